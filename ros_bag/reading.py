"""Reads a bag: its messages by topic, decoded without ROS, as far as the file can be read."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ros_bag.definitions import MessageDefinition
from ros_bag.elements import MOST_VALUES, readable_messages
from ros_bag.fields import field_steps
from ros_bag.mcap_file import Contents, Row, contents_of, mcap_file_in
from ros_bag.qos import INFINITE_NS

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

Int64s: TypeAlias = npt.NDArray[np.int64]
#: Decodes the CDR of a message of a type.
_Decoder: TypeAlias = Callable[[bytes | memoryview, str], object]


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
            return _decoder_of(self.topic_type, self.definition)
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
                found.append(decoder(data, self.topic_type))
            except Exception:
                found.append(None)
        return tuple(found)

    def field(self, path: str) -> list[Any]:
        """Return the value of one field in each message: None if the message is malformed or has no such field.

        `fields.field_steps` describes paths. Arrays of numbers are numpy arrays.
        """
        steps = field_steps(path)
        return [_pick(message, steps) for message in self.messages]

    def numbers(self, path: str) -> npt.NDArray[np.float64] | None:
        """Return a field with an array of numbers of 64 bits in each message, without decoding each: float64[n, length].

        None if the messages are not alike: if any differs from the first one in more than these numbers. Numbers decide
        nothing about the other contents of a message, so that all others are decoded as the first one.
        """
        if self.definition is None:
            return None
        if len(set(map(len, self.data))) != 1:
            return None
        steps = field_steps(path)
        place = self._placed(0, steps)
        if place is None:
            return None
        start, end = place
        rows = np.frombuffer(b"".join(self.data), np.uint8).reshape(len(self.data), -1)
        before = start
        if self._is_padded(rows, place, steps):
            before -= _PADDING
        if _differ(rows[:, :before]):
            return None
        if _differ(rows[:, end:]):
            return None
        return rows[:, start:end].copy().view(np.float64)

    def _placed(self, number: int, steps: Sequence[str | int]) -> tuple[int, int] | None:
        """Return where the numbers in a field of a message begin and end in its bytes; None if that is not known."""
        decoder = self._decoder
        if decoder is None:
            return None
        message = memoryview(self.data[number])
        try:
            values = _pick(decoder(message, self.topic_type), steps)
        except Exception:
            return None
        return _place_in(message, values)

    def _is_padded(
        self, rows: npt.NDArray[np.uint8], place: tuple[int, int], steps: Sequence[str | int]
    ) -> bool:
        """Tell whether messages differ in the last bytes before the numbers, and these mean nothing.

        Writers leave any contents in the bytes that align the numbers behind the length of their sequence. Two messages
        with equal lengths, and different bytes directly before the numbers, cannot have the lengths there.
        """
        start, end = place
        padding = rows[:, start - _PADDING : start]
        differing = (padding != padding[0]).any(axis=1)
        if not differing.any():
            return False
        stated = self.data[0][start - 2 * _PADDING : start - _PADDING]
        if int.from_bytes(stated, "little") != (end - start) // 8:
            return False
        if not self._is_sequence(steps):
            return False
        return self._placed(int(differing.argmax()), steps) == place

    def _is_sequence(self, steps: Sequence[str | int]) -> bool:
        """Tell whether a path leads to a sequence by the names of fields alone."""
        assert self.definition is not None
        types = _types_of(self.topic_type, self.definition)
        kind: tuple[int, Any] = (_NAMED, self.topic_type)
        for step in steps:
            if kind[0] != _NAMED:
                return False
            fields: dict[Any, tuple[int, Any]] = dict(types[kind[1]][1])
            if step not in fields:
                return False
            kind = fields[step]
        return kind[0] == _SEQUENCE


#: Bytes that align numbers of 64 bits behind the length of a sequence, if any do.
_PADDING = 4
#: Kinds of fields, as `rosbags` numbers them: a message, and a sequence.
_NAMED, _SEQUENCE = 2, 4


def _differ(rows: npt.NDArray[np.uint8]) -> bool:
    """Tell whether any row differs from the first one."""
    return bool((rows != rows[0]).any())


def _place_in(message: memoryview, values: Any) -> tuple[int, int] | None:
    """Return where an array begins and ends in the bytes of its message; None if it is no view of some of them."""
    if not isinstance(values, np.ndarray):
        return None
    if (values.dtype, values.ndim) != (np.float64, 1):
        return None
    if not values.size:
        return None
    start = values.ctypes.data - np.frombuffer(message, np.uint8).ctypes.data
    end = start + values.nbytes
    # Before the array stand its header, of four bytes, and its length.
    if start < 2 * _PADDING:
        return None
    if message[start:end] != values.tobytes():
        return None
    return start, end


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


@functools.lru_cache(maxsize=64)
def _types_of(topic_type: str, definition: MessageDefinition) -> Typesdict:
    """Return the types in the definition in the bag; none if the definition cannot be understood."""
    from rosbags.typesys import TypesysError

    try:
        return definition.types(topic_type)
    except TypesysError:
        return {}


@functools.lru_cache(maxsize=64)
def _decoder_of(topic_type: str, definition: MessageDefinition) -> _Decoder | None:
    """Return a decoder of CDR by the definition in the bag; None if the definition cannot be understood."""
    from rosbags.typesys import TypesysError

    from ros_bag.decoders import ReadingStore

    store = ReadingStore()
    try:
        store.register(_types_of(topic_type, definition))
        # Compiles the decoder, which fails for wide strings.
        store.get_msgdef(topic_type)
    except (TypesysError, KeyError):
        return None
    return store.deserialize_cdr


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
        path = mcap_file_in(folder)
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
            # A definition that lacks a type has no decoder, so that its messages need no bound.
            with contextlib.suppress(KeyError):
                types = _types_of(topic_type, definition)
                read = readable_messages(topic_type, types, data, self._most_values)
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
    # Times of foreign bags may use all 64 bits; they are limited to the largest value of int64.
    whole = np.fromiter(map(itemgetter(index), rows), dtype=np.uint64, count=len(rows))
    return np.minimum(whole, INFINITE_NS, out=whole).astype(np.int64)
