"""A class list: who is in the class, under which number a system knows them, and when they handed in.

    name,student_id,submitted_at
    alice,20260017,2026-03-02T23:41:00+01:00

`name` is the submission's name, or the one that a learning-management system wrote. The other two columns, and their
values, may be missing; there may be more columns. A time without offset from UTC is this machine's local time. Of
several lines of a student with an id, the last time counts.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from grader.errors import SubmissionError
from grader.policy import parse_time

_MOST_BYTES = 4 * 1024 * 1024
_COLUMNS = ("name", "student_id", "submitted_at")


@dataclass(frozen=True)
class Listed:
    """A student of the class.

    Attributes
    ----------
    submitted_at : datetime or None
        With its offset from UTC.
    """

    name: str
    student_id: str | None = None
    submitted_at: datetime | None = None


def read_class_list(path: Path) -> list[Listed]:
    """Read a class list, of values separated by commas, semicolons or tabs.

    Raises
    ------
    SubmissionError
        If it cannot be read, with the first line that is wrong.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as problem:
        raise SubmissionError(
            "the class list cannot be read", where=str(path), remedy=f"It is a CSV file in UTF-8. {problem}"
        ) from None
    first = text.partition("\n")[0]
    rows = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count))
    try:
        columns = [column.strip().lower().replace(" ", "_") for column in next(rows, [])]
        if "name" not in columns:
            raise ValueError("there is no column 'name'")
        filled = (row for row in rows if any(cell.strip() for cell in row))
        return _once_each(_listed(dict(zip(columns, row, strict=False))) for row in filled)
    except (ValueError, csv.Error) as problem:
        raise SubmissionError(
            f"the class list is not usable: {problem}",
            where=f"{path}:{rows.line_num}",
            remedy=f"Its columns are {', '.join(_COLUMNS)}; times are like 2026-03-02T23:41:00+01:00.",
        ) from None


def _once_each(listed: Iterable[Listed]) -> list[Listed]:
    """Return each student with an id once, with the last time, as of a list with a line for each hand-in."""
    found: dict[tuple[str, str | None, int], Listed] = {}
    for number, student in enumerate(listed):
        key = (student.name, student.student_id, 0 if student.student_id else number)
        times = [s.submitted_at for s in (found.get(key), student) if s is not None and s.submitted_at is not None]
        found[key] = replace(student, submitted_at=max(times, default=None))
    return list(found.values())


def _listed(row: dict[str, str]) -> Listed:
    name, student_id, time = (row.get(column, "").strip() for column in _COLUMNS)
    if not name and not student_id:
        raise ValueError("neither a name nor a student_id")
    submitted_at = parse_time(time) if time else None
    if time and submitted_at is None:
        raise ValueError(f"{time!r} is no time")
    return Listed(name, student_id or None, submitted_at.astimezone() if submitted_at is not None else None)
