"""Limits on the memory and the processes of a sandbox by control groups, version 1 or 2, where these can be made.

The name of a group holds the number of its sandbox: the next sandbox of that number takes over a stale group.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from confine.machine import CounterFile

#: Limits on all confined processes of a sandbox together.
MEMORY_BYTES = 2 * 1024**3
PROCESSES = 256

_REMOVAL_S = 2.0
#: Moves the shell into each group that is named before `--`, then becomes the command.
_ENTER = 'while [ "$1" != -- ]; do echo $$ > "$1/cgroup.procs" || exit 125; shift; done; shift; exec "$@"'


#: Files of the memory controller by version: limit, limit on swap (in version 1 on both together), used memory, kills.
_MEMORY_FILES = {
    1: (
        "memory.limit_in_bytes",
        "memory.memsw.limit_in_bytes",
        "memory.usage_in_bytes",
        "memory.oom_control",
    ),
    2: ("memory.max", "memory.swap.max", "memory.current", "memory.events"),
}


@dataclass(frozen=True)
class CgroupParents:
    """Parent folders of a sandbox's group.

    `memory` and `processes` are its parents in these hierarchies, the same one in version 2. `cpu` is the parent in a
    hierarchy that sums up CPU time and shares out nothing, None if there is no such hierarchy.
    """

    memory: str
    processes: str
    cpu: str | None
    version: int


class SandboxCgroup:
    """The control group of a sandbox's confined processes; its `label` is unique among groups of this user."""

    def __init__(self, parents: CgroupParents, label: str) -> None:
        self._version = parents.version
        name = f"confine-{os.getuid()}-{label}"
        self._memory = Path(parents.memory) / name
        self._processes = Path(parents.processes) / name
        self._cpu: Path | None = None
        self._used_ns: CounterFile | None = None
        if parents.cpu is not None:
            self._cpu = Path(parents.cpu) / name
            self._used_ns = CounterFile(str(self._cpu / "cpuacct.usage"))
        limit, swap, taken, kills = _MEMORY_FILES[parents.version]
        self._limit = self._memory / limit
        self._swap = self._memory / swap
        self._taken = CounterFile(str(self._memory / taken))
        self._kills = _NamedCounter(self._memory / kills, "oom_kill")
        self._used_us = _NamedCounter(self._memory / "cpu.stat", "usage_usec")
        self._refusals = _NamedCounter(self._processes / "pids.events", "max")

    def make(self, memory_bytes: int = MEMORY_BYTES, processes: int = PROCESSES) -> None:
        """Make the group and set its limits, or raise `OSError` if that is not permitted here."""
        self.remove()
        for folder in self._folders():
            folder.mkdir(exist_ok=True)
            if self._version == 2:
                with suppress(OSError):
                    (folder.parent / "cgroup.subtree_control").write_text("+memory +pids")
        (self._processes / "pids.max").write_text(str(processes))
        self._limit.write_text(str(memory_bytes))
        swap_bytes = 0
        if self._version == 1:
            swap_bytes = memory_bytes
        with suppress(OSError):
            self._swap.write_text(str(swap_bytes))

    def entering(self, command: Sequence[str]) -> list[str]:
        """Return the command line that runs `command` within the group."""
        return ["sh", "-c", _ENTER, "sh", *map(str, self._folders()), "--", *command]

    def exceeded(self) -> dict[str, int]:
        """Return the number of hits of each limit: {"memory": kills by the kernel, "processes": refused forks}."""
        return {
            "memory": self._kills.value(),
            "processes": self._refusals.value(),
        }

    def memory_bytes(self) -> int:
        """Return the memory used by the group, 0 if it cannot be read."""
        try:
            return int(self._taken.read())
        except (OSError, ValueError):
            return 0

    def cpu_ns(self) -> int | None:
        """Return the CPU time of all present and past processes of the group, in ns; None if nothing sums it up."""
        if self._version == 2:
            return self._used_us.value() * 1000
        with suppress(OSError, ValueError):
            if self._used_ns is not None:
                return int(self._used_ns.read())
        return None

    def remove(self) -> None:
        """Kill all processes in the group, and remove it; give up after two seconds."""
        self._close_counters()
        end_s = time.monotonic() + _REMOVAL_S
        while any(folder.exists() for folder in self._folders()):
            for folder in self._folders():
                with suppress(OSError):
                    _kill_all(folder)
                with suppress(OSError):
                    folder.rmdir()
            if time.monotonic() > end_s:
                return
            time.sleep(0.002)

    def _close_counters(self) -> None:
        for counter in (self._taken, self._kills, self._refusals, self._used_us):
            counter.close()
        if self._used_ns is not None:
            self._used_ns.close()

    def _folders(self) -> list[Path]:
        folders = [self._memory]
        if self._processes != self._memory:
            folders.append(self._processes)
        if self._cpu is not None and self._cpu not in folders:
            folders.append(self._cpu)
        return folders


def _kill_all(group: Path) -> None:
    """Kill the processes of a group; raises `OSError` if there is no such group."""
    for word in (group / "cgroup.procs").read_text().split():
        with suppress(ProcessLookupError):
            os.kill(int(word), signal.SIGKILL)


class _NamedCounter(CounterFile):
    """A counter from a file with lines such as "oom_kill 2"."""

    def __init__(self, file: Path, name: str) -> None:
        super().__init__(str(file))
        self._name = name.encode()
        self._text = b""
        self._value = 0

    def value(self) -> int:
        """Return the counter, 0 if it is not there."""
        try:
            text = self.read()
        except OSError:
            text = b""
        if text != self._text:
            self._text = text
            words = text.split()
            self._value = 0
            if self._name in words:
                self._value = int(words[words.index(self._name) + 1])
        return self._value


def cgroup_parents() -> list[CgroupParents]:
    """Return the places where groups might be made here, the likeliest first; none is tried."""
    hierarchies = _Hierarchies()
    writable = []
    for parents in [*hierarchies.of_version_1(), *hierarchies.of_version_2()]:
        may_write = os.access(parents.memory, os.W_OK) and os.access(parents.processes, os.W_OK)
        if may_write and parents not in writable:
            writable.append(parents)
    return writable


class _Hierarchies:
    """The mounted hierarchies of control groups, and this process's place in each."""

    def __init__(self) -> None:
        self._mounts = _mounted_hierarchies()
        self._own = _own_groups()

    def of_version_1(self) -> list[CgroupParents]:
        """Return this process's groups, if memory and processes have hierarchies."""
        if "memory" not in self._mounts or "pids" not in self._mounts:
            return []
        return [CgroupParents(self._own_group("memory"), self._own_group("pids"), self._cpu(), 1)]

    def of_version_2(self) -> list[CgroupParents]:
        """Return the root and this process's group, if version 2 is mounted."""
        if "" not in self._mounts:
            return []
        folders = (self._mounts[""], self._own_group(""))
        return [CgroupParents(folder, folder, folder, 2) for folder in folders]

    def _cpu(self) -> str | None:
        """Return this process's group in a hierarchy of version 1 that only sums up CPU time.

        A group in a hierarchy that shares out CPU time would change the scheduling of all threads.
        """
        mount = self._mounts.get("cpuacct")
        if mount is None or mount == self._mounts.get("cpu"):
            return None
        group = self._own_group("cpuacct")
        if not os.access(group, os.W_OK):
            return None
        return group

    def _own_group(self, controller: str) -> str:
        mount = self._mounts[controller]
        folder = Path(mount) / self._own.get(controller, "/").strip("/")
        if not folder.is_dir():  # as in a container that sees only a part of the hierarchy
            return mount
        return str(folder)


def _mounted_hierarchies() -> Mapping[str, str]:
    """Return controller -> mount point; the hierarchy of version 2 has the name ""."""
    found: dict[str, str] = {}
    with suppress(OSError):
        for line in Path("/proc/self/mountinfo").read_text().splitlines():
            before, _, after = line.partition(" - ")
            mount = before.split()[4]
            kind, _, options = after.split(" ", 2)
            if kind == "cgroup2":
                found.setdefault("", mount)
            elif kind == "cgroup":
                for name in options.split(","):
                    found.setdefault(name, mount)
    return found


def _own_groups() -> Mapping[str, str]:
    """Return controller -> path of this process's group; version 2 has the name ""."""
    found = {}
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            for name in controllers.split(","):
                found[name] = path
    return found
