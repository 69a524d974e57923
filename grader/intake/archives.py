"""The members of zip and tar archives, as the standard library reads them.

Its readers take directories and extended headers into memory whatever their size, and unpack whatever is claimed.
So they run only where the kernel bounds time and memory: as in `grader.intake.extraction`.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import stat
import struct
import tarfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta, timezone
from enum import Enum
from functools import partial
from typing import IO, BinaryIO, cast

from grader.errors import GraderError, SubmissionError
from grader.intake.members import Kind, Member, pieces_of, too_much
from grader.intake.names import displayed

#: Bytes of a file by which `format_of` tells what it is.
HEAD_BYTES = 512
#: How much larger than itself an archive may be when it is unpacked; a tar only above so many bytes.
MOST_RATIO = 200
_RATIO_FROM_BYTES = 64 * 1024 * 1024
_GET_ANOTHER = "Get it once more, or unpack it."
#: Of a zip: some 60,000 files with their names.
_MOST_DIRECTORY_BYTES = 8 * 1024 * 1024
#: Of a tar, which can only be read from its beginning to its end.
_MOST_UNPACKED_BYTES = 512 * 1024 * 1024
_BLOCK = 512
#: The time that zip tools write when they know none.
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_ZIP_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)


class Format(Enum):
    """What kind of archive a file is."""

    ZIP = "zip"
    TAR = "tar"
    GZIP = "tar.gz"
    BZIP2 = "tar.bz2"
    XZ = "tar.xz"
    SEVEN_ZIP = "7z"
    RAR = "rar"
    ZSTANDARD = "zstd"


_OPENED: Mapping[Format | None, Callable[[BinaryIO], IO[bytes]]] = {
    Format.TAR: lambda file: file,
    Format.GZIP: lambda file: cast("IO[bytes]", gzip.GzipFile(fileobj=file)),
    Format.BZIP2: bz2.open,
    Format.XZ: partial(lzma.open, format=lzma.FORMAT_XZ),
}
_MAGIC = {
    b"PK\x03\x04": Format.ZIP,
    b"PK\x05\x06": Format.ZIP,
    b"PK\x07\x08": Format.ZIP,
    b"\x1f\x8b": Format.GZIP,
    b"BZh": Format.BZIP2,
    b"\xfd7zXZ\x00": Format.XZ,
    b"7z\xbc\xaf\x27\x1c": Format.SEVEN_ZIP,
    b"Rar!\x1a\x07": Format.RAR,
    b"\x28\xb5\x2f\xfd": Format.ZSTANDARD,
}


def format_of(head: bytes) -> Format | None:
    """Tell an archive by its first `HEAD_BYTES` bytes; None for anything else."""
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            return kind
    try:
        tarfile.TarInfo.frombuf(head, "utf-8", "surrogateescape")
    except (tarfile.TarError, ValueError):
        return None
    return Format.TAR


def members_of_archive(file: BinaryIO) -> Iterator[Member]:
    """Go through an archive in its own order.

    Parameters
    ----------
    file : binary file
        Regular, open at its beginning.

    Raises
    ------
    SubmissionError
        If it is none that is read here, truncated, damaged, has a password, or is larger than anything handed in.
    """
    kind = format_of(file.read(HEAD_BYTES))
    file.seek(0)
    with _damage_reported():
        if kind is Format.ZIP:
            yield from _members_of_zip(file)
        elif kind in _OPENED:
            yield from _members_of_tar(file, _OPENED[kind])
        elif kind is None:
            raise SubmissionError("this is not a zip or tar archive", remedy=_GET_ANOTHER)
        else:
            remedy = "Pack it as .zip or .tar.gz, or give the folder."
            raise SubmissionError(f"a {kind.value} archive is not read here", remedy=remedy)


@contextmanager
def _damage_reported() -> Iterator[None]:
    """Report whatever the readers raise on what they did not expect."""
    try:
        yield
    except (GraderError, MemoryError):
        raise
    except Exception as problem:
        raise _damaged(str(problem) or "it ends too early") from problem


def _damaged(problem: str) -> SubmissionError:
    return SubmissionError(f"the archive is damaged: {displayed(problem)}", remedy=_GET_ANOTHER)


def _pieces(opened: Callable[[], IO[bytes] | None]) -> Iterator[bytes]:
    with _damage_reported(), opened() or io.BytesIO() as content:
        yield from pieces_of(content)


# -- zip -------------------------------------------------------------------------------------------


class _Guarded(io.BufferedReader):
    """A file of which nothing large is read at once: that would be a zip's directory."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _MOST_DIRECTORY_BYTES:
            raise too_much("more than some 60,000 files")
        return super().read(size)


def _members_of_zip(file: BinaryIO) -> Iterator[Member]:
    with zipfile.ZipFile(_Guarded(cast("io.RawIOBase", file))) as archive:
        for info in archive.infolist():
            pieces = partial(_pieces, partial(_open_zipped, archive, info))
            yield Member(zip_name(info), _zip_kind(info), info.file_size, info.compress_size, _zip_time(info), pieces)


def _open_zipped(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> IO[bytes]:
    if info.flag_bits & 0x1:
        remedy = "Pack it without, or unpack it and give the folder."
        raise SubmissionError("the archive is protected by a password", remedy=remedy)
    return archive.open(info)


def zip_name(info: zipfile.ZipInfo) -> str:
    """Return a member's name; bytes of which nothing says how to read them are UTF-8, as macOS writes, or CP437."""
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
    return Kind.FILE if info.compress_type in _ZIP_METHODS else Kind.METHOD


def _zip_time(info: zipfile.ZipInfo) -> datetime | None:
    """Return a member's time: from Unix's or NTFS's field, which are in UTC, else as local time of this machine."""
    extra, position = info.extra, 0
    while position + 4 <= len(extra):
        field, length = struct.unpack_from("<HH", extra, position)
        data = extra[position + 4 : position + 4 + length]
        position += 4 + length
        if field == 0x5455 and len(data) >= 5 and data[0] & 1:
            return _utc(struct.unpack_from("<i", data, 1)[0])
        if field == 0x000A and len(data) >= 16 and data[4:6] == b"\x01\x00":
            return _utc(struct.unpack_from("<Q", data, 8)[0] / 1e7 - 11_644_473_600)
    if tuple(info.date_time) == _ZIP_EPOCH:
        return None
    try:
        return datetime(*info.date_time).astimezone()
    except (ValueError, OverflowError, OSError):
        return None


def _utc(seconds: float) -> datetime | None:
    try:
        return datetime(1970, 1, 1, tzinfo=timezone.utc) + timedelta(seconds=seconds)
    except (OverflowError, ValueError):
        return None


# -- tar -------------------------------------------------------------------------------------------


def _members_of_tar(file: BinaryIO, opened: Callable[[BinaryIO], IO[bytes]]) -> Iterator[Member]:
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    most = min(_MOST_UNPACKED_BYTES, max(_RATIO_FROM_BYTES, MOST_RATIO * size))
    with opened(file) as stream, tarfile.open(fileobj=stream, mode="r:") as archive:
        for info in archive:
            if archive.offset < info.offset_data:
                raise _damaged("a file's size is below zero")
            _require_at_most(most, archive.offset)
            pieces = partial(_pieces, partial(archive.extractfile, info))
            yield Member(info.name, _tar_kind(info), info.size, None, _utc(info.mtime), pieces)
        _read_to_end(stream, archive.offset, most)


def _require_at_most(most: int, size: int) -> None:
    if size > most:
        raise too_much(f"more than {most // 1024**2} MiB when it is unpacked")


def _read_to_end(stream: IO[bytes], offset: int, most: int) -> None:
    """Read what follows the last file: nothing but zeros at first, then on to the checksum of what is packed."""
    stream.seek(offset)
    if stream.read(_BLOCK).strip(b"\0"):
        raise _damaged("a header is not valid")
    while stream.read(_BLOCK * 128):
        _require_at_most(most, stream.tell())


def _tar_kind(info: tarfile.TarInfo) -> Kind:
    if info.isdir():
        return Kind.FOLDER
    if info.issym():
        return Kind.LINK
    if info.islnk():
        return Kind.HARD_LINK
    if info.issparse():
        return Kind.SPARSE
    return Kind.FILE if info.isreg() else Kind.SPECIAL
