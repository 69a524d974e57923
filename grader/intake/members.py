"""What a folder or an archive holds, one member after another; and the folders among the two."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from functools import partial
from itertools import islice
from pathlib import Path
from typing import IO

from grader.errors import SubmissionError
from grader.intake.names import TOOL_FOLDERS

_PIECE_BYTES = 64 * 1024


class Kind(Enum):
    """What a member is; for what is not taken in, the value says why."""

    FILE = "a file"
    FOLDER = "a folder"
    LINK = "a symbolic link"
    HARD_LINK = "a hard link"
    SPECIAL = "not a regular file"
    SPARSE = "a sparse file"
    METHOD = "packed by a method that is not read here"
    UNREADABLE = "not readable"
    CLOSED = "a folder that is not readable"
    DEEP = "too many folders deep"


@dataclass(frozen=True)
class Member:
    """A file or something else in a folder or an archive.

    Attributes
    ----------
    name : str
        As it stands there; not to be trusted.
    size_bytes : int
        What is claimed.
    packed_bytes : int or None
        What it takes in the archive, if that is known.
    modified : datetime or None
        With its offset from UTC.
    pieces : callable
        Gives the content, piece by piece; only until the next member is asked for.
    """

    name: str
    kind: Kind
    size_bytes: int = 0
    packed_bytes: int | None = None
    modified: datetime | None = None
    pieces: Callable[[], Iterator[bytes]] = lambda: iter(())


def pieces_of(file: IO[bytes]) -> Iterator[bytes]:
    """Read a file piece by piece."""
    return iter(partial(file.read, _PIECE_BYTES), b"")


def too_much(what: str) -> SubmissionError:
    """Return the error of a submission that holds more of something than anyone hands in."""
    return SubmissionError(
        f"the submission holds {what}", remedy="Hand it in without recordings, build folders and the like."
    )


def is_folder(path: Path) -> bool:
    """Whether a path leads to a folder; never fails."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def open_regular(path: str | Path, folder: int | None = None) -> int:
    """Open a file for reading if it is a regular one, without waiting for and without following anything.

    Parameters
    ----------
    folder : int or None
        Open folder that the path is relative to.

    Raises
    ------
    OSError
        If it is none, or may not be read.
    """
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY, dir_fd=folder)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise OSError("not a regular file")
    return file


def members_of_folder(path: Path, most: int, most_depth: int) -> Iterator[Member]:
    """Go through a folder: its files by name, then its folders. Folders that tools made are named, not entered.

    Parameters
    ----------
    most : int
        Names in one folder that are read.
    most_depth : int
        Folders within each other that are entered.

    Raises
    ------
    OSError
        If the folder itself cannot be read.
    SubmissionError
        If there is more than that in one folder.
    """
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield from _below(folder, (), most, most_depth)
    finally:
        os.close(folder)


def _below(folder: int, above: tuple[str, ...], most: int, most_depth: int) -> Iterator[Member]:
    with os.scandir(folder) as entries:
        found = [(entry.is_dir(follow_symlinks=False), entry.name) for entry in islice(entries, most + 1)]
    if len(found) > most:
        raise too_much(f"more than {most:,} files")
    for is_folder, name in sorted(found):
        path = "/".join((*above, name))
        if not is_folder:
            yield from _file(folder, name, path)
            continue
        yield Member(path, Kind.FOLDER)
        if name in TOOL_FOLDERS:
            continue
        if len(above) >= most_depth:
            yield Member(path, Kind.DEEP)
        else:
            yield from _folder(folder, (*above, name), most, most_depth)


def _folder(folder: int, parts: tuple[str, ...], most: int, most_depth: int) -> Iterator[Member]:
    try:
        inner = os.open(parts[-1], os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)
    except OSError:
        yield Member("/".join(parts), Kind.CLOSED)
        return
    try:
        yield from _below(inner, parts, most, most_depth)
    finally:
        os.close(inner)


def _file(folder: int, name: str, path: str) -> Iterator[Member]:
    try:
        mode = os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode
        if not stat.S_ISREG(mode):
            yield Member(path, Kind.LINK if stat.S_ISLNK(mode) else Kind.SPECIAL)
            return
        file = open_regular(name, folder)
    except OSError:
        yield Member(path, Kind.UNREADABLE)
        return
    with os.fdopen(file, "rb", buffering=0) as content:
        yield Member(path, Kind.FILE, os.fstat(file).st_size, pieces=partial(pieces_of, content))
