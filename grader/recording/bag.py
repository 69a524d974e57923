"""The rosbag2 bag of a recording: one MCAP file and its `metadata.yaml`.

A message's `log_time` is the time of its reception, its `publish_time` the writer's DDS source timestamp, and its
`sequence` the publication sequence number, which counts from 1 for each publisher. The bag opens with `ros2 bag` and
Foxglove.

References
----------
MCAP format specification, version 0; rosbag2 metadata, version 8, which `ros2 bag` of Humble, Jazzy and later reads.
"""

from __future__ import annotations

import functools
import itertools
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grader.files import replace_file
from grader.recording.definitions import MessageDefinition, field_steps
from grader.recording.elements import MOST_VALUES, readable_messages
from grader.recording.mcap_file import DAMAGE, Contents, Row, TopicInfo, contents_of
from grader.recording.session import Qos

if TYPE_CHECKING:
    from typing import TypeAlias

    import numpy as np
    import numpy.typing as npt
    from mcap.writer import Writer
    from rosbags.interfaces.typing import Typesdict

    Int64s: TypeAlias = npt.NDArray[np.int64]

METADATA_FILE = "metadata.yaml"
#: Last version with QoS profiles as text; Humble reads no other form.
METADATA_VERSION = 8
INFINITE_NS = 9_223_372_036_854_775_807

_RECOVERY_FOLDER = ".recovering"


# -- metadata.yaml ---------------------------------------------------------------------------------


#: Numbers of QoS policies in rmw's `types.h`; rosbag2 writes them up to metadata version 8.
_HISTORY = ("system_default", "keep_last", "keep_all", "unknown")
_RELIABILITY = ("system_default", "reliable", "best_effort", "unknown", "best_available")
_DURABILITY = ("system_default", "transient_local", "volatile", "unknown", "best_available")
_LIVELINESS = ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown")


def _number(policy: str, policies: Sequence[str]) -> int:
    return policies.index(policy if policy in policies else "unknown")


def _duration(duration_ns: int | None) -> dict[str, int]:
    seconds, nanoseconds = divmod(INFINITE_NS if duration_ns is None else duration_ns, 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _qos_text(profiles: Sequence[Qos]) -> str:
    """Write offered QoS profiles in the terms of rosbag2 up to metadata version 8, as JSON, which is YAML.

    Later versions understand policies as numbers too. The channel and `metadata.yaml` hold the same text, because
    `rosbags` gives no messages of a channel if the two differ.
    """
    return json.dumps([_plain_qos(qos) for qos in profiles])


def _plain_qos(qos: Qos) -> dict[str, Any]:
    return {
        "history": _number(qos.history, _HISTORY),
        "depth": qos.depth,
        "reliability": _number(qos.reliability, _RELIABILITY),
        "durability": _number(qos.durability, _DURABILITY),
        "deadline": _duration(qos.deadline_ns),
        "lifespan": _duration(qos.lifespan_ns),
        "liveliness": _number(qos.liveliness, _LIVELINESS),
        "liveliness_lease_duration": _duration(qos.liveliness_lease_ns),
        "avoid_ros_namespace_conventions": False,
    }


def offered_policies(qos_text: str) -> list[tuple[str, str]]:
    """Return the reliability and durability of each QoS profile in a channel's text; none if it is not understood.

    Recordings of earlier versions name the policies: `[{"reliability": "best_effort", ...}]`; they are numbers today.
    """
    policies = []
    try:
        for profile in json.loads(qos_text or "[]"):
            reliability = _name(profile["reliability"], _RELIABILITY)
            policies.append((reliability, _name(profile["durability"], _DURABILITY)))
    except (ValueError, TypeError, KeyError, RecursionError):
        return []
    return policies


def _name(policy: object, policies: Sequence[str]) -> str:
    if isinstance(policy, int) and 0 <= policy < len(policies):
        return policies[policy]
    return str(policy)


def _metadata_yaml(
    file_name: str, channels: Sequence[TopicInfo], start_ns: int, end_ns: int
) -> str:
    total = sum(channel.count for channel in channels)
    duration = {"nanoseconds": end_ns - start_ns}
    start = {"nanoseconds_since_epoch": start_ns}
    file = {"path": file_name, "starting_time": start, "duration": duration, "message_count": total}
    information = {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": start,
        "message_count": total,
        "topics_with_message_count": [_plain_topic(channel) for channel in channels],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [file],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    return json.dumps({"rosbag2_bagfile_information": information}, indent=1) + "\n"


def _plain_topic(channel: TopicInfo) -> dict[str, Any]:
    metadata = {
        "name": channel.topic,
        "type": channel.topic_type,
        "serialization_format": "cdr",
        "offered_qos_profiles": channel.qos_text,
        "type_description_hash": channel.type_hash,
    }
    return {"topic_metadata": metadata, "message_count": channel.count}


# -- writing ---------------------------------------------------------------------------------------


class BagWriter:
    """Writes a bag into a folder, which is made if it is missing. One thread at a time may use it.

    Chunks are compressed: a bag is a third as large, for less than 1 ms of CPU time in a session. `flush` ends a chunk.
    """

    def __init__(self, folder: Path, name: str) -> None:
        from mcap.writer import CompressionType, Writer

        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file_name = name + ".mcap"
        self._stream = (folder / self._file_name).open("wb")
        self._writer: Writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="ros-lab-grader")
        self._stream.flush()
        self._schemas: dict[tuple[str, MessageDefinition], int] = {}
        self._channels: dict[int, TopicInfo] = {}
        self._start_ns = INFINITE_NS
        self._end_ns = 0

    def add_channel(
        self,
        topic: str,
        topic_type: str,
        type_hash: str,
        definition: MessageDefinition,
        offered_qos: Sequence[Qos],
    ) -> int:
        """Add a topic of one type, and return its channel for `write`."""
        qos_text = _qos_text(offered_qos)
        return self._add(TopicInfo(topic, topic_type, type_hash, definition, qos_text))

    def _add(self, channel: TopicInfo) -> int:
        key = (channel.topic_type, channel.definition)
        if key not in self._schemas:
            text = channel.definition.text.encode()
            self._schemas[key] = self._writer.register_schema(
                channel.topic_type, channel.definition.encoding, text
            )
        metadata = {"offered_qos_profiles": channel.qos_text, "topic_type_hash": channel.type_hash}
        number = self._writer.register_channel(channel.topic, "cdr", self._schemas[key], metadata)
        self._channels[number] = channel
        return number

    def write(
        self, channel: int, data: bytes, *, received_ns: int, source_ns: int, sequence: int
    ) -> None:
        """Add a message: its CDR bytes with the header of four bytes, and its times."""
        # The source timestamp comes over the wire, and can be anything.
        received_ns = min(max(received_ns, 0), INFINITE_NS)
        source_ns = min(max(source_ns, 0), INFINITE_NS)
        self._writer.add_message(channel, received_ns, data, source_ns, sequence & 0xFFFFFFFF)
        self._channels[channel].count += 1
        self._start_ns = min(self._start_ns, received_ns)
        self._end_ns = max(self._end_ns, received_ns)

    def note_damage(self, damage: Sequence[str]) -> None:
        """Note the unreadable parts of the bag from which this one is made, if any."""
        if damage:
            numbered = {str(n): words for n, words in enumerate(damage)}
            self._writer.add_metadata(DAMAGE, numbered)

    def flush(self) -> None:
        """Hand all written data to the system; it outlives a kill of this process."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Finish the MCAP file, then write `metadata.yaml`; its presence says that the bag is whole."""
        if self._stream.closed:
            return
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()
        start_ns = min(self._start_ns, self._end_ns)
        text = _metadata_yaml(
            self._file_name, list(self._channels.values()), start_ns, self._end_ns
        )
        replace_file(self._folder / METADATA_FILE, text)


# -- mending ---------------------------------------------------------------------------------------


def _mcap_file(folder: Path) -> Path | None:
    return min(folder.glob("*.mcap"), default=None)


def recover(folder: Path) -> bool:
    """Finish a bag after its recorder was killed, with every readable message; return False if the bag was whole.

    A bag with damage elsewhere than at its end keeps a note of that. Raises `NotADirectoryError` if the folder is
    missing.
    """
    if not folder.is_dir():
        raise NotADirectoryError(f"no bag at {folder}: give the folder that holds the .mcap file")
    if (folder / METADATA_FILE).exists():
        return False
    found = _mcap_file(folder)
    path = found or folder / (folder.name + ".mcap")
    workshop = folder / _RECOVERY_FOLDER
    shutil.rmtree(workshop, ignore_errors=True)
    _rewrite(contents_of(found), BagWriter(workshop, path.stem))
    (workshop / path.name).replace(path)
    (workshop / METADATA_FILE).replace(folder / METADATA_FILE)
    shutil.rmtree(workshop)
    return True


def _rewrite(contents: Contents, writer: BagWriter) -> None:
    """Write all readable messages in the order of their reception, and close the writer."""
    rows: list[tuple[Row, int]] = []
    for info, messages in contents.topics().values():
        channel = writer._add(info)
        rows += [(row, channel) for row in messages]
    rows.sort(key=lambda item: item[0][0])
    for (received_ns, source_ns, sequence, buffer, start, end), channel in rows:
        data = bytes(buffer[start:end])
        writer.write(channel, data, received_ns=received_ns, source_ns=source_ns, sequence=sequence)
    writer.note_damage(contents.damage_in_words())
    writer.close()


# -- reading ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stream:
    """All messages of one type on one topic, in the order of their reception."""

    topic: str
    #: Empty if the bag has no message of the topic.
    topic_type: str
    #: int64[n]: Time of each message's reception.
    received_ns: Int64s
    #: int64[n]: The publisher's DDS source timestamps.
    source_ns: Int64s
    #: int64[n]: Publication sequence numbers; those of several publishers interleave.
    sequence: Int64s
    #: CDR, with the header of four bytes.
    data: tuple[bytes, ...]
    #: The type's definition from the bag.
    definition: MessageDefinition | None = None
    #: Number of further messages, which are ignored because decoding all would take too long.
    unread: int = 0

    def __len__(self) -> int:
        return len(self.data)

    @property
    def recorded(self) -> int:
        """Number of recorded messages, with the unread ones."""
        return len(self) + self.unread

    def only(self, rows: npt.NDArray[np.bool_]) -> Stream:
        """Return the stream with some of its messages."""
        return replace(
            self,
            received_ns=self.received_ns[rows],
            source_ns=self.source_ns[rows],
            sequence=self.sequence[rows],
            data=tuple(itertools.compress(self.data, rows)),
        )

    @property
    def understood(self) -> bool:
        """True if the type's definition can be read; if not, no message can be decoded, whatever its bytes."""
        return not self.data or self._decoder is not None

    @property
    def _decoder(self) -> _Decoder | None:
        if self.definition:
            return _decoder(self.topic_type, self.definition)
        return None

    @functools.cached_property
    def messages(self) -> tuple[object | None, ...]:
        """All messages, decoded; None stands for a message with bytes that do not fit the type."""
        decoder = self._decoder
        if decoder is None:
            return (None,) * len(self.data)
        found: list[object | None] = []
        for data in self.data:
            # The bytes are a student's. Decoding fails in many ways (short, wrong lengths, bad UTF-8), with exceptions
            # of several families.
            try:
                found.append(decoder.decode(data, self.topic_type))
            except Exception:
                found.append(None)
        return tuple(found)

    def field(self, path: str) -> list[Any]:
        """Return the value of one field in each message: None if the message is malformed or has no such field.

        `definitions.field_steps` describes paths. Arrays of numbers are numpy arrays.
        """
        steps = field_steps(path)
        return [_pick(message, steps) for message in self.messages]


def _pick(value: Any, steps: Sequence[str | int]) -> Any:
    try:
        for step in steps:
            if isinstance(step, int):
                value = value[step]
            else:
                value = getattr(value, step)
    except (AttributeError, IndexError, TypeError):
        return None
    return value


@dataclass(frozen=True)
class _Decoder:
    types: Typesdict
    decode: Callable[[bytes, str], object]


@functools.lru_cache(maxsize=64)
def _decoder(topic_type: str, definition: MessageDefinition) -> _Decoder | None:
    """Return a decoder of CDR by the definition in the bag; None if the definition cannot be understood."""
    from rosbags.typesys import Stores, TypesysError, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        types = definition.types(topic_type)
        store.register(types)
        # Compiles the decoder, which fails for wide strings.
        store.get_msgdef(topic_type)
    except (TypesysError, KeyError):
        return None
    return _Decoder(types, store.deserialize_cdr)


class Bag:
    """A bag opened for reading, finished or not, with all messages that can be read.

    The bag is `finished` if its recorder came to its end, and nothing is missing since; if not, the last moments may be
    missing. `damage` names the other unreadable parts. Its `topics` are sorted by name, then by type; a topic with two
    types is there twice.
    """

    def __init__(self, contents: Contents, most_values: int = MOST_VALUES) -> None:
        self._most_values = most_values
        self.finished = contents.finished
        self.damage = contents.damage_in_words()
        self._contents = contents.topics()
        topics = []
        for key in sorted(self._contents):
            info, rows = self._contents[key]
            topics.append(replace(info, count=len(rows)))
        self.topics = tuple(topics)

    @classmethod
    def open(cls, folder: Path, most_values: int = MOST_VALUES) -> Bag:
        """Open the bag in a folder, finished or not, or raise `FileNotFoundError` if there is none.

        At most `most_values` values of each topic are decoded.
        """
        path = _mcap_file(folder)
        if path is None:
            raise FileNotFoundError(f"no .mcap file in {folder}: give the folder of a recording")
        return cls(contents_of(path), most_values)

    @classmethod
    def empty(cls) -> Bag:
        """Return a finished bag without messages."""
        return cls(Contents(finished=True))

    @property
    def whole(self) -> bool:
        """True if the whole recording can be read."""
        return self.finished and not self.damage

    @property
    def size_bytes(self) -> int:
        """Bytes of all messages together."""
        total = 0
        for _, rows in self._contents.values():
            for *_, start, end in rows:
                total += end - start
        return total

    def received_ns(self, topic: str, topic_type: str) -> Int64s:
        """Return the times of reception of the messages of one type on a topic, in order."""
        return _column(self._rows(topic, topic_type), 0)

    def _rows(self, topic: str, topic_type: str) -> list[Row]:
        """Return the messages of one type on a topic, in the order of their reception."""
        _, rows = self._contents.get((topic, topic_type), (None, []))
        return sorted(rows, key=itemgetter(0))

    def messages(
        self, topics: Iterable[tuple[str, str]]
    ) -> Iterator[tuple[int, tuple[str, str], bytes]]:
        """Yield all messages of some topics (name and type) as they were received: time, topic, and CDR."""
        found: list[tuple[Row, tuple[str, str]]] = []
        for topic in topics:
            _, rows = self._contents.get(topic, (None, []))
            found += [(row, topic) for row in rows]
        found.sort(key=lambda item: item[0][0])
        for (received_ns, _, _, buffer, start, end), topic in found:
            yield min(received_ns, INFINITE_NS), topic, bytes(buffer[start:end])

    @functools.cache  # noqa: B019 - a bag lives as long as its judging
    def stream(self, topic: str, topic_type: str | None = None) -> Stream:
        """Return the messages of a topic (fully qualified), of its most frequent type if none is given.

        Messages beyond the most values are left out, see `Stream.unread`.
        """
        if topic_type is None:
            topic_type = self._most_frequent_type(topic)
        rows = self._rows(topic, topic_type)
        data = tuple(bytes(buffer[start:end]) for _, _, _, buffer, start, end in rows)
        read = len(data)
        definition = None
        found, _ = self._contents.get((topic, topic_type), (None, []))
        if found is not None:
            definition = found.definition
        if definition is not None:
            decoder = _decoder(topic_type, definition)
            if decoder is not None:
                read = readable_messages(topic_type, decoder.types, data, self._most_values)
        rows = rows[:read]
        return Stream(
            topic,
            topic_type,
            received_ns=_column(rows, 0),
            source_ns=_column(rows, 1),
            sequence=_column(rows, 2),
            data=data[:read],
            definition=definition,
            unread=len(data) - read,
        )

    def _most_frequent_type(self, topic: str) -> str:
        """Return the type of a topic with the most messages; empty if the bag has none."""
        infos = [info for info in self.topics if info.topic == topic]
        if not infos:
            return ""
        return max(infos, key=lambda info: info.count).topic_type


def _column(rows: list[Row], index: int) -> Int64s:
    # Imported here, because processes that only write bags would start a third slower.
    import numpy as np

    # Times of foreign bags may use all 64 bits; they are limited to the largest value of int64.
    whole = np.fromiter(map(itemgetter(index), rows), dtype=np.uint64, count=len(rows))
    return np.minimum(whole, INFINITE_NS, out=whole).astype(np.int64)
