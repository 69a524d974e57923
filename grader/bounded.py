"""Runs work on students' files in processes of its own, each with a bound on its time and memory.

A process is a fork of this one; its result, or its exception, comes back through a pipe. On other systems than Linux,
where no submission is graded, the work is done in this process, unbounded.
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

from grader.errors import BoundError
from grader.limits import set_limit, set_soft_limit

with suppress(ImportError):  # Windows has no such module.
    import resource

T = TypeVar("T")
K = TypeVar("K")

_PIECE_BYTES = 1 << 16
_SET_PDEATHSIG = 1  # prctl(2)


@dataclass(frozen=True)
class Bound:
    """The limits of a process.

    `what` is the work as a message names it. `cpu_s` is its CPU time, which a busy machine does not lengthen, and `wall_s`
    its whole time, for work that waits for ever. `memory_bytes` is beyond the memory of this process, `file_bytes` the
    size of a file. None stands for no limit, neither for the process nor for its children.
    """

    what: str
    cpu_s: float | None
    wall_s: float
    memory_bytes: int | None
    file_bytes: int | None = None


def in_process(work: Callable[[], T], bound: Bound) -> T:
    """Return the result of work in a process of its own; raise its exception, or `BoundError` beyond the bound."""
    with begun(work, bound) as outcome:
        return outcome()


@contextmanager
def begun(work: Callable[[], T], bound: Bound) -> Iterator[Callable[[], T]]:
    """Do work in a process of its own, which ends with the context; yield a function that returns its result, or raises."""
    if sys.platform != "linux":
        yield work
        return
    child = _Child.start(work, bound)
    ended = functools.cache(child.wait)

    def outcome() -> T:
        found = ended()
        if isinstance(found, BaseException):
            raise found
        return cast(T, found)

    try:
        yield outcome
    finally:
        # The result may not have been asked for, and is no longer wanted.
        child.ends_s = min(child.ends_s, time.monotonic() + 2.0)
        ended()


def in_processes(
    works: Mapping[K, Callable[[], T]], bound: Bound, at_a_time: int = 1
) -> Iterator[tuple[K, T | Exception]]:
    """Do pieces of work, `at_a_time` at once, and yield the result or exception of each as soon as it is there.

    A piece beyond the bound yields a `BoundError`.
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
        parent = os.getpid()
        process = os.fork()
        if process == 0:
            os.close(reading)
            _be_child(work, writing, bound, parent)
        os.close(writing)
        return cls(process, reading, bound, time.monotonic() + bound.wall_s)

    def read(self) -> bool:
        """Read a piece of the result; return False at its end."""
        piece = os.read(self.pipe, _PIECE_BYTES)
        self.received.append(piece)
        self.is_over = not piece
        return bool(piece)

    def wait(self) -> Any:
        """Wait until it ends, or its time is over, and return its outcome."""
        while True:
            left_s = max(0.0, self.ends_s - time.monotonic())
            ready, _, _ = select.select([self.pipe], [], [], left_s)
            if not ready or not self.read():
                return self.end()

    def end(self) -> Any:
        """Kill it, if it has not ended, and return its outcome."""
        if not self.is_over:
            os.kill(self.process, signal.SIGKILL)
        os.close(self.pipe)
        _, status = os.waitpid(self.process, 0)
        if os.waitstatus_to_exitcode(status) == 0:
            outcome = pickle.loads(b"".join(self.received))  # From a copy of this process.
            return outcome.here() if isinstance(outcome, _Raised) else outcome
        is_out_of_cpu = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU
        if is_out_of_cpu and self.bound.cpu_s is not None:
            return _exceeded(self.bound, f"took more than {self.bound.cpu_s:g} s of CPU time")
        if not self.is_over:
            return _exceeded(self.bound, f"took longer than {self.bound.wall_s:g} s")
        return _exceeded(self.bound, f"ended with status {os.waitstatus_to_exitcode(status)}")


def _exceeded(bound: Bound, problem: str) -> BoundError:
    remedy = "Nothing else is affected. No text of a student's should cause this: please report it, with the recordings."
    return BoundError(f"{bound.what} {problem}", remedy=remedy)


def _be_child(work: Callable[[], object], pipe: int, bound: Bound, parent: int) -> NoReturn:
    """Do the work, send its outcome, and end without touching anything that this process shares with its parent."""
    status = 1
    # Collecting the parent's objects was seen to crash. The child's own objects have few cycles; looking for them
    # takes a tenth of judging, and its memory is bounded.
    gc.freeze()
    gc.disable()
    try:
        # It shares its parent's locks, such as a slot of the machine, and must not hold them longer.
        ctypes.CDLL(None).prctl(_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(status)
        # Ctrl-C is for the parent, which ends this process.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU):
            signal.signal(number, signal.SIG_DFL)
        _limit(bound)
        write_all(pipe, pickle.dumps(_outcome_of(work, bound)))
        status = 0
    except BaseException:
        os.write(2, traceback.format_exc().encode(errors="replace"))
    finally:
        os._exit(status)


def _outcome_of(work: Callable[[], object], bound: Bound) -> object:
    """Return the result of work, its exception as `_Raised`, or `BoundError` if it lacks memory."""
    try:
        return work()
    except Exception as error:
        lacks_memory = isinstance(error, MemoryError) or _error_number(error) == errno.ENOMEM
        if lacks_memory and bound.memory_bytes:
            most_gib = bound.memory_bytes / 2**30
            return _exceeded(bound, f"took more than {most_gib:g} GiB of memory")
        return _Raised.of(error)


def _error_number(error: Exception) -> int | None:
    return getattr(error, "errno", None)


@dataclass(frozen=True)
class _Raised:
    """An exception to be sent, with its traceback as text, because no exception takes its traceback along."""

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
    """The traceback of an exception in the other process."""


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
    """Limit the address space of this process, unless a smaller limit holds."""
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    if soft == resource.RLIM_INFINITY:
        soft = most_bytes
    set_soft_limit("as", min(soft, most_bytes))


def write_all(file: int, content: bytes) -> None:
    """Write all content to a descriptor, even if it takes only a little at a time."""
    left = memoryview(content)
    while left:
        left = left[os.write(file, left) :]
