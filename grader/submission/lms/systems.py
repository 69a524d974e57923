"""Learning-management systems by the names in their downloads of a class: a row for each system."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import PurePosixPath

import yaml

from grader import yaml_text
from grader.lab.overrides import moment_of
from grader.recording.submission import Person

_TABLES = frozenset({".csv", ".xlsx", ".xls", ".ods", ".tsv"})
#: Characters of the longest name that these systems make.
_MOST_CHARACTERS = 500

#: Names of entries: True for a folder.
Entries = Mapping[str, bool]
#: Returns the texts of readable files.
Read = Callable[[Sequence[str]], Mapping[str, str]]


@dataclass(frozen=True)
class Delivered:
    """A file or folder of a download, as its name describes it."""

    #: The student's name, as the system writes it.
    student: str
    #: The student's id in the system.
    student_id: str
    #: The student's name for the file; empty for a folder, and for a file of the system itself.
    file: str = ""
    #: Name of the file before the system marked it as a repeated submission.
    first_called: str = ""
    #: True if the system marked it as late.
    late: bool = False
    #: Time of the submission, if the download has it; without offset from UTC if it has none.
    attempt_at: datetime | None = None
    #: Location of the student's feedback in an archive for the system: a file of this name and kind or, after a slash or
    #: an underscore, a file of any name. Empty if the system accepts no such archive.
    handback: str = ""
    #: Members of a joint submission, if the system names them.
    people: tuple[Person, ...] = ()


@dataclass(frozen=True)
class System:
    """A learning-management system."""

    name: str
    #: Returns the description of each entry with a name of the system.
    match: Callable[[Entries], dict[str, Delivered]]
    #: Entries that the system adds.
    own: frozenset[str] = frozenset()
    #: Attribute of `Person` for the system's ids, if a grade book has them.
    id_is: str = ""
    #: Adds facts from the system's own files to the descriptions.
    details: Callable[[Mapping[str, Delivered], Read], Mapping[str, Delivered]] = (
        lambda known, read: known
    )


def is_table(name: str) -> bool:
    """Return whether a file is a table, such as a table of grades."""
    return PurePosixPath(name).suffix.lower() in _TABLES


def recognised(entries: Entries) -> tuple[System, Mapping[str, Delivered]] | None:
    """Return the system of a download, and its description of each entry that is named after a student.

    Returns None unless most entries, without tables, have names of one of the systems.
    """
    fit = {}
    for name, is_folder in entries.items():
        if len(name) <= _MOST_CHARACTERS:
            fit[name] = is_folder
    for system in SYSTEMS:
        known = system.match(fit)
        others = 0
        for name in entries:
            is_of_system = name in known or name in system.own
            if not is_of_system and not is_table(name):
                others += 1
        if len(known) > others:
            return system, known
    return None


def _matches(pattern: str, entries: Entries, *, folders: bool) -> list[re.Match[str]]:
    """Return the matches of a pattern with the whole names of folders, or of files."""
    found = []
    for name, is_folder in entries.items():
        if is_folder is folders:
            match = re.fullmatch(pattern, name, re.DOTALL)
            if match is not None:
                found.append(match)
    return found


def _time(text: str, form: str) -> datetime | None:
    """Read a time, without offset from UTC if it has none; None for another form."""
    try:
        return datetime.strptime(text, form)
    except ValueError:
        return None


# -- Moodle: `Full Name_12345_assignsubmission_file_/lab.zip`, or without folders `..._file_lab.zip` -----------------

# Underscores in names become spaces, and the name of a group can come first. The number is the participant's in this
# assignment. A file has its own name after the student's, a folder has none.
_MOODLE = r"(?P<name>[^_]+)_(?P<id>\d+)_assignsubmission_(?P<kind>[a-z]+)_?(?P<file>.*)"


def _moodle(entries: Entries) -> dict[str, Delivered]:
    delivered = {}
    for match in _matches(_MOODLE, entries, folders=False):
        if match["file"]:
            before = match[0][: match.start("file")]
            name = match["name"].strip()
            delivered[match[0]] = Delivered(name, match["id"], match["file"], handback=before)
    for match in _matches(_MOODLE, entries, folders=True):
        if not match["file"]:
            name = match["name"].strip()
            delivered[match[0]] = Delivered(name, match["id"], handback=f"{match[0]}/")
    return delivered


# -- Canvas: `surnamefirstname_67_890_lab.zip`, with `_LATE` after the name where it was (once `_late`) -------------

# `anon_Xy3z` replaces name and user in anonymous grading, `..._67_text.html` holds text that was typed in. A file
# that is submitted again is `lab-1.zip`. The first number is the user's, the second the file's, and no two files of a
# student have the same one; equal numbers come from students that number their files by labs and tasks.
# A number that begins with 0, as a lab's can, is not an id of Canvas.
_CANVAS = (
    r"(?:(?!(?i:LATE)_)(?P<name>\w+?)_)?(?:(?P<late>(?i:LATE))_)?(?P<id>[1-9]\d*|anon_[^\W_]+)_"
    r"(?:(?P<number>0|[1-9]\d*)_(?P<file>.+)|(?P<typed>(?:text|link)\.html))"
)
_CANVAS_AGAIN = re.compile(r"-\d{1,3}(?=(\.[^.]+)?$)")


def _canvas(entries: Entries) -> dict[str, Delivered]:
    found = _matches(_CANVAS, entries, folders=False)
    numbers = [match.group("name", "id", "number", "typed") for match in found]
    times = Counter(numbers)
    delivered = {}
    for match, number in zip(found, numbers, strict=True):
        if times[number] > 1:
            continue
        file = match["file"] or match["typed"]
        # Canvas shows feedback under the name of the submitted file.
        handback = match[0] if match["file"] else ""
        id_ = match["id"]
        student = match["name"] or id_
        original = _CANVAS_AGAIN.sub("", file)
        late = match["late"] is not None
        delivered[match[0]] = Delivered(student, id_, file, original, late, handback=handback)
    return delivered


# -- Blackboard: `Lab 9_username_attempt_2026-03-01-12-30-00_lab.zip`, and a `.txt` about each attempt ---------------

# Titles, user names and names of groups can have underscores. The student's name is the rest after the assignment's
# title, the common beginning of all names.
_BLACKBOARD = r"(?P<head>.[^_]*_.+?)_attempt_(?P<time>\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)(?:_(?P<file>.+)|(?P<about>\.txt))"


def _blackboard(entries: Entries) -> dict[str, Delivered]:
    found = _matches(_BLACKBOARD, entries, folders=False)
    title = _common_title({match["head"] for match in found})
    delivered = {}
    for match in found:
        head = match["head"]
        if title:
            student = head.removeprefix(title)
        else:
            student = head.rpartition("_")[2]
        time = _time(match["time"], "%Y-%m-%d-%H-%M-%S")
        if time is not None:
            file = match["file"] or ""
            delivered[match[0]] = Delivered(student, student, file, attempt_at=time)
    return delivered


def _common_title(heads: Collection[str]) -> str:
    """Return the common beginning of all names, up to an underscore."""
    first = min(heads, default="")
    alike = 0
    for sign, other in zip(first, max(heads, default=""), strict=False):
        if sign != other:
            break
        alike += 1
    return first[: first.rfind("_", 0, alike) + 1]


# -- Brightspace: `67-890 - Full Name - Mar 1, 2026 1230 PM/lab.zip`, a folder for each submission -------------------

# The first number is the user's, the second the assignment's. `index.html` is next to them.
_BRIGHTSPACE = r"(?P<id>\d+)-\d+ - (?P<name>.+) - (?P<time>(?:(?! - ).)*\b\d{4}\b(?:(?! - ).)*)"
_CLOCK = re.compile(r"(\d{1,2}):?(\d\d)( ?[AP]M)?$")


def _brightspace(entries: Entries) -> dict[str, Delivered]:
    delivered = {}
    for match in _matches(_BRIGHTSPACE, entries, folders=True):
        time = _brightspace_time(match["time"])
        delivered[match[0]] = Delivered(match["name"], match["id"], attempt_at=time)
    return delivered


def _brightspace_time(text: str) -> datetime | None:
    """Read a time such as `Mar 1, 2026 1230 PM`; None for another form."""
    clock = _CLOCK.search(text)
    if clock is None:
        return None
    day = text[: clock.start()].strip()
    half = (clock[3] or "").strip()
    # With one digit, `121 PM` could be read as 12:01.
    padded = f"{day} {int(clock[1]):02}{clock[2]}{half}"
    clock_form = "%I%M%p" if half else "%H%M"
    for day_form in ("%b %d, %Y", "%B %d, %Y", "%d %b, %Y"):
        time = _time(padded, f"{day_form} {clock_form}")
        if time is not None:
            return time
    return None


# -- Sakai: `Surname, First(username)/Submission attachment(s)/lab.zip`, with `timestamp.txt` beside the attachments --

_SAKAI = r"(?P<name>[^()][^(),]*,[^()]+)\((?P<id>[^()\s]+)\)"


def _sakai(entries: Entries) -> dict[str, Delivered]:
    found = _matches(_SAKAI, entries, folders=True)
    return {match[0]: Delivered(match["name"].strip(), match["id"]) for match in found}


def _sakai_times(known: Mapping[str, Delivered], read: Read) -> Mapping[str, Delivered]:
    files = {entry: f"{entry}/timestamp.txt" for entry in known}
    texts = read(list(files.values()))
    dated = {}
    for entry, delivered in known.items():
        time = _sakai_time(texts.get(files[entry], ""))
        dated[entry] = replace(delivered, attempt_at=time)
    return dated


def _sakai_time(text: str) -> datetime | None:
    """Read digits in UTC, such as `20260302224105123`, or ISO 8601 with an offset."""
    digits = re.fullmatch(r"\s*(\d{14})\d*\s*", text)
    if digits is None:
        return moment_of(text.strip())
    return _time(f"{digits[1]}+0000", "%Y%m%d%H%M%S%z")


# -- Gradescope: `submission_123/`, and names and times in `submission_metadata.yml` ---------------------------------

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
    found = {}
    for entry, delivered in known.items():
        submitted = written.get(entry, _Submitted())
        found[entry] = _by(submitted, delivered)
    return found


def _by(submitted: _Submitted, known: Delivered) -> Delivered:
    """Return a folder with its people; a joint submission is named after all of them, with its number."""
    people = []
    ids = []
    names = []
    for fact in submitted.people:
        person = Person(fact.get("name", ""), fact.get("sid", ""), email=fact.get("email", ""))
        person_id = person.student_id or person.email
        people.append(person)
        ids.append(person_id)
        names.append(person.name or person_id)
    if len(names) > 1:
        known = replace(known, student=", ".join([*names, known.student]), student_id="")
    elif names:
        known = replace(known, student=names[0], student_id=ids[0])
    return replace(known, attempt_at=submitted.at, people=tuple(people))


def _submitted_in(text: str) -> dict[str, _Submitted]:
    """Read the people and the time of each folder.

    The file is read line by line, in Gradescope's fixed form: most of its megabytes come from students, and could break
    a reader of YAML.
    """
    found: dict[str, _Submitted] = {}
    folder = _Submitted()
    part = ""
    for line in text.splitlines():
        if key := _KEY.fullmatch(line):
            folder = found[key["key"]] = _Submitted()
            part = ""
        elif key := _PART.fullmatch(line):
            part = key["key"]
            if part == ":created_at":
                folder.at = _created_at(key["value"] or "")
        elif part == ":submitters" and (fact := _FACT.fullmatch(line)):
            if fact["new"] or not folder.people:
                folder.people.append({})
            folder.people[-1][fact["key"]] = _scalar(fact["value"])
    return found


def _created_at(text: str) -> datetime | None:
    """Read a time such as `2026-03-02 22:41:05.123456789 Z`, without the digits beyond microseconds."""
    return moment_of(re.sub(r"(\.\d{6})\d+", r"\1", _scalar(text)))


def _scalar(text: str) -> str:
    """Return a scalar of YAML without its quotation marks."""
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
