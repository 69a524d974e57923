"""A class list: the students of a class, their names in other systems, and their times of submission.

    name,student_id,submitted_at
    alice,20260017,2026-03-02T23:41:00+01:00

`name` is the submission's name, or the name in a learning-management system. All other columns are optional:
`student_id`, `login`, `email`, `section`, `team` (a team submits together), `language` (of the report and of mails, such
as `de`), `submitted_at`. A time without offset from
UTC is in the time zone of the rubric's policy. Of several lines of a student with an id, the last time counts. Exports
of the grade books of Moodle (a grading worksheet, in any language), Canvas, Blackboard and Brightspace are class lists
too, each in its own form.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

from grader.errors import SubmissionError
from grader.lab.policy import latest, parse_time
from grader.languages.catalogue import tag_of
from grader.recording.submission import Identity, Person
from grader.submission.lms.worksheet import WORKSHEET_TIME, columns_of, worksheet_time

_MOST_BYTES = 4 * 1024 * 1024
#: Lines by which columns are recognised.
_SAMPLE_LINES = 50
#: Columns for each fact about a person, in lower case, with underscores for blanks.
_COLUMNS = {
    "name": ("name", "full_name", "student"),
    "student_id": ("student_id", "id_number", "sis_user_id", "orgdefinedid"),
    "login": ("login", "username", "sis_login_id"),
    "email": ("email", "email_address"),
    "section": ("section",),
    "moodle": ("identifier",),
    "canvas": ("id",),
    "language": ("language", "lang"),
}
_FIRST = ("first_name", "firstname")
_LAST = ("last_name", "lastname", "surname")
#: Name in a line of Canvas' export that describes no student.
_POINTS_POSSIBLE = "Points Possible"
#: Characters from which a login, an id or a single name counts; shorter ones are often words of something else.
_LEAST_CHARACTERS = 3


@dataclass(frozen=True)
class Student:
    """A student of the class."""

    name: str
    student_id: str | None = None
    #: Without offset from UTC if the list has none.
    submitted_at: datetime | None = None
    #: All facts of the list.
    person: Person = field(default_factory=Person)
    #: Name of the team that submits together.
    team: str = ""
    #: The source of the time, in words.
    time_source: str = ""
    #: A time in a worksheet that could not be read.
    unread_time: str = ""

    @property
    def shown(self) -> str:
        """The name, or the id or login of a student without a name."""
        return self.name or self.student_id or self.person.login


def read_class_list(path: Path) -> list[Student]:
    """Read a class list of values separated by commas, semicolons or tabs.

    Raises SubmissionError, with the first wrong line, if it cannot be read.
    """
    text = _text_of(path)
    first = text.partition("\n")[0]
    delimiter = max(",;\t", key=first.count)
    rows = csv.reader(text.splitlines(), delimiter=delimiter)
    try:
        sample = islice(csv.reader(text.splitlines(), delimiter=delimiter), 1, _SAMPLE_LINES)
        columns = columns_of(next(rows, []), list(sample))
        return _once_each(_students_in(rows, columns))
    except (ValueError, OverflowError, csv.Error) as problem:
        raise SubmissionError(
            f"the class list is not usable: {problem}",
            location=f"{path}:{rows.line_num}",
            remedy="Its columns are name, student_id, login, email, section, team, language, submitted_at; times are like "
            "2026-03-02T23:41:00+01:00.",
        ) from None


def _text_of(path: Path) -> str:
    """Return the text of a class list; raises SubmissionError if it cannot be read."""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES)
        is_utf_16 = content.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
        return content.decode("utf-16" if is_utf_16 else "utf-8-sig")
    except (OSError, UnicodeDecodeError) as problem:
        raise SubmissionError(
            "the class list cannot be read",
            location=str(path),
            remedy=f"It is a CSV file in UTF-8. {problem}",
        ) from None


def _students_in(rows: Iterable[Sequence[str]], columns: Sequence[str]) -> Iterator[Student]:
    """Yield the students of a list; raises ValueError for the first wrong row."""
    naming = {*_COLUMNS["name"], *_COLUMNS["login"], *_COLUMNS["student_id"]}
    if naming.isdisjoint(columns):
        raise ValueError("there is no column 'name'")
    for row in rows:
        cells = dict(zip(columns, map(str.strip, row), strict=False))
        if any(cells.values()):
            student = _listed(cells)
            if student.name != _POINTS_POSSIBLE:
                yield student


def _once_each(listed: Iterable[Student]) -> list[Student]:
    """Return each student with an id once, with the last time; a list can have a line for each submission."""
    found: dict[tuple[str, str | None, int], Student] = {}
    for number, student in enumerate(listed):
        line = 0 if student.student_id else number
        key = (student.name, student.student_id, line)
        previous = found.get(key)
        if previous is not None:
            student = _with_last_time(student, previous)
        found[key] = student
    return list(found.values())


def _with_last_time(student: Student, previous: Student) -> Student:
    """Return a student with the later of the times in two lines."""
    own = student.submitted_at
    time = previous.submitted_at
    if time is None:
        return student
    if own is not None and latest(own) >= latest(time):
        return student
    return replace(student, submitted_at=time, time_source=previous.time_source)


def _listed(row: Mapping[str, str]) -> Student:
    facts = {fact: _value(row, columns) for fact, columns in _COLUMNS.items()}
    if not facts["name"]:
        facts["name"] = f"{_value(row, _FIRST)} {_value(row, _LAST)}".strip()
    facts["moodle"] = _number_in(facts["moodle"])
    facts["language"] = tag_of(facts["language"])
    person = Person(**facts)
    if not (person.name or person.student_id or person.login):
        raise ValueError("neither a name nor a student_id")
    time, source = _submission_time(row)
    unread = ""
    if time is None:
        unread = row.get(WORKSHEET_TIME, "")
    if unread == "-":
        unread = ""
    team = row.get("team", "")
    return Student(person.name, person.student_id or None, time, person, team, source, unread)


def _number_in(participant: str) -> str:
    """Return the number at the end of a text such as "Participant 11" or "Teilnehmer/in11"."""
    number = re.search(r"\d{1,20}$", participant)
    return number[0] if number is not None else participant


def _submission_time(row: Mapping[str, str]) -> tuple[datetime | None, str]:
    """Return a student's time of submission, from a column of the list itself or of Moodle's worksheet, and its source."""
    text = row.get("submitted_at", "")
    if text:
        time = parse_time(text)
        if time is None:
            raise ValueError(f"{text!r} is not a time")
        # Raises OverflowError for a time that no clock shows.
        time.astimezone(UTC)
        return time, "the class list"
    time = worksheet_time(row.get(WORKSHEET_TIME, ""))
    if time is None:
        return None, ""
    return time, "Moodle's grading worksheet"


def _value(row: Mapping[str, str], columns: Iterable[str]) -> str:
    """Return the first value of a row in some columns; ids of Brightspace begin with `#`."""
    for column in columns:
        if row.get(column):
            return row[column].removeprefix("#")
    return ""


# -- owners of submissions ---------------------------------------------------------------------


@dataclass(frozen=True)
class Match:
    """The owner of a submission, by a class list."""

    student_id: str | None
    submitted_at: datetime | None
    time_source: str
    #: Indexes in the list of all possible owners.
    may_be: frozenset[int]
    #: Certain owners: a student with their team, or a team without a known submitter.
    people: tuple[Person, ...] = ()
    is_of_team: bool = False

    def completed(self, identity: Identity) -> Identity:
        """Return an identity with the facts of the list."""
        if self.is_of_team:
            return replace(identity, people=self.people)
        return Identity(self.people).completed(identity)


def matches(
    students: Sequence[Student], items: Sequence[tuple[Student, Sequence[str]]]
) -> list[Match]:
    """Find the owner of each submission by its id, its name and other names, in any notation.

    A name of two students, or of two submissions with different ids, does not tell the owner. The members of the
    student's team, or of a team with the submission's name, own it too, unless the team has another submission.

    Parameters
    ----------
    students
        The class list.
    items
        Facts and other names of each submission.
    """
    teams = _members_of_teams(students)
    owners = _owners(students, items)
    of_team = []
    for (item, others), (owner, _) in zip(items, owners, strict=True):
        if owner is not None:
            of_team.append(_plain(students[owner].team))
        else:
            of_team.append(_team_named((item.name, *others), teams))
    found = []
    for (item, _), (owner, may_be), team in zip(items, owners, of_team, strict=True):
        shares = [] if owner is None else [owner]
        if team and of_team.count(team) == 1:
            shares += teams[team]
        known = Student("")
        if owner is not None:
            known = students[owner]
        people = tuple(person_of(students[index]) for index in dict.fromkeys(shares))
        dated = known if known.submitted_at is not None else item
        student_id = known.student_id or item.student_id
        possible = frozenset({*may_be, *shares})
        is_team = bool(people) and owner is None
        found.append(
            Match(student_id, dated.submitted_at, dated.time_source, possible, people, is_team)
        )
    return found


def _members_of_teams(students: Sequence[Student]) -> dict[str, list[int]]:
    """Return the indexes of each team's members."""
    teams: dict[str, list[int]] = defaultdict(list)
    for index, student in enumerate(students):
        if student.team:
            teams[_plain(student.team)].append(index)
    return teams


def _team_named(names: Iterable[str], teams: Mapping[str, object]) -> str:
    """Return the first of some names that is a team's; empty if none is."""
    for name in map(_plain, names):
        if name in teams:
            return name
    return ""


#: Facts of a submission, and its other names.
_Item = tuple[Student, Sequence[str]]
#: Index of the owner in the class list if it is certain, and the indexes of all possible owners.
_Owner = tuple[int | None, set[int]]


def _owners(students: Sequence[Student], items: Sequence[_Item]) -> list[_Owner]:
    """Return the owner of each submission, by whole names, else by words."""
    found = _by_whole_names(students, items)
    words = _by_words(students, items)
    certain = {owner for owner, _ in found if owner is not None}
    taken: Counter[int | None] = Counter()
    for (whole, _), (by_words, _) in zip(found, words, strict=True):
        if not whole:
            taken[by_words] += 1
    for n, (owner, may_be) in enumerate(found):
        if owner is not None or may_be:
            continue
        by_words, candidates = words[n]
        is_claimed = taken[by_words] > 1 or by_words in certain
        if by_words is None or is_claimed:
            found[n] = None, candidates
        else:
            found[n] = by_words, {by_words}
    return found


def _by_whole_names(students: Sequence[Student], items: Sequence[_Item]) -> list[_Owner]:
    """Find owners by names, logins, ids and addresses that equal a whole name of a submission."""
    called = _students_by_key(students)
    bearing = _bearers_by_key(items)
    found: list[_Owner] = []
    for item, names in items:
        own = _keys(item.student_id)
        certain: int | None = None
        may_be: set[int] = set()
        for key in _keys(item.student_id, item.name, *names):
            owners = called.get(key, set())
            may_be |= owners
            is_telling = len(bearing[key]) == 1 or key in own
            if is_telling and len(owners) == 1 and certain is None:
                certain = min(owners)
        found.append((certain, may_be))
    return found


def _students_by_key(students: Sequence[Student]) -> dict[str, set[int]]:
    """Return the indexes of the students with each key."""
    called: dict[str, set[int]] = defaultdict(set)
    for index, student in enumerate(students):
        keys = _keys(student.student_id, student.name, *student.person.names)
        if student.name and student.student_id:
            # Folders of a download have the name and the id, such as "Ann Lee 4711".
            keys += _keys(f"{student.name} {student.student_id}")
        for key in keys:
            called[key].add(index)
    return called


def _bearers_by_key(items: Sequence[_Item]) -> dict[str, set[str]]:
    """Return the ids, or else the names, of the submissions with each key."""
    bearing: dict[str, set[str]] = defaultdict(set)
    for item, names in items:
        for key in _keys(item.student_id, item.name, *names):
            bearing[key].add(item.student_id or item.name)
    return bearing


def _by_words(students: Sequence[Student], items: Sequence[_Item]) -> list[_Owner]:
    """Find owners by a login or id among the words of a submission's names, or by all words of the owner's name.

    For example `Müller_Änne_aemuell_4711` has the login aemuell and the words of "Änne Müller". Logins and names of
    different students tell no owner. Neither does a login or id among the words of several submissions, such as a year.
    """
    spoken = []
    for item, others in items:
        words = " ".join(map(_plain, (item.name, *others)))
        spoken.append(f" {words} ")
    names = [frozenset(_plain(student.name).split()) for student in students]
    numbers = [_numbers_of(student) for student in students]
    common = _times_spoken(numbers, spoken)
    found: list[_Owner] = []
    for text in spoken:
        by_number, unclear = _numbered_in(text, numbers, common)
        by_name = _named_in(frozenset(text.split()), names)
        found.append(_owner_of(by_number, by_name, unclear))
    return found


def _times_spoken(numbers: Sequence[frozenset[str]], spoken: Sequence[str]) -> dict[str, int]:
    """Return the number of texts with each login and id among their words."""
    common: dict[str, int] = {}
    for number in frozenset[str]().union(*numbers):
        common[number] = sum(f" {number} " in text for text in spoken)
    return common


def _numbered_in(
    text: str, numbers: Sequence[frozenset[str]], common: Mapping[str, int]
) -> tuple[set[int], set[int]]:
    """Return the students with a login or id in this text only, and students with one in other texts too."""
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
    """Return the only student named by logins or ids, and by names; None and all named students if there is none."""
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
    """Return the students with their whole name among some words; a name within another student's does not count."""
    found = set()
    for index, name in enumerate(names):
        is_long_enough = len("".join(name)) >= _LEAST_CHARACTERS
        if name and name <= words and is_long_enough:
            found.add(index)
    within = set()
    for index in found:
        if any(names[index] < names[other] for other in found):
            within.add(index)
    return found - within


def person_of(student: Student) -> Person:
    """Return all facts of a list about a student."""
    return Person(student.name, student.student_id or "").completed(student.person)


def _keys(*texts: str | None) -> list[str]:
    """Return the keys of a student: each text as it is written, then each as the name of a folder keeps it.

    "Surname, First" has the keys of "First Surname" too.
    """
    given = [unicodedata.normalize("NFC", text) for text in texts if text]
    for text in tuple(given):
        last, comma, first = text.partition(", ")
        if comma:
            given.append(f"{first} {last}")
    keys = [f"={text.casefold()}" for text in given]
    keys += filter(None, map(_plain, given))
    return keys


def _plain(text: str) -> str:
    """Return the words of a text: letters with their marks, and digits."""
    kept = []
    for character in text:
        is_of_word = unicodedata.category(character)[0] in "LMN"
        kept.append(character if is_of_word else " ")
    return " ".join("".join(kept).split()).casefold()
