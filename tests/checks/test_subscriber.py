"""Checks of a node that listens: its subscriptions and its survival, and faults of the machine."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.recording.session import Endpoint, GraphSnapshot
from grader.result import Outcome
from ros_bag.qos import Qos
from tests.synthetic import BEST_EFFORT, FLOATS, RELIABLE, Session, at, judged, submission

COMMAND, STATE = "/commands", "/states"
SUBSCRIBED: dict[str, Any] = {
    "artifact": "it",
    "node": "/student",
    "topics": [{"topic": COMMAND, "type": FLOATS}, {"topic": STATE, "type": FLOATS}],
}
# -- subscriptions ---------------------------------------------------------------------------------


def subscribed(folder: Path, qos: Any = RELIABLE, state: str = STATE, **how: str) -> Session:
    """Make a session with two subscriptions, the second as told."""
    session = (
        Session(folder)
        .endpoint("subscription", COMMAND)
        .process("it", interrupted_ns=None, exited_ns=None)
    )
    return session.endpoint("subscription", state, qos=qos, **how)


def test_two_subscriptions_as_asked_pass(tmp_path: Path) -> None:
    """Topics, types and QoS as asked earn all."""
    assert judged("topics_subscribed", SUBSCRIBED, subscribed(tmp_path)).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("qos", "policy"),
    [
        (replace(RELIABLE, durability="transient_local"), "durability"),
        (replace(RELIABLE, deadline_ns=10_000_000), "deadline"),
        (replace(RELIABLE, liveliness="manual_by_topic"), "liveliness"),
    ],
)
def test_a_request_that_nobody_offers_costs_a_part(tmp_path: Path, qos: Any, policy: str) -> None:
    """A node that can hear nothing on one topic loses 60 %, and the policy is named."""
    finding = judged("topics_subscribed", SUBSCRIBED, subscribed(tmp_path, qos))
    assert finding.credit == Decimal("0.4")
    assert f"incompatible in {policy}" in finding.reason


def test_a_weaker_request_is_compatible(tmp_path: Path) -> None:
    """Best effort is requested from a reliable publisher without loss of points."""
    assert (
        judged("topics_subscribed", SUBSCRIBED, subscribed(tmp_path, BEST_EFFORT)).outcome
        is Outcome.PASSED
    )


def test_a_weaker_request_than_the_lab_asks_for_is_noted(tmp_path: Path) -> None:
    """If the rubric asks for reliable, a best effort request gets a note, and loses nothing."""
    wanted = {**SUBSCRIBED, "reliability": "reliable"}
    finding = judged("topics_subscribed", wanted, subscribed(tmp_path, BEST_EFFORT))
    assert finding.outcome is Outcome.PASSED
    assert [STATE in note for note in finding.notes] == [True]
    assert judged("topics_subscribed", wanted, subscribed(tmp_path / "other")).notes == ()


def test_reliable_is_too_much_for_a_best_effort_offer(tmp_path: Path) -> None:
    """A reliable request clashes with a best effort offer on the rubric's other side."""
    wanted = {**SUBSCRIBED, "offered": {"reliability": "best_effort"}}
    finding = judged("topics_subscribed", wanted, subscribed(tmp_path))
    assert "RELIABLE is requested, BEST_EFFORT offered" in finding.reason


def test_a_misspelt_topic_and_a_wrong_type_are_reported(tmp_path: Path) -> None:
    """The name that the student used and the type are named."""
    session = subscribed(tmp_path, state="/state", topic_type="std_msgs/msg/String").called(
        f"{STATE}=/state"
    )
    finding = judged("topics_subscribed", SUBSCRIBED, session)
    assert finding.credit == Decimal("0.4")
    assert "/state, not /states" in finding.reason


def test_a_topic_in_the_namespace_of_its_node_is_reported(tmp_path: Path) -> None:
    """A relative name in a namespace costs as much as any wrong name.

    The reason names the namespace.
    """
    session = subscribed(tmp_path, state=f"/arm{STATE}", node="/arm/student").called(
        f"{STATE}=/arm{STATE}"
    )
    finding = judged("topics_subscribed", SUBSCRIBED, session)
    assert finding.credit == Decimal("0.4")
    assert "in its node's namespace, /arm." in finding.reason


def test_no_subscription_at_all_fails(tmp_path: Path) -> None:
    """A node that subscribes to nothing, or ends by itself, is told so."""
    session = Session(tmp_path).process("it", interrupted_ns=None, ended_by="itself", exit_status=0)
    finding = judged("topics_subscribed", SUBSCRIBED, session)
    assert finding.outcome is Outcome.FAILED
    assert "exit status 0 after" in finding.reason


def test_a_wrong_node_name_costs_a_fifth(tmp_path: Path) -> None:
    """Another node name is named with the one asked for."""
    session = (
        Session(tmp_path)
        .endpoint("subscription", COMMAND, "/x")
        .endpoint("subscription", STATE, "/x")
    )
    finding = judged("topics_subscribed", SUBSCRIBED, session)
    assert finding.credit == Decimal("0.8")
    assert "/x, not /student" in finding.reason


# -- survival --------------------------------------------------------------------------------------


def test_a_node_that_went_on_survives(tmp_path: Path) -> None:
    """A process that only ended at Ctrl-C has survived."""
    session = Session(tmp_path).process().step("publish", "early")
    assert (
        judged("survives", {"artifact": "it", "step": "early"}, session).outcome is Outcome.PASSED
    )


def test_a_node_that_died_at_the_step_fails(tmp_path: Path) -> None:
    """A process that ended by itself, and had to be started again, has not."""
    session = Session(tmp_path).process(
        "it", interrupted_ns=None, exited_ns=1_800_000_003_000_000_000, exit_status=1
    )
    session.process("it", started_ns=1_800_000_005_000_000_000).step("publish", "early")
    finding = judged("survives", {"artifact": "it", "step": "early"}, session)
    assert finding.outcome is Outcome.FAILED
    assert finding.measured == "it ended with status 1 at 3.00 s"


def test_what_ends_a_node_later_is_no_matter_of_the_step(tmp_path: Path) -> None:
    """A process that ended after a later step began has survived this one."""
    session = Session(tmp_path).step("publish", "early").step("start", "later")
    session.record.steps[-1].started_ns = at(2.0)
    session.process("it", interrupted_ns=None, exited_ns=at(3.0), exit_status=1)
    wanted = {"artifact": "it", "step": "early"}
    assert judged("survives", wanted, session).outcome is Outcome.FAILED
    assert judged("survives", {**wanted, "until": "later"}, session).outcome is Outcome.PASSED
    session.record.processes[0].exited_ns = at(1.5)
    assert judged("survives", {**wanted, "until": "later"}, session).outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("time_s", "line", "credit"),
    [
        (1.5, "RMS: 0.1852 rad", "0.5"),
        (2.5, "RMS: 0.1852 rad", "1"),
        (1.5, "No command yet, so no RMS error of the 7 joints", "1"),
    ],
)
def test_a_report_before_it_can_be_made_costs_a_part(
    tmp_path: Path, time_s: float, line: str, credit: str
) -> None:
    """A node that invents its reference value goes on, but reports too early.

    A node that explains the wait does not.
    """
    session = Session(tmp_path).step("publish", "early").step("start", "later")
    session.record.steps[-1].started_ns = at(2.0)
    session.process("it", [(time_s, line), (3.0, "RMS: 0.2000 rad")])
    wanted = {"artifact": "it", "step": "early", "until": "later", "quiet": r"RMS[^\d]*([\d.]+)"}
    finding = judged("survives", wanted, session)
    assert finding.credit == Decimal(credit)
    assert ("At 1.5 s it reports 0.1852" in finding.reason) == (credit != "1")


def test_a_step_that_was_not_reached_decides_nothing(tmp_path: Path) -> None:
    """Without the step, the recording does not show the node's behaviour."""
    session = Session(tmp_path).process()
    assert (
        judged("survives", {"artifact": "it", "step": "early"}, session).outcome
        is Outcome.INCONCLUSIVE
    )


def test_a_missing_subscriber_fails(tmp_path: Path) -> None:
    """Without the file the first check fails."""
    finding = judged("topics_subscribed", SUBSCRIBED, Session(tmp_path), submission(it=None))
    assert finding.outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("matched", "topic_type", "outcome"),
    [
        (False, FLOATS, Outcome.INCONCLUSIVE),
        (True, FLOATS, Outcome.PASSED),
        (False, "other/msg/Type", Outcome.PASSED),
    ],
)
def test_a_node_that_got_nothing_has_not_survived_it(
    tmp_path: Path, matched: bool, topic_type: str, outcome: Outcome
) -> None:
    """After a late discovery nothing shows the node's behaviour.

    Another type is charged elsewhere.
    """
    session = Session(tmp_path).process().endpoint("subscription", STATE, topic_type=topic_type)
    session.step("publish", "early", matched=matched, parameters={"topic": STATE, "type": FLOATS})
    assert judged("survives", {"artifact": "it", "step": "early"}, session).outcome is outcome


@pytest.mark.parametrize(("launched_as", "rest"), [("/other", "0.6"), (STATE, None)])
def test_a_node_that_hears_nothing_loses_of_the_rest(
    tmp_path: Path, launched_as: str, rest: str | None
) -> None:
    """Only a launch file that gives it the right topics keeps the rest whole."""
    session = Session(tmp_path).endpoint("subscription", COMMAND).process("it")
    launched = Session(tmp_path, "launch").endpoint("subscription", COMMAND)
    launched.endpoint("subscription", launched_as)
    wanted = {**SUBSCRIBED, "rest": 0.6, "launched_in": "launch"}
    others = {"launch": launched.recorded()}
    finding = judged("topics_subscribed", wanted, session, others=others)
    expected = None if rest is None else Decimal(rest)
    assert finding.passes_on == expected


@pytest.mark.parametrize(("launch", "rest"), [("it", None), ("start", Decimal("0.6"))])
def test_a_missing_launch_file_repairs_no_subscriptions(
    tmp_path: Path, launch: str, rest: Decimal | None
) -> None:
    """Without its session, a launch file that is there may repair them."""
    session = Session(tmp_path).endpoint("subscription", COMMAND).process("it")
    wanted = {**SUBSCRIBED, "rest": 0.6, "launched_in": "launch", "launched_by": launch}
    finding = judged("topics_subscribed", wanted, session, submission({"it.py": ""}))
    assert finding.passes_on == rest


@pytest.mark.parametrize(
    ("asked", "outcome"), [(STATE, Outcome.INCONCLUSIVE), ("/other", Outcome.PARTIAL)]
)
def test_one_subscription_that_was_made_and_never_seen_is_undecided(
    tmp_path: Path, asked: str, outcome: Outcome
) -> None:
    """The running node asked for the subscription, so the discovery may have failed."""
    session = (
        Session(tmp_path)
        .endpoint("subscription", COMMAND)
        .process("it")
        .claim("subscription", asked)
    )
    assert judged("topics_subscribed", SUBSCRIBED, session).outcome is outcome


# -- a program that starts its node again ----------------------------------------------------------


def listening(folder: Path, *snapshots: tuple[float, tuple[str, ...]]) -> Session:
    """Make a session with subscriptions of one node that come and go in the graph."""
    session = Session(folder).process(
        "it", ["Traceback (most recent call last):", "TypeError: None"]
    )
    session.record.graph.clear()
    for time_s, gids in snapshots:
        there = []
        for gid in gids:
            there.append(
                Endpoint("subscription", STATE, FLOATS, "", "/student", gid * 32, RELIABLE)
            )
        session.record.graph.append(GraphSnapshot(at(time_s), ["/student"] if there else [], there))
    session.step("publish", "early", parameters={"topic": STATE, "type": FLOATS}, matched=True)
    return session.step("start", "stimulus")


@pytest.mark.parametrize(
    ("later", "survived"),
    [
        ([(1.5, "a")], True),
        ([(1.5, ""), (2.5, "b")], False),
        ([(1.5, "ab")], False),
        ([(1.5, "")], False),
        ([(4.5, "")], True),
    ],
    ids=[
        "it stays",
        "it comes back",
        "it comes back beside what it left",
        "it is gone",
        "it goes later",
    ],
)
def test_a_program_outlives_its_node_only_with_it(
    tmp_path: Path, later: list[tuple[float, str]], survived: bool
) -> None:
    """A program that goes on without its node, or restarts it, has not survived.

    Later events do not matter.
    """
    session = listening(tmp_path, (0.5, ("a",)), *((time_s, tuple(gids)) for time_s, gids in later))
    session.record.steps[-1].started_ns = at(4.0)
    finding = judged("survives", {"artifact": "it", "step": "early", "until": "stimulus"}, session)
    assert finding.outcome is (Outcome.PASSED if survived else Outcome.FAILED)
    if not survived:
        assert "its node ended before" in finding.measured
        assert "TypeError" in finding.reason


# -- the profile that is requested -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("qos", "credit"),
    [
        (RELIABLE, "1"),
        (BEST_EFFORT, "0.5"),
        (replace(BEST_EFFORT, durability="transient_local"), "0"),
    ],
)
def test_a_subscription_requests_the_profile_that_is_asked_for(
    tmp_path: Path, qos: Qos, credit: str
) -> None:
    """Each policy counts the same; another endpoint's on the topic does not."""
    session = (
        Session(tmp_path)
        .endpoint("subscription", "/in", qos=qos)
        .endpoint("publisher", "/in", qos=BEST_EFFORT)
    )
    wanted = {"topic": "/in", "reliability": "reliable", "durability": "volatile"}
    finding = judged("requested_qos", wanted, session)
    assert finding.credit == Decimal(credit)
    assert (
        credit == "1"
        or "The subscription requests BEST_EFFORT reliability, not RELIABLE." in finding.reason
    )


def test_without_a_subscription_there_is_no_request(tmp_path: Path) -> None:
    """A publisher on the topic is none."""
    session = Session(tmp_path).endpoint("publisher", "/in")
    assert (
        judged("requested_qos", {"topic": "/in", "reliability": "reliable"}, session).outcome
        is Outcome.FAILED
    )
