"""Samples of the machine: the offset of the clocks, and the idle time of each core."""

from __future__ import annotations

import os

from grader.live.process.machine_sample import MachineSampler


def test_a_sample_holds_the_offset_of_its_time() -> None:
    """The system clock less its offset is the time of the other clock."""
    machine = MachineSampler()
    first, second = machine.sample(), machine.sample()
    assert second.t_ns - second.clock_offset_ns > first.t_ns - first.clock_offset_ns >= 0


def test_a_sample_tells_of_each_core_for_how_long_it_was_idle() -> None:
    """The times go on with the clock, and no core was idle for longer than the time between two samples."""
    machine = MachineSampler()
    first, second = machine.sample(), machine.sample()
    assert {str(core) for core in os.sched_getaffinity(0)} <= set(first.idle_ns)
    passed_ns = second.t_ns - first.t_ns + 20_000_000
    for core, idle_ns in first.idle_ns.items():
        assert 0 <= second.idle_ns[core] - idle_ns <= passed_ns
