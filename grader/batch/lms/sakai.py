"""Sakai: `Surname, First(username)/Submission attachment(s)/lab.zip`, with `timestamp.txt` beside the attachments."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone

from grader.batch.lms.system import Delivered, System, matches
from grader.policy import parse_time

_NAME = re.compile(r"(?P<name>[^()][^(),]*,[^()]+)\((?P<id>[^()\s]+)\)")


class Sakai(System):
    """Downloads of Sakai."""

    name = "Sakai"

    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Read names of folders."""
        found = matches(_NAME, entries, folders=True)
        return {match[0]: Delivered(match["name"].strip(), match["id"]) for match in found}

    def entries(
        self, known: Mapping[str, Delivered], read: Callable[[Sequence[str]], Mapping[str, str]]
    ) -> Mapping[str, Delivered]:
        """Add the times that lie beside what was handed in."""
        files = {entry: f"{entry}/timestamp.txt" for entry in known}
        texts = read(list(files.values()))
        return {entry: replace(one, attempt_at=_time(texts.get(files[entry], ""))) for entry, one in known.items()}


def _time(text: str) -> datetime | None:
    """Read `timestamp.txt`: digits in UTC, such as `20260302224105123`, or ISO 8601 with an offset."""
    digits = re.match(r"\s*(\d{14})\d*\s*$", text)
    if digits is not None:
        try:
            return datetime.strptime(digits[1], "%Y%m%d%H%M%S").replace(tzinfo=timezone.utc)
        except ValueError:
            return None
    time = parse_time(text.strip())
    return time if time is not None and time.utcoffset() is not None else None
