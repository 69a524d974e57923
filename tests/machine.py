"""Shares this machine between tests that run side by side, also in other workers.

A test that measures time, and found the machine too busy, may ask for the machine alone: running tests end first, and
no test begins in the meantime.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Beginnings of the reasons that a busy machine gives for an undecided measurement.
MACHINE = ("Not your fault: the grading computer was too busy", "The measurement error ")
#: True while this process has a part of the machine; tests within a test share it.
_shares = False


def _lock(name: str) -> int:
    path = Path(tempfile.gettempdir()) / f"grade-tests-{os.geteuid()}-{name}.lock"
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)


_GATE, _MACHINE = _lock("gate"), _lock("machine")


@contextmanager
def beside_others() -> Iterator[None]:
    """Run beside other tests, but not beside one that has the machine alone."""
    global _shares
    fcntl.flock(_GATE, fcntl.LOCK_SH)
    fcntl.flock(_MACHINE, fcntl.LOCK_SH)
    fcntl.flock(_GATE, fcntl.LOCK_UN)
    _shares = True
    try:
        yield
    finally:
        _shares = False
        fcntl.flock(_MACHINE, fcntl.LOCK_UN)


@contextmanager
def alone() -> Iterator[None]:
    """Wait for the others' ends, and have the machine alone; the gate keeps those that come later waiting."""
    assert _shares
    fcntl.flock(_MACHINE, fcntl.LOCK_UN)
    fcntl.flock(_GATE, fcntl.LOCK_EX)
    fcntl.flock(_MACHINE, fcntl.LOCK_EX)
    try:
        yield
    finally:
        fcntl.flock(_MACHINE, fcntl.LOCK_SH)
        fcntl.flock(_GATE, fcntl.LOCK_UN)


class Others:
    """The use of this machine by others since this was made: other programs, and the host of a virtual machine."""

    def __init__(self) -> None:
        self._begun = self._look()

    @staticmethod
    def _look() -> tuple[float, float, float]:
        of_all_cores = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0]
        user, nice, system, _, _, irq, softirq, steal = (
            int(number) for number in of_all_cores.split()[1:9]
        )
        busy_s = (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")
        return time.monotonic(), busy_s, sum(os.times()[:4])

    @property
    def share(self) -> float:
        """The others' share of all cores; ended children of this process count as its own."""
        elapsed_s, busy_s, own_s = (
            now - then for now, then in zip(self._look(), self._begun, strict=True)
        )
        return (busy_s - own_s) / (elapsed_s * (os.cpu_count() or 1))
