"""What of the machine's own doings may disturb a measurement: its clock, its host, the press for its cores."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from grader.recording.session import MachineSample


def sample_machine() -> MachineSample:
    """Read the machine's clock, and what it says of time taken and time waited."""
    now_ns, offset_ns = read_clocks()
    return MachineSample(now_ns, offset_ns, stolen_ns(), _waiting_us(), _idle_ns())


#: Readings of both clocks that are tried, and how far apart they may be at best.
_READINGS, _AT_ONCE_NS = 5, 50_000


def read_clocks(
    system: Callable[[], int] = time.time_ns, monotonic: Callable[[], int] = time.monotonic_ns
) -> tuple[int, int]:
    """Return the system clock's time, and by how much it is ahead of the monotonic clock, in ns.

    Where this process loses its core between the readings, the clock must not seem to have been set.
    """
    best: tuple[int, int, int] | None = None
    for _ in range(_READINGS):
        before_ns, now_ns, after_ns = monotonic(), system(), monotonic()
        if best is None or after_ns - before_ns < best[0]:
            best = after_ns - before_ns, now_ns, now_ns - (before_ns + after_ns) // 2
        if best[0] <= _AT_ONCE_NS:
            break
    assert best is not None
    return best[1], best[2]


def stolen_ns() -> int:
    """Return the time that the host of a virtual machine has taken from its cores since boot, in ns."""
    with suppress(OSError, ValueError, IndexError):
        words = Path("/proc/stat").read_text().split("\n", 1)[0].split()
        return int(words[8]) * (1_000_000_000 // os.sysconf("SC_CLK_TCK"))
    return 0


def _idle_ns() -> dict[str, int]:
    """Return for each core the time since boot in which nothing ran on it, in ns."""
    tick_ns = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    with suppress(OSError, ValueError, IndexError):
        lines = [line.split() for line in Path("/proc/stat").read_text().splitlines() if line.startswith("cpu")]
        return {words[0][3:]: (int(words[4]) + int(words[5])) * tick_ns for words in lines if words[0] != "cpu"}
    return {}


def _waiting_us() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        return int(Path("/proc/pressure/cpu").read_text().split("total=", 1)[1].split()[0])
    return None
