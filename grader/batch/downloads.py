"""How learning-management systems name what they pack into one download.

- Moodle: `Full Name_12345_assignsubmission_file_/lab.zip`, or without folders `..._file_lab.zip`. Underscores in
  names have become spaces, and a group's name may stand before. The number is the participant's in this assignment.
- Canvas: `surnamefirstname_67_890_lab.zip`, with `_LATE` behind the name where it was (once `_late`), `anon_Xy3z` for
  name and user where graders are not to know, `..._67_text.html` for what was typed in. A file handed in again is
  `lab-1.zip`. The first number is the user's, the second the file's, and no two files of a student have the same.
- Blackboard: `Lab 9_username_attempt_2026-03-01-12-30-00_lab.zip`, and a `.txt` about each attempt. Titles, user
  names and names of groups may hold underscores themselves.
- Brightspace: `67-890 - Full Name - Mar 1, 2026 1230 PM/lab.zip`, a folder for each time that a student handed in,
  and `index.html`. The first number is the user's, the second the assignment's.
- Sakai: `Surname, First(username)/Submission attachment(s)/lab.zip`, with `timestamp.txt` beside it.
- Gradescope: `submission_123/`, and who and when in `submission_metadata.yml`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from itertools import takewhile
from pathlib import PurePosixPath

import yaml

from grader.policy import parse_time

_MOODLE = re.compile(r"(?P<name>[^_]+)_(?P<id>\d+)_assignsubmission_(?P<kind>[a-z]+)_?(?P<file>.*)", re.DOTALL)
# A number that begins with 0, as that of a lab may, is no id of Canvas.
_CANVAS = re.compile(
    r"(?:(?!(?i:LATE)_)(?P<name>\w+?)_)?(?:(?P<late>(?i:LATE))_)?(?P<id>[1-9]\d*|anon_[^\W_]+)_"
    r"(?:(?P<number>0|[1-9]\d*)_(?P<file>.+)|(?P<typed>(?:text|link)\.html))",
    re.DOTALL,
)
_BLACKBOARD = re.compile(
    r"(?P<head>.+?_.+?)_attempt_(?P<time>\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)(?:_(?P<file>.+)|(?P<about>\.txt))", re.DOTALL
)
_BRIGHTSPACE = re.compile(r"(?P<id>\d+)-\d+ - (?P<name>.+) - (?P<time>(?:(?! - ).)*\b\d{4}\b(?:(?! - ).)*)")
_SAKAI = re.compile(r"(?P<name>[^()]+, ?[^()]+)\((?P<id>[^()\s]+)\)")
_TABLES = frozenset({".csv", ".xlsx", ".xls", ".ods", ".tsv"})
#: Longer names are none that these systems make.
_MOST_CHARACTERS = 500
_AGAIN = re.compile(r"-\d{1,3}(?=(\.[^.]+)?$)")
_CLOCK = re.compile(r"(\d{1,2}):?(\d\d)( ?[AP]M)?$")
#: What Gradescope writes of its submissions, and Sakai of the time of each.
GRADESCOPE_FILE = "submission_metadata.yml"
SAKAI_TIME_FILE = "timestamp.txt"


@dataclass(frozen=True)
class Delivered:
    """A file or folder of a download, as its name tells it.

    Attributes
    ----------
    student : str
        The student's name, as the system writes it.
    student_id : str
        By which the system knows the student.
    file : str
        What the student called the file; empty for a folder, and for what the system itself wrote.
    again : str
        What it was called before the system told it from an earlier one.
    late : bool
        Whether the system marked it so.
    attempt_at : datetime or None
        When it was handed in, in local time, where the name tells it.
    """

    student: str
    student_id: str
    file: str = ""
    again: str = ""
    late: bool = False
    attempt_at: datetime | None = None


@dataclass(frozen=True)
class Download:
    """A download of a class.

    Attributes
    ----------
    system : str
        Where it comes from.
    known : mapping
        What is known of each entry that the system named after a student.
    own : frozenset of str
        Entries that the system made for itself.
    """

    system: str
    known: Mapping[str, Delivered]
    own: frozenset[str] = field(default_factory=frozenset)


def _moodle(entries: Mapping[str, bool]) -> dict[str, Delivered]:
    found = {}
    for name, is_folder in entries.items():
        told = _MOODLE.fullmatch(name)
        if told is not None and is_folder != bool(told["file"]):
            found[name] = Delivered(told["name"].strip(), told["id"], told["file"])
    return found


def _canvas(entries: Mapping[str, bool]) -> dict[str, Delivered]:
    matched = [told for name, is_folder in entries.items() if not is_folder and (told := _CANVAS.fullmatch(name))]
    numbers = Counter(_numbered(told) for told in matched)
    return {
        told[0]: _of_canvas(told)
        for told in matched
        # Files with the same numbers are not of Canvas: students number theirs by labs and tasks.
        if numbers[_numbered(told)] < 2
    }


def _numbered(told: re.Match[str]) -> tuple[str | None, str, str]:
    return told["name"], told["id"], told["number"] or told["typed"]


def _of_canvas(told: re.Match[str]) -> Delivered:
    file = told["file"] or told["typed"]
    return Delivered(told["name"] or told["id"], told["id"], file, _AGAIN.sub("", file), told["late"] is not None)


def _blackboard(entries: Mapping[str, bool]) -> dict[str, Delivered]:
    matched = [told for name, is_folder in entries.items() if not is_folder and (told := _BLACKBOARD.fullmatch(name))]
    title = len(_title_of({told["head"] for told in matched}))
    found = {}
    for told in matched:
        student = told["head"][title:] if title else told["head"].rpartition("_")[2]
        time = _local(told["time"], "%Y-%m-%d-%H-%M-%S")
        if time is not None:
            found[told[0]] = Delivered(student, student, told["file"] or "", attempt_at=time)
    return found


def _title_of(heads: Collection[str]) -> str:
    """Return how all of them begin, up to an underscore: the assignment's title, which nothing else tells."""
    first, last = min(heads, default=""), max(heads, default="")
    alike = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False)))
    return first[: first.rfind("_", 0, alike) + 1]


def _brightspace(entries: Mapping[str, bool]) -> dict[str, Delivered]:
    matched = [told for name, is_folder in entries.items() if is_folder and (told := _BRIGHTSPACE.fullmatch(name))]
    return {told[0]: Delivered(told["name"], told["id"], attempt_at=_clock_time(told["time"])) for told in matched}


def _clock_time(text: str) -> datetime | None:
    """Read a time such as `Mar 1, 2026 1230 PM`; None if it is written in another way."""
    clock = _CLOCK.search(text)
    if clock is None:
        return None
    # Two digits each, or `121 PM` could be read as 12:01.
    day, half = text[: clock.start()].strip(), (clock[3] or "").strip()
    forms = [f"{day_form} {'%I%M%p' if half else '%H%M'}" for day_form in ("%b %d, %Y", "%B %d, %Y", "%d %b, %Y")]
    read = (_local(f"{day} {int(clock[1]):02}{clock[2]}{half}", form) for form in forms)
    return next((time for time in read if time is not None), None)


def _local(text: str, form: str) -> datetime | None:
    try:
        return datetime.strptime(text, form).astimezone()
    except (ValueError, OverflowError, OSError):
        return None


def _sakai(entries: Mapping[str, bool]) -> dict[str, Delivered]:
    matched = [told for name, is_folder in entries.items() if is_folder and (told := _SAKAI.fullmatch(name))]
    return {told[0]: Delivered(told["name"].strip(), told["id"]) for told in matched}


def _gradescope(entries: Mapping[str, bool]) -> dict[str, Delivered]:
    if entries.get(GRADESCOPE_FILE, True):
        return {}
    return {name: Delivered(name, name) for name, is_folder in entries.items() if is_folder}


_SYSTEMS: dict[str, tuple[Callable[[Mapping[str, bool]], dict[str, Delivered]], frozenset[str]]] = {
    "Moodle": (_moodle, frozenset()),
    "Canvas": (_canvas, frozenset()),
    "Blackboard": (_blackboard, frozenset()),
    "Brightspace": (_brightspace, frozenset({"index.html"})),
    "Sakai": (_sakai, frozenset()),
    "Gradescope": (_gradescope, frozenset({GRADESCOPE_FILE})),
}


def is_table(name: str) -> bool:
    """Whether a file is a table, such as a system writes of grades."""
    return PurePosixPath(name).suffix.lower() in _TABLES


def recognised(entries: Mapping[str, bool]) -> Download | None:
    """Tell which system a download comes from, and what it says of each entry.

    Parameters
    ----------
    entries : mapping
        Names -> whether it is a folder.

    Returns
    -------
    Download or None
        None unless most entries are named as one of the systems does; tables are not counted.
    """
    fit = {name: is_folder for name, is_folder in entries.items() if len(name) <= _MOST_CHARACTERS}
    for system, (read, own) in _SYSTEMS.items():
        known = read(fit)
        others = [name for name in entries if name not in known and name not in own and not is_table(name)]
        if len(known) > len(others):
            return Download(system, known, own & entries.keys())
    return None


# -- what else the systems write -----------------------------------------------------------------------


@dataclass(frozen=True)
class Submitted:
    """Who handed something in, and when.

    Attributes
    ----------
    students : tuple of (str, str)
        Names and ids.
    """

    students: tuple[tuple[str, str], ...] = ()
    at: datetime | None = None


_KEY = re.compile(r"(?P<key>[^\s:#-][^:]*):\s*")
_PART = re.compile(r" {2}(?P<key>:\w+):(?: (?P<value>.*))?")
_FACT = re.compile(r"(?: {2}(?P<new>- )| {4}):(?P<key>name|sid|email): (?P<value>.+)")


def read_gradescope(text: str) -> dict[str, Submitted]:
    """Read of `submission_metadata.yml` who handed in which folder, and when.

    It is read by its lines, as Gradescope always writes it: with all test results of a class it has megabytes, of
    which most are written by students, and which a reader of YAML would take minutes for.
    """
    found: dict[str, Submitted] = {}
    folder, part = "", ""
    people: list[dict[str, str]] = []
    for line in text.splitlines():
        if key := _KEY.fullmatch(line):
            folder, part, people = key["key"], "", []
            found[folder] = Submitted()
        elif folder and (told := _PART.fullmatch(line)):
            part = told["key"]
            if part == ":created_at":
                found[folder] = Submitted(found[folder].students, _moment(told["value"] or ""))
        elif folder and part == ":submitters" and (fact := _FACT.fullmatch(line)):
            people += [{}] if fact["new"] or not people else []
            people[-1][fact["key"]] = _scalar(fact["value"])
            found[folder] = Submitted(tuple(_students(people)), found[folder].at)
    return found


def _students(people: Collection[Mapping[str, str]]) -> Iterator[tuple[str, str]]:
    for person in people:
        student_id = person.get("sid") or person.get("email", "")
        yield person.get("name") or student_id, student_id


def _scalar(text: str) -> str:
    text = text.strip()
    if text[:1] in ("'", '"'):
        try:
            return str(yaml.safe_load(text))
        except yaml.YAMLError:
            return text
    return text


def _moment(text: str) -> datetime | None:
    time = parse_time(re.sub(r"(\.\d{6})\d+", r"\1", _scalar(text)))
    return time if time is not None and time.utcoffset() is not None else None


def read_sakai_time(text: str) -> datetime | None:
    """Read `timestamp.txt`: digits in UTC, such as `20260302224105123`, or ISO 8601."""
    digits = re.match(r"\s*(\d{14})\d*\s*$", text)
    if digits is None:
        return _moment(text)
    try:
        return datetime.strptime(digits[1], "%Y%m%d%H%M%S").replace(tzinfo=timezone.utc)
    except ValueError:
        return None
