"""Bags that a flood, a hostile publisher or a cut made: each is opened, read and repaired in bounded time."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from ros_bag.reading import Bag
from ros_bag.recovery import recover
from ros_bag.writing import BagWriter
from tests.ros_bag.sample_messages import DEFINITIONS, FLOATS, RELIABLE, floats
from tests.thorough import examples

MOST_S = 10.0
MAGIC = b"\x89MCAP0\r\n"


def _record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def _chunk(records: bytes, compression: str = "", size: int | None = None) -> bytes:
    head = struct.pack("<QQQI", 0, 0, len(records) if size is None else size, 0)
    name = compression.encode()
    return head + struct.pack("<I", len(name)) + name + struct.pack("<Q", len(records)) + records


def _string(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def _described(channels: int) -> bytes:
    schema = struct.pack("<H", 1) + _string(FLOATS) + _string("ros2msg")
    schema += _string(DEFINITIONS[FLOATS].text)
    made = [_record(Opcode.SCHEMA, schema)]
    for number in range(channels):
        body = (
            struct.pack("<HH", number, 1)
            + _string(f"/t{number}")
            + _string("cdr")
            + struct.pack("<I", 0)
        )
        made.append(_record(Opcode.CHANNEL, body))
    return b"".join(made)


def _message(channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> bytes:
    return _record(
        Opcode.MESSAGE, struct.pack("<HIQQ", channel, sequence, log_ns, publish_ns) + data
    )


def _nested(depth: int) -> bytes:
    found = _message(0, 1, 1, 1, floats([1.0]))
    for _ in range(depth):
        found = _record(Opcode.CHUNK, _chunk(found))
    return found


FLOODS: dict[str, Callable[[], bytes]] = {
    "two thousand channels": lambda: _described(2_000),
    "a channel announced over and over": lambda: _described(1) * 2_000,
    "three thousand messages": lambda: (
        _described(1) + b"".join(_message(0, n, n, n, floats([1.0])) for n in range(3_000))
    ),
    "times that are none": lambda: (
        _described(1)
        + b"".join(
            _message(0, 2**32 - 1, t, 2**64 - 1 - t, floats([1.0]))
            for t in (0, 2**63 - 1, 2**63, 2**64 - 1)
        )
    ),
    "chunks within each other": lambda: _described(1) + _nested(3_000),
    "chunks that claim more than there is": lambda: (
        _described(1)
        + b"".join(_record(Opcode.CHUNK, _chunk(b"", size=2**63), length=2**62) for _ in range(3))
    ),
    "records of no length": lambda: _described(1) + _record(Opcode.HEADER, b"") * 30_000,
    "compression that none knows": lambda: (
        _described(1) + _record(Opcode.CHUNK, _chunk(b"abc", "x" * 1000)) * 1000
    ),
    "messages of no channel": lambda: _described(1) + _message(65535, 1, 1, 1, b"") * 10_000,
}


def _bag(folder: Path, content: bytes) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "x.mcap").write_bytes(MAGIC + content)
    return folder


def _read(folder: Path) -> int:
    """Open a bag and look at all that is in it; returns how many messages that are."""
    bag, found = Bag.open(folder), 0
    for info in bag.topics[:50]:
        stream = bag.stream(info.topic, info.topic_type)
        stream.field("data")
        found += len(stream)
    return found


@pytest.mark.parametrize("flood", FLOODS)
def test_a_flood_is_soon_read_and_repaired(flood: str, tmp_path: Path) -> None:
    """However many channels, messages and chunks there are, and whatever lengths and times they claim."""
    folder = _bag(tmp_path / "bag", FLOODS[flood]())
    began_s = time.process_time()
    found = _read(folder)
    assert recover(folder)
    assert _read(folder) == found
    assert time.process_time() - began_s < MOST_S


def _small_bag() -> bytes:
    with tempfile.TemporaryDirectory() as name:
        writer = BagWriter(Path(name), "x")
        for topic in ("/a", "/b"):
            channel = writer.add_channel(topic, FLOATS, "", DEFINITIONS[FLOATS], [RELIABLE])
            for number in range(20):
                writer.write(
                    channel, floats([number]), received_ns=number, source_ns=number, sequence=number
                )
        writer.close()
        return (Path(name) / "x.mcap").read_bytes()


SMALL = _small_bag()


@settings(max_examples=examples(100), deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, len(SMALL) - 1), st.binary(min_size=1, max_size=9), st.booleans()),
        max_size=8,
    ),
    st.integers(0, len(SMALL)),
)
def test_no_bytes_are_too_much(changes: list[tuple[int, bytes, bool]], cut: int) -> None:
    """A bag that was changed and cut anywhere is read as far as it goes, and raises nothing."""
    data = bytearray(SMALL[: cut or None])
    for place, piece, replaces in changes:
        data[place : place + len(piece) if replaces else place] = piece
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "x.mcap").write_bytes(bytes(data))
        began_s = time.process_time()
        found = _read(Path(name))
        assert recover(Path(name))
        assert _read(Path(name)) == found
        assert time.process_time() - began_s < MOST_S


@cache
def _zeros(size: int, *, told: bool) -> bytes:
    """Return so many zeros as a frame of zstd, which is small, with its size in it or without."""
    compressor = zstandard.ZstdCompressor().compressobj(size=size if told else -1)
    piece = bytes(2**20)
    parts = [compressor.compress(piece) for _ in range(size // len(piece))]
    return b"".join([*parts, compressor.flush()])


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("claimed", [1000, 2**30, 2**63])
def test_a_small_bag_does_not_open_large(told: bool, claimed: int, tmp_path: Path) -> None:
    """Whatever size a chunk claims and its data says, a reader with 100 MiB of memory left opens the bag."""
    data = _zeros(2**28, told=told)
    chunk = struct.pack("<QQQI", 0, 0, claimed, 0) + _string("zstd")
    chunk += struct.pack("<Q", len(data)) + data
    whole = _record(Opcode.CHUNK, chunk)
    assert len(whole) < 50_000
    folder = _bag(tmp_path, _described(1) + whole + _message(0, 1, 1, 1, floats([1.0])))
    command = [sys.executable, "-c", READER, str(folder), str(100 * 2**20)]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    count, damage = json.loads(said)
    assert count == 1
    assert len(damage) == 1


#: Opens a bag in a process with little more memory than it has by then.
READER = """
import json, resource, sys
from pathlib import Path
import mcap.records, rosbags.typesys, zstandard
from ros_bag.reading import Bag
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[2]),) * 2)
bag = Bag.open(Path(sys.argv[1]))
print(json.dumps([len(bag.stream("/t0")), bag.damage]))
"""
