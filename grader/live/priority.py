"""Lets cells have their cores when they want them, so that other work on the machine delays little of what is measured.

What stands goes before what is starting, since a start takes a whole core for a while and nothing of it is timed;
and both go before what is no business of ours. All students' processes are treated alike. None of it is
needed, and what the machine does not permit is left: then delays are excused or left undecided.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from contextlib import suppress
from enum import IntEnum
from pathlib import Path

#: Who asks for short turns is given them soon after waking.
_SLICE_NS = 100_000
_SCHED_SETATTR = 314  # x86-64
_SCHED_NORMAL, _RESET_ON_FORK = 0, 1


class Priority(IntEnum):
    """Nice values: each step is a quarter more of a core that several want, so that others still get a tenth."""

    STARTING = -5
    STANDING = -10


class _Attributes(ctypes.Structure):
    """`struct sched_attr` in its first form."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
    )


def put_self_first() -> None:
    """Let this process go before others, and those that it starts not."""
    _take_short_turns(0, _RESET_ON_FORK)
    weigh_session(os.getpid(), Priority.STANDING)


def put_starting(pid: int) -> None:
    """Let a process that has just begun, and those that it starts, go before those that are none of ours."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, pid, Priority.STARTING)
    weigh_session(pid, Priority.STARTING)


def put_standing(pids: Iterable[int]) -> None:
    """Let all threads of some processes, and those to come, go before all others."""
    for pid in pids:
        weigh_session(pid, Priority.STANDING)
        with suppress(OSError):
            for task in Path(f"/proc/{pid}/task").iterdir():
                _take_short_turns(int(task.name))


def weigh_session(pid: int, priority: Priority) -> None:
    """Give the session (setsid) of a process its weight, where the system weighs sessions and not processes.

    References
    ----------
    sched(7): with autogroups, the nice value of a process counts within its session only.
    """
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(int(priority)))


def _take_short_turns(tid: int, flags: int = 0) -> None:
    """Give a thread short turns, and a nice value if that is permitted.

    References
    ----------
    sched_setattr(2): for ordinary processes the run time is the length of a turn, since Linux 6.12; before that
    it is ignored.
    """
    with suppress(OSError):
        usual = os.getpriority(os.PRIO_PROCESS, tid)
        for nice in (int(Priority.STANDING), usual):
            attributes = _Attributes(ctypes.sizeof(_Attributes), _SCHED_NORMAL, flags, nice, 0, _SLICE_NS)
            if ctypes.CDLL(None).syscall(_SCHED_SETATTR, tid, ctypes.byref(attributes), 0) == 0:
                return
