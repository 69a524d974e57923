"""Values of requests, parameters and results in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Characters that are shown of a value.
_LONGEST = 500
#: Elements that are shown of a list.
_MOST_ELEMENTS = 20


def literal(value: Any) -> str:
    """Write a value as YAML would, cut if it is long, e.g. "[1.5, 'fast', true]"."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"'{value[:_LONGEST]}'"
    if isinstance(value, (list, tuple)):
        text = ", ".join(literal(each) for each in value[:_MOST_ELEMENTS])
        end = ", …]" if len(value) > _MOST_ELEMENTS else "]"
        return f"[{text}{end}"
    return str(value)[:_LONGEST]


def fields(values: Any) -> str:
    """Write a message's fields in a line, e.g. "success: true, message: 'on'"."""
    if not isinstance(values, Mapping):
        return literal(values)
    written = [f"{name}: {literal(value)}" for name, value in values.items()]
    return ", ".join(written)
