"""Records of a recording: dataclasses as JSON files, read back with their types or refused."""

from __future__ import annotations

import dataclasses
import functools
import json
import types
import typing
from collections.abc import Callable
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
    readers = _readers(cast(Any, kind))
    if not plain.keys() <= readers.keys():
        raise ValueError(f"{kind.__name__}: unknown key {min(plain.keys() - readers.keys())!r}")
    try:
        return kind(**{name: readers[name](value) for name, value in plain.items()})
    except TypeError as problem:
        raise ValueError(f"{kind.__name__}: {problem}") from problem


@functools.lru_cache(maxsize=64)
def _readers(kind: type[Any]) -> dict[str, Callable[[Any], Any]]:
    """Return what reads each field of a dataclass; finding that takes longer than all else in reading a record."""
    hints = typing.get_type_hints(kind)
    return {f.name: _reader(hints[f.name]) for f in dataclasses.fields(kind)}


def _reader(hint: Any) -> Callable[[Any], Any]:
    """Return what turns a value that `json` read into one of a type, or raises `ValueError`."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        inner = _reader(next(a for a in arguments if a is not type(None)))
        return lambda value: None if value is None else inner(value)
    if dataclasses.is_dataclass(hint):
        return functools.partial(from_plain, cast(Any, hint))
    kind: Any = origin or hint
    if kind is Any:
        return lambda value: value
    accepted: Any = {float: (int, float), tuple: list}.get(kind, kind)

    def checked(value: Any) -> Any:
        if not isinstance(value, accepted) or (value.__class__ is bool and kind is not bool):
            raise ValueError(f"{kind.__name__} expected, found {type(value).__name__}")
        if kind is int and not -(2**63) <= value < 2**63:
            raise ValueError("a number is too large")
        return value

    if kind is dict:
        of_item = _reader(arguments[1])
        return lambda value: {name: of_item(item) for name, item in checked(value).items()}
    if accepted is list:
        of_item = _reader(arguments[0])
        return lambda value: kind(map(of_item, checked(value)))
    return checked
