"""Values are counted without decoding: as many as there are, whatever the type, and in a time that is bounded."""

from __future__ import annotations

import dataclasses
import random
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ros_bag.definitions import definition_of
from ros_bag.elements import MOST_VALUES, readable_messages
from ros_bag.qos import Qos
from ros_bag.reading import Bag, Stream
from ros_bag.writing import BagWriter
from tests.ros_bag.sample_messages import message_types, write_all_types
from tests.thorough import part

FLOATS = "std_msgs/msg/Float64MultiArray"


def values_in(message: Any) -> int:
    """Return how many values a decoded message is made of."""
    if dataclasses.is_dataclass(message):
        fields = (field.name for field in dataclasses.fields(message))
        return 1 + sum(
            values_in(getattr(message, name)) for name in fields if name != "__msgtype__"
        )
    if isinstance(message, list):
        return 1 + sum(map(values_in, message))
    return 1


def with_dimensions(count: int) -> bytes:
    """Return the CDR of a Float64MultiArray with so many empty dimensions in its layout, and no data."""
    dimension = struct.pack("<IB3xII", 1, 0, 0, 0)
    return struct.pack("<BBHI", 0, 1, 0, count) + dimension * count + struct.pack("<II", 0, 0)


def test_every_type_is_counted_as_it_is_decoded(tmp_path: Path) -> None:
    """The first message is read if its values are allowed, and not if one fewer is."""
    pytest.importorskip("rclpy")
    some = part(message_types(), of=4)
    write_all_types(tmp_path, [*some, "std_msgs/msg/Empty", "nav_msgs/msg/Path"], messages=1)
    bag, wrong = Bag.open(tmp_path), []
    for info in bag.topics:
        stream = bag.stream(info.topic)
        if not stream.understood:
            continue
        values = values_in(stream.messages[0])
        types = info.definition.types(info.topic_type)
        read = []
        for n in (values, values - 1):
            read.append(readable_messages(info.topic_type, types, stream.data, n))
        if read != [1, 0]:
            wrong.append((info.topic_type, values, read))
    assert wrong == []
    assert len(bag.topics) > 40


def test_a_flood_of_empty_parts_is_cut(tmp_path: Path) -> None:
    """Twenty thousand empty dimensions in each message: only as many messages are there as can be decoded."""
    writer = BagWriter(tmp_path, "x")
    qos = [Qos("reliable", "volatile", liveliness="automatic")]
    channel = writer.add_channel("/a", FLOATS, "", definition_of(FLOATS), qos)
    for number in range(100):
        times = {"received_ns": number, "source_ns": number, "sequence": number}
        writer.write(channel, with_dimensions(20_000), **times)
    writer.close()
    began_s = time.process_time()
    stream = Bag.open(tmp_path).stream("/a")
    per_message = values_in(stream.messages[0])
    assert len(stream) == len(stream.received_ns) == MOST_VALUES // per_message < 100
    assert len(stream) + stream.unread == 100
    assert all(message is not None for message in stream.messages)
    assert time.process_time() - began_s < 25


def test_large_arrays_of_numbers_are_few_values() -> None:
    """An image or a cloud of points is one array, however large."""
    name = "sensor_msgs/msg/PointCloud2"
    types = definition_of(name).types(name)
    cloud = b"\0\1\0\0" + bytes(12) + struct.pack("<4xIII", 1, 1000, 0)
    cloud += struct.pack("<B3xIII", 0, 16, 16_000_000, 16_000_000) + bytes(16_000_001)
    assert readable_messages(name, types, [cloud] * 20) == 20


@pytest.mark.parametrize(
    "name", [FLOATS, "visualization_msgs/msg/MarkerArray", "nav_msgs/msg/Path"]
)
def test_random_bytes_are_counted_in_bounded_time(name: str) -> None:
    """Lengths that are none end a message; nothing is allocated for them."""
    source, types = random.Random(1), definition_of(name).types(name)
    data = [b"\0\1\0\0" + source.choice([b"\xff", b"\0", b"\1\0\0\0"]) * 20_000 for _ in range(20)]
    data += [b"", b"\0", b"\0\1\0\0" + source.randbytes(100_000)]
    began_s = time.process_time()
    assert 0 <= readable_messages(name, types, data, 100_000) <= len(data)
    assert time.process_time() - began_s < 10


def test_a_type_that_cannot_be_decoded_is_told_apart_from_wrong_bytes() -> None:
    """Then it is not the messages that are wrong."""
    pytest.importorskip("rclpy")
    one = np.zeros(1, np.int64)
    for name, understood in ((FLOATS, True), ("test_msgs/msg/WStrings", False)):
        stream = Stream("/a", name, one, one, one, (b"wrong",), definition_of(name))
        assert stream.understood is understood
        assert stream.messages == (None,)
