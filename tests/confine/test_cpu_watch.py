"""Delays of processes by the machine are seen, and waits of a process for its own threads are not taken for delays."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from confine.priority import put_in_real_time
from confine.watched import Watched

pytestmark = pytest.mark.live

_WATCH = """
import socket, sys
from confine.cpu_watch import main
main(socket.socket(fileno=int(sys.argv[1])))
"""
#: Begins to compute in two threads, without the interpreter's lock, as soon as it may.
_TWO_THREADS = """
import hashlib, sys, threading
sys.stdin.readline()
block = bytes(2**20)
def compute():
    while True:
        hashlib.sha256(block)
threading.Thread(target=compute, daemon=True).start()
compute()
"""
#: Threads that compute for a moment each, now and then, and one that begins after a second.
_MANY_THREADS = """
import hashlib, threading, time
block = bytes(2**18)
def compute(pause_s):
    while True:
        hashlib.sha256(block)
        time.sleep(pause_s)
for number in range(12):
    threading.Thread(target=compute, args=(0.002 * 2**number,), daemon=True).start()
time.sleep(1)
compute(0.001)
"""
_CORE = min(os.sched_getaffinity(0))


@contextmanager
def program(source: str, *arguments: str, **more: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a program until the end of the context."""
    command = [sys.executable, "-c", source, *arguments]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **more
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def until(condition: Callable[[], bool], limit_s: float) -> None:
    """Wait until a condition holds; fails if that takes too long."""
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def say(process: subprocess.Popen[str], text: str) -> None:
    """Write a line to a program."""
    assert process.stdin is not None
    process.stdin.write(text + "\n")
    process.stdin.flush()


def threads_of(pid: int) -> list[int]:
    """Return the ids of a process's threads."""
    return [int(task.name) for task in Path(f"/proc/{pid}/task").iterdir()]


class Channel:
    """A session's channel to a watch."""

    def __init__(self, link: socket.socket) -> None:
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        answers, writer = os.pipe()
        with theirs:
            socket.send_fds(link, [b"session"], [theirs.fileno(), writer])
        os.close(writer)
        self._answers = os.fdopen(answers)
        #: Names of processes that the watch said to have demoted.
        self.demoted: list[str] = []

    def follow(self, name: str, is_confined: bool, core: int | None, pid: int | None) -> None:
        """Have a process watched, or new threads of a known one; returns once it is."""
        asked = {"name": name, "is_confined": is_confined, "core": core}
        descriptors = [] if pid is None else [os.pidfd_open(pid)]
        socket.send_fds(self._requests, [json.dumps(asked).encode()], descriptors)
        for descriptor in descriptors:
            os.close(descriptor)
        self.calm_s(time.time_ns())

    def calm_s(self, since_ns: int) -> float:
        """Return for how long the watched were undisturbed since a time."""
        self._requests.send(json.dumps({"calm_since": since_ns}).encode())
        while isinstance(answer := json.loads(self._answers.readline()), str):
            self.demoted.append(answer)
        return float(answer)

    def seen(self) -> dict[str, list[list[int]]]:
        """Close the channel and return the recorded delays."""
        self._requests.close()
        with self._answers:
            *demoted, last = map(json.loads, self._answers)
        self.demoted += demoted
        found: dict[str, list[list[int]]] = last
        return found


class Watch(NamedTuple):
    """A running watch, and the link to it."""

    process: subprocess.Popen[str]
    link: socket.socket


@contextmanager
def watching() -> Iterator[Watch]:
    """Run a watch; without sessions, it ends with its link."""
    link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with program(_WATCH, str(theirs.fileno()), pass_fds=(theirs.fileno(),)) as process:
        theirs.close()
        yield Watch(process, link)
        link.close()
        assert process.wait(10) == 0


def counters(pid: int) -> tuple[float, float]:
    """Return CPU time and waits of all threads of a process, in s."""
    each = [Path(f"/proc/{pid}/task/{t}/schedstat").read_text().split() for t in threads_of(pid)]
    return sum(int(words[0]) for words in each) / 1e9, sum(int(words[1]) for words in each) / 1e9


class Moment(NamedTuple):
    """A time, and the CPU time and the waits of a process until then."""

    t_ns: int
    cpu_s: float
    waited_s: float

    @classmethod
    def of(cls, pid: int) -> Moment:
        """Return the present moment of a process."""
        return cls(time.time_ns(), *counters(pid))

    def unused_until(self, later: Moment) -> float:
        """Return the time that the process did not use its core until a later moment, in s."""
        return (later.t_ns - self.t_ns) / 1e9 - (later.cpu_s - self.cpu_s)


def test_waits_for_others_are_seen_and_those_for_oneself_are_not() -> None:
    """Two threads on one core wait for each other half of the time.

    Only the time used by other processes counts as machine delay.
    """
    with watching() as watch, program(_TWO_THREADS) as it, program(_TWO_THREADS) as other:
        say(it, "")
        until(lambda: len(threads_of(it.pid)) == 2, 30)
        for process in (it, other):
            for thread in threads_of(process.pid):
                os.sched_setaffinity(thread, {_CORE})
        channel = Channel(watch.link)
        channel.follow("it", True, _CORE, it.pid)
        time.sleep(0.1)
        start = Moment.of(it.pid)
        time.sleep(0.4)
        middle = Moment.of(it.pid)
        say(other, "")
        time.sleep(0.6)
        end = Moment.of(it.pid)
        delays = channel.seen()["it"]
    alone_s = sum(delay for at, _, delay, _ in delays if start.t_ns < at < middle.t_ns) / 1e9
    both_s = sum(delay for at, _, delay, _ in delays if start.t_ns < at < end.t_ns) / 1e9
    stalled_s = sum(stalled for at, *_, stalled in delays if start.t_ns < at < end.t_ns) / 1e9
    assert stalled_s < 0.3 * both_s, "to wait for another program is no stall"
    assert middle.waited_s - start.waited_s > 0.3
    assert alone_s <= start.unused_until(middle) + 0.1
    unused_s = start.unused_until(end)
    assert unused_s > 0.1
    assert both_s == pytest.approx(unused_s, abs=0.3 * unused_s)


def all_stopped(pid: int) -> bool:
    """Say whether every thread of a process stopped: each one stops only when it next leaves the kernel."""
    return all(
        "T (stopped)" in Path(f"/proc/{pid}/task/{thread}/status").read_text()
        for thread in threads_of(pid)
    )


@pytest.mark.parametrize("clocks", ["all", "none", "one has ended"])
def test_no_thread_is_forgotten_for_not_being_read_each_time(clocks: str) -> None:
    """Threads that did not run are not read, if the clocks of their processes tell so.

    The sums still cover all threads, to the nanosecond.
    """
    with program(_MANY_THREADS) as it, program(_TWO_THREADS) as other:
        until(lambda: len(threads_of(it.pid)) == 13, 30)
        for process in (it, other):
            os.sched_setaffinity(process.pid, {_CORE})
        say(other, "")
        watched = Watched(is_confined=True, pids=[it.pid])
        watched.find_threads()
        if clocks == "none":
            watched.clocks.clear()
        elif clocks == "one has ended":
            with subprocess.Popen(["true"]) as ended:
                watched.clocks.append(~ended.pid << 3 | 2)
        waited_ns = 0
        for sample in range(200):
            time.sleep(0.01)
            waited_ns += watched.read(sample)[0]
        it.send_signal(signal.SIGSTOP)
        until(lambda: all_stopped(it.pid), 5)
        waited_ns += watched.read(200)[0]
        cpu_s, all_waited_s = counters(it.pid)
    assert watched.cpu_ns / 1e9 == cpu_s
    assert waited_ns / 1e9 == all_waited_s


def test_what_is_stopped_with_all_its_sandbox_is_seen() -> None:
    """A process that does not run waits in no queue: that the watch itself did not wake up tells of it."""
    with watching() as watch, program("input()") as it:
        channel = Channel(watch.link)
        channel.follow("it", True, _CORE, it.pid)
        time.sleep(0.3)
        start_ns = time.time_ns()
        watch.process.send_signal(signal.SIGSTOP)
        time.sleep(0.15)
        end_ns = time.time_ns()
        watch.process.send_signal(signal.SIGCONT)
        time.sleep(0.1)
        calm, asked_ns = channel.calm_s(start_ns), time.time_ns()
        delays = channel.seen()["it"]
    # Waiting times from before the threads were followed (other work at the start) are one earlier
    # delay.
    stopped = [each for each in delays if each[2] > 100_000_000 and each[0] + each[1] > start_ns]
    assert len(stopped) == 1
    assert stopped[0][3] > 100_000_000, "nobody had the core meanwhile"
    assert stopped[0][0] <= start_ns + 10_000_000
    assert end_ns <= stopped[0][0] + stopped[0][1]
    assert calm < (asked_ns - end_ns) / 1e9  # without any of the stopped time


def test_a_runaway_does_not_go_before_all_others() -> None:
    """A process that computes without a pause loses real-time scheduling.

    Where real-time scheduling is permitted, the loss is reported once and the process goes on.
    """
    with watching() as watch, program(_TWO_THREADS) as it:
        say(it, "")
        until(lambda: len(threads_of(it.pid)) == 2, 30)
        channel = Channel(watch.link)
        channel.follow("it", False, None, it.pid)
        put_in_real_time([it.pid])
        deadline_s = time.monotonic() + 5
        while (
            any(os.sched_getscheduler(t) & os.SCHED_RR for t in threads_of(it.pid))
            and time.monotonic() < deadline_s
        ):
            # As a session does, for threads that came later.
            channel.follow("it", False, None, None)
            time.sleep(0.05)
        assert {os.sched_getscheduler(t) & ~os.SCHED_RESET_ON_FORK for t in threads_of(it.pid)} == {
            os.SCHED_OTHER
        }
        assert it.poll() is None
        assert channel.seen()["it"] is not None
    assert channel.demoted == ["it"]


def test_sessions_have_delays_of_their_own_processes_alone() -> None:
    """A watch serves many sessions, also after the last of earlier ones has ended.

    A process of another session that has the core is no part of one's own.
    """
    with watching() as watch, program(_TWO_THREADS) as it, program(_TWO_THREADS) as other:
        for process in (it, other):
            os.sched_setaffinity(process.pid, {_CORE})
        first = Channel(watch.link)
        first.follow("it", True, _CORE, it.pid)
        assert first.seen().keys() == {"it"}
        channels = {"it": Channel(watch.link), "other": Channel(watch.link)}
        channels["it"].follow("it", True, _CORE, it.pid)
        channels["other"].follow("other", True, _CORE, other.pid)
        for process in (it, other):
            say(process, "")
        time.sleep(0.6)
        found = {name: channel.seen() for name, channel in channels.items()}
    for name, delays in found.items():
        assert delays.keys() == {name}
        assert sum(delay for _, _, delay, _ in delays[name]) > 150_000_000
