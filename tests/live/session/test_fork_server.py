"""The process that starts sandboxes: its errors, and the CPU time of its forks."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from confine.namespaces import Form
from grader.bounded import limit_memory
from grader.classroom.worker import MOST_MEMORY_BYTES
from grader.errors import PlatformError
from grader.live.session.fork_server import ForkServer
from grader.live.session.runner import sandbox_pid
from tests.live.small_lab import below, command_of, make_lab, name_of, until

pytestmark = pytest.mark.live

FORM = Form.NONE


async def said_by(forks: ForkServer, plan: Path, errors: Path) -> tuple[int, bytes]:
    """Start a sandbox, and return its process id and its messages until its end."""
    said = await forks.start_sandbox(FORM, plan, errors)
    return await sandbox_pid(said), await said.read()


def process_id_of_server() -> int:
    """Return the process id of the one fork server that there is, when no sandbox is in it any more."""
    (found,) = (
        p
        for p in below(os.getpid())
        if "grader.live.session.fork_server" in command_of(p)
        and name_of(p) not in ("", "sandbox", "cpu watch")
    )
    return found


def named(name: str) -> list[int]:
    """Return the ids of this process's descendants with a name."""
    return [pid for pid in below(os.getpid()) if name_of(pid) == name]


def test_a_server_loads_before_the_first_session_is_known(tmp_path: Path) -> None:
    """The server then has the libraries of ROS, and has started nothing; a lab's types are loaded later."""
    with ForkServer() as forks:
        forks.load(FORM)
        until(lambda: "rmw_fastrtps" in libraries_of(process_id_of_server()), 60)
        server = process_id_of_server()
        assert named("cpu watch") == []
        assert "geometry_msgs" not in libraries_of(server)
        forks.likely = ["geometry_msgs/msg/Twist"]
        _, said = asyncio.run(said_by(forks, tmp_path / "none.json", tmp_path / "errors"))
        assert said == b"ended 1\n"
        assert "geometry_msgs" in libraries_of(server)


def test_a_server_that_only_loads_ends_at_once() -> None:
    """An error in the rubric's text comes while it loads; nobody waits for it then."""
    with ForkServer() as forks:
        forks.load(FORM)
    assert named("fork server") == []
    with pytest.raises(ValueError, match="not enough values"):
        process_id_of_server()


def libraries_of(pid: int) -> str:
    """Return the list of the files in a process's memory."""
    return Path(f"/proc/{pid}/maps").read_text(encoding="utf-8")


def test_a_plan_that_cannot_be_read_ends_its_sandbox_only(tmp_path: Path) -> None:
    """The next one is served as well, and the reason is in the file of errors."""
    with ForkServer() as forks:
        for number in range(2):
            pid, said = asyncio.run(said_by(forks, tmp_path / "none.json", tmp_path / "errors"))
            assert pid > 0
            assert said == b"ended 1\n"
            assert "FileNotFoundError" in (tmp_path / "errors").read_text(encoding="utf-8"), number
        until(lambda: not named("sandbox"), 10)


def test_a_server_that_was_killed_is_reported(tmp_path: Path) -> None:
    """A request to a killed server fails at once with an error."""
    with ForkServer(["no/such/type"]) as forks:
        asyncio.run(said_by(forks, tmp_path / "none.json", tmp_path / "errors"))  # it is up
        server = process_id_of_server()
        os.kill(server, signal.SIGKILL)
        with pytest.raises(PlatformError, match="has ended"):
            asyncio.run(said_by(forks, tmp_path / "none.json", tmp_path / "errors"))


#: Becomes the first process of a sandbox, and takes /dev/shm away there.
WITHOUT_SHARED_MEMORY = """
import asyncio, subprocess, sys
from pathlib import Path
from grader.errors import PlatformError
from grader.live.session.runner import sandbox_pid
from grader.live.session.fork_server import ForkServer
from confine.namespaces import Form, enter_sandbox

form, folder = Form(sys.argv[1]), Path(sys.argv[2])
try:
    enter_sandbox(form)
except OSError as problem:
    sys.exit(f"no namespaces here: {problem}")
for name in ("null", "urandom"):
    (folder / name).touch()
    subprocess.run(["mount", "--bind", f"/dev/{name}", folder / name], check=True)
subprocess.run(["mount", "--rbind", folder, "/dev"], check=True)

async def ask(forks):
    said = await forks.start_sandbox(form, folder / "plan.json", folder / "errors")
    try:
        await sandbox_pid(said)
    except PlatformError as error:
        print(error)

with ForkServer() as forks:
    for _ in range(2):
        asyncio.run(ask(forks))
"""


def test_why_no_sandbox_can_be_made_is_reported(tmp_path: Path) -> None:
    """The system's reason for a missing sandbox is reported, to each caller anew.

    Here, shared memory cannot be mounted.
    """
    form = "root" if os.geteuid() == 0 else "user"
    command = [sys.executable, "-c", WITHOUT_SHARED_MEMORY, form, str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if run.stderr.startswith("no namespaces"):
        pytest.skip(run.stderr)
    assert (
        run.stdout.count("a session cannot be started here: [Errno 2] mount: No such file") == 2
    ), run.stderr


def test_sandboxes_do_not_inherit_the_limit_of_the_process_that_grades(tmp_path: Path) -> None:
    """A student's node has the same memory in a class as by itself.

    The limit on memory for judging a submission does not reach it.
    """
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit_memory(MOST_MEMORY_BYTES)
    try:
        assert resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
        with ForkServer() as forks:
            asyncio.run(said_by(forks, tmp_path / "none.json", tmp_path / "errors"))  # it is up
            server = process_id_of_server()
            assert resource.prlimit(server, resource.RLIMIT_AS) == (before[1], before[1])
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_cpu_time_in_sandboxes_counts_as_the_graders(tmp_path: Path) -> None:
    """CPU time of processes in a sandbox counts among this process's children, not as free."""
    busy = "import time\nend = time.process_time() + 1.0\nwhile time.process_time() < end: pass\n"
    steps: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"wait_exit": {"process": "talker", "timeout_s": 40}},
    ]
    lab = make_lab(tmp_path, {"talker": busy}, {"only": steps})
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    lab.record(own_server=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime > 1.0


def test_branches_share_one_watch(tmp_path: Path) -> None:
    """Each watch wakes up two hundred times a second on each core, and a class has many branches."""
    errors = tmp_path / "errors"
    with ForkServer() as forks:
        with forks.branch(FORM) as one, forks.branch(FORM) as other:
            for branch in (one, other):
                asyncio.run(said_by(branch, tmp_path / "none.json", errors))
            watches = named("cpu watch")
            assert len(watches) == 1
        until(lambda: not named("fork server"), 10)
        assert named("cpu watch") == watches, "a later branch has it too"
    until(lambda: not named("cpu watch"), 10)
