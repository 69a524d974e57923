"""Samples of the machine: its clocks are read at once."""

from __future__ import annotations

import os

from grader.live.machine import read_clocks, sample_machine


def test_a_core_that_is_lost_between_two_clocks_is_no_clock_that_was_set() -> None:
    """Of several readings that counts in which the least time passed."""
    steady = iter([0, 30_000_000, 30_000_000, 30_000_200])
    told = iter([1_000_000_000, 1_030_000_100])
    assert read_clocks(lambda: next(told), lambda: next(steady)) == (1_030_000_100, 1_000_000_000)


def test_a_sample_holds_the_offset_of_its_time() -> None:
    """The system clock less its offset is the time of the other clock."""
    first, second = sample_machine(), sample_machine()
    assert second.t_ns - second.clock_offset_ns > first.t_ns - first.clock_offset_ns >= 0


def test_a_sample_tells_of_each_core_for_how_long_it_was_idle() -> None:
    """The times go on with the clock, and no core was idle for longer than the time between two samples."""
    first, second = sample_machine(), sample_machine()
    assert {str(core) for core in os.sched_getaffinity(0)} <= set(first.idle_ns)
    passed_ns = second.t_ns - first.t_ns + 20_000_000
    assert all(0 <= second.idle_ns[core] - idle_ns <= passed_ns for core, idle_ns in first.idle_ns.items())
