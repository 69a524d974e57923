"""Submissions that were written from the lab alone, with what a teacher would give for each criterion said before."""

from __future__ import annotations

import tarfile
from pathlib import Path

import pytest

from grader.classroom.expectations import compare, load_fixture
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric

ROOT = Path(__file__).parents[2]
KEPT = sorted((ROOT / "tests/recordings/teacher").glob("*.tar.xz"))


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.mark.parametrize("kept", KEPT, ids=lambda path: path.name.removesuffix(".tar.xz"))
def test_each_criterion_earns_what_a_teacher_would_give(kept: Path, tmp_path: Path, rubric: Rubric) -> None:
    """Of what the kept sessions and the files decide; where it does not, the fixture says why."""
    with tarfile.open(kept) as archive:
        archive.extractall(tmp_path, filter="data")
    fixture = load_fixture(ROOT / "fixtures" / kept.name.removesuffix(".tar.xz"))
    result = judge(open_recordings(tmp_path, rubric), rubric)
    judged = {criterion.id for criterion in result.criteria}
    assert {"documentation", *fixture.expectation.sessions} <= judged
    assert compare(fixture.expectation, result, rubric).differences == ()
