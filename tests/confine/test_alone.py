"""Confinement works alone: neither it nor its tests need the grader, or any library."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import confine

PACKAGE = Path(confine.__file__).parent
MODULES = sorted(f"confine.{path.stem}" for path in PACKAGE.glob("*.py") if path.stem[0] != "_")
#: Imports the modules named in its arguments, and prints all that were loaded.
IMPORTER = """
import importlib, json, sys
for name in sys.argv[2:]:
    sys.path.insert(0, sys.argv[1])
    importlib.import_module(name)
print(json.dumps(sorted(sys.modules)))
"""


def loaded_by(*modules: str) -> set[str]:
    """Return the modules that an interpreter without site-packages loads for some modules."""
    command = [sys.executable, "-I", "-S", "-c", IMPORTER, str(PACKAGE.parent), *modules]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    return set(json.loads(said))


def imports_of(file: Path) -> Iterator[str]:
    """Yield the modules that a file imports."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield node.module or ""
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_module_needs_more_than_the_standard_library() -> None:
    """An interpreter without installed packages imports all modules, and none of the grader."""
    own = {name for name in loaded_by(*MODULES) if name.split(".")[0] == "confine"}
    assert own >= set(MODULES)
    others = {name.split(".")[0] for name in loaded_by(*MODULES)} - {"confine", "__main__"}
    assert others <= sys.stdlib_module_names


def test_limits_start_no_process() -> None:
    """The judging half of a grader may import them: no module that starts processes comes along."""
    assert not {"subprocess", "asyncio", "ctypes"} & loaded_by("confine.limits")


def test_the_tests_need_no_grader() -> None:
    """The tests beside this one import confinement, the standard library and pytest."""
    for file in sorted(Path(__file__).parent.glob("*.py")):
        found = {module.split(".")[0] for module in imports_of(file)}
        assert found - sys.stdlib_module_names <= {"confine", "pytest"}, file.name
