"""Patterns for a submission's files in a rubric, such as `**/launch/*.py`.

A pattern is a path from the submission's root. `*`, `?` and `[...]` match within one name, and `**` any number of
folders. Capitals count.
"""

from __future__ import annotations

import fnmatch
import re
from functools import lru_cache
from pathlib import PurePosixPath

ANY_FOLDERS = "**"
_DRIVE = re.compile(r"[A-Za-z]:")


def mistake_in(pattern: str) -> str:
    """Say why a pattern can match no file of any submission; empty if it can."""
    parts = pattern.split("/")
    if not pattern.strip():
        return "an empty pattern matches no file"
    if "\\" in pattern:
        return f"{pattern!r} matches no file; folders are separated by /"
    is_absolute = parts[0] == ""
    if is_absolute or _DRIVE.match(pattern):
        return f"{pattern!r} matches no file; a pattern begins at the submission's root, without a / before it"
    if parts[-1] == "":
        return f"{pattern!r} matches no file; it ends with a folder"
    if {"", ".", ".."} & set(parts):
        return f"{pattern!r} matches no file; leave out '.', '..' and double slashes"
    return ""


def matches(pattern: str, path: PurePosixPath) -> bool:
    """Tell whether a pattern matches the path of a file, relative to the submission's root."""
    parts = path.parts
    #: The numbers of leading parts of the path that the pattern so far can match.
    reached = {0}
    for piece in pattern.split("/"):
        if piece == ANY_FOLDERS:
            reached = set(range(min(reached), len(parts) + 1))
        else:
            named = _named(piece)
            inside = (n for n in reached if n < len(parts))
            reached = {n + 1 for n in inside if named.match(parts[n])}
        if not reached:
            return False
    return len(parts) in reached


def anywhere(pattern: str) -> str:
    """Return a pattern without the `**/` before it: `x.py` and `**/x.py` name the same files, in one folder or in any."""
    return pattern.removeprefix(f"{ANY_FOLDERS}/")


@lru_cache(maxsize=512)
def _named(piece: str) -> re.Pattern[str]:
    return re.compile(fnmatch.translate(piece))
