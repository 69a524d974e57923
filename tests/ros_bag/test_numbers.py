"""Arrays of numbers of messages that are alike, read without decoding each message."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from ros_bag.definitions import definition_of
from ros_bag.reading import Stream

_STORE = get_typestore(Stores.ROS2_JAZZY)
_FLOATS = "std_msgs/msg/Float64MultiArray"
_STATE = "sensor_msgs/msg/JointState"
_RANDOM = np.random.default_rng(2)


def _stream(kind: str, *messages: bytes) -> Stream:
    """Return a stream of messages of a type."""
    times = np.arange(len(messages), dtype=np.int64)
    return Stream("/a", kind, times, times, times, messages, definition_of(kind))


def _floats(*values: float, offset: int = 0, big: bool = False) -> bytes:
    """Return the CDR of a Float64MultiArray."""
    types = _STORE.types
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=offset)
    message = types[_FLOATS](layout=layout, data=np.array(values))
    return bytes(_STORE.serialize_cdr(message, _FLOATS, little_endian=not big))


def _state(sec: int, *values: float) -> bytes:
    """Return the CDR of a JointState with names."""
    types = _STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
    none = np.empty(0)
    names = [f"joint{number}" for number in range(len(values))]
    message: Any = types[_STATE](header, names, np.array(values), none, none)
    return bytes(_STORE.serialize_cdr(message, _STATE))


def _same(stream: Stream, path: str) -> bool:
    """Tell whether a stream has the numbers of its decoded messages."""
    found = stream.numbers(path)
    assert found is not None
    return np.array_equal(found, np.array(stream.field(path)), equal_nan=True)


@pytest.mark.parametrize("count", [1, 2, 50])
def test_numbers_of_messages_that_are_alike(count: int) -> None:
    """Random bytes as numbers come back to the last bit, also those that look like another length."""
    rows = _RANDOM.integers(0, 256, (count, 7 * 8), np.uint8).view(np.float64)
    stream = _stream(_FLOATS, *(_floats(*row) for row in rows))
    found = stream.numbers("data")
    assert found is not None
    assert found.tobytes() == rows.tobytes()
    found[0, 0] = 1.0


def test_bytes_that_align_the_numbers_mean_nothing() -> None:
    """Writers leave any bytes between the length of a sequence and its numbers, which decoders pass over."""
    messages = []
    for number in range(20):
        message = bytearray(_floats(number, 2.0, 3.0))
        message[16:20] = _RANDOM.bytes(4)
        messages.append(bytes(message))
    messages[5] = messages[5][:16] + (3).to_bytes(4, "little") + messages[5][20:]
    assert _same(_stream(_FLOATS, *messages), "data")


def test_a_length_directly_before_the_numbers_counts() -> None:
    """Messages are not alike if one has its length in the place of meaningless bytes of another."""
    one = _floats(1.0, 2.0, 3.0)
    other = one[:16] + (2).to_bytes(4, "little") + one[20:]
    assert _same(_stream(_FLOATS, one, other), "data")
    shorter = one[:12] + (2).to_bytes(4, "little") + one[16:]
    assert _stream(_FLOATS, one, shorter).numbers("data") is None


def test_numbers_behind_texts_and_times() -> None:
    """The place of the numbers follows from the first message, whatever is in front of them."""
    messages = [_state(3, *row) for row in _RANDOM.normal(size=(20, 3))]
    assert _same(_stream(_STATE, *messages), "position")


@pytest.mark.parametrize(
    ("kind", "messages", "path"),
    [
        (_FLOATS, [_floats(1, 2), _floats(1, 2, 3)], "data"),
        (_FLOATS, [_floats(1, 2), _floats(1, 2, offset=1)], "data"),
        (_FLOATS, [_floats(1, 2), _floats(1, 2)[:-1]], "data"),
        (_FLOATS, [b"wrong", b"wrong"], "data"),
        (_FLOATS, [_floats(1, big=True), _floats(2, big=True)], "data"),
        (_FLOATS, [_floats(), _floats()], "data"),
        (_FLOATS, [_floats(1), _floats(2)], "data[0]"),
        (_FLOATS, [_floats(1), _floats(2)], "layout"),
        (_FLOATS, [_floats(1), _floats(2)], "missing"),
        (_FLOATS, [], "data"),
        (_STATE, [_state(3, 1.0), _state(4, 1.0)], "position"),
        (_STATE, [_state(3, 1.0), _state(3, 2.0)], "name"),
    ],
)
def test_other_messages_are_decoded_one_by_one(kind: str, messages: list[bytes], path: str) -> None:
    """Messages that differ in anything else, and other fields, are left to the decoder."""
    assert _stream(kind, *messages).numbers(path) is None
