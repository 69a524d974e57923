"""Watches what a session's student processes take, and ends those that take too much.

Where control groups can be made, the kernel limits memory and processes, and this only notes it; elsewhere it
sums up and kills. Disk is limited by the size of the file systems that the processes may write to.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from grader.live.cgroup import MEMORY_BYTES, PROCESSES, CellGroup
from grader.live.process import RunningProcess, descendants_of

_PERIOD_S = 0.1
#: A limit on processes refuses new ones; so near to it, it has.
_NEARLY = 8
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
#: Where there are no file systems of a size of their own: what the processes may write, in bytes and in files.
_MAX_WRITTEN_BYTES = 512 * 1024 * 1024
_MAX_WRITTEN_FILES = 40_000
_LOOKS_PER_WALK = 5


class Guard:
    """The watch over a session's student processes.

    Parameters
    ----------
    students : callable
        Returns the student's processes of the session.
    group : CellGroup or None
        The cell's control group.
    areas : mapping
        Folders that the student's processes may change.
    sized : bool
        Whether each area is a file system of a size of its own.
    """

    def __init__(
        self,
        students: Callable[[], list[RunningProcess]],
        group: CellGroup | None,
        areas: Mapping[str, Path],
        *,
        sized: bool,
    ) -> None:
        self._students, self._group, self._areas, self._sized = students, group, areas, sized
        self._noted = {"memory": 0, "processes": 0}
        self._looks = 0

    async def watch(self) -> None:
        """Look again and again until cancelled."""
        while True:
            await asyncio.sleep(_PERIOD_S)
            await self.look()

    async def look(self) -> None:
        """Look once: note and end what exceeds a limit."""
        if self._group is not None:
            self._note_exceeded(self._group)
        else:
            await self._sum_up()
        if self._sized:
            self._note_full_areas()
        elif self._looks % _LOOKS_PER_WALK == 0:
            await self._walk_areas()
        self._looks += 1

    def _note_exceeded(self, group: CellGroup) -> None:
        for limit, times in group.exceeded().items():
            if times > self._noted[limit]:
                self._noted[limit] = times
                self._blame(limit)

    def _blame(self, limit: str) -> None:
        """Note a limit with the process that a signal has ended, else with the largest one."""
        students = self._students()
        killed = [p for p in students if not p.alive and p.run.exit_status in (137, -9) and p.run.limit is None]
        alive = sorted((p for p in students if p.alive), key=lambda p: -_taken(p)[0])
        for process in (killed if limit == "memory" else []) or alive[:1] or students[-1:]:
            process.run.limit = process.run.limit or limit

    async def _sum_up(self) -> None:
        alive = [p for p in self._students() if p.alive]
        taken = {p: _taken(p) for p in alive}
        if sum(memory for memory, _ in taken.values()) > MEMORY_BYTES:
            # What forked processes share is in that sum once for each; a truer one takes longer.
            own = {p: _own_memory(p) for p in alive}
            if sum(own.values()) <= MEMORY_BYTES:
                await self._limit_tasks(taken)
                return
            largest = max(alive, key=lambda p: own[p])
            await largest.kill(limit="memory")
        await self._limit_tasks(taken)

    async def _limit_tasks(self, taken: Mapping[RunningProcess, tuple[int, int]]) -> None:
        for process, (_, tasks) in taken.items():
            if tasks > PROCESSES:
                await process.kill(limit="processes")
            elif tasks > PROCESSES - _NEARLY:
                process.run.limit = process.run.limit or "processes"

    def _note_full_areas(self) -> None:
        for folder in self._areas.values():
            with suppress(OSError):
                space = os.statvfs(folder)
                full = "disk" if space.f_bavail == 0 else "files" if space.f_favail == 0 < space.f_files else None
                for process in self._students():
                    if full is not None and process.alive:
                        process.run.limit = process.run.limit or full

    async def _walk_areas(self) -> None:
        size, count = await asyncio.to_thread(_written, list(self._areas.values()))
        limit = "disk" if size > _MAX_WRITTEN_BYTES else "files" if count > _MAX_WRITTEN_FILES else None
        if limit is not None:
            for process in self._students():
                await process.kill(limit=limit)


def _taken(process: RunningProcess) -> tuple[int, int]:
    """Return (memory in bytes, number of threads) of a process and all that it has started."""
    root = process.root_pid()
    memory = tasks = 0
    for pid in descendants_of(root) if root is not None else ():
        with suppress(OSError, ValueError, IndexError):
            words = Path(f"/proc/{pid}/statm").read_text().split()
            memory += int(words[1]) * _PAGE_BYTES
            tasks += len(os.listdir(f"/proc/{pid}/task"))  # noqa: PTH208 - names alone, which is faster
    return memory, tasks


def _own_memory(process: RunningProcess) -> int:
    """Return the memory of a process and all that it has started in bytes, shared pages divided among them."""
    root = process.root_pid()
    total = 0
    for pid in descendants_of(root) if root is not None else ():
        with suppress(OSError, ValueError, IndexError):
            text = Path(f"/proc/{pid}/smaps_rollup").read_text()
            total += int(text.split("Pss:", 1)[1].split()[0]) * 1024
    return total


def _written(folders: list[Path]) -> tuple[int, int]:
    """Return the space in bytes and the number of files below some folders, counted up to the limit."""
    size = count = 0
    for folder in folders:
        for _, folder_names, names, at in os.fwalk(folder, follow_symlinks=False):
            count += len(names) + len(folder_names)
            for name in names:
                with suppress(OSError):
                    size += os.stat(name, dir_fd=at, follow_symlinks=False).st_blocks * 512
            if size > _MAX_WRITTEN_BYTES or count > _MAX_WRITTEN_FILES:
                return size, count
    return size, count
