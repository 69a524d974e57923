"""Jobs and endings as they travel between processes."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import pytest

from confine.isolation import Isolation, Level
from grader.classroom.job import Job, problem_of
from grader.errors import GraderError, RubricError, SubmissionError
from grader.judging.rubrics import read_rubric
from grader.pipeline import Options
from grader.submission.extraction import SubmissionSource


def test_a_job_arrives_as_it_was_sent(tmp_path: Path) -> None:
    """Rubric, options and submission are the same on the other side."""
    source = SubmissionSource.of(tmp_path)
    job = Job(
        source,
        tmp_path,
        read_rubric(None),
        Options(Path(sys.executable), ["qos"]),
        Isolation(Level.FULL),
    )
    assert pickle.loads(pickle.dumps(job)) == job


def test_problems_arrive() -> None:
    """A problem arrives whole on the other side, but with its text cut to a bound."""
    problem = problem_of(SubmissionError("it broke", location="a.py", remedy="mend it"))
    arrived = pickle.loads(pickle.dumps(problem))
    assert (vars(arrived), arrived.exit_status) == (vars(problem), 3)
    assert len(problem_of(GraderError("x" * 10**6)).problem) < 10_000


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (
            SubmissionError("it is empty", location="ann", remedy="fill it"),
            ("it is empty", "ann", "fill it", 3),
        ),
        (GraderError("it broke"), ("it broke", "", "", 70)),
        (
            RubricError("two mistakes", ["a.yaml:1: one", "a.yaml:2: two"], location="a.yaml"),
            ("two mistakes; a.yaml:1: one; a.yaml:2: two", "a.yaml", "", 4),
        ),
    ],
)
def test_errors_keep_their_words_and_their_exit_status(
    error: GraderError, expected: tuple[str, str, str, int]
) -> None:
    """An error of a submission says the same in a class as it does alone."""
    found = problem_of(error)
    assert (found.problem, found.location, found.remedy, found.exit_status) == expected


def test_a_full_disk_is_named() -> None:
    """An error of the system has its reason, its file and a remedy."""
    told = problem_of(OSError(28, "No space left on device", "/results/ann"))
    assert (told.problem, told.location, told.exit_status) == (
        "No space left on device",
        "/results/ann",
        70,
    )
    assert "disk" in told.remedy


def test_a_mistake_of_the_grader_is_called_one() -> None:
    """Anything unforeseen is told with its kind."""
    told = problem_of(KeyError("x"))
    assert "KeyError" in told.problem
    assert "defect of grade" in told.remedy
