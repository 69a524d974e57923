"""The names in a folder, or in an archive as if it were unpacked: enough to tell whose files they are."""

from __future__ import annotations

import os
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
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

#: Names in one submission that are looked at to tell what it is.
_MOST_NAMES = 5_000
_MOST_DEPTH = 12
#: Names directly in a folder of submissions.
_MOST_ENTRIES = 1_000_000
#: Bytes that are read of the files beside submissions.
_MOST_NOTES_BYTES = 64 * 1024**2


@dataclass(frozen=True)
class Listing:
    """A folder, or one within an archive, and the names of the files in it."""

    path: Path
    #: The folder within the archive, with a slash at its end; empty for the archive itself, None for a folder.
    within: str | None
    #: Paths relative to it.
    files: tuple[str, ...]

    @property
    def name(self) -> str:
        """The folder's name; of an archive, without the ending."""
        if self.within:
            return PurePosixPath(self.within).name
        name = Path(os.path.realpath(self.path)).name
        return name if self.within is None else without_archive_suffix(name)

    @property
    def location(self) -> str:
        """Where it lies, for a person."""
        return f"{self.path}: {displayed(self.within)}" if self.within else str(self.path)

    @property
    def origin(self) -> str:
        """Where it lies, the same however the path was typed."""
        path = os.path.realpath(self.path)
        return f"{path}: {self.within}" if self.within else path

    @property
    def is_repository(self) -> bool:
        """Whether it is the root of a git repository."""
        return any(file.startswith(".git/") for file in self.files)

    @cached_property
    def _grouped(self) -> dict[str, tuple[str, ...]]:
        """What lies directly in it -> the paths below that; none below a file."""
        groups: dict[str, list[str]] = defaultdict(list)
        for file in self.files:
            first, slash, rest = file.partition("/")
            if first:
                groups[first] += [rest] if slash else []
        return {name: tuple(below) for name, below in groups.items()}

    @cached_property
    def entries(self) -> dict[str, bool]:
        """What lies directly in it -> whether that is a folder; without what nobody hands in."""
        return {
            name: bool(below)
            for name, below in sorted(self._grouped.items())
            if not (name.startswith(".") or is_litter(name) or (below and name in TOOL_FOLDERS))
        }

    @property
    def only_folder(self) -> str | None:
        """The folder that it holds, if it holds nothing else but tables."""
        inner = [name for name, folder in self.entries.items() if folder or not is_table(name)]
        return inner[0] if len(inner) == 1 and self.entries[inner[0]] else None

    def entered(self, folder: str) -> Listing:
        """Return a folder in it, looked at as closely as one that was given itself."""
        if self.within is not None:
            return self.below(folder)
        return listing_of(self.path / folder) or self.below(folder)

    def below(self, folder: str) -> Listing:
        """Return a folder in it."""
        inside = self._grouped[folder]
        if self.within is None:
            return Listing(self.path / folder, None, inside)
        return Listing(self.path, f"{self.within}{folder}/", inside)

    def texts(self, files: Sequence[str]) -> dict[str, str]:
        """Read files below it; what cannot be read is left out."""
        if self.within is not None:
            members = {self.within + file: file for file in files}
            return {
                members[m]: text
                for m, text in texts_in(self.path, members, _MOST_NOTES_BYTES).items()
            }
        read = {file: text_of(self.path, file, _MOST_NOTES_BYTES) for file in files}
        return {file: text for file, text in read.items() if text is not None}

    def piece(self, entry: str = "", *, is_folder: bool = True, name: str = "") -> Piece:
        """Return what lies in it, or one entry."""
        if self.within is None:
            return Piece(self.path / entry if entry else self.path, name=name)
        member = self.within + entry + ("/" if entry and is_folder else "")
        return Piece(self.path, member, name)


def listing_of(path: Path) -> Listing | None:
    """Look at a path; None if it is neither a folder nor an archive that can be read."""
    if is_folder(path):
        return Listing(path, None, tuple(_names_below(path)))
    inside = names_in(path)
    return None if inside is None else Listing(path, "", tuple(inside))


def _names_below(path: Path) -> Iterator[str]:
    for name, inside in _listed(path, _MOST_ENTRIES):
        if not inside:
            yield name
        else:
            yield from list(_walk(path / name, f"{name}/")) or [f"{name}/"]


def _walk(folder: Path, above: str) -> Iterator[str]:
    """Name the files of a folder, as many as it takes to tell what it is."""
    waiting = deque([(folder, above, 1)] if folder.name not in TOOL_FOLDERS else [])
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
    """Return the names in a folder, and whether each is a folder; none if it may not be read."""
    with suppress(OSError), os.scandir(folder) as entries:
        return sorted(
            (entry.name, entry.is_dir(follow_symlinks=False)) for entry in islice(entries, most)
        )
    return []
