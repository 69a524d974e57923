"""Runs work on students' texts in processes of its own, each with a bound on its time and memory.

A process is a fork of this one; its result or its exception comes back through a pipe. On other systems than Linux,
where nothing is graded, the work is done in this process, without bounds.
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
from collections.abc import Callable, Collection, Iterator, Mapping
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
#: Time for a process to end after its context, in s.
_LAST_S = 2.0


@dataclass(frozen=True)
class Bound:
    """Limits of a process.

    `what` names the work in a message. `cpu_s` limits its CPU time, so that a busy machine does not count, and `wall_s`
    all its time, for work that waits for ever. `memory_bytes` is added to the memory of this process; `file_bytes` limits
    the size of a file. None sets no limit, neither for the process nor for its children.
    """

    what: str
    cpu_s: float | None
    wall_s: float
    memory_bytes: int | None
    file_bytes: int | None = None


def in_process(work: Callable[[], T], bound: Bound) -> T:
    """Return the result of work in a process of its own; raises its exception, or `BoundError` beyond the bound."""
    with begun(work, bound) as outcome:
        return outcome()


@contextmanager
def begun(work: Callable[[], T], bound: Bound) -> Iterator[Callable[[], T]]:
    """Do work in a process of its own, which ends with the context; give a function that waits for the result."""
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
        # The caller may not have asked for the outcome, and will not.
        child.ends_s = min(child.ends_s, time.monotonic() + _LAST_S)
        ended()


def _finished(running: Mapping[K, _Child]) -> list[K]:
    """Wait for output of any child, and return the keys of the children that ended or are late."""
    ready = _wait_for(running.values())
    for child in ready:
        child.read()
    finished = []
    for key, child in running.items():
        is_stuck = child.is_late() and child not in ready
        if child.is_over or is_stuck:
            finished.append(key)
    return finished


def in_processes(
    works: Mapping[K, Callable[[], T]], bound: Bound, at_a_time: int | None = None
) -> Iterator[tuple[K, T | Exception]]:
    """Do pieces of work, by default one a core, and give the result or the exception of each as soon as it is there.

    The exception of work beyond the bound is `BoundError`.
    """
    if sys.platform != "linux":
        for key, work in works.items():
            yield key, _outcome_of(work)
        return
    waiting = list(works.items())[::-1]
    running: dict[K, _Child] = {}
    most = at_a_time
    if not most:
        most = len(os.sched_getaffinity(0))
    try:
        while waiting or running:
            while waiting and len(running) < most:
                key, work = waiting.pop()
                running[key] = _Child.start(work, bound)
            for key in _finished(running):
                child = running.pop(key)
                yield key, child.end()
    finally:
        for child in running.values():
            child.end()


def _outcome_of(work: Callable[[], T]) -> T | Exception:
    """Do work in this process, and return its result or its exception."""
    try:
        return work()
    except Exception as error:
        return error


def _wait_for(children: Collection[_Child]) -> list[_Child]:
    """Wait until children can be read or one is late; return those that can be read."""
    left_s = min(child.ends_s for child in children) - time.monotonic()
    pipes = {child.pipe: child for child in children}
    ready, _, _ = select.select(list(pipes), [], [], max(0.0, left_s))
    return [pipes[pipe] for pipe in ready]


@dataclass(eq=False)
class _Child:
    """A process at work, and the pieces of its outcome so far."""

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

    def is_late(self) -> bool:
        """Return whether its time is over."""
        return self.ends_s <= time.monotonic()

    def read(self) -> None:
        """Take the next piece from the pipe, or note that there is none."""
        piece = os.read(self.pipe, _PIECE_BYTES)
        self.received.append(piece)
        self.is_over = not piece

    def wait(self) -> Any:
        """Wait until it ends, or its time is over; return its outcome."""
        while not self.is_over:
            if not _wait_for([self]):
                break
            self.read()
        return self.end()

    def end(self) -> Any:
        """End it, if it has not ended; return its outcome."""
        if not self.is_over:
            os.kill(self.process, signal.SIGKILL)
        os.close(self.pipe)
        _, ended = os.waitpid(self.process, 0)
        status = os.waitstatus_to_exitcode(ended)
        sent = b"".join(self.received)
        has_failed = status != 0
        # Code of a lab can end its process at once, with status 0.
        if not sent:
            has_failed = True
        if has_failed:
            return _exceeded(self.bound, self._failure(status))
        outcome = pickle.loads(sent)  # from a copy of this process
        if isinstance(outcome, _Raised):
            return outcome.here()
        return outcome

    def _failure(self, status: int) -> str:
        """Return the words for an end with a status that is not 0."""
        if status == -signal.SIGXCPU and self.bound.cpu_s is not None:
            return f"took more than {self.bound.cpu_s:g} s of CPU time"
        if not self.is_over:
            return f"took longer than {self.bound.wall_s:g} s"
        return f"ended with status {status}"


def _exceeded(bound: Bound, problem: str) -> BoundError:
    remedy = "Nothing else is affected. No text of a student's should cause this: please report it, with the recordings."
    return BoundError(f"{bound.what} {problem}", remedy=remedy)


def _be_child(work: Callable[[], object], pipe: int, bound: Bound, parent: int) -> NoReturn:
    """Do the work, send its outcome, and end without closing anything that this process shares with its parent."""
    status = 1
    # Collecting inherited objects was seen to crash. Few new ones are in cycles: looking for these takes a tenth of
    # judging, and memory is bounded.
    gc.freeze()
    gc.disable()
    try:
        # The child shares files of its parent, such as the lock of a slot, and must not hold these longer.
        ctypes.CDLL(None).prctl(_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(status)
        # Ctrl-C is for the parent, which ends this process.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU):
            signal.signal(number, signal.SIG_DFL)
        _limit(bound)
        try:
            outcome = work()
        except Exception as error:
            outcome = _Raised.of(error)
            if bound.memory_bytes and _is_for_memory(error):
                memory = f"took more than {bound.memory_bytes / 2**30:g} GiB of memory"
                outcome = _exceeded(bound, memory)
        write_all(pipe, pickle.dumps(outcome))
        status = 0
    except BaseException:
        os.write(2, traceback.format_exc().encode(errors="replace"))
    finally:
        os._exit(status)


def _is_for_memory(error: Exception) -> bool:
    """Return whether an exception was raised because memory was missing.

    Where an allocation fails, CPython raises SystemError in some places: "error return without exception set".
    """
    if isinstance(error, MemoryError | SystemError):
        return True
    return getattr(error, "errno", None) == errno.ENOMEM


@dataclass(frozen=True)
class _Raised:
    """An exception to be sent, and its traceback, which pickling would lose."""

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
    """Limit the address space of this process, unless it is limited to less."""
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    if soft == resource.RLIM_INFINITY:
        soft = most_bytes
    set_soft_limit("as", min(soft, most_bytes))


def write_all(file: int, content: bytes) -> None:
    """Write all of a text to a descriptor, in as many pieces as it takes."""
    left = memoryview(content)
    while left:
        left = left[os.write(file, left) :]
