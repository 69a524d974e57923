"""Examines whether the limits under which this process was started suffice for grading."""

from __future__ import annotations

import os
from pathlib import Path

from confine.limits import Shortage, raise_soft_limits, shortages
from confine.machine import processes_of_user, tasks_of
from grader.errors import PlatformError

#: Threads of the grader and of one session's programs, which count against their common user's limit. Two sessions
#: side by side had 57.
_OWN_TASKS = 96


def present_shortages() -> list[Shortage]:
    """Return the limits that are lower than usual, those that prevent grading first."""
    found = shortages({"nproc": _tasks_in_use()})
    return sorted(found, key=lambda shortage: not shortage.is_fatal)


def require_limits() -> None:
    """Make use of the limits that this process may have; raises `PlatformError` if one prevents grading."""
    raise_soft_limits()
    for shortage in present_shortages():
        if shortage.is_fatal:
            raise PlatformError(str(shortage), remedy=shortage.remedy)


def _tasks_in_use() -> int:
    """Return how many processes and threads count against the limit of students' programs, beside their own.

    As root they have a user id of their own each, and the kernel counts none of root's. In a user namespace all count.
    """
    if _is_root_of_the_machine():
        return 0
    return _OWN_TASKS + sum(len(tasks_of(pid)) for pid in processes_of_user(os.getuid()))


def _is_root_of_the_machine() -> bool:
    """Return whether the kernel counts no process of this user."""
    ids = Path("/proc/self/uid_map").read_text(encoding="ascii").split()
    root_here, root_outside = ids[:2]
    if root_here != root_outside:
        return False
    return os.geteuid() == 0
