"""Memory and process limits of a sandbox's students by control groups, version 1 or 2, where these can be made.

A sandbox's group has its number in its name, so that what a killed grader left behind is taken over by the next.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from confine.machine import read_bytes_of

#: Limit of all of a sandbox's student processes together.
MEMORY_BYTES = 2 * 1024**3
PROCESSES = 256

_REMOVAL_S = 2.0
#: Moves the shell into each group that is named before `--`, then becomes the command.
_ENTER = 'while [ "$1" != -- ]; do echo $$ > "$1/cgroup.procs" || exit 125; shift; done; shift; exec "$@"'


#: Files of the memory controller by version: its limit, that of swap (in version 1 of both together), what is taken,
#: and how often it killed.
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
    """Folders in which a sandbox's group can be made.

    `memory` and `processes` are its parents in these hierarchies, the same one in version 2; `cpu` is that in the
    hierarchy that sums up CPU time, where one does that and shares out nothing.
    """

    memory: str
    processes: str
    cpu: str | None
    version: int


class SandboxCgroup:
    """The control group of a sandbox's student processes.

    Its `label` tells it from others of this user.
    """

    def __init__(self, parents: CgroupParents, label: str) -> None:
        self._version = parents.version
        name = f"confine-{os.getuid()}-{label}"
        self._memory, self._processes = Path(parents.memory) / name, Path(parents.processes) / name
        self._limit, self._swap, self._taken, self._kills = (
            self._memory / n for n in _MEMORY_FILES[parents.version]
        )
        self._cpu = Path(parents.cpu) / name if parents.cpu is not None else None

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
        with suppress(OSError):
            self._swap.write_text(str(memory_bytes if self._version == 1 else 0))

    def entering(self, command: Sequence[str]) -> list[str]:
        """Return the command line that runs `command` within the group."""
        return ["sh", "-c", _ENTER, "sh", *map(str, self._folders()), "--", *command]

    def exceeded(self) -> dict[str, int]:
        """Return how often each limit was hit: {"memory": kills for want of memory, "processes": refused forks}."""
        return {
            "memory": _counter(self._kills, "oom_kill"),
            "processes": _counter(self._processes / "pids.events", "max"),
        }

    def memory_bytes(self) -> int:
        """Return the memory that the group takes, 0 where that cannot be read."""
        with suppress(OSError, ValueError):
            return int(read_bytes_of(str(self._taken)))
        return 0

    def cpu_ns(self) -> int | None:
        """Return the CPU time of all that ever was in the group, in ns; None where that is not summed up."""
        with suppress(OSError, ValueError):
            if self._version == 2:
                return _counter(self._memory / "cpu.stat", "usage_usec") * 1000
            if self._cpu is not None:
                return int((self._cpu / "cpuacct.usage").read_text())
        return None

    def remove(self) -> None:
        """Kill what is left in the group, and remove it; returns after a short while if it will not go."""
        end_s = time.monotonic() + _REMOVAL_S
        while any(folder.exists() for folder in self._folders()):
            for folder in self._folders():
                with suppress(OSError):
                    for word in (folder / "cgroup.procs").read_text().split():
                        with suppress(ProcessLookupError):
                            os.kill(int(word), 9)
                with suppress(OSError):
                    folder.rmdir()
            if time.monotonic() > end_s:
                return
            time.sleep(0.002)

    def _folders(self) -> list[Path]:
        return [
            folder
            for folder in dict.fromkeys((self._memory, self._processes, self._cpu))
            if folder is not None
        ]


def _counter(file: Path, name: str) -> int:
    with suppress(OSError):
        found = re.search(rf"^{name} (\d+)$", read_bytes_of(str(file)).decode(), re.MULTILINE)
        return int(found[1]) if found else 0
    return 0


def cgroup_parents() -> list[CgroupParents]:
    """Return the places where groups might be made here, the likeliest first; none is tried."""
    mounts = _mounted_hierarchies()
    own = _own_groups()
    parents = []
    if "memory" in mounts and "pids" in mounts:
        memory, pids = (_within(mounts[name], own.get(name, "/")) for name in ("memory", "pids"))
        # Where the same hierarchy shares out CPU time, a group in it would change how all threads are scheduled.
        apart = "cpuacct" in mounts and mounts["cpuacct"] != mounts.get("cpu")
        cpu = _within(mounts["cpuacct"], own.get("cpuacct", "/")) if apart else None
        parents.append(
            CgroupParents(
                memory, pids, cpu if cpu is not None and os.access(cpu, os.W_OK) else None, 1
            )
        )
    if "" in mounts:
        root = mounts[""]
        parents += [
            CgroupParents(folder, folder, folder, 2)
            for folder in (root, _within(root, own.get("", "/")))
        ]
    return list(
        dict.fromkeys(
            p for p in parents if os.access(p.memory, os.W_OK) and os.access(p.processes, os.W_OK)
        )
    )


def _within(mount: str, group: str) -> str:
    folder = Path(mount) / group.strip("/")
    return str(folder) if folder.is_dir() else mount


def _mounted_hierarchies() -> Mapping[str, str]:
    """Return controller -> mount point; the hierarchy of version 2 has the name ""."""
    found: dict[str, str] = {}
    with suppress(OSError):
        for line in Path("/proc/self/mountinfo").read_text().splitlines():
            before, _, after = line.partition(" - ")
            kind, _, options = after.split(" ", 2)
            for name in {"cgroup2": [""], "cgroup": options.split(",")}.get(kind, []):
                found.setdefault(name, before.split()[4])
    return found


def _own_groups() -> Mapping[str, str]:
    """Return controller -> path of this process's group; version 2 has the name ""."""
    with suppress(OSError):
        lines = [line.split(":", 2) for line in Path("/proc/self/cgroup").read_text().splitlines()]
        return {name: path for _, controllers, path in lines for name in controllers.split(",")}
    return {}
