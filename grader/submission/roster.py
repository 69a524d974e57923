"""A class list: who is in the class, under which number a system knows them, and when they handed in.

    name,student_id,submitted_at
    alice,20260017,2026-03-02T23:41:00+01:00

`name` is the submission's name, or the one that a learning-management system wrote. The other two columns, and their
values, may be missing; there may be more columns. A time without offset from UTC is this machine's local time. Of
several lines of a student with an id, the last time counts.
"""

from __future__ import annotations

import csv
import unicodedata
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from grader.errors import SubmissionError
from grader.lab.policy import parse_time

_MOST_BYTES = 4 * 1024 * 1024
_COLUMNS = ("name", "student_id", "submitted_at")


@dataclass(frozen=True)
class Student:
    """A student of the class."""

    name: str
    student_id: str | None = None
    #: With its offset from UTC.
    submitted_at: datetime | None = None


def read_class_list(path: Path) -> list[Student]:
    """Read a class list, of values separated by commas, semicolons or tabs.

    Raises SubmissionError if it cannot be read, with the first line that is wrong.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as problem:
        raise SubmissionError(
            "the class list cannot be read", location=str(path), remedy=f"It is a CSV file in UTF-8. {problem}"
        ) from None
    first = text.partition("\n")[0]
    rows = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count))
    try:
        columns = [column.strip().lower().replace(" ", "_") for column in next(rows, [])]
        if "name" not in columns:
            raise ValueError("there is no column 'name'")
        filled = (row for row in rows if any(cell.strip() for cell in row))
        return _once_each(_listed(dict(zip(columns, row, strict=False))) for row in filled)
    except (ValueError, OverflowError, csv.Error) as problem:
        raise SubmissionError(
            f"the class list is not usable: {problem}",
            location=f"{path}:{rows.line_num}",
            remedy=f"Its columns are {', '.join(_COLUMNS)}; times are like 2026-03-02T23:41:00+01:00.",
        ) from None


def _once_each(listed: Iterable[Student]) -> list[Student]:
    """Return each student with an id once, with the last time, as of a list with a line for each hand-in."""
    found: dict[tuple[str, str | None, int], Student] = {}
    for number, student in enumerate(listed):
        key = (student.name, student.student_id, 0 if student.student_id else number)
        times = [s.submitted_at for s in (found.get(key), student) if s is not None and s.submitted_at is not None]
        found[key] = replace(student, submitted_at=max(times, default=None))
    return list(found.values())


def _listed(row: dict[str, str]) -> Student:
    name, student_id, time = (row.get(column, "").strip() for column in _COLUMNS)
    if not name and not student_id:
        raise ValueError("neither a name nor a student_id")
    submitted_at = parse_time(time) if time else None
    if time and submitted_at is None:
        raise ValueError(f"{time!r} is not a time")
    return Student(name, student_id or None, submitted_at.astimezone() if submitted_at is not None else None)


# -- whose what is -----------------------------------------------------------------------------


def matches(
    students: Sequence[Student], items: Sequence[tuple[Student, Sequence[str]]]
) -> list[tuple[Student, int | None, frozenset[int]]]:
    """Find the student of each thing that was handed in, by the id, the name and others that it bears, however written.

    Returns for each what is known of its student, their place in the list, None if that does not tell, and the
    places of all that it may belong to. A name that two students have, or that two things bear under different ids,
    does not tell whose they are.
    """
    called: dict[str, set[int]] = defaultdict(set)
    for index, student in enumerate(students):
        # Of a download, folders are called after both.
        both = f"{student.name} {student.student_id}" if student.name and student.student_id else ""
        for key in _keys(student.student_id, student.name, both):
            called[key].add(index)
    bearing: dict[str, set[str]] = defaultdict(set)
    for item, names in items:
        for key in _keys(item.student_id, item.name, *names):
            bearing[key].add(item.student_id or item.name)
    found: list[tuple[Student, int | None, frozenset[int]]] = []
    for item, names in items:
        keys = [key for key in _keys(item.student_id, item.name, *names) if key in called]
        telling = [key for key in keys if len(bearing[key]) == 1 or key in _keys(item.student_id)]
        sure = next((min(called[key]) for key in telling if len(called[key]) == 1), None)
        known = students[sure] if sure is not None else Student("")
        student_id, time = known.student_id or item.student_id, known.submitted_at or item.submitted_at
        found.append((Student(item.name, student_id, time), sure, frozenset(i for key in keys for i in called[key])))
    return found


def _keys(*texts: str | None) -> list[str]:
    """Return by what a student is known: first each text as it is written, then what a folder's name keeps of it.

    "Surname, First" is the same as "First Surname".
    """
    given = [unicodedata.normalize("NFC", text) for text in texts if text]
    given += [f"{first} {last}" for last, comma, first in (text.partition(", ") for text in given) if comma]
    return [*(f"={text.casefold()}" for text in given), *(plain for text in given if (plain := _plain(text)))]


def _plain(text: str) -> str:
    """Return the words of a text, of letters with their marks, and of digits."""
    return " ".join("".join(c if unicodedata.category(c)[0] in "LMN" else " " for c in text).split()).casefold()
