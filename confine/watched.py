"""CPU times and delays of one watched process, by the kernel's counters of its threads.

References
----------
`schedstat` in proc(5): CPU time and waiting time of a thread, in ns; clock_getcpuclockid(3).
"""

from __future__ import annotations

import os
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field

from confine.machine import is_in_real_time, tasks_of

#: Largest number of delays of one process; beyond it, neighbours are joined.
_MOST_DELAYS = 1000
#: Length of the history of a process, in samples.
_HISTORY = 200
#: Time after a delay that it may still affect, in ns: two and a half intervals of a program at 100 Hz.
_AFTER_NS = 25_000_000
#: A delay: its start, the length of its span, the delay itself, and how much of it the core stood still, in ns.
Delay = list[int]


class _Thread:
    """A watched thread: the descriptor of its counters, and their last text and values in ns."""

    __slots__ = ("cpu_ns", "file", "text", "tid", "waited_ns")

    def __init__(self, tid: int) -> None:
        self.tid = tid
        self.file = os.open(f"/proc/{tid}/schedstat", os.O_RDONLY)
        self.text = b""
        self.cpu_ns = 0
        self.waited_ns = 0


@dataclass
class Watched:
    """A watched process: counters of its threads, and its delays."""

    is_confined: bool
    core: int | None = None
    name: str = ""
    #: True if it goes before all ordinary processes.
    is_in_real_time: bool = False
    #: Set as soon as a demotion is reported.
    is_reported: bool = False
    #: Ids of its processes.
    pids: list[int] = field(default_factory=list)
    #: Its threads; those that ran last are at the end.
    threads: list[_Thread] = field(default_factory=list)
    #: CPU time of all threads, in ns.
    cpu_ns: int = 0
    #: CPU clocks of the process and of others among its threads.
    clocks: list[int] = field(default_factory=list)
    #: Excess of these clocks over `cpu_ns`, when all threads had been read; without meaning once a clock has ended.
    excess_ns: int = 0
    #: Samples: time and CPU time until then, in ns.
    history: deque[tuple[int, int]] = field(
        default_factory=lambda: deque([(0, 0)], maxlen=_HISTORY)
    )
    delays: list[Delay] = field(default_factory=list)

    def find_threads(self) -> None:
        """Watch the present threads of its processes; the last process tells how it is scheduled."""
        known = {thread.tid for thread in self.threads}
        for pid in self.pids:
            for tid in map(int, tasks_of(pid)):
                if tid not in known:
                    self._open(tid)
        if self.pids:
            self.is_in_real_time = is_in_real_time(self.pids[-1])

    def _open(self, tid: int) -> None:
        with suppress(OSError):
            self.threads.append(_Thread(tid))
            clock = ~tid << 3 | 2  # as clock_getcpuclockid(3) has it
            time.clock_gettime_ns(clock)
            self.clocks.append(clock)  # without an error, it is the first thread of a process

    def close(self) -> None:
        """Close the counters of all threads."""
        for thread in self.threads:
            os.close(thread.file)

    def read(self, now_ns: int) -> tuple[int, int]:
        """Take the CPU time since the last sample, and return the waiting time of all threads and the longest one.

        Few of a program's many threads run within a sample: as soon as the CPU time of the threads read so far equals
        that of the clocks, no other thread has run or ended a wait.
        """
        clocks_ns = self._read_clocks()
        waited = (0, 0)
        if self.cpu_ns != clocks_ns:
            waited = self._read_threads(clocks_ns)
        self.history.append((now_ns, self.cpu_ns))
        return waited

    def _read_threads(self, clocks_ns: int) -> tuple[int, int]:
        """Read threads until they explain the clocks; see `read`."""
        together_ns = 0
        longest_ns = 0
        for thread in self.threads[::-1]:
            try:
                text = os.pread(thread.file, 100, 0)
                if text == thread.text:
                    continue
                cpu_ns, waited_ns, _ = map(int, text.split())
            except (OSError, ValueError):
                self._forget(thread)
                continue
            self.cpu_ns += cpu_ns - thread.cpu_ns
            waited_since_ns = waited_ns - thread.waited_ns
            thread.text = text
            thread.cpu_ns = cpu_ns
            thread.waited_ns = waited_ns
            self._put_last(thread)
            together_ns += waited_since_ns
            if waited_since_ns > longest_ns:
                longest_ns = waited_since_ns
            if self.cpu_ns == clocks_ns:
                break
        else:
            self.excess_ns += clocks_ns - self.cpu_ns
        return together_ns, longest_ns

    def _read_clocks(self) -> int:
        """Return the CPU time of all threads by the clocks in ns, -1 without clocks or as soon as one has ended."""
        if not self.clocks:
            return -1
        total_ns = -self.excess_ns
        try:
            for clock in self.clocks:
                total_ns += time.clock_gettime_ns(clock)
        except OSError:
            return -1
        return total_ns

    def _forget(self, thread: _Thread) -> None:
        """Watch a thread no more that has ended."""
        os.close(thread.file)
        self.threads.remove(thread)

    def _put_last(self, thread: _Thread) -> None:
        """Put a thread where the next sample looks first."""
        if self.threads[-1] is not thread:
            self.threads.remove(thread)
            self.threads.append(thread)

    def used_since(self, t_ns: int) -> int:
        """Return the CPU time since a time, as far as the history goes back."""
        later_ns, later_cpu_ns = self.history[-1]
        for known_ns, cpu_ns in reversed(self.history):
            if known_ns <= t_ns:
                share = (t_ns - known_ns) / max(1, later_ns - known_ns)
                return self.cpu_ns - cpu_ns - round(share * (later_cpu_ns - cpu_ns))
            later_ns, later_cpu_ns = known_ns, cpu_ns
        return self.cpu_ns - later_cpu_ns

    def noted_since(self, t_ns: int) -> int:
        """Return the sum of the noted delays since a time, in ns."""
        total_ns = 0
        for start_ns, length_ns, delay_ns, _ in reversed(self.delays):
            left_ns = start_ns + length_ns - t_ns
            if left_ns <= 0:
                break
            total_ns += min(delay_ns, left_ns)
        return total_ns

    def calm_ns(self, since_ns: int, now_ns: int) -> int:
        """Return the time between delays since a time, without the times after these that they may affect."""
        calm_ns = 0
        calm_since_ns = since_ns
        for start_ns, length_ns, *_ in [*self.delays, [now_ns, 0]]:
            end_ns = start_ns + length_ns
            if end_ns > since_ns:
                calm_ns += max(0, start_ns - calm_since_ns - _AFTER_NS)
                calm_since_ns = end_ns
        return calm_ns

    def note(self, start_ns: int, end_ns: int, delay_ns: int, stalled_ns: int) -> None:
        """Note a delay within a span of time, and how much of it the core stood still."""
        length_ns = end_ns - start_ns
        delay_ns = min(delay_ns, length_ns)
        self.delays.append([start_ns, length_ns, delay_ns, min(stalled_ns, delay_ns)])
        if len(self.delays) > _MOST_DELAYS:
            self.delays = _joined(self.delays)


def _joined(delays: list[Delay]) -> list[Delay]:
    """Return delays with neighbours joined in pairs; an odd last one stays."""
    joined = []
    for first, second in zip(delays[::2], delays[1::2], strict=False):
        length_ns = second[0] + second[1] - first[0]
        joined.append([first[0], length_ns, first[2] + second[2], first[3] + second[3]])
    if len(delays) % 2:
        joined.append(delays[-1])
    return joined
