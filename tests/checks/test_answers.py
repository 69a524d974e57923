"""Answers of services by their fields, against constants and oracles; right, wrong and at the edge."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from grader.checks.answers import CallValue
from grader.checks.base import failed
from grader.result import Outcome
from tests.synthetic import Session, at, judged

EACH = [
    {"step": "near", "values": {"pose.position.x": 1.5, "names[0]": "base"}},
    {"step": "far", "values": {"pose.position.x": 40.0}, "patterns": {"message": "(?i)far"}},
]
VALUE: dict[str, Any] = {"artifact": "it", "each": EACH, "tolerance": 0.01}


def answer(
    x: float, message: str = "far away", names: tuple[str, ...] = ("base",)
) -> dict[str, Any]:
    """Give a response with nested fields, as a step keeps it."""
    return {"pose": {"position": {"x": x, "y": 0.0}}, "names": list(names), "message": message}


def calls(folder: Path, **answers: Mapping[str, Any] | None) -> Session:
    """Record calls, each with a request of its own."""
    session = Session(folder).process("it")
    for n, (label, response) in enumerate(answers.items()):
        call = {"started_ns": at(1.0), "ended_ns": at(1.1), "response": response}
        request = {"distance": float(n + 1)}
        parameters = {"service": "/locate", "request": request}
        outcome = "done" if response is not None else "timeout"
        session.step("call", label, outcome, calls=[call], request=request, parameters=parameters)
    return session


@pytest.mark.parametrize(
    ("near", "far", "credit", "words"),
    [
        (answer(1.5), answer(40.0), "1", ""),
        (answer(1.509), answer(39.991, "FAR"), "1", ""),
        (
            answer(1.511),
            answer(40.0),
            "0.75",
            "In the answer to 'near', pose.position.x is 1.511, not 1.5.",
        ),
        (answer(1.5, names=()), answer(40.0), "0.75", "names[0] is None, not 'base'"),
        (
            answer(1.5),
            answer(4.0, "close"),
            "0.5",
            "pose.position.x is 4.0, not 40.0 and message is 'close'.",
        ),
        (
            answer(0.0, "no", ()),
            answer(0.0, "no", ()),
            "0",
            "All 2 calls get the same answer, whatever they ask for.",
        ),
        (answer(1.5), None, "0.5", "far: No answer came within 0.1 s."),
        (None, answer(40.0), "0.5", "near: No answer came within 0.1 s."),
        ({"other": "type"}, answer(40.0), "0.5", "pose.position.x is None"),
    ],
)
def test_each_answer_is_judged_by_its_fields(
    tmp_path: Path, near: dict[str, Any] | None, far: dict[str, Any] | None, credit: str, words: str
) -> None:
    """Each call is a part, and each field a part of that."""
    finding = judged("call_value", VALUE, calls(tmp_path, near=near, far=far))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_a_field_that_is_not_there_is_like_no_pattern(tmp_path: Path) -> None:
    """A missing field is not a text that a pattern could match."""
    each = [{"step": "near", "patterns": {"note": "N"}}]
    finding = judged("call_value", {**VALUE, "each": each}, calls(tmp_path, near=answer(1.5)))
    assert finding.outcome is Outcome.FAILED
    assert "note is None" in finding.reason


def test_something_is_asked_of_each_answer() -> None:
    """Each answer has values or patterns; without them every answer would be wrong."""
    with pytest.raises(ValidationError, match="each needs values or patterns"):
        CallValue.model_validate({**VALUE, "each": [*EACH, {"step": "other"}]})


def test_silence_costs_once(tmp_path: Path) -> None:
    """A service that answers nothing fails the first check that asks it, and not the next."""
    recorded = calls(tmp_path, near=None, far=None).recorded()
    finding = judged("call_value", VALUE, recorded)
    assert (finding.outcome, finding.measured) == (Outcome.FAILED, "no answer")
    assert (
        judged("call_value", {**VALUE, "each": EACH[1:]}, recorded).outcome is Outcome.NOT_REACHED
    )


def test_a_request_that_cannot_be_sent_earns_nothing(tmp_path: Path) -> None:
    """The student's type lacks the field, so that two requests are the same."""
    session = calls(tmp_path, near=answer(1.5), far=answer(40.0))
    for step in session.record.steps:
        step.result["request"] = {}
    finding = judged("call_value", VALUE, session)
    assert finding.credit == Decimal("0.5")
    assert "The request of 'far' cannot be sent: it is that of 'near'." in finding.reason


def test_a_mistake_that_another_check_charged_costs_nothing(tmp_path: Path) -> None:
    """An alternative may name another check that charged the mistake, as with any oracle."""
    known = {**ORACLE["alternatives"][0], "charged_by": ["earlier"]}
    session = calls(tmp_path, near=answer(3.0, names=()), far=answer(6.0, names=()))
    earlier = {"earlier": failed("", "", "It was charged.")}
    finding = judged("call_value", {**ORACLE, "alternatives": [known]}, session, findings=earlier)
    assert (finding.outcome, finding.credit) == (Outcome.EXCUSED, Decimal(1))
    assert finding.reason.endswith("This mistake is charged under 'earlier', and not again here.")


def doubled(request: Mapping[str, Any], parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Compute the answer to a request; an oracle as a lab has it."""
    return {
        "pose.position.x": np.float64(request["distance"]) * parameters["factor"],
        "names": np.array([]),
    }


ORACLE: dict[str, Any] = {
    "artifact": "it",
    "each": [{"step": "near"}, {"step": "far"}],
    "oracle": "tests/checks/test_answers.py:doubled",
    "parameters": {"factor": 2.0},
    "alternatives": [
        {"parameters": {"factor": 3.0}, "meaning": "three times the distance", "credit": 0.75}
    ],
}


@pytest.mark.parametrize(("factor", "credit"), [(2.0, "1"), (3.0, "0.75"), (4.0, "0.5")])
def test_an_oracle_computes_the_answer_from_the_request(
    tmp_path: Path, factor: float, credit: str
) -> None:
    """An oracle computes the right answer, and by other parameters the answer of a mistake."""
    session = calls(tmp_path, near=answer(factor, names=()), far=answer(2 * factor, names=()))
    finding = judged("call_value", ORACLE, session)
    assert finding.credit == Decimal(credit)
    assert ("It matches three times the distance." in finding.reason) == (factor == 3.0)
