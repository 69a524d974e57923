"""Submissions written from the lab alone, and a teacher's points for each criterion."""

from __future__ import annotations

import sys
import tarfile
from pathlib import Path

import pytest

from grader.classroom.expectations import compare, load_fixture
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
KEPT = [
    path
    for of in ("teacher", "extension")
    for path in sorted((ROOT / f"tests/{of}_recordings").glob("*.tar.xz"))
]


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.mark.parametrize("kept", KEPT, ids=lambda path: path.name.removesuffix(".tar.xz"))
def test_each_criterion_earns_what_a_teacher_would_give(
    kept: Path, tmp_path: Path, rubric: Rubric
) -> None:
    """The kept sessions and the files give the teacher's points.

    The fixture gives the reason for any exception.
    """
    with tarfile.open(kept) as archive:
        archive.extractall(tmp_path, filter="data")
    fixture = load_fixture(ROOT / "fixtures" / kept.name.removesuffix(".tar.xz"))
    result = judge(open_recordings(tmp_path, rubric), rubric)
    judged = {criterion.id for criterion in (*result.criteria, *result.bonus)}
    assert {"documentation", *fixture.expectation.sessions} <= judged
    assert compare(fixture.expectation, result, rubric).differences == ()


def test_the_kept_recordings_tell_nothing_of_the_machine() -> None:
    """No path of the machine on which they were made stands in them, and they stay small."""
    own = [str(ROOT), sys.prefix, f"{Path.home()}/"]
    for kept in KEPT:
        with tarfile.open(kept) as archive:
            contents = [archive.extractfile(member).read() for member in archive if member.isfile()]  # type: ignore[union-attr]
        assert not [
            name for name in own if any(name.encode() in content for content in contents)
        ], kept
    assert sum(kept.stat().st_size for kept in KEPT) < 4_000_000
