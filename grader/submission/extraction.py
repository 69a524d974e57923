"""The one way in: every file that a student hands in passes the same rules into a clean folder.

A folder is copied as an archive is extracted. So what a student changes meanwhile does not matter, and the rest of the
grader meets nothing but regular files under names that can be shown. The work is done in a process of its own, of which
the kernel bounds time, memory and the size of files, whatever an archive makes its reader do.
"""

from __future__ import annotations

import difflib
import os
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
from grader.submission.beneath import open_regular_beneath
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

#: What submissions are made of. These files have room of their own, so that a student's recordings and pictures,
#: however many, do not crowd them out.
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
#: Beside one of these, an archive is not what was meant to be handed in.
_PROGRAM_SUFFIXES = frozenset({".py", ".c", ".cc", ".cpp", ".hpp", ".launch", ".sh"})
#: How many archives within each other are unpacked: what a learning-management system packed, and what a student did.
_MOST_NESTED = 2
#: How compiled code begins: ELF, Mach-O, Java, WebAssembly, libraries of objects.
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
#: Left-out files that are named for one reason; of others, how many there are is said.
_MOST_NAMED = 10
_MOST_UNREADABLE = 1000
_WITHIN = "an archive within the submission"
#: Files of a whole class in one archive.
_MOST_LISTED = 200_000


@dataclass(frozen=True)
class Limits:
    """What is extracted at most; the rest is left out and listed."""

    #: Files and folders that are looked at; with more, the submission is refused.
    members: int = 50_000
    #: Sources and texts; and as many files of other kinds.
    files: int = 2_000
    #: Sources and texts in all; files of other kinds in all.
    source_bytes: int = 32 * 1024**2
    other_bytes: int = 96 * 1024**2
    file_bytes: int = 8 * 1024**2
    #: An archive within an archive.
    archive_bytes: int = 128 * 1024**2
    #: Folders within each other, and folders that hold what is extracted.
    depth: int = 20
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
    """Return what work on a submission returns, done in a bounded process.

    Raises SubmissionError if it raises that, or exceeds the bound; with where the submission comes from.
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
    """Something that was handed in: a folder, an archive, a file, or a part of an archive."""

    path: Path
    #: What of the archive is meant, as `names_in` tells it: a file, or a folder with a slash at its end; or everything.
    member: str = ""
    #: What a single file is called in the submission, if not as its path says.
    name: str = ""


@dataclass(frozen=True)
class SubmissionSource:
    """Where a submission comes from, before it is extracted."""

    #: Under which its results are known: fit for a file's name, and of one submission only.
    name: str
    pieces: tuple[Piece, ...]
    #: What a learning-management system tells: its id of the student, whether it is marked as late, the student's name.
    student_id: str | None = None
    #: When it was handed in, without offset from UTC if the source of the time names none.
    submitted_at: datetime | None = None
    late: bool = False
    student: str = ""
    #: All that is known of those who handed it in.
    identity: Identity = field(default_factory=Identity)
    #: Where it comes from, in words; written by students, so not to be trusted.
    location: str = ""
    #: The path that it was found by, the same however that was typed; empty where nobody knows.
    origin: str = ""
    #: The source of the time of submission, in words.
    time_source: str = ""
    #: The time of the newest file in the archive, once that is extracted; it proves nothing.
    newest_file: datetime | None = None

    @property
    def submission_time(self) -> SubmissionTime:
        """When it was handed in, and how that is known."""
        return SubmissionTime(self.submitted_at, self.time_source, self.newest_file)

    @classmethod
    def of(cls, path: Path) -> SubmissionSource:
        """Return the submission that a path stands for, called as the folder or archive is."""
        name = Path(os.path.realpath(path)).name or "submission"
        named = name if is_folder(path) else file_names.without_archive_suffix(name)
        return cls(named, (Piece(path),), location=str(path), origin=os.path.realpath(path))


@dataclass(frozen=True)
class Intake:
    """An extracted submission."""

    #: Holds regular files only.
    folder: Path
    #: With the time of the newest file in the archive.
    source: SubmissionSource
    #: What was not extracted, a line each with its reason.
    left_out: tuple[str, ...] = ()
    #: Files, and folders with a slash at the end, that are there and may not be read; some of many.
    unreadable: tuple[str, ...] = ()


@contextmanager
def open_submission(
    source: SubmissionSource | Path, *, prefix: str = "grade-", limits: Limits = LIMITS
) -> Iterator[Intake]:
    """Extract a submission (a path stands for `SubmissionSource.of` it) for as long as the context lasts.

    Raises SubmissionError if there is nothing, or it cannot be read to its end, or is more than anyone hands in.

    Of members with the same name the last counts, as it does for `unzip` and `tar`; of names that Windows and macOS
    cannot keep apart, the first. Hard links in a tar are left out. One archive beside which no program lies is
    unpacked, also within an archive; others are left out.
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
    left_out = extraction.left_out()
    if not extraction.kept:
        problem = (
            "no file of the submission could be used" if left_out else "the submission is empty"
        )
        remedy = (
            f"Left out: {'; '.join(left_out[:3])}." if left_out else "Put the lab's files into it."
        )
        raise SubmissionError(problem, remedy=remedy)
    source = replace(source, newest_file=extraction.newest)
    return Intake(extraction.folder, source, left_out, tuple(extraction.unreadable))


class _Extraction:
    """A submission that is being extracted."""

    def __init__(self, scratch: Path, limits: Limits) -> None:
        self.folder = scratch / "submission"
        self.folder.mkdir()
        self.newest: datetime | None = None
        self.unreadable: list[str] = []
        self.kept: dict[str, str] = {}  # collision key -> the name it came under
        self._limits = limits
        self._members = 0
        self._reasons: dict[str, list[str]] = {}  # why something was left out -> its names
        self._tool_folders: set[str] = set()
        self._folders: set[str] = set()  # their collision keys
        self._room = {
            True: [limits.files, limits.source_bytes],
            False: [limits.files, limits.other_bytes],
        }
        self._has_programs = False
        self._archives: list[str] = []
        self._partial, self._archive = scratch / "partial", scratch / "archive-0"

    def add_piece(self, piece: Piece, *, alone: bool) -> None:
        """Add a piece; if it is the only one, an archive is the submission."""
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
        is_archive = format_of(file.read(HEAD_BYTES)) is not None or file_names.is_packed(
            piece.path.name
        )
        file.seek(0)
        if piece.member:
            self._add_all(_part_of(members_of_archive(file), piece.member, piece.name))
        elif alone and is_archive:
            self._add_all(members_of_archive(file), timed=True)
        else:
            size, name = os.fstat(file.fileno()).st_size, piece.name or piece.path.name
            self._add_all([Member(name, Kind.FILE, size, pieces=partial(pieces_of, file))])

    def unpack_single_archive(self) -> None:
        """Unpack an archive that was handed in within the archive or beside documents."""
        if len(self._archives) == 1 and not self._has_programs:
            self._archives.clear()
            with self._archive.open("rb") as file:
                self._archive.unlink()  # Another may be in it.
                self._add_all(members_of_archive(file), timed=True)

    def left_out(self) -> tuple[str, ...]:
        """Return a line for each file that was left out; for those that would be too many, one for each reason."""
        several = len(self._archives) > 1 and not self._has_programs
        for name in self._archives:
            self._note(
                name, _WITHIN + ", one of several; it is not clear which of them counts" * several
            )
        lines = []
        for reason, left_out in self._reasons.items():
            lines += [f"{file_names.displayed(name)}: {reason}" for name in left_out[:_MOST_NAMED]]
            if len(left_out) > _MOST_NAMED:
                lines.append(f"and {len(left_out) - _MOST_NAMED:,} more: {reason}")
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
            if added and timed and member.modified:
                times = (self.newest or member.modified, member.modified)
                self.newest = max(times, key=latest)

    def _add(self, member: Member, parts: tuple[str, ...]) -> bool:
        """Add a file, if it is one that a student may have meant to hand in; returns whether it was."""
        is_folder = member.kind is Kind.FOLDER
        made = file_names.tool_folder((*parts, "") if is_folder else parts)
        if made is not None and made not in self._tool_folders:
            self._tool_folders.add(made)
            self._note(f"{made}/", "made by a tool")
        if made is not None or is_folder or file_names.is_litter(parts[-1]):
            return False
        if (
            member.kind in (Kind.UNREADABLE, Kind.CLOSED)
            and len(self.unreadable) < _MOST_UNREADABLE
        ):
            self.unreadable.append("/".join(parts) + "/" * (member.kind is Kind.CLOSED))
        if member.kind is not Kind.FILE or len(parts) > self._limits.depth + 1:
            raise file_names.UnfitError(
                (Kind.DEEP if member.kind is Kind.FILE else member.kind).value
            )
        if self.kept.get(file_names.collision_key(parts), member.name) != member.name:
            raise file_names.UnfitError(
                "its name differs from another only in case or in the form of its letters"
            )
        pieces = member.pieces()
        head = next(pieces, b"")
        suffix = PurePosixPath(parts[-1]).suffix.lower()
        if (file_names.is_packed(parts[-1]) or suffix in ("", ".py")) and format_of(
            head[:HEAD_BYTES]
        ) is not None:
            self._keep_archive(member, chain([head], pieces))
            return False
        is_machine_code = head.startswith(_COMPILED_MAGIC) or (
            head.startswith(b"MZ") and b"\0" in head
        )
        if is_machine_code or file_names.is_compiled(parts[-1]):
            raise file_names.UnfitError("compiled code")
        self._copy(member, parts, chain([head], pieces), self._room[suffix in _SOURCE_SUFFIXES])
        self._has_programs = self._has_programs or suffix in _PROGRAM_SUFFIXES
        return True

    def _copy(
        self, member: Member, parts: tuple[str, ...], content: Iterator[bytes], room: list[int]
    ) -> None:
        """Copy a file into the clean folder, as far as there is room for files and bytes of its kind."""
        if room[0] <= 0:
            raise file_names.UnfitError(f"more than {self._limits.files:,} files of its kind")
        folders = {
            file_names.collision_key(parts[:depth]) for depth in range(1, len(parts))
        } - self._folders
        if len(self._folders) + len(folders) > self._limits.folders:
            raise file_names.UnfitError(f"more than {self._limits.folders:,} folders")
        most, why = self._limits.file_bytes, f"larger than {self._limits.file_bytes // 1024**2} MiB"
        if room[1] < most:
            most, why = room[1], "files of its kind are too large together"
        size = self._write(member, content, most, why)
        target, key = self.folder.joinpath(*parts), file_names.collision_key(parts)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            self._partial.replace(target)
        except (FileExistsError, NotADirectoryError, IsADirectoryError):
            raise file_names.UnfitError("a file where another has a folder") from None
        room[0], room[1] = room[0] - 1, room[1] - size
        self._folders |= folders
        if key in self.kept:
            self._note(member.name, "an earlier file of the same name")
        elif file_names.differ(member.name, parts):
            self._note(
                member.name, "used, without the characters of its name that cannot be displayed"
            )
        self.kept[key] = member.name

    def _keep_archive(self, member: Member, content: Iterator[bytes]) -> None:
        """Keep an archive until it is known whether it is the only one; of others the name is enough."""
        if not self._archives:
            most = self._limits.archive_bytes
            self._write(member, content, most, f"an archive larger than {most // 1024**2} MiB")
            self._partial.rename(self._archive)
        self._archives.append(member.name)

    def _write(self, member: Member, content: Iterator[bytes], most: int, otherwise: str) -> int:
        """Write a file of at most so many bytes, to be put in its place later; returns its size."""
        size = member.size_bytes
        with self._partial.open("wb") as file:
            for piece in content if size <= most else ():
                file.write(piece)
                size = max(size, file.tell())
                if size > most:
                    break
        if size > most:
            raise file_names.UnfitError(otherwise)
        return size


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
    """Pick a file, or all that lies in a folder, out of an archive; under the names that they have without it."""
    for member in members:
        path = file_names.slashed(member.name)
        if path == part and not part.endswith("/"):
            yield replace(member, name=name or PurePosixPath(part).name)
        elif part.endswith("/") and len(path) > len(part) and path.startswith(part):
            yield replace(member, name=path[len(part) :])


# -- what a system packed for a whole class --------------------------------------------------------


def names_in(path: Path, within: str = "") -> list[str] | None:
    """Return the names of the files in an archive, or in one `within` it, with slashes; folders end with one.

    None if it is no archive, or cannot be read, or holds more than a class hands in.
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
    return file_names.slashed(member.name).rstrip("/") + "/" * (member.kind is Kind.FOLDER)


def text_of(folder: Path, name: str, most_bytes: int) -> str | None:
    """Return the text of a file that a system wrote beside submissions; None if it cannot be read or lies elsewhere."""
    with suppress(OSError), os.fdopen(open_regular_beneath(folder, name), "rb") as file:
        return file.read(most_bytes).decode("utf-8", "replace")
    return None


def texts_in(path: Path, wanted: Collection[str], most_bytes: int) -> dict[str, str]:
    """Return the texts of members of an archive that a system wrote beside submissions, as `names_in` names them.

    What cannot be read is left out; the members' sizes together are limited.
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
    """Name what lies where something was looked for."""
    found = []
    with suppress(OSError):
        found = [p for p in path.parent.iterdir() if not p.name.startswith(".")]
    there = sorted(p.name for p in found if p.is_dir() or file_names.is_packed(p.name))
    near = difflib.get_close_matches(path.name, there, n=3, cutoff=0.5) or there[:5]
    return f"In {path.parent}/ there is: {', '.join(near)}." if near else ""
