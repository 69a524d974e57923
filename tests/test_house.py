"""`tools/house`: figures that it measures, and when a worse one fails."""

from __future__ import annotations

import ast
import graphlib
import json
import runpy
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


@pytest.mark.parametrize(("landed", "status"), [(4.0, 0), (3.0, 0), (2.0, 1)])
def test_a_worse_figure_fails(
    house: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    landed: float,
    status: int,
) -> None:
    """The sentence names the package and both figures; landing keeps the better ones."""
    (tmp_path / "grader/checks").mkdir(parents=True)
    (tmp_path / "grader/checks/a.py").write_text("a = 1\n", encoding="utf-8")
    kept = tmp_path / "house.json"
    kept.write_text(json.dumps({"grader/checks": {"nodes": landed}}), encoding="utf-8")
    main = house["main"]
    measured = house["measured"]
    main.__globals__.update(LANDED=kept, measured=lambda: measured(tmp_path))
    assert main([]) == status
    output = capsys.readouterr().out
    assert ("grader/checks: nodes is 3, and was 2" in output) == bool(status)
    assert main(["--land"]) == 0
    assert json.loads(kept.read_text())["grader/checks"]["nodes"] == min(3.0, landed)


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Each module can be read after its imports, those for types and later ones included."""
    root = HOUSE.parents[1]
    files = [
        path for path in modules() if "standin" not in path.parts and "inside" not in path.parts
    ]
    by_name = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in files
    }
    imports: dict[str, set[str]] = {}
    for name, path in by_name.items():
        nodes = [
            node
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom)
        ]
        package = name.rpartition(".")[0] + "."
        froms = [
            (package * (node.level == 1) + (node.module or ""), [a.name for a in node.names])
            for node in nodes
        ]
        asked = {f"{m}.{n}" if f"{m}.{n}" in by_name else m for m, names in froms for n in names}
        imports[name] = asked & set(by_name) - {name}
    assert len(by_name) > 150
    assert sum(map(len, imports.values())) > 500
    assert len(list(graphlib.TopologicalSorter(imports).static_order())) == len(by_name)
