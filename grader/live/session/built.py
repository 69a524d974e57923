"""A package of the submission as colcon installed it: its files, their sources, and its programs."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

from grader.recording.submission import FileFact, PackageFact, SubmissionRecord
from grader.submission.packages.colcon import bounded, is_launch_file, sections_of

#: Folder of the installed modules, below a prefix.
_MODULES = re.compile(r"lib/python[\d.]+/site-packages/")
#: First line of a script of setuptools with the interpreter of the build.
_OF_BUILD = re.compile(rb"\A#!.{1,300}\n(?=# EASY-INSTALL-ENTRY-SCRIPT)")
#: Bytes of a list of console scripts that are read.
_MOST_LISTED = 100_000
#: Lists of console scripts of distributions, below a prefix.
_ENTRY_POINTS = "lib/python*/site-packages/*-info/entry_points.txt"
#: Most such lists that are read; a package has one.
_MOST_LISTS = 20
_NAME = re.compile(r"(?!\.{1,2}$)[\w.+-]{1,200}")
_TARGET = re.compile(r"([\w.]{1,200})\s*:\s*([\w.]{1,200})")


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
                source = self._source_of(path, ".py")
            found.append(InstalledFile(path, file.stat().st_size, source, is_program))
        return found

    @cached_property
    def scripts(self) -> dict[str, str]:
        """Console scripts, such as {"talker": "lab.talker:main"}, wherever they are installed."""
        found: dict[str, str] = {}
        for file in self._lists:
            found |= _console_scripts(file)
        return found

    @cached_property
    def _lists(self) -> list[Path]:
        """Lists of console scripts of the installed distributions."""
        found = [file for file in self._prefix.glob(_ENTRY_POINTS) if file.is_file()]
        return sorted(found)[:_MOST_LISTS]

    @cached_property
    def executables(self) -> dict[str, str]:
        """Console scripts, and Python files that the build copied as programs, by their names."""
        found = dict(self.scripts)
        for file in self.files:
            if file.is_program and file.source is not None:
                found[PurePosixPath(file.path).name] = file.source
        return found

    @cached_property
    def shared(self) -> dict[str, str]:
        """Path of each installed data file -> file of the submission with its content."""
        found = {}
        for file in self.files:
            if file.path.startswith("share/"):
                source = self._source_of(file.path)
                if source is not None:
                    found[file.path] = source
        return found

    @cached_property
    def programs(self) -> dict[str, str]:
        """Name of each entry point in the folder of the executables -> path of its module below the prefix."""
        found = {}
        for file in self._lists:
            modules = file.parents[1].relative_to(self._prefix)
            for name, target in _console_scripts(file).items():
                program = self._prefix / "lib" / self.name / name
                if program.is_file():
                    module = target.partition(":")[0].replace(".", "/")
                    found[name] = f"{modules}/{module}.py"
        return found

    def copy(self, file: InstalledFile, target: Path, interpreter: str) -> None:
        """Copy an installed file; a script of setuptools is run by an interpreter."""
        origin = self._prefix / file.path
        shutil.copy(origin, target)
        if file.path.startswith(("bin/", f"lib/{self.name}/")):
            content = origin.read_bytes()
            target.write_bytes(_OF_BUILD.sub(f"#!{interpreter}\n".encode(), content, count=1))

    def _source_of(self, path: str, suffix: str = "") -> str | None:
        """Return the file with a suffix and the same content, and a path that ends most like the installed one."""
        content = (self._prefix / path).read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        likest = None
        most = -1
        for source in self._sources.get(digest, ()):
            if not source.endswith(suffix):
                continue
            number = _common_parts(source, path)
            if number > most:
                likest = source
                most = number
        return likest


def built_package(
    record: SubmissionRecord, package: PackageFact, prefixes: Path
) -> BuiltPackage | None:
    """Return a package as colcon installed it below the folder of all prefixes; None if it was not built."""
    build = record.build_of(package)
    if build is None or build.outcome != "built":
        return None
    prefix = prefixes / package.name
    if not prefix.is_dir():
        return None
    above = PurePosixPath(package.path)
    sources = []
    for file in record.files:
        if PurePosixPath(file.path).is_relative_to(above):
            sources.append(file)
    return BuiltPackage(package.name, prefix, sources)


def note_installed(record: SubmissionRecord, prefixes: Path) -> None:
    """Note what the built packages install, in place of the facts read from their build files."""
    for package in record.packages:
        built = built_package(record, package, prefixes)
        if built is None:
            continue
        package.executables = built.executables
        package.shared = built.shared
        problems = [text for text in package.problems if "does not follow" not in text]
        package.problems = bounded(list(dict.fromkeys([*problems, *_left_out(record, package)])))


def _left_out(record: SubmissionRecord, package: PackageFact) -> list[str]:
    """Name the launch files that a package does not install, each with the line to add.

    `ros2 launch` finds an installed file of the same name, so that nothing is said of a copy elsewhere.
    """
    installed = set()
    for path in (package.shared or {}).values():
        installed.add(PurePosixPath(path).name)
    above = f"{package.path}/".lstrip("/")
    found = []
    for path in sorted(file.path for file in record.files):
        if not path.startswith(above):
            continue
        inside = PurePosixPath(path.removeprefix(above))
        if inside.name in installed:
            continue
        if not is_launch_file(path):
            continue
        command = f"ros2 launch {package.name} {inside.name}"
        line = _installing_line(package, inside)
        found.append(f"it does not install {inside}, so `{command}` does not find it; add {line}")
    return found


def _installing_line(package: PackageFact, file: PurePosixPath) -> str:
    """Return the line of a build file that installs a launch file."""
    folder = str(file.parent).removeprefix(".")
    if package.build_type != "ament_python":
        line = f"install(DIRECTORY {folder or '.'} DESTINATION share/${{PROJECT_NAME}})"
        return f"{line} to CMakeLists.txt"
    entry = f"('share/{package.name}/{folder or 'launch'}', ['{file}'])"
    return f"{entry} to data_files in setup.py"


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
    with file.open("rb") as opened:
        text = opened.read(_MOST_LISTED).decode("utf-8", errors="replace")
    parser = sections_of(text)
    if not parser.has_section("console_scripts"):
        return {}
    found = {}
    for name, target in parser.items("console_scripts"):
        match = _TARGET.match(target)
        if match is None:
            continue
        if _NAME.fullmatch(name):
            found[name] = f"{match[1]}:{match[2]}"
    return found
