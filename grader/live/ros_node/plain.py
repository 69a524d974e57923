"""Messages as JSON has them, cut to a bounded size, because a student's message may have any size."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Any

#: Longest text, and most elements of an array.
LONGEST_TEXT, MOST_ELEMENTS = 10_000, 1000
#: Characters and values that are passed on of a whole message.
MOST_IN_MESSAGE = 100_000


class Room:
    """The number of characters and values that may still be passed on."""

    def __init__(self, left: int = MOST_IN_MESSAGE) -> None:
        self.left = left


def plain(value: Any, room: Room | None = None) -> Any:
    """Return a message, or a part of one, as JSON has it; None for values that do not fit in the room."""
    room = room or Room()
    if room.left <= 0:
        return None
    room.left -= 1
    if value is None or isinstance(value, (bool, int, float)):
        return value
    if isinstance(value, Mapping):
        return {str(name): plain(inner, room) for name, inner in value.items()}
    if hasattr(value, "get_fields_and_field_types"):
        return {
            name: plain(getattr(value, name), room) for name in value.get_fields_and_field_types()
        }
    if not isinstance(value, str) and hasattr(value, "__iter__"):
        return _elements(value, room)
    text = str(value)[: min(LONGEST_TEXT, room.left)]
    room.left -= len(text)
    return text


def _elements(value: Any, room: Room) -> list[Any]:
    # Elements of an array have types of their own, unknown to JSON.
    some = (
        value[:MOST_ELEMENTS].tolist() if hasattr(value, "tolist") else islice(value, MOST_ELEMENTS)
    )
    return [plain(element, room) for element in some if room.left > 0]
