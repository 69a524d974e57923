"""What of the machine's own doings may disturb a measurement: its clock, its host, the press for its cores."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

from grader.recording.session import MachineSample


def sample_machine() -> MachineSample:
    """Read the machine's clock, and what it says of time taken and time waited."""
    now_ns = time.time_ns()
    return MachineSample(now_ns, now_ns - time.monotonic_ns(), stolen_ns(), _waiting_us())


def stolen_ns() -> int:
    """Return the time that the host of a virtual machine has taken from its cores since boot, in ns."""
    with suppress(OSError, ValueError, IndexError):
        words = Path("/proc/stat").read_text().split("\n", 1)[0].split()
        return int(words[8]) * (1_000_000_000 // os.sysconf("SC_CLK_TCK"))
    return 0


def _waiting_us() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        return int(Path("/proc/pressure/cpu").read_text().split("total=", 1)[1].split()[0])
    return None
