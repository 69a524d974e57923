"""Which learning-management system a download of a class comes from: a module a system, each by how it names things."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from grader.batch.lms.blackboard import Blackboard
from grader.batch.lms.brightspace import Brightspace
from grader.batch.lms.canvas import Canvas
from grader.batch.lms.gradescope import Gradescope
from grader.batch.lms.moodle import Moodle
from grader.batch.lms.sakai import Sakai
from grader.batch.lms.system import Delivered, System

__all__ = ["Delivered", "Download", "is_table", "recognised"]

_SYSTEMS: tuple[System, ...] = (Moodle(), Canvas(), Blackboard(), Brightspace(), Sakai(), Gradescope())
_TABLES = frozenset({".csv", ".xlsx", ".xls", ".ods", ".tsv"})
#: Longer names are none that these systems make.
_MOST_CHARACTERS = 500


@dataclass(frozen=True)
class Download:
    """A download of a class.

    Attributes
    ----------
    known : mapping
        What the system says of each entry that it named after a student.
    own : frozenset of str
        Entries that it made for itself.
    """

    system: System
    known: Mapping[str, Delivered]
    own: frozenset[str]


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
    for system in _SYSTEMS:
        known = system.match(fit)
        others = [name for name in entries if name not in known and name not in system.own and not is_table(name)]
        if len(known) > len(others):
            return Download(system, known, system.own & entries.keys())
    return None
