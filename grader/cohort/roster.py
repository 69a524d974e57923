"""What a class list adds to results that are there: ids, times of submission, and who is missing."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from grader.cohort.entries import ClassEntry

NOTHING_HANDED_IN = "There is no result under this name: nothing was handed in, or under another name."


@dataclass(frozen=True)
class Student:
    """Someone on the list."""

    name: str
    student_id: str | None = None
    submitted_at: datetime | None = None


def with_roster(entries: Sequence[ClassEntry], roster: Iterable[Student]) -> list[ClassEntry]:
    """Return the entries with what a list knows of them, and one for each student of it who has none, by name.

    Parameters
    ----------
    roster : iterable of Student
        An entry is a student's if it bears the student's id, name, or both, in whatever case and however parted.
    """
    completed = {entry.name: entry for entry in entries}
    known: dict[str, str] = {}
    for entry in entries:
        for text in (entry.student_id, entry.name):
            if text and (key := _key(text)):
                known.setdefault(key, entry.name)
    for student in roster:
        # Of a download, folders are called after both.
        both = f"{student.name} {student.student_id}" if student.student_id else ""
        keys = [_key(text) for text in (student.student_id, student.name, both) if text]
        found = next((known[key] for key in keys if key in known), None)
        if found is None:
            name = student.name or student.student_id or ""
            missing = ClassEntry(name, None, NOTHING_HANDED_IN, "", student.submitted_at, student.student_id)
            completed.setdefault(name, missing)
        else:
            entry = completed[found]
            completed[found] = replace(
                entry,
                submitted_at=student.submitted_at or entry.submitted_at,
                student_id=student.student_id or entry.student_id,
            )
    return sorted(completed.values(), key=lambda entry: entry.name)


def _key(name: str) -> str:
    """Return what is the same of a name and of the folder that is called after it."""
    return " ".join(re.findall(r"[^\W_]+", unicodedata.normalize("NFC", name))).casefold()
