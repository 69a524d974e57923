"""Samples of the machine, as recordings keep them."""

from __future__ import annotations

from confine.machine import idle_ns_of_cores, read_clocks, stolen_ns, waited_us
from grader.recording.session import MachineSample


def sample_machine() -> MachineSample:
    """Read the machine's clocks, its stolen time, its waiting time and the idle time of its cores."""
    now_ns, offset_ns = read_clocks()
    idle_ns = idle_ns_of_cores()
    return MachineSample(now_ns, offset_ns, stolen_ns(), waited_us(), idle_ns)
