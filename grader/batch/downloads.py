"""How learning-management systems name what they pack into one download.

- Moodle: `Full Name_12345_assignsubmission_file_/lab.zip`, or without folders `..._file_lab.zip`. Underscores in
  names have become spaces, and a group's name may stand before. The number is the participant's in this assignment.
- Canvas: `surnamefirstname_67_890_lab.zip`, with `_LATE` behind the name where it was, `anon_Xy3z` for name and user
  where graders are not to know, `..._67_text.html` for what was typed in. A file handed in again is `lab-1.zip`.
- Blackboard: `Lab 9_username_attempt_2026-03-01-12-30-00_lab.zip`, and a `.txt` about each attempt.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime

_MOODLE = re.compile(r"(?P<name>[^_]+)_(?P<id>\d+)_assignsubmission_(?P<kind>[a-z]+)_?(?P<file>.*)", re.DOTALL)
_CANVAS = re.compile(
    r"(?:(?P<name>\w+?)_)?(?:(?P<late>LATE)_)?(?P<id>\d+|anon_[^\W_]+)_"
    r"(?:(?P<number>\d+)_(?P<file>.+)|(?P<typed>(?:text|link)\.html))",
    re.DOTALL,
)
_BLACKBOARD = re.compile(
    r".+?_(?P<id>[^_\s]+)_attempt_(?P<time>\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)(?:_(?P<file>.+)|(?P<about>\.txt))", re.DOTALL
)
#: Longer names are none that these systems make.
_MOST_CHARACTERS = 500
_AGAIN = re.compile(r"-\d{1,3}(?=(\.[^.]+)?$)")


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


def _moodle(name: str, is_folder: bool) -> Delivered | None:
    told = _MOODLE.fullmatch(name)
    if told is None or is_folder == bool(told["file"]):
        return None
    return Delivered(told["name"].strip(), told["id"], told["file"])


def _canvas(name: str, is_folder: bool) -> Delivered | None:
    told = _CANVAS.fullmatch(name)
    if told is None or is_folder:
        return None
    file = told["file"] or told["typed"]
    student = told["name"] or told["id"]
    return Delivered(student, told["id"], file, _AGAIN.sub("", file), told["late"] is not None)


def _blackboard(name: str, is_folder: bool) -> Delivered | None:
    told = _BLACKBOARD.fullmatch(name)
    if told is None or is_folder:
        return None
    try:
        time = datetime.strptime(told["time"], "%Y-%m-%d-%H-%M-%S").astimezone()
    except (ValueError, OverflowError, OSError):
        return None
    return Delivered(told["id"], told["id"], told["file"] or "", attempt_at=time)


_SYSTEMS: dict[str, Callable[[str, bool], Delivered | None]] = {
    "Moodle": _moodle,
    "Canvas": _canvas,
    "Blackboard": _blackboard,
}


def recognised(entries: Mapping[str, bool]) -> tuple[str, dict[str, Delivered]] | None:
    """Tell which system a download comes from, and what it says of each entry.

    Parameters
    ----------
    entries : mapping
        Names -> whether it is a folder.

    Returns
    -------
    tuple or None
        The system's name, and what is known of the entries that it named; None unless these are most of them.
    """
    for system, read in _SYSTEMS.items():
        told = {name: read(name, is_folder) for name, is_folder in entries.items() if len(name) <= _MOST_CHARACTERS}
        known = {name: delivered for name, delivered in told.items() if delivered is not None}
        if known and 2 * len(known) > len(entries):
            return system, known
    return None
