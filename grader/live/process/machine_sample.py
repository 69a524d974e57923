"""Samples of the machine, as recordings keep them."""

from __future__ import annotations

from confine.machine import CORES, WAITS, CounterFile, core_times_in, read_clocks, waited_us_in
from grader.recording.session import MachineSample


class MachineSampler:
    """Takes samples of the machine; its files stay open."""

    def __init__(self) -> None:
        self._cores = CounterFile(CORES)
        self._waits = CounterFile(WAITS)

    def sample(self, students_ns: int | None = None) -> MachineSample:
        """Read the machine's clocks, its stolen time, its waiting time and the idle time of its cores.

        `students_ns` is the CPU time of the student's processes.
        """
        now_ns, offset_ns = read_clocks()
        idle_ns, stolen_ns = core_times_in(self._cores)
        waited_us = waited_us_in(self._waits)
        return MachineSample(now_ns, offset_ns, stolen_ns, waited_us, idle_ns, students_ns)
