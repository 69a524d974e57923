"""Priorities of processes and threads, as far as the system permits them, so that other work delays little.

A process that *stands* has started and is measured; starting ones count as other work. Trusted processes can be
scheduled in real time; a watch above them demotes one that uses too much. Confined processes cannot: on an idle machine
a tool with 13 threads on its core then waited for 1.6 s of 10 s there, and for 0.5 s as an ordinary process.
"""

from __future__ import annotations

import ctypes
import functools
import os
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from confine.limits import set_limit
from confine.machine import is_in_real_time, tasks_of

#: Nice values; each step is a quarter more of a contended core: others still get a tenth, and measured processes most.
STANDING, MEASURED = -10, -15
#: Length of a turn, in ns: threads with short turns get one soon after waking.
_SLICE_NS = 100_000
_SCHED_SETATTR = 314  # x86-64
_SCHED_NORMAL, _RESET_ON_FORK = 0, 1
_LIBC = ctypes.CDLL(None)
#: Priorities in real time: of trusted processes, and of the watch above them.
RECORDING, WATCHING = 1, 2
#: Time that a process may compute in real time without a pause before the kernel ends it; the watch demotes it earlier.
_RUNAWAY_US = 3_000_000


def put_self_first() -> None:
    """Let this process go before others, but not the processes that it starts."""
    _put_first(0, _RESET_ON_FORK)
    _weigh_session(os.getpid())


@contextmanager
def going_first() -> Iterator[None]:
    """Let this process and its children go before others for a while: beside eight busy ones it began in 3 s.

    Processes in the same session of a terminal go before others too.
    """
    weight = Path("/proc/self/autogroup")
    before: list[str] = []
    if weight.exists():
        before = weight.read_text(encoding="utf-8").split()[-1:]
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, STANDING)
    _weigh_session(os.getpid())
    try:
        yield
    finally:
        with suppress(OSError):
            for nice in before:
                weight.write_text(nice, encoding="utf-8")


def put_standing(pids: Iterable[int], nice: int = STANDING) -> None:
    """Let all present and future threads of some processes go before all others."""
    for pid in pids:
        _weigh_session(pid, nice)
        for task in tasks_of(pid):
            _put_first(int(task), nice=nice)


def _weigh_session(pid: int, nice: int = STANDING) -> None:
    """Give the session (setsid) of a process its weight, if the system weighs sessions instead of processes.

    With autogroups, the nice value of a process counts within its session only (sched(7)).
    """
    if not _weighs_sessions():
        return
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(nice))


@functools.cache
def _weighs_sessions() -> bool:
    return Path("/proc/self/autogroup").exists()


def _put_first(tid: int, flags: int = 0, nice: int = STANDING) -> None:
    """Give a thread short turns, and a nice value if that is permitted.

    For ordinary processes the run time is the length of a turn, since Linux 6.12; before that it is ignored
    (sched_setattr(2); this is the first form of `struct sched_attr`).
    """
    with suppress(OSError):
        for value in (nice, os.getpriority(os.PRIO_PROCESS, tid)):
            attributes = struct.pack(
                "=IIQiIQQQ", 48, _SCHED_NORMAL, flags, value, 0, _SLICE_NS, 0, 0
            )
            if _LIBC.syscall(_SCHED_SETATTR, tid, attributes, 0) == 0:
                return


def put_in_real_time(pids: Iterable[int], priority: int = RECORDING) -> None:
    """Let all present and future threads of some trusted processes go before all ordinary ones."""
    for pid in pids:
        with suppress(OSError, ValueError):
            set_limit("rttime", _RUNAWAY_US, pid=pid)
            for task in tasks_of(pid):
                os.sched_setscheduler(int(task), os.SCHED_RR, os.sched_param(priority))


def demote(tids: Iterable[int]) -> None:
    """Schedule threads in real time as ordinary ones that stand."""
    for tid in tids:
        with suppress(OSError):
            if is_in_real_time(tid):
                os.sched_setscheduler(tid, os.SCHED_OTHER, os.sched_param(0))
                _put_first(tid)
