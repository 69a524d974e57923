"""Parameters as a node reads them: `rcl` has rules of its own, by which some texts are numbers or truth values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

_TRUE = frozenset(["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_INTEGER = re.compile(r"\s*[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")
_NUMBER = re.compile(
    r"\s*[+-]?((\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|inf|infinity|nan)", re.IGNORECASE
)
_HEXADECIMAL = re.compile(
    r"\s*[+-]?0[xX]([0-9a-fA-F]+(\.[0-9a-fA-F]*)?|\.[0-9a-fA-F]+)([pP][+-]?\d+)?"
)
_DOTTED = re.compile(r"[+-]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_LARGEST = 2**63
#: Python refuses to read numbers of more than 4300 digits; those above the largest have 20.
_LONGEST_INTEGER = 1000


def read(text: str) -> Any:
    """The first document of a YAML text.

    Raises yaml.YAMLError if it is no YAML, has an alias, which no node can read, or is nested too deeply.
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
    import yaml

    if isinstance(event, yaml.AliasEvent):
        raise yaml.YAMLError(
            f"line {getattr(event.start_mark, 'line', 0) + 1}: a node cannot read aliases"
        )
    if isinstance(event, yaml.ScalarEvent):
        return (
            event.value
            if event.style in ("'", '"') or str(event.tag).endswith(":str")
            else scalar(event.value)
        )
    if isinstance(event, yaml.SequenceStartEvent):
        items: list[Any] = []
        while not isinstance(following := next(events), yaml.SequenceEndEvent):
            items.append(_value(following, events))
        return items
    content: dict[str, Any] = {}
    while not isinstance(following := next(events), yaml.MappingEndEvent):
        key = (
            following.value
            if isinstance(following, yaml.ScalarEvent)
            else str(_value(following, events))
        )
        content[key] = _value(next(events), events)
    return content


def scalar(text: str) -> bool | int | float | str:
    """What a text without quotes is: as `get_value` in `rcl_yaml_param_parser` asks C's `strtol` and `strtod`."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    whole = _INTEGER.fullmatch(text)
    if whole is not None and len(text) <= _LONGEST_INTEGER:
        value = int(text, 8 if re.fullmatch(r"\s*[+-]?0[0-7]+", text) else 0)
        if -_LARGEST <= value < _LARGEST:
            return value
    if _DOTTED.fullmatch(text):
        return float(text.replace(".", ""))
    if _HEXADECIMAL.fullmatch(text):
        return float.fromhex(text)
    if _NUMBER.fullmatch(text):
        number = float(text)
        if math.isfinite(number) or text.strip("+- ")[0] in "iInN":
            return number
    return text
