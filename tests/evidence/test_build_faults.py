"""Faults of packages by the recorded words of their builds."""

from __future__ import annotations

import pytest

from grader.evidence.build_faults import build_fault, built_folders
from grader.evidence.installed_faults import has_own_marker, start_fault, use_fault
from grader.evidence.manifest_faults import misspelt_dependencies, undeclared_dependencies
from grader.recording.submission import BuildFact, PackageFact
from grader.submission.packages.colcon import find_packages
from tests.ros_packages import PACKAGE, SETUP, broken
from tests.synthetic import submission

MARKER = "share/ament_index/resource_index/packages/lab"
LAB = PackageFact("lab", "ws/lab", "ament_python")
#: Words of builds by colcon 0.21 with setuptools 65 and 79, and by CMake 3.25.
CRASH = """\
Traceback (most recent call last):
  File "<string>", line 1, in <module>
  File "/venv/setuptools/_distutils/core.py", line 268, in run_setup
    exec(code, g)
  File "<string>", line {line}{where}
{error}
Traceback (most recent call last):
  File "/venv/colcon_core/executor/__init__.py", line 91, in __call__
    rc = await self.task(*args, **kwargs)
subprocess.CalledProcessError: Command '['python']' returned non-zero exit status 1.
"""
NO_SETUP = (
    "AssertionError: Expected ['python', 'setup.py', '--help-commands'] to pass: python: can't open file "
    "'/ws/src/ws/lab/setup.py': [Errno 2] No such file or directory"
)
NO_CMAKE = """\
CMake Error at CMakeLists.txt:4 (find_package):
  By not providing "Findfoo.cmake" in CMAKE_MODULE_PATH this project has
  asked CMake to find a package configuration file provided by "foo", but
  CMake did not find one.

-- Configuring incomplete, errors occurred!
"""
CASES = [
    (
        CRASH.format(line=7, where="\n    version='0.0.0'", error="SyntaxError: invalid syntax."),
        ("SyntaxError: invalid syntax.", "setup.py", 7, "syntax"),
    ),
    (
        CRASH.format(
            line=1, where=", in <module>", error="ModuleNotFoundError: No module named 'numpyy'"
        ),
        ("No module named 'numpyy'", "setup.py", 1, "numpyy"),
    ),
    (
        "error: package directory 'labs' does not exist",
        ("package directory 'labs' does not exist", "setup.py", 8, "labs"),
    ),
    (
        "error: can't copy 'resource/lab': doesn't exist or not a regular file",
        ("can't copy 'resource/lab'", "setup.py", 10, "empty file resource/lab"),
    ),
    (
        "error: can't copy 'launch/lab.launch.py': doesn't exist or not a regular file",
        ("can't copy 'launch/lab.launch.py'", "setup.py", 12, "data_files"),
    ),
    (NO_SETUP, ("no setup.py", "package.xml", None, "ros2 pkg create")),
    (NO_CMAKE, ('provided by "foo"', "CMakeLists.txt", 4, "colcon build")),
    (
        'CMake Error: The source directory "/ws/src/ws/lab" does not appear to contain CMakeLists.txt.',
        ("no CMakeLists.txt", "package.xml", None, "ament_python"),
    ),
    (
        "/ws/src/ws/lab/src/talker.cpp:3:10: fatal error: rclcp.hpp: No such file or directory",
        ("rclcp.hpp", "src/talker.cpp", 3, "colcon build"),
    ),
    (
        "ERROR:colcon:colcon build: Duplicate package names not supported:\n- lab:\n  - src/a\n  - src/b",
        ("several packages with the name lab", "package.xml", None, "but one"),
    ),
    ("", ("failed", "setup.py", None, "colcon build --packages-select lab")),
]


@pytest.mark.parametrize(("output", "wanted"), CASES)
def test_a_failed_build_is_explained(output: str, wanted: tuple[str, str, int | None, str]) -> None:
    """The fault has the words of the build, the file and line, and a remedy that fits."""
    words, file, line, remedy = wanted
    texts = {"ws/lab/setup.py": SETUP}
    fault = build_fault(LAB, BuildFact("lab", "ws/lab", "failed", output=output), texts)
    assert fault is not None
    assert words in fault.message
    assert (fault.file, fault.line) == (f"ws/lab/{file}", line)
    assert remedy in fault.remedy


def test_a_crash_of_the_build_itself_is_no_place() -> None:
    """A traceback of colcon alone points at no line; the static reading names the mistake."""
    files = broken("entry")
    (package,) = find_packages(files, list(files))
    output = CRASH.format(line=1, where="", error="X").split("\n", 6)[-1]
    fault = build_fault(package, BuildFact("lab", "", "failed", output=output), files)
    assert fault is not None
    assert "'talker = lab/talker.py:main'" in fault.message
    assert "package.module:function" in fault.remedy


@pytest.mark.parametrize("outcome", ["built", "not built"])
def test_without_a_failure_there_is_no_fault(outcome: str) -> None:
    """A package that was built, and one that nobody could build here, has no fault."""
    assert build_fault(LAB, BuildFact("lab", "ws/lab", outcome), {}) is None


def test_an_ignored_package_is_not_found() -> None:
    """A package that colcon skips is not built, for one of three reasons."""
    build = BuildFact("lab", "ws/lab", "ignored")
    beside = build_fault(LAB, build, {"ws/COLCON_IGNORE": ""})
    inside = build_fault(LAB, build, {})
    invalid = PackageFact(
        "lab", "ws/lab", "ament_python", problems=["package.xml is not valid XML: x"]
    )
    wrong = build_fault(invalid, build, {})
    assert beside is not None
    assert inside is not None
    assert wrong is not None
    assert "COLCON_IGNORE" in beside.remedy
    assert "inside another package" in inside.message
    assert "is not valid XML" in wrong.message


@pytest.mark.parametrize(
    ("installed", "words"),
    [
        (["bin/talker"], "in bin"),
        (["lib/my_lab/talker"], "in lib/my_lab"),
        (["bin/talker", "lib/lab/talker"], ""),
        (["lib/lab/talker", "lib/python3.11/site-packages/lab/talker.py"], ""),
        ([], ""),
    ],
)
def test_executables_elsewhere_are_not_found(installed: list[str], words: str) -> None:
    """`ros2 run` searches lib/PACKAGE alone; setup.cfg names the folder."""
    build = BuildFact("lab", "ws/lab", "built", installed=installed)
    fault = use_fault(LAB, build, {"ws/lab/setup.cfg": "[develop]"})
    assert bool(fault) == bool(words)
    if fault is not None:
        assert words in fault.message
        assert fault.file == "ws/lab/setup.cfg"
        assert "install_scripts=$base/lib/lab" in fault.remedy
        without = use_fault(LAB, build, {})
        assert without is not None
        assert (without.file, "there is no setup.cfg" in without.message) == (
            "ws/lab/setup.py",
            True,
        )


@pytest.mark.parametrize(
    ("text", "is_broken"), [("import rclpy\n", True), ("#!/usr/bin/env python3\n", False)]
)
@pytest.mark.parametrize("is_built", [True, False])
def test_a_script_without_interpreter_does_not_start(
    text: str, is_broken: bool, is_built: bool
) -> None:
    """A copied script needs a `#!` line, by the installed file or by its source; one that nobody starts costs nothing."""
    package = PackageFact("lab", "", "ament_cmake", {"talker.py": "scripts/talker.py"})
    build = None
    if is_built:
        build = BuildFact("lab", "", "built", without_interpreter=["lib/lab/talker.py"] * is_broken)
    texts = {"scripts/talker.py": text}
    fault = start_fault(package, build, texts, ["talker.py"])
    assert bool(fault) == is_broken
    assert start_fault(package, build, texts, ["other"]) is None
    if fault is not None:
        assert (fault.file, fault.line) == ("scripts/talker.py", 1)


def test_scripts_that_are_not_known_for_sure_cost_nothing() -> None:
    """Files that stand for executables, because the build file was not understood, need no `#!` line."""
    problem = "CMakeLists.txt installs programs in a way that the grader does not follow"
    package = PackageFact("lab", "", "ament_cmake", {"talker.py": "talker.py"}, problems=[problem])
    assert start_fault(package, None, {"talker.py": "import rclpy\n"}, ["talker.py"]) is None


def test_a_marker_that_colcon_adds_is_none() -> None:
    """The build warns of a marker that it adds by itself."""
    build = BuildFact("lab", "", "built", installed=[MARKER])
    assert has_own_marker(build)
    build.output = "WARNING: Package 'lab' doesn't explicitly install a marker in the package index"
    assert not has_own_marker(build)
    assert not has_own_marker(BuildFact("lab", "", "built"))


def test_imports_that_the_manifest_does_not_declare() -> None:
    """Imported packages of ROS must be declared; launch files, tests and own modules need nothing."""
    files = {
        **PACKAGE,
        "lab/talker.py": "import rclpy\nimport numpy\nfrom std_msgs.msg import String\nimport lab.other\n",
        "test/test_it.py": "import sensor_msgs\n",
        "lab/launch/lab_launch.py": "import launch_ros\n",
    }
    record = submission(files)
    record.packages = find_packages(files, list(files))
    found = undeclared_dependencies(
        record, record.packages[0], ["rclpy", "std_msgs", "sensor_msgs", "launch_ros"]
    )
    assert found == {"std_msgs": "lab/talker.py"}


def test_dependencies_that_are_misspelt() -> None:
    """A slip of a package is named with its cure; names of libraries for CMake are no names for a package.xml."""
    manifest = PACKAGE["package.xml"].replace(
        "</package>", "<depend>std_msg</depend><depend>opencv</depend></package>"
    )
    record = submission({**PACKAGE, "package.xml": manifest})
    record.packages = find_packages({**PACKAGE}, list(PACKAGE))
    assert misspelt_dependencies(record, record.packages[0]) == {"std_msg": "std_msgs"}


def test_folders_that_colcon_makes() -> None:
    """Folders of a build are known by the notes about files that were left out."""
    record = submission()
    record.left_out = ["ws/build: made by a tool", "log: made by a tool", ".venv: made by a tool"]
    assert built_folders(record) == ["log", "ws/build"]
