"""When the last commit of a git repository was made, read from its files.

`git` itself is not asked: a repository's configuration can make it run programs (pagers, signature checks, file
system monitors, helpers that fetch missing objects), and a repository that a student handed in is the student's.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from contextlib import suppress
from datetime import datetime, timedelta, timezone
from functools import partial
from pathlib import Path

from grader.beneath import open_regular_beneath
from grader.bounded import Bound, in_process
from grader.errors import BoundError

#: Differences can be told so that resolving them takes minutes; as git writes them, it takes milliseconds.
_BOUND = Bound("reading the last commit", cpu_s=2.0, wall_s=10.0, memory_bytes=128 * 1024**2)
_MOST_BYTES = 1024 * 1024
_MOST_PACKS = 100
#: Objects within a pack that are told as differences to others, one after another.
_MOST_DELTAS = 60
_OBJECT = re.compile(r"[0-9a-f]{40}|[0-9a-f]{64}")
_BRANCH = re.compile(r"refs/[\w./+@#-]{1,300}")
_COMMITTER = re.compile(rb"^committer [^\n]*> (-?\d{1,12}) ([+-])(\d\d)(\d\d)$", re.MULTILINE)
_COMMIT, _OFFSET_DELTA, _REFERENCE_DELTA = 1, 6, 7


class _UnreadableError(Exception):
    """The repository is damaged, or of a form that is not read here."""


def last_commit_time(folder: Path) -> datetime | None:
    """Return the time of the commit that is checked out, as its committer's clock said; None if there is none.

    Parameters
    ----------
    folder : Path
        Root of the working tree.

    Notes
    -----
    Only files below `.git` are opened: neither links nor alternates are followed, nor the worktrees of others.

    References
    ----------
    Git's documentation: gitrepository-layout, gitformat-pack, gitformat-index.
    """
    repository = folder / ".git"
    with suppress(OSError, BoundError):
        if not repository.is_symlink() and repository.is_dir():
            return in_process(partial(_time_of_head, repository), _BOUND)
    return None


def _time_of_head(repository: Path) -> datetime | None:
    with suppress(OSError, _UnreadableError, struct.error, zlib.error, IndexError, ValueError, OverflowError):
        header = _commit(repository, _head(repository)).split(b"\n\n", 1)[0]
        if told := _COMMITTER.search(header):
            offset = timedelta(hours=int(told[3]), minutes=int(told[4]))
            zone = timezone(-offset if told[2] == b"-" else offset)
            return datetime.fromtimestamp(int(told[1]), zone)
    return None


def _opened(repository: Path, name: str) -> int:
    return open_regular_beneath(repository.parent, f"{repository.name}/{name}")


def _content(repository: Path, name: str) -> bytes:
    with os.fdopen(_opened(repository, name), "rb") as file:
        content = file.read(_MOST_BYTES + 1)
    if len(content) > _MOST_BYTES:
        raise _UnreadableError
    return content


def _head(repository: Path) -> str:
    """Return the object that HEAD means."""
    head = _content(repository, "HEAD").decode("ascii", "replace").strip()
    if not head.startswith("ref:"):
        return _object_name(head)
    branch = head.removeprefix("ref:").strip()
    if not _BRANCH.fullmatch(branch) or ".." in branch:
        raise _UnreadableError
    with suppress(OSError):
        return _object_name(_content(repository, branch).decode("ascii", "replace").strip())
    for line in _content(repository, "packed-refs").decode("utf-8", "replace").splitlines():
        if line.endswith(f" {branch}"):
            return _object_name(line.split(" ", 1)[0])
    raise _UnreadableError


def _object_name(text: str) -> str:
    if not _OBJECT.fullmatch(text):
        raise _UnreadableError
    return text


def _commit(repository: Path, name: str) -> bytes:
    with suppress(FileNotFoundError):
        header, _, content = _inflated(_content(repository, f"objects/{name[:2]}/{name[2:]}")).partition(b"\0")
        if not header.startswith(b"commit "):
            raise _UnreadableError
        return content
    packs = sorted(path.stem for path in (repository / "objects" / "pack").glob("*.idx"))[:_MOST_PACKS]
    for pack in (f"objects/pack/{stem}" for stem in packs):
        if (offset := _offset_in_pack(repository, pack, bytes.fromhex(name))) is not None:
            return _packed(repository, pack, offset, len(name) // 2)
    raise _UnreadableError


def _inflated(packed: bytes) -> bytes:
    content = zlib.decompressobj().decompress(packed, _MOST_BYTES)
    if len(content) == _MOST_BYTES:
        raise _UnreadableError
    return content


def _read_at(file: int, offset: int, size: int) -> bytes:
    content = os.pread(file, size, offset)
    if len(content) < size:
        raise _UnreadableError
    return content


def _offset_in_pack(repository: Path, pack: str, name: bytes) -> int | None:
    """Look an object up in a pack's index (version 2): a table by first byte, then names in order, then offsets."""
    file = _opened(repository, f"{pack}.idx")
    try:
        if _read_at(file, 0, 8) != b"\xfftOc\0\0\0\2":
            raise _UnreadableError
        fan_out = struct.unpack(">256I", _read_at(file, 8, 1024))
        low, high, total = fan_out[name[0] - 1] if name[0] else 0, fan_out[name[0]], fan_out[255]
        names, width = 8 + 1024, len(name)
        while low < high:
            middle = (low + high) // 2
            found = _read_at(file, names + middle * width, width)
            if found == name:
                return _offset(file, names + total * (width + 4), middle, total)
            low, high = (middle + 1, high) if found < name else (low, middle)
        return None
    finally:
        os.close(file)


def _offset(file: int, offsets: int, number: int, total: int) -> int:
    offset: int = struct.unpack(">I", _read_at(file, offsets + number * 4, 4))[0]
    if offset & 0x80000000:
        offset = struct.unpack(">Q", _read_at(file, offsets + total * 4 + (offset & 0x7FFFFFFF) * 8, 8))[0]
    return offset


def _packed(repository: Path, pack: str, offset: int, width: int) -> bytes:
    """Read a commit out of a pack, resolving differences."""
    file = _opened(repository, f"{pack}.pack")
    try:
        deltas: list[bytes] = []
        while len(deltas) <= _MOST_DELTAS:
            head = os.pread(file, _MOST_BYTES, offset)
            kind, position = (head[0] >> 4) & 7, 1
            while head[position - 1] & 0x80:
                position += 1
            base = offset
            if kind == _OFFSET_DELTA:
                back, position = _backwards(head, position)
                base = offset - back
            elif kind == _REFERENCE_DELTA:
                base = _offset_in_pack(repository, pack, head[position : position + width]) or offset
                position += width
            content = _inflated(head[position:])
            if kind == _COMMIT:
                for delta in reversed(deltas):
                    content = _applied(content, delta)
                return content
            if base == offset or base <= 0:
                break
            deltas.append(content)
            offset = base
        raise _UnreadableError
    finally:
        os.close(file)


def _backwards(data: bytes, position: int) -> tuple[int, int]:
    """Read how far back the base of a difference lies; returns it with the position behind it."""
    value = data[position] & 0x7F
    while data[position] & 0x80:
        position += 1
        value = ((value + 1) << 7) | (data[position] & 0x7F)
    return value, position + 1


def _applied(base: bytes, delta: bytes) -> bytes:
    """Apply a difference: pieces to copy from the base, and pieces to insert."""
    position = 0
    for _ in range(2):  # the sizes of the base and of the result
        while delta[position] & 0x80:
            position += 1
        position += 1
    result = bytearray()
    while position < len(delta):
        code = delta[position]
        position += 1
        if code & 0x80:
            numbers = []
            for bit in range(7):
                numbers.append(delta[position] if code & (1 << bit) else 0)
                position += bool(code & (1 << bit))
            start, size = int.from_bytes(numbers[:4], "little"), int.from_bytes(numbers[4:], "little") or 0x10000
            result += base[start : start + size]
        else:
            result += delta[position : position + code]
            position += code
        if len(result) > _MOST_BYTES or not code:
            raise _UnreadableError
    return bytes(result)
