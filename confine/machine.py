"""The kernel's counters of the machine, of its memory, and of its processes and threads."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_TICK_NS = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
#: Memory of all sockets of the machine below which single ones are not looked at, in pages.
_NOTABLE_PAGES = 16 * 1024
_TABLES = ("udp", "udp6", "tcp", "tcp6")
_READ_BYTES = 64 * 1024
#: Files with the times of the cores, with the waits for them, and with the newest process id of the reader's namespace.
CORES, WAITS, LOADS = "/proc/stat", "/proc/pressure/cpu", "/proc/loadavg"
#: A core and its times in the first of these files.
_CORE = re.compile(rb"^cpu(\d+) (.*)", re.MULTILINE)
#: Pages of all sockets of a kind, in a network's sums.
_PAGES = re.compile(rb"^(?:UDP|TCP): .*\bmem (\d+)", re.MULTILINE)
#: Most processes in a tree; a fork bomb may have more.
_MOST_PROCESSES = 1000
#: Longest wait for an idle machine, in s, and the largest share of time that its processes wait for a core.
_MOST_WAIT_S, _CALM_SHARE = 10.0, 0.2
#: Number of readings of both clocks, and the distance of two readings that is good enough.
_READINGS, _AT_ONCE_NS = 5, 50_000


class CounterFile:
    """A file of the kernel's counters. It stays open, because opening takes longer than reading.

    A failed reading closes it, for example after its control group was removed.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._descriptor = -1

    def read(self) -> bytes:
        """Return the text of the file; raises `OSError` if there is none."""
        if self._descriptor < 0:
            self._descriptor = os.open(self._path, os.O_RDONLY)
        try:
            return os.pread(self._descriptor, _READ_BYTES, 0)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file; the next reading opens it again."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def waited_us() -> int | None:
    """Return the time since boot that some process waited for a core (PSI), in µs; None if the system does not tell."""
    file = CounterFile(WAITS)
    try:
        return waited_us_in(file)
    finally:
        file.close()


def waited_us_in(file: CounterFile) -> int | None:
    """Return the time of `waited_us` from an open file."""
    with suppress(OSError, ValueError, IndexError):
        return int(file.read().split(b"total=", 1)[1].split()[0])
    return None


def wait_for_calm(
    most_s: float = _MOST_WAIT_S,
    period_s: float = 1.0,
    waited: Callable[[], int | None] = waited_us,
) -> bool:
    """Wait until few processes of this machine wait for its cores; False if that takes too long."""
    end_s = time.monotonic() + most_s
    before_us = waited()
    while before_us is not None and time.monotonic() < end_s:
        time.sleep(period_s)
        after_us = waited() or 0
        if after_us - before_us < _CALM_SHARE * period_s * 1e6:
            return True
        before_us = waited()
    return before_us is None


def read_clocks(
    system: Callable[[], int] = time.time_ns, monotonic: Callable[[], int] = time.monotonic_ns
) -> tuple[int, int]:
    """Return the system clock's time, and its lead over the monotonic clock, in ns.

    If this process loses its core between two readings, the clock must not seem to have been set: the reading that
    took least counts.
    """
    readings = []
    for _ in range(_READINGS):
        before_ns = monotonic()
        now_ns = system()
        after_ns = monotonic()
        took_ns = after_ns - before_ns
        lead_ns = now_ns - (before_ns + after_ns) // 2
        readings.append((took_ns, now_ns, lead_ns))
        if took_ns <= _AT_ONCE_NS:
            break
    _, now_ns, lead_ns = min(readings)
    return now_ns, lead_ns


class CoreTimes(NamedTuple):
    """Times of the machine's cores since boot, in ns.

    `idle_ns` is the idle time of each core: waiting for a disk is idle too. `stolen_ns` is the time taken by the host of
    a virtual machine from all of its cores.
    """

    idle_ns: dict[str, int]
    stolen_ns: int


def core_times_in(file: CounterFile) -> CoreTimes:
    """Return the times in /proc/stat (proc(5): 3 idle, 4 waiting for a disk, 7 stolen), none if it cannot be read."""
    idle_ns: dict[str, int] = {}
    all_stolen_ns = 0
    with suppress(OSError, ValueError, IndexError):
        for core, text in _CORE.findall(file.read()):
            ticks = text.split()
            idle_ns[core.decode()] = (int(ticks[3]) + int(ticks[4])) * _TICK_NS
            all_stolen_ns += int(ticks[7]) * _TICK_NS
    return CoreTimes(idle_ns, all_stolen_ns)


def _core_times() -> CoreTimes:
    file = CounterFile(CORES)
    try:
        return core_times_in(file)
    finally:
        file.close()


def stolen_ns() -> int:
    """Return the time taken by the host of a virtual machine from its cores since boot, in ns."""
    return _core_times().stolen_ns


def cpu_quota(
    mounted: Path = Path("/sys/fs/cgroup"), membership: Path = Path("/proc/self/cgroup")
) -> float | None:
    """Return the limit of control groups on this process's CPU time, in cores, e.g. 2.0; None without a limit.

    Parameters
    ----------
    mounted
        Folder with the hierarchy of version 2, or with one folder for each of version 1.
    membership
        File with a line for each hierarchy, e.g. "0::/system.slice/runner.service" or "4:cpu,cpuacct:/docker/0a1b".

    References
    ----------
    cgroups(7); Linux, Documentation/admin-guide/cgroup-v2.rst (`cpu.max`) and scheduler/sched-bwc.rst.
    """
    found: list[float] = []
    try:
        lines = membership.read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    for line in lines:
        _, controllers, path = line.split(":", 2)
        top = mounted
        if controllers:
            if "cpu" not in controllers.split(","):
                continue
            top = mounted / controllers
        group = top / path.lstrip("/")
        while group.is_relative_to(top):
            found += _quotas_of(group)
            group = group.parent
    return min(found, default=None)


def _quotas_of(group: Path) -> list[float]:
    """Return the limit of a control group as a number of cores, or nothing."""
    try:
        if (group / "cpu.max").exists():
            quota, period = (group / "cpu.max").read_text(encoding="ascii").split()
        else:
            quota = (group / "cpu.cfs_quota_us").read_text(encoding="ascii")
            period = (group / "cpu.cfs_period_us").read_text(encoding="ascii")
        cores = int(quota) / int(period)
    except (OSError, ValueError):  # "max" stands for no limit.
        return []
    if cores <= 0:  # In version 1, -1 stands for no limit.
        return []
    return [cores]


def idle_s() -> float:
    """Return the idle time of the machine's cores since boot, in s of one core, on average."""
    idle_ns = _core_times().idle_ns
    return sum(idle_ns.values()) / 1e9 / max(1, len(idle_ns))


class NetworkMemory:
    """The bytes queued in the sockets of this process's network, or in the sockets of one user there.

    All networks of a machine share the memory for these bytes, and no control group of version 1 counts it.
    """

    def __init__(self, user: int | None = None) -> None:
        self._user = user
        self._sums = CounterFile("/proc/net/sockstat")
        #: The last sums that were not worth a look at single sockets.
        self._calm_sums = b""

    def bytes(self) -> int:
        """Return the present bytes."""
        try:
            sums = self._sums.read()
        except OSError:
            return self._queued()
        # Mostly, the sums are the same as before.
        if sums == self._calm_sums:
            return 0
        if sum(map(int, _PAGES.findall(sums))) < _NOTABLE_PAGES:
            self._calm_sums = sums
            return 0
        return self._queued()

    def _queued(self) -> int:
        """Return the bytes in all sockets, one after another."""
        return sum(_queued(Path("/proc/net") / name, self._user) for name in _TABLES)


def _queued(table: Path, user: int | None) -> int:
    total = 0
    with (
        suppress(OSError, ValueError, IndexError),
        table.open(encoding="ascii", errors="replace") as lines,
    ):
        next(lines, None)
        for line in lines:
            words = line.split()
            if user is None or int(words[7]) == user:
                sent, _, received = words[4].partition(":")
                total += int(sent, 16) + int(received, 16)
    return total


def available_share() -> float:
    """Return the available share of the machine's memory, 1 if the system does not tell."""
    with suppress(OSError, ValueError, ZeroDivisionError):
        text = Path("/proc/meminfo").read_text()
        amounts = {
            name: int(amount)
            for name, amount in re.findall(r"^(\w+): +(\d+) kB", text, re.MULTILINE)
        }
        return amounts.get("MemAvailable", amounts["MemTotal"]) / amounts["MemTotal"]
    return 1.0


def children_of(pid: int) -> list[int]:
    """Return the process ids of the children of all of a process's threads."""
    return _children_of_tasks(pid, tasks_of(pid))


def _children_of_tasks(pid: int, tasks: Iterable[str]) -> list[int]:
    found: list[int] = []
    for task in tasks:
        with suppress(OSError, ValueError):
            found += map(int, read_bytes_of(f"/proc/{pid}/task/{task}/children").split())
    return found


def descendants_of(pid: int) -> list[int]:
    """Return a process id and the ids of all descendants of the process."""
    return list(tasks_below(pid))


def tasks_below(pid: int) -> dict[int, list[str]]:
    """Return the thread ids of a process and of all its descendants, by process id."""
    found: dict[int, list[str]] = {}
    queue = [pid]
    while queue and len(found) < _MOST_PROCESSES:
        current = queue.pop()
        found[current] = tasks_of(current)
        queue += _children_of_tasks(current, found[current])
    return found


def last_task_in(file: CounterFile) -> bytes:
    """Return the id of the newest process or thread in this process's namespace, from the open file `LOADS`.

    While it is the same, none has begun, in namespaces below this one either.

    References
    ----------
    The last field of `loadavg` in proc(5).
    """
    return file.read().rpartition(b" ")[2]


def cpu_of_children_ns(pid: int) -> int:
    """Return the CPU time of a process's ended children, in ns."""
    with suppress(OSError, ValueError, IndexError):
        words = read_bytes_of(f"/proc/{pid}/stat").rpartition(b")")[2].split()
        return sum(map(int, words[13:15])) * _TICK_NS
    return 0


def tasks_of(pid: int) -> list[str]:
    """Return the thread ids of a process, none if it has ended."""
    with suppress(OSError):
        return os.listdir(f"/proc/{pid}/task")  # noqa: PTH208 - names alone, which is faster
    return []


def is_in_real_time(tid: int) -> bool:
    """Return whether a thread is scheduled in real time."""
    with suppress(OSError):
        return os.sched_getscheduler(tid) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR
    return False


def processes_of_user(uid: int) -> set[int]:
    """Return the process ids of a user."""
    found = set()
    with os.scandir("/proc") as entries:
        for entry in entries:
            with suppress(OSError):
                if entry.name.isdecimal() and entry.stat().st_uid == uid:
                    found.add(int(entry.name))
    return found


def read_bytes_of(file: str) -> bytes:
    """Read a file of /proc; as a `Path` it would take five times as long, twice a second."""
    descriptor = os.open(file, os.O_RDONLY)
    try:
        return os.read(descriptor, _READ_BYTES)
    finally:
        os.close(descriptor)
