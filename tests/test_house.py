"""`tools/house`: figures that it measures, and when a worse one fails."""

from __future__ import annotations

import ast
import graphlib
import json
import runpy
from collections.abc import Set
from pathlib import Path
from typing import Any

import pytest

from tests.packages import modules

HOUSE = Path(__file__).resolve().parents[1] / "tools/house"
MODULE = '''"""A module."""

import re

LIMIT = 5


def both(a: bool, b: bool) -> bool:
    """Return whether all are true.

    Said in three lines.
    """
    # What is small is not counted.
    values = [v for v in (a, b) if v]
    return len(values) == 2 and LIMIT > 0 if a else False
'''


@pytest.fixture
def house() -> dict[str, Any]:
    """Give the script's names."""
    return runpy.run_path(str(HOUSE))


def test_a_module_is_measured(house: dict[str, Any]) -> None:
    """Docstrings, comments and blank lines are no code lines."""
    counts = house["Counts"]()
    counts.add_module(MODULE)
    assert counts.code_lines == 5
    assert (counts.comprehensions, counts.conditionals, counts.operators) == (1, 1, 1)
    assert (counts.texts, counts.openings, counts.clauses) == (3, 1, 1)
    function = ast.parse(MODULE).body[-1]
    assert house["complexity"](function) == 4
    assert house["length"](function) == 4


def test_a_page_is_measured_without_its_code(house: dict[str, Any]) -> None:
    """Only prose counts."""
    counts = house["Counts"]()
    counts.add_page(
        "# Title of it\n\nWhat is here counts once.\n\n```bash\nwhat who whose of\n```\n"
    )
    assert (counts.texts, counts.openings, counts.clauses) == (2, 1, 1)


@pytest.mark.parametrize(("landed", "status"), [(10.0, 0), (9.0, 0), (8.0, 1)])
def test_a_worse_figure_fails(
    house: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    landed: float,
    status: int,
) -> None:
    """The sentence names the package and both figures; landing keeps the better ones."""
    (tmp_path / "grader/checks").mkdir(parents=True)
    (tmp_path / "grader/checks/a.py").write_text("a = (1, b, c, (d, e))\n", encoding="utf-8")
    kept = tmp_path / "house.json"
    kept.write_text(json.dumps({"grader/checks": {"nodes": landed}}), encoding="utf-8")
    main = house["main"]
    measured = house["measured"]
    main.__globals__.update(LANDED=kept, measured=lambda: measured(tmp_path))
    assert main([]) == status
    output = capsys.readouterr().out
    assert ("grader/checks: nodes is 9, and was 8" in output) == bool(status)
    assert main(["--land"]) == 0
    assert json.loads(kept.read_text())["grader/checks"]["nodes"] == min(9.0, landed)


def module_name(path: Path) -> str:
    """Return the dotted name of a module, without `__init__`."""
    parts = path.relative_to(HOUSE.parents[1]).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


def imported_by(name: str, path: Path, known: Set[str]) -> set[str]:
    """Return the known modules named in the `from` imports of a module."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.ImportFrom):
            continue
        source = node.module or ""
        if node.level == 1:
            source = f"{name.rpartition('.')[0]}.{source}".rstrip(".")
        for alias in node.names:
            inner = f"{source}.{alias.name}"
            found.add(inner if inner in known else source)
    return found & known


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Each module can be read after its imports, those for types and later ones included."""
    files = [path for path in modules() if not {"standin", "inside"} & set(path.parts)]
    by_name = {module_name(path): path for path in files}
    imports: dict[str, set[str]] = {}
    for name, path in by_name.items():
        imports[name] = imported_by(name, path, by_name.keys()) - {name}
    assert len(by_name) > 150
    assert sum(map(len, imports.values())) > 500
    assert len(list(graphlib.TopologicalSorter(imports).static_order())) == len(by_name)
