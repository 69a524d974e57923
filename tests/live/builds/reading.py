"""Records of folders with packages."""

from __future__ import annotations

from pathlib import Path

from grader.recording.submission import SubmissionRecord
from grader.submission.artifacts import collect_files
from grader.submission.packages.colcon import find_packages


def read(folder: Path) -> SubmissionRecord:
    """Return the record of a folder with packages."""
    record = SubmissionRecord("x")
    collect_files(folder, record)
    record.packages = find_packages(record.texts, [file.path for file in record.files])
    return record
