"""Messages for tests: by hand without ROS, and a bag with messages of every installed type by the real serializer."""

from __future__ import annotations

import importlib
import itertools
import struct
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ros_bag.definitions import SEPARATOR, MessageDefinition, definition_of, type_hash_of
from ros_bag.qos import Qos
from ros_bag.writing import BagWriter

FLOATS, TEXT = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/String"
RELIABLE = Qos(reliability="reliable", durability="volatile", liveliness="automatic")
DEFINITIONS = {
    FLOATS: MessageDefinition(
        "ros2msg",
        "MultiArrayLayout layout\nfloat64[] data\n"
        f"{SEPARATOR}\nMSG: std_msgs/MultiArrayLayout\nMultiArrayDimension[] dim\nuint32 data_offset\n"
        f"{SEPARATOR}\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n",
    ),
    TEXT: MessageDefinition("ros2msg", "string data\n"),
}
#: Topic -> the messages on it, as rclpy has them.
Sent = dict[str, list[Any]]


def floats(values: Iterable[float]) -> bytes:
    """Give the CDR of a Float64MultiArray without a layout."""
    listed = list(values)
    if listed:
        body = struct.pack(f"<4x{len(listed)}d", *listed)
    else:
        body = b""
    return struct.pack("<BBHIII", 0, 1, 0, 0, 0, len(listed)) + body


def message_types() -> list[str]:
    """Return all message types of the installed packages."""
    share = Path(sys.prefix) / "share"
    return sorted(f"{path.parts[-3]}/msg/{path.stem}" for path in share.glob("*/msg/*.msg"))


def write_all_types(folder: Path, types: list[str], messages: int = 2) -> Sent:
    """Write a bag with some messages of each type, each on a topic named by its type, and return these messages."""
    from rclpy.serialization import serialize_message

    sent: Sent = {}
    writer = BagWriter(folder, "all")
    for name in types:
        package, part, kind = name.split("/")
        made = getattr(importlib.import_module(f"{package}.{part}"), kind)
        topic = "/" + name.replace("/", "_")
        definition = definition_of(name)
        channel = writer.add_channel(topic, name, type_hash_of(name), definition, [RELIABLE])
        sent[topic] = [_filled(made, itertools.count(3 * n)) for n in range(messages)]
        for number, message in enumerate(sent[topic], 1):
            data = serialize_message(message)
            times = {"received_ns": number * 10**9, "source_ns": number * 10**9}
            writer.write(channel, data, **times, sequence=number)
    writer.close()
    return sent


def _filled(kind: Any, numbers: Iterator[int]) -> Any:
    """Return a message with values other than zero in all fields, and two elements in each sequence."""
    message = kind()
    for field, spelled in kind.get_fields_and_field_types().items():
        setattr(message, field, _value(kind, spelled, numbers))
    return message


def _value(kind: Any, spelled: str, numbers: Iterator[int]) -> Any:
    if spelled.startswith("sequence<"):
        element, _, most = spelled.removeprefix("sequence<").removesuffix(">").partition(", ")
        return [_value(kind, element, numbers) for _ in range(min(2, int(most or 2)))]
    if spelled.endswith("]"):
        element, _, size = spelled[:-1].partition("[")
        return [_value(kind, element, numbers) for _ in range(int(size))]
    number = next(numbers) % 100
    if "/" in spelled:
        package, name = spelled.split("/")
        return _filled(getattr(importlib.import_module(f"{package}.msg"), name), numbers)
    plain = {"boolean": number % 2 == 0, "octet": bytes([number]), "float": number + 0.5}
    plain["double"] = plain["float"]
    return plain.get(spelled, f"s{number}" if "string" in spelled else number)


def same(read: Any, message: Any) -> bool:
    """Tell whether a decoded value equals a message of rclpy's, or a part of one, by the names of its fields."""
    if hasattr(message, "get_fields_and_field_types"):
        return all(
            same(_field(read, name), getattr(message, name))
            for name in message.get_fields_and_field_types()
        )
    if isinstance(message, bytes):
        # An octet is one byte with rclpy, and a number with others.
        return bool(read == message[0])
    if isinstance(message, (bool, int, float, str)):
        return bool(read == message)
    if not hasattr(message, "__len__"):
        return bool(read == message)
    if len(read) != len(message):
        return False
    return all(map(same, read, message))


def _field(read: Any, name: str) -> Any:
    if isinstance(read, dict):
        return read[name]
    return getattr(read, name)
