"""Records that were changed on disk are refused, or are of their types."""

from __future__ import annotations

import copy
import json
import typing
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.recording.record import read_record
from grader.recording.session import SESSION_SCHEMA, SessionRecord, read_session, write_session
from grader.recording.submission import SUBMISSION_SCHEMA, SubmissionRecord
from tests.thorough import examples

RECORDINGS = Path(__file__).parents[1] / "recordings/solution"
VALUES: list[Any] = [
    None,
    True,
    0,
    10**400,
    1e308,
    "",
    "a",
    [],
    {},
    [[]],
    [None],
    {"a": {}},
    float("nan"),
]
KINDS: dict[str, tuple[type[Any], str]] = {
    "submission.json": (SubmissionRecord, SUBMISSION_SCHEMA),
    "publisher/session.json": (SessionRecord, SESSION_SCHEMA),
    "launch/session.json": (SessionRecord, SESSION_SCHEMA),
}


def _shortened(value: Any) -> Any:
    """Return data with the first two elements of each list."""
    if isinstance(value, dict):
        return {key: _shortened(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_shortened(part) for part in value[:2]]
    return value


PLAIN = {
    name: _shortened(json.loads((RECORDINGS / name).read_text(encoding="utf-8"))) for name in KINDS
}


def _places(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    parts: Iterable[tuple[Any, Any]]
    if isinstance(value, dict):
        parts = value.items()
    elif isinstance(value, list):
        parts = enumerate(value)
    else:
        parts = ()
    for key, part in parts:
        yield (*above, key)
        yield from _places(part, (*above, key))


PLACES = {name: list(_places(plain)) for name, plain in PLAIN.items()}


def _are_typed(value: Any) -> bool:
    """Tell whether the texts, numbers and lists in a record have the types of its fields."""
    for hint, part in (
        (typing.get_type_hints(type(value))[f.name], getattr(value, f.name)) for f in fields(value)
    ):
        kind = typing.get_origin(hint) or hint
        if kind in (str, bool, list, dict) and not isinstance(part, kind):
            return False
        inner = part if isinstance(part, list) else [part]
        if not all(_are_typed(item) for item in inner if is_dataclass(item)):
            return False
    return True


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=examples(100))
@given(data=st.data())
def test_a_record_with_other_values_is_refused_or_sound(
    name: str, data: st.DataObject, tmp_path_factory: Any
) -> None:
    """Any value in a record gives a ValueError, or a record with the type of each field."""
    plain = copy.deepcopy(PLAIN[name])
    place = data.draw(st.sampled_from(PLACES[name]))
    part = plain
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = data.draw(st.sampled_from(VALUES))
    file = tmp_path_factory.getbasetemp() / "record.json"
    file.write_text(json.dumps(plain), encoding="utf-8")
    try:
        record = read_record(file, *KINDS[name])
    except ValueError:
        return
    assert _are_typed(record)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"schema": ' * 50_000, "\0", '"\\ud800"', "1" * 5000]
)
def test_what_is_no_record_is_refused(text: str, tmp_path: Path) -> None:
    """Text that is no record, however deep or long, raises the one error that is documented."""
    (tmp_path / "session.json").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r".+"):
        read_session(tmp_path)


def test_a_record_is_written_with_all_its_fields(tmp_path: Path) -> None:
    """The file equals the output of `dataclasses.asdict`, and is read back as the same record."""
    record = read_session(RECORDINGS / "publisher")
    write_session(tmp_path, record)
    assert json.loads((tmp_path / "session.json").read_text()) == json.loads(
        json.dumps(asdict(record))
    )
    assert asdict(read_session(tmp_path)) == asdict(record)
