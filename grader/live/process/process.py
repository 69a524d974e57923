"""One process of a session: started under limits, its output kept with times, its CPU accounted."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from confine.helpers import run_helper, start_piped
from confine.machine import children_of, descendants_of
from confine.priority import STANDING, put_in_real_time, put_standing
from confine.program_usage import ProgramUsage
from grader.live.process.forked import Program, start_forked
from grader.live.process.piped import (
    READ_BYTES,
    BlockReader,
    PipedProcess,
    PipeWriter,
    wait_for_end,
)
from grader.recording.session import OutputLine, ProcessRun, Usage

#: Output kept of one process, in bytes and in lines; further output is counted and dropped.
MAX_OUTPUT_BYTES = 1024 * 1024
MAX_OUTPUT_LINES = 50_000
#: Output kept beyond that after Ctrl-C, in bytes and in lines: programs print their results at the end. A flood may leave
#: 64 KiB in each pipe before.
_LAST_OUTPUT_BYTES = 256 * 1024
_LAST_OUTPUT_LINES = 10_000
#: Output after which a process is ended, in bytes: reading it takes time from others.
MAX_FLOOD_BYTES = 64 * 1024 * 1024
#: The longest line that is kept whole, in bytes.
MAX_LINE_BYTES = 8 * 1024
#: A line that its first character read later, or the one before it, ends.
_COMPLETE = re.compile(rb"[^\r\n][\r\n]\Z|\r[^\r\n]\Z")
#: End of a line; a carriage return at the end of a block may be followed by a line feed.
_LINE_END = re.compile(rb"\r?\n|\r(?!\n|\Z)")
#: Longest message of a program of the grader's, in bytes: a snapshot of a flooded graph.
_LONGEST_MESSAGE_BYTES = 64 * 2**20
#: Time between SIGINT, SIGTERM and SIGKILL.
_TERMINATE_GRACE_S = 1.0
#: Time to read the last output after the exit of a process, on a busy machine.
_LAST_OUTPUT_S = 2.0
#: Time for the first process of a sandbox to end after the sandbox, on a busy machine.
_LAST_USAGE_S = 0.5
#: Timeout of another program that holds a process to a core; it takes a few ms.
_HOLD_S = 2.0


@dataclass
class OutputRoom:
    """Room for the further output of several processes together."""

    bytes: int = 16 * MAX_OUTPUT_BYTES
    lines: int = 4 * MAX_OUTPUT_LINES

    def take(self, length: int) -> bool:
        """Take the room for a line, if there is enough."""
        if self.bytes < length or self.lines < 1:
            return False
        self.bytes -= length
        self.lines -= 1
        return True

    def widen(self) -> None:
        """Add the room for the last output of a process."""
        self.bytes += _LAST_OUTPUT_BYTES
        self.lines += _LAST_OUTPUT_LINES


class RunningProcess:
    """A started process and the record that it leaves.

    With bubblewrap, `child_pid_fd` is the read end of its `--info-fd`: the process is a child of the pid written there.
    A trusted process may speak in lines on standard output: `on_message` gets each, whole, and none is kept. Of other
    output as much is kept as there is `room`, which a session's processes share.
    """

    def __init__(
        self,
        run: ProcessRun,
        process: PipedProcess,
        child_pid_fd: int | None,
        on_message: Callable[[bytes], None] | None,
        room: OutputRoom,
    ) -> None:
        self.run = run
        self._process = process
        self._child_pid_fd = child_pid_fd
        self._sandbox_info = b""
        self._sandbox_pid: int | None = None
        self._usage = ProgramUsage()
        #: Its nice value, and the threads that have it.
        self._stands: tuple[int, int] | None = None
        self._written = 0
        self._rooms = (OutputRoom(MAX_OUTPUT_BYTES, MAX_OUTPUT_LINES), room)
        #: True once a line had no room: the lines that are kept have no gaps.
        self._is_full = False
        self._said = asyncio.Event()
        take_output: Callable[[bytes], None] = partial(self._take, _Stream("stdout"))
        if on_message is not None:
            take_output = _Messages(on_message).take
        self._readers = [
            BlockReader(process.stdout, take_output),
            BlockReader(process.stderr, partial(self._take, _Stream("stderr"))),
        ]
        self.exited = asyncio.create_task(self._wait())

    @classmethod
    async def start(
        cls,
        run: ProcessRun,
        argv: Sequence[str],
        *,
        environment: Mapping[str, str],
        pass_fds: Sequence[int] = (),
        child_pid_fd: int | None = None,
        with_input: bool = False,
        room: OutputRoom | None = None,
    ) -> RunningProcess:
        """Start a process in a process group of its own, with SIGINT at its default."""
        run.started_ns = time.time_ns()
        started = start_piped(
            argv, environment=environment, pass_fds=pass_fds, with_input=with_input
        )
        assert started.stdout is not None
        assert started.stderr is not None
        stdin = None
        if started.stdin is not None:
            stdin = PipeWriter(started.stdin)
        process = PipedProcess(
            started.pid, stdin, started.stdout, started.stderr, wait=started.wait
        )
        return cls(run, process, child_pid_fd, None, room or OutputRoom())

    @classmethod
    async def fork(
        cls, run: ProcessRun, program: Program, *, on_message: Callable[[bytes], None] | None = None
    ) -> RunningProcess:
        """Start one of the grader's own programs as a fork of this process; it has a standard input."""
        run.started_ns = time.time_ns()
        process = start_forked(program)
        return cls(run, process, None, on_message, OutputRoom())

    @property
    def alive(self) -> bool:
        """True until it has ended."""
        return not self.exited.done()

    def write(self, data: bytes, *, last: bool = False) -> None:
        """Write to its standard input (only if started `with_input`), and close that if it is the last."""
        if self._process.stdin is not None and self.alive:
            self._process.stdin.write(data)
            if last:
                self._process.stdin.close()

    def _take(self, stream: _Stream, block: bytes) -> None:
        """Take a block of an output, empty at its end, and keep its lines."""
        now = time.time_ns()
        if not block:
            if stream.rest:
                self._keep(stream.rest_ns, stream.name, stream.rest.rstrip(b"\r"))
            return
        self._written += len(block)
        if self._written > MAX_FLOOD_BYTES:
            self.run.limit = "output"
            self._end_group()
        if self._is_full:
            self.run.output_dropped_bytes += len(stream.rest) + len(block)
            stream.rest = b""
            return
        first_ns = stream.begun_ns(block, now)
        for line in stream.split(block, now):
            self._keep(first_ns, stream.name, line)
            first_ns = now

    def _keep(self, t_ns: int, stream: str, line: bytes) -> None:
        cut = line[:MAX_LINE_BYTES]
        if not self._has_room(len(cut) + 1):
            self.run.output_dropped_bytes += len(line) + 1
            return
        self.run.output_dropped_bytes += len(line) - len(cut)
        self.run.output.append(OutputLine(t_ns, stream, cut.decode("utf-8", "replace")))
        self._said.set()

    def _has_room(self, length: int) -> bool:
        """Take the room for a line, unless this or an earlier line had none."""
        for room in self._rooms:
            if not self._is_full:
                self._is_full = not room.take(length)
        return not self._is_full

    def _widen(self) -> None:
        """Make room for the output that a program prints at its end."""
        for room in self._rooms:
            room.widen()
        self._is_full = False

    async def _wait(self) -> int:
        status = await self._process.wait()
        self.run.exited_ns = time.time_ns()
        self.run.exit_status = status
        # A grandchild may hold the pipes open; its later output is not waited for.
        ends = [reader.ended for reader in self._readers]
        await asyncio.wait(ends, timeout=_LAST_OUTPUT_S)
        for reader in self._readers:
            reader.stop()
        await self._note_last_usage()
        self._usage.close()
        # A launch file may start more programs than the grader may have files open.
        if self._child_pid_fd is not None:
            os.close(self._child_pid_fd)
        return status

    def _pid(self) -> int | None:
        """Process id of the student's program: bubblewrap's child's child, or the process itself."""
        if self._child_pid_fd is None:
            return self._process.pid
        if self._sandbox_pid is None and self.alive:
            with suppress(BlockingIOError):
                self._sandbox_info += os.read(self._child_pid_fd, 4096)
            with suppress(ValueError, KeyError):  # Bubblewrap writes in pieces.
                self._sandbox_pid = int(json.loads(self._sandbox_info)["child-pid"])
        if self._sandbox_pid is None:
            return None
        children = children_of(self._sandbox_pid)
        if not children:
            return None
        return children[0]

    async def stop(
        self, timeout_s: float, on_unheeded: Callable[[], Awaitable[None]] | None = None
    ) -> None:
        """Interrupt the program itself as Ctrl-C would, then terminate, then kill it; `ended_by` names the last step.

        `on_unheeded` is called if the program goes on after the interrupt.
        """
        if not self.alive:
            return
        # Without a program, it is just beginning or just ending.
        if self._pid() is None:
            has_ended = await self.wait_exit(_TERMINATE_GRACE_S)
            if has_ended:
                return
        self.sample_usage()
        ways = (
            ("interrupt", signal.SIGINT, timeout_s),
            ("terminate", signal.SIGTERM, _TERMINATE_GRACE_S),
        )
        for ended_by, number, grace_s in ways:
            pid = self._pid()
            if pid is not None:
                if number == signal.SIGINT:
                    self.run.interrupted_ns = time.time_ns()
                    self._widen()
                with suppress(ProcessLookupError):
                    os.kill(pid, number)
                if await self.wait_exit(grace_s):
                    self.run.ended_by = ended_by
                    return
                if number != signal.SIGINT:
                    continue
                if on_unheeded is not None:
                    await on_unheeded()
        await self.kill()

    async def kill(self, limit: str | None = None) -> None:
        """Kill it, for a `limit` if it exceeded one, with its process group (and with bubblewrap, its sandbox)."""
        if self.alive:
            self.sample_usage()
            self.run.ended_by = "kill"
            if limit is not None:
                self.run.ended_by = "limit"
                self.run.limit = limit
            self._end_group()
            await self.wait_exit(5.0)

    def _end_group(self) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def root_pid(self) -> int | None:
        """Process id below which all of its processes are, while they have not left it."""
        return self._sandbox_pid or self._pid()

    def descendants(self) -> list[int]:
        """Process ids of all its processes that have not left it."""
        root = self.root_pid()
        if root is None:
            return []
        return descendants_of(root)

    async def wait_exit(self, timeout_s: float) -> bool:
        """Wait until it has ended; False if it has not in time."""
        done, _ = await asyncio.wait({self.exited}, timeout=timeout_s)
        return bool(done)

    async def wait_said(self, timeout_s: float) -> None:
        """Wait until it has said a line since the last call, has ended, or the time is over."""
        said = asyncio.ensure_future(self._said.wait())
        try:
            either = {said, self.exited}
            await asyncio.wait(either, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        finally:
            said.cancel()
        self._said.clear()

    def put_standing(self, nice: int = STANDING) -> None:
        """Let it go before processes that are still starting, because its timing counts from now on."""
        self._find()
        self.stay_standing(nice)

    def stay_standing(self, nice: int) -> None:
        """Do as `put_standing` for its processes and threads at the last sample."""
        stands = (nice, self._usage.searches)
        if stands == self._stands:
            return
        self._stands = stands
        put_standing(self.pids, nice)
        if self.run.role != "student":
            put_in_real_time(self.pids)

    def _find(self) -> None:
        """Find its present processes and threads."""
        root = self.root_pid()
        if root is not None:
            self._usage.find(root)

    @property
    def pids(self) -> list[int]:
        """Ids of its processes at the last look."""
        return list(self._usage.tasks)

    @property
    def scheduling(self) -> object:
        """Value that changes with its processes and threads, their priority or their core."""
        return self._usage.searches, self._stands, self.run.core

    def hold_to_core(self, core: int, user: int | None) -> None:
        """Let all its present and future threads run on one core only.

        On several cores CPython's threads hand the interpreter's lock to each other badly: a subscription under rclpy's
        MultiThreadedExecutor was seen to handle 27 of 400 messages on two cores, and 400 of 400 on one. It is done once
        the node stands, and has seen all cores. `user` is a user id of its own.
        """
        self._find()
        for pid, tids in self._usage.tasks.items():
            try:
                _hold(tids, core)
            except PermissionError:
                if user is not None:
                    _hold_as_user(pid, core, user)
        root = self.root_pid()
        if root is None or self.run.core == core:
            return
        with suppress(OSError):
            if os.sched_getaffinity(self._pid() or root) == {core}:
                self.run.core = core
                self.run.held_ns = time.time_ns()

    def sample_usage(self) -> None:
        """Read CPU time and run-queue delay of all its processes and threads, while they exist."""
        root = self.root_pid()
        if root is None or self.run.exited_ns is not None:
            return
        self._usage.look(root)
        if not self._usage.times:  # The process ended before the first sample.
            return
        cpu_ns = self._usage.cpu_ns
        if self.run.usage:
            cpu_ns = max(cpu_ns, self.run.usage[-1].cpu_ns)
        self.run.usage.append(Usage(time.time_ns(), cpu_ns, self._usage.delay_ns))

    def delay_by_others_s(self) -> float:
        """Return the longest time that one of its threads surely waited for a core because of other programs, in s.

        That is its whole wait, less the CPU time of all threads and child processes of the same program.
        """
        cpu_ns = 0
        if self.run.usage:
            cpu_ns = self.run.usage[-1].cpu_ns
        longest_ns = 0
        for thread_cpu_ns, delay_ns in self._usage.times.values():
            by_others_ns = delay_ns - (cpu_ns - thread_cpu_ns)
            longest_ns = max(longest_ns, by_others_ns)
        return longest_ns / 1e9

    def lately_used(self) -> float:
        """Return the share of a core that it used between the last two looks at it."""
        *_, before, now = Usage(0, 0, 0), Usage(1, 0, 0), *self.run.usage
        return (now.cpu_ns - before.cpu_ns) / (now.t_ns - before.t_ns)

    async def _note_last_usage(self) -> None:
        """Note the CPU time until its end, which no sample has; its delay is taken from the last sample.

        A sandbox that ends leaves its first process, with the CPU time of all in it, to the first of the session. That
        process may end a moment later.
        """
        if self._sandbox_pid is None or not self.run.usage:
            return
        with suppress(OSError):
            await wait_for_end(self._sandbox_pid, _LAST_USAGE_S)
            pid, _, used = os.wait4(self._sandbox_pid, os.WNOHANG)
            last = self.run.usage[-1]
            cpu_ns = round((used.ru_utime + used.ru_stime) * 1e9)
            exited_ns = self.run.exited_ns or 0
            if pid and cpu_ns > last.cpu_ns and exited_ns > last.t_ns:
                self.run.usage.append(Usage(exited_ns, cpu_ns, last.run_delay_ns))


class PipeReader:
    """Collects the text from a pipe, up to a limit, and hands it on when the pipe closes."""

    def __init__(self, fd: int, limit_bytes: int, on_end: Callable[[str], None]) -> None:
        self._fd = fd
        self._limit = limit_bytes
        self._on_end = on_end
        self._data = bytearray()
        os.set_blocking(fd, False)
        asyncio.get_running_loop().add_reader(fd, self._read)

    def _read(self) -> None:
        with suppress(BlockingIOError):
            block = os.read(self._fd, READ_BYTES)
            self._data += block
            # A program that writes beyond the limit gets an error, and keeps no reader busy.
            if not block or len(self._data) >= self._limit:
                self.close()

    def so_far(self) -> str:
        """Return the text until now, "" after it was handed on."""
        if self._fd < 0:
            return ""
        return self._data.decode("utf-8", "replace")

    def close(self) -> None:
        """Read the rest from the pipe, close it, and hand the text on."""
        if self._fd < 0:
            return
        with suppress(BlockingIOError):
            while len(self._data) < self._limit and (block := os.read(self._fd, READ_BYTES)):
                self._data += block
        asyncio.get_running_loop().remove_reader(self._fd)
        os.close(self._fd)
        self._fd = -1
        self._on_end(self._data.decode("utf-8", "replace"))


class _Stream:
    """An output of a process, cut into lines."""

    def __init__(self, name: str) -> None:
        self.name = name
        #: The unfinished last line, and the time of its last block.
        self.rest = b""
        self.rest_ns = 0

    def begun_ns(self, block: bytes, now_ns: int) -> int:
        """Return the time of a block's first line.

        The line may have been complete before, as is a status line that begins with a carriage return.
        """
        if not self.rest:
            return now_ns
        if _COMPLETE.search(self.rest + block[:1]):
            return self.rest_ns
        return now_ns

    def split(self, block: bytes, now_ns: int) -> list[bytes]:
        """Return the lines completed by a block."""
        text = self.rest + block
        if b"\r" in text:
            *lines, self.rest = _LINE_END.split(text)
        else:
            *lines, self.rest = text.split(b"\n")
        self.rest_ns = now_ns
        if len(self.rest) > MAX_LINE_BYTES:
            lines.append(self.rest)
            self.rest = b""
        return lines


class _Messages:
    """The messages of a program of the grader, a line each."""

    def __init__(self, on_message: Callable[[bytes], None]) -> None:
        self._on_message = on_message
        self._parts: list[bytes] = []
        self._length = 0

    def take(self, block: bytes) -> None:
        """Take a block, empty at the end, and hand on the messages completed by it."""
        *ends, rest = block.split(b"\n")
        for end in ends:
            self._hand_on(end)
        if rest:
            self._parts.append(rest)
            self._length += len(rest)
        if self._length > _LONGEST_MESSAGE_BYTES:
            self._parts.clear()
            raise ValueError("a program of the grader's sent a message without end")
        if not block:
            self._end()

    def _end(self) -> None:
        if self._parts:
            self._hand_on(b"")

    def _hand_on(self, end: bytes) -> None:
        message = b"".join([*self._parts, end])
        self._parts.clear()
        self._length = 0
        self._on_message(message)


def _hold(tids: Iterable[int], core: int) -> None:
    """Hold threads to a core, or raise `PermissionError`."""
    for tid in tids:
        with suppress(ProcessLookupError):
            os.sched_setaffinity(tid, {core})


def _hold_as_user(pid: int, core: int, user: int) -> None:
    """Hold a process to a core as its own user: root in a container may not choose the cores of other users."""
    become = ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups", "--no-new-privs"]
    command = [*become, "taskset", "--all-tasks", "--cpu-list", "--pid", str(core), str(pid)]
    with suppress(OSError, subprocess.TimeoutExpired):
        run_helper(command, timeout_s=_HOLD_S)
