"""Bags work alone: neither the package nor its tests need the grader."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import ros_bag

PACKAGE = Path(ros_bag.__file__).parent
MODULES = sorted(f"ros_bag.{path.stem}" for path in PACKAGE.glob("*.py") if path.stem[0] != "_")
#: Imports the modules named in its arguments, and prints all loaded ones.
IMPORTER = """
import importlib, json, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
print(json.dumps(sorted(sys.modules)))
"""


def loaded_by(*modules: str) -> set[str]:
    """Return the top-level packages that an interpreter loads for some modules."""
    command = [sys.executable, "-c", IMPORTER, *modules]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    return {name.split(".")[0] for name in json.loads(said)}


def imports_of(file: Path) -> Iterator[str]:
    """Yield the modules that a file imports."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield node.module or ""
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_module_needs_the_grader_or_ros() -> None:
    """All modules are imported without a grader, ROS or a way to start processes."""
    assert not loaded_by(*MODULES) & {"grader", "confine", "launch_plan", "rclpy"}


@pytest.mark.parametrize("module", ["writing", "recovery"])
def test_a_recorder_loads_no_reader(module: str) -> None:
    """Numpy and `rosbags` would take a third of the start of a process that only writes."""
    assert not loaded_by(f"ros_bag.{module}") & {"numpy", "rosbags"}


def test_the_tests_need_no_grader() -> None:
    """The tests beside this one import no module of the grader, directly or by other tests."""
    for file in sorted(Path(__file__).parent.glob("*.py")):
        for module in imports_of(file):
            assert not re.match(r"(grader|confine|launch_plan)\b", module), file.name
            if module.startswith("tests."):
                assert re.match(r"tests\.(ros_bag|thorough)\b", module), file.name


def test_the_example_of_the_manual_runs(tmp_path: Path) -> None:
    """The program in README.md prints the results in its comments."""
    manual = (PACKAGE / "README.md").read_text(encoding="utf-8")
    program = manual.split("```python\n")[1].split("```")[0]
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "True ['hi']\n"
