"""Watches when the machine keeps a session's processes from their cores: a process of the grader's in its sandbox.

On each core that a student's process is held to, a thread wakes up every few milliseconds: if late, without waiting in
the kernel's queue, the core itself stalled. Every second time it reads for how long the threads of watched processes
waited. They wait for each other too: so a wait counts only where one thread alone had a notable one, and for no longer
than the student's programs left of that time.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field

from confine.priority import WATCHING, demote, put_in_real_time, put_standing
from grader.live.process.forked import Program
from grader.live.process.process import RunningProcess
from grader.live.process.waiting import within
from grader.recording.session import ProcessRun

#: All that wakes a thread up costs 0.07 to 0.15 ms on a virtual machine: with two processes of 13 threads each 2.8 to
#: 3.8 % of a core beside a load of 8. At twice the period stops of 5 to 10 ms, which matter, would be missed.
_PERIOD_S, _WAKES_PER_SAMPLE = 0.005, 2
#: Waits that a core has at any time: a thread waited 0.9 ms of 10 ms for others of its process (90 % of samples).
_LEAST_NS = 1_000_000
#: What is kept of one process; where there is more, neighbours become one.
_MOST_KEPT = 1000
#: How far back it is known what a process used, in samples.
_HISTORY = 200
#: What takes this share of a core for so long may not go before all others any more.
_RUNAWAY_SHARE, _RUNAWAY_NS = 0.6, 300_000_000
#: The limit that such a process has hit, as `ProcessRun.limit` names limits.
COMPUTING = "computing"
#: What two delays take of the time between them at 100 Hz: the interval in which one ends, the next, half of the last.
_AFTER_NS = 25_000_000
_STOP_S, _ANSWER_S = 3.0, 1.0
_ADDRESS_SPACE_BYTES = 1024**3


class CpuWatch:
    """A session's side of the watch; without it, samples twice a second tell the same less finely."""

    def __init__(self) -> None:
        self._running: RunningProcess | None = None
        self._runs: dict[str, ProcessRun] = {}
        self._calm_s: asyncio.Future[float] | None = None

    async def start(self, environment: dict[str, str]) -> RunningProcess:
        """Start the process that watches, and return it."""
        run = ProcessRun("cpu watch", "grader", ["python", "-m", __name__])
        program = Program(run.name, main, environment, _ADDRESS_SPACE_BYTES)
        self._running = await RunningProcess.fork(run, program, on_message=self._hear)
        return self._running

    def follow(self, processes: Iterable[RunningProcess]) -> None:
        """Have it watch the threads that some processes have now, on the cores to which these are held."""
        if self._running is None:
            return
        for process in processes:
            run = process.run
            name = f"{run.name} {run.started_ns}"  # a program may be started twice
            if process is not self._running and process.alive and process.threads:
                self._runs[name] = run
                said = {
                    "name": name,
                    "core": run.core,
                    "role": run.role,
                    "threads": process.threads,
                }
                self._running.write((json.dumps(said) + "\n").encode())

    async def calm_s(self, since_ns: int) -> float:
        """Return for how long the student's processes were undisturbed since a time; inf where nobody can tell."""
        if self._running is None or not self._running.alive:
            return math.inf
        self._calm_s = asyncio.get_running_loop().create_future()
        self._running.write((json.dumps({"calm_since": since_ns}) + "\n").encode())
        with suppress(asyncio.TimeoutError):
            return await within(self._calm_s, _ANSWER_S)
        return math.inf

    async def stop(self) -> None:
        """Take over what it has seen, and end it."""
        if self._running is not None:
            self._running.write(b"", last=True)
            await self._running.wait_exit(_STOP_S)
            await self._running.kill()

    def _hear(self, line: bytes) -> None:
        said = json.loads(line)
        if isinstance(said, str):
            self._runs[said].limit = COMPUTING
        elif isinstance(said, dict):
            for name, disturbed in said.items():
                self._runs[name].disturbed = disturbed
        elif self._calm_s is not None and not self._calm_s.done():
            self._calm_s.set_result(float(said))


@dataclass
class _Watched:
    """A process that is watched, by the counters of its threads."""

    role: str
    core: int | None = None
    name: str = ""
    #: Set once its demotion is reported, and for a student's process from the beginning.
    is_reported: bool = False
    #: Thread id -> descriptor of its counters, who ran last at the end; what they said: CPU and queue time, in ns.
    files: dict[int, int] = field(default_factory=dict)
    last: dict[int, tuple[int, int]] = field(default_factory=dict)
    said: dict[int, bytes] = field(default_factory=dict)
    cpu_ns: int = 0
    #: The clocks of its processes, and by how much more than `cpu_ns` these were seen to have used.
    clocks: list[int] = field(default_factory=list)
    more_ns: int = 0
    #: (time, CPU time until then), both in ns.
    history: deque[tuple[int, int]] = field(
        default_factory=lambda: deque([(0, 0)], maxlen=_HISTORY)
    )
    disturbed: list[list[int]] = field(default_factory=list)

    def open(self, threads: Iterable[int]) -> None:
        for thread in threads:
            if thread not in self.files:
                with suppress(OSError):
                    self.files[thread] = os.open(f"/proc/{thread}/schedstat", os.O_RDONLY)
                    time.clock_gettime_ns(
                        clock := ~thread << 3 | 2
                    )  # as clock_getcpuclockid(3) has it
                    self.clocks.append(clock)  # since it is the first thread of a process

    def read(self, now_ns: int) -> tuple[int, int]:
        """Take the CPU time since the last look, and return how long its threads waited: together, and the longest.

        Of a node's dozen threads few run within a sample: once these account for what the clocks of its processes say,
        no other one ran, nor ended a wait.
        """
        together = longest = process_ns = 0
        with suppress(OSError):  # Once one of them has ended, all threads are read.
            process_ns = sum(map(time.clock_gettime_ns, self.clocks))
        for thread, file in reversed(list(self.files.items())):
            if process_ns and process_ns - self.cpu_ns == self.more_ns:
                break
            try:
                if (said := os.pread(file, 100, 0)) == self.said.get(thread):
                    continue
                cpu_ns, waited_ns, *_ = map(int, said.split())
            except (OSError, ValueError):  # It has ended.
                os.close(self.files.pop(thread))
                continue
            cpu_before_ns, before_ns = self.last.get(thread, (0, 0))
            self.last[thread], self.said[thread] = (cpu_ns, waited_ns), said
            self.cpu_ns += cpu_ns - cpu_before_ns
            together += waited_ns - before_ns
            longest = max(longest, waited_ns - before_ns)
            self.files[thread] = self.files.pop(thread)
        else:
            self.more_ns = process_ns - self.cpu_ns
        self.history.append((now_ns, self.cpu_ns))
        return together, longest

    def used_since(self, t_ns: int) -> int:
        """Return the CPU time that it used since a time, as far as that is known."""
        later_ns, later_cpu_ns = self.history[-1]
        for known_ns, cpu_ns in reversed(self.history):
            if known_ns <= t_ns:
                share = (t_ns - known_ns) / max(1, later_ns - known_ns)
                return self.cpu_ns - cpu_ns - round(share * (later_cpu_ns - cpu_ns))
            later_ns, later_cpu_ns = known_ns, cpu_ns
        return self.cpu_ns - later_cpu_ns

    def noted_since(self, t_ns: int) -> int:
        """Return for how long it was delayed since a time, as far as that is noted already."""
        since = itertools.takewhile(
            lambda noted: noted[0] + noted[1] > t_ns, reversed(self.disturbed)
        )
        return sum(
            min(delay_ns, start_ns + length_ns - t_ns) for start_ns, length_ns, delay_ns in since
        )

    def calm_ns(self, since_ns: int, now_ns: int) -> int:
        """Return how much of a time lies between delays, without what they may have affected after them."""
        calm_ns, end_ns = 0, since_ns
        for start_ns, length_ns, _ in [*self.disturbed, (now_ns, 0, 0)]:
            if start_ns + length_ns > since_ns:
                calm_ns += max(0, start_ns - end_ns - _AFTER_NS)
                end_ns = start_ns + length_ns
        return calm_ns

    def note(self, start_ns: int, end_ns: int, delay_ns: int) -> None:
        self.disturbed.append([start_ns, end_ns - start_ns, min(delay_ns, end_ns - start_ns)])
        if len(self.disturbed) > _MOST_KEPT:
            pairs = zip(self.disturbed[::2], self.disturbed[1::2], strict=False)
            self.disturbed = [
                [first[0], last[0] + last[1] - first[0], first[2] + last[2]]
                for first, last in pairs
            ] + self.disturbed[len(self.disturbed) // 2 * 2 :]


class _Watch:
    """All that is watched; each core has a thread, and the first one's looks after what is held to none."""

    def __init__(self) -> None:
        self.watched: dict[str, _Watched] = {}
        self._cores: dict[int, threading.Thread] = {}
        self._lock = threading.Lock()
        self._ended = threading.Event()

    def follow(self, name: str, core: int | None, role: str, threads: list[int]) -> None:
        with self._lock:
            is_student = role == "student"
            watched = self.watched.setdefault(
                name, _Watched(role, name=name, is_reported=is_student)
            )
            watched.core = core
            watched.open(threads)
        wanted = (
            core if core is not None else min(self._cores, default=min(os.sched_getaffinity(0)))
        )
        if wanted not in self._cores:
            self._cores[wanted] = threading.Thread(
                target=self._watch_core, args=(wanted,), daemon=True
            )
            self._cores[wanted].start()

    def calm_s(self, since_ns: int) -> float:
        """Return for how long that of the student's processes was undisturbed which was so least."""
        now_ns = time.time_ns()
        with self._lock:
            students = [w for w in self.watched.values() if w.role == "student" and w.files]
            return min((w.calm_ns(since_ns, now_ns) for w in students), default=math.inf) / 1e9

    def end(self) -> dict[str, list[list[int]]]:
        self._ended.set()
        for thread in self._cores.values():
            thread.join()
        return {name: watched.disturbed for name, watched in self.watched.items()}

    def _watch_core(self, core: int) -> None:
        with suppress(OSError):
            os.sched_setaffinity(threading.get_native_id(), {core})
        queue = os.open("/proc/thread-self/schedstat", os.O_RDONLY)
        looked_ns, waited_ns = time.time_ns(), 0
        woke_ns = looked_ns
        stalled_ns = wakes = 0
        while not self._ended.is_set():
            time.sleep(_PERIOD_S)
            # Read once: a stop between the reading for a sample's end and that for its delay came here in 1 of 500.
            now_ns, before_ns = time.time_ns(), waited_ns
            waited_ns = int(os.pread(queue, 100, 0).split()[1])
            late_ns = now_ns - woke_ns - round(_PERIOD_S * 1e9) - (waited_ns - before_ns)
            woke_ns, wakes = now_ns, wakes + 1
            if late_ns > _LEAST_NS:
                stalled_ns += late_ns
            if wakes % _WAKES_PER_SAMPLE == 0 or stalled_ns:
                with self._lock:
                    self._look(core, looked_ns, now_ns, stalled_ns)
                looked_ns, stalled_ns = now_ns, 0

    def _look(self, core: int, looked_ns: int, now_ns: int, stalled_ns: int) -> None:
        """Note for how long each process on a core, and those on none, were kept from theirs since the last look."""
        is_first = core == next(iter(self._cores))
        held = [w for w in self.watched.values() if w.core == core]
        waits = {id(w): w.read(now_ns) for w in held}
        for watched in held:
            own = [w for w in held if w.role == "student" or w is watched]
            self._judge(watched, own, *waits[id(watched)], looked_ns, now_ns, stalled_ns)
        for watched in [
            w for w in self.watched.values() if w.core not in (core, None) and stalled_ns
        ]:
            # A stop of all makes another core's thread late by so much less as that had woken up later.
            more_ns = stalled_ns - watched.noted_since(looked_ns)
            if _LEAST_NS < more_ns < _PERIOD_S * 1e9 + _LEAST_NS:
                watched.note(looked_ns, now_ns, more_ns)
        for watched in [w for w in self.watched.values() if w.core is None]:
            waited = watched.read(now_ns) if is_first else (0, 0)
            self._judge(watched, [watched], *waited, looked_ns, now_ns, stalled_ns)
            is_time = is_first and now_ns // _RUNAWAY_NS > looked_ns // _RUNAWAY_NS
            if is_time and watched.used_since(now_ns - _RUNAWAY_NS) > _RUNAWAY_SHARE * _RUNAWAY_NS:
                # One of the grader's own, held to no core, that somebody floods.
                demote(watched.files)
                self._note_demoted(watched)

    def _note_demoted(self, watched: _Watched) -> None:
        """Say once, and at once, that a process of the grader's was demoted."""
        if not watched.is_reported:
            watched.is_reported = True
            os.write(1, f"{json.dumps(watched.name)}\n".encode())

    def _judge(
        self, watched: _Watched, own: list[_Watched], together_ns: int, longest_ns: int,
        looked_ns: int, now_ns: int, stalled_ns: int,
    ) -> None:  # fmt: skip
        if max(longest_ns, stalled_ns) <= _LEAST_NS:
            return  # as at most times
        # A wait is counted when it ends; it began as long ago.
        start_ns = min(looked_ns, now_ns - longest_ns)
        delay_ns = 0
        if longest_ns > _LEAST_NS:
            used_ns = sum(w.used_since(start_ns) for w in own)
            delay_ns = min(together_ns, now_ns - start_ns - used_ns) - watched.noted_since(start_ns)
        delay_ns = max(delay_ns, stalled_ns - watched.noted_since(start_ns))
        if delay_ns > _LEAST_NS:
            watched.note(start_ns, now_ns, delay_ns)


def main() -> None:
    """Watch what is named on standard input, one JSON object a line, and at its end say what was seen."""
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
