"""Runs work on what students wrote in processes of its own, each with a bound on its time and memory.

A process is a fork of this one; what it returns, or raises, comes back through a pipe. On other systems than Linux,
where nothing is graded, the work is done here, unbounded.
"""

from __future__ import annotations

import ctypes
import errno
import functools
import gc
import os
import pickle
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast

from confine.limits import set_limit, set_soft_limit
from grader.errors import BoundError

with suppress(ImportError):  # There is none on Windows.
    import resource

T = TypeVar("T")
K = TypeVar("K")

_PIECE_BYTES = 1 << 16
_SET_PDEATHSIG = 1  # prctl(2)


@dataclass(frozen=True)
class Bound:
    """What a process may take.

    `what` is the work as a message names it, `cpu_s` its computing, so that a busy machine does not count, and `wall_s`
    all its time, for work that waits for ever. `memory_bytes` is beyond what this process has, `file_bytes` of a file.
    What is None is not bounded, and so not for what the process starts.
    """

    what: str
    cpu_s: float | None
    wall_s: float
    memory_bytes: int | None
    file_bytes: int | None = None


def in_process(work: Callable[[], T], bound: Bound) -> T:
    """Return what work returns in a process of its own, or raise what it raises, or `BoundError` beyond the bound."""
    with begun(work, bound) as outcome:
        return outcome()


@contextmanager
def begun(work: Callable[[], T], bound: Bound) -> Iterator[Callable[[], T]]:
    """Do work in a process of its own, which ends with the context; gives what returns, or raises, what comes of it."""
    if sys.platform != "linux":
        yield work
        return
    child = _Child.start(work, bound)
    ended = functools.cache(child.wait)

    def outcome() -> T:
        if isinstance(found := ended(), BaseException):
            raise found
        return cast(T, found)

    try:
        yield outcome
    finally:
        child.ends_s = min(
            child.ends_s, time.monotonic() + 2.0
        )  # Nobody may have asked for it, or will.
        ended()


def in_processes(
    works: Mapping[K, Callable[[], T]], bound: Bound, at_a_time: int = 1
) -> Iterator[tuple[K, T | Exception]]:
    """Do pieces of work, so many at a time, and give what came of each as soon as it is there.

    An exception stands for itself; `BoundError` for what took more than the bound.
    """
    if sys.platform != "linux":
        for key, work in works.items():
            try:
                outcome: T | Exception = work()
            except Exception as error:
                outcome = error
            yield key, outcome
        return
    waiting = list(works.items())[::-1]
    running: dict[int, tuple[K, _Child]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_a_time:
                key, work = waiting.pop()
                child = _Child.start(work, bound)
                running[child.pipe] = key, child
            left_s = min(child.ends_s for _, child in running.values()) - time.monotonic()
            ready, _, _ = select.select(list(running), [], [], max(0.0, left_s))
            late = [
                pipe for pipe, (_, child) in running.items() if child.ends_s <= time.monotonic()
            ]
            for pipe in {*ready, *late}:
                key, child = running[pipe]
                if pipe not in ready or not child.read():
                    del running[pipe]
                    yield key, child.end()
    finally:
        for _, child in running.values():
            child.end()


@dataclass
class _Child:
    process: int
    pipe: int
    bound: Bound
    ends_s: float
    received: list[bytes] = field(default_factory=list)
    is_over: bool = False

    @classmethod
    def start(cls, work: Callable[[], object], bound: Bound) -> _Child:
        reading, writing = os.pipe()
        parent, process = os.getpid(), os.fork()
        if process == 0:
            os.close(reading)
            _be_child(work, writing, bound, parent)
        os.close(writing)
        return cls(process, reading, bound, time.monotonic() + bound.wall_s)

    def read(self) -> bool:
        """Take what has come; returns whether more may follow."""
        piece = os.read(self.pipe, _PIECE_BYTES)
        self.received.append(piece)
        self.is_over = not piece
        return bool(piece)

    def wait(self) -> Any:
        """Wait until it ends, or its time is over; returns its outcome."""
        while (
            select.select([self.pipe], [], [], max(0.0, self.ends_s - time.monotonic()))[0]
            and self.read()
        ):
            pass
        return self.end()

    def end(self) -> Any:
        """End it, if it has not ended; returns its outcome."""
        if not self.is_over:
            os.kill(self.process, signal.SIGKILL)
        os.close(self.pipe)
        _, status = os.waitpid(self.process, 0)
        if os.waitstatus_to_exitcode(status) == 0:
            outcome = pickle.loads(b"".join(self.received))  # From a copy of this process.
            return outcome.here() if isinstance(outcome, _Raised) else outcome
        if (
            os.WIFSIGNALED(status)
            and os.WTERMSIG(status) == signal.SIGXCPU
            and self.bound.cpu_s is not None
        ):
            return _exceeded(self.bound, f"took more than {self.bound.cpu_s:g} s of CPU time")
        if not self.is_over:
            return _exceeded(self.bound, f"took longer than {self.bound.wall_s:g} s")
        return _exceeded(self.bound, f"ended with status {os.waitstatus_to_exitcode(status)}")


def _exceeded(bound: Bound, problem: str) -> BoundError:
    remedy = "Nothing else is affected. No text of a student's should cause this: please report it, with the recordings."
    return BoundError(f"{bound.what} {problem}", remedy=remedy)


def _be_child(work: Callable[[], object], pipe: int, bound: Bound, parent: int) -> NoReturn:
    """Work, send what comes of it, and end without a word to what this process shares with the one it came from."""
    status = 1
    # What it was born with is not its own to collect, and was seen to crash where that was tried; of what it makes
    # little is in cycles, for which to look takes a tenth of judging, and its memory is bounded.
    gc.freeze()
    gc.disable()
    try:
        # It shares what its parent holds, such as a slot of the machine, and must not hold that longer.
        ctypes.CDLL(None).prctl(_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(status)
        signal.signal(
            signal.SIGINT, signal.SIG_IGN
        )  # Ctrl-C is for the process that asked, which ends this one.
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU):
            signal.signal(number, signal.SIG_DFL)
        _limit(bound)
        try:
            outcome = work()
        except Exception as error:
            lacks_memory = (
                isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM
            )
            memory = f"took more than {(bound.memory_bytes or 0) / 2**30:g} GiB of memory"
            outcome = (
                _exceeded(bound, memory)
                if lacks_memory and bound.memory_bytes
                else _Raised.of(error)
            )
        write_all(pipe, pickle.dumps(outcome))
        status = 0
    except BaseException:
        os.write(2, traceback.format_exc().encode(errors="replace"))
    finally:
        os._exit(status)


@dataclass(frozen=True)
class _Raised:
    """An exception that is sent, and its trace for those who look for its cause, which no exception takes with it."""

    error: Exception
    trace: str

    @classmethod
    def of(cls, error: Exception) -> _Raised:
        trace = "".join(traceback.format_exception(error))
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return cls(RuntimeError(f"{type(error).__name__}: {error}"), trace)
        return cls(error, trace)

    def here(self) -> Exception:
        self.error.__cause__ = _InProcess(self.trace)
        return self.error


class _InProcess(Exception):
    """Where an exception came up in the other process."""


def _limit(bound: Bound) -> None:
    set_soft_limit("core", 0)
    if bound.cpu_s is not None:
        seconds = max(1, round(bound.cpu_s))
        set_limit("cpu", seconds, seconds + 5)
    if bound.file_bytes is not None:
        set_limit("fsize", bound.file_bytes)
    if bound.memory_bytes is not None:
        taken_bytes = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        limit_memory(taken_bytes + bound.memory_bytes)


def limit_memory(most_bytes: int) -> None:
    """Limit the address space of this process, unless it is limited to less."""
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    if soft == resource.RLIM_INFINITY:
        soft = most_bytes
    set_soft_limit("as", min(soft, most_bytes))


def write_all(file: int, content: bytes) -> None:
    """Write to a descriptor, however little of it is taken at a time."""
    left = memoryview(content)
    while left:
        left = left[os.write(file, left) :]
