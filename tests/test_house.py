"""`tools/house`: what it counts of a module, and when too many lines are a failure."""

from __future__ import annotations

import ast
import graphlib
import runpy
from pathlib import Path
from typing import Any

import pytest

HOUSE = Path(__file__).resolve().parents[1] / "tools/house"
MODULE = '''"""A module."""

import re

LIMIT = 5
_FOUND = re.compile("a")


def both(a: bool, b: bool) -> bool:
    """Return whether all are true.

    Said in three lines.
    """
    # Why.
    return a and b and LIMIT > 0
'''


@pytest.fixture
def house() -> dict[str, Any]:
    """Give the script's names."""
    return runpy.run_path(str(HOUSE))


def test_a_module_is_counted(house: dict[str, Any]) -> None:
    """Docstrings, comments and blank lines are no code, nor of a function's length."""
    counted = house["Figures"].of(MODULE)
    assert (counted.lines, counted.code, counted.comments) == (15, 5, 1)
    assert (counted.operators, counted.constants, counted.patterns) == (2, 2, 1)
    assert (counted.functions, counted.large) == ([3], 0)


@pytest.mark.parametrize(("budget", "status"), [(10, 1), (20, 0)])
def test_too_many_lines_fail(
    house: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str], budget: int, status: int
) -> None:
    """And the distance is printed."""
    (tmp_path / "checks").mkdir()
    (tmp_path / "checks/a.py").write_text(MODULE, encoding="utf-8")
    main = house["main"]
    main.__globals__.update(GRADER=tmp_path, BUDGET={"": budget})
    assert main() == status
    output = capsys.readouterr().out
    assert f"15 lines; the budget is {budget}, {abs(budget - 15)} away" in output
    assert "checks" in output


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Each module can be read after those that it imports, what is imported for types or later included."""
    root = HOUSE.parents[1]
    files = [path for path in root.glob("grader/**/*.py") if "standin" not in path.parts and "inside" not in path.parts]
    modules = {".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path for path in files}
    imports: dict[str, set[str]] = {}
    for name, path in modules.items():
        nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
        package = name.rpartition(".")[0] + "."
        froms = [(package * (node.level == 1) + (node.module or ""), [a.name for a in node.names]) for node in nodes]
        asked = {f"{m}.{n}" if f"{m}.{n}" in modules else m for m, names in froms for n in names}
        imports[name] = asked & set(modules) - {name}
    assert len(modules) > 150
    assert sum(map(len, imports.values())) > 500
    assert len(list(graphlib.TopologicalSorter(imports).static_order())) == len(modules)
