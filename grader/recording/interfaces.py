"""Interface packages as they are written: `msg/`, `srv/` and `action/` files, of a lab or a student, not yet built."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

#: Folder of definitions -> names that their parts add to theirs.
PARTS = {
    "msg": ("",),
    "srv": ("_Request", "_Response"),
    "action": ("_Goal", "_Result", "_Feedback"),
}
#: Of one package, far more than people write.
_MOST_FILES, _MOST_CHARACTERS, _LONGEST_NAME = 200, 200_000, 100
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_FILE = re.compile(r"(msg|srv|action)/[A-Z][A-Za-z0-9]*\.\1")
#: The package of a field's type, which stands first in its line.
_TYPE = re.compile(r"[ \t]*([a-z][a-z0-9_]*)/[A-Z]")
_SEPARATOR = re.compile(r"^---[ \t]*$", re.MULTILINE)


@dataclass(frozen=True)
class InterfacePackage:
    """The definitions of a package: their paths below its folder, such as "msg/Num.msg", and texts."""

    name: str
    files: Mapping[str, str]

    @property
    def problem(self) -> str:
        """Why it is not built: its names are none that ROS takes, or it is too large; empty if there is no reason."""
        if not _NAME.fullmatch(self.name) or len(self.name) > _LONGEST_NAME:
            return f"{self.name[:_LONGEST_NAME]!r} is not a valid name of an interface package"
        wrong = next((name for name in self.files if not _FILE.fullmatch(name)), None)
        if wrong is not None:
            return f"{wrong} is not a valid name of an interface; msg/Num.msg is one"
        if len(self.files) > _MOST_FILES or sum(map(len, self.files.values())) > _MOST_CHARACTERS:
            return f"it has more than {_MOST_FILES} interfaces, or more than {_MOST_CHARACTERS} characters of them"
        return ""

    @cached_property
    def used(self) -> frozenset[str]:
        """Names of the other packages whose messages it has in its own."""
        # A form feed and the like end a line too: rosidl splits texts so.
        lines = (line for text in self.files.values() for line in text.splitlines())
        return frozenset(found[1] for line in lines if (found := _TYPE.match(line))) - {self.name}

    @cached_property
    def types(self) -> frozenset[str]:
        """Names of its types, such as "my_msgs/srv/Add"."""
        return frozenset(
            f"{self.name}/{PurePosixPath(file).with_suffix('')}" for file in self.files
        )

    @cached_property
    def fields(self) -> Mapping[str, Any]:
        """Fields of each message in it, those of services and actions included, as `rosbags` describes them.

        Raises ValueError, naming the file, for what is no definition.
        """
        found: dict[str, Any] = {}
        for file, text in self.files.items():
            path = PurePosixPath(file)
            parts = PARTS[path.parent.name]
            sections = [text] if len(parts) == 1 else _SEPARATOR.split(text)
            if len(sections) != len(parts):
                raise ValueError(f"{file}: {len(parts) - 1} lines of --- are needed")
            for part, section in zip(parts, sections, strict=True):
                found[f"{self.name}/{path.with_suffix('')}{part}"] = _parsed(
                    file, section, self.name
                )
        return found


def _parsed(file: str, text: str, package: str) -> Any:
    from rosbags.typesys import TypesysError, get_types_from_msg

    name = f"{package}/msg/Any"  # what stands without a package in it is a message of its own
    try:
        return get_types_from_msg(text, name)[name]
    except TypesysError as problem:
        raise ValueError(f"{file}: {problem}") from problem


def packages_of(files: Mapping[str, str]) -> Iterator[InterfacePackage]:
    """Give the interface packages among some files, paths -> texts; a package is named by its package.xml or folder."""
    folders: dict[PurePosixPath, dict[str, str]] = {}
    for name, text in files.items():
        path = PurePosixPath(name)
        if path.suffix[1:] in PARTS and path.parent.name == path.suffix[1:]:
            folders.setdefault(path.parent.parent, {})[f"{path.parent.name}/{path.name}"] = text
    for folder, found in folders.items():
        named = re.search(
            r"<name>\s*([\w-]{1,100})\s*</name>", files.get(str(folder / "package.xml"), "")
        )
        yield InterfacePackage(named[1] if named is not None else folder.name, found)


def read_folder(folder: Path) -> dict[str, str]:
    """Return the texts of definitions and manifests below a folder of the instructor's, by their paths in it."""
    suffixes = (*(f".{kind}" for kind in PARTS), ".xml")
    paths = (
        path for path in sorted(folder.rglob("*")) if path.suffix in suffixes and path.is_file()
    )
    return {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def in_order(packages: Iterable[InterfacePackage]) -> list[InterfacePackage]:
    """Return packages after those that they use; what use each other in a circle stand last."""
    waiting = {package.name: package for package in packages}
    ordered: list[InterfacePackage] = []
    while ready := [p for p in waiting.values() if waiting.keys().isdisjoint(p.used)]:
        ordered += ready
        for package in ready:
            del waiting[package.name]
    return [*ordered, *waiting.values()]
