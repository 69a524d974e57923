"""Blackboard: `Lab 9_username_attempt_2026-03-01-12-30-00_lab.zip`, and a `.txt` about each attempt.

Titles, user names and names of groups may hold underscores themselves.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from itertools import takewhile

from grader.batch.lms.system import Delivered, System, local_time, matches

_NAME = re.compile(
    r"(?P<head>.[^_]*_.+?)_attempt_(?P<time>\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)(?:_(?P<file>.+)|(?P<about>\.txt))", re.DOTALL
)


class Blackboard(System):
    """Downloads of Blackboard."""

    name = "Blackboard"

    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Read names of files: the student is what is left of one without the assignment's title."""
        found = matches(_NAME, entries, folders=False)
        title = len(_title_of({match["head"] for match in found}))
        delivered = {}
        for match in found:
            student = match["head"][title:] if title else match["head"].rpartition("_")[2]
            time = local_time(match["time"], "%Y-%m-%d-%H-%M-%S")
            if time is not None:
                delivered[match[0]] = Delivered(student, student, match["file"] or "", attempt_at=time)
        return delivered


def _title_of(heads: Collection[str]) -> str:
    """Return how all of them begin, up to an underscore: the assignment's title, which nothing else tells."""
    first, last = min(heads, default=""), max(heads, default="")
    alike = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False)))
    return first[: first.rfind("_", 0, alike) + 1]
