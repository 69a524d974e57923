"""The folders that a student's programs see in a sandbox."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import confine
import grader
import launch_plan
import ros_bag
from confine.room import SHARED_MEMORY, TEMPORARY, Room
from grader.live.sandbox.environment import INSIDE_FOLDER, LAUNCHING_FOLDER
from grader.live.sandbox.installation import Installation

WORKSPACE = "/ws"
HOME = "/home/student"
INSIDE = "/inside"
LAUNCHING = "/launching"
PARAMETERS = "/parameters"
INTERFACES = "/interfaces"
CRASHES = "/crashes"

_AREAS = {WORKSPACE: "ws", HOME: "home", TEMPORARY: "tmp", SHARED_MEMORY: "shm"}
#: Folders into which the grader writes for a session's programs.
_WRITTEN = {PARAMETERS: "parameters", INTERFACES: "interfaces", CRASHES: "crashes"}
#: Folders of a checkout that belong to an interpreter, if the checkout is a virtual environment too.
_OF_ENVIRONMENTS = ("bin", "lib", "lib64", "include", "share")


class StudentRoom(Room):
    """The room of a session's student; the grader's own packages, oracles and solution included, are covered."""

    @classmethod
    def below(cls, scratch: Path, installation: Installation) -> StudentRoom:
        """Return the room of a sandbox with its own folders in `scratch`, and an installation of ROS."""
        interpreter = installation.interpreter
        areas = {seen: scratch / name for seen, name in _AREAS.items()}
        tools = {INSIDE: INSIDE_FOLDER, LAUNCHING: LAUNCHING_FOLDER}
        tools |= {seen: scratch / name for seen, name in _WRITTEN.items()}
        tools |= installation.folders
        room = cls(areas, tools, interpreter, covered=())
        return cls(areas, tools, interpreter, covered=_own_folders(room.roots))

    def make(self, scratch: Path, mount: Callable[[Path], None] | None = None) -> None:
        """Make the folders, the areas as file systems of their own if there is a way to mount one."""
        super().make(scratch, mount)
        self.open_to_all(HOME, TEMPORARY, SHARED_MEMORY)
        for written in _WRITTEN:
            self.tools[written].mkdir()
            self.tools[written].chmod(0o755)  # whatever the umask is


def made_room(scratch: Path, installation: Installation) -> StudentRoom:
    """Make the room of a sandbox in `scratch`, without file systems of its own."""
    room = StudentRoom.below(scratch, installation)
    room.make(scratch)
    return room


def _own_folders(roots: Sequence[Path]) -> list[Path]:
    """Return the grader's packages and, in a checkout, the folders beside these outside of each interpreter."""
    package = Path(grader.__file__).parent
    checkout = package.parent
    if not (checkout / "rubric.yaml").is_file():
        return [package, *map(Path, [*confine.__path__, *launch_plan.__path__, *ros_bag.__path__])]
    theirs: set[Path] = set()
    if checkout in roots:
        theirs = {checkout / name for name in _OF_ENVIRONMENTS}
    holding_interpreter = {*roots}
    for root in roots:
        holding_interpreter.update(root.parents)
    found = []
    with os.scandir(checkout) as entries:
        for entry in entries:
            folder = checkout / entry.name
            if folder in theirs or folder in holding_interpreter:
                continue
            if entry.is_dir(follow_symlinks=False):
                found.append(folder)
    return sorted(found)
