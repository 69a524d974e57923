"""Watches what a session's student processes take, and ends those that take too much.

Where control groups can be made, the kernel limits memory and processes, and this notes it; elsewhere it sums up.
Memory beyond the limit ends the whole program either way: the kernel may have killed a child of it only, and the rest
would be waited for in vain. Disk is limited by the size of the file systems that the processes may write to.
"""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from confine.cgroup import MEMORY_BYTES, PROCESSES, SandboxCgroup
from confine.machine import available_share, network_bytes, processes_of_user, tasks_of
from grader.live.process.process import RunningProcess

_PERIOD_S = 0.1
#: Share of the limit on memory from which it is getting short.
_SHORT = 0.25
#: A limit on processes refuses new ones; so near to it, it has.
_NEARLY = 8
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
#: Where there are no file systems of a size of their own: what the processes may write, in bytes and in files.
_MAX_WRITTEN_BYTES = 512 * 1024 * 1024
_MAX_WRITTEN_FILES = 40_000
_MAX_WRITTEN_DEPTH = 100
_LOOKS_PER_WALK = 5
#: Of the disk's space that was free when the session began, the share below which nothing more may be written: files
#: that are open and have no name any more are in no folder.
_LEAST_FREE = 0.5
#: What may lie in the sockets of a session.
_MAX_NETWORK_BYTES = 128 * 1024 * 1024
#: Share of the machine's memory below which nothing more may be taken, where the kernel limits nobody.
_LEAST_AVAILABLE = 0.04


class Guard:
    """The watch over a session's student processes.

    They may change `areas`, each a file system of a size of its own, and the network the session's own, if these are
    `sized`. `user` is their user id, where they have one of their own. `on_problem` receives what disturbs the
    session and cannot be laid at anybody's door.
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
        self._students, self._group, self._areas, self._sized = students, group, areas, sized
        self._user, self._on_problem = user, on_problem
        self._noted = {"memory": 0, "processes": 0}
        #: Where the kernel kills: what each took when memory was last getting short.
        self._held: dict[RunningProcess, int] = {}
        self._looks = 0
        #: Free space of the areas' disk when it was first looked at, in bytes.
        self._free_bytes: int | None = None

    async def watch(self) -> None:
        """Look again and again until cancelled."""
        while True:
            await asyncio.sleep(_PERIOD_S)
            await self.look()

    async def look(self) -> None:
        """Look once: note and end what exceeds a limit."""
        if self._group is not None:
            await self._note_exceeded(self._group)
        else:
            await self._sum_up()
            # No sum shows all that they hold.
            if available_share() < _LEAST_AVAILABLE:
                await self._spare("machine ran out of memory")
        own = self._sized or self._user is not None
        if own and network_bytes(None if self._sized else self._user) > _MAX_NETWORK_BYTES:
            await self._end_all("memory")
        if self._sized:
            self._note_full_areas()
        elif self._looks % _LOOKS_PER_WALK == 0:
            await self._walk_areas()
        self._looks += 1

    async def _end_all(self, limit: str | None) -> None:
        for process in self._students():
            await process.kill(limit=limit)

    async def _spare(self, what: str) -> None:
        """End the student's processes where the machine runs out of something, whoever has taken it."""
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
        if group.memory_bytes() > _SHORT * MEMORY_BYTES:
            self._held = {p: _taken(p.descendants())[0] for p in self._students() if p.alive}

    def _to_blame(self, limit: str) -> list[RunningProcess]:
        """Return the process that a signal has ended, else the one that takes, or lately took, most."""
        students = self._students()
        killed = [
            p
            for p in students
            if not p.alive and p.run.exit_status in (137, -9) and p.run.limit is None
        ]
        alive = [p for p in students if p.alive]
        largest = max(
            alive, key=lambda p: max(self._held.get(p, 0), _taken(p.descendants())[0]), default=None
        )
        return (killed if limit == "memory" else []) or (
            [largest] if largest is not None else students[-1:]
        )

    async def _sum_up(self) -> None:
        alive = [p for p in self._students() if p.alive]
        taken = {p: _taken(p.descendants()) for p in alive}
        orphans = self._orphans(alive)
        left_memory, left_tasks = _taken(orphans)
        for process, (_, tasks) in taken.items():
            if tasks > PROCESSES:
                await process.kill(limit="processes")
            elif tasks + left_tasks > PROCESSES - _NEARLY:
                process.run.limit = process.run.limit or "processes"
        if left_tasks > PROCESSES - _NEARLY:
            self._end_orphans(orphans, "processes")
        if sum(memory for memory, _ in taken.values()) + left_memory > MEMORY_BYTES:
            # What forked processes share is in that sum once for each; a truer one takes longer.
            own = {p: _own_memory(p.descendants()) for p in alive}
            left = _own_memory(orphans)
            if sum(own.values()) + left > MEMORY_BYTES:
                largest = max(alive, key=lambda p: own[p], default=None)
                if largest is not None and own[largest] >= left:
                    await largest.kill(limit="memory")
                else:
                    self._end_orphans(orphans, "memory")

    def _orphans(self, alive: Iterable[RunningProcess]) -> list[int]:
        """Return the processes of the students' user that are below none of their programs any more.

        Where programs have process ids of their own, none gets away from below them.
        """
        if self._sized or self._user is None:
            return []
        return sorted(processes_of_user(self._user).difference(*(p.descendants() for p in alive)))

    def _end_orphans(self, orphans: Iterable[int], limit: str) -> None:
        for process in self._to_blame(limit):
            process.run.limit = process.run.limit or limit
        for pid in orphans:
            with suppress(OSError):
                # Since they were counted, one may have ended, and somebody else have its process id.
                if Path(f"/proc/{pid}").stat().st_uid == self._user:
                    os.kill(pid, signal.SIGKILL)

    def _note_full_areas(self) -> None:
        for folder in self._areas.values():
            with suppress(OSError):
                space = os.statvfs(folder)
                full = (
                    "disk"
                    if space.f_bavail == 0
                    else "files"
                    if space.f_favail == 0 < space.f_files
                    else None
                )
                for process in self._students():
                    if full is not None and process.alive:
                        process.run.limit = process.run.limit or full

    async def _walk_areas(self) -> None:
        size, count = await asyncio.to_thread(_written, list(self._areas.values()))
        limit = (
            "disk" if size > _MAX_WRITTEN_BYTES else "files" if count > _MAX_WRITTEN_FILES else None
        )
        if limit is not None:
            await self._end_all(limit)
        free_bytes = min(map(_free_bytes, self._areas.values()))
        self._free_bytes = free_bytes if self._free_bytes is None else self._free_bytes
        if free_bytes < _LEAST_FREE * self._free_bytes:
            await self._spare("disk ran out of space")


def _free_bytes(folder: Path) -> int:
    space = os.statvfs(folder)
    return space.f_bavail * space.f_frsize


def _taken(pids: Iterable[int]) -> tuple[int, int]:
    """Return (memory in bytes, number of threads) of processes."""
    memory = tasks = 0
    for pid in pids:
        with suppress(OSError, ValueError, IndexError):
            tasks += len(tasks_of(pid))
            memory += int(_reported_memory(pid, "statm").split()[1]) * _PAGE_BYTES
    return memory, tasks


def _own_memory(pids: Iterable[int]) -> int:
    """Return the memory of processes in bytes, shared pages divided among them."""
    total = 0
    for pid in pids:
        with suppress(OSError, ValueError, IndexError):
            # Where its share of shared pages may not be read, without these.
            if "Pss:" in (shared := _reported_memory(pid, "smaps_rollup")):
                total += int(shared.split("Pss:", 1)[1].split()[0]) * 1024
            else:
                resident, shared_pages = map(int, _reported_memory(pid, "statm").split()[1:3])
                total += (resident - shared_pages) * _PAGE_BYTES
    return total


def _reported_memory(pid: int, file: str) -> str:
    """Return what a file in /proc says of a process: by another of its threads, where the first has ended."""
    text = ""
    for folder in (f"/proc/{pid}", *(f"/proc/{pid}/task/{task}" for task in tasks_of(pid))):
        with suppress(OSError):
            text = Path(folder, file).read_text()
            if not text.startswith("0 "):
                return text
    return text


def _written(folders: list[Path]) -> tuple[int, int]:
    """Return the space in bytes and the number of files below some folders, counted up to the limit.

    What cannot be counted, since it is too deep or closed to us, is over the limit.
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
