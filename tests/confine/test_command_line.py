"""`python -m confine`: the confinement of a command and the exit status."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import confine
from confine.isolation import Level
from confine.landlock import landlock_version
from confine.probing import probe_isolation

pytestmark = pytest.mark.live

README = Path(confine.__file__).with_name("README.md")


def run(*words: str, path: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line, with another search path if one is given."""
    environment = dict(os.environ)
    if path is not None:
        environment["PATH"] = path
    return subprocess.run(
        [sys.executable, "-m", "confine", *words],
        input="from outside\n",
        capture_output=True,
        text=True,
        env=environment,
        timeout=60,
        check=False,
    )


@pytest.fixture(scope="module", autouse=True)
def level() -> Level:
    """Give this machine's level; skip where nothing can be confined."""
    found = probe_isolation(Path(sys.executable)).level
    if not found.at_least(Level.REDUCED):
        pytest.skip("nothing can be confined here")
    return found


@pytest.fixture
def tools(tmp_path: Path) -> str:
    """Give a search path without bubblewrap."""
    for name in ("setpriv", "prlimit"):
        (tmp_path / name).symlink_to(f"/usr/bin/{name}")
    return str(tmp_path)


@pytest.mark.parametrize(
    ("words", "status", "output"),
    [
        (["cat"], 0, "from outside\n"),
        (["sh", "-c", "echo $HOME; exit 7"], 7, "/home/user\n"),
        (["sh", "-c", "kill -9 $$"], 137, ""),
        (["sh", "-c", 'x=1; "$0" -c "print(4)"', sys.executable], 0, "4\n"),
    ],
)
def test_it_ends_as_the_command_does(
    level: Level, words: list[str], status: int, output: str
) -> None:
    """The input and the outputs are the command's, and the level is said apart from them."""
    done = run("--", *words)
    assert done.returncode == status, done.stderr
    if level.at_least(Level.NO_CGROUP):
        assert done.stdout == output
    assert done.stderr.startswith(f"confine: level {level.value}")


def test_it_sees_the_folders_that_are_shown_only(tmp_path: Path) -> None:
    """A shown folder can be read and not changed; the one beside it is not there."""
    shown, hidden = tmp_path / "shown", tmp_path / "hidden"
    for folder in (shown, hidden):
        folder.mkdir()
        (folder / "file").write_text(folder.name)
        folder.chmod(0o755)
    tries = f"cat {shown}/file; cat {hidden}/file || echo none; touch {shown}/new || echo denied"
    for parent in tmp_path.parents[:2]:
        parent.chmod(0o755)
    done = run("--read", str(shown), "--", "sh", "-c", tries)
    assert done.stdout == "shownnone\ndenied\n", done.stderr


def test_it_is_alone_with_its_loopback(level: Level) -> None:
    """A confined command sees neither the network nor the processes of the machine."""
    if not level.at_least(Level.NO_CGROUP):
        pytest.skip("no namespaces here")
    assert int(run("--", "sh", "-c", "ls /proc | grep -c '^[0-9]*$'").stdout) < 10
    program = "import socket; print([name for _, name in socket.if_nameindex()])"
    assert run("--", sys.executable, "-c", program).stdout == "['lo']\n"


def test_it_cannot_fill_the_disk(level: Level) -> None:
    """The folders of a confined command have a limited size."""
    if not level.at_least(Level.NO_CGROUP):
        pytest.skip("no namespaces here")
    fill = "for n in 1 2 3; do head -c 40000000 /dev/zero > $n || echo full; done"
    assert run("--", "sh", "-c", fill).stdout == "full\nfull\n"


def test_a_command_that_takes_too_long_is_ended() -> None:
    """The exit status equals timeout(1)'s, 124."""
    done = run("--timeout", "0.5", "--", "sleep", "50")
    assert done.returncode == 124
    assert "after 0.5 s" in done.stderr


@pytest.mark.skipif(landlock_version() < 1, reason="this kernel has no Landlock")
def test_nothing_outlives_the_command_without_namespaces(tools: str, tmp_path: Path) -> None:
    """A process in a session of its own is killed: it holds the output no longer."""
    daemon = "import os, time; os.fork() and os._exit(5); os.setsid(); os.fork() and os._exit(0); time.sleep(600)"
    done = run("--", sys.executable, "-c", daemon, path=tools)
    assert done.returncode == 5, done.stderr


@pytest.mark.skipif(landlock_version() < 1, reason="this kernel has no Landlock")
def test_too_low_a_level_is_refused_with_a_remedy(tools: str) -> None:
    """The command does not run: its status is 125."""
    done = run("--at-least", "no-cgroup", "--", "echo", "ran", path=tools)
    assert (done.returncode, done.stdout) == (125, "")
    assert "'no cgroup' is required. Install bubblewrap" in done.stderr


def test_a_machine_that_confines_nothing_is_named(tmp_path: Path) -> None:
    """The remedy stands where the level would."""
    done = run("--", "echo", "ran", path=str(tmp_path))
    assert (done.returncode, done.stdout) == (125, "")
    assert "Install util-linux (setpriv, prlimit not found)." in done.stderr


def test_its_help_names_levels_and_statuses() -> None:
    """The page fits on a screen."""
    said = run("--help").stdout
    assert "full, no-cgroup, reduced, none" in said
    assert "125" in said
    assert len(said.splitlines()) < 40


def test_the_example_of_the_readme_runs(level: Level) -> None:
    """The README's example prints the user id of a confined program."""
    example = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert example is not None
    command = [sys.executable, "-c", example[1]]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    assert int(said) != 0 or level is Level.REDUCED
