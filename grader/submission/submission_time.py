"""Time of a submission in its record."""

from __future__ import annotations

from datetime import datetime

from grader.lab.policy import SubmissionTime, parse_time
from grader.recording.submission import SubmissionRecord

#: The source of a time that earlier versions took from a repository.
_FORMER_COMMIT = "the last commit"


def set_submission_time(record: SubmissionRecord, submission_time: SubmissionTime) -> None:
    """Store the time of a submission in its record."""
    record.submitted_at = _text(submission_time.at)
    record.time_source = submission_time.source
    record.newest_file = _text(submission_time.newest_file)
    record.last_commit = _text(submission_time.last_commit)
    record.marked_late_by = submission_time.marked_late_by


def submission_time_of(record: SubmissionRecord) -> SubmissionTime:
    """Return the time of a recorded submission.

    In records of earlier versions, the time of the last commit can stand as the time of submission. The oldest records
    do not name the source of their time; it can be a file's.
    """
    at = _time(record.submitted_at)
    source = record.time_source
    last_commit = _time(record.last_commit)
    if source == _FORMER_COMMIT:
        at, source, last_commit = None, "", at
    if not source and at is not None:
        source = "an earlier version of grade"
    newest_file = _time(record.newest_file)
    return SubmissionTime(at, source, newest_file, last_commit, record.marked_late_by)


def _text(time: datetime | None) -> str | None:
    return time.isoformat() if time is not None else None


def _time(text: str | None) -> datetime | None:
    return parse_time(text) if text else None
