"""Watches the memory, processes and files of a session's student processes, and ends those that exceed a limit.

With control groups, the kernel limits memory and processes, and the watch notes it; without them it sums up itself.
Memory beyond the limit ends the whole program either way: the kernel may have killed only a child of it, and the rest
would be waited for in vain. Disk is limited by the size of the file systems that the processes may write to.
"""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from grader.live.process.process import RunningProcess
from grader.live.sandbox.cgroup import MEMORY_BYTES, PROCESSES, SandboxCgroup
from grader.live.sandbox.machine import available_share, network_bytes, processes_of_user, tasks_of

_PERIOD_S = 0.1
#: Share of the limit on memory above which memory is getting short.
_SHORT = 0.25
#: Number of processes below the limit from which the limit counts as reached, because it refuses new ones.
_NEARLY = 8
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
#: Limits on written bytes, files and depth of folders without file systems of a limited size.
_MAX_WRITTEN_BYTES = 512 * 1024 * 1024
_MAX_WRITTEN_FILES = 40_000
_MAX_WRITTEN_DEPTH = 100
_LOOKS_PER_WALK = 5
#: Share of the free disk space at the session's start below which nothing more may be written, because no folder shows
#: files that are open and have no name any more.
_LEAST_FREE = 0.5
#: Limit on the bytes in the sockets of a session.
_MAX_NETWORK_BYTES = 128 * 1024 * 1024
#: Share of the machine's memory below which nothing more may be taken, if the kernel limits no process.
_LEAST_AVAILABLE = 0.04


class Guard:
    """The watch over a session's student processes.

    The processes may change `areas`. If these are `sized`, each is a file system of a limited size, and the network is
    the session's own. `user` is the user id of the processes, if they have one of their own. `on_problem` is called with
    infrastructure faults that no student can have caused.
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
        self._noted = {"memory": 0, "processes": 0}
        #: Bytes of each process when memory was last getting short, if the kernel kills.
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
            # No sum shows all held memory.
            if available_share() < _LEAST_AVAILABLE:
                await self._spare("machine ran out of memory")
        if self._network_is_full():
            await self._end_all("memory")
        if self._sized:
            self._note_full_areas()
        elif self._looks % _LOOKS_PER_WALK == 0:
            await self._walk_areas()
        self._looks += 1

    def _network_is_full(self) -> bool:
        """Tell whether the sockets of the session hold too much, if they can be told from others."""
        if self._sized:
            return network_bytes(None) > _MAX_NETWORK_BYTES
        if self._user is not None:
            return network_bytes(self._user) > _MAX_NETWORK_BYTES
        return False

    async def _end_all(self, limit: str | None) -> None:
        for process in self._students():
            await process.kill(limit=limit)

    async def _spare(self, what: str) -> None:
        """End the student's processes because the machine runs out of something, from whatever cause."""
        if self._alive():
            self._on_problem(f"the {what} while it was recorded")
            await self._end_all(None)

    def _alive(self) -> list[RunningProcess]:
        return [process for process in self._students() if process.alive]

    async def _note_exceeded(self, group: SandboxCgroup) -> None:
        for limit, times in group.exceeded().items():
            if times > self._noted[limit]:
                self._noted[limit] = times
                for process in self._to_blame(limit):
                    process.run.limit = process.run.limit or limit
                    if limit == "memory":
                        await process.kill(limit=limit)
        if group.memory_bytes() > _SHORT * MEMORY_BYTES:
            self._held = {process: _taken(process.descendants())[0] for process in self._alive()}

    def _to_blame(self, limit: str) -> list[RunningProcess]:
        """Return the processes that a signal has ended, else the process that takes, or lately took, most."""
        students = self._students()
        if limit == "memory":
            killed = [process for process in students if _was_killed(process)]
            if killed:
                return killed
        alive = self._alive()
        if not alive:
            return students[-1:]

        def memory(process: RunningProcess) -> int:
            return max(self._held.get(process, 0), _taken(process.descendants())[0])

        return [max(alive, key=memory)]

    async def _sum_up(self) -> None:
        """Note and end the processes that exceed a limit by the sums of what each has taken."""
        alive = self._alive()
        taken = {process: _taken(process.descendants()) for process in alive}
        orphans = self._orphans(alive)
        all_memory, left_tasks = _taken(orphans)
        for process, (memory, tasks) in taken.items():
            all_memory += memory
            if tasks > PROCESSES:
                await process.kill(limit="processes")
            elif tasks + left_tasks > PROCESSES - _NEARLY:
                process.run.limit = process.run.limit or "processes"
        if left_tasks > PROCESSES - _NEARLY:
            self._end_orphans(orphans, "processes")
        if all_memory > MEMORY_BYTES:
            await self._limit_own_memory(alive, orphans)

    async def _limit_own_memory(self, alive: list[RunningProcess], orphans: list[int]) -> None:
        """End the largest process, or the orphans, if the memory is beyond the limit.

        `_sum_up` counts shared pages once for each process; this sum divides them, and takes longer.
        """
        own = {process: _own_memory(process.descendants()) for process in alive}
        left = _own_memory(orphans)
        if sum(own.values()) + left <= MEMORY_BYTES:
            return
        largest = max(alive, key=lambda process: own[process], default=None)
        if largest is not None and own[largest] >= left:
            await largest.kill(limit="memory")
        else:
            self._end_orphans(orphans, "memory")

    def _orphans(self, alive: Iterable[RunningProcess]) -> list[int]:
        """Return the processes of the students' user that are no longer descendants of any program.

        With process ids of their own, no process can leave its program.
        """
        if self._sized or self._user is None:
            return []
        orphans = set(processes_of_user(self._user))
        for process in alive:
            orphans.difference_update(process.descendants())
        return sorted(orphans)

    def _end_orphans(self, orphans: Iterable[int], limit: str) -> None:
        for process in self._to_blame(limit):
            process.run.limit = process.run.limit or limit
        for pid in orphans:
            with suppress(OSError):
                # One may have ended in the meantime, and another user's process may have its id.
                if Path(f"/proc/{pid}").stat().st_uid == self._user:
                    os.kill(pid, signal.SIGKILL)

    def _note_full_areas(self) -> None:
        for folder in self._areas.values():
            with suppress(OSError):
                full = _exhausted(os.statvfs(folder))
                if full is not None:
                    for process in self._alive():
                        process.run.limit = process.run.limit or full

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


def _was_killed(process: RunningProcess) -> bool:
    """Tell whether SIGKILL has ended a process or its shell, and no limit is noted for it."""
    if process.alive or process.run.limit is not None:
        return False
    return process.run.exit_status in (137, -9)


def _exhausted(space: os.statvfs_result) -> str | None:
    """Name the limit that a file system has reached: "disk", "files" or None."""
    if space.f_bavail == 0:
        return "disk"
    if space.f_favail == 0 < space.f_files:
        return "files"
    return None


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
    """Return the memory of processes in bytes, with shared pages divided among them.

    Shared pages are left out if their division may not be read.
    """
    total = 0
    for pid in pids:
        with suppress(OSError, ValueError, IndexError):
            shared = _reported_memory(pid, "smaps_rollup")
            if "Pss:" in shared:
                total += int(shared.split("Pss:", 1)[1].split()[0]) * 1024
            else:
                resident, shared_pages = map(int, _reported_memory(pid, "statm").split()[1:3])
                total += (resident - shared_pages) * _PAGE_BYTES
    return total


def _reported_memory(pid: int, file: str) -> str:
    """Return the text of a file about a process in /proc; another thread answers for a first one that has ended."""
    text = ""
    folders = [f"/proc/{pid}"]
    folders += [f"/proc/{pid}/task/{task}" for task in tasks_of(pid)]
    for folder in folders:
        with suppress(OSError):
            text = Path(folder, file).read_text()
            if not text.startswith("0 "):
                return text
    return text


def _written(folders: list[Path]) -> tuple[int, int]:
    """Return the space in bytes and the number of files below some folders, counted up to the limit.

    A folder that cannot be counted, because it is too deep or closed to the grader, is over the limit.
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
        except (FileNotFoundError, NotADirectoryError):  # it was removed in the meantime
            continue
        except OSError:
            return size, _MAX_WRITTEN_FILES + 1
        if depth > _MAX_WRITTEN_DEPTH:
            return size, _MAX_WRITTEN_FILES + 1
    return size, count
