"""Messages as JSON has them: whatever they hold, within bounds."""

from __future__ import annotations

import array
import json
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.live.ros_node.plain import LONGEST_TEXT, MOST_ELEMENTS, Room, plain


class Message:
    """Stands for a message of rclpy, with the method that names its fields."""

    def __init__(self, **fields: object) -> None:
        self.__dict__ |= fields

    def get_fields_and_field_types(self) -> dict[str, str]:
        """Return the names of its fields."""
        return dict.fromkeys(self.__dict__, "")


def test_messages_within_messages_are_mappings() -> None:
    """Arrays are lists of plain numbers, and texts stay as they are."""
    inner = Message(
        x=1.5, raw=array.array("i", [1, 2]), fixed=np.array([1.5, 2.5], np.float32), text="a"
    )
    assert plain(Message(one=inner, several=[inner, True])) == {
        "one": {"x": 1.5, "raw": [1, 2], "fixed": [1.5, 2.5], "text": "a"},
        "several": [{"x": 1.5, "raw": [1, 2], "fixed": [1.5, 2.5], "text": "a"}, True],
    }


def endless() -> Iterator[int]:
    """Give numbers without end."""
    while True:
        yield 1


@pytest.mark.parametrize(
    "value",
    [
        array.array("i", bytes(4 * 10**7)),
        np.zeros(10**7),
        "x" * 10**8,
        b"x" * 10**8,
        endless(),
        [["x" * 10**5] * 10**3] * 10**3,
        Message(a=Message(b=[Message(c="y" * 10**6)] * 10**6)),
    ],
)
def test_what_is_too_large_is_cut(value: object) -> None:
    """Texts, arrays and whole messages are cut to a useful size."""
    assert len(json.dumps(plain(value))) < 500_000
    assert len(plain("x" * 10**8)) == LONGEST_TEXT
    assert len(plain([0] * 10**6)) == MOST_ELEMENTS


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(VALUES, st.integers(-1, 50))
def test_anything_is_json_and_as_large_as_there_is_room(value: object, left: int) -> None:
    """Each value and character takes some of the room, and where there is none left, nothing follows."""
    room = Room(left)
    json.dumps(plain(value, room))
    assert room.left >= min(left, 0) - 1
