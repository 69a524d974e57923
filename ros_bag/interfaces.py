"""Interface packages before they are built: `msg/`, `srv/` and `action/` files of a lab or a student."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

#: Folder of definitions -> suffixes of the names of their parts.
PARTS = {
    "msg": ("",),
    "srv": ("_Request", "_Response"),
    "action": ("_Goal", "_Result", "_Feedback"),
}
#: Limits of one package, far above those that people write.
_MOST_FILES = 200
_MOST_CHARACTERS = 200_000
_LONGEST_NAME = 100
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_FILE = re.compile(r"(msg|srv|action)/[A-Z][A-Za-z0-9]*\.\1")
#: Package of a field's type, at the beginning of a line.
_TYPE = re.compile(r"[ \t]*([a-z][a-z0-9_]*)/[A-Z]")
_SEPARATOR = re.compile(r"^---[ \t]*$", re.MULTILINE)
#: Definitions of ROS packages that cannot be installed with pip, as <package>/<msg|srv|action>/<name>.
_SHIPPED = Path(__file__).parent / "shipped"


@dataclass(frozen=True)
class InterfacePackage:
    """The definitions of a package: their paths below its folder, such as "msg/Num.msg", and texts."""

    name: str
    files: Mapping[str, str]

    @property
    def problem(self) -> str:
        """The reason why it cannot be built: a name that ROS refuses, or its size; empty if there is none."""
        if not _NAME.fullmatch(self.name) or len(self.name) > _LONGEST_NAME:
            return f"{self.name[:_LONGEST_NAME]!r} is not a valid name of an interface package"
        for name in self.files:
            if not _FILE.fullmatch(name):
                return f"{name} is not a valid name of an interface; msg/Num.msg is one"
        characters = sum(map(len, self.files.values()))
        if len(self.files) > _MOST_FILES or characters > _MOST_CHARACTERS:
            return f"it has more than {_MOST_FILES} interfaces, or more than {_MOST_CHARACTERS} characters of them"
        return ""

    @cached_property
    def used(self) -> frozenset[str]:
        """Names of the other packages with messages that it uses in its own."""
        names = set()
        for text in self.files.values():
            # rosidl splits texts as `splitlines` does: a form feed and the like end a line too.
            for line in text.splitlines():
                found = _TYPE.match(line)
                if found:
                    names.add(found[1])
        return frozenset(names - {self.name})

    @cached_property
    def types(self) -> frozenset[str]:
        """Names of its types, such as "my_msgs/srv/Add"."""
        stems = [PurePosixPath(file).with_suffix("") for file in self.files]
        return frozenset(f"{self.name}/{stem}" for stem in stems)

    def named_in(self, text: str) -> InterfacePackage:
        """Return the package with only the types that a text names, and those that they use; whole if it names none."""
        named: dict[str, str] = {}
        texts = [text]
        while texts:
            found = texts.pop()
            for file, definition in self.files.items():
                if file in named:
                    continue
                if _is_word(PurePosixPath(file).stem, found):
                    named[file] = definition
                    texts.append(definition)
        if not named:
            return self
        return InterfacePackage(self.name, named)

    @cached_property
    def fields(self) -> Mapping[str, Any]:
        """Fields of each message in it, those of services and actions included, as `rosbags` describes them.

        Raises ValueError, naming the file, if a file is not a definition.
        """
        found: dict[str, Any] = {}
        for file, text in self.files.items():
            path = PurePosixPath(file)
            parts = PARTS[path.parent.name]
            if len(parts) == 1:
                sections = [text]
            else:
                sections = _SEPARATOR.split(text)
            if len(sections) != len(parts):
                raise ValueError(f"{file}: {len(parts) - 1} lines of --- are needed")
            for part, section in zip(parts, sections, strict=True):
                name = f"{self.name}/{path.with_suffix('')}{part}"
                found[name] = _parsed(file, section, self.name)
        return found


def _is_word(name: str, text: str) -> bool:
    return re.search(rf"\b{name}\b", text) is not None


def _parsed(file: str, text: str, package: str) -> Any:
    from rosbags.typesys import TypesysError, get_types_from_msg

    name = f"{package}/msg/Any"  # a type without a package is a message of this package
    try:
        return get_types_from_msg(text, name)[name]
    except TypesysError as problem:
        raise ValueError(f"{file}: {problem}") from problem


def packages_of(files: Mapping[str, str]) -> Iterator[InterfacePackage]:
    """Yield the interface packages among files (paths -> texts), named by package.xml or by their folder."""
    folders: dict[PurePosixPath, dict[str, str]] = {}
    for name, text in files.items():
        path = PurePosixPath(name)
        kind = path.suffix[1:]
        if kind in PARTS and path.parent.name == kind:
            folders.setdefault(path.parent.parent, {})[f"{kind}/{path.name}"] = text
    for folder, found in folders.items():
        manifest = files.get(str(folder / "package.xml"), "")
        named = re.search(r"<name>\s*([\w-]{1,100})\s*</name>", manifest)
        name = folder.name
        if named is not None:
            name = named[1]
        yield InterfacePackage(name, found)


def read_folder(folder: Path) -> dict[str, str]:
    """Return the texts of definitions and manifests below an instructor's folder, by their paths in it."""
    texts = {}
    for path in sorted(folder.rglob("*")):
        is_wanted = path.suffix == ".xml" or path.suffix[1:] in PARTS
        if is_wanted and path.is_file():
            texts[path.relative_to(folder).as_posix()] = path.read_text(encoding="utf-8")
    return texts


@lru_cache(maxsize=1)
def shipped_packages() -> tuple[InterfacePackage, ...]:
    """Return the packages of definitions that come with the grader, such as `ackermann_msgs`."""
    return tuple(packages_of(read_folder(_SHIPPED)))


def in_order(packages: Iterable[InterfacePackage]) -> list[InterfacePackage]:
    """Return packages after those that they use; packages that use each other in a circle come last."""
    waiting = {package.name: package for package in packages}
    ordered: list[InterfacePackage] = []
    while True:
        ready = [each for each in waiting.values() if waiting.keys().isdisjoint(each.used)]
        if not ready:
            return [*ordered, *waiting.values()]
        ordered += ready
        for package in ready:
            del waiting[package.name]
