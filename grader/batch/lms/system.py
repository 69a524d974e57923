"""What the learning-management systems have in common: each names what students hand in after them."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import ClassVar


@dataclass(frozen=True)
class Delivered:
    """A file or folder of a download, as its name describes it.

    Attributes
    ----------
    student : str
        The student's name, as the system writes it.
    student_id : str
        By which the system knows the student.
    file : str
        What the student called the file; empty for a folder, and for what the system itself wrote.
    first_called : str
        What it was called before the system marked it as handed in once more.
    late : bool
        Whether the system marked it so.
    attempt_at : datetime or None
        When it was handed in, in local time, where the name says it.
    """

    student: str
    student_id: str
    file: str = ""
    first_called: str = ""
    late: bool = False
    attempt_at: datetime | None = None


class System(ABC):
    """A learning-management system.

    Attributes
    ----------
    own : frozenset of str
        Entries that it makes for itself.
    """

    name: ClassVar[str]
    own: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Return what it says of each entry that it named; `entries` are names -> whether it is a folder."""

    def entries(
        self, known: Mapping[str, Delivered], read: Callable[[Sequence[str]], Mapping[str, str]]
    ) -> Mapping[str, Delivered]:
        """Add what it wrote down in files beside the entries; `read` gives the texts of those that can be read."""
        return known


def matches(pattern: re.Pattern[str], entries: Mapping[str, bool], *, folders: bool) -> list[re.Match[str]]:
    """Return how the names of all folders, or all files, fit a pattern; without those that do not."""
    found = (pattern.fullmatch(name) for name, is_folder in entries.items() if is_folder is folders)
    return [match for match in found if match is not None]


def local_time(text: str, form: str) -> datetime | None:
    """Read a time of this machine's zone; None if it is none of that form."""
    try:
        return datetime.strptime(text, form).astimezone()
    except (ValueError, OverflowError, OSError):
        return None
