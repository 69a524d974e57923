"""The names in a folder, or in an archive as if it were unpacked; they are enough to tell the owner of each file."""

from __future__ import annotations

import os
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path, PurePosixPath

from grader.submission.extraction import Piece, names_in, text_of, texts_in
from grader.submission.file_names import (
    TOOL_FOLDERS,
    displayed,
    is_litter,
    without_archive_suffix,
)
from grader.submission.lms.systems import is_table
from grader.submission.members import is_folder

#: Names in one submission that are read.
_MOST_NAMES = 5_000
#: Folders within each other that are entered.
_MOST_DEPTH = 12
#: Names directly in a folder of submissions that are read.
_MOST_ENTRIES = 1_000_000
#: Bytes that are read of the files beside submissions.
_MOST_NOTES_BYTES = 64 * 1024**2


@dataclass(frozen=True)
class Listing:
    """A folder, or a folder within an archive, and the names of its files."""

    path: Path
    #: The folder within the archive, with a slash at its end; empty for the archive itself, None for a folder.
    within: str | None
    #: Paths relative to the folder.
    files: tuple[str, ...]

    @property
    def name(self) -> str:
        """The folder's name, or the archive's without its suffix."""
        if self.within:
            return PurePosixPath(self.within).name
        name = Path(os.path.realpath(self.path)).name
        if self.within is None:
            return name
        return without_archive_suffix(name)

    @property
    def location(self) -> str:
        """The location of the folder, as shown to people."""
        if not self.within:
            return str(self.path)
        return f"{self.path}: {displayed(self.within)}"

    @property
    def origin(self) -> str:
        """The location of the folder, independent of the way that the path was typed."""
        path = os.path.realpath(self.path)
        if self.within:
            return f"{path}: {self.within}"
        return path

    @property
    def is_repository(self) -> bool:
        """True for the root of a git repository."""
        return any(file.startswith(".git/") for file in self.files)

    @cached_property
    def _grouped(self) -> dict[str, tuple[str, ...]]:
        """Paths below each entry; a file has none."""
        groups: dict[str, list[str]] = defaultdict(list)
        for file in self.files:
            first, slash, rest = file.partition("/")
            if not first:
                continue
            below = groups[first]
            if slash:
                below.append(rest)
        return {name: tuple(below) for name, below in groups.items()}

    @cached_property
    def entries(self) -> dict[str, bool]:
        """Entries that students can have submitted, by name: True for a folder."""
        found: dict[str, bool] = {}
        for name, below in sorted(self._grouped.items()):
            is_of_tool = name in TOOL_FOLDERS and bool(below)
            if not (name.startswith(".") or is_litter(name) or is_of_tool):
                found[name] = bool(below)
        return found

    @property
    def folders(self) -> list[str]:
        """Entries that are folders."""
        return [name for name, is_folder in self.entries.items() if is_folder]

    @property
    def only_folder(self) -> str | None:
        """The folder in a folder without other entries except tables."""
        inner = []
        for name, is_a_folder in self.entries.items():
            if is_a_folder or not is_table(name):
                inner.append(name)
        if len(inner) != 1 or not self.entries[inner[0]]:
            return None
        return inner[0]

    def entered(self, folder: str) -> Listing:
        """Return a folder in this one, read as completely as a folder of the command line."""
        if self.within is not None:
            return self.below(folder)
        return listing_of(self.path / folder) or self.below(folder)

    def below(self, folder: str) -> Listing:
        """Return a folder in this one."""
        inside = self._grouped[folder]
        if self.within is None:
            return Listing(self.path / folder, None, inside)
        return Listing(self.path, f"{self.within}{folder}/", inside)

    def texts(self, files: Sequence[str]) -> dict[str, str]:
        """Return the texts of files in the folder; unreadable ones are left out."""
        found: dict[str, str] = {}
        if self.within is not None:
            members = {self.within + file: file for file in files}
            for member, text in texts_in(self.path, members, _MOST_NOTES_BYTES).items():
                found[members[member]] = text
            return found
        for file in files:
            read = text_of(self.path, file, _MOST_NOTES_BYTES)
            if read is not None:
                found[file] = read
        return found

    def piece(self, entry: str = "", *, is_folder: bool = True, name: str = "") -> Piece:
        """Return the whole folder, or one entry, as a piece of a submission."""
        if self.within is None:
            return Piece(self.path / entry, name=name)
        member = self.within + entry
        if entry and is_folder:
            member += "/"
        return Piece(self.path, member, name)


def listing_of(path: Path) -> Listing | None:
    """Return the listing of a path; None if it is neither a folder nor a readable archive."""
    if is_folder(path):
        return Listing(path, None, tuple(_names_below(path)))
    inside = names_in(path)
    if inside is None:
        return None
    return Listing(path, "", tuple(inside))


def _names_below(path: Path) -> Iterator[str]:
    for name, is_a_folder in _listed(path, _MOST_ENTRIES):
        if not is_a_folder:
            yield name
            continue
        below = list(_walk(path / name, f"{name}/"))
        yield from below or [f"{name}/"]


def _walk(folder: Path, above: str) -> Iterator[str]:
    """Yield the names of a folder's files, as many as are read."""
    if folder.name in TOOL_FOLDERS:
        return
    waiting = deque([(folder, above, 1)])
    seen = 0
    while waiting and seen < _MOST_NAMES:
        folder, above, depth = waiting.popleft()
        for name, inside in _listed(folder):
            seen += 1
            if not inside:
                yield above + name
            elif depth < _MOST_DEPTH and name not in TOOL_FOLDERS:
                waiting.append((folder / name, f"{above}{name}/", depth + 1))


def _listed(folder: Path, most: int = _MOST_NAMES) -> list[tuple[str, bool]]:
    """Return the names in a folder, with True for a folder; none if it may not be read."""
    found = []
    try:
        with os.scandir(folder) as entries:
            for entry in islice(entries, most):
                found.append((entry.name, entry.is_dir(follow_symlinks=False)))
    except OSError:
        return []
    return sorted(found)
