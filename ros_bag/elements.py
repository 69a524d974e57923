"""Counts the values in messages without decoding them, because a small message can hold very many empty parts.

Values are counted as objects of Python: each message in a message, text, number, and array of numbers is one. The
bytes of arrays of numbers are not counted, because the size of the recording bounds them.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Mapping, Sequence
from typing import Any

#: Values of one topic that are decoded: some 2 s of a core and 0.1 GiB. Seven joints at 100 Hz are 40,000 in a minute.
MOST_VALUES = 2_000_000

_BASE, _NAME, _ARRAY = 1, 2, 3  # and 4 for a sequence, as `rosbags` numbers them
_HEADER_BYTES = 4
_SIZES = {"int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "float32": 4,
          "int64": 8, "uint64": 8, "float64": 8, "float128": 16}  # fmt: skip
_LONGEST_ALIGNMENT = 8
_TEXT_BYTES = 5  # its length, and the byte that ends it

#: Field of an empty message in CDR.
_FILLER = (("structure_needs_at_least_one_member", (_BASE, ("uint8", 0))),)

_Kind = tuple[int, Any]
#: Name of a type -> its constants and fields.
_Types = Mapping[str, tuple[Any, Sequence[tuple[str, _Kind]]]]


class _Beyond(Exception):
    """There are more values than are asked for, or fewer bytes than the type needs."""


def readable_messages(
    topic_type: str, types: _Types, messages: Sequence[bytes], most: int = MOST_VALUES
) -> int:
    """Return the number of first messages that hold at most `most` values together."""
    fixed, per_byte = _bound(topic_type, types)
    size_bytes = sum(map(len, messages))
    # The sizes alone nearly always show that there are fewer.
    if fixed * len(messages) + per_byte * size_bytes <= most:
        return len(messages)
    count = 0
    for number, data in enumerate(messages):
        count += _Counter(types, data, most - count).values_of(topic_type)
        if count > most:
            return number
    return len(messages)


def _bound(topic_type: str, types: _Types) -> tuple[int, float]:
    """Return the least number of values in a message, and the largest number of further values per byte."""
    densest = 0.0

    @functools.cache
    def size_of(name: str) -> tuple[int, int]:
        """Return values and bytes of a message of a type if all its sequences are empty."""
        values = 1
        size = 1
        for _, kind in types[name][1] or _FILLER:
            more, bytes_ = size_of_kind(kind)
            values += more
            size += bytes_
        return values, max(1, size - 1)

    def size_of_kind(kind: _Kind) -> tuple[int, int]:
        nonlocal densest
        form, inner = kind
        if form == _NAME:
            return size_of(inner)
        if form == _BASE:
            is_text = inner[0] == "string"
            if is_text:
                return 1, _TEXT_BYTES
            return 1, _SIZES.get(inner[0], 1)
        element, length = inner
        if _is_number(element):
            return 1, 1
        values, size = size_of_kind(element)
        if form == _ARRAY:
            return 1 + length * values, length * size
        densest = max(densest, values / size)
        return 1, 1

    return size_of(topic_type)[0], densest


def _is_number(kind: _Kind) -> bool:
    return kind[0] == _BASE and kind[1][0] != "string"


class _Counter:
    """Walks through the CDR of one message, and counts its values up to a number."""

    def __init__(self, types: _Types, data: bytes, most: int) -> None:
        self._types = types
        self._data = data[_HEADER_BYTES:]
        self._order = "little" if data[1:2] == b"\1" else "big"
        self._most = most
        self._place = 0
        self._count = 0

    def values_of(self, topic_type: str) -> int:
        """Return the number of values in a message of a type, up to the mistake if the message is malformed."""
        with contextlib.suppress(_Beyond):
            self._message(topic_type)
        return self._count

    def _message(self, name: str) -> None:
        self._add()
        for _, kind in self._types[name][1] or _FILLER:
            self._value(kind)

    def _value(self, kind: _Kind) -> None:
        form, inner = kind
        if form == _NAME:
            self._message(inner)
        elif form == _BASE:
            self._add()
            self._skip(inner[0], 1)
        else:
            element, length = inner
            if form != _ARRAY:
                length = self._length()
            self._several(element, length)

    def _several(self, element: _Kind, length: int) -> None:
        self._add()
        if not _is_number(element):
            for _ in range(length):
                self._value(element)
        elif length:
            self._skip(element[1][0], length)

    def _add(self) -> None:
        self._count += 1
        if self._count > self._most:
            raise _Beyond
        if self._place > len(self._data):
            raise _Beyond

    def _length(self) -> int:
        start = (self._place + 3) & -4
        self._place = start + 4
        if self._place > len(self._data):
            raise _Beyond
        return int.from_bytes(self._data[start : self._place], self._order)  # type: ignore[arg-type]

    def _skip(self, name: str, length: int) -> None:
        if name == "string":
            length = self._length()
            self._place += length
            return
        size = _SIZES.get(name, 1)
        alignment = min(size, _LONGEST_ALIGNMENT)
        start = (self._place + alignment - 1) & -alignment
        self._place = start + size * length
