"""The check of an action's server: each part right, wrong and in between, known mistakes by name, delays as doubts."""

from __future__ import annotations

import math
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from grader.checks.action import ActionServer
from grader.checks.base import failed
from grader.evidence.flakiness import inconclusive_reason
from grader.recording.session import GraphSnapshot, OutputLine, ServiceEndpoint
from grader.result import Finding, Location, Outcome
from tests.synthetic import Session, at, judged

NAME, KIND = "/fibonacci", "test_msgs/action/Fibonacci"
ABOUT = {"artifact": "it", "action": NAME, "type": KIND}
OFFERED = {**ABOUT, "node": "/student", "offered": {}}
#: A goal that went as it should: four messages of feedback, 0.1 s apart.
GOOD: dict[str, Any] = {
    "goal": {"order": 5},
    "goal_id": "0" * 32,
    "sent_ns": at(1.0),
    "answered_ns": at(1.003),
    "accepted": True,
    "stamp_ns": at(1.002),
    "feedback": [
        {"t_ns": at(1.1 + n / 10), "values": {"sequence": list(range(n + 3))}} for n in range(4)
    ],
    "feedback_count": 4,
    "first_feedback_ns": at(1.1),
    "last_feedback_ns": at(1.4),
    "ended_ns": at(1.5),
    "status": "succeeded",
    "result": {"sequence": [0, 1, 1, 2, 3, 5], "took": 1.25, "by": {"name": "it"}},
    "cancel": None,
}
REJECTED = {
    **GOOD,
    "accepted": False,
    "feedback": [],
    "feedback_count": 0,
    "ended_ns": None,
    "result": None,
}
SILENT = {**REJECTED, "accepted": None, "answered_ns": None, "status": None}
ENDLESS = {**GOOD, "ended_ns": None, "status": "executing", "result": None}


def cancelled(
    ended_s: float = 0.1, status: str = "canceled", *, accepted: bool = True, code: int = 0
) -> Any:
    """Give a goal that was cancelled 0.5 s after it was sent, and ended so long after that."""
    cancel = {"sent_ns": at(1.5), "answered_ns": at(1.51), "accepted": accepted, "code": code}
    return {**GOOD, "cancel": cancel, "ended_ns": at(1.5 + ended_s), "status": status}


def sent(
    session: Session, label: str, *goals: dict[str, Any], outcome: str = "done", **result: Any
) -> Session:
    """Add a step that sent goals."""
    parameters = {"action": NAME, "type": KIND, "goal": goals[0]["goal"] if goals else {"order": 5}}
    return session.step(
        "send_goal", label, outcome, goals=list(goals), parameters=parameters, **result
    )


def offering(folder: Path, name: str = NAME, kind: str = KIND, node: str = "/student") -> Session:
    """Begin a session with an action's server in the graph."""
    return Session(folder).process().service(f"{name}/_action/send_goal", node, f"{kind}_SendGoal")


def finding(folder: Path, part: str, wanted: dict[str, Any], *goals: dict[str, Any]) -> Finding:
    """Judge one part by the goals of one step, after an accepted and a rejected goal."""
    session = sent(sent(offering(folder), "yes", GOOD), "no", REJECTED)
    return judged(
        "action_server", {**ABOUT, part: {"step": "it", **wanted}}, sent(session, "it", *goals)
    )


# -- offered ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "credit", "words"),
    [
        ({}, "1", ""),
        ({"name": "/fibo"}, "0.4", "The action is named /fibo, not /fibonacci"),
        ({"kind": "other_msgs/action/Fibonacci"}, "0.4", "is other_msgs/action/Fibonacci, not"),
        ({"node": "/other"}, "0.8", "named /other, not /student"),
    ],
)
def test_an_action_is_offered_by_name_type_and_node(
    tmp_path: Path, wrong: dict[str, str], credit: str, words: str
) -> None:
    """A right action earns everything; a wrong name, type or node costs its share."""
    session = offering(tmp_path, **wrong)
    found = judged("action_server", OFFERED, session.called(f"{NAME}={wrong.get('name', NAME)}"))
    assert found.credit == Decimal(credit)
    assert words in found.reason


def test_no_action_in_the_graph_fails_and_keeps_the_rest_from_being_tested(tmp_path: Path) -> None:
    """The services of an action count only where one takes goals; nothing else costs by itself."""
    session = (
        Session(tmp_path).process().service(f"{NAME}/_action/get_result", kind=f"{KIND}_GetResult")
    )
    sent(session, "it", outcome="timeout", problem="the action server is not up")
    found = judged(
        "action_server", {**OFFERED, "result": {"step": "it", "values": {"sequence": []}}}, session
    )
    assert found.outcome is Outcome.FAILED
    assert "The action /fibonacci did not appear" in found.reason
    assert (
        found.reason.count(
            "Not tested, because no goal could be sent: the action server is not up."
        )
        == 1
    )


def test_a_server_that_was_asked_for_and_never_seen_is_undecided(tmp_path: Path) -> None:
    """By the tap the program made it: then discovery failed, or the note is forged."""
    session = Session(tmp_path).process().claim("action", "fibonacci")
    found = judged("action_server", OFFERED, session)
    assert found.outcome is Outcome.INCONCLUSIVE
    assert "asked for the action /fibonacci (it.py:7)" in found.reason


def test_a_fault_of_the_server_itself_points_at_its_line(tmp_path: Path) -> None:
    """A loss caused by the callbacks points at the goal, and a loss of the server at its line."""
    session = sent(
        sent(offering(tmp_path).claim("action", NAME), "it", GOOD), "no", REJECTED
    ).recorded()
    rejects = judged("action_server", {**ABOUT, "accepted": {"step": "no"}}, session)
    assert [(place.file, place.line) for place in rejects.where] == [("it.py", 7), (None, None)]
    late = judged(
        "action_server", {**ABOUT, "result": {"step": "it", "values": {"took": 0}}}, session
    )
    assert [(place.topic, place.file) for place in late.where] == [(NAME, None)]


# -- accepted and rejected -------------------------------------------------------------------------


def test_goals_are_accepted_and_rejected(tmp_path: Path) -> None:
    """Right answers earn full credit, and the measurement gives the time to the answer."""
    assert (
        finding(tmp_path / "1", "accepted", {}, GOOD).measured
        == "goal order=5 accepted after 3.0 ms"
    )
    assert finding(tmp_path / "2", "rejected", {}, REJECTED).outcome is Outcome.PASSED


def test_who_accepts_or_rejects_everything_is_told_so(tmp_path: Path) -> None:
    """Without the other kind of answer in the session, the mistake has a name and a hint of its own."""
    wanted = {**ABOUT, "rejected": {"step": "it"}}
    found = judged(
        "action_server", wanted, sent(sent(offering(tmp_path / "1"), "yes", GOOD), "it", GOOD)
    )
    assert (found.outcome, found.reason) == (Outcome.FAILED, "Every goal is accepted.")
    assert "GoalResponse.REJECT" in found.hint
    wanted = {**ABOUT, "accepted": {"step": "it"}, "rejected": {"step": "no"}}
    session = sent(sent(offering(tmp_path / "2"), "it", REJECTED), "no", REJECTED)
    session.record.processes[0].output.append(
        OutputLine(at(1.0), "stderr", "... did not return a GoalResponse type.")
    )
    found = judged("action_server", wanted, session)
    assert found.credit == 0
    assert "Every goal is rejected." in found.reason
    assert "a rejection proves nothing" in found.reason
    assert "returns no GoalResponse" in found.hint


def test_a_silent_server_is_charged_once(tmp_path: Path) -> None:
    """The first part says that no answer came.

    Later goals and checks say that they were not tested.
    """
    session = sent(
        sent(offering(tmp_path), "it", SILENT, outcome="timeout"),
        "later",
        SILENT,
        outcome="timeout",
    )
    wanted = {
        **ABOUT,
        "accepted": {"step": "it"},
        "feedback": {"step": "it"},
        "final_status": {"step": "it"},
        "cancelled": {"step": "later"},
    }
    recorded = session.recorded()
    found = judged("action_server", wanted, recorded)
    assert found.outcome is Outcome.FAILED
    assert found.reason.count("neither accepted nor rejected within 1.0 s") == 1
    assert found.reason.count("Not tested, because the goal order=5 got no answer") == 1
    assert found.reason.count("Not tested, because an earlier goal (order=5) got no answer") == 1
    assert "rclpy.spin(node)" in found.hint
    alone = {**ABOUT, "feedback": {"step": "it"}}
    assert judged("action_server", alone, recorded).outcome is Outcome.FAILED
    after = judged("action_server", alone, recorded, findings={"first": found})
    assert after.outcome is Outcome.NOT_REACHED


def test_what_lost_points_in_another_session_keeps_nothing_from_being_looked_at_again(
    tmp_path: Path,
) -> None:
    """Only a check of the same session was asked whether its loss may be chance."""
    session = sent(
        offering(tmp_path), "it", outcome="timeout", problem="the action server is not up"
    ).recorded()
    elsewhere = failed("", "", "no README", where=[Location(session="other")])
    found = judged(
        "action_server",
        {**ABOUT, "accepted": {"step": "it"}},
        session,
        findings={"first": elsewhere},
    )
    assert found.outcome is Outcome.FAILED


def test_a_goal_that_is_answered_is_judged_whatever_became_of_earlier_ones(tmp_path: Path) -> None:
    """An unanswered goal costs points in its own part, and in no other."""
    session = sent(sent(offering(tmp_path), "first", SILENT, outcome="timeout"), "it", GOOD)
    assert (
        judged("action_server", {**ABOUT, "accepted": {"step": "it"}}, session).outcome
        is Outcome.PASSED
    )


def test_goals_to_another_action_prove_nothing(tmp_path: Path) -> None:
    """An answer of another server earns nothing here, and its silence costs nothing."""
    other = sent(sent(offering(tmp_path), "other", GOOD), "silent", SILENT)
    for step in other.record.steps:
        step.parameters["action"] = "/other"
    recorded = sent(sent(other, "no", REJECTED), "later", SILENT).recorded()
    assert (
        "proves nothing"
        in judged("action_server", {**ABOUT, "rejected": {"step": "no"}}, recorded).reason
    )
    assert (
        "Every goal"
        in judged("action_server", {**ABOUT, "accepted": {"step": "no"}}, recorded).reason
    )
    later = judged("action_server", {**ABOUT, "accepted": {"step": "later"}}, recorded)
    assert "neither accepted nor rejected" in later.reason


def test_a_rejected_goal_keeps_the_rest_from_being_tested(tmp_path: Path) -> None:
    """A wrongly rejected goal is charged once, and nothing else is."""
    found = finding(tmp_path, "feedback", {}, REJECTED)
    assert "Not tested, because the goal order=5 was rejected." in found.reason


# -- feedback --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "changed", "credit", "words"),
    [
        ({"at_least": 4, "at_least_hz": 10}, {}, "1", ""),
        ({"at_least": 5}, {}, "0.8", "4 of 5 messages of feedback came"),
        ({}, {"feedback": [], "feedback_count": 0}, "0", "No feedback came"),
        ({"at_least_hz": 20}, {}, "0.5", "comes at 10.0 Hz; 19 Hz give full credit"),
        ({"at_least_hz": 10.8, "hz_tolerance": "5%"}, {}, "0.9", "comes at 10.0 Hz; 10.26 Hz"),
        ({"at_least_hz": 10.5, "hz_tolerance": "5%"}, {}, "1", ""),
        (
            {"at_least_hz": 1},
            {"feedback_count": 1, "last_feedback_ns": at(1.1)},
            "0",
            "comes at 0.0 Hz",
        ),
        ({"rising": "sequence"}, {}, "1", ""),
        ({"falling": "sequence"}, {}, "0.5", "From one message to the next, sequence rises."),
        ({"rising": "sequence[1]"}, {}, "1", ""),
        ({"rising": "absent.field"}, {}, "1", ""),
    ],
)
def test_feedback_is_judged_by_number_rate_and_order(
    tmp_path: Path, wanted: dict[str, Any], changed: dict[str, Any], credit: str, words: str
) -> None:
    """Each wrong part costs its share.

    A field missing in the student's type is charged where the type is judged.
    """
    found = finding(tmp_path, "feedback", wanted, {**GOOD, **changed})
    assert found.credit == Decimal(credit)
    assert words in found.reason


def test_a_number_that_falls_once_does_not_rise(tmp_path: Path) -> None:
    """A single decrease is enough, and a value that is not a number does not rise."""
    unknown = [{"t_ns": at(1.0 + n), "values": {"share": math.nan}} for n in range(4)]
    assert (
        finding(
            tmp_path / "1", "feedback", {"rising": "share"}, {**GOOD, "feedback": unknown}
        ).credit
        < 1
    )
    feedback = []
    for n, share in enumerate((0.1, 0.5, 0.4, 1.0)):
        feedback.append({"t_ns": at(1.0 + n), "values": {"share": share}})
    found = finding(
        tmp_path,
        "feedback",
        {"rising": "share", "other_order_credit": "20%"},
        {**GOOD, "feedback": feedback},
    )
    assert found.credit == Decimal("0.2")


# -- results and statuses --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "tolerance", "credit", "words"),
    [
        ({"sequence": [0, 1, 1, 2, 3, 5]}, 0.0, "1", ""),
        (
            {"sequence": [0, 1, 1, 2, 3]},
            0.0,
            "0",
            "sequence is [0, 1, 1, 2, 3, 5], not [0, 1, 1, 2, 3]",
        ),
        ({"sequence[5]": 5, "took": 1.3}, 0.1, "1", ""),
        ({"sequence[5]": 5, "took": 1.3}, 0.01, "0.5", "In the result, took is 1.25, not 1.3."),
        ({"by.name": "it", "by": {"name": "it"}}, 0.0, "1", ""),
        (
            {"by.name": "other", "sequence[9]": 1},
            0.0,
            "0",
            "by.name is 'it', not 'other' and sequence[9] is None, not 1",
        ),
    ],
)
def test_results_are_compared_value_by_value(
    tmp_path: Path, values: dict[str, Any], tolerance: float, credit: str, words: str
) -> None:
    """Fields are named by paths, numbers may differ by the tolerance, and each value counts the same."""
    found = finding(tmp_path, "result", {"values": values, "tolerance": tolerance}, GOOD)
    assert found.credit == Decimal(credit)
    assert words in found.reason


def test_an_empty_result_is_told_so(tmp_path: Path) -> None:
    """A result of zeros or empty fields gets the hint to fill in the fields."""
    empty = {**GOOD, "result": {"sequence": []}}
    assert (
        "Fill in the fields"
        in finding(tmp_path, "result", {"values": {"sequence": [1]}}, empty).hint
    )


def test_a_result_that_never_came_is_not_an_end_that_never_came(tmp_path: Path) -> None:
    """By the status that the server published, the goal ended: then the result was not returned."""
    returned_nothing = {**ENDLESS, "status": "succeeded"}
    found = finding(tmp_path / "1", "result", {"values": {"sequence": [1]}}, returned_nothing)
    assert "ended as SUCCEEDED, but its result never came" in found.reason
    assert "`return result`" in found.hint
    assert finding(tmp_path / "2", "final_status", {}, returned_nothing).outcome is Outcome.PASSED
    found = finding(tmp_path / "3", "final_status", {}, ENDLESS)
    assert "did not end within 1.0 s (its status was EXECUTING)" in found.reason


@pytest.mark.parametrize(
    ("printed", "words", "hint"),
    [
        ("", "ended as ABORTED, not as SUCCEEDED", "goal_handle.succeed()"),
        (
            "Goal state not set, assuming aborted. Goal ID: [1 2]",
            "without setting a status",
            "goal_handle.succeed()",
        ),
        ("Error raised in execute callback: no", "The execute callback raised an exception", ""),
    ],
)
def test_who_forgets_to_succeed_is_told_so(
    tmp_path: Path, printed: str, words: str, hint: str
) -> None:
    """The output of rclpy tells the mistake."""
    session = (
        Session(tmp_path)
        .process(lines=[printed])
        .service(f"{NAME}/_action/send_goal", kind=f"{KIND}_SendGoal")
    )
    sent(session, "it", {**GOOD, "status": "aborted"})
    found = judged("action_server", {**ABOUT, "final_status": {"step": "it"}}, session)
    assert found.outcome is Outcome.FAILED
    assert words in found.reason
    assert hint in found.hint


# -- cancelled and preempted -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "credit", "words"),
    [
        (cancelled(), "1", ""),
        (cancelled(1.0), "1", ""),
        (
            cancelled(1.001),
            "0.5",
            "It ended 1.001 s after it was cancelled; within 1 s gives full credit",
        ),
        (cancelled(status="aborted"), "0.5", "ended as ABORTED, not as CANCELED"),
        (cancelled(3.0, "succeeded"), "0", "ended as SUCCEEDED, not as CANCELED"),
        (
            cancelled(3.0, "succeeded", accepted=False),
            "0",
            "Cancelling the goal order=5 was refused.",
        ),
        (
            cancelled(3.0, "succeeded", accepted=False, code=3),
            "0",
            "was not answered while it was under way",
        ),
        (
            {**cancelled(), "ended_ns": None, "status": "canceling"},
            "0",
            "did not end after it was cancelled",
        ),
        (GOOD, "0", "had ended as SUCCEEDED before it could be cancelled"),
        (ENDLESS, "0", "the moment at which the goal order=5 was to be cancelled never came"),
    ],
)
def test_cancelling_is_judged_by_answer_time_and_status(
    tmp_path: Path, goal: dict[str, Any], credit: str, words: str
) -> None:
    """A timely cancellation with status CANCELED earns full credit.

    Each half alone earns a part, and known mistakes are named from the recording.
    """
    found = finding(tmp_path, "cancelled", {}, goal)
    assert found.credit == Decimal(credit)
    assert words in found.reason


def test_a_server_that_is_blocked_or_refuses_is_told_how_to_fix_it(tmp_path: Path) -> None:
    """A blocked server and a refusing one have hints of their own."""
    blocked = cancelled(3.0, "succeeded", accepted=False, code=3)
    assert "MultiThreadedExecutor" in finding(tmp_path / "1", "cancelled", {}, blocked).hint
    assert (
        "CancelResponse.ACCEPT"
        in finding(tmp_path / "2", "cancelled", {}, cancelled(accepted=False)).hint
    )


NEWER = {**GOOD, "sent_ns": at(1.5), "answered_ns": at(1.51), "ended_ns": at(2.0)}


@pytest.mark.parametrize(
    ("first", "newer", "credit", "words"),
    [
        ({"ended_ns": at(1.6), "status": "aborted"}, {}, "1", ""),
        ({"ended_ns": at(1.505), "status": "aborted"}, {}, "1", ""),
        (
            {"ended_ns": at(2.6), "status": "aborted"},
            {},
            "0.5",
            "1.10 s after a newer one was sent",
        ),
        (
            {"ended_ns": at(1.6), "status": "aborted"},
            {"ended_ns": None, "status": "executing"},
            "0.5",
            "did not end",
        ),
        (
            {"ended_ns": at(1.6), "status": "aborted"},
            {"status": "aborted"},
            "0.5",
            "The newer goal ended as ABORTED.",
        ),
        ({"ended_ns": at(4.0)}, {}, "0", "ended as SUCCEEDED, not as ABORTED or CANCELED"),
        (
            {"ended_ns": at(4.0)},
            {"accepted": False},
            "0",
            "A newer goal is rejected while one is under way.",
        ),
        ({"ended_ns": at(4.0)}, {"accepted": None}, "0", "A newer goal was not answered."),
        (
            {"ended_ns": at(4.0)},
            {"answered_ns": at(4.0)},
            "0",
            "A newer goal was answered only after 2.50 s.",
        ),
    ],
)
def test_preempting_is_judged_by_both_goals(
    tmp_path: Path, first: dict[str, Any], newer: dict[str, Any], credit: str, words: str
) -> None:
    """The first has to leave soon, and the newer one to be carried out."""
    found = finding(tmp_path, "preempted", {}, {**GOOD, **first}, {**NEWER, **newer})
    assert found.credit == Decimal(credit)
    assert words in found.reason


def test_who_never_succeeds_is_not_charged_for_the_newer_goal(tmp_path: Path) -> None:
    """A wrong status costs points only in the part that asks for the status."""
    session = sent(
        offering(tmp_path), "it", {**GOOD, "status": "aborted"}, {**NEWER, "status": "aborted"}
    )
    assert (
        judged("action_server", {**ABOUT, "preempted": {"step": "it"}}, session).outcome
        is Outcome.PASSED
    )


def test_a_goal_that_ended_before_the_newer_one_could_be_sent_is_told_so(tmp_path: Path) -> None:
    """A goal that ended early left nothing to preempt."""
    assert "before it could be preempted" in finding(tmp_path, "preempted", {}, GOOD).reason


# -- the machine -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("part", "wanted", "goal"),
    [
        ("cancelled", {}, cancelled(1.2)),
        ("feedback", {"at_least_hz": 12}, GOOD),
    ],
)
def test_what_the_machine_may_have_delayed_is_undecided(
    tmp_path: Path, part: str, wanted: dict[str, Any], goal: dict[str, Any]
) -> None:
    """A delay at that time excuses the student; without a delay the finding costs points."""
    for delays, outcome in (
        ((), Outcome.PARTIAL),
        (((1.15, 0.1), (1.55, 0.3)), Outcome.INCONCLUSIVE),
    ):
        session = sent(offering(tmp_path / outcome.value), "it", goal)
        session.disturbed("it", *delays)
        found = judged("action_server", {**ABOUT, part: {"step": "it", **wanted}}, session)
        assert found.outcome is outcome
        assert ("Not your fault" in found.reason) == bool(delays)


@pytest.mark.parametrize("part", ["cancelled", "preempted"])
def test_a_goal_that_the_grader_asked_to_end_too_late_is_undecided(
    tmp_path: Path, part: str
) -> None:
    """A late cancellation or newer goal is undecided if the machine delayed the grader.

    Without such a delay the goal costs points.
    """
    for delays, outcome in (((), Outcome.FAILED), (((1.05, 0.45),), Outcome.INCONCLUSIVE)):
        session = sent(offering(tmp_path / outcome.value), "it", GOOD).disturbed("it", *delays)
        session.record.steps[-1].parameters |= {"cancel_after_s": 0.2, "newer_after_s": 0.2}
        assert judged("action_server", {**ABOUT, part: {"step": "it"}}, session).outcome is outcome


@pytest.mark.parametrize(("kind", "sent_goals"), [("wait_for", {}), ("send_goal", {"goals": []})])
def test_an_action_that_came_after_it_was_given_up_is_seen_again(
    tmp_path: Path, kind: str, sent_goals: dict[str, Any]
) -> None:
    """A late server may be the machine's doing, unless a goal was already sent to it."""
    session = Session(tmp_path / "late")
    session.step(kind, "it", "timeout", parameters={"action": NAME}, **sent_goals)
    session.record.graph.append(
        GraphSnapshot(at(9.0), services=[ServiceEndpoint(f"{NAME}/_action/send_goal", "", "")])
    )
    assert "/fibonacci came too late" in str(inconclusive_reason(session.recorded(), ()))
    session = sent(Session(tmp_path / "sent"), "it", SILENT, outcome="timeout")
    session.record.graph.append(
        GraphSnapshot(at(9.0), services=[ServiceEndpoint(f"{NAME}/_action/send_goal", "", "")])
    )
    assert inconclusive_reason(session.recorded(), ()) is None


# -- parameters and weights ------------------------------------------------------------------------


def test_parts_count_by_their_weights(tmp_path: Path) -> None:
    """A part with three times the weight costs three times as much."""
    session = sent(offering(tmp_path), "it", {**GOOD, "feedback_count": 0})
    wanted = {**ABOUT, "accepted": {"step": "it"}, "feedback": {"step": "it", "weight": 3.0}}
    assert judged("action_server", wanted, session).credit == Decimal("0.25")


def test_a_check_without_a_part_is_refused() -> None:
    """A check without a part could never fail."""
    with pytest.raises(ValidationError, match="at least one of offered, accepted"):
        ActionServer.model_validate(ABOUT)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["sequence", "x"]), inner, max_size=2)
    ),
    max_leaves=6,
)


@given(
    st.fixed_dictionaries(
        {
            "accepted": st.sampled_from([True, False, None]),
            "ended_ns": st.none() | st.integers(-(2**63), 2**63 - 1),
            "status": st.sampled_from(
                [None, "unknown", "executing", "succeeded", "canceled", "aborted"]
            ),
            "result": PLAIN,
            "feedback": st.lists(
                st.fixed_dictionaries({"t_ns": st.integers(-(2**63), 2**63 - 1), "values": PLAIN}),
                max_size=3,
            ),
            "feedback_count": st.integers(0, 2**40),
            "first_feedback_ns": st.integers(-(2**63), 2**63 - 1),
            "last_feedback_ns": st.integers(-(2**63), 2**63 - 1),
            "cancel": st.none()
            | st.fixed_dictionaries(
                {
                    "sent_ns": st.just(at(1.5)),
                    "answered_ns": st.none() | st.just(at(1.6)),
                    "accepted": st.booleans(),
                    "code": st.integers(-128, 127),
                }
            ),
        }
    )
)
def test_whatever_a_server_sends_is_judged(
    tmp_path_factory: pytest.TempPathFactory, sent_back: dict[str, Any]
) -> None:
    """Arbitrary values and times break no check, and earn no more than full credit."""
    goal = {**GOOD, **sent_back}
    goal["cancel"] = goal["cancel"] and {
        **goal["cancel"],
        "accepted": goal["cancel"]["answered_ns"] is not None,
    }
    session = sent(
        offering(tmp_path_factory.mktemp("any")), "it", goal, {**NEWER, "status": goal["status"]}
    )
    step = {"step": "it"}
    wanted = {
        **ABOUT,
        "accepted": step,
        "feedback": {**step, "at_least_hz": 3.0, "rising": "sequence", "falling": "x"},
        "result": {**step, "values": {"sequence": [1], "x": 1.5}},
        "final_status": step,
        "cancelled": step,
        "preempted": step,
    }
    found = judged("action_server", wanted, session)
    assert 0 <= found.credit <= 1
