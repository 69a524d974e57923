"""Compiled programs that are not assessable here."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.evidence.compiled import (
    missing_here,
    package_of,
    unbuilt_program_for,
    unbuilt_programs,
    why_not_built,
)
from grader.recording.submission import ArtifactFact, BuildFact, PackageFact, SubmissionRecord
from grader.result import Outcome
from tests.synthetic import Session, judged, submission

OFFERED = {"artifact": "it", "service": "/enable", "type": "std_srvs/srv/SetBool"}

SCRIPT = """\
find_package(rclcpp REQUIRED)
set(NAME listener)
add_executable(talker src/talker.cpp)  # the first
ament_auto_add_executable(${NAME} src/listener.cpp)
rclcpp_components_register_node(parts PLUGIN "a::B" EXECUTABLE part)
foreach(each a b)
  add_executable(${each}_node src/${each}.cpp)
endforeach()
"""
#: Words of CMake 3.25, which breaks lines anywhere.
LACKS = """\
CMake Error at CMakeLists.txt:1 (find_package):
  asked CMake to find a package configuration file provided by
  "{name}", but CMake did not find one.
"""


def handed_in(build: BuildFact | None = None) -> SubmissionRecord:
    """Give a submission with a package in C++, and its build."""
    record = submission({"arm/CMakeLists.txt": SCRIPT})
    record.packages = [PackageFact("arm", "arm", "ament_cmake")]
    record.builds = [build] if build is not None else None
    return record


@pytest.mark.parametrize(
    ("build", "is_open"),
    [
        (None, True),
        (BuildFact("arm", "arm", "not built", "no tool"), True),
        (BuildFact("arm", "arm", "failed", output=LACKS.format(name="rclcpp")), True),
        (BuildFact("arm", "arm", "failed", output="Could NOT find OpenSSL, try"), True),
        (BuildFact("arm", "arm", "failed", output="error: x"), False),
        (BuildFact("arm", "arm", "built"), False),
    ],
)
def test_programs_of_a_package_that_cannot_be_built_here(
    build: BuildFact | None, is_open: bool
) -> None:
    """A missing package is no fault for sure; each other failure is one."""
    record = handed_in(build)
    names = ["talker", "listener", "part", "${each}_node"]
    assert list(unbuilt_programs(record)) == names * is_open
    assert bool(why_not_built(build)) == is_open
    if build is not None:
        assert bool(missing_here(build)) == (is_open and build.outcome == "failed")


@pytest.mark.parametrize(
    ("expected", "words"),
    [
        ("listener.py", "There is no listener.py, and listener is compiled by the package arm"),
        ("other.py", "There is no other.py, and talker is compiled"),
        ("arm_launch.py", ""),
        ("arm.launch.py", ""),
        ("README.md", ""),
    ],
)
def test_a_missing_python_program_may_be_a_compiled_one(expected: str, words: str) -> None:
    """A missing program is open if the submission compiles programs; a missing launch file or text is not."""
    found = unbuilt_program_for(handed_in(), expected)
    assert found.startswith(words)
    assert bool(found) == bool(words)


def test_a_program_with_the_name_of_another_artifact_is_no_substitute() -> None:
    """A missing file is charged if each compiled program stands for another one."""
    record = submission(
        {"arm/CMakeLists.txt": "add_executable(talker a.cpp)"}, talker=None, other=None
    )
    record.packages = [PackageFact("arm", "arm", "ament_cmake")]
    assert unbuilt_program_for(record, "talker.py")
    assert unbuilt_program_for(record, "other.py") == ""


def test_without_compiled_programs_nothing_is_open() -> None:
    """A submission in Python alone has no excuse for a missing file."""
    assert unbuilt_program_for(submission(), "talker.py") == ""


def test_a_source_belongs_to_the_innermost_package() -> None:
    """The package around a C++ file compiles it; a Python file has no such package."""
    record = handed_in()
    inner = PackageFact("inner", "arm/inner", "ament_cmake")
    record.packages.append(inner)
    found = package_of(record, ArtifactFact("a", "a.cpp", "arm/inner/src/a.cpp"))
    assert found == inner
    assert package_of(record, ArtifactFact("a", "a.py", "arm/inner/a.py")) is None
    assert package_of(record, ArtifactFact("a", "a.cpp", "a.cpp")) is None


@pytest.mark.parametrize(
    ("packages", "build", "outcome", "words"),
    [
        (True, None, Outcome.INCONCLUSIVE, "the grading computer lacks colcon"),
        (True, "failed", Outcome.FAILED, "expected ';'"),
        (False, None, Outcome.FAILED, "is not in a package"),
    ],
)
def test_an_artifact_in_c_that_was_not_compiled(
    packages: bool, build: str | None, outcome: Outcome, words: str
) -> None:
    """A source without a program is a fault of the student's, unless only this machine could not build it."""
    record = handed_in()
    record.artifacts = [ArtifactFact("it", "it.c", "arm/it.c", "name")]
    if not packages:
        record.packages = []
    if build is not None:
        output = "/ws/src/arm/it.c:3:9: error: expected ';' before '}' token\n"
        record.builds = [BuildFact("arm", "arm", build, output=output)]
    finding = judged("service_offered", OFFERED, None, record)
    assert finding.outcome is outcome
    assert words in finding.reason


@pytest.mark.parametrize(
    ("installed", "path", "is_measured"),
    [
        (["lib/arm/talker"], "arm/src/talker.cpp", True),
        (["lib/arm/listener"], "arm/src/talker.cpp", False),
        (["lib/arm/a_node"], "arm/src/a.cpp", True),
        (["bin/talker"], "arm/src/talker.cpp", False),
    ],
)
def test_a_compiled_program_has_to_be_installed(
    tmp_path: Path, installed: list[str], path: str, is_measured: bool
) -> None:
    """A built program is judged by the graph like one in Python, unless `ros2 run` surely does not find it."""
    record = handed_in(BuildFact("arm", "arm", "built", installed=installed))
    record.artifacts = [ArtifactFact("it", "it.cpp", path, "name")]
    finding = judged("service_offered", OFFERED, Session(tmp_path), record)
    assert ("installs no program" not in finding.reason) == is_measured
