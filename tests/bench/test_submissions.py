"""Submissions near a limit are the solution with one file changed."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from bench.submissions import NAMES, NEAR_LIMITS, SOLUTION, write


def test_each_changes_one_file_of_the_solution(tmp_path: Path) -> None:
    """All are valid Python and differ from the solution in the one file that they hand in."""
    write(tmp_path / "class")
    assert sorted(p.name for p in (tmp_path / "class").iterdir()) == sorted(NAMES)
    for near in NEAR_LIMITS:
        (file,) = (tmp_path / "class" / near.name).iterdir()
        text = file.read_text(encoding="utf-8")
        ast.parse(text)
        assert file.name == near.file
        assert text != (SOLUTION / near.file).read_text(encoding="utf-8")


def test_only_what_is_asked_for_is_written(tmp_path: Path) -> None:
    """The submissions of an earlier call are removed."""
    write(tmp_path / "class")
    write(tmp_path / "class", ["jitter_2_ms"])
    assert [p.name for p in (tmp_path / "class").iterdir()] == ["jitter_2_ms"]


def test_a_solution_without_the_text_is_reported(tmp_path: Path) -> None:
    """Where the solution was rewritten, nothing is handed in unchanged by mistake."""
    (tmp_path / "solution").mkdir()
    for file in SOLUTION.glob("*.py"):
        (tmp_path / "solution" / file.name).write_text("print('rewritten')\n", encoding="utf-8")
    with pytest.raises(ValueError, match="rate_98_5_hz"):
        write(tmp_path / "class", solution=tmp_path / "solution")
