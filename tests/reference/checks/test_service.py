"""Refusals and quickness of a service, as Lab 09-01 checks them, by the grader's own calls."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.result import Finding, Outcome
from tests.synthetic import Session, at, judged, submission

CALL_GATED = "reference/checks/service.py:call_gated"
CALLS_IN_TIME = "reference/checks/service.py:calls_in_time"
NAME = "/robot/enable"
#: Parameters of the step that sets the gate.
SWITCHED_OFF = {"node": "/robot", "values": {"safety": False}}
GATED = {
    "set_step": "off",
    "refused_step": "refuse",
    "recovered_step": "recover",
    "from_start_step": "from_start",
    "refused": {"success": False},
    "recovered": {"success": True},
}
IN_TIME = {"step": "many", "within_s": 1.0}


def call(response: dict[str, Any] | None, latency_s: float = 0.002) -> dict[str, Any]:
    """Give one call as a step keeps it."""
    return {"started_ns": at(1.0), "ended_ns": at(1.0 + latency_s), "response": response}


def answer(success: bool, message: str = "Robot enabled") -> dict[str, Any]:
    """Give a response."""
    return {"success": success, "message": message}


def called(
    session: Session,
    label: str,
    *calls: dict[str, Any],
    wanted: int | None = None,
    data: bool = True,
    **result: Any,
) -> Session:
    """Add a step that called the service."""
    parameters = {"service": NAME, "request": {"data": data}, "repeat": wanted or len(calls)}
    if all(c["response"] is not None for c in calls):
        outcome = "done"
    else:
        outcome = "timeout"
    return session.step(
        "call", label, outcome, calls=list(calls), service=NAME, parameters=parameters, **result
    )


# -- the gate --------------------------------------------------------------------------------------


def gated(
    folder: Path, refuse: bool, recover: bool, from_start: bool, outcome: str = "done"
) -> Finding:
    """Judge a node that answers three calls with these."""
    session = Session(folder).step("set_parameters", "off", outcome, parameters=SWITCHED_OFF)
    for label, success in (("refuse", refuse), ("recover", recover), ("from_start", from_start)):
        called(session, label, call(answer(success)))
    return judged(CALL_GATED, GATED, session)


@pytest.mark.parametrize(("again", "credit"), [(False, "1"), (True, "0.5")])
def test_an_enabled_robot_is_refused_too(tmp_path: Path, again: bool, credit: str) -> None:
    """A node that answers a repeated request before it reads its parameter loses half."""
    session = Session(tmp_path).step("set_parameters", "off", parameters=SWITCHED_OFF)
    answers = {"refuse": False, "recover": True, "from_start": False, "again": again}
    for label, success in answers.items():
        called(session, label, call(answer(success)))
    finding = judged(CALL_GATED, {**GATED, "enabled_step": "again"}, session)
    assert finding.credit == Decimal(credit)


@pytest.mark.parametrize(
    ("refusal", "recovery", "credit"),
    [
        ("cannot be enabled", "Robot enabled", "1"),
        ("Robot enabled", "Robot enabled", "0.4"),
        ("cannot be enabled", "Robot disabled", "0.4"),
        ("Robot is not enabled", "Robot enabled (was disabled)", "1"),
    ],
)
def test_a_message_of_the_opposite_state_misleads(
    tmp_path: Path, refusal: str, recovery: str, credit: str
) -> None:
    """The fields are right; an operator reads the message. All such messages are one mistake."""
    session = Session(tmp_path).step("set_parameters", "off", parameters=SWITCHED_OFF)
    answers = {
        "refuse": answer(False, refusal),
        "recover": answer(True, recovery),
        "from_start": answer(False, refusal),
    }
    for label, response in answers.items():
        called(session, label, call(response))
    told = {"told_on": "(?i)^robot enabled$", "told_off": "(?i)^robot disabled$"}
    gate = {**GATED, **told, "misled_credit": 0.4, "contrary_cause": "messages"}
    finding = judged(CALL_GATED, gate, session)
    assert finding.credit == Decimal(credit)
    assert finding.causes == (() if credit == "1" else ("messages",))


def test_a_request_granted_from_the_start_misleads_nobody(tmp_path: Path) -> None:
    """The node enables by its own account too, for example because its parameter has another name."""
    session = Session(tmp_path).step("set_parameters", "off", parameters=SWITCHED_OFF)
    answers = {
        "refuse": answer(False, "Safety is off"),
        "recover": answer(True, "Robot enabled"),
        "from_start": answer(True, "Robot enabled"),
    }
    for label, response in answers.items():
        called(session, label, call(response))
    gate = {**GATED, "told_on": "(?i)^robot enabled$", "misled_credit": 0.4}
    finding = judged(CALL_GATED, {**gate, "contrary_cause": "messages"}, session)
    assert "messages" not in finding.causes


@pytest.mark.parametrize(
    ("answers", "credit", "words"),
    [
        ((False, True, False), "1", ""),
        ((False, False, False), "0.5", "does not recover"),
        ((True, True, False), "0.5", "only when the parameter is false from the start"),
        ((True, True, True), "0", "although the parameter is false"),
    ],
)
def test_refusal_and_recovery_are_half_each(
    tmp_path: Path, answers: tuple[bool, bool, bool], credit: str, words: str
) -> None:
    """Refusing, recovering, and reading the parameter only once are told apart."""
    finding = gated(tmp_path, *answers)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_a_parameters_object_as_a_condition_is_named(tmp_path: Path) -> None:
    """The hint is to add `.value`."""
    session = Session(tmp_path).step("set_parameters", "off", "done", parameters=SWITCHED_OFF)
    for label in ("refuse", "recover", "from_start"):
        called(session, label, call(answer(True)))
    record = submission({"it.py": "\nif self.get_parameter('safety'):\n    go()\n"})
    finding = judged(CALL_GATED, GATED, session.process(), record)
    assert "Line 2 of it.py tests the parameter's object" in finding.reason
    assert finding.where[0].line == 2


def test_a_parameter_of_another_name_forbids_nothing_by_its_own(tmp_path: Path) -> None:
    """All is right by the other name, and part of the credit is left."""
    session = Session(tmp_path).step(
        "set_parameters", "off", "done", parameters=SWITCHED_OFF, names={"safety": "safe"}
    )
    for label, success in (("refuse", False), ("recover", True), ("from_start", False)):
        called(session, label, call(answer(success)))
    finding = judged(CALL_GATED, {**GATED, "other_name_credit": 0.5}, session)
    assert finding.credit == Decimal("0.5")
    assert "by the parameter safe; with safety set to false, it still enables" in finding.reason
    assert finding.causes == ("parameter safety of /robot",)


@pytest.mark.parametrize(
    ("own_type", "from_start", "credit"),
    [("string", None, "0"), ("string", False, "1"), ("bool", None, "1"), ("not set", None, "1")],
)
def test_a_parameter_of_another_type_forbids_nothing(
    tmp_path: Path, own_type: str, from_start: bool | None, credit: str
) -> None:
    """A string cannot be set to false by anybody; one with dynamic typing answers from the start, and is right."""
    held = {"safety": {"type": own_type, "value": "true"}}
    session = Session(tmp_path).step("get_parameters", "read", values=held)
    session.step("set_parameters", "off", "done", parameters=SWITCHED_OFF)
    for label, success in (("refuse", False), ("recover", True)):
        called(session, label, call(answer(success)))
    called(session, "from_start", call(None if from_start is None else answer(from_start)))
    source = "import rclpy\nself.declare_parameter('safety', 'true')\n"
    record = submission({"it.py": source})
    finding = judged(CALL_GATED, {**GATED, "read_step": "read"}, session.process(), record)
    assert finding.credit == Decimal(credit)
    if credit == "0":
        assert "declared as a string, so the bool false cannot be set" in finding.reason
        assert (finding.where[0].file, finding.where[0].line) == ("it.py", 2)
        assert finding.causes == ("parameter safety of /robot",)


@pytest.mark.parametrize(("success", "credit"), [(True, "1"), (False, "0.17")])
def test_what_must_always_be_possible_is_not_refused(
    tmp_path: Path, success: bool, credit: str
) -> None:
    """A robot that cannot be disabled while safety is off endangers as one that can be enabled then."""
    session = Session(tmp_path).step("set_parameters", "off", "done", parameters=SWITCHED_OFF)
    for label, answered in (
        ("refuse", False),
        ("disable", success),
        ("recover", True),
        ("from_start", False),
    ):
        called(session, label, call(answer(answered)), data=label != "disable")
    gate = {
        **GATED,
        "allowed_step": "disable",
        "allowed": {"success": True},
        "disallowed_credit": 0.17,
    }
    assert judged(CALL_GATED, gate, session).credit == Decimal(credit)


def test_a_refusal_in_words_alone_earns_half(tmp_path: Path) -> None:
    """A message that refuses beside success=True is half a refusal, one that enables is none."""
    for name, said, credit in (("a", "Cannot enable: unsafe", "0.5"), ("b", "Robot enabled", "0")):
        session = called(Session(tmp_path, name), "refuse", call(answer(True, said)))
        called(session, "recover", call(answer(True)))
        assert judged(CALL_GATED, {**GATED, "refusal": "(?i)cannot"}, session).credit == Decimal(
            credit
        )


def test_a_gate_the_wrong_way_round_earns_nothing(tmp_path: Path) -> None:
    """A node that follows the parameter in reverse enables exactly while that is forbidden.

    If enabling fails otherwise, a refusal proves nothing. If the node enables later, the failure is
    charged in the enabling check, and not here again.
    """
    lost = {"first": Finding(Outcome.FAILED, Decimal(0), "", "")}
    gate = {**GATED, "enables": "first"}
    for name, off, on, credit in (
        ("a", True, False, "0"),
        ("b", False, False, "0"),
        ("c", False, True, "1"),
    ):
        session = called(
            called(Session(tmp_path, name), "refuse", call(answer(off))),
            "recover",
            call(answer(on)),
        )
        finding = judged(CALL_GATED, gate, session, findings=lost)
        assert finding.credit == Decimal(credit)
        assert (finding.outcome is Outcome.NOT_REACHED) == (name == "b")


def test_a_parameter_that_cannot_be_set_is_reported(tmp_path: Path) -> None:
    """If the parameter could not be set, the reason says so."""
    reason = gated(tmp_path, True, True, True, "failed").reason
    assert "because safety could not be set while it ran" in reason


def test_no_answer_while_off_is_reported(tmp_path: Path) -> None:
    """A node that falls silent while the parameter is false is told so."""
    finding = judged(CALL_GATED, GATED, called(Session(tmp_path), "refuse", call(None)))
    assert finding.reason == "No answer came while the parameter was false."


# -- quickness -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("latencies", "credit"),
    [([0.002] * 10, "1"), ([1.0] * 10, "1"), ([0.002] * 9 + [1.2], "0.9"), ([2.0] * 10, "0")],
)
def test_calls_are_credited_by_the_share_in_time(
    tmp_path: Path, latencies: list[float], credit: str
) -> None:
    """A call answered within the limit counts, one above it does not."""
    calls = [call(answer(True), latency_s) for latency_s in latencies]
    finding = judged(CALLS_IN_TIME, IN_TIME, called(Session(tmp_path), "many", *calls))
    assert finding.credit == Decimal(credit)


def test_calls_that_the_machine_may_have_delayed_are_undecided(tmp_path: Path) -> None:
    """A slow call is not charged where the server had no core for so long, and is where it slept."""
    calls = [call(answer(True), latency_s) for latency_s in [0.002] * 9 + [1.2]]
    held_up = called(Session(tmp_path / "a").process(), "many", *calls).delayed("it", 3.0, 4.0)
    assert judged(CALLS_IN_TIME, IN_TIME, held_up).outcome is Outcome.INCONCLUSIVE
    slept = called(Session(tmp_path / "b").process(), "many", *calls).delayed("it", 0.3, 4.0)
    assert judged(CALLS_IN_TIME, IN_TIME, slept).credit == Decimal("0.9")


def test_quick_calls_for_which_there_was_no_time_are_undecided(tmp_path: Path) -> None:
    """Where fewer calls were made than asked for, but all in time, nothing is lost."""
    session = called(Session(tmp_path), "many", *[call(answer(True))] * 5, wanted=50)
    assert judged(CALLS_IN_TIME, IN_TIME, session).outcome is Outcome.INCONCLUSIVE


def test_enough_quick_calls_will_do_where_there_was_no_time_for_more(tmp_path: Path) -> None:
    """Calls that take long but are in time are not held against the node when others had no time."""
    calls = [call(answer(True), 0.9)] * 12
    finding = judged(CALLS_IN_TIME, IN_TIME, called(Session(tmp_path), "many", *calls, wanted=50))
    assert finding.outcome is Outcome.PASSED
    assert "12 of 50 calls" in finding.notes[0]


def test_slow_calls_are_lost_even_if_not_all_were_made(tmp_path: Path) -> None:
    """Calls that took too long leave nothing undecided."""
    session = called(Session(tmp_path), "many", *[call(answer(True), 1.5)] * 5, wanted=50)
    finding = judged(CALLS_IN_TIME, IN_TIME, session)
    assert finding.outcome is Outcome.FAILED
    assert "The quickest took 1.50 s" in finding.reason


def test_no_calls_after_a_silent_one_are_not_reached(tmp_path: Path) -> None:
    """Silence was charged with the call before."""
    session = called(called(Session(tmp_path), "enable", call(None)), "many", call(None))
    assert judged(CALLS_IN_TIME, IN_TIME, session).outcome is Outcome.NOT_REACHED
    assert judged(CALLS_IN_TIME, IN_TIME, Session(tmp_path)).outcome is Outcome.FAILED


def test_a_call_that_the_grader_itself_delayed_is_undecided(tmp_path: Path) -> None:
    """The caller that times the calls may be delayed too, or stall."""
    calls = [call(answer(True), latency_s) for latency_s in [0.002] * 9 + [1.4]]
    late = called(Session(tmp_path / "a").process("director", role="grader"), "many", *calls)
    late.delayed("director", 2.0, 4.0)
    assert judged(CALLS_IN_TIME, IN_TIME, late).outcome is Outcome.INCONCLUSIVE
    calls[-1]["held_up_ns"] = 1_300_000_000
    stopped = called(Session(tmp_path / "b").process(), "many", *calls)
    assert judged(CALLS_IN_TIME, IN_TIME, stopped).outcome is Outcome.INCONCLUSIVE


def test_a_later_call_to_a_node_that_ended_is_not_charged_again(tmp_path: Path) -> None:
    """The reason names the first call without an answer."""
    session = Session(tmp_path).process(
        "it", interrupted_ns=None, ended_by="itself", exit_status=0, exited_ns=at(0.9)
    )
    session.step("call", "enable", "cancelled").step("call", "many", "cancelled")
    later = judged(CALLS_IN_TIME, IN_TIME, session)
    assert later.outcome is Outcome.NOT_REACHED
    assert 'the call "enable" got no answer' in later.reason
