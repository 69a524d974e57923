"""Lets a cell have its cores when it wants them, so that other work on the machine delays little of what is measured.

None of it is needed, and what the machine does not permit is left: then delays are excused or left undecided.
All processes of all cells are treated alike, so that none of them gains anything over the others.
"""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress
from pathlib import Path

#: Some nine times the weight of ordinary processes, so that these go on with a tenth of a core at worst.
_NICE = -10
#: Who asks for short turns is given them soon after waking.
_SLICE_NS = 100_000
_SCHED_SETATTR = 314  # x86-64
_SCHED_NORMAL = 0


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


def put_first() -> None:
    """Put this process, and those that it starts from now on, before others.

    References
    ----------
    sched_setattr(2): for ordinary processes the run time is the length of a turn, since Linux 6.12; before that
    it is ignored.
    """
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    attributes = _Attributes(
        ctypes.sizeof(_Attributes), _SCHED_NORMAL, 0, os.getpriority(os.PRIO_PROCESS, 0), 0, _SLICE_NS
    )
    ctypes.CDLL(None).syscall(_SCHED_SETATTR, 0, ctypes.byref(attributes), 0)
    put_session_first(os.getpid())


def put_session_first(pid: int) -> None:
    """Put the session (setsid) of a process before others, where the system weighs sessions and not processes.

    References
    ----------
    sched(7): with autogroups, the nice value of a process counts within its session only.
    """
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(_NICE))
