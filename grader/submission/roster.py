"""A class list: who is in the class, as whom systems know them, and when they handed in.

    name,student_id,submitted_at
    alice,20260017,2026-03-02T23:41:00+01:00

`name` is the submission's name, or the one that a learning-management system wrote. All other columns may be missing:
`student_id`, `login`, `email`, `section`, `team` (those of one team hand in together), `submitted_at`. A time without
offset from UTC is local. Of several lines of a student with an id, the last time counts. What the grade books of
Moodle, Canvas, Blackboard and Brightspace export is such a list too, with a form of its own for each.
"""

from __future__ import annotations

import csv
import unicodedata
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from grader.errors import SubmissionError
from grader.lab.policy import parse_time
from grader.recording.submission import Identity, Person

_MOST_BYTES = 4 * 1024 * 1024
#: What is known of a person -> how columns with it are called, in lower case, with underscores for blanks.
_COLUMNS = {
    "name": ("name", "full_name", "student"),
    "student_id": ("student_id", "id_number", "sis_user_id", "orgdefinedid"),
    "login": ("login", "username", "sis_login_id"),
    "email": ("email", "email_address"),
    "section": ("section",),
    "moodle": ("identifier",),
    "canvas": ("id",),
}
_FIRST, _LAST = ("first_name", "firstname"), ("last_name", "lastname", "surname")
#: What stands in the column of names in a line of Canvas' export that is about no student.
_POINTS_POSSIBLE = "Points Possible"


@dataclass(frozen=True)
class Student:
    """A student of the class."""

    name: str
    student_id: str | None = None
    #: With its offset from UTC.
    submitted_at: datetime | None = None
    #: All that the list knows of them.
    person: Person = field(default_factory=Person)
    #: Who hands in together is of one team.
    team: str = ""


def read_class_list(path: Path) -> list[Student]:
    """Read a class list, of values separated by commas, semicolons or tabs.

    Raises SubmissionError if it cannot be read, with the first line that is wrong.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES)
        text = content.decode(
            "utf-16" if content.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig"
        )
    except (OSError, UnicodeDecodeError) as problem:
        raise SubmissionError(
            "the class list cannot be read",
            location=str(path),
            remedy=f"It is a CSV file in UTF-8. {problem}",
        ) from None
    first = text.partition("\n")[0]
    rows = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count))
    try:
        columns = [column.strip().lower().replace(" ", "_") for column in next(rows, [])]
        if not {*_COLUMNS["name"], *_COLUMNS["login"], *_COLUMNS["student_id"]} & {*columns}:
            raise ValueError("there is no column 'name'")
        filled = (row for row in rows if any(cell.strip() for cell in row))
        listed = (
            _listed({c: v.strip() for c, v in zip(columns, row, strict=False)}) for row in filled
        )
        return _once_each(student for student in listed if student.name != _POINTS_POSSIBLE)
    except (ValueError, OverflowError, csv.Error) as problem:
        raise SubmissionError(
            f"the class list is not usable: {problem}",
            location=f"{path}:{rows.line_num}",
            remedy="Its columns are name, student_id, login, email, section, team, submitted_at; times are like "
            "2026-03-02T23:41:00+01:00.",
        ) from None


def _once_each(listed: Iterable[Student]) -> list[Student]:
    """Return each student with an id once, with the last time, as of a list with a line for each hand-in."""
    found: dict[tuple[str, str | None, int], Student] = {}
    for number, student in enumerate(listed):
        key = (student.name, student.student_id, 0 if student.student_id else number)
        times = [
            s.submitted_at
            for s in (found.get(key), student)
            if s is not None and s.submitted_at is not None
        ]
        found[key] = replace(student, submitted_at=max(times, default=None))
    return list(found.values())


def _listed(row: Mapping[str, str]) -> Student:
    known = {fact: _value(row, columns) for fact, columns in _COLUMNS.items()}
    name = known["name"] or f"{_value(row, _FIRST)} {_value(row, _LAST)}".strip()
    person = Person(**(known | {"name": name, "moodle": known["moodle"].rpartition(" ")[2]}))
    time = row.get("submitted_at", "")
    if not (person.name or person.student_id or person.login):
        raise ValueError("neither a name nor a student_id")
    submitted_at = parse_time(time) if time else None
    if time and submitted_at is None:
        raise ValueError(f"{time!r} is not a time")
    moment = submitted_at.astimezone() if submitted_at is not None else None
    return Student(name, person.student_id or None, moment, person, row.get("team", ""))


def _value(row: Mapping[str, str], columns: Iterable[str]) -> str:
    return next((row[column].removeprefix("#") for column in columns if row.get(column)), "")


# -- whose what is -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Match:
    """Whose something that was handed in is, by a class list."""

    student_id: str | None
    submitted_at: datetime | None
    #: Places in the list of all that it may belong to.
    may_be: frozenset[int]
    #: Of whom it is, if that is certain: the student, and the others of the team; or a team of whom nobody is known to
    #: be the one who handed it in.
    people: tuple[Person, ...] = ()
    is_of_team: bool = False

    def completed(self, identity: Identity) -> Identity:
        """Return with what the list knows who handed something in."""
        if self.is_of_team:
            return replace(identity, people=self.people)
        return Identity(self.people).completed(identity)


def matches(
    students: Sequence[Student], items: Sequence[tuple[Student, Sequence[str]]]
) -> list[Match]:
    """Find the student of each thing that was handed in, by the id, the name and others that it bears, however written.

    A name that two students have, or that two things bear under different ids, does not tell whose they are. All of a
    student's team, or of the team whose name it bears, have a share in it, unless that team handed in another too.
    """
    teams: dict[str, list[int]] = defaultdict(list)
    for index, student in enumerate(students):
        if student.team:
            teams[_plain(student.team)].append(index)
    owners = _owners(students, items)
    of_team = [
        _plain(students[sure].team)
        if sure is not None
        else next((t for t in map(_plain, names) if t in teams), "")
        for (sure, _), (item, others) in zip(owners, items, strict=True)
        for names in [(item.name, *others)]
    ]
    found = []
    for (item, _), (sure, may_be), team in zip(items, owners, of_team, strict=True):
        known = students[sure] if sure is not None else Student("")
        members = teams[team] if team and of_team.count(team) == 1 else ()
        shares = dict.fromkeys([*([] if sure is None else [sure]), *members])
        student_id, time = (
            known.student_id or item.student_id,
            known.submitted_at or item.submitted_at,
        )
        people = tuple(person_of(students[index]) for index in shares)
        found.append(
            Match(
                student_id,
                time,
                frozenset({*may_be, *shares}),
                people,
                bool(people) and sure is None,
            )
        )
    return found


def _owners(
    students: Sequence[Student], items: Sequence[tuple[Student, Sequence[str]]]
) -> list[tuple[int | None, set[int]]]:
    """Return the place of each thing's student, None if that does not tell, and of all to whom it may belong."""
    called: dict[str, set[int]] = defaultdict(set)
    for index, student in enumerate(students):
        # Of a download, folders are called after both.
        both = f"{student.name} {student.student_id}" if student.name and student.student_id else ""
        for key in _keys(student.student_id, student.name, *student.person.names, both):
            called[key].add(index)
    bearing: dict[str, set[str]] = defaultdict(set)
    for item, names in items:
        for key in _keys(item.student_id, item.name, *names):
            bearing[key].add(item.student_id or item.name)
    found: list[tuple[int | None, set[int]]] = []
    for item, names in items:
        keys = [key for key in _keys(item.student_id, item.name, *names) if key in called]
        telling = [key for key in keys if len(bearing[key]) == 1 or key in _keys(item.student_id)]
        sure = next((min(called[key]) for key in telling if len(called[key]) == 1), None)
        found.append((sure, {index for key in keys for index in called[key]}))
    return found


def person_of(student: Student) -> Person:
    """Return all that a list says of a student."""
    return Person(student.name, student.student_id or "").completed(student.person)


def _keys(*texts: str | None) -> list[str]:
    """Return by what a student is known: first each text as it is written, then what a folder's name keeps of it.

    "Surname, First" is the same as "First Surname".
    """
    given = [unicodedata.normalize("NFC", text) for text in texts if text]
    given += [
        f"{first} {last}"
        for last, comma, first in (text.partition(", ") for text in given)
        if comma
    ]
    return [
        *(f"={text.casefold()}" for text in given),
        *(plain for text in given if (plain := _plain(text))),
    ]


def _plain(text: str) -> str:
    """Return the words of a text, of letters with their marks, and of digits."""
    return " ".join(
        "".join(c if unicodedata.category(c)[0] in "LMN" else " " for c in text).split()
    ).casefold()
