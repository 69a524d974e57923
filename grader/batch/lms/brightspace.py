"""Brightspace: `67-890 - Full Name - Mar 1, 2026 1230 PM/lab.zip`, a folder for each time that a student handed in.

The first number is the user's, the second the assignment's. `index.html` lies beside them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime

from grader.batch.lms.system import Delivered, System, local_time, matches

_NAME = re.compile(r"(?P<id>\d+)-\d+ - (?P<name>.+) - (?P<time>(?:(?! - ).)*\b\d{4}\b(?:(?! - ).)*)")
_CLOCK = re.compile(r"(\d{1,2}):?(\d\d)( ?[AP]M)?$")


class Brightspace(System):
    """Downloads of Brightspace."""

    name = "Brightspace"
    own = frozenset({"index.html"})

    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Read names of folders."""
        return {
            match[0]: Delivered(match["name"], match["id"], attempt_at=_time(match["time"]))
            for match in matches(_NAME, entries, folders=True)
        }


def _time(text: str) -> datetime | None:
    """Read a time such as `Mar 1, 2026 1230 PM`; None if it is written in another way."""
    clock = _CLOCK.search(text)
    if clock is None:
        return None
    # Two digits each, or `121 PM` could be read as 12:01.
    day, half = text[: clock.start()].strip(), (clock[3] or "").strip()
    forms = [f"{day_form} {'%I%M%p' if half else '%H%M'}" for day_form in ("%b %d, %Y", "%B %d, %Y", "%d %b, %Y")]
    read = (local_time(f"{day} {int(clock[1]):02}{clock[2]}{half}", form) for form in forms)
    return next((time for time in read if time is not None), None)
