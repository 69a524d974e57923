"""Lifecycle nodes: reached states and publications in each state; right, wrong and at the edge."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.result import Outcome
from tests.synthetic import Session, at, evenly, judged

TEXT, EVENT = "std_msgs/msg/String", "lifecycle_msgs/msg/TransitionEvent"
WANTED = [
    {"step": "configure", "state": "inactive"},
    {"step": "activate", "state": "active"},
    {"step": "deactivate", "state": "inactive"},
    {"step": "cleanup", "state": "unconfigured"},
]
LIFECYCLE: dict[str, Any] = {"process": "it", "transitions": WANTED}
PUBLISHED: dict[str, Any] = {**LIFECYCLE, "published": [{"topic": "/chatter", "at_least": 10}]}
#: When each transition is asked for.
ASKED = {"configure": 2.0, "activate": 4.0, "deactivate": 8.0, "cleanup": 10.0}


def asked(
    session: Session,
    label: str,
    before: str,
    after: str,
    *,
    success: bool = True,
    outcome: str = "done",
    node: str = "/talker",
) -> Session:
    """Add a step that asked for a transition."""
    called_s = ASKED[label]
    result = {"node": node, "before": before, "after": after, "success": success}
    times = {"called_ns": at(called_s), "answered_ns": at(called_s + 0.1)}
    session.step(
        "change_state",
        label,
        outcome,
        **({**result, **times} if outcome == "done" else {"problem": "x"}),
    )
    step = session.record.steps[-1]
    step.started_ns, step.ended_ns = at(called_s), at(called_s + 0.1)
    return session


def whole(folder: Path, *times_s: float) -> Session:
    """Record a node that goes all the way, and publishes at some times."""
    session = Session(folder).process("it")
    states = ["unconfigured", "inactive", "active", "inactive", "unconfigured"]
    for label, before, after in zip(ASKED, states[:-1], states[1:], strict=True):
        asked(session, label, before, after)
    return session.texts("/chatter", ["x"] * len(times_s), times_s)


ACTIVE = evenly(10, 3.8, 4.15)


def test_a_node_that_goes_all_the_way_passes(tmp_path: Path) -> None:
    """All states are reached, and messages come while it is active."""
    finding = judged("lifecycle", PUBLISHED, whole(tmp_path, *ACTIVE))
    assert (finding.outcome, finding.reason) == (Outcome.PASSED, "")
    assert (
        "/chatter: 0 messages while unconfigured, 0 messages while inactive, 39 messages while active"
        in finding.measured
    )


@pytest.mark.parametrize(
    ("times_s", "credit", "words"),
    [
        (ACTIVE, "1", ""),
        ([*ACTIVE, 8.14], "1", ""),  # on its way when it was deactivated
        ([*ACTIVE, 8.2], "0.625", "/chatter carries messages while the node is inactive too"),
        (evenly(10, 11.0, 0.5), "0.625", "while the node is unconfigured, inactive too"),
        (ACTIVE[:10], "1", ""),
        (ACTIVE[:9], "0.5", "On /chatter 9 messages came while the node was active."),
        ([], "0.5", "On /chatter 0 messages came"),
    ],
)
def test_messages_come_in_the_right_states_only(
    tmp_path: Path, times_s: list[float], credit: str, words: str
) -> None:
    """An ordinary publisher publishes in every state; one that on_activate() forgot publishes in none."""
    finding = judged("lifecycle", PUBLISHED, whole(tmp_path, *times_s))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason
    hints = {"0.625": "create_lifecycle_publisher()", "0.5": "super().on_activate(state)", "1": ""}
    assert hints[credit] in finding.hint


def test_silence_that_the_machine_caused_is_undecided(tmp_path: Path) -> None:
    """After a delay of most of the time, neither too few messages nor a late one prove anything."""
    delayed = whole(tmp_path, *ACTIVE[:9]).disturbed("it", (5.0, 2.9))
    assert judged("lifecycle", PUBLISHED, delayed).outcome is Outcome.INCONCLUSIVE
    late = whole(tmp_path / "late", *ACTIVE, 8.4).disturbed("it", (8.1, 0.25))
    assert judged("lifecycle", PUBLISHED, late).outcome is Outcome.INCONCLUSIVE


def test_each_time_in_a_state_is_judged_by_its_own_delays(tmp_path: Path) -> None:
    """A short stay that the machine delayed is undecided, even beside a long and calm one."""
    session = whole(tmp_path, *ACTIVE)
    asked(session, "activate", "unconfigured", "active")
    again = session.record.steps[-1]
    again.label, again.result["called_ns"], again.result["answered_ns"] = (
        "again",
        at(12.0),
        at(12.1),
    )
    session.record.ended_ns = at(13.0)
    assert (
        judged("lifecycle", PUBLISHED, session.disturbed("it", (12.1, 0.8))).outcome
        is Outcome.INCONCLUSIVE
    )


def test_another_lifecycle_node_does_not_count(tmp_path: Path) -> None:
    """The states of another lifecycle node are ignored."""
    session = asked(
        whole(tmp_path, *ACTIVE), "configure", "unconfigured", "inactive", node="/other"
    )
    other = session.record.steps.pop()
    other.label, other.result["called_ns"], other.result["answered_ns"] = "other", at(6.0), at(6.1)
    session.record.steps.insert(2, other)
    assert judged("lifecycle", PUBLISHED, session).outcome is Outcome.PASSED


def test_a_callback_that_raises_is_named(tmp_path: Path) -> None:
    """An error-processing event names the cause, and later transitions are not charged again."""
    session = Session(tmp_path).process("it")
    asked(session, "configure", "unconfigured", "unconfigured", success=False)
    asked(session, "activate", "unconfigured", "unconfigured", success=False)
    event = {"goal_state": {"label": "errorprocessing"}}
    session.typed("/talker/transition_event", EVENT, [event], [2.05])
    finding = judged("lifecycle", {**LIFECYCLE, "transitions": WANTED[:2]}, session)
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == (
        "After 'configure' the node is unconfigured, not inactive. Its callback raised an exception or returned ERROR."
    )
    assert "activate: not tested" in finding.measured


def test_a_callback_that_fails_costs_its_transition(tmp_path: Path) -> None:
    """A transition without the expected state has reported failure; the other transitions count."""
    session = Session(tmp_path).process("it")
    asked(session, "configure", "unconfigured", "inactive")
    asked(session, "activate", "inactive", "inactive", success=False)
    finding = judged("lifecycle", {**LIFECYCLE, "transitions": WANTED[:2]}, session)
    assert finding.credit == Decimal("0.5")
    assert finding.reason == "After 'activate' the node is inactive, not active."


@pytest.mark.parametrize(
    ("success", "after", "outcome"), [(False, "unconfigured", "passed"), (True, "active", "failed")]
)
def test_a_transition_can_be_expected_to_be_refused(
    tmp_path: Path, success: bool, after: str, outcome: str
) -> None:
    """An impossible transition leaves the state unchanged and reports no success."""
    session = asked(
        Session(tmp_path).process("it"), "activate", "unconfigured", after, success=success
    )
    wanted = [{"step": "activate", "state": "unconfigured", "succeeds": False}]
    assert (
        judged("lifecycle", {**LIFECYCLE, "transitions": wanted}, session).outcome.value == outcome
    )


def test_a_node_that_is_none_is_charged_once(tmp_path: Path) -> None:
    """An ordinary node has no such services; where an earlier step was not answered either, that one costs."""
    session = asked(Session(tmp_path).process("it"), "configure", "", "", outcome="timeout")
    asked(session, "activate", "", "", outcome="timeout")
    recorded = session.recorded()
    finding = judged("lifecycle", LIFECYCLE, recorded)
    assert (finding.outcome, finding.measured) == (Outcome.FAILED, "no answer")
    later = judged("lifecycle", {**LIFECYCLE, "transitions": WANTED[1:2]}, recorded)
    assert later.outcome is Outcome.NOT_REACHED
    assert '"configure" got no answer' in later.reason


def test_one_transition_without_an_answer_costs_that_one(tmp_path: Path) -> None:
    """The answered transitions count; a crash of the node is reported."""
    session = asked(
        Session(tmp_path / "slow").process("it"), "configure", "", "", outcome="timeout"
    )
    asked(session, "activate", "inactive", "active")
    finding = judged("lifecycle", {**LIFECYCLE, "transitions": WANTED[:2]}, session)
    assert (finding.credit, finding.reason) == (
        Decimal("0.5"),
        "The node did not answer 'configure'.",
    )
    error = ["ZeroDivisionError: division by zero"]
    session = Session(tmp_path / "ended").process(
        "it", error, interrupted_ns=None, ended_by="itself", exit_status=1
    )
    asked(session, "configure", "unconfigured", "inactive")
    asked(session, "activate", "", "", outcome="cancelled")
    finding = judged("lifecycle", {**LIFECYCLE, "transitions": WANTED[:2]}, session)
    assert (finding.credit, "already ended" in finding.reason) == (Decimal("0.5"), True)


def test_a_state_that_was_never_reached_is_charged_with_its_transition(tmp_path: Path) -> None:
    """Nothing can be published in a state that was never reached; this is not reported again."""
    session = asked(
        Session(tmp_path).process("it"), "configure", "unconfigured", "unconfigured", success=False
    )
    finding = judged("lifecycle", {**PUBLISHED, "transitions": WANTED[:1]}, session)
    assert finding.outcome is Outcome.FAILED
    assert "/chatter" not in finding.reason
