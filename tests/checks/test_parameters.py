"""Parameters that are set while a node runs: effects and refusals; right, wrong and at the edge."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from grader.checks.parameters import ParameterEffect
from grader.result import Outcome
from tests.synthetic import Session, at, evenly, judged

STEPS = {"set_step": "set", "before": "before", "after": "after"}
RATE: dict[str, Any] = {"process": "it", **STEPS, "topic": "/chatter", "old": 10.0, "new": 20.0}
FIELD: dict[str, Any] = {**RATE, "field": "data", "old": 1.0, "new": 2.5, "tolerance": 0.1}
RESTARTED = {"restarted": "restarted"}


def windows(folder: Path, **refused: str) -> Session:
    """Give a session with a window before a parameter was set, one after, and one of a node that began with it."""
    session = Session(folder).process("it").window(1.0, 4.0, "before")
    session.step(
        "set_parameters", "set", "failed" if refused else "done", node="/talker", refused=refused
    )
    return session.window(5.0, 8.0, "after").window(9.0, 12.0, "restarted")


def rates(
    session: Session, before_hz: float, after_hz: float, restarted_hz: float = 20.0
) -> Session:
    """Record a topic at three rates."""
    spans = {1.0: before_hz, 5.0: after_hz, 9.0: restarted_hz}
    times = []
    for start_s, hz in spans.items():
        if hz:
            for t in evenly(hz, 3.0, start_s):
                times.append(t)
    return session.messages("/chatter", [[1.0]] * len(times), times)


@pytest.mark.parametrize(
    ("after_hz", "more", "credit", "words"),
    [
        (20.0, {}, "1", ""),
        (19.1, {}, "1", ""),
        (16.7, {}, "0.4", "Messages come at 16.7 Hz"),
        (10.0, {}, "0", "The parameter was accepted, but the rate of /chatter in Hz stays at 10."),
        (10.0, RESTARTED, "0.5", "The timer keeps its old period until the node is restarted."),
        (30.0, {}, "0", "The old timer runs on beside the new one"),
        (50.0, {}, "0", "Messages come at 50.0 Hz"),
    ],
)
def test_a_rate_follows_its_parameter(
    tmp_path: Path, after_hz: float, more: dict[str, Any], credit: str, words: str
) -> None:
    """Within a twentieth; a timer that was not made anew, or that was made besides, has its name."""
    finding = judged("parameter_effect", {**RATE, **more}, rates(windows(tmp_path), 10.0, after_hz))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_what_ignores_a_parameter_after_a_restart_too_is_named(tmp_path: Path) -> None:
    """A parameter without an effect even after a restart was only declared."""
    finding = judged(
        "parameter_effect", {**RATE, **RESTARTED}, rates(windows(tmp_path), 10.0, 10.0, 10.0)
    )
    assert "it is declared but ignored" in finding.reason


def test_what_was_so_before_proves_nothing(tmp_path: Path) -> None:
    """A rate that is the new one all the time is not the parameter's doing."""
    finding = judged("parameter_effect", RATE, rates(windows(tmp_path), 20.0, 20.0))
    assert (finding.outcome, finding.reason) == (
        Outcome.FAILED,
        "It was 20 before, so nothing changed.",
    )


def test_a_topic_that_falls_silent_fails_unless_the_machine_delayed_it(tmp_path: Path) -> None:
    """A timer that was cancelled and not made anew publishes nothing."""
    finding = judged("parameter_effect", RATE, rates(windows(tmp_path), 10.0, 0.0))
    assert finding.outcome is Outcome.FAILED
    assert "After the parameter was set, nothing was seen of the rate of /chatter" in finding.reason
    delayed = rates(windows(tmp_path / "delayed"), 10.0, 0.0).disturbed("it", (5.0, 2.0))
    assert judged("parameter_effect", RATE, delayed).outcome is Outcome.INCONCLUSIVE


def test_a_rate_that_the_machine_lowered_is_undecided(tmp_path: Path) -> None:
    """A lowered rate is undecided, as in the check of the rate alone."""
    late = rates(windows(tmp_path), 10.0, 17.0).disturbed(
        "it", *((5.0 + n / 4, 0.06) for n in range(12))
    )
    assert judged("parameter_effect", RATE, late).outcome is Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("hz", "more", "delay"),
    [
        ((10.0, 10.0, 10.0), {"old": 20.0, "new": 10.0}, (1.0, 1.5)),
        ((10.0, 10.0, 15.0), RESTARTED, (9.0, 1.0)),
        ((8.0, 10.0, 20.0), RESTARTED, (1.0, 0.6)),
    ],
)
def test_a_rate_to_compare_with_that_the_machine_lowered_leaves_it_undecided(
    tmp_path: Path, hz: tuple[float, float, float], more: dict[str, Any], delay: tuple[float, float]
) -> None:
    """A delay may have lowered the rate before the change or after the restart.

    Without a delay the finding costs points.
    """
    calm = rates(windows(tmp_path / "calm"), *hz)
    assert judged("parameter_effect", {**RATE, **more}, calm).outcome is Outcome.FAILED
    busy = rates(windows(tmp_path / "busy"), *hz).disturbed("it", delay)
    assert judged("parameter_effect", {**RATE, **more}, busy).outcome is Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("after", "more", "credit", "words"),
    [
        (2.5, {}, "1", ""),
        (2.59, {}, "1", ""),
        (2.61, {}, "0", "After the parameter was set, data is 2.61."),
        (1.0, {}, "0", "data stays at 1."),
        (1.0, RESTARTED, "0.5", "takes effect only after a restart"),
    ],
)
def test_a_field_follows_its_parameter(
    tmp_path: Path, after: float, more: dict[str, Any], credit: str, words: str
) -> None:
    """The field follows its parameter if its median is within the tolerance."""
    values, times = (
        [1.0] * 31 + [9.0] + [after] * 30 + [2.5] * 31,
        [t for s in (1.0, 5.0, 9.0) for t in evenly(10, 3.0, s)],
    )
    session = windows(tmp_path).messages("/chatter", [[v] for v in values], times)
    finding = judged("parameter_effect", {**FIELD, **more}, session)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


@pytest.mark.parametrize(
    ("greeting", "outcome"), [("hello", Outcome.FAILED), ("ahoi", Outcome.PASSED)]
)
def test_a_text_follows_its_parameter(tmp_path: Path, greeting: str, outcome: Outcome) -> None:
    """The most frequent one counts."""
    times = []
    for s in (1.0, 5.0):
        for t in evenly(10, 3.0, s):
            times.append(t)
    session = windows(tmp_path).texts("/chatter", ["hello"] * 33 + [greeting] * 29, times)
    text = {**RATE, "text": "data", "old": "hello", "new": "ahoi"}
    assert judged("parameter_effect", text, session).outcome is outcome


@pytest.mark.parametrize(("total", "outcome"), [(6.0, Outcome.PASSED), (3.0, Outcome.FAILED)])
def test_an_answer_follows_its_parameter(tmp_path: Path, total: float, outcome: Outcome) -> None:
    """Calls before and after are compared by a field of their answers."""
    session = Session(tmp_path).process("it")
    for label, value in (("before", 3.0), ("after", total)):
        if label == "after":
            session.step("set_parameters", "set", node="/talker", refused={})
        call = {"started_ns": at(1.0), "ended_ns": at(1.1), "response": {"found": {"total": value}}}
        session.step("call", label, calls=[call])
    answer = {"process": "it", **STEPS, "answer": "found.total", "old": 3.0, "new": 6.0}
    assert judged("parameter_effect", answer, session).outcome is outcome


def test_a_parameter_that_cannot_be_set_has_no_effect(tmp_path: Path) -> None:
    """The node's reason is shown; without an answer, the first check that asks for one costs."""
    finding = judged(
        "parameter_effect", RATE, rates(windows(tmp_path, rate="it is read-only"), 10.0, 10.0)
    )
    assert "could not be set while the node ran: rate: it is read-only." in finding.reason
    silent = (
        Session(tmp_path / "silent")
        .process("it")
        .step("get_parameters", "get", "timeout", problem="x")
    )
    silent.step("set_parameters", "set", "timeout", problem="x")
    assert judged("parameter_effect", RATE, silent).outcome is Outcome.NOT_REACHED


@pytest.mark.parametrize(
    "wrong", [{"answer": "data"}, {"topic": None}, {"old": "slow"}, {"new": True}]
)
def test_an_effect_is_of_one_kind(wrong: dict[str, Any]) -> None:
    """A topic or an answer, and a rate is a number."""
    with pytest.raises(ValidationError):
        ParameterEffect.model_validate({**RATE, **wrong})


# -- refusals --------------------------------------------------------------------------------------

REJECTED = {"step": "invalid"}


def refusing(
    folder: Path,
    refused: dict[str, str],
    after: dict[str, Any],
    before: dict[str, Any] | None = None,
) -> Session:
    """Record that invalid values were set."""
    values = {"rate": -1.0, "mode": "fly"}
    if before is not None:
        held = before
    else:
        held = {"rate": 10.0, "mode": "drive"}
    return (
        Session(folder)
        .process("it")
        .step(
            "set_parameters",
            "invalid",
            node="/talker",
            refused=refused,
            before=held,
            after=after,
            parameters={"values": values},
        )
    )


HELD, WHY = (
    {"rate": 10.0, "mode": "drive"},
    {"rate": "must be positive", "mode": "one of drive, stop"},
)


@pytest.mark.parametrize(
    ("refused", "after", "credit", "words"),
    [
        (WHY, HELD, "1", ""),
        ({**WHY, "rate": " "}, HELD, "0.875", "rate refuses -1.0 without a reason."),
        ({"mode": WHY["mode"]}, {**HELD, "rate": -1.0}, "0.5", "rate accepts -1.0."),
        (WHY, {**HELD, "rate": -1.0}, "0.625", "rate was 10, and is -1 after it refused -1.0."),
        ({}, {"rate": -1.0, "mode": "fly"}, "0", "mode accepts 'fly'."),
    ],
)
def test_invalid_values_are_refused_with_a_reason(
    tmp_path: Path, refused: dict[str, str], after: dict[str, Any], credit: str, words: str
) -> None:
    """Each value is a part; one that was taken all the same is none."""
    finding = judged("parameter_rejected", REJECTED, refusing(tmp_path, refused, after))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_a_refusal_of_what_is_not_declared_proves_nothing(tmp_path: Path) -> None:
    """An undeclared parameter is refused by rclpy itself."""
    finding = judged(
        "parameter_rejected", REJECTED, refusing(tmp_path, WHY, {"rate": 10.0}, {"rate": 10.0})
    )
    assert finding.credit == Decimal("0.5")
    assert "mode is not declared, so that refusing it proves nothing." in finding.reason


def test_other_words_of_a_reason_are_noted(tmp_path: Path) -> None:
    """A reason in other words costs nothing."""
    finding = judged(
        "parameter_rejected", {**REJECTED, "reason": "positive"}, refusing(tmp_path, WHY, HELD)
    )
    assert finding.outcome is Outcome.PASSED
    assert finding.notes == (
        "The reason 'one of drive, stop' for mode is not worded as in the lab.",
    )


def test_a_node_that_ends_by_an_invalid_value_fails(tmp_path: Path) -> None:
    """A node that ended gives no answer, and its output shows the reason."""
    session = Session(tmp_path).process(
        "it",
        ["ZeroDivisionError: division by zero"],
        interrupted_ns=None,
        ended_by="itself",
        exit_status=1,
    )
    session.step(
        "set_parameters",
        "invalid",
        "timeout",
        node="/talker",
        refused={},
        parameters={"values": {"rate": 0.0}},
    )
    finding = judged("parameter_rejected", REJECTED, session)
    assert finding.outcome is Outcome.FAILED
    assert "already ended, with exit status 1" in finding.reason
