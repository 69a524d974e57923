"""Time of a submission in its record."""

from __future__ import annotations

from datetime import datetime

from grader.lab.policy import SubmissionTime, parse_time
from grader.recording.submission import SubmissionRecord


def set_submission_time(record: SubmissionRecord, submission_time: SubmissionTime) -> None:
    """Store the time of a submission in its record."""
    record.submitted_at = _text(submission_time.at)
    record.time_source = submission_time.source
    record.newest_file = _text(submission_time.newest_file)


def submission_time_of(record: SubmissionRecord) -> SubmissionTime:
    """Return the time of a recorded submission.

    Records of earlier versions do not name the source of their time; it can be a file's.
    """
    at = _time(record.submitted_at)
    source = record.time_source
    if not source and at is not None:
        source = "an earlier version of grade"
    return SubmissionTime(at, source, _time(record.newest_file))


def _text(time: datetime | None) -> str | None:
    return time.isoformat() if time is not None else None


def _time(text: str | None) -> datetime | None:
    return parse_time(text) if text else None
