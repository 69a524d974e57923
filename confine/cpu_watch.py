"""Watches delays of processes by the machine: times at which their cores were taken or stalled.

On each core with a watched process a thread wakes up every few milliseconds: if it is late without a wait in the
kernel's queue, the core itself stalled. Every second time it reads the waiting times of the watched threads. Threads of
one process also wait for each other: a wait counts only if one thread alone had a notable one, and only up to the time
that the confined programs left unused.

It is a process of its own and reads requests as JSON, a line each, for example

    {"name": "node", "core": 1, "is_confined": true, "threads": [712, 713]}
    {"calm_since": 1795297328094735593}

The second is answered by the undisturbed time of all confined processes since then, in seconds. The name of a process is
written as soon as it is demoted, and the delays of all processes at the end of the input (see `Delay`):

    "node"
    {"node": [[1795297328094735593, 10000000, 4000000]]}
"""

from __future__ import annotations

import json
import math
import os
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

from confine.priority import WATCHING, demote, put_in_real_time, put_standing
from confine.watched import Delay, Watched

#: Each waking of a thread costs 0.07 to 0.15 ms on a virtual machine: with two processes of 13 threads each 2.8 to 3.8 %
#: of a core beside a load of 8. Twice the period would miss stops of 5 to 10 ms, which matter.
_PERIOD_S, _WAKES_PER_SAMPLE = 0.005, 2
_PERIOD_NS = 5_000_000
#: Longest wait that does not count, in ns: in 90 % of samples of 10 ms a thread waited 0.9 ms for others of its process.
_LEAST_NS = 1_000_000
#: Share of a core, and time in ns: a process with more CPU time than that loses its real-time scheduling.
_RUNAWAY_SHARE, _RUNAWAY_NS = 0.6, 300_000_000


@dataclass(frozen=True)
class _Sample:
    """The span between two looks at a core's processes, and how long the core stalled in it, in ns."""

    looked_ns: int
    now_ns: int
    stalled_ns: int

    def ends_period(self, period_ns: int) -> bool:
        """Return whether a period of the clock ends within the sample."""
        return self.now_ns // period_ns > self.looked_ns // period_ns


class _Watch:
    """All watched processes; each core has a thread, and the first core's thread also watches processes held to none."""

    def __init__(self) -> None:
        self._watched: dict[str, Watched] = {}
        self._cores: dict[int, threading.Thread] = {}
        self._lock = threading.Lock()
        self._ended = threading.Event()

    def follow(self, name: str, core: int | None, is_confined: bool, threads: list[int]) -> None:
        """Watch some threads of a process, which is held to a core or to none."""
        with self._lock:
            watched = self._watched.setdefault(name, Watched(is_confined, name=name))
            watched.core = core
            watched.open(threads)
        if core is None:
            core = min(self._cores, default=min(os.sched_getaffinity(0)))
        if core not in self._cores:
            thread = threading.Thread(target=self._watch_core, args=(core,), daemon=True)
            self._cores[core] = thread
            thread.start()

    def calm_s(self, since_ns: int) -> float:
        """Return the undisturbed time of the most disturbed confined process since a time; inf if there is none."""
        now_ns = time.time_ns()
        calm_ns = math.inf
        with self._lock:
            for watched in self._watched.values():
                if watched.is_confined and watched.files:
                    calm_ns = min(calm_ns, watched.calm_ns(since_ns, now_ns))
        return calm_ns / 1e9

    def end(self) -> dict[str, list[Delay]]:
        """End all threads, and return the delays of each process."""
        self._ended.set()
        for thread in self._cores.values():
            thread.join()
        return {name: watched.delays for name, watched in self._watched.items()}

    def _watch_core(self, core: int) -> None:
        with suppress(OSError):
            os.sched_setaffinity(threading.get_native_id(), {core})
        queue = os.open("/proc/thread-self/schedstat", os.O_RDONLY)
        looked_ns = woke_ns = time.time_ns()
        waited_ns = stalled_ns = wakes = 0
        while not self._ended.is_set():
            time.sleep(_PERIOD_S)
            # One reading for the end of a sample and for its delay: 1 in 500 stops fell between two readings.
            now_ns = time.time_ns()
            waited_before_ns = waited_ns
            waited_ns = int(os.pread(queue, 100, 0).split()[1])
            late_ns = now_ns - woke_ns - _PERIOD_NS - (waited_ns - waited_before_ns)
            woke_ns = now_ns
            wakes += 1
            if late_ns > _LEAST_NS:
                stalled_ns += late_ns
            if wakes % _WAKES_PER_SAMPLE == 0 or stalled_ns:
                with self._lock:
                    self._look(core, _Sample(looked_ns, now_ns, stalled_ns))
                looked_ns = now_ns
                stalled_ns = 0

    def _look(self, core: int, sample: _Sample) -> None:
        """Note the delays of the processes on a core and of those held to none since the last look."""
        held = [watched for watched in self._watched.values() if watched.core == core]
        waits = [watched.read(sample.now_ns) for watched in held]
        for watched, waited in zip(held, waits, strict=True):
            own = [other for other in held if other.is_confined or other is watched]
            _judge(watched, own, waited, sample)
        if sample.stalled_ns:
            for watched in self._watched.values():
                if watched.core not in (core, None):
                    _note_stop(watched, sample)
        is_first = core == next(iter(self._cores))
        for watched in self._watched.values():
            if watched.core is None:
                self._look_at_unheld(watched, sample, is_first)

    def _look_at_unheld(self, watched: Watched, sample: _Sample, is_first: bool) -> None:
        """Note the delay of a process that is held to no core; the first core's thread reads its counters."""
        if not is_first:
            _judge(watched, [watched], (0, 0), sample)
            return
        _judge(watched, [watched], watched.read(sample.now_ns), sample)
        if sample.ends_period(_RUNAWAY_NS):
            used_ns = watched.used_since(sample.now_ns - _RUNAWAY_NS)
            if used_ns > _RUNAWAY_SHARE * _RUNAWAY_NS:
                # A trusted process that is flooded with work.
                demote(watched.files)
                _report_demotion(watched)


def _report_demotion(watched: Watched) -> None:
    """Report a demotion once, and at once; confined processes have no real-time scheduling to lose."""
    if not watched.is_confined and not watched.is_reported:
        watched.is_reported = True
        os.write(1, f"{json.dumps(watched.name)}\n".encode())


def _note_stop(watched: Watched, sample: _Sample) -> None:
    """Note a stop of the whole machine for a process on another core.

    A stop makes the thread of another core late by the time between the wakings of both threads less.
    """
    more_ns = sample.stalled_ns - watched.noted_since(sample.looked_ns)
    if _LEAST_NS < more_ns < _PERIOD_NS + _LEAST_NS:
        watched.note(sample.looked_ns, sample.now_ns, more_ns)


def _judge(watched: Watched, own: list[Watched], waited: tuple[int, int], sample: _Sample) -> None:
    """Note the delay of a process in a sample, unless it is as short as most.

    `waited` are the waiting times of all its threads together and of one at most; CPU time of the processes in `own` is
    no delay.
    """
    together_ns, longest_ns = waited
    if max(longest_ns, sample.stalled_ns) <= _LEAST_NS:
        return
    # A wait is counted when it ends; it began as long ago.
    start_ns = min(sample.looked_ns, sample.now_ns - longest_ns)
    noted_ns = watched.noted_since(start_ns)
    delay_ns = sample.stalled_ns - noted_ns
    if longest_ns > _LEAST_NS:
        used_ns = sum(other.used_since(start_ns) for other in own)
        unused_ns = sample.now_ns - start_ns - used_ns
        delay_ns = max(delay_ns, min(together_ns, unused_ns) - noted_ns)
    if delay_ns > _LEAST_NS:
        watched.note(start_ns, sample.now_ns, delay_ns)


def main() -> None:
    """Watch the processes that are named on standard input, and report their delays at its end."""
    put_standing([os.getpid()])
    put_in_real_time([os.getpid()], WATCHING)  # and so all threads that follow
    watch = _Watch()
    for line in sys.stdin:
        asked = json.loads(line)
        if "calm_since" in asked:
            print(json.dumps(watch.calm_s(asked["calm_since"])), flush=True)
        else:
            watch.follow(**asked)
    print(json.dumps(watch.end()), flush=True)
