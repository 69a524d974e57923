"""Records of a recording: dataclasses as JSON files, read back with their types or refused."""

from __future__ import annotations

import dataclasses
import functools
import json
import types
import typing
from pathlib import Path
from typing import Any, TypeVar, cast

from grader.files import replace_file

T = TypeVar("T")


def write_record(file: Path, record: Any) -> None:
    """Write a record in one step, so that no half-written file can be mistaken for a whole one."""
    replace_file(file, json.dumps(dataclasses.asdict(record), ensure_ascii=True))


def read_record(file: Path, kind: type[T], schema: str) -> T:
    """Read a record, or raise `FileNotFoundError`, or `ValueError` if it is not one whose `schema` says this."""
    try:
        plain = json.loads(file.read_text(encoding="utf-8"))
    except RecursionError as problem:
        raise ValueError("it is nested too deeply") from problem
    found = plain.get("schema") if isinstance(plain, dict) else None
    if found != schema:
        raise ValueError(f"schema {schema} expected, found {found!r}")
    return from_plain(kind, plain)


def from_plain(kind: type[T], plain: Any) -> T:
    """Build a dataclass from what `json` read, or raise `ValueError` if that does not have its shape."""
    if not isinstance(plain, dict):
        raise ValueError(f"{kind.__name__}: an object was expected")
    hints = _hints(cast(Any, kind))
    unknown = sorted(set(plain) - set(hints))
    if unknown:
        raise ValueError(f"{kind.__name__}: unknown key {unknown[0]!r}")
    try:
        return kind(**{name: _convert(hints[name], value) for name, value in plain.items()})
    except TypeError as problem:
        raise ValueError(f"{kind.__name__}: {problem}") from problem


@functools.lru_cache(maxsize=64)
def _hints(kind: type[Any]) -> dict[str, Any]:
    """Return the types of a dataclass's fields; finding them takes longer than all else in reading a record."""
    hints = typing.get_type_hints(kind)
    return {f.name: hints[f.name] for f in dataclasses.fields(kind)}


def _convert(hint: Any, value: Any) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        inner = [a for a in arguments if a is not type(None)]
        return None if value is None else _convert(inner[0], value)
    if dataclasses.is_dataclass(hint):
        return from_plain(hint, value)  # type: ignore[arg-type]
    kind: Any = origin or hint
    if kind is Any:
        return value
    accepted: Any = {float: (int, float), tuple: list}.get(kind, kind)
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{kind.__name__} expected, found {type(value).__name__}")
    if kind is int and not -(2**63) <= value < 2**63:
        raise ValueError("a number is too large")
    if isinstance(value, list):
        return kind(_convert(arguments[0], item) for item in value)
    return {name: _convert(arguments[1], item) for name, item in value.items()} if isinstance(value, dict) else value
