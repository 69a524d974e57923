"""A package of the submission as colcon installed it: its files, their sources, and its programs."""

from __future__ import annotations

import configparser
import hashlib
import re
import shutil
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from grader.recording.submission import FileFact

#: Folder of the installed modules, below a prefix.
_MODULES = re.compile(r"lib/python[\d.]+/site-packages/")
#: First line of a script of setuptools with the interpreter of the build.
_OF_BUILD = re.compile(rb"#!.*python.*\n(?=# EASY-INSTALL-ENTRY-SCRIPT)")
_TARGET = re.compile(r"([\w.]+)\s*:\s*[\w.]+")


@dataclass(frozen=True)
class InstalledFile:
    """An installed file.

    Attributes
    ----------
    path
        Path below the prefix, e.g. "lib/lab/talker".
    source
        File of the submission with the same content, for a module or a Python script; relative to the root.
    is_program
        Whether `ros2 run` finds the file.
    """

    path: str
    size_bytes: int
    source: str | None
    is_program: bool


class BuiltPackage:
    """The prefix of a built package, with plain files alone.

    Parameters
    ----------
    name
        Name of the package.
    prefix
        Folder of its installed files.
    sources
        Files of its folder in the submission.
    """

    def __init__(self, name: str, prefix: Path, sources: Iterable[FileFact]) -> None:
        self.name = name
        self._prefix = prefix
        self._sources: dict[str, list[str]] = defaultdict(list)
        for source in sources:
            if source.path.endswith(".py"):
                self._sources[source.sha256].append(source.path)

    @cached_property
    def files(self) -> list[InstalledFile]:
        """Installed files by their paths; links that the build made are left out."""
        found = []
        for file in sorted(self._prefix.rglob("*")):
            if file.is_symlink():
                continue
            if not file.is_file():
                continue
            path = file.relative_to(self._prefix).as_posix()
            is_program = path.startswith(f"lib/{self.name}/")
            source = None
            if is_program or _MODULES.match(path):
                source = self._source_of(path)
            found.append(InstalledFile(path, file.stat().st_size, source, is_program))
        return found

    @cached_property
    def programs(self) -> dict[str, str]:
        """Name of each entry point in the folder of the executables -> path of its module below the prefix."""
        found = {}
        for file in self._prefix.glob("lib/python*/site-packages/*-info/entry_points.txt"):
            modules = file.parents[1].relative_to(self._prefix)
            for name, target in _console_scripts(file).items():
                match = _TARGET.match(target)
                if match is None:
                    continue
                program = self._prefix / "lib" / self.name / name
                if program.is_file():
                    module = match[1].replace(".", "/")
                    found[name] = f"{modules}/{module}.py"
        return found

    def copy(self, file: InstalledFile, target: Path, interpreter: str) -> None:
        """Copy an installed file; a script of setuptools is run by an interpreter."""
        origin = self._prefix / file.path
        shutil.copy(origin, target)
        if file.is_program or file.path.startswith("bin/"):
            content = origin.read_bytes()
            target.write_bytes(_OF_BUILD.sub(f"#!{interpreter}\n".encode(), content, count=1))

    def _source_of(self, path: str) -> str | None:
        """Return the Python file with the same content, and a path that ends most like the installed one."""
        content = (self._prefix / path).read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        likest = None
        most = -1
        for source in self._sources.get(digest, ()):
            number = _common_parts(source, path)
            if number > most:
                likest = source
                most = number
        return likest


def _common_parts(first: str, second: str) -> int:
    """Return the number of equal parts at the ends of two paths."""
    number = 0
    ends = reversed(first.split("/"))
    other_ends = reversed(second.split("/"))
    for one, other in zip(ends, other_ends, strict=False):
        if one != other:
            break
        number += 1
    return number


def _console_scripts(file: Path) -> dict[str, str]:
    """Return the console scripts of a distribution, e.g. {"talker": "lab.talker:main"}."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[method-assign,assignment]
    try:
        parser.read(file, encoding="utf-8")
    except (configparser.Error, UnicodeDecodeError):
        return {}
    if not parser.has_section("console_scripts"):
        return {}
    return dict(parser.items("console_scripts"))
