"""CPU times and delays of all threads of a program, looked at again and again.

A look costs little while the program keeps its threads: it searches for processes and threads only after one began
or ended, and leaves out threads without CPU time since the last look.

References
----------
`schedstat` in proc(5): CPU time and waiting time of a thread, in ns; clock_getcpuclockid(3).
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable

from confine.machine import (
    LOADS,
    CounterFile,
    cpu_of_children_ns,
    last_task_in,
    read_bytes_of,
    tasks_below,
)

#: Most files of threads that one program keeps open, and all programs of this process together: each program may have
#: hundreds of threads, and this process may have a thousand open files.
_MOST_KEPT, _MOST_KEPT_TOGETHER = 24, 128


class ProgramUsage:
    """The processes and threads of one program, and their CPU times and delays until the last look.

    Attributes
    ----------
    tasks
        Thread ids by process id, of the present processes.
    searches
        Number of searches for processes and threads; `tasks` change with it only.
    times
        CPU time and waiting time in ns by thread id; ended threads stay.
    """

    def __init__(self) -> None:
        self.tasks: dict[int, list[int]] = {}
        self.searches = 0
        self.times: dict[int, tuple[int, int]] = {}
        self._counters = _ThreadCounters()
        self._loads = CounterFile(LOADS)
        #: The sandbox's newest process or thread before the last search.
        self._newest = b""
        #: Set as soon as a process or thread has ended since the last search.
        self._has_ended = False
        #: Present threads, the last to run at the end.
        self._order: list[int] = []
        #: CPU time of the threads in `times`, in ns.
        self._read_ns = 0
        #: CPU time of the present processes, their ended threads included, in ns.
        self._clocks_ns = 0
        #: Excess of this time over `_read_ns`, when all threads had been read.
        self._excess_ns = 0
        #: CPU time of ended children of the present processes, in ns.
        self._children_ns = 0

    def look(self, root: int) -> None:
        """Look at the program below a process."""
        self.find(root)
        self._clocks_ns = self._read_clocks()
        if self._has_ended:
            self.find(root)
            self._clocks_ns = self._read_clocks()
        self._read_threads()

    def find(self, root: int) -> None:
        """Find the present processes below a process, and their threads, unless they are the same.

        Only in a namespace of process ids of its own does a program keep its processes, and is a new id rare.
        """
        newest = last_task_in(self._loads)
        if os.getpid() == 1 and root in self.tasks:
            if (newest, False) == (self._newest, self._has_ended):
                return
        self._newest = newest
        self._has_ended = False
        self.searches += 1
        self.tasks = {pid: list(map(int, tasks)) for pid, tasks in tasks_below(root).items()}
        self._children_ns = sum(map(cpu_of_children_ns, self.tasks))
        self._order = _in_order(self._order, self.tasks.values())
        self._counters.keep_only(self._order)

    def _read_threads(self) -> None:
        """Read the counters of all threads with CPU time since the last look.

        As soon as the threads read so far explain the CPU time by the processes' clocks, no other thread has run or
        ended a wait.
        """
        for tid in reversed(self._order.copy()):
            excess_ns = self._clocks_ns - self._read_ns
            if (excess_ns, False) == (self._excess_ns, self._has_ended):
                break
            self._read(tid)
        else:
            self._excess_ns = self._clocks_ns - self._read_ns

    @property
    def cpu_ns(self) -> int:
        """CPU time in ns, ended threads and children included."""
        return max(self._clocks_ns + self._children_ns, self._read_ns)

    @property
    def delay_ns(self) -> int:
        """Waiting time of all threads together, in ns."""
        return sum(delay_ns for _, delay_ns in self.times.values())

    def close(self) -> None:
        """Close all files; the next look opens them again."""
        self._counters.keep_only(())
        self._loads.close()

    def _read_clocks(self) -> int:
        """Return the CPU time of all present processes, in ns."""
        total_ns = 0
        for pid in self.tasks:
            try:
                total_ns += time.clock_gettime_ns(~pid << 3 | 2)  # as clock_getcpuclockid(3) has it
            except OSError:
                self._has_ended = True
        return total_ns

    def _read(self, tid: int) -> None:
        """Take the counters of a thread; the next look begins with the last ones to run."""
        before = self.times.get(tid, (0, 0))
        try:
            words = self._counters.read(tid).split()
            now = int(words[0]), int(words[1])
        except (OSError, ValueError, IndexError):
            self._has_ended = True
            return
        if now != before:
            self.times[tid] = now
            self._read_ns += now[0] - before[0]
            self._order.remove(tid)
            self._order.append(tid)


class _ThreadCounters:
    """The counters of threads. Some files stay open, because opening takes longer than reading."""

    #: Number of open files of all programs together.
    _kept_together = 0

    def __init__(self) -> None:
        self._kept: dict[int, CounterFile] = {}

    def read(self, tid: int) -> bytes:
        """Return the text of a thread's `schedstat`; raises `OSError` if the thread has ended."""
        kept = self._kept.get(tid)
        if kept is not None:
            return kept.read()
        file = f"/proc/{tid}/schedstat"
        if not self._has_room():
            return read_bytes_of(file)
        kept = CounterFile(file)
        text = kept.read()
        self._kept[tid] = kept
        _ThreadCounters._kept_together += 1
        return text

    def _has_room(self) -> bool:
        """Tell whether one more file may stay open."""
        if len(self._kept) >= _MOST_KEPT:
            return False
        return _ThreadCounters._kept_together < _MOST_KEPT_TOGETHER

    def keep_only(self, tids: Iterable[int]) -> None:
        """Close the files of all other threads."""
        for tid in self._kept.keys() - set(tids):
            self._kept.pop(tid).close()
            _ThreadCounters._kept_together -= 1


def _in_order(known: Iterable[int], present: Iterable[Iterable[int]]) -> list[int]:
    """Return all present threads: known ones in their order, then new ones."""
    new = dict.fromkeys(tid for tids in present for tid in tids)
    kept = [tid for tid in known if tid in new]
    for tid in kept:
        del new[tid]
    return [*kept, *new]
