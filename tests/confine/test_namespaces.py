"""The first process of a sandbox: namespaces shared with others, and one end for both."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

FORM = "ROOT" if os.geteuid() == 0 else "USER"
PROGRAM = """
import os, select, signal, socket, sys, time
from pathlib import Path
from confine.namespaces import Form, enter_sandbox

before = {{name: os.readlink(f"/proc/self/ns/{{name}}") for name in ("net", "mnt", "ipc", "uts", "pid")}}
outside = os.getpid()
enter_sandbox(Form.{form})
{body}
"""


def in_cell(body: str) -> subprocess.CompletedProcess[str]:
    """Run the text as the first process of a cell."""
    program = PROGRAM.format(form=FORM, body=body)
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )


def as_root(body: str) -> subprocess.CompletedProcess[str]:
    """Run the text with the names of `in_cell`, outside of all cells."""
    program = PROGRAM.format(form="ROOT", body=body).replace("enter_sandbox(Form.ROOT)\n", "")
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.fixture(scope="module", autouse=True)
def _permitted() -> None:
    """Skip where no sandboxes can be made."""
    run = in_cell("")
    if run.returncode != 0:
        pytest.skip(f"no namespaces here: {run.stderr.strip().splitlines()[-1]}")


def test_a_sandbox_shares_no_namespace_with_its_surroundings() -> None:
    """Network, mounts, IPC, host name and process ids are its own, with a loopback and itself in them."""
    run = in_cell("""
print([name for name, was in before.items() if os.readlink(f"/proc/self/ns/{name}") == was])
print(os.getpid(), [p.name for p in Path("/proc").iterdir() if p.name.isdecimal()])
print([name for _, name in socket.if_nameindex()])
""")
    assert run.stdout.splitlines() == ["[]", "1 ['1']", "['lo']"], run.stderr


def test_mounts_of_a_sandbox_are_seen_nowhere_else(tmp_path: Path) -> None:
    """Mounts made by the first process stay in the cell."""
    mount = f'subprocess.run(["mount", "-t", "tmpfs", "none", {str(tmp_path)!r}], check=True)'
    run = in_cell(
        f"import subprocess; {mount}; print({str(tmp_path)!r} in Path('/proc/self/mounts').read_text())"
    )
    assert run.stdout.strip() == "True", run.stderr
    assert str(tmp_path) not in Path("/proc/self/mounts").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("body", "status"), [("sys.exit(7)", 7), ("os.kill(outside, 0)", 1), ("", 0)]
)
def test_the_process_outside_ends_as_the_first_one_does(body: str, status: int) -> None:
    """The outer process passes the first one's status on.

    From within, outer processes cannot be named.
    """
    assert in_cell(body).returncode == status


def test_a_sandbox_ends_with_the_process_outside() -> None:
    """Killing the outer process ends all processes of the sandbox, in other sessions too."""
    body = "import subprocess; subprocess.Popen(['sleep', '600'], start_new_session=True); print('up', flush=True); "
    program = PROGRAM.format(form=FORM, body=body + "time.sleep(600)")
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        os.kill(process.pid, signal.SIGKILL)
        # All of them hold the pipe.
        assert process.stdout.read() == ""


@pytest.mark.parametrize("has_setting", [True, False])
def test_later_processes_of_a_sandbox_have_other_ids(*, has_setting: bool) -> None:
    """The lowest ids are used up, also by a kernel without the setting for it."""
    without = "namespaces._LAST_ID = Path('/missing')"
    run = in_cell(f"""
from confine import namespaces
{"" if has_setting else without}
namespaces.use_up_process_ids(12)
later = os.fork()
if later == 0:
    os._exit(0)
os.wait()
print(later)
""")
    assert run.stdout.strip() == "14", run.stderr


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can come back from a namespace")
def test_a_fork_can_be_the_first_process_of_a_sandbox() -> None:
    """The fork shares no namespace with its parent, and the later forks of the parent are outside of the sandbox."""
    run = as_root("""
from confine.namespaces import enter_rest_of_sandbox, fork_first
for _ in range(2):
    first = fork_first()
    if first == 0:
        enter_rest_of_sandbox()
        print([name for name, was in before.items() if os.readlink(f"/proc/self/ns/{name}") == was])
        print(os.getpid(), [p.name for p in Path("/proc").iterdir() if p.name.isdecimal()], flush=True)
        os._exit(5)
    print(os.waitpid(first, 0) == (first, 5 << 8), flush=True)
plain = os.fork()
if plain == 0:
    os._exit(int(os.getpid() == 1))
print(os.waitpid(plain, 0) == (plain, 0), os.readlink("/proc/self/ns/pid_for_children") == before["pid"])
""")
    assert run.stdout.splitlines() == ["[]", "1 ['1']", "True"] * 2 + ["True True"], run.stderr


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can come back from a namespace")
@pytest.mark.parametrize("is_late", [True, False])
def test_a_first_process_ends_with_the_one_that_forked_it(*, is_late: bool) -> None:
    """The parent may end before or after the fork has asked for that; the processes of the fork end too."""
    run = as_root(f"""
from confine import namespaces
told, telling = os.pipe()
ready, starting = os.pipe()
late = {is_late}
ask = namespaces.end_with_parent
def asking():
    if late:
        select.select([parent], [], [])
    ask()
namespaces.end_with_parent = asking
if os.fork() == 0:
    parent = os.pidfd_open(os.getpid())
    if namespaces.fork_first() == 0:
        os.write(starting, b"x")
        if os.fork() == 0:
            time.sleep(600)
        os.write(telling, b"it lives")
        time.sleep(600)
    if not late:
        os.read(ready, 1)
    os._exit(0)
os.close(telling)
os.wait()
said = b""
# Ends when all of them have ended.
while block := os.read(told, 100):
    said += block
print(said.count(b"it lives") <= (not late))
""")
    assert run.stdout.strip() == "True", run.stderr


def test_a_fork_is_refused_if_there_is_no_way_back() -> None:
    """A user namespace has the process ids of its surroundings: nothing is changed there."""
    program = PROGRAM.format(form="ROOT", body="").replace("enter_sandbox(Form.ROOT)\n", "")
    program += """
from confine.namespaces import fork_first
try:
    fork_first()
except OSError as problem:
    print(type(problem).__name__, os.readlink("/proc/self/ns/pid_for_children") == before["pid"])
"""
    run = subprocess.run(
        ["unshare", "--user", "--map-root-user", sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if run.returncode != 0:
        pytest.skip(f"no user namespaces here: {run.stderr}")
    assert run.stdout.strip() == "PermissionError True", run.stderr
