"""`result.json`: the contract that others script against."""

from __future__ import annotations

import dataclasses
import json
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import grader.report
from grader.result import (
    CheckResult,
    CriterionResult,
    Finding,
    Location,
    Outcome,
    Result,
    Score,
    Violation,
    ViolationKind,
    number,
    read_result,
    result_schema,
    to_json,
    to_plain,
)

FINDING = Finding(
    Outcome.PARTIAL,
    Decimal("0.5"),
    "100 Hz",
    "90 Hz \x1b[31m ü \u2028",
    "too slow",
    "use a timer",
    (
        Location(file="a.py", line=3),
        Location(session="s", topic="/a", start_s=1.23456789, end_s=2.0),
    ),
    ("a note",),
)


def result(finding: Finding = FINDING) -> Result:
    """Give a result with one check."""
    check = CheckResult.of(
        finding,
        id="a.rate",
        title="Rate",
        session="s",
        earned=Decimal("2.5"),
        possible=Decimal(5),
        undecided=Decimal(0),
    )
    criterion = CriterionResult("a", "A", Decimal("2.5"), Decimal(5), Decimal(0), (check,))
    score = Score(Decimal("2.5"), Decimal("5.0"), Decimal(0))
    return Result(
        "ann", "Lab 1: One", score, (criterion,), ("advice",), ("problem",), {"grader": "0"}
    )


def test_the_contract() -> None:
    """Each key is where scripts look for it."""
    plain = json.loads(to_json(result()))
    assert plain["schema"] == "ros-lab-grader/result/v1"
    assert plain["score"] == {"earned": 2.5, "possible": 5, "undecided": 0, "final": 2.5}
    assert plain["adjustments"] == []
    assert set(plain) == {
        "schema",
        "submission",
        "lab",
        "score",
        "criteria",
        "adjustments",
        "bonus",
        "violations",
        "advisories",
        "problems",
        "provenance",
        "chosen",
    }
    assert set(plain["criteria"][0]) == {
        "id",
        "title",
        "earned",
        "possible",
        "undecided",
        "checks",
        "description",
    }
    check = plain["criteria"][0]["checks"][0]
    assert set(check) == {
        "id",
        "title",
        "outcome",
        "earned",
        "possible",
        "undecided",
        "expected",
        "measured",
        "reason",
        "hint",
        "where",
        "notes",
        "counted",
        "session",
        "credit",
        "charged_by",
        "commands",
    }
    assert check["outcome"] == "partial"
    assert check["where"] == [
        {"file": "a.py", "line": 3},
        {"session": "s", "topic": "/a", "start_s": 1.235, "end_s": 2.0},
    ]


def test_a_violation_is_reported_with_its_evidence() -> None:
    """A violation has its kind, session, evidence, and the checks that fail because of it."""
    violation = Violation(
        ViolationKind.SPOOFS_CLOCK,
        "s",
        "A second clock.",
        ("9 messages",),
        Location(session="s"),
        True,
        ("a.rate",),
    )
    plain = json.loads(to_json(dataclasses.replace(result(), violations=(violation,))))
    assert plain["violations"] == [
        {
            "kind": "spoofs_clock",
            "session": "s",
            "text": "A second clock.",
            "evidence": ["9 messages"],
            "where": {"session": "s"},
            "certain": True,
            "checks": ["a.rate"],
        }
    ]


def test_the_schema_that_is_shipped_is_the_current_one() -> None:
    """The shipped schema matches the classes; `tools/write-schemas` writes it."""
    shipped = json.loads(
        (Path(grader.report.__file__).parent / "result.schema.json").read_text(encoding="utf-8")
    )
    assert shipped == result_schema(), "run .venv/bin/python tools/write-schemas"


def test_the_schema_knows_every_kind_of_violation() -> None:
    """Scripts that go by the schema meet no kind that it does not name."""
    assert result_schema()["$defs"]["ViolationKind"]["enum"] == [
        kind.value for kind in ViolationKind
    ]


def test_a_result_without_the_rule_that_decided_can_be_read() -> None:
    """Results of earlier versions do not name it."""
    named = result(dataclasses.replace(FINDING, decided_by="flaky"))
    plain = to_plain(named)
    check = plain["criteria"][0]["checks"][0]
    assert check["decided_by"] == "flaky"
    assert to_plain(read_result(plain)) == plain
    del check["decided_by"]
    assert read_result(plain).checks[0].decided_by is None


def test_text_of_students_comes_back_as_it_was() -> None:
    """Control characters are escaped in the file, and are themselves again when it is read."""
    text = to_json(result())
    assert text.isascii()
    assert "\x1b" not in text
    assert json.loads(text) == to_plain(result())


@given(st.text(max_size=50))
def test_any_text_is_valid_json(text: str) -> None:
    """Whatever a student wrote, the file can be read."""
    plain = json.loads(to_json(result(Finding(Outcome.FAILED, Decimal(0), text, text, text, text))))
    assert plain["criteria"][0]["checks"][0]["reason"] == text


@pytest.mark.parametrize(
    ("value", "shown"), [("5", "5"), ("5.0", "5"), ("2.5", "2.5"), ("0", "0"), ("1E+1", "10")]
)
def test_whole_points_are_whole_numbers(value: str, shown: str) -> None:
    """Points have no needless digits."""
    assert json.dumps(number(Decimal(value))) == shown


def test_equal_results_give_equal_bytes() -> None:
    """The order of keys is fixed, and the text ends with a line end."""
    assert to_json(result()) == to_json(result())
    assert to_json(result()).endswith("}\n")
