"""Records of a recording: dataclasses as JSON files, read back with their types or refused."""

from __future__ import annotations

import dataclasses
import functools
import json
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

from grader.files import replace_file

T = TypeVar("T")
_Reader = Callable[[Any], Any]
#: Types of the output of `json` for types that it does not have.
_ACCEPTED: Any = {float: (int, float), tuple: list}


def write_record(file: Path, record: Any) -> None:
    """Write a record in one step: a reader never sees a half-written file."""
    # Its fields one after another, without a copy of all values as `dataclasses.asdict` makes one.
    text = json.dumps(record, ensure_ascii=True, default=vars)
    replace_file(file, text)


def read_record(file: Path, kind: type[T], schema: str) -> T:
    """Read a record with a schema; raise `FileNotFoundError`, or `ValueError` if it is not such a record."""
    try:
        plain = json.loads(file.read_text(encoding="utf-8"))
    except RecursionError as problem:
        raise ValueError("it is nested too deeply") from problem
    found = None
    if isinstance(plain, dict):
        found = plain.get("schema")
    if found != schema:
        raise ValueError(f"schema {schema} expected, found {found!r}")
    return from_plain(kind, plain)


def from_plain(kind: type[T], plain: Any) -> T:
    """Build a dataclass from the output of `json`, or raise `ValueError` if that has another shape."""
    if not isinstance(plain, dict):
        raise ValueError(f"{kind.__name__}: an object was expected")
    readers = _readers(cast(Any, kind))
    unknown = plain.keys() - readers.keys()
    if unknown:
        raise ValueError(f"{kind.__name__}: unknown key {min(unknown)!r}")
    try:
        values = {}
        for name, value in plain.items():
            read = readers[name]
            values[name] = read(value)
        return kind(**values)
    except TypeError as problem:
        raise ValueError(f"{kind.__name__}: {problem}") from problem


def prepare(kinds: Iterable[type[Any]]) -> None:
    """Find the readers of some dataclasses, and of those within them, so that forks of this process have them."""
    waiting = list(kinds)
    known: set[type[Any]] = set()
    while waiting:
        kind = waiting.pop()
        if kind in known:
            continue
        known.add(kind)
        _readers(cast(Any, kind))
        hints = typing.get_type_hints(kind)
        for hint in hints.values():
            waiting += _dataclasses_in(hint)


def _dataclasses_in(hint: Any) -> Iterator[type[Any]]:
    """Yield the dataclasses in a type such as `dict[str, list[Kind] | None]`."""
    if dataclasses.is_dataclass(hint):
        kind: Any = hint
        yield kind
    for argument in typing.get_args(hint):
        yield from _dataclasses_in(argument)


@functools.lru_cache(maxsize=128)
def _readers(kind: type[Any]) -> dict[str, _Reader]:
    """Return a reader for each field of a dataclass. Finding them takes longer than reading a record."""
    hints = typing.get_type_hints(kind)
    return {f.name: _reader(hints[f.name]) for f in dataclasses.fields(kind)}


def _reader(hint: Any) -> _Reader:
    """Return a function that turns output of `json` into a value of a type, or raises `ValueError`."""
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):
        return _optional_reader(hint)
    if dataclasses.is_dataclass(hint):
        return functools.partial(from_plain, cast(Any, hint))
    kind: Any = origin or hint
    if kind is Any:
        return lambda value: value
    accepted = _ACCEPTED.get(kind, kind)
    checked = functools.partial(_checked, kind, accepted)
    if kind is dict:
        of_item = _reader(typing.get_args(hint)[1])
        return lambda value: {name: of_item(item) for name, item in checked(value).items()}
    if accepted is list:
        of_item = _reader(typing.get_args(hint)[0])
        return lambda value: kind(map(of_item, checked(value)))
    return checked


def _optional_reader(hint: Any) -> _Reader:
    """Return the reader of a type such as `int | None`."""
    types_ = [each for each in typing.get_args(hint) if each is not type(None)]
    inner = _reader(types_[0])
    return lambda value: None if value is None else inner(value)


def _checked(kind: Any, accepted: Any, value: Any) -> Any:
    """Return a value of an accepted type, or raise `ValueError`; True and False are not numbers."""
    # Most values: numbers can be too large, and lists are of another type than their field.
    if value.__class__ is kind is not int:
        return value
    if value.__class__ is bool:
        accepted = bool if kind is bool else ()
    if not isinstance(value, accepted):
        raise ValueError(f"{kind.__name__} expected, found {type(value).__name__}")
    if kind is int and not -(2**63) <= value < 2**63:
        raise ValueError("a number is too large")
    return value
