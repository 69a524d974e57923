"""When a submission was handed in, as its record keeps it."""

from __future__ import annotations

from datetime import datetime

from grader.lab.policy import SubmissionTime, parse_time
from grader.recording.submission import SubmissionRecord


def set_submission_time(record: SubmissionRecord, submission_time: SubmissionTime) -> None:
    """Keep in a record when its submission was handed in."""
    record.submitted_at = _text(submission_time.at)
    record.time_source = submission_time.source
    record.newest_file = _text(submission_time.newest_file)


def submission_time_of(record: SubmissionRecord) -> SubmissionTime:
    """Return when a recorded submission was handed in.

    Records of earlier versions do not name the source of their time, which may be a file's.
    """
    at = _time(record.submitted_at)
    source = record.time_source or ("an earlier version of grade" if at is not None else "")
    return SubmissionTime(at, source, _time(record.newest_file))


def _text(time: datetime | None) -> str | None:
    return time.isoformat() if time is not None else None


def _time(text: str | None) -> datetime | None:
    return parse_time(text) if text else None
