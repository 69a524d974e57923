"""Forks as programs: their inheritance, their end, and their reports."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.live.small_lab import until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")

#: Forks MAIN, gives it INPUT, and prints its output and its exit status.
PROGRAM = """
import asyncio, os, resource, signal, sys
from grader.live.process.forked import Program, run_script, start_forked

signal.signal(signal.SIGINT, signal.SIG_IGN)
opened = os.dup2(os.open("/", os.O_RDONLY), 50)

{main}

async def run():
    process = start_forked(Program("a fork", main, {{"ONLY": "this"}}, {limit}))
    process.stdin.write(b"a line\\n")
    process.stdin.close()
    said, errors = await asyncio.to_thread(process.stdout.read), await asyncio.to_thread(process.stderr.read)
    print(await process.wait(), said.decode(), errors.decode()[-500:], sep="|", end="")

asyncio.run(run())
"""


def forked(main: str, limit: int | None = None) -> tuple[int, str, str]:
    """Fork a program that the text defines as `main`; returns status, output and errors."""
    program = PROGRAM.format(main=main, limit=limit)
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    status, said, errors = run.stdout.split("|", 2)
    return int(status), said, errors


def test_a_fork_has_its_own_environment_and_pipes() -> None:
    """A fork has its own input and environment, and no arguments but its name."""
    status, said, _ = forked(
        "def main(): print(sys.argv, dict(os.environ), sys.stdin.read().strip(), os.getcwd())"
    )
    assert (status, said) == (0, "['a fork'] {'ONLY': 'this'} a line /\n")


def test_a_fork_keeps_no_descriptor_and_no_signal_of_the_other_process() -> None:
    """A fork closes inherited files, and does not ignore Ctrl-C although its parent does."""
    main = """def main():
    descriptors = set(map(int, os.listdir("/proc/self/fd")))
    print(opened in descriptors, len(descriptors) <= 4, signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""
    assert forked(main)[1] == "False True True\n"


def test_a_fork_has_a_session_of_its_own() -> None:
    """A fork leads a session of its own, with a scheduling weight and signals of its own."""
    assert forked("def main(): print(os.getsid(0) == os.getpid())")[1] == "True\n"


def test_a_fork_goes_by_its_name() -> None:
    """A fork shows its own name in a list of processes."""
    assert forked('def main(): print(open("/proc/self/comm").read().strip())')[1] == "a fork\n"


@pytest.mark.parametrize(
    ("body", "status", "error"),
    [
        ("pass", 0, ""),
        ("sys.exit(3)", 3, ""),
        ("sys.exit()", 0, ""),
        ("raise ValueError('broken')", 1, "ValueError: broken\n"),
        ("os.kill(os.getpid(), signal.SIGKILL)", -9, ""),
    ],
    ids=["return", "exit with a status", "exit", "exception", "signal"],
)
def test_a_fork_ends_as_a_program_does(body: str, status: int, error: str) -> None:
    """The status tells how, and an exception is written to standard error."""
    ended, _, errors = forked(f"def main(): {body}")
    assert ended == status
    assert errors.endswith(error)
    assert bool(errors) == bool(error)


def test_a_script_runs_as_a_program(tmp_path: Path) -> None:
    """A script is the main module of its fork, under its own path and with its arguments."""
    (tmp_path / "it.py").write_text("import sys\nprint(__name__, sys.argv)\n", encoding="utf-8")
    file = str(tmp_path / "it.py")
    assert forked(f"def main(): run_script({file!r}, '-')")[1] == f"__main__ [{file!r}, '-']\n"


def test_a_fork_may_not_map_more_than_it_is_allowed() -> None:
    """A fork that maps more memory than its limit is refused."""
    status, _, errors = forked("def main(): bytearray(2**30)", limit=2**29)
    assert status == 1
    assert "MemoryError" in errors


def test_a_fork_ends_with_the_process_that_it_comes_from() -> None:
    """If that is killed, nothing of it goes on."""
    program = PROGRAM.format(
        main="""def main():
    import time
    os.write(told, str(os.getpid()).encode())
    time.sleep(600)
told = 2
""",
        limit=None,
    ).replace(
        "said, errors =",
        "print(process.stderr.read(9).decode(), flush=True); said, errors =",
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        fork = int(process.stdout.readline())
        assert Path(f"/proc/{fork}").exists()
        os.kill(process.pid, signal.SIGKILL)
        process.wait(timeout=20)
        until(lambda: not Path(f"/proc/{fork}").exists(), 10)
