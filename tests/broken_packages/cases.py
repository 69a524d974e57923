"""Packages with one defect each: read from cases.yaml and written into a workspace, and their kept builds."""

from __future__ import annotations

import json
import posixpath
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import yaml

from grader.recording.record import from_plain
from grader.recording.submission import BuildFact
from tests.ros_packages import MANIFEST, PACKAGE

_CASES = Path(__file__).with_name("cases.yaml")
#: Builds by colcon 0.21, setuptools 79 and CMake 3.25: kind -> builds.
_BUILDS = Path(__file__).with_name("builds.json")
#: A correct package in C: path -> text.
_C_PACKAGE = {
    "package.xml": MANIFEST.replace("ament_python", "ament_cmake").replace(
        "<exec_depend>rclpy</exec_depend>",
        "<buildtool_depend>ament_cmake</buildtool_depend><depend>rcl</depend>",
    ),
    "CMakeLists.txt": """\
cmake_minimum_required(VERSION 3.8)
project(lab C)
find_package(ament_cmake REQUIRED)
find_package(rcl REQUIRED)
add_executable(talker src/talker.c)
ament_target_dependencies(talker rcl)
install(TARGETS talker DESTINATION lib/${PROJECT_NAME})
install(DIRECTORY launch DESTINATION share/${PROJECT_NAME})
ament_package()
""",
    "src/talker.c": "#include <rcl/rcl.h>\n\nint main(void) {\n  return 0;\n}\n",
    "launch/lab.launch.py": PACKAGE["launch/lab.launch.py"],
}
_PACKAGES = {"python": PACKAGE, "c": _C_PACKAGE}


class Report(NamedTuple):
    """Expected words of the report: a part of the sentence, file below the package, line, a part of the remedy."""

    words: str
    file: str
    line: int | None
    remedy: str


@dataclass
class Case:
    """A package with a defect; the fields are explained in the file of the cases."""

    kind: str
    package: str
    says: str
    report: list[str | int | None] = field(default_factory=list)
    seen: str = ""
    without: list[str] = field(default_factory=list)
    replaced: list[list[str]] = field(default_factory=list)
    added: dict[str, str] = field(default_factory=dict)
    renamed: list[str] = field(default_factory=list)

    def files(self) -> dict[str, str]:
        """Return the files of the workspace: path -> text."""
        package = {**_PACKAGES[self.package]}
        for file, text, other in self.replaced:
            assert text in package[file], (self.kind, text)
            package[file] = package[file].replace(text, other)
        for file in self.without:
            del package[file]
        found = {}
        for path, text in {**package, **self.added}.items():
            text = package[text[1:]] if text.startswith("=") else text
            found[posixpath.normpath(f"src/lab/{path}")] = self._renamed(path, text)
        return found

    def _renamed(self, path: str, text: str) -> str:
        if self.renamed and path.startswith(self.renamed[0]):
            _, name, other = self.renamed
            swapped = text.replace(other, "\0").replace(name, other)
            return swapped.replace("\0", name)
        return text

    def expected(self) -> Report:
        """Return the expected words of the report."""
        words, file, line, remedy = self.report
        assert isinstance(line, int | None)
        return Report(str(words), str(file), line, str(remedy))


def cases() -> list[Case]:
    """Return all cases."""
    return [Case(**each) for each in yaml.safe_load(_CASES.read_text(encoding="utf-8"))]


def kept_builds() -> dict[str, list[BuildFact]]:
    """Return the kept builds of the cases by their kinds."""
    plain = json.loads(_BUILDS.read_text(encoding="utf-8"))
    found: dict[str, list[BuildFact]] = {}
    for kind, builds in plain.items():
        found[kind] = []
        for build in builds:
            found[kind].append(from_plain(BuildFact, build))
    return found


def write_exactly(folder: Path, files: Mapping[str, str]) -> None:
    """Write files with their ends of lines."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode())
