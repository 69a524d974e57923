"""The members of zip and tar archives, read without believing what their headers claim.

Python's `zipfile` and `tarfile` read directories and extended headers into memory whatever their size, and some
decompressors give out gigabytes at a time. Here, each such step has a limit.
"""

from __future__ import annotations

import bz2
import functools
import io
import lzma
import re
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from enum import Enum
from typing import BinaryIO, Protocol

from grader.intake.members import Kind, Member, Readable, TooMuchError

CHUNK_BYTES = 64 * 1024
#: Bytes of a file by which `format_of` tells what it is.
HEAD_BYTES = 512
#: What a zip's directory may take: some 60,000 files with their names.
MOST_DIRECTORY_BYTES = 8 * 1024 * 1024
_MOST_HEADER_BYTES = 1024 * 1024
#: What is unpacked of an archive in all, and how much of a tar before its compression is looked at.
MOST_STREAM_BYTES = 512 * 1024 * 1024
_RATIO_FROM_BYTES = 64 * 1024 * 1024
MOST_RATIO = 200
#: Some tools pack pieces of 64 KiB each by itself; empty ones by the million are only an attack.
_MOST_PIECES = 20_000
_XZ_MEMORY_BYTES = 128 * 1024 * 1024
_BLOCK = 512
#: The time that zip tools write when they know none.
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_PAX_RECORD = re.compile(rb"(\d{1,8}) ([^=]{1,200})=", re.DOTALL)


class DamagedError(Exception):
    """The archive cannot be read to its end; the text says what is wrong with it."""


class ProtectedError(Exception):
    """The archive is encrypted."""


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

    @property
    def can_be_read(self) -> bool:
        """Whether `members_of_archive` reads it."""
        return self not in (Format.SEVEN_ZIP, Format.RAR, Format.ZSTANDARD)


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


@contextmanager
def _damage_told() -> Iterator[None]:
    """Turn all that the libraries raise on archives that are damaged into `DamagedError`."""
    try:
        yield
    except (zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, EOFError) as problem:
        raise DamagedError(str(problem) or "it ends too early") from problem
    except (struct.error, ValueError, OverflowError, NotImplementedError, RuntimeError, OSError) as problem:
        raise DamagedError(str(problem)) from problem


def members_of_archive(file: BinaryIO, kind: Format) -> Iterator[Member]:
    """Go through an archive in its own order.

    Parameters
    ----------
    file : binary file
        Regular, open at its beginning.

    Raises
    ------
    DamagedError
        If it is truncated or damaged.
    ProtectedError
        If it has a password.
    TooMuchError
        If it is larger than anything that is handed in.
    """
    with _damage_told():
        yield from _members_of_zip(file) if kind is Format.ZIP else _members_of_tar(_Stream(file, kind))


class _Content:
    """The content of a member; raises nothing but what `members_of_archive` does."""

    def __init__(self, content: Readable) -> None:
        self._content = content

    def read(self, size: int, /) -> bytes:
        with _damage_told():
            return self._content.read(size)


# -- zip -------------------------------------------------------------------------------------------


class _Guarded(io.RawIOBase):
    """A file of which nothing large is read at once: that would be a zip's directory."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        content = self._file.read(size if 0 <= size <= MOST_DIRECTORY_BYTES else MOST_DIRECTORY_BYTES + 1)
        if len(content) > MOST_DIRECTORY_BYTES:
            raise TooMuchError("more than some 60,000 files")
        return content

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True


def _members_of_zip(file: BinaryIO) -> Iterator[Member]:
    """Go through a zip in the order of its directory."""
    with zipfile.ZipFile(_Guarded(file)) as archive:
        zipped = _Zipped(archive)
        for info in archive.infolist():
            kind = _zip_kind(info)
            opened = functools.partial(zipped.open, info)
            yield Member(zip_name(info), kind, info.file_size, info.compress_size, _zip_time(info), opened)


@dataclass
class _Zipped:
    """Opens members, and counts what is read of the archive: its entries may overlap."""

    archive: zipfile.ZipFile
    read: int = 0

    def open(self, info: zipfile.ZipInfo) -> Readable:
        if info.flag_bits & 0x1:
            raise ProtectedError
        self.read += info.compress_size
        if self.read > MOST_STREAM_BYTES:
            raise TooMuchError(f"more than {MOST_STREAM_BYTES // 1024**2} MiB to read")
        with _damage_told():
            return _Content(self.archive.open(info))


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
    # Other methods are rare, and Python unpacks them without a limit to what comes out at once.
    known = info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    return Kind.FILE if known or info.flag_bits & 0x1 else Kind.METHOD


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


class _Decoder(Protocol):
    """What `bz2` and `lzma` have in common."""

    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, max_length: int) -> bytes: ...


class _Gunzip:
    """Brings `zlib` to the same form."""

    def __init__(self) -> None:
        self._decoder = zlib.decompressobj(wbits=31)

    @property
    def eof(self) -> bool:
        return self._decoder.eof

    @property
    def needs_input(self) -> bool:
        return not self._decoder.unconsumed_tail

    @property
    def unused_data(self) -> bytes:
        return self._decoder.unused_data

    def decompress(self, data: bytes, max_length: int) -> bytes:
        return self._decoder.decompress(self._decoder.unconsumed_tail + data, max_length)


def _decoder(kind: Format) -> _Decoder:
    if kind is Format.XZ:
        return lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_XZ_MEMORY_BYTES)
    return _Gunzip() if kind is Format.GZIP else bz2.BZ2Decompressor()


class _Unpacked:
    """Unpacks a file piece by piece, never more at once than was asked for.

    Python's own readers have no limit of memory for xz, and go through a million empty pieces one by one.
    """

    def __init__(self, file: BinaryIO, kind: Format) -> None:
        self._file, self._kind = file, kind
        self._decoder = _decoder(kind)
        self._pieces = 1

    def read(self, size: int, /) -> bytes:
        while True:
            packed = b""
            if self._decoder.eof:
                packed = self._next_piece()
                if not packed:
                    return b""
            elif self._decoder.needs_input:
                packed = self._packed()
                if not packed:
                    if content := self._decoder.decompress(b"", size):
                        return content
                    raise EOFError
            if content := self._decoder.decompress(packed, size):
                return content

    def _packed(self) -> bytes:
        if self._file.tell() > MOST_STREAM_BYTES:
            raise TooMuchError(f"more than {MOST_STREAM_BYTES // 1024**2} MiB to read")
        return self._file.read(CHUNK_BYTES)

    def _next_piece(self) -> bytes:
        packed = self._decoder.unused_data.lstrip(b"\0")
        while not packed and (part := self._packed()):
            packed = part.lstrip(b"\0")
        if packed:
            self._pieces += 1
            if self._pieces > _MOST_PIECES:
                raise TooMuchError(f"more than {_MOST_PIECES:,} pieces packed one by one")
            self._decoder = _decoder(self._kind)
        return packed


class _Stream:
    """What a tar unpacks to, counted, and cut off where no archive that somebody made by hand goes on."""

    def __init__(self, file: BinaryIO, kind: Format) -> None:
        self._file = file
        self._content: Readable = file if kind is Format.TAR else _Unpacked(file, kind)
        self._read = 0

    def read(self, size: int, /) -> bytes:
        """Read up to so many bytes; none at the end."""
        content = self._content.read(min(size, CHUNK_BYTES))
        self._read += len(content)
        if self._read > _RATIO_FROM_BYTES and self._read > MOST_RATIO * self._file.tell():
            raise TooMuchError(f"more than {MOST_RATIO} times its own size when unpacked")
        if self._read > MOST_STREAM_BYTES:
            raise TooMuchError(f"more than {MOST_STREAM_BYTES // 1024**2} MiB when unpacked")
        return content

    def exactly(self, size: int) -> bytes:
        """Read so many bytes, or none if there is nothing left."""
        parts: list[bytes] = []
        missing = size
        while missing and (part := self.read(missing)):
            parts.append(part)
            missing -= len(part)
        if parts and missing:
            raise EOFError
        return b"".join(parts)

    def skip(self, size: int) -> None:
        """Pass over so many bytes."""
        while size:
            part = self.read(size)
            if not part:
                raise EOFError
            size -= len(part)


class _TarContent:
    """The content of a tar's member."""

    def __init__(self, stream: _Stream, size: int) -> None:
        self._stream = stream
        self.left = size

    def read(self, size: int, /) -> bytes:
        part = self._stream.read(min(size, self.left)) if self.left else b""
        if self.left and size and not part:
            raise EOFError
        self.left -= len(part)
        return part


@dataclass
class _Extended:
    """What extended headers say of the member that follows them."""

    name: str | None = None
    size: int | None = None
    modified: float | None = None
    sparse: bool = False


def _members_of_tar(stream: _Stream) -> Iterator[Member]:
    """Go through a tar, in POSIX's, GNU's and the old format.

    References
    ----------
    POSIX.1-2017, pax, "ustar Interchange Format" and "pax Header Block"; GNU tar manual, "Basic Tar Format".
    """
    extended = _Extended()
    while (block := stream.exactly(_BLOCK)) and block.strip(b"\0"):
        info = tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
        if info.type in (tarfile.XHDTYPE, tarfile.SOLARIS_XHDTYPE, tarfile.XGLTYPE, *_LONG):
            _extend(extended, info.type, _payload(stream, info.size))
            continue
        if info.type == tarfile.GNUTYPE_SPARSE:
            _skip_sparse_map(stream, block[482])
        content = _TarContent(stream, _data_size(info, extended))
        padding = -content.left % _BLOCK
        modified = _utc(info.mtime if extended.modified is None else extended.modified)
        name = info.name if extended.name is None else extended.name
        yield Member(
            name, _tar_kind(info, extended), content.left, None, modified, functools.partial(_Content, content)
        )
        stream.skip(content.left + padding)
        extended = _Extended()
    while stream.read(CHUNK_BYTES):  # to the checksum at the end of what is packed
        pass


_LONG = (tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_LONGLINK)


def _data_size(info: tarfile.TarInfo, extended: _Extended) -> int:
    """Return the bytes that follow a header: links and folders may state a size, and have none."""
    size = info.size if extended.size is None else extended.size
    if size < 0:
        raise DamagedError("a file's size is below zero")
    return size if info.isreg() or info.type not in tarfile.SUPPORTED_TYPES else 0


def _payload(stream: _Stream, size: int) -> bytes:
    if not 0 <= size <= _MOST_HEADER_BYTES:
        raise DamagedError("a header is too large")
    payload = stream.exactly(size)
    if len(payload) < size:
        raise EOFError
    stream.skip(-size % _BLOCK)
    return payload


def _extend(extended: _Extended, kind: bytes, payload: bytes) -> None:
    if kind == tarfile.GNUTYPE_LONGNAME:
        extended.name = payload.rstrip(b"\0").decode("utf-8", "surrogateescape")
    if kind not in (tarfile.XHDTYPE, tarfile.SOLARIS_XHDTYPE):
        return  # Long names of links are of no interest, and headers for all members carry comments.
    position = 0
    while match := _PAX_RECORD.match(payload, position):
        end = position + int(match[1])
        value = payload[match.end() : end - 1]
        if match[2] == b"path":
            extended.name = value.decode("utf-8", "surrogateescape")
        elif match[2] == b"size":
            extended.size = int(value[:20])
        elif match[2] == b"mtime":
            extended.modified = float(value[:40])
        elif match[2].startswith(b"GNU.sparse."):
            extended.sparse = True
        if end <= match.end():
            raise DamagedError("a header is not valid")
        position = end


def _skip_sparse_map(stream: _Stream, goes_on: int) -> None:
    for _ in range(_MOST_HEADER_BYTES // _BLOCK):
        if not goes_on:
            return
        block = stream.exactly(_BLOCK)
        if not block:
            raise EOFError
        goes_on = block[504]
    raise DamagedError("a header is too large")


def _tar_kind(info: tarfile.TarInfo, extended: _Extended) -> Kind:
    if info.isdir():
        return Kind.FOLDER
    if info.issym():
        return Kind.LINK
    if info.islnk():
        return Kind.HARD_LINK
    if extended.sparse or info.type == tarfile.GNUTYPE_SPARSE:
        return Kind.SPARSE
    return Kind.FILE if info.isreg() else Kind.SPECIAL
