"""The one way in: every file that a student hands in passes the same rules into a clean folder.

A folder is taken in as an archive is. So what a student changes meanwhile does not matter, and the rest of the grader
meets nothing but regular files under names that can be shown. The work is done in a process of its own, of which the
kernel bounds time, memory and the size of files, whatever an archive makes its reader do.
"""

from __future__ import annotations

import difflib
import os
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from itertools import chain, islice
from pathlib import Path, PurePosixPath
from typing import BinaryIO, TypeVar

from grader.beneath import open_regular_beneath
from grader.bounded import Bound, in_process
from grader.errors import BoundError, SubmissionError
from grader.intake import names
from grader.intake.archives import HEAD_BYTES, MOST_RATIO, format_of, members_of_archive
from grader.intake.members import Kind, Member, is_folder, members_of_folder, open_regular, pieces_of, too_much
from grader.intake.notes import Notes

#: What submissions are made of. These files have room of their own, so that a student's recordings and pictures,
#: however many, do not crowd them out.
_SOURCE_SUFFIXES = frozenset(
    {".py", ".md", ".rst", ".txt", ".xml", ".cfg", ".toml", ".yaml", ".yml", ".launch", ".org", ".adoc", ""}
    | {".c", ".cc", ".cpp", ".h", ".hpp", ".cmake", ".sh", ".json", ".msg", ".srv", ".action", ".urdf", ".xacro"}
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
#: Up to here, any compression is believed.
_RATIO_FROM_BYTES = 1024 * 1024
_MOST_UNREADABLE = 1000
_WITHIN = "an archive within the submission"
_FULL = "no room left for files of its kind"
#: Files of a whole class in one archive.
_MOST_LISTED = 200_000


@dataclass(frozen=True)
class Limits:
    """What is taken in at most; the rest is left out and listed, unless it says otherwise.

    Attributes
    ----------
    members : int
        Files and folders that are looked at; with more, the submission is refused.
    files : int
        Sources and texts; and as many files of other kinds.
    folders : int
        Folders that hold what is taken in.
    source_bytes, other_bytes : int
        Sources and texts in all; files of other kinds in all.
    file_bytes : int
        One file.
    archive_bytes : int
        An archive within an archive.
    depth : int
        Folders within each other.
    """

    members: int = 50_000
    files: int = 2_000
    folders: int = 2_000
    source_bytes: int = 32 * 1024**2
    other_bytes: int = 96 * 1024**2
    file_bytes: int = 8 * 1024**2
    archive_bytes: int = 128 * 1024**2
    depth: int = 20


LIMITS = Limits()
_BOUND = Bound("unpacking it", cpu_s=20, wall_s=600, memory_bytes=128 * 1024**2, file_bytes=LIMITS.archive_bytes)

T = TypeVar("T")


def confined(work: Callable[[], T], where: str, bound: Bound = _BOUND) -> T:
    """Return what work on a submission returns, done in a bounded process.

    Parameters
    ----------
    where : str
        Where the submission comes from, for messages.

    Raises
    ------
    SubmissionError
        If it raises that, or exceeds the bound.
    """
    try:
        return in_process(work, bound)
    except BoundError as error:
        raise SubmissionError(error.problem, where=where, remedy=too_much("").remedy) from None
    except SubmissionError as error:
        error.where = error.where or where
        raise


@dataclass(frozen=True)
class Piece:
    """Something that was handed in.

    Attributes
    ----------
    path : Path
        A folder, an archive or a file.
    member : str
        What of the archive is meant, as `names_in` tells it: a file, or a folder with a slash at its end; everything
        if empty.
    name : str
        What a single file is called in the submission, if not as its path says.
    """

    path: Path
    member: str = ""
    name: str = ""


@dataclass(frozen=True)
class Handed:
    """A submission as it was handed in.

    Attributes
    ----------
    name : str
        Under which its results are known: fit for a file's name, and of one submission only.
    pieces : tuple of Piece
        What it consists of.
    student_id : str or None
        By which a learning-management system knows the student.
    submitted_at : datetime or None
        With its offset from UTC, where anything but the archive itself tells it.
    late : bool
        Whether a learning-management system marked it so.
    student : str
        The student's name as a learning-management system writes it; empty where none has.
    where : str
        Where it comes from, in words; written by students, so not to be trusted.
    source : str
        The path that it was found by, the same however that was typed; empty where nobody knows.
    """

    name: str
    pieces: tuple[Piece, ...]
    student_id: str | None = None
    submitted_at: datetime | None = None
    late: bool = False
    student: str = ""
    where: str = ""
    source: str = ""

    @classmethod
    def of(cls, path: Path) -> Handed:
        """Return the submission that a path stands for, called as the folder or archive is."""
        name = Path(os.path.realpath(path)).name or "submission"
        named = name if is_folder(path) else names.without_archive_suffix(name)
        return cls(named, (Piece(path),), where=str(path), source=os.path.realpath(path))


@dataclass(frozen=True)
class Intake:
    """A submission that was taken in.

    Attributes
    ----------
    folder : Path
        Holds regular files only.
    left_out : tuple of str
        What was not taken in, a line each with its reason.
    submitted_at : datetime or None
        When it was handed in; else the newest time of a file in the archive, which is what a student's machine said.
    where : str
        Where it comes from, in words.
    unreadable : tuple of str
        Files, and folders with a slash at the end, that are there and may not be read; some of many.
    student_id : str or None
        By which a learning-management system or a class list knows the student.
    source : str
        The path that it was found by, see `Handed`.
    """

    folder: Path
    name: str
    left_out: tuple[str, ...] = ()
    submitted_at: datetime | None = None
    where: str = ""
    unreadable: tuple[str, ...] = ()
    student_id: str | None = None
    source: str = ""


@contextmanager
def taken_in(handed: Handed | Path, *, prefix: str = "grade-", limits: Limits = LIMITS) -> Iterator[Intake]:
    """Take a submission in, for as long as the context lasts.

    Parameters
    ----------
    handed : Handed or Path
        A path stands for `Handed.of` it.
    prefix : str
        How the name of the temporary folder begins.

    Raises
    ------
    SubmissionError
        If there is nothing, or it cannot be read to its end, or is more than anyone hands in.

    Notes
    -----
    Of members with the same name the last counts, as it does for `unzip` and `tar`. Of names that differ only in
    case or in the form of their letters, which Windows and macOS cannot keep apart, the first counts. Hard links in a
    tar are left out; in a folder they cannot be told from files, and are taken in as such. One archive beside which
    no program lies is unpacked, also within an archive; others are left out.
    """
    if isinstance(handed, Path):
        handed = Handed.of(handed)
    with tempfile.TemporaryDirectory(prefix=f"{prefix}intake-") as scratch:
        yield confined(partial(_extracted, handed, Path(scratch), limits), handed.where)


def _extracted(handed: Handed, scratch: Path, limits: Limits) -> Intake:
    extraction = _Extraction(scratch, limits)
    for piece in handed.pieces:
        extraction.take_piece(piece, alone=len(handed.pieces) == 1)
    for _ in range(_MOST_NESTED):
        extraction.unpack_single_archive()
    extraction.leave_archives_out()
    extraction.require_files()
    return Intake(
        extraction.folder,
        handed.name,
        extraction.notes.lines(),
        handed.submitted_at or extraction.newest,
        handed.where,
        tuple(extraction.unreadable),
        handed.student_id,
        handed.source,
    )


@dataclass
class _Room:
    """What is left of the room for files of a kind."""

    files: int
    size_bytes: int


class _Extraction:
    """A submission that is being taken in."""

    def __init__(self, scratch: Path, limits: Limits) -> None:
        self.folder = scratch / "submission"
        self.folder.mkdir()
        self.notes = Notes()
        self.newest: datetime | None = None
        self.unreadable: list[str] = []
        self._scratch, self._limits = scratch, limits
        self._members = 0
        self._kept: dict[str, str] = {}  # collision key -> the name it came under
        self._folders: set[str] = set()  # collision keys
        self._sources = _Room(limits.files, limits.source_bytes)
        self._others = _Room(limits.files, limits.other_bytes)
        self._has_programs = False
        self._archives: list[tuple[str, Path]] = []
        self._partial = scratch / "partial"

    # -- pieces and archives ---------------------------------------------------------------------

    def take_piece(self, piece: Piece, *, alone: bool) -> None:
        """Take in a folder, an archive, a file, or a part of an archive.

        Parameters
        ----------
        alone : bool
            Whether it is the only piece, so that an archive is the submission.
        """
        try:
            if is_folder(piece.path):
                self._take_all(members_of_folder(piece.path, self._limits.members, self._limits.depth))
            else:
                with _opened(piece.path) as file:
                    self._take_file(file, piece, alone=alone)
        except FileNotFoundError:
            remedy = f"Check the path. {_neighbours(piece.path)}".strip()
            raise SubmissionError("there is no such submission", remedy=remedy) from None
        except PermissionError:
            remedy = "Give yourself the right to read it."
            raise SubmissionError("the submission may not be read", remedy=remedy) from None

    def _take_file(self, file: BinaryIO, piece: Piece, *, alone: bool) -> None:
        is_archive = format_of(file.read(HEAD_BYTES)) is not None or names.is_packed(piece.path.name)
        file.seek(0)
        if piece.member:
            self._take_all(_part_of(members_of_archive(file), piece.member, piece.name))
        elif alone and is_archive:
            self._take_all(members_of_archive(file), timed=True)
        else:
            size, name = os.fstat(file.fileno()).st_size, piece.name or piece.path.name
            self._take_all([Member(name, Kind.FILE, size, pieces=partial(pieces_of, file))])

    def unpack_single_archive(self) -> None:
        """Unpack an archive that was handed in within the archive or beside documents."""
        if len(self._archives) != 1 or self._has_programs:
            return
        _, path = self._archives.pop()
        with path.open("rb") as file:
            self._take_all(members_of_archive(file), timed=True)
        path.unlink()

    def leave_archives_out(self) -> None:
        """Note archives that were not unpacked."""
        several = len(self._archives) > 1 and not self._has_programs
        reason = f"{_WITHIN}, one of several; nothing says which of them counts" if several else _WITHIN
        for name, _ in self._archives:
            self.notes.add(name, reason)

    def require_files(self) -> None:
        """Refuse a submission of which nothing could be taken in."""
        if self._kept:
            return
        lines = self.notes.lines()
        if lines:
            remedy = f"Left out: {'; '.join(lines[:3])}."
            raise SubmissionError("nothing of the submission could be taken in", remedy=remedy)
        raise SubmissionError("the submission is empty", remedy="Put the lab's files into it.")

    # -- members -----------------------------------------------------------------------------------

    def _take_all(self, members: Iterable[Member], *, timed: bool = False) -> None:
        for member in members:
            self._members += 1
            if self._members > self._limits.members:
                raise too_much(f"more than {self._limits.members:,} files and folders")
            try:
                parts = names.clean_parts(member.name)
            except names.UnfitNameError as reason:
                self.notes.add(member.name, str(reason))
                continue
            if self._is_of_interest(member, parts) and self._take(member, parts) and timed and member.modified:
                self.newest = max(self.newest or member.modified, member.modified)

    def _is_of_interest(self, member: Member, parts: tuple[str, ...]) -> bool:
        """Whether a member is something that a student may have meant to hand in."""
        is_folder = member.kind is Kind.FOLDER
        made = names.tool_folder((*parts, "") if is_folder else parts)
        if made is not None:
            self.notes.add_tool_folder(made, 0 if is_folder else 1)
        return made is None and not is_folder and not names.is_litter(parts[-1])

    def _take(self, member: Member, parts: tuple[str, ...]) -> bool:
        """Take a file in; returns whether it was, and notes why not."""
        if member.kind in (Kind.UNREADABLE, Kind.CLOSED) and len(self.unreadable) < _MOST_UNREADABLE:
            self.unreadable.append("/".join(parts) + "/" * (member.kind is Kind.CLOSED))
        reason = self._reason_against(member, parts) or self._copy(member, parts)
        if reason is not None:
            self.notes.add(member.name, reason)
        return reason is None

    def _reason_against(self, member: Member, parts: tuple[str, ...]) -> str | None:
        """Say why a file is not even opened."""
        if member.kind is not Kind.FILE:
            return str(member.kind.value)
        if len(parts) > self._limits.depth + 1:
            return str(Kind.DEEP.value)
        if names.is_compiled(parts[-1]):
            return "compiled code"
        if member.packed_bytes is not None and member.size_bytes > max(
            MOST_RATIO * member.packed_bytes, _RATIO_FROM_BYTES
        ):
            return f"more than {MOST_RATIO} times its own size when unpacked"
        key = names.collision_key(parts)
        if key in self._folders or any(names.collision_key(parts[:n]) in self._kept for n in range(1, len(parts))):
            return "a file where another has a folder"
        if len(self._folders) + len(_folders_above(parts) - self._folders) > self._limits.folders:
            return f"more than {self._limits.folders:,} folders"
        if self._kept.get(key, member.name) != member.name:
            return "its name differs from another only in case or in the form of its letters"
        return None

    def _copy(self, member: Member, parts: tuple[str, ...]) -> str | None:
        """Copy a file into the clean folder; says why, if it does not belong there."""
        pieces = member.pieces()
        head = next(pieces, b"")
        content = chain([head], pieces)
        suffix = PurePosixPath(parts[-1]).suffix.lower()
        if (names.is_packed(parts[-1]) or suffix in ("", ".py")) and format_of(head[:HEAD_BYTES]) is not None:
            return self._put_aside(member, content)
        if head.startswith(_COMPILED_MAGIC) or (head.startswith(b"MZ") and b"\0" in head):
            return "compiled code"
        room = self._sources if suffix in _SOURCE_SUFFIXES else self._others
        if room.files <= 0:
            return f"more than {self._limits.files:,} files of its kind"
        most = min(self._limits.file_bytes, room.size_bytes)
        size = self._write(content, most) if member.size_bytes <= most else None
        if size is None:
            return f"larger than {_mebibytes(self._limits.file_bytes)}" if most == self._limits.file_bytes else _FULL
        room.files -= 1
        room.size_bytes -= size
        self._keep(member.name, parts)
        self._has_programs = self._has_programs or suffix in _PROGRAM_SUFFIXES
        return None

    def _put_aside(self, member: Member, content: Iterator[bytes]) -> str | None:
        """Keep an archive until it is known whether it is the only one; of others the name is enough."""
        most = self._limits.archive_bytes
        if not self._archives and (member.size_bytes > most or self._write(content, most) is None):
            return f"an archive larger than {_mebibytes(most)}"
        aside = self._scratch / f"archive-{self._members}"
        if not self._archives:
            self._partial.rename(aside)
        self._archives.append((member.name, aside))
        return None

    def _write(self, content: Iterator[bytes], most: int) -> int | None:
        """Write a file, to be put in its place later; returns its size, or None if it is too large."""
        size = 0
        with self._partial.open("wb") as file:
            for piece in content:
                size += len(piece)
                if size > most:
                    return None
                file.write(piece)
        return size

    def _keep(self, name: str, parts: tuple[str, ...]) -> None:
        """Put the file that was written last in its place."""
        key = names.collision_key(parts)
        if key in self._kept:
            self.notes.add(name, "an earlier file of the same name")
        elif names.differ(name, parts):
            self.notes.add(name, "taken in without the characters in its name that cannot be shown")
        target = self.folder.joinpath(*parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        self._partial.replace(target)
        self._kept[key] = name
        self._folders.update(_folders_above(parts))


def _folders_above(parts: tuple[str, ...]) -> set[str]:
    """Return the collision keys of the folders that a file lies in."""
    return {names.collision_key(parts[:depth]) for depth in range(1, len(parts))}


def _mebibytes(size: int) -> str:
    return f"{size // 1024**2} MiB"


def _opened(path: Path) -> BinaryIO:
    try:
        return os.fdopen(open_regular(os.path.realpath(path)), "rb")
    except (FileNotFoundError, PermissionError):
        raise
    except OSError:
        remedy = "This is something else; check the path."
        raise SubmissionError("a submission is a folder, an archive or a file", remedy=remedy) from None


def _part_of(members: Iterable[Member], part: str, name: str) -> Iterator[Member]:
    """Pick a file, or all that lies in a folder, out of an archive; under the names that they have without it."""
    for member in members:
        path = names.slashed(member.name)
        if path == part and not part.endswith("/"):
            yield replace(member, name=name or PurePosixPath(part).name)
        elif part.endswith("/") and len(path) > len(part) and path.startswith(part):
            yield replace(member, name=path[len(part) :])


def names_in(path: Path, within: str = "") -> list[str] | None:
    """Return the names of the files in an archive, with slashes, and of folders, with a slash at the end.

    Parameters
    ----------
    within : str
        A file in it, if that is an archive whose names are asked for.

    Returns
    -------
    list of str or None
        None if it is no archive, or cannot be read, or holds more than a class hands in.
    """
    with suppress(OSError, SubmissionError):
        return confined(partial(_names_in, path, within), str(path))
    return None


def _names_in(path: Path, within: str) -> list[str] | None:
    with _opened(path) as file:
        if not within:
            return _names_of(file)
        for member in islice(members_of_archive(file), _MOST_LISTED):
            if names.slashed(member.name) == within and member.kind is Kind.FILE:
                with tempfile.TemporaryFile() as inner:
                    inner.writelines(member.pieces())
                    inner.seek(0)
                    return _names_of(inner)
    return None


def _names_of(file: BinaryIO) -> list[str] | None:
    found = []
    for member in islice(members_of_archive(file), _MOST_LISTED + 1):
        name = names.slashed(member.name).rstrip("/")
        found.append(f"{name}/" if member.kind is Kind.FOLDER else name)
    return found if len(found) <= _MOST_LISTED else None


def text_of(folder: Path, name: str, most_bytes: int) -> str | None:
    """Return the text of a file that a system wrote beside submissions; None if it cannot be read or lies elsewhere."""
    try:
        with os.fdopen(open_regular_beneath(folder, name), "rb") as file:
            return file.read(most_bytes).decode("utf-8", "replace")
    except OSError:
        return None


def texts_in(path: Path, wanted: Collection[str], most_bytes: int) -> dict[str, str]:
    """Return the texts of members of an archive that a system wrote beside submissions, as `names_in` names them.

    What cannot be read is left out; the members' sizes together are limited.
    """
    with suppress(OSError, SubmissionError):
        return confined(partial(_texts_in, path, wanted, most_bytes), str(path))
    return {}


def _texts_in(path: Path, wanted: Collection[str], most_bytes: int) -> dict[str, str]:
    found: dict[str, str] = {}
    with _opened(path) as file, suppress(SubmissionError):
        for member in islice(members_of_archive(file), _MOST_LISTED):
            name = names.slashed(member.name)
            if name in wanted and member.kind is Kind.FILE:
                content = _read(member, most_bytes)
                most_bytes -= len(content)
                found[name] = content.decode("utf-8", "replace")
    return found


def _read(member: Member, most_bytes: int) -> bytes:
    content = bytearray()
    for piece in member.pieces():
        content += piece[: most_bytes - len(content)]
        if len(content) >= most_bytes:
            break
    return bytes(content)


def _neighbours(path: Path) -> str:
    """Name what lies where something was looked for."""
    parent = path.parent
    if not os.access(parent, os.R_OK | os.X_OK) or not is_folder(parent):
        return ""
    found = (p for p in parent.iterdir() if not p.name.startswith("."))
    there = sorted(p.name for p in found if p.is_dir() or names.is_packed(p.name))
    near = difflib.get_close_matches(path.name, there, n=3, cutoff=0.5) or there[:5]
    return f"In {parent}/ there is: {', '.join(near)}." if near else ""
