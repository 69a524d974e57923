"""Watches delays of processes by the machine: times at which their cores were taken or stalled.

On each core with a watched process a thread wakes up every few milliseconds: if it is late without a wait in the
kernel's queue, the core itself stalled. Every second time it reads the waiting times of the watched threads. Threads of
one process also wait for each other: a wait counts only if one thread alone had a notable one, and only up to the time
that the confined programs left unused.

One process watches many sessions. Each sleep costs it its caches, so that five processes for five sessions took four
times as much CPU time. A session sends it the ends of a channel: a socket for requests and a pipe for answers. Requests
are JSON, a packet each, for example

    {"name": "node", "core": 1, "is_confined": true}
    {"calm_since": 1795297328094735593}

The first brings pidfds of the node's new processes. The second is answered by the undisturbed time of all confined
processes since then, in seconds. The name of a process is written as soon as it is demoted, and the delays of all
processes when the requests end (see `Delay`):

    "node"
    {"node": [[1795297328094735593, 10000000, 4000000, 0]]}
"""

from __future__ import annotations

import gc
import json
import math
import os
import socket
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from confine.priority import WATCHING, demote, put_in_real_time, put_standing
from confine.watched import Watched

#: Each waking of a thread costs 0.07 to 0.15 ms on a virtual machine: with two processes of 13 threads each 2.8 to 3.8 %
#: of a core beside a load of 8. Twice the period would miss stops of 5 to 10 ms, which matter.
_PERIOD_S, _WAKES_PER_SAMPLE = 0.005, 2
_PERIOD_NS = 5_000_000
#: Longest wait that does not count, in ns: in 90 % of samples of 10 ms a thread waited 0.9 ms for others of its process.
_LEAST_NS = 1_000_000
#: Lateness in ns up to which a thread's own counters are not read; a stall is seen as shorter by as much at most.
_UNREAD_NS = 250_000
#: Period of reading processes in real time, in ns. They wait only for each other; five times as many looks found as
#: many delays.
_SELDOM_NS = 50_000_000
#: Share of a core, and time in ns: a process with more CPU time than that loses its real-time scheduling.
_RUNAWAY_SHARE, _RUNAWAY_NS = 0.6, 300_000_000
#: Bytes of a request, and processes in it.
_MOST_BYTES, _MOST_PROCESSES = 4096, 64


class Sample(NamedTuple):
    """The span between two looks at a core's processes, and how long the core stalled in it, in ns."""

    looked_ns: int
    now_ns: int
    stalled_ns: int

    def ends_period(self, period_ns: int) -> bool:
        """Return whether a period of the clock ends within the sample."""
        return self.now_ns // period_ns > self.looked_ns // period_ns


class _Sleeper:
    """Short sleeps of a thread, and stalls of its core in them."""

    def __init__(self) -> None:
        self.woke_ns = time.time_ns()
        self._counters = os.open("/proc/thread-self/schedstat", os.O_RDONLY)
        self._spent_ns = 0
        #: Sum of the latenesses since the counters were last read, in ns.
        self._unread_ns = 0

    def sleep(self) -> int:
        """Sleep for a period, and return how long the core stalled since the last waking, in ns.

        Looks and waits in the kernel's queue make a thread late too. If a thread is hardly late, both were short, and
        its counters need no reading.
        """
        time.sleep(_PERIOD_S)
        # One reading for the end of a sample and for its delay: 1 in 500 stops fell between two readings.
        now_ns = time.time_ns()
        late_ns = now_ns - self.woke_ns - _PERIOD_NS
        self.woke_ns = now_ns
        self._unread_ns += max(0, late_ns)
        if self._unread_ns <= _UNREAD_NS:
            return 0
        late_ns -= self._read_spent()
        if late_ns > _LEAST_NS:
            return late_ns
        return 0

    def _read_spent(self) -> int:
        """Return the CPU time and the time in the kernel's queue since the last reading, in ns."""
        before_ns = self._spent_ns
        cpu_ns, waited_ns, _ = map(int, os.pread(self._counters, 100, 0).split())
        self._spent_ns = cpu_ns + waited_ns
        self._unread_ns = 0
        return self._spent_ns - before_ns

    def close(self) -> None:
        """Close its counters."""
        os.close(self._counters)


class Watching:
    """The watched processes of one session, and its channel.

    Parameters
    ----------
    requests : socket.socket
        Brings requests, a packet each, until it is closed.
    answers : int
        Descriptor for lines with answers.
    """

    def __init__(self, requests: socket.socket, answers: int) -> None:
        self.requests = requests
        self.watched: dict[str, Watched] = {}
        self._answers = answers
        #: Core -> the processes held to it; None -> processes held to none.
        self.held: dict[int | None, list[Watched]] = {}

    def answer(self, value: object) -> None:
        """Write a line, unless the session is gone."""
        with suppress(OSError):
            os.write(self._answers, f"{json.dumps(value)}\n".encode())

    def follow(self, name: str, core: int | None, is_confined: bool, pids: Iterable[int]) -> None:
        """Watch a program on a core, or on all if that is None, with further processes."""
        watched = self.watched.setdefault(name, Watched(is_confined, name=name))
        watched.core = core
        watched.pids.extend(pids)
        watched.find_threads()
        self.held = {}
        for each in self.watched.values():
            self.held.setdefault(each.core, []).append(each)

    def calm_s(self, since_ns: int) -> float:
        """Return the undisturbed time of the most disturbed confined process since a time; inf if there is none."""
        now_ns = time.time_ns()
        calm_ns = math.inf
        for watched in self.watched.values():
            if watched.is_confined and watched.threads:
                calm_ns = min(calm_ns, watched.calm_ns(since_ns, now_ns))
        return calm_ns / 1e9

    def end(self) -> None:
        """Report the delays of each process, and close the channel."""
        self.answer({name: watched.delays for name, watched in self.watched.items()})
        os.close(self._answers)
        self.requests.close()
        for watched in self.watched.values():
            watched.close()

    def note_stop(self, core: int, sample: Sample) -> None:
        """Note the stall of a core for the processes on no core or on other ones."""
        for watched in self.watched.values():
            if watched.core is None:
                _judge(watched, [watched], (0, 0), sample)
            elif watched.core != core:
                _note_stop(watched, sample)

    def demote_runaway(self, watched: Watched, now_ns: int) -> None:
        """Take its scheduling in real time from a trusted process under a flood of work, and report this once."""
        used_ns = watched.used_since(now_ns - _RUNAWAY_NS)
        if used_ns <= _RUNAWAY_SHARE * _RUNAWAY_NS:
            return
        demote(thread.tid for thread in watched.threads)
        watched.is_in_real_time = False
        # Confined processes have no real-time scheduling to lose.
        if not watched.is_confined and not watched.is_reported:
            watched.is_reported = True
            self.answer(watched.name)


class _Watch:
    """All sessions; each core has a thread while there are any, and the first thread also watches processes held to none."""

    def __init__(self) -> None:
        self._sessions: list[Watching] = []
        #: Core, or None -> the sessions with processes there. In a class, most of twenty sessions have none on a core.
        self._on: dict[int | None, list[Watching]] = {}
        self._cores: dict[int, threading.Thread] = {}
        self._lock = threading.Lock()

    def serve(self, session: Watching) -> None:
        """Answer the requests of a session until its end."""
        with self._lock:
            self._sessions.append(session)
            self._sort()
        while True:
            request, descriptors, *_ = socket.recv_fds(
                session.requests, _MOST_BYTES, _MOST_PROCESSES
            )
            if not request:
                break
            self._answer(session, json.loads(request), descriptors)
        with self._lock:
            self._sessions.remove(session)
            self._sort()
        session.end()

    def _sort(self) -> None:
        """Find the sessions with processes on each core."""
        self._on = {}
        for session in self._sessions:
            for core in session.held:
                self._on.setdefault(core, []).append(session)

    def _answer(self, session: Watching, asked: dict[str, Any], descriptors: list[int]) -> None:
        if "calm_since" in asked:
            with self._lock:
                calm_s = session.calm_s(asked["calm_since"])
            session.answer(calm_s)
            return
        pids = _pids_of(descriptors)
        with self._lock:
            session.follow(pids=pids, **asked)
            self._sort()
            self._start_thread(asked["core"])

    def _start_thread(self, core: int | None) -> None:
        """See to it that a core is watched; for a process held to none, any core."""
        if core is None:
            core = min(self._cores, default=min(os.sched_getaffinity(0)))
        if core not in self._cores:
            thread = threading.Thread(target=self._watch_core, args=(core,), daemon=True)
            self._cores[core] = thread
            thread.start()

    def _watch_core(self, core: int) -> None:
        with suppress(OSError):
            os.sched_setaffinity(threading.get_native_id(), {core})
        sleeper = _Sleeper()
        looked_ns = sleeper.woke_ns
        wakes = 0
        while True:
            stalled_ns = sleeper.sleep()
            wakes += 1
            if wakes % _WAKES_PER_SAMPLE and not stalled_ns:
                continue
            with self._lock:
                if not self._sessions:
                    del self._cores[core]
                    sleeper.close()
                    return
                sample = Sample(looked_ns, sleeper.woke_ns, stalled_ns)
                self._look(core, sample)
            looked_ns = sample.now_ns

    def _look(self, core: int, sample: Sample) -> None:
        """Note the delays of the processes on a core since the last look, and on the first core of those held to none."""
        for session in self._on.get(core, ()):
            _look_at_held(session.held[core], sample)
        if sample.stalled_ns:
            for session in self._sessions:
                session.note_stop(core, sample)
        if core == next(iter(self._cores)):
            for session in self._on.get(None, ()):
                _look_at_unheld(session, sample)


def _pids_of(descriptors: Iterable[int]) -> list[int]:
    """Return the ids, in this process's namespace, of processes, and close their descriptors.

    References
    ----------
    `Pid` of pidfds in proc_pid_fdinfo(5): -1 for an ended process, 0 for one of a namespace above.
    """
    pids = []
    for descriptor in descriptors:
        text = Path(f"/proc/self/fdinfo/{descriptor}").read_text()
        os.close(descriptor)
        pid = int(text.split("Pid:")[1].split()[0])
        if pid > 0:
            pids.append(pid)
    return pids


def _look_at_held(held: list[Watched], sample: Sample) -> None:
    """Read the processes of a session on a core, and note the delays of those that waited, or of all in a stall."""
    delayed = []
    for watched in held:
        waited = watched.read(sample.now_ns)
        if sample.stalled_ns or waited[1] > _LEAST_NS:
            delayed.append((watched, waited))
    for watched, waited in delayed:
        own = [other for other in held if other.is_confined or other is watched]
        _judge(watched, own, waited, sample)


def _look_at_unheld(session: Watching, sample: Sample) -> None:
    """Read the processes of a session that are held to no core, those in real time seldom."""
    is_time_for_all = sample.ends_period(_SELDOM_NS)
    for watched in session.held[None]:
        if is_time_for_all or not watched.is_in_real_time:
            _look_at(watched, sample)
    if sample.ends_period(_RUNAWAY_NS):
        for watched in session.held[None]:
            session.demote_runaway(watched, sample.now_ns)


def _look_at(watched: Watched, sample: Sample) -> None:
    """Note the delay of an unheld process since it was last read."""
    looked_ns = max(watched.history[-1][0], sample.looked_ns - _SELDOM_NS)
    waited = watched.read(sample.now_ns)
    if waited[1] > _LEAST_NS:
        _judge(watched, [watched], waited, Sample(looked_ns, sample.now_ns, 0))


def _note_stop(watched: Watched, sample: Sample) -> None:
    """Note a stop of the whole machine for a process on another core.

    A stop makes the thread of another core late by the time between the wakings of both threads less.
    """
    more_ns = sample.stalled_ns - watched.noted_since(sample.looked_ns)
    if _LEAST_NS < more_ns < _PERIOD_NS + _LEAST_NS:
        watched.note(sample.looked_ns, sample.now_ns, more_ns, more_ns)


def _judge(watched: Watched, own: list[Watched], waited: tuple[int, int], sample: Sample) -> None:
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
    stalled_ns = max(0, sample.stalled_ns - noted_ns)
    delay_ns = stalled_ns
    if longest_ns > _LEAST_NS:
        used_ns = sum(other.used_since(start_ns) for other in own)
        unused_ns = sample.now_ns - start_ns - used_ns
        delay_ns = max(delay_ns, min(together_ns, unused_ns) - noted_ns)
    if delay_ns > _LEAST_NS:
        watched.note(start_ns, sample.now_ns, delay_ns, stalled_ns)


def main(link: socket.socket) -> None:
    """Watch the processes of sessions until the socket for their channels is closed."""
    put_standing([os.getpid()])
    put_in_real_time([os.getpid()], WATCHING)  # and so all threads that follow
    gc.disable()  # A collection would be a stall, and nothing here is cyclic.
    watch = _Watch()
    serving = []
    while True:
        request, descriptors, *_ = socket.recv_fds(link, _MOST_BYTES, 2)
        if not request:
            break
        requests, answers = descriptors
        session = Watching(socket.socket(fileno=requests), answers)
        thread = threading.Thread(target=watch.serve, args=(session,), daemon=True)
        serving.append(thread)
        thread.start()
    for thread in serving:
        thread.join()
