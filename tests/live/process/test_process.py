"""Processes with real programs: their kept output, and their descendants."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys

import pytest

from confine.machine import descendants_of
from grader.live.process.process import (
    MAX_OUTPUT_BYTES,
    MAX_OUTPUT_LINES,
    OutputRoom,
    PipeReader,
    RunningProcess,
)
from grader.recording.session import ProcessRun

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")

#: A thread starts a child and stays; the child's first thread ends and another one goes on.
_HIDDEN = """
import ctypes, os, threading, time
def child():
    if os.fork() == 0:
        threading.Thread(target=time.sleep, args=(60,)).start()
        print(os.getpid(), flush=True)
        ctypes.CDLL(None).syscall(60, 0)
    time.sleep(60)
threading.Thread(target=child).start()
"""


def run(program: str, room: OutputRoom | None = None) -> ProcessRun:
    """Run a Python program to its end."""
    record = ProcessRun("it", "student", [])

    async def to_the_end() -> None:
        running = await RunningProcess.start(
            record, [sys.executable, "-c", program], environment={}, room=room
        )
        assert await running.wait_exit(60)

    asyncio.run(to_the_end())
    return record


def test_a_line_ends_the_wait_for_it() -> None:
    """Each line ends one wait, the end of the process does, and otherwise the time."""
    record = ProcessRun("it", "student", [])
    heard = []

    async def listen() -> None:
        running = await RunningProcess.start(
            record,
            [sys.executable, "-c", "print(1, flush=True); print(input(), flush=True)"],
            environment={},
            with_input=True,
        )
        await running.wait_said(60)
        heard.append([line.text for line in record.output])
        await running.wait_said(0.01)
        running.write(b"2\n", last=True)
        await running.wait_said(60)
        heard.append([line.text for line in record.output])
        await running.wait_exit(60)
        await running.wait_said(60)

    asyncio.run(listen())
    assert heard == [["1"], ["1", "2"]]


def test_lines_are_kept_up_to_a_number() -> None:
    """A million empty lines are counted, and some of them kept."""
    record = run("import os; [os.write(1, b'\\n' * 100_000) for _ in range(10)]")
    assert len(record.output) == MAX_OUTPUT_LINES
    assert record.output_dropped_bytes == 10**6 - MAX_OUTPUT_LINES


def test_a_carriage_return_ends_a_line() -> None:
    """A status line is one line each time, and the two characters of Windows end one line together."""
    written = [b"a\r", b"\nb\r\n", b"RMS: 1", b"\rRMS: 2\rRMS", b": 3\r"]
    record = run(f"import os; [os.write(1, text) for text in {written}]")
    assert [line.text for line in record.output] == ["a", "b", "RMS: 1", "RMS: 2", "RMS: 3"]
    times = [line.t_ns for line in record.output]
    assert times == sorted(times)


#: Forks a program that sends messages, and prints their lengths.
_SENDS = """
import asyncio, os
from grader.live.process.forked import Program
from grader.live.process.process import RunningProcess
from grader.recording.session import ProcessRun

def send():
    for text in (b"a", b"\\nbc\\n", b"d" * 10**6 + b"\\nef"):
        os.write(1, text) if len(text) < 10 else os.fdopen(os.dup(1), "wb").write(text)

async def hear():
    heard = []
    process = await RunningProcess.fork(
        ProcessRun("it", "grader", []), Program("it", send, {}), on_message=heard.append
    )
    await process.wait_exit(20)
    print([len(message) for message in heard], heard[1])

asyncio.run(hear())
"""


def test_a_message_is_heard_whole() -> None:
    """A message of a program of the grader ends with its line, in however many pieces it comes, or with the output."""
    said = subprocess.run(
        [sys.executable, "-c", _SENDS], capture_output=True, text=True, timeout=60, check=True
    )
    assert said.stdout == "[1, 2, 1000000, 2] b'bc'\n"


def test_long_output_is_kept_up_to_a_size() -> None:
    """One megabyte of eight is kept, in whole lines."""
    record = run("import os; [os.write(1, (b'x' * 1023 + b'\\n') * 64) for _ in range(128)]")
    assert (
        MAX_OUTPUT_BYTES - 2048
        < sum(len(line.text) + 1 for line in record.output)
        <= MAX_OUTPUT_BYTES
    )
    assert record.output_dropped_bytes == 128 * 64 * 1024 - sum(
        len(line.text) + 1 for line in record.output
    )


_FLOODS = """
import time
for _ in range(200_000):
    print("again" * 8)
print("x" * 100)
try:
    time.sleep(60)
except KeyboardInterrupt:
    print("Mean: [1.0]")
"""


def test_the_last_output_of_a_flooding_program_is_kept() -> None:
    """The output after Ctrl-C has room of its own, behind any amount of output before."""
    record = ProcessRun("it", "student", [])

    async def stop() -> None:
        running = await RunningProcess.start(
            record, [sys.executable, "-u", "-c", _FLOODS], environment={}
        )
        while record.output_dropped_bytes < 200_000 * 41 - MAX_OUTPUT_BYTES:
            await asyncio.sleep(0.05)
        assert "x" * 100 not in [line.text for line in record.output]
        await running.stop(10)

    asyncio.run(asyncio.wait_for(stop(), 60))
    assert record.output[-1].text == "Mean: [1.0]"
    kept = [line.text for line in record.output[:-1]]
    assert set(kept) == {"again" * 8}


def test_processes_of_a_session_share_their_room() -> None:
    """The processes of a session share one room for output: the second gets the rest."""
    room = OutputRoom(bytes=100, lines=5)
    assert len(run("print('a\\n' * 2, end='')", room).output) == 2
    second = run("print('b\\n' * 10, end='')", room)
    assert (len(second.output), second.output_dropped_bytes) == (3, 14)


def test_a_child_of_any_thread_is_found() -> None:
    """A child belongs to its process whichever thread started it.

    It is found even after the child's own first thread has ended.
    """
    with subprocess.Popen(
        [sys.executable, "-c", _HIDDEN], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            child = int(process.stdout.readline())
            assert child in descendants_of(process.pid)
        finally:
            for pid in descendants_of(process.pid):
                os.kill(pid, 9)


def test_who_writes_without_end_to_a_pipe_is_cut_off() -> None:
    """Once there is enough, it is handed on, and the writer gets an error instead of keeping us busy."""
    told: list[str] = []
    program = "import os, sys\ntry:\n while True: os.write(int(sys.argv[1]), b'x' * 65536)\nexcept OSError: pass"

    async def read() -> int:
        reading, writing = os.pipe()
        PipeReader(reading, 10**6, told.append)
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", program, str(writing), pass_fds=(writing,)
        )
        os.close(writing)
        return await asyncio.wait_for(process.wait(), 60)

    assert asyncio.run(read()) == 0
    assert len(told) == 1
    assert 10**6 <= len(told[0]) < 2 * 10**6


#: Prints the cores of a process of another user: before it is held to one, after a trial, and after one as that user.
_HOLDS = """
import asyncio, os, sys, time
from grader.live.process.process import RunningProcess
from grader.recording.session import ProcessRun

async def hold():
    command = ["setpriv", "--reuid=64299", "--regid=64299", "--clear-groups", "sleep", "60"]
    running = await RunningProcess.start(ProcessRun("it", "student", []), command, environment={})
    end_s = time.monotonic() + 20
    while os.stat(f"/proc/{running.root_pid()}").st_uid != 64299 and time.monotonic() < end_s:
        await asyncio.sleep(0.01)
    core = max(os.sched_getaffinity(0))
    for user in ("nobody", None, 64299):
        if user != "nobody":
            running.hold_to_core(core, user)
        # On a machine that halts just then, what holds it is given up.
        while user == 64299 and len(os.sched_getaffinity(running.root_pid())) > 1 and time.monotonic() < end_s:
            running.hold_to_core(core, user)
        print(len(os.sched_getaffinity(running.root_pid())))
    await running.kill()

asyncio.run(hold())
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root starts processes of other users")
@pytest.mark.skipif(
    len(os.sched_getaffinity(0)) < 2, reason="with one core there is nothing to choose"
)
def test_a_process_of_another_user_is_held_to_a_core_where_root_may_not_do_so() -> None:
    """In a container, root lacks the capability for it, and does it as that user."""
    container = ["setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice", "--"]
    command = [*container, sys.executable, "-c", _HOLDS]
    paths = os.pathsep.join(path for path in sys.path if path)
    said = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    cores = str(len(os.sched_getaffinity(0)))
    assert said.stdout.split() == [cores, cores, "1"]


#: Tells its child's process id as bubblewrap does, in two pieces; the child's child is the program.
_TOLD_IN_PIECES = """
import os, sys, time
told = int(sys.argv[1])
replaced, held = os.pipe()
sandbox = os.fork()
if sandbox == 0:
    if os.fork() == 0:
        os.execvp("sleep", ["sleep", "60"])
    os.close(held)
    os.wait()
    os._exit(0)
os.close(held)
os.write(told, b'{"child-pid": %d' % sandbox)
os.read(replaced, 1)  # It ends once the program has replaced Python, which can lose a signal before.
time.sleep(0.3)
os.write(told, b', "pid-namespace": 1}')
os.wait()
"""


def test_a_program_is_found_however_its_sandbox_tells_of_it() -> None:
    """A process id that arrives in pieces is put together, and the program can be interrupted."""
    record = ProcessRun("it", "student", [])
    told, tells = os.pipe()
    os.set_blocking(told, False)

    async def interrupted() -> None:
        command = [sys.executable, "-c", _TOLD_IN_PIECES, str(tells)]
        running = await RunningProcess.start(
            record,
            command,
            environment={"PATH": os.defpath},
            pass_fds=(tells,),
            child_pid_fd=told,
        )
        await running.stop(20)

    asyncio.run(asyncio.wait_for(interrupted(), 40))
    assert record.ended_by == "interrupt"
    assert record.interrupted_ns is not None


#: Computes for 0.6 s of CPU time in children, one after the other, that nobody looks at while they live.
_SHORT_LIVES = """
import os, time
for _ in range(20):
    if os.fork() == 0:
        while time.process_time() < 0.03:
            pass
        os._exit(0)
    os.wait()
print("done", flush=True)
time.sleep(60)
"""


def test_what_children_used_that_came_and_went_counts() -> None:
    """CPU time of a program includes children that started and ended between two looks."""

    async def used_ns() -> int:
        run = ProcessRun("it", "student", [])
        running = await RunningProcess.start(
            run, [sys.executable, "-c", _SHORT_LIVES], environment={}
        )
        while not run.output:
            await asyncio.sleep(0.01)
        running.sample_usage()
        await running.kill()
        return run.usage[-1].cpu_ns

    assert asyncio.run(used_ns()) > 500_000_000


#: Keeps the last core busy, in as many processes as the count says.
_BUSY = """
import os
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
for _ in range(COUNT - 1):
    if os.fork() == 0:
        break
while True:
    pass
"""


@pytest.mark.parametrize(("own", "others"), [(4, 0), (1, 3)])
def test_only_other_programs_delay_a_program(own: int, others: int) -> None:
    """A program that waits for its own children is not delayed by the machine; one beside other programs is."""
    record = ProcessRun("it", "student", [])
    beside = []
    for _ in range(others):
        busy = [sys.executable, "-c", _BUSY.replace("COUNT", "1")]
        beside.append(subprocess.Popen(busy))

    async def delay_by_others_s() -> float:
        running = await RunningProcess.start(
            record, [sys.executable, "-c", _BUSY.replace("COUNT", str(own))], environment={}
        )
        await asyncio.sleep(2.0)
        running.sample_usage()
        delay_s = running.delay_by_others_s()
        await running.kill()
        return delay_s

    try:
        delay_s = asyncio.run(delay_by_others_s())
    finally:
        for program in beside:
            program.kill()
            program.wait()
    whole_s = record.usage[-1].run_delay_ns / 1e9
    assert whole_s > 0.5
    if others:
        assert delay_s > 0.8 * whole_s
    else:
        assert delay_s < 0.2 * whole_s
