"""What a class list adds to results that are there: ids, times of submission, and who is missing."""

from __future__ import annotations

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
    students = list(roster)
    called: dict[str, set[str | None]] = {}
    for student in students:
        for key in _keys(student.student_id, student.name):
            called.setdefault(key, set()).add(student.student_id)
    completed = {entry.name: entry for entry in entries}
    bearing: dict[str, set[str]] = {}
    for entry in entries:
        for key in _keys(entry.student_id, entry.name, _without_id(entry)):
            bearing.setdefault(key, set()).add(entry.name)
    for student in students:
        # Of a download, folders are called after both.
        both = f"{student.name} {student.student_id}" if student.student_id else ""
        keys = _keys(student.student_id, student.name, both)
        # What several entries, or several students, bear does not tell whose they are.
        telling = (key for key in keys if len(bearing.get(key, ())) == 1 and len(called.get(key, ())) < 2)
        found = next((min(bearing[key]) for key in telling), None)
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


def _without_id(entry: ClassEntry) -> str:
    """Return the student's name in a name that ends with the id, as of a download; empty if there is none."""
    return entry.name.removesuffix(f"_{entry.student_id}") if entry.student_id else ""


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
