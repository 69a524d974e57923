"""Every fixture gets the verdict that its expected.yaml states, graded live on a real ROS graph."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from grader import pipeline, result_folder, rubrics
from grader.batch.expectations import Verdict, compare, load_fixture
from grader.judging import judge, open_recordings
from grader.rubric import Rubric
from grader.submission import read_submission_folder
from tests.machine import alone

ROOT = Path(__file__).parents[2]
#: How often a fixture is graded without other tests beside it, where the machine is busy all the same.
MOST_ALONE = 3
FIXTURES = sorted(path.parent for path in (ROOT / "fixtures").glob("*/expected.yaml"))


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


@pytest.mark.live
@pytest.mark.parametrize("folder", FIXTURES, ids=lambda path: path.name)
def test_fixture_gets_its_verdict(folder: Path, tmp_path: Path, rubric: Rubric) -> None:
    """A fixture loses points where its expected.yaml says, and nowhere else."""
    fixture = load_fixture(folder)
    submission = fixture.lay_out(tmp_path)

    def graded() -> Verdict:
        results = tmp_path / "results"
        record = read_submission_folder(submission, rubric)
        record.sessions = list(fixture.expectation.sessions)
        options = pipeline.Options(Path(sys.executable), record.sessions, jobs=1)
        pipeline.record(submission, record, rubric, results, options, lambda progress: None)
        result = judge(open_recordings(results / result_folder.RECORDINGS, rubric), rubric)
        assert result is not None
        return compare(fixture.expectation, result, rubric)

    verdict = graded()
    for _ in range(MOST_ALONE):
        if verdict.undecided:
            # Several tests at a time can be more than the machine takes; undecided is then the right answer.
            with alone():
                verdict = graded()
    assert verdict.differences == ()
