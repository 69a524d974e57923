"""A validated rubric is read from the cache until something changes that it depends on."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from grader.errors import RubricError
from grader.judging import rubrics
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.lab.rubric import load_rubric


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a small lab with a check of its own, and an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "lab"
    shutil.copytree(lab_folder() / "labs/emergency-brake", folder)
    return folder


def count_kinds(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Return a list that grows with each validation."""
    found: list[object] = []
    kinds = rubrics.rubric_kinds

    def noted() -> object:
        found.append(None)
        return kinds()

    monkeypatch.setattr(rubrics, "rubric_kinds", noted)
    return found


def test_a_rubric_is_validated_once(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rubric of the cache equals a validated one."""
    validations = count_kinds(monkeypatch)
    first = read_rubric(lab / "rubric.yaml")
    again = read_rubric(lab / "rubric.yaml")
    assert again == first == load_rubric(lab / "rubric.yaml", rubrics.rubric_kinds())
    assert len(validations) == 2  # one of them in this test


def test_a_changed_text_is_validated(lab: Path) -> None:
    """A mistake is found although the rubric was valid before."""
    rubric = lab / "rubric.yaml"
    read_rubric(rubric)
    rubric.write_text(rubric.read_text("utf-8") + "mistake: 1\n", encoding="utf-8")
    with pytest.raises(RubricError, match="mistake"):
        read_rubric(rubric)


def test_a_missing_file_is_noticed(lab: Path) -> None:
    """The rubric is the same, and no longer valid."""
    rubric = read_rubric(lab / "rubric.yaml")
    (file,) = {spec.file for spec in rubric.reference.values()}
    (lab / file).unlink()
    with pytest.raises(RubricError):
        read_rubric(lab / "rubric.yaml")
