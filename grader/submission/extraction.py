"""Extraction of submissions: every submitted file passes the same rules into a clean folder.

A folder is copied, as an archive is extracted. Later changes by the student have no effect, and the rest of the grader
reads only regular files with displayable names. The work runs in a process of its own; the kernel bounds its time, its
memory and the size of its files, for any archive.
"""

from __future__ import annotations

import difflib
import os
import posixpath
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import BinaryIO, TypeVar

from grader.bounded import Bound, in_process
from grader.errors import BoundError, SubmissionError
from grader.lab.policy import SubmissionTime, latest
from grader.recording.submission import Identity
from grader.submission import file_names
from grader.submission.beneath import is_regular_beneath, open_regular_beneath
from grader.submission.members import (
    HEAD_BYTES,
    Kind,
    Member,
    format_of,
    is_folder,
    members_of_archive,
    members_of_folder,
    pieces_of,
    too_much,
)

#: Suffixes of sources and texts. These files have limits of their own; recordings and pictures cannot crowd them out.
_SOURCE_SUFFIXES = file_names.TEXT_SUFFIXES | frozenset(
    {
        ".c",
        ".cc",
        ".cpp",
        ".h",
        ".hpp",
        ".cmake",
        ".sh",
        ".json",
        ".msg",
        ".srv",
        ".action",
        ".urdf",
        ".xacro",
    }
)
#: Suffixes of programs; an archive beside a program is not the submission.
_PROGRAM_SUFFIXES = frozenset({".py", ".c", ".cc", ".cpp", ".hpp", ".launch", ".sh"})
#: Archives within each other that are unpacked: that of a learning-management system, and that of a student.
_MOST_NESTED = 2
#: First bytes of compiled code: ELF, Mach-O, Java, WebAssembly, libraries of objects.
_COMPILED_MAGIC = (
    b"\x7fELF",
    b"\xfe\xed\xfa\xce",
    b"\xfe\xed\xfa\xcf",
    b"\xce\xfa\xed\xfe",
    b"\xcf\xfa\xed\xfe",
    b"\xca\xfe\xba\xbe",
    b"\x00asm",
    b"!<arch>\n",
)
#: Left-out files that are named for each reason; others are counted.
_MOST_NAMED = 10
#: Unreadable files that are kept.
_MOST_UNREADABLE = 1000
_WITHIN = "an archive within the submission"
#: Files of a whole class in one archive.
_MOST_LISTED = 200_000


@dataclass(frozen=True)
class Limits:
    """Limits of an extraction; files beyond are left out and listed."""

    #: Files and folders; a submission with more is refused.
    members: int = 50_000
    #: Number of sources and texts, and number of other files.
    files: int = 2_000
    #: Size of all sources and texts.
    source_bytes: int = 32 * 1024**2
    #: Size of all other files.
    other_bytes: int = 96 * 1024**2
    #: Size of one file.
    file_bytes: int = 8 * 1024**2
    #: Size of an archive within an archive.
    archive_bytes: int = 128 * 1024**2
    #: Folders within each other.
    depth: int = 20
    #: Folders with extracted files.
    folders: int = 2_000


LIMITS = Limits()
_BOUND = Bound(
    "unpacking it",
    cpu_s=20,
    wall_s=600,
    memory_bytes=128 * 1024**2,
    file_bytes=LIMITS.archive_bytes,
)

T = TypeVar("T")


def in_bounds(work: Callable[[], T], location: str, bound: Bound = _BOUND) -> T:
    """Do some work on a submission in a bounded process, and return its result.

    Raises SubmissionError, with the submission's location, if the work raises it or exceeds the bound.
    """
    try:
        return in_process(work, bound)
    except BoundError as error:
        raise SubmissionError(
            error.problem, location=location, remedy=too_much("").remedy
        ) from None
    except SubmissionError as error:
        error.location = error.location or location
        raise


@dataclass(frozen=True)
class Piece:
    """A submitted folder, archive, file, or part of an archive."""

    path: Path
    #: File or folder in the archive, as `names_in` names it, a folder with a slash at its end; empty for everything.
    member: str = ""
    #: Name of a single file in the submission; empty for the name in its path.
    name: str = ""


@dataclass(frozen=True)
class SubmissionSource:
    """The origin of a submission, before it is extracted."""

    #: Unique name of the submission and of its results, fit for a file's name.
    name: str
    pieces: tuple[Piece, ...]
    #: Id of the student in a learning-management system.
    student_id: str | None = None
    #: Time of submission, without offset from UTC if its source has none.
    submitted_at: datetime | None = None
    #: The learning-management system that marks the submission as late; empty for none.
    marked_late_by: str = ""
    #: Name of the student in a learning-management system.
    student: str = ""
    #: All known facts about the students.
    identity: Identity = field(default_factory=Identity)
    #: Location in words; students write parts of it, and it must not be trusted.
    location: str = ""
    #: Path of the submission, independent of the way that it was typed; empty if unknown.
    origin: str = ""
    #: The source of the time of submission, in words.
    time_source: str = ""
    #: The time of the newest file in the archive, once that is extracted; it proves nothing.
    newest_file: datetime | None = None
    #: The time of the last commit in the repository; it proves nothing.
    last_commit: datetime | None = None

    @property
    def submission_time(self) -> SubmissionTime:
        """Time of submission, with its source."""
        return SubmissionTime(
            self.submitted_at,
            self.time_source,
            self.newest_file,
            self.last_commit,
            self.marked_late_by,
        )

    @classmethod
    def of(cls, path: Path) -> SubmissionSource:
        """Return the submission at a path, with the name of its folder or archive."""
        name = Path(os.path.realpath(path)).name or "submission"
        if is_folder(path):
            named = name
        else:
            named = file_names.without_archive_suffix(name)
        return cls(named, (Piece(path),), location=str(path), origin=os.path.realpath(path))


@dataclass(frozen=True)
class Intake:
    """An extracted submission."""

    #: Folder with regular files only.
    folder: Path
    #: The source, with the time of the newest file in the archive.
    source: SubmissionSource
    #: A line with the reason for each file that was not extracted.
    left_out: tuple[str, ...] = ()
    #: Unreadable files, and folders with a slash at the end; some of many.
    unreadable: tuple[str, ...] = ()


@contextmanager
def open_submission(
    source: SubmissionSource | Path, *, prefix: str = "grade-", limits: Limits = LIMITS
) -> Iterator[Intake]:
    """Extract a submission (or `SubmissionSource.of` a path) while the context lasts.

    Of members with the same name the last counts, as for `unzip` and `tar`; of names that Windows and macOS cannot keep
    apart, the first. A symbolic link to a file of the submission becomes a copy of it; other links are left out. A single
    archive without a program beside it is unpacked, also within an archive; other archives are left out.

    Raises
    ------
    SubmissionError
        If the submission is empty, cannot be read to its end, or is absurdly large.
    """
    if isinstance(source, Path):
        source = SubmissionSource.of(source)
    with tempfile.TemporaryDirectory(prefix=f"{prefix}intake-") as scratch:
        yield in_bounds(partial(_extracted, source, Path(scratch), limits), source.location)


def _extracted(source: SubmissionSource, scratch: Path, limits: Limits) -> Intake:
    extraction = _Extraction(scratch, limits)
    for piece in source.pieces:
        extraction.add_piece(piece, alone=len(source.pieces) == 1)
    for _ in range(_MOST_NESTED):
        extraction.unpack_single_archive()
    extraction.add_linked_files()
    left_out = extraction.left_out()
    if not extraction.kept and left_out:
        first = "; ".join(left_out[:3])
        raise SubmissionError(
            "no file of the submission could be used", remedy=f"Left out: {first}."
        )
    if not extraction.kept:
        raise SubmissionError("the submission is empty", remedy="Put the lab's files into it.")
    source = replace(source, newest_file=extraction.newest)
    return Intake(extraction.folder, source, left_out, tuple(extraction.unreadable))


class _Extraction:
    """A submission that is being extracted."""

    def __init__(self, scratch: Path, limits: Limits) -> None:
        self.folder = scratch / "submission"
        self.folder.mkdir()
        self.newest: datetime | None = None
        self.unreadable: list[str] = []
        #: Names of members in the submission, by collision key.
        self.kept: dict[str, str] = {}
        self._limits = limits
        self._members = 0
        #: Names of left-out members, by reason.
        self._reasons: dict[str, list[str]] = {}
        self._tool_folders: set[str] = set()
        #: Collision keys of folders.
        self._folders: set[str] = set()
        #: Number and size of files that still fit: sources and texts (True), and others.
        self._room = {
            True: [limits.files, limits.source_bytes],
            False: [limits.files, limits.other_bytes],
        }
        self._has_programs = False
        self._archives: list[str] = []
        #: Symbolic links, with their places.
        self._links: list[tuple[Member, tuple[str, ...]]] = []
        self._partial = scratch / "partial"
        self._archive = scratch / "archive-0"

    def add_piece(self, piece: Piece, *, alone: bool) -> None:
        """Add a piece; an archive that is the only piece is unpacked."""
        try:
            if is_folder(piece.path):
                self._add_all(members_of_folder(piece.path, self._limits.depth))
            else:
                with _opened(piece.path) as file:
                    self._add_file(file, piece, alone=alone)
        except FileNotFoundError:
            remedy = f"Check the path. {_neighbours(piece.path)}".strip()
            raise SubmissionError("there is no such submission", remedy=remedy) from None
        except PermissionError:
            remedy = "Give yourself the right to read it."
            raise SubmissionError("the submission may not be read", remedy=remedy) from None

    def _add_file(self, file: BinaryIO, piece: Piece, *, alone: bool) -> None:
        is_archive = format_of(file.read(HEAD_BYTES)) is not None
        if file_names.is_packed(piece.path.name):
            is_archive = True
        file.seek(0)
        if piece.member:
            self._add_all(_part_of(members_of_archive(file), piece.member, piece.name))
        elif alone and is_archive:
            self._add_all(members_of_archive(file), timed=True)
        else:
            name = piece.name or piece.path.name
            size = os.fstat(file.fileno()).st_size
            self._add_all([Member(name, Kind.FILE, size, pieces=partial(pieces_of, file))])

    def unpack_single_archive(self) -> None:
        """Unpack a single archive within the archive or beside documents."""
        if len(self._archives) == 1 and not self._has_programs:
            self._archives.clear()
            with self._archive.open("rb") as file:
                # The archive can hold another one.
                self._archive.unlink()
                self._add_all(members_of_archive(file), timed=True)

    def add_linked_files(self) -> None:
        """Add a copy of each extracted file to which a symbolic link leads; other links are left out.

        Targets are compared as texts with the extracted files, and no link is followed.
        """
        for link, parts in self._links:
            try:
                self._add_linked(link, parts)
            except file_names.UnfitError as reason:
                self._note(link.name, str(reason))

    def _add_linked(self, link: Member, parts: tuple[str, ...]) -> None:
        """Add a copy of an extracted file in the place of a link to it, or raise UnfitError."""
        above = "/".join(parts[:-1])
        target = posixpath.join(above, link.target)
        path = posixpath.normpath(target)
        is_free = file_names.collision_key(parts) not in self.kept
        is_file = is_regular_beneath(self.folder, path)
        if not (is_free and is_file):
            raise file_names.UnfitError(link.kind.value)
        with (self.folder / path).open("rb") as file:
            content = partial(pieces_of, file)
            copy = replace(link, kind=Kind.FILE, size_bytes=0, pieces=content)
            self._add(copy, parts)

    def left_out(self) -> tuple[str, ...]:
        """Return a line for each file that was left out; many files with one reason share a line."""
        reason = _WITHIN
        if len(self._archives) > 1 and not self._has_programs:
            reason += ", one of several; it is not clear which of them counts"
        for name in self._archives:
            self._note(name, reason)
        lines = []
        for reason, left_out in self._reasons.items():
            for name in left_out[:_MOST_NAMED]:
                shown = file_names.displayed(name)
                lines.append(f"{shown}: {reason}")
            more = len(left_out) - _MOST_NAMED
            if more > 0:
                lines.append(f"and {more:,} more: {reason}")
        return tuple(lines)

    def _note(self, name: str, reason: str) -> None:
        self._reasons.setdefault(reason, []).append(name)

    def _add_all(self, members: Iterable[Member], *, timed: bool = False) -> None:
        for member in members:
            self._members += 1
            if self._members > self._limits.members:
                raise too_much(f"more than {self._limits.members:,} files and folders")
            try:
                added = self._add(member, file_names.clean_parts(member.name))
            except file_names.UnfitError as reason:
                self._note(member.name, str(reason))
                continue
            modified = member.modified
            if added and timed and modified:
                times = (self.newest or modified, modified)
                self.newest = max(times, key=latest)

    def _add(self, member: Member, parts: tuple[str, ...]) -> bool:
        """Add a file, unless a tool or the system made it; returns whether it was added."""
        if self._is_made_by_tool(member, parts):
            return False
        if member.kind is Kind.LINK:
            self._links.append((member, parts))
            return False
        self._require_fit(member, parts)
        pieces = member.pieces()
        head = next(pieces, b"")
        name = parts[-1]
        suffix = PurePosixPath(name).suffix.lower()
        can_be_archive = file_names.is_packed(name) or suffix in ("", ".py")
        if can_be_archive and format_of(head[:HEAD_BYTES]) is not None:
            self._keep_archive(member, chain([head], pieces))
            return False
        if _is_machine_code(head) or file_names.is_compiled(name):
            raise file_names.UnfitError("compiled code")
        room = self._room[suffix in _SOURCE_SUFFIXES]
        self._copy(member, parts, chain([head], pieces), room)
        self._has_programs = self._has_programs or suffix in _PROGRAM_SUFFIXES
        return True

    def _is_made_by_tool(self, member: Member, parts: tuple[str, ...]) -> bool:
        """Return whether a member is a folder, is in a tool's folder, or is litter of a file manager."""
        is_folder = member.kind is Kind.FOLDER
        made = file_names.tool_folder((*parts, "") if is_folder else parts)
        if made is not None and made not in self._tool_folders:
            self._tool_folders.add(made)
            self._note(f"{made}/", "made by a tool")
        if made is not None or is_folder:
            return True
        return file_names.is_litter(parts[-1])

    def _require_fit(self, member: Member, parts: tuple[str, ...]) -> None:
        """Raise UnfitError unless a member is a regular file in a free place; notes an unreadable one."""
        path = "/".join(parts)
        if len(self.unreadable) < _MOST_UNREADABLE:
            if member.kind is Kind.UNREADABLE:
                self.unreadable.append(path)
            elif member.kind is Kind.CLOSED:
                self.unreadable.append(f"{path}/")
        if member.kind is not Kind.FILE:
            raise file_names.UnfitError(member.kind.value)
        if len(parts) > self._limits.depth + 1:
            raise file_names.UnfitError(Kind.DEEP.value)
        if self.kept.get(file_names.collision_key(parts), member.name) != member.name:
            raise file_names.UnfitError(
                "its name differs from another only in case or in the form of its letters"
            )

    def _copy(
        self, member: Member, parts: tuple[str, ...], content: Iterator[bytes], room: list[int]
    ) -> None:
        """Copy a file into the clean folder, within the limits for files of its kind."""
        if room[0] <= 0:
            raise file_names.UnfitError(f"more than {self._limits.files:,} files of its kind")
        folders = {file_names.collision_key(parts[:depth]) for depth in range(1, len(parts))}
        folders -= self._folders
        if len(self._folders) + len(folders) > self._limits.folders:
            raise file_names.UnfitError(f"more than {self._limits.folders:,} folders")
        most = self._limits.file_bytes
        why = f"larger than {most // 1024**2} MiB"
        if room[1] < most:
            most = room[1]
            why = "files of its kind are too large together"
        size = self._write(member, content, most, why)
        target = self.folder.joinpath(*parts)
        key = file_names.collision_key(parts)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            self._partial.replace(target)
        except (FileExistsError, NotADirectoryError, IsADirectoryError):
            raise file_names.UnfitError("a file where another has a folder") from None
        room[0] -= 1
        room[1] -= size
        self._folders |= folders
        if key in self.kept:
            self._note(member.name, "an earlier file of the same name")
        elif file_names.differ(member.name, parts):
            self._note(
                member.name, "used, without the characters of its name that cannot be displayed"
            )
        self.kept[key] = member.name

    def _keep_archive(self, member: Member, content: Iterator[bytes]) -> None:
        """Keep the first archive, which can be the only one; of other archives, only the name is needed."""
        if not self._archives:
            most = self._limits.archive_bytes
            self._write(member, content, most, f"an archive larger than {most // 1024**2} MiB")
            self._partial.rename(self._archive)
        self._archives.append(member.name)

    def _write(self, member: Member, content: Iterator[bytes], most: int, otherwise: str) -> int:
        """Write a file of limited size, which is moved to its place later; returns the size."""
        size = member.size_bytes
        if size > most:
            raise file_names.UnfitError(otherwise)
        with self._partial.open("wb") as file:
            for piece in content:
                file.write(piece)
                size = max(size, file.tell())
                if size > most:
                    break
        if size > most:
            raise file_names.UnfitError(otherwise)
        return size


def _is_machine_code(head: bytes) -> bool:
    """Return whether a file with some first bytes is compiled code."""
    if head.startswith(_COMPILED_MAGIC):
        return True
    return head.startswith(b"MZ") and b"\0" in head


def _opened(path: Path) -> BinaryIO:
    try:
        return os.fdopen(open_regular_beneath(Path("/"), os.path.realpath(path)[1:]), "rb")
    except (FileNotFoundError, PermissionError):
        raise
    except OSError:
        remedy = "This is something else; check the path."
        raise SubmissionError(
            "a submission is a folder, an archive or a file", remedy=remedy
        ) from None


def _part_of(members: Iterable[Member], part: str, name: str) -> Iterator[Member]:
    """Yield a file, or the contents of a folder, of an archive, with names relative to it."""
    is_folder = part.endswith("/")
    for member in members:
        path = file_names.slashed(member.name)
        if not is_folder and path == part:
            yield replace(member, name=name or PurePosixPath(part).name)
        elif is_folder and path != part and path.startswith(part):
            yield replace(member, name=path[len(part) :])


# -- archives of a whole class ---------------------------------------------------------------------


def names_in(path: Path, within: str = "") -> list[str] | None:
    """Return the names in an archive, or in an archive `within` it, with slashes; folders end with a slash.

    Returns None for another file, an unreadable archive, or more files than a class submits.
    """
    with suppress(OSError, SubmissionError):
        return in_bounds(partial(_names_in, path, within), str(path))
    return None


def _names_in(path: Path, within: str) -> list[str] | None:
    with _opened(path) as file, tempfile.TemporaryFile() as inner:
        if not within:
            return [_listed(member) for member in _members_of_class(file)]
        for member in _members_of_class(file):
            if _listed(member) == within:
                inner.writelines(member.pieces())
                inner.seek(0)
                return [_listed(member) for member in _members_of_class(inner)]
    return None


def _members_of_class(file: BinaryIO) -> Iterator[Member]:
    for number, member in enumerate(members_of_archive(file)):
        if number >= _MOST_LISTED:
            raise too_much(f"more than {_MOST_LISTED:,} files")
        yield member


def _listed(member: Member) -> str:
    name = file_names.slashed(member.name).rstrip("/")
    if member.kind is Kind.FOLDER:
        return f"{name}/"
    return name


def text_of(folder: Path, name: str, most_bytes: int) -> str | None:
    """Return the text of a system's file beside submissions; None if it cannot be read or is elsewhere."""
    with suppress(OSError), os.fdopen(open_regular_beneath(folder, name), "rb") as file:
        return file.read(most_bytes).decode("utf-8", "replace")
    return None


def texts_in(path: Path, wanted: Collection[str], most_bytes: int) -> dict[str, str]:
    """Return the texts of a system's files in an archive, by names as in `names_in`.

    Unreadable files are left out; the size of all files is limited.
    """
    with suppress(OSError, SubmissionError):
        return in_bounds(partial(_texts_in, path, wanted, most_bytes), str(path))
    return {}


def _texts_in(path: Path, wanted: Collection[str], most_bytes: int) -> dict[str, str]:
    found: dict[str, str] = {}
    with _opened(path) as file, suppress(SubmissionError):
        for member in _members_of_class(file):
            if (name := _listed(member)) in wanted:
                content = b""
                for piece in member.pieces():
                    content += piece[: most_bytes - len(content)]
                most_bytes -= len(content)
                found[name] = content.decode("utf-8", "replace")
    return found


def _neighbours(path: Path) -> str:
    """Name entries beside a missing path, the most similar ones if there are any."""
    found = []
    with suppress(OSError):
        found = [p for p in path.parent.iterdir() if not p.name.startswith(".")]
    usable = [p.name for p in found if p.is_dir() or file_names.is_packed(p.name)]
    there = sorted(usable)
    near = difflib.get_close_matches(path.name, there, n=3, cutoff=0.5) or there[:5]
    if near:
        return f"In {path.parent}/ there is: {', '.join(near)}."
    return ""
