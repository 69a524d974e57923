"""Notes of the tap, found among other output of a student's process."""

from __future__ import annotations

import json
from typing import Any

import pytest

from grader.live.student_tap.claims import claims_in
from ros_bag.qos import Qos

QOS = {"history": "keep_last", "depth": 3, "reliability": "reliable", "durability": "volatile"}
NOTE: dict[str, Any] = {
    "kind": "publisher",
    "name": "/a",
    "node": "/n",
    "file": "/ws/src/it.py",
    "line": 7,
    "qos": QOS,
}


def test_a_note_is_read_with_its_place_in_the_submission() -> None:
    """Paths are told as the submission has them, and the profile comes along."""
    (claim,) = claims_in(f'{{"kind": "started"}}\n{json.dumps(NOTE)}\n', "it", "/ws/src/")
    assert (claim.process, claim.kind, claim.name, claim.file, claim.line) == (
        "it",
        "publisher",
        "/a",
        "it.py",
        7,
    )
    assert claim.qos == Qos("reliable", "volatile", "keep_last", 3)


@pytest.mark.parametrize("value", [True, -1, 1.5, "text", None])
def test_a_parameters_default_is_kept(value: object) -> None:
    """The default of a declared parameter is kept as a plain value."""
    (claim,) = claims_in(json.dumps({**NOTE, "kind": "parameter", "value": value}), "it", "")
    assert claim.value == value


@pytest.mark.parametrize(
    "line",
    [
        "",
        "no JSON",
        "[" * 100_000,
        "9" * 5000,
        json.dumps([NOTE]),
        json.dumps({**NOTE, "kind": 1}),
        json.dumps({**NOTE, "name": None}),
        json.dumps({**NOTE, "name": "/\ud800"}),
        json.dumps({**NOTE, "line": -1}),
        json.dumps({**NOTE, "line": 1e300}),
        json.dumps({**NOTE, "line": 10**400}),
        json.dumps({**NOTE, "line": float("inf")}),
        json.dumps({**NOTE, "qos": 3}),
        json.dumps({**NOTE, "qos": {**QOS, "depth": "many"}}),
        json.dumps({**NOTE, "qos": {**QOS, "history": []}}),
        json.dumps({**NOTE, "value": [[1]]}),
        json.dumps({k: v for k, v in NOTE.items() if k != "file"}),
    ],
)
def test_what_is_none_of_the_taps_notes_is_passed_over(line: str) -> None:
    """Other types, numbers beyond all bounds and deep nesting break nothing, and the next note is read."""
    assert len(claims_in(f"{line}\n{json.dumps(NOTE)}", "it", "")) == 1


def test_long_texts_are_cut() -> None:
    """A text that never ends is kept in part."""
    (claim,) = claims_in(json.dumps({**NOTE, "name": "/" + "x" * 10_000}), "it", "")
    assert 100 < len(claim.name) < 1000


def test_notes_without_end_are_cut_off() -> None:
    """Only some of a hundred thousand notes are kept."""
    assert len(claims_in(f"{json.dumps(NOTE)}\n" * 100_000, "it", "")) <= 2000
