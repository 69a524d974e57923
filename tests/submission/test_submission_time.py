"""The time of a submission in its record."""

from __future__ import annotations

from datetime import UTC, datetime

from grader.lab.policy import SubmissionTime
from grader.recording.submission import SubmissionRecord
from grader.submission.submission_time import set_submission_time, submission_time_of

NOON = datetime(2026, 11, 20, 12, tzinfo=UTC)


def test_all_that_is_known_is_kept() -> None:
    """A record gives back the times and marks that it was given."""
    known = SubmissionTime(NOON, "the class list", datetime(2026, 11, 19), NOON, "Canvas")
    record = SubmissionRecord("alice")
    set_submission_time(record, known)
    assert submission_time_of(record) == known
    set_submission_time(record, SubmissionTime())
    assert submission_time_of(record) == SubmissionTime()


def test_a_commit_of_an_earlier_version_proves_nothing() -> None:
    """Earlier versions recorded the last commit as the time of submission."""
    former = SubmissionRecord("alice", submitted_at=NOON.isoformat(), time_source="the last commit")
    assert submission_time_of(former) == SubmissionTime(last_commit=NOON)
