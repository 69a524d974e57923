"""Members of a folder, a zip or a tar, one after another, read by the standard library.

The library's readers load directories and extended headers of any size into memory, and unpack any claimed size.
Therefore they run only in processes with bounded time and memory, as in `grader.submission.extraction`.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import stat
import struct
import tarfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import Enum
from functools import partial
from pathlib import Path
from typing import IO, BinaryIO, cast

from grader.errors import GraderError, SubmissionError
from grader.submission.beneath import open_regular_beneath
from grader.submission.file_names import TOOL_FOLDERS, displayed

#: First bytes of a file that `format_of` examines.
HEAD_BYTES = 512
_PIECE_BYTES = 64 * 1024
#: Unpacked bytes of a tar, which can only be read from start to end.
_MOST_UNPACKED_BYTES = 512 * 1024 * 1024
_GET_ANOTHER = "Download it again, or unpack it."
#: The time that zip tools write for an unknown time.
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_ZIP_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)


class Kind(Enum):
    """Kinds of members; the value of a kind that is not extracted is the reason."""

    FILE = "a file"
    FOLDER = "a folder"
    LINK = "a symbolic link"
    HARD_LINK = "a hard link"
    SPECIAL = "not a regular file"
    SPARSE = "a sparse file"
    METHOD = "compressed by a method that grade does not read"
    UNREADABLE = "not readable"
    CLOSED = "a folder that is not readable"
    DEEP = "too many folders deep"


@dataclass(frozen=True)
class Member:
    """A file or something else in a folder or an archive."""

    #: The name in the archive; untrusted.
    name: str
    kind: Kind
    #: The claimed size.
    size_bytes: int = 0
    #: Time on the packing machine, without offset from UTC if only its local time is known.
    modified: datetime | None = None
    #: The target of a symbolic link; untrusted.
    target: str = ""
    #: Returns the content, piece by piece; valid until the next member is read.
    pieces: Callable[[], Iterator[bytes]] = lambda: iter(())


def pieces_of(file: IO[bytes]) -> Iterator[bytes]:
    """Read a file piece by piece."""
    return iter(partial(file.read, _PIECE_BYTES), b"")


def too_much(what: str) -> SubmissionError:
    """Return the error of a submission with an absurd amount of something."""
    return SubmissionError(
        f"the submission holds {what}",
        remedy="Hand it in without recordings, build folders and the like.",
    )


# -- folders ---------------------------------------------------------------------------------------


def is_folder(path: Path) -> bool:
    """Return whether a path leads to a folder; never fails."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def members_of_folder(path: Path, most_depth: int) -> Iterator[Member]:
    """Yield the members of a folder, up to a depth. Folders of tools are yielded, but not entered.

    Raises OSError if the folder itself cannot be read.
    """
    for above, folders, files, folder in os.fwalk(os.path.realpath(path)):
        inside = os.path.relpath(above, os.path.realpath(path))
        if inside == ".":
            depth = 0
        else:
            depth = inside.count("/") + 1
        is_deepest = depth >= most_depth
        for name in (*sorted(files), *sorted(folders)):
            path_inside = name
            if depth:
                path_inside = f"{inside}/{name}"
            yield from _entry(folder, name, path_inside, is_deepest)
        folders[:] = sorted(set(folders) - TOOL_FOLDERS)
        if is_deepest:
            folders.clear()


def _entry(folder: int, name: str, path: str, is_deepest: bool) -> Iterator[Member]:
    try:
        mode = os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode
        if stat.S_ISREG(mode):
            with os.fdopen(open_regular_beneath(folder, name), "rb") as file:
                size = os.fstat(file.fileno()).st_size
                yield Member(path, Kind.FILE, size, pieces=partial(pieces_of, file))
        elif stat.S_ISLNK(mode):
            yield Member(path, Kind.LINK, target=os.readlink(name, dir_fd=folder))
        elif not stat.S_ISDIR(mode):
            yield Member(path, Kind.SPECIAL)
        else:
            yield Member(path, Kind.FOLDER)
            if is_deepest and name not in TOOL_FOLDERS:
                yield Member(path, Kind.DEEP)
            elif not os.access(name, os.R_OK | os.X_OK, dir_fd=folder, effective_ids=True):
                yield Member(path, Kind.CLOSED)
    except OSError:
        yield Member(path, Kind.UNREADABLE)


# -- archives --------------------------------------------------------------------------------------


#: Formats by the first bytes of an archive.
_MAGIC = {
    b"PK\x03\x04": "zip",
    b"PK\x05\x06": "zip",
    b"PK\x07\x08": "zip",
    b"\x1f\x8b": "tar.gz",
    b"BZh": "tar.bz2",
    b"\xfd7zXZ\x00": "tar.xz",
    b"7z\xbc\xaf\x27\x1c": "7z",
    b"Rar!\x1a\x07": "rar",
    b"\x28\xb5\x2f\xfd": "zstd",
}
_UNPACKED: Mapping[str | None, Callable[[BinaryIO], IO[bytes]]] = {
    "tar": lambda file: file,
    "tar.gz": lambda file: cast("IO[bytes]", gzip.GzipFile(fileobj=file)),
    "tar.bz2": bz2.open,
    "tar.xz": partial(lzma.open, format=lzma.FORMAT_XZ),
}


def format_of(head: bytes) -> str | None:
    """Recognise an archive by its first `HEAD_BYTES` bytes; None for anything else."""
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            return kind
    with suppress(tarfile.TarError, ValueError):
        tarfile.TarInfo.frombuf(head, "utf-8", "surrogateescape")
        return "tar"
    return None


def members_of_archive(file: BinaryIO) -> Iterator[Member]:
    """Yield the members of an archive, a regular file open at its start, in their order.

    Raises SubmissionError if the archive has an unknown format, is truncated or damaged, has a password, or is absurdly
    large.
    """
    kind = format_of(file.read(HEAD_BYTES))
    file.seek(0)
    with _damage_reported():
        if kind == "zip":
            yield from _members_of_zip(file)
        elif kind in _UNPACKED:
            yield from _members_of_tar(_UNPACKED[kind](file))
        elif kind is None:
            raise SubmissionError("this is not a zip or tar archive", remedy=_GET_ANOTHER)
        else:
            remedy = "Pack it as .zip or .tar.gz, or give the folder."
            raise SubmissionError(f"{kind} archives are not supported", remedy=remedy)


@contextmanager
def _damage_reported() -> Iterator[None]:
    """Report any exception of the readers as a damaged archive."""
    try:
        yield
    except (GraderError, MemoryError):
        raise
    except Exception as problem:
        words = displayed(str(problem) or "it ends too early")
        raise SubmissionError(f"the archive is damaged: {words}", remedy=_GET_ANOTHER) from problem


def _pieces(opened: Callable[[], IO[bytes] | None]) -> Iterator[bytes]:
    with _damage_reported(), opened() or io.BytesIO() as content:
        yield from pieces_of(content)


def _utc(seconds: float) -> datetime | None:
    with suppress(OverflowError, ValueError):
        return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    return None


def _members_of_zip(file: BinaryIO) -> Iterator[Member]:
    with zipfile.ZipFile(file) as archive:
        for info in archive.infolist():
            pieces = partial(_pieces, partial(_open_zipped, archive, info))
            kind = _zip_kind(info)
            target = ""
            if kind is Kind.LINK:
                target = next(pieces(), b"").decode("utf-8", "replace")
            time = _zip_time(info)
            yield Member(zip_name(info), kind, info.file_size, time, target, pieces)


def _open_zipped(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> IO[bytes]:
    if info.flag_bits & 0x1:
        remedy = "Pack it without a password, or unpack it and give the folder."
        raise SubmissionError("the archive is protected by a password", remedy=remedy)
    return archive.open(info)


def zip_name(info: zipfile.ZipInfo) -> str:
    """Return a member's name; bytes without a known encoding are read as UTF-8, as macOS writes, else as CP437."""
    name = info.orig_filename
    if not info.flag_bits & 0x800 and not name.isascii():
        with suppress(UnicodeError):
            return name.encode("cp437").decode("utf-8")
    return name


def _zip_kind(info: zipfile.ZipInfo) -> Kind:
    mode = stat.S_IFMT(info.external_attr >> 16)
    if info.orig_filename.endswith(("/", "\\")) or mode == stat.S_IFDIR:
        return Kind.FOLDER
    if mode == stat.S_IFLNK:
        return Kind.LINK
    if mode not in (0, stat.S_IFREG):
        return Kind.SPECIAL
    if info.compress_type not in _ZIP_METHODS:
        return Kind.METHOD
    return Kind.FILE


def _zip_time(info: zipfile.ZipInfo) -> datetime | None:
    """Return a member's time: in UTC from the field of Unix or NTFS, else as local time."""
    extra = info.extra
    while len(extra) >= 4:
        field, length = struct.unpack_from("<HH", extra)
        data = extra[4 : 4 + length]
        extra = extra[4 + length :]
        is_unix = field == 0x5455 and len(data) >= 5
        if is_unix and data[0] & 1:
            (seconds,) = struct.unpack_from("<i", data, 1)
            return _utc(seconds)
        is_ntfs = field == 0x000A and len(data) >= 16
        if is_ntfs and data[4:6] == b"\x01\x00":
            (ticks,) = struct.unpack_from("<Q", data, 8)
            return _utc(ticks / 1e7 - 11_644_473_600)
    if tuple(info.date_time) == _ZIP_EPOCH:
        return None
    with suppress(ValueError):
        return datetime(*info.date_time)
    return None


def _members_of_tar(stream: IO[bytes]) -> Iterator[Member]:
    with stream, tarfile.open(fileobj=stream, mode="r:") as archive:
        for info in archive:
            if archive.offset < info.offset_data:
                raise ValueError("a file has a negative size")
            _require_at_most(archive.offset)
            pieces = partial(_pieces, partial(archive.extractfile, info))
            kind = _tar_kind(info)
            time = _utc(info.mtime)
            yield Member(info.name, kind, info.size, time, info.linkname, pieces)
        # Zeros follow the last file; the rest up to the packed data's checksum is read too.
        stream.seek(archive.offset)
        if stream.read(tarfile.BLOCKSIZE).strip(b"\0"):
            raise ValueError("a header is not valid")
        while stream.read(_PIECE_BYTES):
            _require_at_most(stream.tell())


def _require_at_most(size: int) -> None:
    if size > _MOST_UNPACKED_BYTES:
        raise too_much(f"more than {_MOST_UNPACKED_BYTES // 1024**2} MiB when it is unpacked")


def _tar_kind(info: tarfile.TarInfo) -> Kind:
    kinds = {
        tarfile.DIRTYPE: Kind.FOLDER,
        tarfile.SYMTYPE: Kind.LINK,
        tarfile.LNKTYPE: Kind.HARD_LINK,
    }
    if info.issparse():
        return Kind.SPARSE
    if info.type in kinds:
        return kinds[info.type]
    if info.isreg():
        return Kind.FILE
    return Kind.SPECIAL
