"""Moodle: `Full Name_12345_assignsubmission_file_/lab.zip`, or without folders `..._file_lab.zip`.

Underscores in names have become spaces, and a group's name may stand before. The number is the participant's in this
assignment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from grader.batch.lms.system import Delivered, System, matches

_NAME = re.compile(r"(?P<name>[^_]+)_(?P<id>\d+)_assignsubmission_(?P<kind>[a-z]+)_?(?P<file>.*)", re.DOTALL)


class Moodle(System):
    """Downloads of Moodle."""

    name = "Moodle"

    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Read names: a file has its own behind the student's, a folder has none."""
        return {
            match[0]: Delivered(match["name"].strip(), match["id"], match["file"])
            for folders in (False, True)
            for match in matches(_NAME, entries, folders=folders)
            if folders != bool(match["file"])
        }
