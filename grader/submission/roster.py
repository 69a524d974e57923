"""A class list: who is in the class, as whom systems know them, and when they handed in.

    name,student_id,submitted_at
    alice,20260017,2026-03-02T23:41:00+01:00

`name` is the submission's name, or the one that a learning-management system wrote. All other columns may be missing:
`student_id`, `login`, `email`, `section`, `team` (those of one team hand in together), `submitted_at`. A time without
offset from UTC is one of the time zone that the rubric's policy names. Of several lines of a student with an id, the
last time counts. What the grade books of Moodle (a grading worksheet, in any language), Canvas, Blackboard and
Brightspace export is such a list too, with a form of its own for each.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from itertools import islice
from pathlib import Path

from grader.errors import SubmissionError
from grader.lab.policy import latest, parse_time
from grader.recording.submission import Identity, Person
from grader.submission.lms.worksheet import WORKSHEET_TIME, columns_of, worksheet_time

_MOST_BYTES = 4 * 1024 * 1024
#: Lines by which columns are known.
_SAMPLE_LINES = 50
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
    #: Without offset from UTC if the list names none.
    submitted_at: datetime | None = None
    #: All that the list knows of them.
    person: Person = field(default_factory=Person)
    #: Who hands in together is of one team.
    team: str = ""
    #: The source of the time, in words.
    time_source: str = ""
    #: A time in a worksheet that could not be read.
    unread_time: str = ""

    @property
    def shown(self) -> str:
        """The name, or the id or login of a student without."""
        return self.name or self.student_id or self.person.login


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
    delimiter = max(",;\t", key=first.count)
    rows = csv.reader(text.splitlines(), delimiter=delimiter)
    try:
        sample = [*islice(csv.reader(text.splitlines(), delimiter=delimiter), 1, _SAMPLE_LINES)]
        columns = columns_of(next(rows, []), sample)
        if not {*_COLUMNS["name"], *_COLUMNS["login"], *_COLUMNS["student_id"]} & {*columns}:
            raise ValueError("there is no column 'name'")
        listed = []
        for row in rows:
            cells = {c: v.strip() for c, v in zip(columns, row, strict=False)}
            if any(cells.values()):
                listed.append(_listed(cells))
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
        before = found.get(key)
        if before is not None and before.submitted_at is not None:
            own = student.submitted_at
            if own is None or latest(own) < latest(before.submitted_at):
                student = replace(
                    student, submitted_at=before.submitted_at, time_source=before.time_source
                )
        found[key] = student
    return list(found.values())


def _listed(row: Mapping[str, str]) -> Student:
    known = {fact: _value(row, columns) for fact, columns in _COLUMNS.items()}
    name = known["name"] or f"{_value(row, _FIRST)} {_value(row, _LAST)}".strip()
    person = Person(**(known | {"name": name, "moodle": _number_in(known["moodle"])}))
    if not (person.name or person.student_id or person.login):
        raise ValueError("neither a name nor a student_id")
    time, source = _submission_time(row)
    unread = row.get(WORKSHEET_TIME, "") if time is None else ""
    return Student(
        name,
        person.student_id or None,
        time,
        person,
        row.get("team", ""),
        source,
        "" if unread == "-" else unread,
    )


def _number_in(participant: str) -> str:
    """Return the number at the end of a text such as "Participant 11" or "Teilnehmer/in11"."""
    number = re.search(r"\d{1,20}$", participant)
    return number[0] if number is not None else participant


def _submission_time(row: Mapping[str, str]) -> tuple[datetime | None, str]:
    """Return when a student handed in, by a column of the list's own or of Moodle's worksheet, and which of the two."""
    text = row.get("submitted_at", "")
    if text:
        time = parse_time(text)
        if time is None:
            raise ValueError(f"{text!r} is not a time")
        time.astimezone(timezone.utc)  # Raises OverflowError for a time that no clock shows.
        return time, "the class list"
    time = worksheet_time(row.get(WORKSHEET_TIME, ""))
    return time, "Moodle's grading worksheet" if time is not None else ""


def _value(row: Mapping[str, str], columns: Iterable[str]) -> str:
    return next((row[column].removeprefix("#") for column in columns if row.get(column)), "")


# -- whose what is -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Match:
    """Whose something that was handed in is, by a class list."""

    student_id: str | None
    submitted_at: datetime | None
    time_source: str
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
        dated = known if known.submitted_at is not None else item
        people = tuple(person_of(students[index]) for index in shares)
        found.append(
            Match(
                known.student_id or item.student_id,
                dated.submitted_at,
                dated.time_source,
                frozenset({*may_be, *shares}),
                people,
                bool(people) and sure is None,
            )
        )
    return found


#: Shorter logins, ids and single names are words of other things too often.
_LEAST_CHARACTERS = 3

#: Something that was handed in, and the names that it bears.
_Item = tuple[Student, Sequence[str]]


def _owners(
    students: Sequence[Student], items: Sequence[_Item]
) -> list[tuple[int | None, set[int]]]:
    """Return the place of each thing's student, None if that does not tell, and of all to whom it may belong."""
    found = _by_whole_names(students, items)
    words = _by_words(students, items)
    certain = {sure for sure, _ in found if sure is not None}
    taken = Counter(sure for (whole, _), (sure, _) in zip(found, words, strict=True) if not whole)
    for n, (sure, may_be) in enumerate(found):
        by_words, candidates = words[n]
        if sure is not None or may_be:
            continue
        if by_words is None or taken[by_words] > 1 or by_words in certain:
            found[n] = None, candidates
        else:
            found[n] = by_words, {by_words}
    return found


def _by_whole_names(
    students: Sequence[Student], items: Sequence[_Item]
) -> list[tuple[int | None, set[int]]]:
    """Find owners by names, logins, ids and addresses that are all of a name that something bears."""
    called = _students_by_key(students)
    bearing = _bearers_by_key(items)
    found: list[tuple[int | None, set[int]]] = []
    for item, names in items:
        own = _keys(item.student_id)
        sure: int | None = None
        may_be: set[int] = set()
        for key in _keys(item.student_id, item.name, *names):
            owners = called.get(key, set())
            may_be |= owners
            is_telling = len(bearing[key]) == 1 or key in own
            if sure is None and is_telling and len(owners) == 1:
                sure = min(owners)
        found.append((sure, may_be))
    return found


def _students_by_key(students: Sequence[Student]) -> dict[str, set[int]]:
    """Return the places of the students for each key that they are known by."""
    called: dict[str, set[int]] = defaultdict(set)
    for index, student in enumerate(students):
        keys = _keys(student.student_id, student.name, *student.person.names)
        if student.name and student.student_id:
            # Folders of a download have the name and the id, e.g. "Ann Lee 4711".
            keys += _keys(f"{student.name} {student.student_id}")
        for key in keys:
            called[key].add(index)
    return called


def _bearers_by_key(items: Sequence[_Item]) -> dict[str, set[str]]:
    """Return the ids, or else the names, of the things that bear each key."""
    bearing: dict[str, set[str]] = defaultdict(set)
    for item, names in items:
        for key in _keys(item.student_id, item.name, *names):
            bearing[key].add(item.student_id or item.name)
    return bearing


def _by_words(
    students: Sequence[Student], items: Sequence[_Item]
) -> list[tuple[int | None, set[int]]]:
    """Find owners by a login or id among the words of a name that something bears, or by all words of their names.

    `Müller_Änne_aemuell_4711` has the login aemuell and the words of "Änne Müller". Logins and names of different
    students do not tell. A login or id among the words of several things, as a year is, tells nothing.
    """
    spoken = [f" {' '.join(map(_plain, (item.name, *names)))} " for item, names in items]
    names = [frozenset(_plain(student.name).split()) for student in students]
    numbers = [_numbers_of(student) for student in students]
    common = _times_spoken(numbers, spoken)
    found: list[tuple[int | None, set[int]]] = []
    for text in spoken:
        by_number, unclear = _numbered_in(text, numbers, common)
        by_name = _named_in(frozenset(text.split()), names)
        found.append(_owner_of(by_number, by_name, unclear))
    return found


def _times_spoken(numbers: Sequence[frozenset[str]], spoken: Sequence[str]) -> dict[str, int]:
    """Return for each login and id among how many texts' words it is."""
    common: dict[str, int] = {}
    for number in frozenset[str]().union(*numbers):
        common[number] = sum(f" {number} " in text for text in spoken)
    return common


def _numbered_in(
    text: str, numbers: Sequence[frozenset[str]], common: Mapping[str, int]
) -> tuple[set[int], set[int]]:
    """Return the students with a login or id in one text only, and those with others that it has."""
    certain: set[int] = set()
    unclear: set[int] = set()
    for index, known in enumerate(numbers):
        here = [number for number in known if f" {number} " in text]
        if any(common[number] == 1 for number in here):
            certain.add(index)
        elif here:
            unclear.add(index)
    return certain, unclear


def _owner_of(
    by_number: set[int], by_name: set[int], unclear: set[int]
) -> tuple[int | None, set[int]]:
    """Return the one student to whom logins or ids, and names, point; None and all of them if there is no such one."""
    both = (by_number | unclear) & by_name
    if len(both) == 1 and by_number <= both:
        return min(both), both
    all_named = by_number | by_name
    if len(all_named) == 1:
        return min(all_named), all_named
    return None, all_named


def _numbers_of(student: Student) -> frozenset[str]:
    """Return the login, id and addresses of a student, as words."""
    mailbox = student.person.email.partition("@")[0]
    texts = (student.student_id or "", student.person.login, student.person.email, mailbox)
    plain = map(_plain, texts)
    return frozenset(text for text in plain if len(text) >= _LEAST_CHARACTERS)


def _named_in(words: frozenset[str], names: Sequence[frozenset[str]]) -> set[int]:
    """Return the students all of whose names are among some words, without names that are a part of another one's."""
    found = set()
    for index, name in enumerate(names):
        if name and name <= words and len("".join(name)) >= _LEAST_CHARACTERS:
            found.add(index)
    return {index for index in found if not any(names[index] < names[other] for other in found)}


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
