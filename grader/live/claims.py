"""What the tap in a student's process notes, taken with care: any code in that process can write to its pipe."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from grader.recording.session import Claim, Qos

_MOST_CLAIMS = 2000
_LONGEST_TEXT, _LARGEST_NUMBER, _LARGEST_INTEGER = 500, 10**7, 2**63


def claims_in(text: str, process: str, above: str) -> list[Claim]:
    """Read the lines that the tap wrote; what is none of its notes is passed over.

    Parameters
    ----------
    process : str
        Name of the process that wrote them.
    above : str
        What the paths of the submission's files begin with there.
    """
    found = []
    for line in text.split("\n")[:_MOST_CLAIMS]:
        with suppress(ValueError, TypeError, KeyError, RecursionError):
            found.append(_claim(json.loads(line), process, above))
    return found


def _claim(note: Mapping[str, Any], process: str, above: str) -> Claim:
    kind, name, node, file = (_text(note[key]) for key in ("kind", "name", "node", "file"))
    value, qos = note.get("value"), note.get("qos")
    return Claim(
        process,
        kind,
        name,
        node,
        _text(note.get("type", "")),
        file.removeprefix(above),
        _number(note["line"]),
        Qos(**dict(_policies(qos))) if qos is not None else None,
        _plain(value),
    )


def _policies(told: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key in ("reliability", "durability", "history"):
        if key in told:
            yield key, _text(told[key])
    if "depth" in told:
        yield "depth", _number(told["depth"])


def _plain(value: Any) -> bool | int | float | str | None:
    if value is None or isinstance(value, (bool, float)):
        return value
    return value if isinstance(value, int) and abs(value) < _LARGEST_INTEGER else _text(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a text is expected")
    return value[:_LONGEST_TEXT].encode("utf-8", "replace").decode("utf-8")


def _number(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value <= _LARGEST_NUMBER:
        raise ValueError("a number is expected that is not too large")
    return value
