"""Near misses: which of a student's names was meant by one that the lab asks for.

A typo in a name is charged once; everything else is then measured on the name that the student used.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass

#: Below this likeness (difflib's ratio of the plain names) two names have nothing to do with each other.
LEAST_RATIO = 0.5


@dataclass(frozen=True)
class Candidate:
    """A name in the graph that belongs to a student's node."""

    name: str
    type: str


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def likeness(wanted: str, name: str) -> float:
    """Return how alike two ROS names are, from 0 to 1; a namespace more or less counts little."""
    whole = difflib.SequenceMatcher(None, _plain(wanted), _plain(name)).ratio()
    last = difflib.SequenceMatcher(None, _plain(wanted.rsplit("/", 1)[-1]), _plain(name.rsplit("/", 1)[-1])).ratio()
    return max(whole, 0.95 * last)


def near_miss(wanted: str, wanted_type: str | None, candidates: Iterable[Candidate]) -> Candidate | None:
    """Choose the candidate that was meant, or None.

    The only one of the wanted type is taken whatever its name: it can mean no other.
    """
    found = sorted(set(candidates), key=lambda c: (c.type != wanted_type, -likeness(wanted, c.name), c.name))
    if not found:
        return None
    same_type = [c for c in found if c.type == wanted_type]
    if len(same_type) == 1:
        return same_type[0]
    alike = [c for c in (same_type or found) if likeness(wanted, c.name) >= LEAST_RATIO]
    return alike[0] if alike else None
