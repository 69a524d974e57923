"""Lets what stands in a sandbox have its core when it wants it, so that other work delays little of what is measured.

What is starting is other work too. What the machine does not permit is left: then delays are excused or left undecided.

The grader's own processes are scheduled in real time where that is permitted; from one that uses more than a node needs
the watch (`cpu_watch`), which goes before them, takes it. The student's are not: on an idle machine a tool with 13
threads on its core then waited for 1.6 s of 10 s there, and for 0.5 s as an ordinary process.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from confine.limits import set_limit
from confine.machine import tasks_of

#: Each step is a quarter more of a core that several want: others still get a tenth, and what is measured most.
STANDING, MEASURED = -10, -15
#: Who asks for short turns is given them soon after waking.
_SLICE_NS = 100_000
_SCHED_SETATTR = 314  # x86-64
_SCHED_NORMAL, _RESET_ON_FORK = 0, 1
#: Priorities in real time: of the grader's own processes, and of what watches all of them.
RECORDING, WATCHING = 1, 2
#: So long one may compute in real time without a pause before the kernel ends it; it is demoted before that.
_RUNAWAY_US = 3_000_000


def put_self_first() -> None:
    """Let this process go before others, and those that it starts not."""
    _put_first(0, _RESET_ON_FORK)
    _weigh_session(os.getpid())


@contextmanager
def going_first() -> Iterator[None]:
    """Let this process and what it starts go before others for a while: beside eight busy ones it began in 3 s.

    The first process of a sandbox passes none of it on, and what shares a terminal's session with this one has it too.
    """
    weight = Path("/proc/self/autogroup")
    before = weight.read_text(encoding="utf-8").split()[-1:] if weight.exists() else []
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
    """Let all threads of some processes, and those to come, go before all others."""
    for pid in pids:
        _weigh_session(pid, nice)
        for task in tasks_of(pid):
            _put_first(int(task), nice=nice)


def _weigh_session(pid: int, nice: int = STANDING) -> None:
    """Give the session (setsid) of a process its weight, where the system weighs sessions and not processes.

    With autogroups, the nice value of a process counts within its session only (sched(7)).
    """
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(nice))


def _put_first(tid: int, flags: int = 0, nice: int = STANDING) -> None:
    """Give a thread short turns, and a nice value if that is permitted.

    For ordinary processes the run time is the length of a turn, since Linux 6.12; before that it is ignored
    (sched_setattr(2), whose `struct sched_attr` is in its first form here).
    """
    with suppress(OSError):
        for value in (nice, os.getpriority(os.PRIO_PROCESS, tid)):
            attributes = struct.pack(
                "=IIQiIQQQ", 48, _SCHED_NORMAL, flags, value, 0, _SLICE_NS, 0, 0
            )
            if ctypes.CDLL(None).syscall(_SCHED_SETATTR, tid, attributes, 0) == 0:
                return


def put_in_real_time(pids: Iterable[int], priority: int = RECORDING) -> None:
    """Let all threads of some of the grader's own processes, and those to come, go before all ordinary ones."""
    for pid in pids:
        with suppress(OSError, ValueError):
            set_limit("rttime", _RUNAWAY_US, pid=pid)
            for task in tasks_of(pid):
                os.sched_setscheduler(int(task), os.SCHED_RR, os.sched_param(priority))


def demote(tids: Iterable[int]) -> None:
    """Let threads that were scheduled in real time be ordinary ones that stand."""
    for tid in tids:
        with suppress(OSError):
            if os.sched_getscheduler(tid) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR:
                os.sched_setscheduler(tid, os.SCHED_OTHER, os.sched_param(0))
                _put_first(tid)
