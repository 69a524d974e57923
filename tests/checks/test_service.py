"""Checks of a node that serves: answers and parameters, by the grader's own calls."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.result import Finding, Outcome
from tests.synthetic import Session, at, judged, submission

NAME, SET_BOOL = "/robot/enable", "std_srvs/srv/SetBool"
OFFERED = {"artifact": "it", "service": NAME, "type": SET_BOOL, "node": "/student"}
ANSWERED = {
    "artifact": "it",
    "step": "enable",
    "response": {"success": True},
    "message": "(?i)enabl",
}
DECLARED = {
    "step": "defaults",
    "parameters": [
        {"name": "limit", "type": "double", "value": 1.0},
        {"name": "safe", "type": "bool", "value": True},
    ],
}


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


# -- the service -----------------------------------------------------------------------------------


def test_a_service_as_asked_passes(tmp_path: Path) -> None:
    """Name, type and node as asked earn all."""
    assert (
        judged("service_offered", OFFERED, Session(tmp_path).service(NAME)).outcome
        is Outcome.PASSED
    )


@pytest.mark.parametrize(
    ("wrong", "credit", "words"),
    [
        ({"name": "/enable"}, "0.4", "named /enable, not /robot/enable"),
        ({"name": f"/arm{NAME}", "node": "/arm/student"}, "0.4", "in its node's namespace, /arm."),
        ({"kind": "std_srvs/srv/Trigger"}, "0.4", "is std_srvs/srv/Trigger"),
        ({"node": "/other"}, "0.8", "named /other, not /student"),
        ({"node": "/arm/student"}, "1", ""),
    ],
)
def test_each_wrong_name_costs_its_part(
    tmp_path: Path, wrong: dict[str, str], credit: str, words: str
) -> None:
    """A wrong name or type costs 60 %, a wrong node name 20 %, a namespace nothing."""
    session = Session(tmp_path).service(**{"name": NAME, **wrong})
    if "name" in wrong:
        session.called(f"{NAME}={wrong['name']}")
    finding = judged("service_offered", OFFERED, session)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_no_service_fails(tmp_path: Path) -> None:
    """A service that never came up, or only one of our own, fails."""
    session = (
        Session(tmp_path).service(NAME, "/ours").process("it", interrupted_ns=None, ended_by="x")
    )
    finding = judged("service_offered", OFFERED, session, reference_nodes=["/ours"])
    assert finding.outcome is Outcome.FAILED
    assert "did not appear" in finding.reason
    assert (
        judged("service_offered", OFFERED, Session(tmp_path), submission(it=None)).measured
        == "no such file"
    )


@pytest.mark.parametrize(("ends_s", "outcome"), [(0.8, Outcome.FAILED), (1.2, Outcome.PASSED)])
def test_a_service_that_nobody_could_call_is_not_offered(
    tmp_path: Path, ends_s: float, outcome: Outcome
) -> None:
    """A service was not offered if its node ended before the first call.

    A moment in the graph does not count.
    """
    session = (
        Session(tmp_path)
        .service(NAME)
        .process("it", interrupted_ns=None, ended_by="itself", exited_ns=at(ends_s))
    )
    finding = judged("service_offered", OFFERED, called(session, "enable", call(None)))
    assert finding.outcome is outcome
    assert outcome is Outcome.PASSED or "already ended" in finding.reason


# -- one answer ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("response", "credit", "outcome"),
    [
        (answer(True), "1", Outcome.PASSED),
        (answer(True, ""), "0.75", Outcome.PARTIAL),
        (answer(True, "Bonjour"), "1", Outcome.PASSED),
        (answer(False), "0", Outcome.FAILED),
    ],
)
def test_an_answer_is_judged_by_its_values(
    tmp_path: Path, response: dict[str, Any], credit: str, outcome: Outcome
) -> None:
    """The wrong value fails, an empty message costs a quarter, and other words only a note."""
    finding = judged("call_answered", ANSWERED, called(Session(tmp_path), "enable", call(response)))
    assert (finding.credit, finding.outcome) == (Decimal(credit), outcome)
    assert bool(finding.notes) == (response["message"] == "Bonjour")


def test_an_answer_of_another_type_has_no_such_field(tmp_path: Path) -> None:
    """A field that the type lacks is named as missing, not as a value."""
    finding = judged(
        "call_answered", ANSWERED, called(Session(tmp_path), "enable", call({"ok": 1}))
    )
    assert finding.reason == "In the answer, there is no field success."


AGAIN = {**ANSWERED, "again": "many", "contrary": r"(?i)\bdisabled\b"}


@pytest.mark.parametrize(
    ("later", "credit", "words"),
    [
        (answer(True, "Robot already enabled"), "1", ""),
        (answer(True, "Robot enabled (was disabled)"), "1", ""),
        (answer(True, "Robot disabled"), "0", "means the opposite"),
        (answer(False, "Robot already enabled"), "0.75", "later"),
    ],
)
def test_the_same_request_is_to_be_answered_alike(
    tmp_path: Path, later: dict[str, Any], credit: str, words: str
) -> None:
    """A contrary later costs all, a refusal a quarter; one that tells of the former state as well is no contrary."""
    session = called(
        called(Session(tmp_path), "enable", call(answer(True))),
        "many",
        call(answer(True)),
        call(later),
    )
    finding = judged("call_answered", AGAIN, session)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_a_contrary_message_misleads_at_each_request(tmp_path: Path) -> None:
    """A message of the previous state has no single charge: after each request, the operator reads the opposite."""
    session = called(Session(tmp_path), "enable", call(answer(True, "Robot disabled")))
    finding = judged("call_answered", AGAIN, session)
    assert (finding.outcome, finding.causes) == (Outcome.FAILED, ())


def test_contrary_messages_have_a_single_charge_by_their_cause(tmp_path: Path) -> None:
    """The rubric names the mistake that several checks of one service see."""
    session = called(Session(tmp_path), "enable", call(answer(True, "Robot disabled")))
    finding = judged("call_answered", {**AGAIN, "contrary_cause": "messages"}, session)
    assert (finding.outcome, finding.causes) == (Outcome.FAILED, ("messages",))


def test_rubrics_of_earlier_versions_name_a_check_for_contrary_messages(tmp_path: Path) -> None:
    """The named check charges messages of the opposite at a later request too."""
    session = called(Session(tmp_path), "enable", call(answer(True, "Robot disabled")))
    first = Finding(Outcome.PARTIAL, Decimal("0.75"))
    given = {**AGAIN, "again_charged_by": "first"}
    finding = judged("call_answered", given, session, findings={"first": first})
    assert finding.outcome is Outcome.EXCUSED


@pytest.mark.parametrize(("default", "credit"), [(False, "1"), (True, "0"), ("false", "0")])
def test_another_default_is_not_charged_with_the_answer(
    tmp_path: Path, default: Any, credit: str
) -> None:
    """A node that refuses since its parameter begins otherwise is judged when the parameter has been set."""
    session = Session(tmp_path).step(
        "get_parameters", "read", values={"safe": {"type": "bool", "value": default}}
    )
    called(session, "enable", call(answer(False)))
    called(session, "recover", call(answer(True)))
    given = {"step": "read", "name": "safe", "value": True, "instead": "recover"}
    assert judged("call_answered", {**ANSWERED, "given": given}, session).credit == Decimal(credit)


def test_another_answer_later_is_charged_once(tmp_path: Path) -> None:
    """A node that refuses repeated requests loses for enabling, and not for disabling as well."""
    session = called(
        called(Session(tmp_path), "enable", call(answer(True))), "many", call(answer(False))
    )
    finding = judged("call_answered", AGAIN, session)
    assert (finding.outcome, finding.causes) == (Outcome.PARTIAL, (f"later answers of {NAME}",))


def test_no_answer_fails_and_says_how_long_it_took(tmp_path: Path) -> None:
    """A call without an answer is told with its time."""
    finding = judged(
        "call_answered", ANSWERED, called(Session(tmp_path).process(), "enable", call(None, 3.0))
    )
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "No answer came within 3.0 s."


def test_a_node_that_does_not_spin_is_recognised(tmp_path: Path) -> None:
    """A node that does not answer questions for parameters either does not spin."""
    session = Session(tmp_path).process().step("get_parameters", "defaults", "timeout")
    finding = judged("call_answered", ANSWERED, called(session, "enable", call(None, 3.0)))
    assert "does not answer parameter requests either" in finding.reason
    assert "rclpy.spin(node) must be reached" in finding.hint


def test_an_exception_in_the_callback_is_the_reason(tmp_path: Path) -> None:
    """The exception and its line are told."""
    lines = [
        "Traceback (most recent call last):",
        '  File "/ws/src/it.py", line 12, in enable',
        "    response.succes = True",
        "AttributeError: 'SetBool_Response' object has no attribute 'succes'",
    ]
    session = Session(tmp_path).process("it", lines, interrupted_ns=None)
    finding = judged("call_answered", ANSWERED, called(session, "enable", call(None, 3.0)))
    assert "it.py, line 12" in finding.reason


def test_silence_is_charged_once(tmp_path: Path) -> None:
    """After a call without an answer, a second one is not reached."""
    session = called(
        called(Session(tmp_path).process(), "first", call(None, 3.0)), "enable", call(None, 3.0)
    )
    assert judged("call_answered", ANSWERED, session).outcome is Outcome.NOT_REACHED


def test_what_the_students_type_cannot_ask_for_fails(tmp_path: Path) -> None:
    """Two requests that differ in a field which the type lacks are one, and only the first of them was made."""
    session = called(Session(tmp_path), "first", call(answer(True)), request={})
    assert judged("call_answered", {**ANSWERED, "step": "first"}, session).outcome is Outcome.PASSED
    session = called(session, "enable", call(answer(True)), data=False, request={})
    finding = judged("call_answered", ANSWERED, session)
    assert (finding.outcome, "no field data" in finding.reason) == (Outcome.FAILED, True)


def test_a_call_that_was_never_made_fails(tmp_path: Path) -> None:
    """Without the step there is no answer."""
    finding = judged("call_answered", ANSWERED, Session(tmp_path).process())
    assert finding.outcome is Outcome.FAILED
    assert "could not be made" in finding.reason


# -- parameters ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "credit", "words"),
    [
        ({"limit": ("double", 1.0), "safe": ("bool", True)}, "1", ""),
        (
            {"limit": ("double", 2.0), "safe": ("bool", True)},
            "0.75",
            "limit is 2.0 (double), not 1.0",
        ),
        ({"limit": ("integer", 1), "safe": ("bool", True)}, "0.75", "limit is 1 (integer)"),
        ({"safe": ("bool", True)}, "0.5", "limit is not declared"),
        ({}, "0", "safe is not declared"),
    ],
)
def test_each_parameter_is_a_part(
    tmp_path: Path, values: dict[str, Any], credit: str, words: str
) -> None:
    """A parameter that is not declared loses its part, one with another default half of it."""
    plain = {name: {"type": kind, "value": value} for name, (kind, value) in values.items()}
    session = Session(tmp_path).step("get_parameters", "defaults", values=plain)
    finding = judged("parameters_declared", DECLARED, session)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_a_type_that_ends_the_launched_node_costs_what_the_rubric_says(tmp_path: Path) -> None:
    """A parameter of another type costs all of the check."""
    plain = {"limit": {"type": "integer", "value": 1}, "safe": {"type": "bool", "value": True}}
    session = Session(tmp_path).step("get_parameters", "defaults", values=plain)
    finding = judged("parameters_declared", {**DECLARED, "other_type_costs": 1}, session)
    assert finding.outcome is Outcome.FAILED
    assert len(finding.causes) == 1


def test_an_overwritten_attribute_is_one_mistake_of_call_and_parameters(tmp_path: Path) -> None:
    """The source declares the parameters, so that no hint asks for it; the crash and the loss share their cause."""
    lines = [
        "Traceback (most recent call last):",
        '  File "/ws/src/it.py", line 9, in enable',
        "rclpy.exceptions.ParameterNotDeclaredException: ('Invalid access to undeclared parameter(s)', [], ['safe'])",
    ]
    source = "class A(Node):\n    def __init__(self):\n        self._parameters = {}\n"
    session = Session(tmp_path).process("it", lines, interrupted_ns=None)
    session.step("get_parameters", "defaults", values={})
    called(session, "enable", call(None, 3.0))
    record = submission({"it.py": source})
    silent = judged("call_answered", ANSWERED, session, record)
    undeclared = judged("parameters_declared", DECLARED, session, record)
    assert silent.causes == undeclared.causes
    assert len(silent.causes) == 1
    for finding in (silent, undeclared):
        assert "self._parameters replaces the attribute" in finding.reason
        assert "another name" in finding.hint


def test_parameters_of_a_silent_node_are_not_charged_again(tmp_path: Path) -> None:
    """A node that answers nothing is charged with its calls."""
    session = called(
        Session(tmp_path).step("get_parameters", "defaults", "timeout"), "enable", call(None)
    )
    assert judged("parameters_declared", DECLARED, session).outcome is Outcome.NOT_REACHED


def test_parameters_that_cannot_be_read_fail(tmp_path: Path) -> None:
    """If only the parameters are not answered, that is charged here."""
    session = Session(tmp_path).step(
        "get_parameters", "defaults", "timeout", problem="no such node"
    )
    finding = judged("parameters_declared", DECLARED, session)
    assert finding.outcome is Outcome.FAILED
    assert "no such node" in finding.reason


# -- a node that ended before it was asked ---------------------------------------------------------

QUIET: dict[str, Any] = {
    "interrupted_ns": None,
    "ended_by": "itself",
    "exit_status": 0,
    "exited_ns": at(0.9),
}


@pytest.mark.parametrize(
    "check", ["call_answered", "topic_published", "topics_subscribed", "service_offered"]
)
def test_a_node_that_ended_without_an_error_is_told_to_spin(tmp_path: Path, check: str) -> None:
    """Each check of the node says that the node had ended."""
    parameters: dict[str, dict[str, Any]] = {
        "call_answered": ANSWERED,
        "service_offered": OFFERED,
        "topic_published": {"artifact": "it", "topic": "/t", "type": "std_msgs/msg/String"},
        "topics_subscribed": {
            "artifact": "it",
            "topics": [{"topic": "/t", "type": "std_msgs/msg/String"}],
        },
    }
    session = Session(tmp_path).process("it", **QUIET)
    session.step("call", "enable", "cancelled", problem="the student's process had ended")
    finding = judged(check, parameters[check], session, submission({"it.py": ""}, it="it.py"))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason.startswith(
        "Your it node had already ended (exit status 0 after 0.8 s, no error)"
    )
    assert "rclpy.spin(node)" in finding.hint


def test_what_could_not_be_asked_of_a_node_that_ended_is_not_charged_again(tmp_path: Path) -> None:
    """The parameters of a node that had ended are not tested, and the reason says so."""
    session = Session(tmp_path).process("it", **QUIET)
    session.step(
        "get_parameters", "defaults", "cancelled", problem="the student's process had ended"
    )
    session.step("call", "enable", "cancelled")
    declared = judged("parameters_declared", DECLARED, session)
    assert declared.outcome is Outcome.NOT_REACHED
    assert "had ended before it could be asked" in declared.reason
