"""Canvas: `surnamefirstname_67_890_lab.zip`, with `_LATE` behind the name where it was (once `_late`).

`anon_Xy3z` stands for name and user where graders are not to know, `..._67_text.html` for what was typed in. A file
handed in again is `lab-1.zip`. The first number is the user's, the second the file's, and no two files of a student
have the same.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

from grader.batch.lms.system import Delivered, System, matches

# A number that begins with 0, as that of a lab may, is no id of Canvas.
_NAME = re.compile(
    r"(?:(?!(?i:LATE)_)(?P<name>\w+?)_)?(?:(?P<late>(?i:LATE))_)?(?P<id>[1-9]\d*|anon_[^\W_]+)_"
    r"(?:(?P<number>0|[1-9]\d*)_(?P<file>.+)|(?P<typed>(?:text|link)\.html))",
    re.DOTALL,
)
_AGAIN = re.compile(r"-\d{1,3}(?=(\.[^.]+)?$)")


class Canvas(System):
    """Downloads of Canvas."""

    name = "Canvas"

    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Read names of files; those with the same numbers are students' own, who number theirs by labs and tasks."""
        found = matches(_NAME, entries, folders=False)
        numbers = Counter(_numbers(match) for match in found)
        return {match[0]: _delivered(match) for match in found if numbers[_numbers(match)] < 2}


def _numbers(match: re.Match[str]) -> tuple[str | None, str, str]:
    return match["name"], match["id"], match["number"] or match["typed"]


def _delivered(match: re.Match[str]) -> Delivered:
    file = match["file"] or match["typed"]
    return Delivered(match["name"] or match["id"], match["id"], file, _AGAIN.sub("", file), match["late"] is not None)
