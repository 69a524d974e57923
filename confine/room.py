"""The part of the file system that confined programs see."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from confine.interpreters import interpreter_links, interpreter_roots
from confine.isolation import Isolation

HOME = "/home/user"
TEMPORARY = "/tmp"
SHARED_MEMORY = "/dev/shm"

#: Rights of a folder like /tmp: every user may make files there, and remove its own.
_OPEN_TO_ALL = 0o1777


@dataclass(frozen=True)
class Room:
    """Folders that confined programs see besides those of the system.

    Programs may change the `areas` and read the `tools`: path inside the sandbox -> folder outside. An `interpreter`
    and its installation have the same paths inside. The folders in `covered` stay hidden, even below a visible folder.
    """

    areas: Mapping[str, Path]
    tools: Mapping[str, Path]
    interpreter: Path
    covered: Sequence[Path]

    @property
    def roots(self) -> list[Path]:
        """Folders of programs that are seen at their own paths."""
        return [Path("/usr"), *interpreter_roots(self.interpreter)]

    @property
    def links(self) -> dict[Path, str]:
        """Links to the interpreter outside of `roots`, with their targets."""
        return interpreter_links(self.interpreter)

    def make(self, scratch: Path, mount: Callable[[Path], None] | None = None) -> None:
        """Make the areas below `scratch`, each a file system of its own if there is a way to mount one."""
        scratch.chmod(0o711)
        for folder in self.areas.values():
            folder.mkdir()
            if mount is not None:
                mount(folder)

    def open_to_all(self, *areas: str) -> None:
        """Let every user write to some areas."""
        for area in areas:
            self.areas[area].chmod(_OPEN_TO_ALL)

    def seen(self, isolation: Isolation) -> dict[str, str]:
        """Return the path of each area and tool for confined programs."""
        folders = {**self.areas, **self.tools}
        if isolation.namespaces:
            return {target: target for target in folders}
        return {target: str(folder) for target, folder in folders.items()}


def private_room(scratch: Path, interpreter: Path) -> Room:
    """Return a room with a home, a /tmp and a /dev/shm below `scratch`, and nothing else."""
    names = {HOME: "home", TEMPORARY: "tmp", SHARED_MEMORY: "shm"}
    areas = {seen: scratch / name for seen, name in names.items()}
    return Room(areas, {}, interpreter, covered=())


def made_private_room(scratch: Path, interpreter: Path) -> Room:
    """Make a private room in `scratch`, open to every user."""
    room = private_room(scratch, interpreter)
    room.make(scratch)
    room.open_to_all(*room.areas)
    return room
