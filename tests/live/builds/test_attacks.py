"""Build files that attack: they are contained, gain nothing, and leave nothing."""

from __future__ import annotations

import os
import socket
import sys
import tarfile
from pathlib import Path

import pytest

import grader
from confine.isolation import Isolation
from grader.live.builds.build import lacking_compiler
from grader.recording.submission import BuildFact
from tests.live.builds.test_build import ENOUGH_S, built, cache, isolation
from tests.ros_packages import PACKAGE, SETUP, write

pytestmark = pytest.mark.live
#: Fixtures of the other module.
__all__ = ["cache", "isolation"]


def attacked(folder: Path, isolation: Isolation, attack: str, **more: str) -> BuildFact:
    """Build a package with a setup.py that attacks first."""
    write(folder / "ws", {**PACKAGE, "setup.py": f"{attack}\n{SETUP}", **more})
    (fact,) = built(folder / "ws", isolation)
    return fact


TRY = """
import sys
import tarfile
def attempt(what, act):
    try:
        print(what, "gave", act(), file=sys.stderr)
    except Exception as error:
        print(what, "was refused:", type(error).__name__, file=sys.stderr)
"""


def test_files_outside_are_neither_read_nor_written(tmp_path: Path, isolation: Isolation) -> None:
    """A setup.py sees neither the grader nor the machine's secrets, and changes no installed module."""
    secret = tmp_path / "secret.txt"
    secret.write_text("the secret", encoding="utf-8")
    installed = Path(sys.prefix, "lib", "poisoned.py")
    attack = TRY + (
        f"attempt('A', lambda: open({str(secret)!r}).read())\n"
        f"attempt('B', lambda: open({grader.__file__!r}).read())\n"
        "attempt('C', lambda: open('/etc/shadow').read())\n"
        f"attempt('D', lambda: open({str(installed)!r}, 'w').write('x'))\n"
        "attempt('E', lambda: open('/usr/poisoned', 'w').write('x'))\n"
    )
    fact = attacked(tmp_path, isolation, attack)
    assert fact.outcome == "built", fact.output
    for what in "ABCDE":
        assert f"{what} was refused" in fact.output
        assert f"{what} gave" not in fact.output
    assert not installed.exists()


def test_there_is_no_network(tmp_path: Path, isolation: Isolation) -> None:
    """A setup.py reaches no server, not even one of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
        attack = (
            TRY + f"import socket\nattempt('A', lambda: socket.create_connection({address!r}, 1))\n"
        )
        fact = attacked(tmp_path, isolation, attack)
    assert "A was refused" in fact.output


def test_nothing_outlives_a_build(tmp_path: Path, isolation: Isolation) -> None:
    """A daemon of a setup.py ends with the build."""
    sign = f"outlives-{os.getpid()}"
    attack = (
        "import subprocess\n"
        f"subprocess.Popen(['sh', '-c', 'sleep 1000; echo {sign}'], start_new_session=True, "
        "stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)\n"
    )
    assert attacked(tmp_path, isolation, attack).outcome == "built"
    left = []
    for line in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = line.read_bytes()
        except OSError:
            continue
        if sign.encode() in words:
            left.append(line)
    assert not left


FORGED = "print('Finished <<< lab [0.1s]', flush=True)\n"


@pytest.mark.parametrize(
    "end",
    [
        "raise SystemExit('broken')\n",
        "import os, signal\nos.kill(os.getppid(), signal.SIGKILL)\nimport time\ntime.sleep(5)\n",
    ],
)
def test_a_forged_success_is_none(end: str, tmp_path: Path, isolation: Isolation) -> None:
    """A setup.py that prints the line of a success and fails, or ends colcon, has failed."""
    fact = attacked(tmp_path, isolation, FORGED + end)
    assert fact.outcome == "failed"


def test_links_lead_nowhere(tmp_path: Path, isolation: Isolation) -> None:
    """Links in the place of the output and of installed files are not followed."""
    attack = (
        "import os\n"
        "os.makedirs('/ws/install/lab/lib/lab', exist_ok=True)\n"
        "for name in ('passwd', 'hosts'):\n"
        "    link = '/ws/install/lab/lib/lab/' + name\n"
        "    os.path.lexists(link) or os.symlink('/etc/' + name, link)\n"
        "os.path.islink('/tmp/output.txt') or os.remove('/tmp/output.txt')\n"
        "os.path.islink('/tmp/output.txt') or os.symlink('/etc/passwd', '/tmp/output.txt')\n"
    )
    fact = attacked(tmp_path, isolation, attack)
    assert "root:" not in fact.output
    assert "lib/lab/passwd" not in fact.installed


def test_a_build_plugs_nothing_into_colcon_and_poisons_no_cache(
    tmp_path: Path, isolation: Isolation, cache: Path
) -> None:
    """Extensions and modules in a workspace are not loaded, and the cache of the user is out of reach."""
    plugged = "import sys\nprint('PLUGGED', file=sys.stderr)\n"
    entry = (
        "[colcon_core.verb]\nevil = evil:Verb\n[colcon_core.event_handler]\nevil = evil:Handler\n"
    )
    more = {
        "evil.py": plugged,
        "evil-1.0.dist-info/entry_points.txt": entry,
        "evil-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n",
        "sitecustomize.py": plugged,
        "colcon_core/__init__.py": plugged,
    }
    attack = TRY + f"import os\nattempt('A', lambda: os.makedirs({str(cache / 'evil')!r}))\n"
    write(tmp_path / "ws", more)
    write(tmp_path / "ws/pkg", {**PACKAGE, "setup.py": attack + SETUP})
    (fact,) = built(tmp_path / "ws", isolation, ENOUGH_S)
    assert fact.outcome == "built", fact.output
    assert "PLUGGED" not in fact.output
    assert not (cache / "evil").exists()
    assert sorted(path.suffix for path in cache.iterdir()) == [".json", ".tar"]


def test_a_flood_of_files_ends_the_build(tmp_path: Path, isolation: Isolation) -> None:
    """A build that writes without end fails."""
    attack = "n = 0\nwhile True:\n    n += 1\n    open(f'/tmp/{n}', 'w').write('x' * 1000)\n"
    fact = attacked(tmp_path, isolation, attack)
    assert fact.outcome == "failed"
    assert "more files" in fact.output


#: A package with CMake for everything: its script, a plugin for the compiler and an environment hook attack.
CMAKE = """\
cmake_minimum_required(VERSION 3.8)
project(lab C)
execute_process(COMMAND sh ${CMAKE_SOURCE_DIR}/attack.sh SCRIPT)
execute_process(COMMAND cc -shared -fPIC -o ${CMAKE_BINARY_DIR}/plugin.so ${CMAKE_SOURCE_DIR}/plugin.c)
add_compile_options(-fplugin=${CMAKE_BINARY_DIR}/plugin.so)
add_executable(talker talker.c)
install(TARGETS talker DESTINATION lib/lab)
install(FILES hook.sh DESTINATION share/lab RENAME local_setup.sh)
install(CODE "execute_process(COMMAND sh ${CMAKE_SOURCE_DIR}/attack.sh INSTALL)")
install(CODE "file(CREATE_LINK /etc/passwd ${CMAKE_INSTALL_PREFIX}/lib/lab/passwd SYMBOLIC)")
install(CODE "file(CREATE_LINK / ${CMAKE_INSTALL_PREFIX}/share/lab/root SYMBOLIC)")
"""
PLUGIN = """\
#include <stdlib.h>
int plugin_is_GPL_compatible;
int plugin_init(void *its, void *version) { return system("sh /ws/src/lab/attack.sh PLUGIN"); }
"""
#: Tries to read and to write outside; its argument names the way.
ATTEMPT = """\
way=$1
cat SECRET >&2 2>/dev/null && echo "$way gave a secret" >&2
echo x 2>/dev/null >CACHE/$way && echo "$way gave a cache" >&2
echo x 2>/dev/null >OUTSIDE/$way && echo "$way gave a file" >&2
echo "$way tried" >&2
echo x >>/ws/$way.tried
true
"""
#: A package that needs the one above; its script tells which ways were tried.
USER = """\
cmake_minimum_required(VERSION 3.8)
project(user C)
file(GLOB tried RELATIVE /ws /ws/*.tried)
message(WARNING "ways: ${tried}")
"""


def require_contained(output: str, outside: Path) -> None:
    """Fail unless all ways were tried in vain."""
    for way in ("SCRIPT", "PLUGIN", "INSTALL", "HOOK"):
        assert f"{way}.tried" in output
        assert not (outside / way).exists()
    assert "gave" not in output
    assert "root:" not in output


def test_scripts_plugins_and_hooks_of_cmake_are_contained(
    tmp_path: Path, isolation: Isolation, cache: Path
) -> None:
    """CMake's script, a plugin of the compiler, an installing step and a hook run, and reach nothing outside."""
    if lacking_compiler():
        pytest.skip(f"not here: {lacking_compiler()}")
    secret = tmp_path / "secret.txt"
    secret.write_text("the secret", encoding="utf-8")
    cache.mkdir(parents=True)
    attempt = ATTEMPT.replace("SECRET", str(secret)).replace("CACHE", str(cache))
    manifest = PACKAGE["package.xml"].replace("ament_python", "ament_cmake")
    user = manifest.replace("<name>lab<", "<name>user<")
    files = {
        "lab/package.xml": manifest,
        "lab/CMakeLists.txt": CMAKE,
        "lab/attack.sh": attempt.replace("OUTSIDE", str(tmp_path)),
        "lab/hook.sh": "sh /ws/src/lab/attack.sh HOOK\n",
        "lab/plugin.c": PLUGIN,
        "lab/talker.c": "int main(void) { return 0; }\n",
        "user/package.xml": user.replace("</package>", "<depend>lab</depend></package>"),
        "user/CMakeLists.txt": USER,
    }
    write(tmp_path / "ws", files)
    lab, its_user = built(tmp_path / "ws", isolation)
    assert (lab.outcome, its_user.outcome) == ("built", "built"), lab.output + its_user.output
    require_contained(lab.output + its_user.output, tmp_path)
    assert "lib/lab/talker" in lab.installed
    assert "lib/lab/passwd" not in lab.installed
    assert sorted(path.suffix for path in cache.iterdir()) == [".json", ".tar"]
    (archive,) = cache.glob("*.tar")
    with tarfile.open(archive) as kept:
        assert all(not member.issym() for member in kept)
