"""Parameters as a node reads them: `rcl` has its own rules for numbers and truth values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

_TRUE = frozenset(["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_INTEGER = re.compile(r"\s*[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")
_OCTAL = re.compile(r"\s*[+-]?0[0-7]+")
_NUMBER = re.compile(
    r"\s*[+-]?((\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|inf|infinity|nan)", re.IGNORECASE
)
_HEXADECIMAL = re.compile(
    r"\s*[+-]?0[xX]([0-9a-fA-F]+(\.[0-9a-fA-F]*)?|\.[0-9a-fA-F]+)([pP][+-]?\d+)?"
)
_DOTTED = re.compile(r"[+-]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_LARGEST = 2**63
#: Longest text of an integer. Python refuses more than 4300 digits, and the largest integer of `rcl` has 19.
_LONGEST_INTEGER = 1000


def read(text: str) -> Any:
    """Return the first document of a YAML text, e.g. `{"rate": 50}` for `rate: 50`.

    Raises
    ------
    yaml.YAMLError
        If the text is not YAML, is nested too deeply, or has an alias, because a node refuses aliases.
    """
    import yaml

    events = iter(yaml.parse(text, Loader=yaml.SafeLoader))
    for event in events:
        if isinstance(event, yaml.NodeEvent):
            try:
                return _value(event, events)
            except RecursionError as problem:
                raise yaml.YAMLError("it is nested too deeply") from problem
    return None


def _value(event: Any, events: Iterator[Any]) -> Any:
    """Return the value that begins with an event; the rest of its events are consumed."""
    import yaml

    if isinstance(event, yaml.AliasEvent):
        line = getattr(event.start_mark, "line", 0) + 1
        raise yaml.YAMLError(f"line {line}: a node cannot read aliases")
    if isinstance(event, yaml.ScalarEvent):
        is_text = event.style in ("'", '"') or str(event.tag).endswith(":str")
        return event.value if is_text else scalar(event.value)
    if isinstance(event, yaml.SequenceStartEvent):
        return _items(events)
    return _mapping(events)


def _items(events: Iterator[Any]) -> list[Any]:
    import yaml

    items: list[Any] = []
    for event in events:
        if isinstance(event, yaml.SequenceEndEvent):
            break
        items.append(_value(event, events))
    return items


def _mapping(events: Iterator[Any]) -> dict[str, Any]:
    import yaml

    content: dict[str, Any] = {}
    for event in events:
        if isinstance(event, yaml.MappingEndEvent):
            break
        is_text = isinstance(event, yaml.ScalarEvent)
        key = event.value if is_text else str(_value(event, events))
        content[key] = _value(next(events), events)
    return content


def scalar(text: str) -> bool | int | float | str:
    """Return the value of a text without quotes, e.g. 8 for `010`, as `rcl_yaml_param_parser` reads it with C's `strtol`."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    whole = _integer(text)
    if whole is not None:
        return whole
    if _DOTTED.fullmatch(text):
        return float(text.replace(".", ""))
    if _HEXADECIMAL.fullmatch(text):
        return float.fromhex(text)
    if not _NUMBER.fullmatch(text):
        return text
    number = float(text)
    is_word = text.strip("+- ")[0] in "iInN"
    # A number too large for a double stays text.
    return number if math.isfinite(number) or is_word else text


def _integer(text: str) -> int | None:
    """Return the value of a decimal, octal or hexadecimal integer of 64 bits, e.g. 31 for `0x1F`."""
    if len(text) > _LONGEST_INTEGER or not _INTEGER.fullmatch(text):
        return None
    value = int(text, 8) if _OCTAL.fullmatch(text) else int(text, 0)
    return value if -_LARGEST <= value < _LARGEST else None
