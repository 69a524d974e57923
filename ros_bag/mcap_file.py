"""Reads an MCAP file as far as possible, and names its unreadable parts.

A recording may be cut short by a kill, damaged on the way, or made to look small and open large. A chunk is opened only
if its size is bounded, and counts only if it matches its checksum; the counts in the file's summary tell what is missing.
"""

from __future__ import annotations

import io
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode

from ros_bag.definitions import MessageDefinition

MAGIC = b"\x89MCAP0\r\n"
#: Limit on the decompressed size of all chunks, in bytes.
MOST_BYTES = 640 * 2**20
#: Most kept descriptions of damage.
_MOST_SAID = 5
#: Name of the metadata record with the unreadable parts of a mended bag.
DAMAGE = "ros-lab-grader damage"

_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct(
    "<QQQII"
)  # start, end, size, checksum, length of the compression's name
_LENGTH = struct.Struct("<Q")
_CHECKSUM_SIZE = 4
_FOOTER = struct.Struct(
    "<BQQQI"
)  # the head of its record, start of the summary and its offsets, checksum

Buffer = Any  # bytes or mmap
#: Log time, publish time, sequence, buffer, and the start and end of the data in the buffer.
Row = tuple[int, int, int, Buffer, int, int]


_WRONG_CHECKSUM = "does not match its checksum"


class _Unreadable(Exception):
    """A part of the file cannot be read."""


@dataclass
class TopicInfo:
    """A topic of one type in a bag, with its number of messages, as the MCAP file and `metadata.yaml` describe it."""

    topic: str
    topic_type: str
    type_hash: str
    definition: MessageDefinition
    qos_text: str
    count: int = 0


@dataclass
class Contents:
    """The readable contents of an MCAP file."""

    schemas: dict[int, tuple[str, MessageDefinition]] = field(default_factory=dict)
    #: Number of a channel -> its topic.
    channels: dict[int, TopicInfo] = field(default_factory=dict)
    #: Number of a channel -> its messages.
    rows: dict[int, list[Row]] = field(default_factory=dict)
    #: True if the file was finished: then nothing is missing at its end.
    finished: bool = False
    #: The unreadable parts, in words.
    damage: list[str] = field(default_factory=list)
    left_bytes: int = MOST_BYTES

    def topics(self) -> dict[tuple[str, str], tuple[TopicInfo, list[Row]]]:
        """Return the messages of all channels by topic and type."""
        found: dict[tuple[str, str], tuple[TopicInfo, list[Row]]] = {}
        for number, info in self.channels.items():
            _, rows = found.setdefault((info.topic, info.topic_type), (info, []))
            rows += self.rows[number]
        return found

    def note(self, place: int, problem: str) -> None:
        """Note that a record cannot be read."""
        self.damage.append(f"the part at byte {place} {problem}")

    def damage_in_words(self) -> tuple[str, ...]:
        """Return the first unreadable parts, and the number of further ones."""
        said = self.damage[:_MOST_SAID]
        more = len(self.damage) - len(said)
        if more:
            return (*said, f"and {more} more")
        return tuple(said)


@dataclass
class _Summary:
    """The summary at the end of a finished file."""

    #: End of the data's records.
    end: int
    chunks: list[int] = field(default_factory=list)
    notes: list[int] = field(default_factory=list)
    chunk_count: int = 0
    #: Number of a channel -> its number of messages; None if the file does not tell.
    counts: dict[int, int] | None = None


def mcap_file_in(folder: Path) -> Path | None:
    """Return the MCAP file in the folder of a bag, None if there is none."""
    return min(folder.glob("*.mcap"), default=None)


def contents_of(path: Path | None) -> Contents:
    """Read a file, or none."""
    contents = Contents()
    size = path.stat().st_size if path is not None else 0
    if path is None or size == 0:
        return contents
    with path.open("rb") as stream:
        # A large bag takes memory only for the pages that are read.
        buffer = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    summary = _summary_of(buffer, size, contents)
    if summary is None:
        if buffer[: len(MAGIC)] == MAGIC:
            _read_records(buffer, len(MAGIC), size, contents)
        return contents
    contents.finished = True
    _read_finished(buffer, summary, contents)
    _compare(summary, contents)
    return contents


# -- a finished file -------------------------------------------------------------------------------


def _summary_of(buffer: Buffer, size: int, contents: Contents) -> _Summary | None:
    """Read the summary, which describes all channels; None if the file is not finished, or its summary damaged."""
    place = size - len(MAGIC) - _FOOTER.size
    start = _summary_start(buffer, place)
    if start is None:
        return None
    summary = _Summary(start)
    try:
        for opcode, body, end in _records(buffer, start, place):
            _read_summary_record(opcode, buffer[body:end], summary, contents)
    except (ValueError, struct.error, McapError):
        return None
    return summary


def _summary_start(buffer: Buffer, place: int) -> int | None:
    """Return the start of the summary from the footer at an offset, or None if either is damaged or missing."""
    if place < len(MAGIC):
        return None
    if buffer[place + _FOOTER.size :] != MAGIC:
        return None
    opcode, length, start, _, checksum = _FOOTER.unpack_from(buffer, place)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - _RECORD_HEAD.size):
        return None
    if start == 0:
        return place
    if not len(MAGIC) <= start <= place:
        return None
    covered = buffer[start : place + _FOOTER.size - _CHECKSUM_SIZE]
    return int(start) if checksum in (0, zlib.crc32(covered)) else None


def _read_summary_record(opcode: int, data: bytes, summary: _Summary, contents: Contents) -> None:
    from mcap.data_stream import ReadDataStream
    from mcap.records import ChunkIndex, MetadataIndex, Statistics

    fields = ReadDataStream(io.BytesIO(data))
    if opcode == Opcode.STATISTICS:
        statistics = Statistics.read(fields)
        summary.counts = statistics.channel_message_counts
        summary.chunk_count = statistics.chunk_count
    elif opcode == Opcode.CHUNK_INDEX:
        summary.chunks.append(ChunkIndex.read(fields).chunk_start_offset)
    elif opcode == Opcode.METADATA_INDEX:
        summary.notes.append(MetadataIndex.read(fields).offset)
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        _describe(opcode, data, contents)


def _read_finished(buffer: Buffer, summary: _Summary, contents: Contents) -> None:
    """Read each chunk at its offset in the summary, or else all records one after another."""
    if not summary.chunks or len(summary.chunks) != summary.chunk_count:
        _read_records(buffer, len(MAGIC), summary.end, contents)
        return
    for place in dict.fromkeys(summary.notes):
        _read_at(buffer, place, Opcode.METADATA, summary.end, contents)
    for place in dict.fromkeys(summary.chunks):
        _read_at(buffer, place, Opcode.CHUNK, summary.end, contents)


def _read_at(buffer: Buffer, place: int, expected: int, limit: int, contents: Contents) -> None:
    """Read the record of an expected kind at an offset, or note that it is not there."""
    if not 0 < place <= limit - _RECORD_HEAD.size:
        contents.note(place, "lies outside of the file")
        return
    opcode, length = _RECORD_HEAD.unpack_from(buffer, place)
    body = place + _RECORD_HEAD.size
    if opcode != expected or body + length > limit:
        contents.note(place, "is another one than the summary says")
    elif opcode == Opcode.CHUNK:
        _read_chunk(buffer, body, body + length, contents)
    else:
        _describe(opcode, buffer[body : body + length], contents)


def _compare(summary: _Summary, contents: Contents) -> None:
    """Note the messages that the summary counts and that were not read."""
    found = []
    for number, count in (summary.counts or {}).items():
        missing = count - len(contents.rows.get(number, ()))
        if missing == 0:
            continue
        info = contents.channels.get(number)
        topic = info.topic if info is not None else "a topic that is not described"
        found.append(f"{missing} of {count} messages on {topic} cannot be read")
    # Such words come first, because they tell the meaning of the damage.
    contents.damage[:0] = found


# -- records, one after another --------------------------------------------------------------------


def _records(buffer: Buffer, offset: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield the kind of each whole record, and the start and end of its body."""
    while offset + _RECORD_HEAD.size <= end:
        opcode, length = _RECORD_HEAD.unpack_from(buffer, offset)
        body = offset + _RECORD_HEAD.size
        offset = body + length
        if offset > end:
            return
        yield opcode, body, offset


def _read_records(
    buffer: Buffer, offset: int, end: int, contents: Contents, *, in_chunk: bool = False
) -> int:
    """Read records up to `end`, or to the first that is cut short or no record at all, and return the offset reached."""
    read_head, read_message, rows = (
        _RECORD_HEAD.unpack_from,
        _MESSAGE_HEAD.unpack_from,
        contents.rows,
    )
    while offset + _RECORD_HEAD.size <= end:
        opcode, length = read_head(buffer, offset)
        body = offset + _RECORD_HEAD.size
        # There is no record of the number 0.
        if opcode == 0:
            break
        # The beginning of a chunk that is cut short can be read.
        if body + length > end and opcode != Opcode.CHUNK:
            break
        offset = body + length
        if opcode == Opcode.MESSAGE and length >= _MESSAGE_HEAD.size:
            channel, sequence, log_ns, publish_ns = read_message(buffer, body)
            if channel in rows:
                rows[channel].append(
                    (log_ns, publish_ns, sequence, buffer, body + _MESSAGE_HEAD.size, offset)
                )
        elif opcode == Opcode.CHUNK and in_chunk:
            contents.note(body, "lies within another chunk")
        elif opcode == Opcode.CHUNK:
            _read_chunk(buffer, body, min(offset, end), contents, cut=offset > end)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            _describe(opcode, buffer[body:offset], contents)
    return offset


def _read_chunk(
    buffer: Buffer, body: int, end: int, contents: Contents, *, cut: bool = False
) -> None:
    """Read the messages in a chunk, or note why they cannot be read; a `cut` chunk is cut short at the file's end."""
    import zstandard

    try:
        data, start, stop = _opened(buffer, body, end, contents, cut)
        read = _read_records(data, start, stop, contents, in_chunk=True)
        if read != stop and not cut:
            raise _Unreadable("ends within a message")
    except _Unreadable as problem:
        contents.note(body, str(problem))
    # Each compression has exceptions of its own.
    except (struct.error, zstandard.ZstdError, RuntimeError) as problem:
        contents.note(body, f"cannot be decompressed ({problem})")


def _opened(
    buffer: Buffer, body: int, end: int, contents: Contents, cut: bool
) -> tuple[Buffer, int, int]:
    """Return the position of a chunk's decompressed records: buffer, start and end."""
    _, _, size, checksum, name_length = _CHUNK_HEAD.unpack_from(buffer, body)
    start = body + _CHUNK_HEAD.size + name_length + _LENGTH.size
    if start > end:
        raise _Unreadable("is cut short")
    name = bytes(buffer[body + _CHUNK_HEAD.size : start - _LENGTH.size])
    (length,) = _LENGTH.unpack_from(buffer, start - _LENGTH.size)
    if not name:
        if not cut and start + length <= end:
            _require_checksum(buffer[start : start + length], checksum)
        return buffer, start, min(start + length, end)
    if start + length > end:
        raise _Unreadable("is cut short")
    if size > contents.left_bytes:
        raise _Unreadable(f"makes more than {MOST_BYTES // 2**20} MiB of a session's messages")
    contents.left_bytes -= size
    data = _decompressed(name, bytes(buffer[start : start + length]), size)
    if len(data) != size:
        raise _Unreadable(_WRONG_CHECKSUM)
    _require_checksum(data, checksum)
    return data, 0, size


def _require_checksum(data: Buffer, checksum: int) -> None:
    """Raise _Unreadable if records do not match their CRC-32; 0 stands for a missing checksum."""
    if checksum not in (0, zlib.crc32(data)):
        raise _Unreadable(_WRONG_CHECKSUM)


def _decompressed(name: bytes, data: bytes, size: int) -> bytes:
    """Decompress a chunk into at most the size of its header, whatever size its data claims."""
    if size == 0:
        return b""
    if name == b"zstd":
        import zstandard

        # The decompressor trusts the size in the data, which must therefore be checked first.
        if zstandard.frame_content_size(data) not in (-1, size):
            raise _Unreadable("is larger than it says")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if name == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        found: bytes = LZ4FrameDecompressor().decompress(data, max_length=size)
        return found
    raise _Unreadable("is compressed in a way that is not known here")


def _describe(opcode: int, data: bytes, contents: Contents) -> None:
    """Read a schema, a channel, or the note of damage in a mended bag; known schemas and channels stay."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Metadata, Schema

    fields = ReadDataStream(io.BytesIO(data))
    try:
        if opcode == Opcode.SCHEMA:
            _take_schema(Schema.read(fields), contents)
        elif opcode == Opcode.CHANNEL:
            _take_channel(Channel.read(fields), contents)
        elif (metadata := Metadata.read(fields)).name == DAMAGE:
            contents.damage += metadata.metadata.values()
    except (ValueError, struct.error, McapError) as problem:
        contents.damage.append(f"a topic's description cannot be read ({problem})")


def _take_schema(schema: Any, contents: Contents) -> None:
    if schema.id in contents.schemas:
        return
    if schema.encoding in ("ros2msg", "ros2idl"):
        definition = MessageDefinition(schema.encoding, schema.data.decode())
        contents.schemas[schema.id] = (schema.name, definition)


def _take_channel(channel: Any, contents: Contents) -> None:
    if channel.id in contents.rows:
        return
    if channel.schema_id not in contents.schemas:
        return
    topic_type, definition = contents.schemas[channel.schema_id]
    type_hash = channel.metadata.get("topic_type_hash", "")
    qos_text = channel.metadata.get("offered_qos_profiles", "[]")
    contents.channels[channel.id] = TopicInfo(
        channel.topic, topic_type, type_hash, definition, qos_text
    )
    contents.rows[channel.id] = []
