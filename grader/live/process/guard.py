"""Watches the memory, processes and files of a session's student processes, and ends those that take too much.

Where control groups can be made, the kernel limits memory and processes, and the guard notes it; elsewhere it sums up.
Memory beyond the limit ends the whole program either way: the kernel may have killed only a child, and the session
would wait for the rest in vain. Disk is limited by the size of the file systems that the processes may write to.
"""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from confine.cgroup import MEMORY_BYTES, PROCESSES, SandboxCgroup
from confine.machine import NetworkMemory, available_share, processes_of_user, tasks_of
from grader.live.process.process import RunningProcess
from grader.live.process.waiting import looked_for

_PERIOD_S = 0.1
#: Share of the limit on memory from which the guard notes the memory of each process.
_SHORT = 0.25
#: Distance to the limit on processes at which the limit has refused new ones.
_NEARLY = 8
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
#: Without file systems of a size of their own: bytes, files and depth of folders that the processes may write.
_MAX_WRITTEN_BYTES = 512 * 1024 * 1024
_MAX_WRITTEN_FILES = 40_000
_MAX_WRITTEN_DEPTH = 100
_LOOKS_PER_WALK = 5
#: Share of the disk's initially free space below which all processes are ended: open files without a name are in no
#: folder.
_LEAST_FREE = 0.5
#: Most bytes in the sockets of a session.
_MAX_NETWORK_BYTES = 128 * 1024 * 1024
#: Share of the machine's memory that must stay available, if no control group limits memory.
_LEAST_AVAILABLE = 0.04


class Guard:
    """The watch over a session's student processes.

    They may change `areas`. If these are `sized`, each is a file system of a size of its own, and the network is the
    session's own. `user` is their user id, if they have one of their own. `on_problem` is called with disturbances that
    no student's process has surely caused.
    """

    def __init__(
        self,
        students: Callable[[], list[RunningProcess]],
        group: SandboxCgroup | None,
        areas: Mapping[str, Path],
        *,
        sized: bool,
        user: int | None,
        on_problem: Callable[[str], None],
    ) -> None:
        self._students = students
        self._group = group
        self._areas = areas
        self._sized = sized
        self._user = user
        self._on_problem = on_problem
        #: The sockets of the students, None if these cannot be told from others.
        self._network: NetworkMemory | None = None
        if sized:
            self._network = NetworkMemory()
        elif user is not None:
            self._network = NetworkMemory(user)
        self._noted = {"memory": 0, "processes": 0}
        #: Memory of each process when it was last noted, in bytes; the kernel may have killed the largest since.
        self._held: dict[RunningProcess, int] = {}
        self._looks = 0
        #: Free space of the areas' disk at the first look, in bytes.
        self._free_bytes: int | None = None

    async def watch(self) -> None:
        """Look again and again until cancelled."""
        while True:
            await looked_for(self._is_notable, _PERIOD_S)
            await self.look()

    def _is_notable(self) -> bool:
        """Return whether a look may find anything, without a look at single processes."""
        group = self._group
        if group is None or not self._sized:
            return True
        if group.exceeded() != self._noted:
            return True
        if _is_short(group):
            return True
        if self._network_bytes() > _MAX_NETWORK_BYTES:
            return True
        return any(map(_is_full, self._areas.values()))

    async def look(self) -> None:
        """Look once, and end the programs that exceed a limit."""
        if self._group is not None:
            await self._note_exceeded(self._group)
        else:
            await self._sum_up()
            # No sum shows all of their memory.
            if available_share() < _LEAST_AVAILABLE:
                await self._spare("machine ran out of memory")
        if self._network_bytes() > _MAX_NETWORK_BYTES:
            await self._end_all("memory")
        if self._sized:
            self._note_full_areas()
        elif self._looks % _LOOKS_PER_WALK == 0:
            await self._walk_areas()
        self._looks += 1

    def _network_bytes(self) -> int:
        """Return the bytes in the sockets of the students; 0 if these cannot be told from others."""
        if self._network is None:
            return 0
        return self._network.bytes()

    async def _end_all(self, limit: str | None) -> None:
        for process in self._students():
            await process.kill(limit=limit)

    async def _spare(self, what: str) -> None:
        """End the student's processes because the machine runs out of something, by these or by others."""
        if any(p.alive for p in self._students()):
            self._on_problem(f"the {what} while it was recorded")
            await self._end_all(None)

    async def _note_exceeded(self, group: SandboxCgroup) -> None:
        for limit, times in group.exceeded().items():
            if times > self._noted[limit]:
                self._noted[limit] = times
                for process in self._to_blame(limit):
                    process.run.limit = process.run.limit or limit
                    if limit == "memory":
                        await process.kill(limit=limit)
        if _is_short(group):
            alive = [process for process in self._students() if process.alive]
            self._held = {process: _taken_by(process).memory_bytes for process in alive}

    def _to_blame(self, limit: str) -> list[RunningProcess]:
        """Return the processes killed for their memory, else the one that takes, or lately took, most."""
        students = self._students()
        if limit == "memory":
            killed = [process for process in students if _was_killed(process)]
            if killed:
                return killed
        alive = [process for process in students if process.alive]
        if not alive:
            return students[-1:]
        return [max(alive, key=self._most_memory)]

    def _most_memory(self, process: RunningProcess) -> int:
        """Return the larger of a process's present and noted memory, in bytes."""
        return max(self._held.get(process, 0), _taken_by(process).memory_bytes)

    async def _sum_up(self) -> None:
        """Sum up the processes and the memory, and end the programs that exceed a limit."""
        alive = [process for process in self._students() if process.alive]
        taken = {process: _taken_by(process) for process in alive}
        orphans = self._orphans(alive)
        left = _taken(orphans)
        for process, its in taken.items():
            if its.tasks > PROCESSES:
                await process.kill(limit="processes")
            elif its.tasks + left.tasks > PROCESSES - _NEARLY:
                process.run.limit = process.run.limit or "processes"
        if left.tasks > PROCESSES - _NEARLY:
            self._end_orphans(orphans, "processes")
        if left.memory_bytes + sum(its.memory_bytes for its in taken.values()) > MEMORY_BYTES:
            await self._limit_memory(alive, orphans)

    async def _limit_memory(self, alive: Iterable[RunningProcess], orphans: list[int]) -> None:
        """End the largest program, or the orphans, if all together take too much memory without shared pages.

        The first sum counts shared pages of forked processes once for each; this one takes longer.
        """
        own = {process: _own_memory(process.descendants()) for process in alive}
        left = _own_memory(orphans)
        if sum(own.values()) + left <= MEMORY_BYTES:
            return
        largest = max(own, key=lambda process: own[process], default=None)
        if largest is not None and own[largest] >= left:
            await largest.kill(limit="memory")
        else:
            self._end_orphans(orphans, "memory")

    def _orphans(self, alive: Iterable[RunningProcess]) -> list[int]:
        """Return the processes of the students' user that are below none of their programs any more.

        Programs with process ids of their own have no orphans.
        """
        if self._sized or self._user is None:
            return []
        orphans = processes_of_user(self._user)
        for process in alive:
            orphans.difference_update(process.descendants())
        return sorted(orphans)

    def _end_orphans(self, orphans: Iterable[int], limit: str) -> None:
        for process in self._to_blame(limit):
            process.run.limit = process.run.limit or limit
        for pid in orphans:
            with suppress(OSError):
                # One may have ended since the count, and a process of another user have its id.
                if Path(f"/proc/{pid}").stat().st_uid == self._user:
                    os.kill(pid, signal.SIGKILL)

    def _note_full_areas(self) -> None:
        for folder in self._areas.values():
            full = _full(folder)
            if full is not None:
                self._note_for_all(full)

    def _note_for_all(self, limit: str) -> None:
        """Note a limit for all programs that run and have hit none."""
        for process in self._students():
            if process.alive:
                process.run.limit = process.run.limit or limit

    async def _walk_areas(self) -> None:
        size, count = await asyncio.to_thread(_written, list(self._areas.values()))
        if size > _MAX_WRITTEN_BYTES:
            await self._end_all("disk")
        elif count > _MAX_WRITTEN_FILES:
            await self._end_all("files")
        free_bytes = min(map(_free_bytes, self._areas.values()))
        if self._free_bytes is None:
            self._free_bytes = free_bytes
        if free_bytes < _LEAST_FREE * self._free_bytes:
            await self._spare("disk ran out of space")


class _Taken(NamedTuple):
    """Memory in bytes and the number of threads of some processes."""

    memory_bytes: int
    tasks: int


def _taken_by(process: RunningProcess) -> _Taken:
    return _taken(process.descendants())


def _was_killed(process: RunningProcess) -> bool:
    """Return whether a program was killed, and not by the guard."""
    if process.alive or process.run.limit is not None:
        return False
    return process.run.exit_status in (137, -9)


def _is_short(group: SandboxCgroup) -> bool:
    return group.memory_bytes() > _SHORT * MEMORY_BYTES


def _is_full(folder: Path) -> bool:
    return _full(folder) is not None


def _full(folder: Path) -> str | None:
    """Return the exhausted resource of a file system, "disk" or "files"; None if it has room, or cannot be read."""
    try:
        space = os.statvfs(folder)
    except OSError:
        return None
    if space.f_bavail == 0:
        return "disk"
    counts_files = space.f_files > 0
    if counts_files and space.f_favail == 0:
        return "files"
    return None


def _free_bytes(folder: Path) -> int:
    space = os.statvfs(folder)
    return space.f_bavail * space.f_frsize


def _taken(pids: Iterable[int]) -> _Taken:
    """Return the memory and the threads of processes."""
    memory = tasks = 0
    for pid in pids:
        with suppress(OSError, ValueError, IndexError):
            tasks += len(tasks_of(pid))
            memory += int(_reported_memory(pid, "statm").split()[1]) * _PAGE_BYTES
    return _Taken(memory, tasks)


def _own_memory(pids: Iterable[int]) -> int:
    """Return the memory of processes in bytes, shared pages divided among them."""
    total = 0
    for pid in pids:
        with suppress(OSError, ValueError, IndexError):
            shared = _reported_memory(pid, "smaps_rollup")
            if "Pss:" in shared:
                total += int(shared.split("Pss:", 1)[1].split()[0]) * 1024
            else:  # Its share of shared pages may not be read.
                resident, shared_pages = map(int, _reported_memory(pid, "statm").split()[1:3])
                total += (resident - shared_pages) * _PAGE_BYTES
    return total


def _reported_memory(pid: int, file: str) -> str:
    """Return the text of a file in /proc about a process; of another of its threads, if the first has ended."""
    text = ""
    for folder in (f"/proc/{pid}", *(f"/proc/{pid}/task/{task}" for task in tasks_of(pid))):
        with suppress(OSError):
            text = Path(folder, file).read_text()
            if not text.startswith("0 "):
                return text
    return text


def _written(folders: list[Path]) -> tuple[int, int]:
    """Return the space in bytes and the number of files below some folders, counted up to the limit.

    Folders that cannot be counted, because they are too deep or closed to this user, count as over the limit.
    """
    size = count = 0
    queue = [(str(folder), 0) for folder in folders]
    while queue:
        folder, depth = queue.pop()
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    count += 1
                    if entry.is_dir(follow_symlinks=False):
                        queue.append((entry.path, depth + 1))
                    else:
                        size += entry.stat(follow_symlinks=False).st_blocks * 512
                    if size > _MAX_WRITTEN_BYTES or count > _MAX_WRITTEN_FILES:
                        return size, count
        except (FileNotFoundError, NotADirectoryError):  # it is gone by now
            continue
        except OSError:
            return size, _MAX_WRITTEN_FILES + 1
        if depth > _MAX_WRITTEN_DEPTH:
            return size, _MAX_WRITTEN_FILES + 1
    return size, count
