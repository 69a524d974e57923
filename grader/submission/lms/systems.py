"""Which learning-management system a download of a class comes from: a row a system, each by how it names things."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import takewhile
from pathlib import PurePosixPath

import yaml

from grader import yaml_text
from grader.lab.overrides import moment_of
from grader.recording.submission import Person

_TABLES = frozenset({".csv", ".xlsx", ".xls", ".ods", ".tsv"})
#: Longer names are none that these systems make.
_MOST_CHARACTERS = 500

#: Names -> whether it is a folder.
Entries = Mapping[str, bool]
#: Gives the texts of those files that can be read.
Read = Callable[[Sequence[str]], Mapping[str, str]]


@dataclass(frozen=True)
class Delivered:
    """A file or folder of a download, as its name describes it."""

    #: The student's name, as the system writes it.
    student: str
    #: By which the system knows the student.
    student_id: str
    #: What the student called the file; empty for a folder, and for what the system itself wrote.
    file: str = ""
    #: What it was called before the system marked it as handed in once more.
    first_called: str = ""
    #: Whether the system marked it so.
    late: bool = False
    #: When it was handed in, if the download says so; without offset from UTC if it names none.
    attempt_at: datetime | None = None
    #: Where in an archive the system takes something back for the student: a file of this name and kind or, behind a
    #: slash or an underscore, one of any name. Empty if it takes nothing back so.
    handback: str = ""
    #: Who handed it in together, where the system says so.
    people: tuple[Person, ...] = ()


@dataclass(frozen=True)
class System:
    """A learning-management system."""

    name: str
    #: Returns what the system says of each entry that it named.
    match: Callable[[Entries], dict[str, Delivered]]
    #: Entries that it makes for itself.
    own: frozenset[str] = frozenset()
    #: Which fact of a `Person` its ids are, if a grade book knows them.
    id_is: str = ""
    #: Adds to what is known what it wrote down in files beside the entries.
    details: Callable[[Mapping[str, Delivered], Read], Mapping[str, Delivered]] = (
        lambda known, read: known
    )


def is_table(name: str) -> bool:
    """Whether a file is a table, such as a system writes of grades."""
    return PurePosixPath(name).suffix.lower() in _TABLES


def recognised(entries: Entries) -> tuple[System, Mapping[str, Delivered]] | None:
    """Determine which system a download comes from, and what it says of each entry that it named after a student.

    None unless most entries are named as one of the systems does; tables are not counted.
    """
    fit = {name: is_folder for name, is_folder in entries.items() if len(name) <= _MOST_CHARACTERS}
    for system in SYSTEMS:
        known = system.match(fit)
        others = [
            name
            for name in entries
            if name not in known and name not in system.own and not is_table(name)
        ]
        if len(known) > len(others):
            return system, known
    return None


def _matches(pattern: str, entries: Entries, *, folders: bool) -> list[re.Match[str]]:
    """Return how the names of all folders, or all files, fit a pattern; without those that do not."""
    found = (
        re.fullmatch(pattern, name, re.DOTALL)
        for name, is_folder in entries.items()
        if is_folder is folders
    )
    return [match for match in found if match is not None]


def _time(text: str, form: str) -> datetime | None:
    """Read a time, without offset from UTC if it names none; None if it is not of that form."""
    try:
        return datetime.strptime(text, form)
    except ValueError:
        return None


# -- Moodle: `Full Name_12345_assignsubmission_file_/lab.zip`, or without folders `..._file_lab.zip` -----------------

# Underscores in names have become spaces, and a group's name may stand before. The number is the participant's in this
# assignment. A file has its own name behind the student's, a folder has none.
_MOODLE = r"(?P<name>[^_]+)_(?P<id>\d+)_assignsubmission_(?P<kind>[a-z]+)_?(?P<file>.*)"


def _moodle(entries: Entries) -> dict[str, Delivered]:
    return {
        match[0]: Delivered(
            match["name"].strip(),
            match["id"],
            match["file"],
            handback=f"{match[0]}/" if folders else match[0][: match.start("file")],
        )
        for folders in (False, True)
        for match in _matches(_MOODLE, entries, folders=folders)
        if folders != bool(match["file"])
    }


# -- Canvas: `surnamefirstname_67_890_lab.zip`, with `_LATE` behind the name where it was (once `_late`) -------------

# `anon_Xy3z` stands for name and user where graders are not to know, `..._67_text.html` for what was typed in. A file
# handed in again is `lab-1.zip`. The first number is the user's, the second the file's, and no two files of a student
# have the same: those that do are students' own, who number theirs by labs and tasks.
# A number that begins with 0, as that of a lab may, is no id of Canvas.
_CANVAS = (
    r"(?:(?!(?i:LATE)_)(?P<name>\w+?)_)?(?:(?P<late>(?i:LATE))_)?(?P<id>[1-9]\d*|anon_[^\W_]+)_"
    r"(?:(?P<number>0|[1-9]\d*)_(?P<file>.+)|(?P<typed>(?:text|link)\.html))"
)
_CANVAS_AGAIN = re.compile(r"-\d{1,3}(?=(\.[^.]+)?$)")


def _canvas(entries: Entries) -> dict[str, Delivered]:
    found = {
        match: match.group("name", "id", "number", "typed")
        for match in _matches(_CANVAS, entries, folders=False)
    }
    times = Counter(found.values())
    delivered = {}
    for match, numbers in found.items():
        if times[numbers] == 1:
            file, late = match["file"] or match["typed"], match["late"] is not None
            student = match["name"] or match["id"]
            # It shows what comes back under the name of what was handed in.
            back = match[0] if match["file"] else ""
            first_called = _CANVAS_AGAIN.sub("", file)
            delivered[match[0]] = Delivered(
                student, match["id"], file, first_called, late, handback=back
            )
    return delivered


# -- Blackboard: `Lab 9_username_attempt_2026-03-01-12-30-00_lab.zip`, and a `.txt` about each attempt ---------------

# Titles, user names and names of groups may hold underscores themselves: the student is what is left without the
# assignment's title, which nothing else tells than that all begin with it.
_BLACKBOARD = r"(?P<head>.[^_]*_.+?)_attempt_(?P<time>\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)(?:_(?P<file>.+)|(?P<about>\.txt))"


def _blackboard(entries: Entries) -> dict[str, Delivered]:
    found = _matches(_BLACKBOARD, entries, folders=False)
    title = _common_title({match["head"] for match in found})
    delivered = {}
    for match in found:
        student = match["head"].removeprefix(title) if title else match["head"].rpartition("_")[2]
        if (time := _time(match["time"], "%Y-%m-%d-%H-%M-%S")) is not None:
            delivered[match[0]] = Delivered(student, student, match["file"] or "", attempt_at=time)
    return delivered


def _common_title(heads: Collection[str]) -> str:
    """Return how all of them begin, up to an underscore."""
    first, last = min(heads, default=""), max(heads, default="")
    alike = sum(
        1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    )
    return first[: first.rfind("_", 0, alike) + 1]


# -- Brightspace: `67-890 - Full Name - Mar 1, 2026 1230 PM/lab.zip`, a folder for each time that one handed in ------

# The first number is the user's, the second the assignment's. `index.html` lies beside them.
_BRIGHTSPACE = r"(?P<id>\d+)-\d+ - (?P<name>.+) - (?P<time>(?:(?! - ).)*\b\d{4}\b(?:(?! - ).)*)"
_CLOCK = re.compile(r"(\d{1,2}):?(\d\d)( ?[AP]M)?$")


def _brightspace(entries: Entries) -> dict[str, Delivered]:
    return {
        match[0]: Delivered(match["name"], match["id"], attempt_at=_brightspace_time(match["time"]))
        for match in _matches(_BRIGHTSPACE, entries, folders=True)
    }


def _brightspace_time(text: str) -> datetime | None:
    """Read a time such as `Mar 1, 2026 1230 PM`; None if it is written in another way."""
    clock = _CLOCK.search(text)
    if clock is None:
        return None
    # Two digits each, or `121 PM` could be read as 12:01.
    day, half = text[: clock.start()].strip(), (clock[3] or "").strip()
    forms = [
        f"{day_form} {'%I%M%p' if half else '%H%M'}"
        for day_form in ("%b %d, %Y", "%B %d, %Y", "%d %b, %Y")
    ]
    read = (_time(f"{day} {int(clock[1]):02}{clock[2]}{half}", form) for form in forms)
    return next((time for time in read if time is not None), None)


# -- Sakai: `Surname, First(username)/Submission attachment(s)/lab.zip`, with `timestamp.txt` beside the attachments --

_SAKAI = r"(?P<name>[^()][^(),]*,[^()]+)\((?P<id>[^()\s]+)\)"


def _sakai(entries: Entries) -> dict[str, Delivered]:
    found = _matches(_SAKAI, entries, folders=True)
    return {match[0]: Delivered(match["name"].strip(), match["id"]) for match in found}


def _sakai_times(known: Mapping[str, Delivered], read: Read) -> Mapping[str, Delivered]:
    files = {entry: f"{entry}/timestamp.txt" for entry in known}
    texts = read(list(files.values()))
    return {
        entry: replace(one, attempt_at=_sakai_time(texts.get(files[entry], "")))
        for entry, one in known.items()
    }


def _sakai_time(text: str) -> datetime | None:
    """Read digits in UTC, such as `20260302224105123`, or ISO 8601 with an offset."""
    digits = re.fullmatch(r"\s*(\d{14})\d*\s*", text)
    return (
        _time(f"{digits[1]}+0000", "%Y%m%d%H%M%S%z")
        if digits is not None
        else moment_of(text.strip())
    )


# -- Gradescope: `submission_123/`, and who and when in `submission_metadata.yml` ------------------------------------

_METADATA = "submission_metadata.yml"
_KEY = re.compile(r"(?P<key>[^\s:#-][^:]*):\s*")
_PART = re.compile(r" {2}(?P<key>:\w+):(?: (?P<value>.*))?")
_FACT = re.compile(r"(?: {2}(?P<new>- )| {4}):(?P<key>name|sid|email): (?P<value>.+)")


@dataclass
class _Submitted:
    people: list[dict[str, str]] = field(default_factory=list)
    at: datetime | None = None


def _gradescope(entries: Entries) -> dict[str, Delivered]:
    """Take each folder beside the system's file for a submission."""
    if entries.get(_METADATA, True):
        return {}
    return {name: Delivered(name, name) for name, is_folder in entries.items() if is_folder}


def _gradescope_people(known: Mapping[str, Delivered], read: Read) -> Mapping[str, Delivered]:
    written = _submitted_in(read([_METADATA]).get(_METADATA, ""))
    return {entry: _by(written.get(entry, _Submitted()), one) for entry, one in known.items()}


def _by(submitted: _Submitted, known: Delivered) -> Delivered:
    """Name those who handed something in together after all of them, with the number of the submission."""
    people = tuple(
        Person(p.get("name", ""), p.get("sid", ""), email=p.get("email", ""))
        for p in submitted.people
    )
    ids = [person.student_id or person.email for person in people]
    names = [person.name or one for person, one in zip(people, ids, strict=True)]
    if len(names) > 1:
        known = replace(known, student=", ".join([*names, known.student]), student_id="")
    elif names:
        known = replace(known, student=names[0], student_id=ids[0])
    return replace(known, attempt_at=submitted.at, people=people)


def _submitted_in(text: str) -> dict[str, _Submitted]:
    """Read who handed in which folder, and when.

    It is read by its lines, as Gradescope always writes it: of its megabytes most are students', who could break a
    reader of YAML.
    """
    found: dict[str, _Submitted] = {}
    folder, part = _Submitted(), ""
    for line in text.splitlines():
        if key := _KEY.fullmatch(line):
            folder = found[key["key"]] = _Submitted()
            part = ""
        elif key := _PART.fullmatch(line):
            part = key["key"]
            if part == ":created_at":
                folder.at = moment_of(re.sub(r"(\.\d{6})\d+", r"\1", _scalar(key["value"] or "")))
        elif part == ":submitters" and (fact := _FACT.fullmatch(line)):
            if fact["new"] or not folder.people:
                folder.people.append({})
            folder.people[-1][fact["key"]] = _scalar(fact["value"])
    return found


def _scalar(text: str) -> str:
    text = text.strip()
    if text[:1] in ("'", '"'):
        with suppress(yaml.YAMLError, RecursionError, ValueError):
            return str(yaml_text.load(text))
    return text


SYSTEMS = (
    System("Moodle", _moodle, id_is="moodle"),
    System("Canvas", _canvas, id_is="canvas"),
    System("Blackboard", _blackboard, id_is="login"),
    System("Brightspace", _brightspace, frozenset({"index.html"})),
    System("Sakai", _sakai, id_is="login", details=_sakai_times),
    System("Gradescope", _gradescope, frozenset({_METADATA}), details=_gradescope_people),
)
