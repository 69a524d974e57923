"""Archives that no tool would make: written byte by byte, small on disk whatever they claim or unpack to."""

from __future__ import annotations

import bz2
import io
import lzma
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterable

MEBIBYTE = 1024 * 1024


def zip_of(members: Iterable[tuple[str | zipfile.ZipInfo, bytes]]) -> bytes:
    """Return a zip of some members."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return file.getvalue()


def tar_of(
    members: Iterable[tuple[str | tarfile.TarInfo, bytes]], form: int = tarfile.PAX_FORMAT
) -> bytes:
    """Return a tar of some members."""
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w", format=form) as archive:
        for name, content in members:
            info = tarfile.TarInfo(name) if isinstance(name, str) else name
            if info.isreg():
                info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return file.getvalue()


def zip_of_entries(count: int) -> bytes:
    """Return a zip with a directory of this many entries, all for the same empty file."""
    local = struct.pack("<4s5H3I2H", b"PK\x03\x04", 20, 0, 0, 0, 0x21, 0, 0, 0, 1, 0) + b"a"
    entry = (
        struct.pack(
            "<4s6H3I5H2I", b"PK\x01\x02", 20, 20, 0, 0, 0, 0x21, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0
        )
        + b"a"
    )
    directory = entry * count
    return local + directory + _zip_end(min(count, 0xFFFF), len(directory), len(local))


def _zip_end(count: int, size: int, offset: int) -> bytes:
    return struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, count, count, size, offset, 0)


def overlapping_zip(count: int, size: int) -> bytes:
    """Return a zip of so many names for one and the same piece of zeros."""
    packed = zip_of([("a", bytes(size))])
    start = packed.index(b"PK\x01\x02")
    entry = packed[start : packed.index(b"PK\x05\x06")]
    entries = b"".join(entry[:-1] + bytes([0x61 + number]) for number in range(count))
    return packed[:start] + entries + _zip_end(count, len(entries), start)


def zeros_in_gzip(before: bytes, mebibytes: int) -> bytes:
    """Return the beginning of a .gz of some bytes and then so many MiB of zeros; never ends."""
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    start = packer.compress(before) + packer.flush(zlib.Z_FULL_FLUSH)
    first = packer.compress(bytes(MEBIBYTE)) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(bytes(MEBIBYTE)) + packer.flush(zlib.Z_FULL_FLUSH)
    return start + first + again * (mebibytes - 1)


def zeros_in_bzip2(before: bytes, mebibytes: int) -> bytes:
    """Return a .bz2 of some bytes and then so many MiB of zeros."""
    return bz2.compress(before) + bz2.compress(bytes(45 * MEBIBYTE)) * (mebibytes // 45 + 1)


def zeros_in_xz(before: bytes, mebibytes: int) -> bytes:
    """Return a .xz of some bytes and then so many MiB of zeros."""
    return lzma.compress(before) + lzma.compress(bytes(16 * MEBIBYTE)) * (mebibytes // 16 + 1)


def tar_header(name: str, size: int) -> bytes:
    """Return the header of a regular file that claims a size."""
    info = tarfile.TarInfo(name)
    info.size = size
    return info.tobuf(tarfile.GNU_FORMAT)
