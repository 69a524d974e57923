"""A tool that compares QoS profiles, as Lab 09-01 checks it: its end, its traffic and its profiles."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from grader.recording.session import OutputLine
from grader.result import Finding, Outcome
from ros_bag.qos import Qos
from tests.synthetic import BEST_EFFORT, RELIABLE, Session, at, evenly, given, judged, submission

ENDS_BY_ITSELF = "reference/checks/qos_tool.py:ends_by_itself"
TOPICS_CARRY_TRAFFIC = "reference/checks/qos_tool.py:topics_carry_traffic"
QOS_PROFILES = "reference/checks/qos_tool.py:qos_profiles"
TOPIC = "/test_fast"
ENDS = {"artifact": "it", "step": "exit", "least_s": 8, "most_s": 16, "output": "Results"}
WANTED = {
    "topic": TOPIC,
    "reliability": "reliable",
    "durability": "volatile",
    "history": "keep_last",
    "depth": 10,
}
PROFILES = {"artifact": "it", "profiles": [WANTED]}
CLAIM = replace(RELIABLE, history="keep_last", depth=10)


# -- the end ---------------------------------------------------------------------------------------


def ended(folder: Path, after_s: float, *lines: str, **facts: Any) -> Finding:
    """Judge a program that ended by itself after a time."""
    how = {"interrupted_ns": None, "exited_ns": at(0.1 + after_s), "ended_by": "itself", **facts}
    return judged(ENDS_BY_ITSELF, ENDS, Session(folder).process("it", lines, **how))


def test_a_program_that_ends_with_results_passes(tmp_path: Path) -> None:
    """Results and an end in time earn all, and another exit status is noted only."""
    assert ended(tmp_path / "a", 10.2, "Results").outcome is Outcome.PASSED
    assert (
        ended(tmp_path / "b", 10.2, "Results", exit_status=1)
        .notes[0]
        .startswith("It does not end with")
    )


def test_an_end_at_ctrl_c_that_rclpy_turned_into_another_error_is_seen_again(
    tmp_path: Path,
) -> None:
    """An accident of rclpy at Ctrl-C does not fail a tool before its results, unless it repeats."""
    lines = ["RuntimeError: Unable to convert call argument '0' to Python object"]
    finding = ended(tmp_path, 22.0, *lines, interrupted_ns=at(22.1), ended_by="interrupt")
    assert (finding.outcome, finding.settled and finding.settled.outcome) == (
        Outcome.INCONCLUSIVE,
        Outcome.FAILED,
    )


@pytest.mark.parametrize(
    ("after_s", "lines", "facts", "credit", "words"),
    [
        (3.0, ["Results"], {}, "0.5", "after 3.0 s"),
        (10.0, [], {}, "0", "in time, and printed nothing"),
        (10.0, ["Ergebnis"], {}, "0.5", "nothing that it printed could be read as results"),
        (
            1.0,
            ["Traceback (most recent call last):", "    Results()", "NameError: Results"],
            {},
            "0",
            "NameError",
        ),
        (
            22.0,
            ["Results"],
            {"interrupted_ns": at(22.1), "ended_by": "interrupt"},
            "0.5",
            "had to be stopped",
        ),
        (
            22.0,
            [],
            {"interrupted_ns": at(22.1), "ended_by": "kill"},
            "0",
            "still running after 22 s",
        ),
    ],
)
def test_each_other_end_is_distinguished(
    tmp_path: Path, after_s: float, lines: list[str], facts: dict[str, Any], credit: str, words: str
) -> None:
    """Ending well and having results are half each."""
    finding = ended(tmp_path, after_s, *lines, **facts)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_results_between_the_lines_of_a_traceback_count(tmp_path: Path) -> None:
    """A traceback on one stream takes nothing from the lines printed on the other meanwhile."""
    session = Session(tmp_path).process(
        "it", ["Results"], interrupted_ns=None, exited_ns=at(10.3), ended_by="itself"
    )
    session.record.processes[0].output[:0] = [
        OutputLine(at(0.1), "stderr", "Traceback (most recent call last):")
    ]
    assert judged(ENDS_BY_ITSELF, ENDS, session).outcome is Outcome.PASSED


def test_a_program_that_was_not_started_decides_nothing(tmp_path: Path) -> None:
    """Without its process the recording cannot answer; without its file the check fails."""
    assert judged(ENDS_BY_ITSELF, ENDS, Session(tmp_path)).outcome is Outcome.INCONCLUSIVE
    assert (
        judged(ENDS_BY_ITSELF, ENDS, Session(tmp_path), submission(it=None)).outcome
        is Outcome.FAILED
    )


# -- traffic ---------------------------------------------------------------------------------------


def test_each_topic_with_traffic_is_a_part(tmp_path: Path) -> None:
    """One of two topics with enough messages earns half, counted by sequence numbers."""
    session = Session(tmp_path).messages("/a", [[0.0]] * 2, [1.0, 2.0], sequence=[1, 200])
    session.messages("/b", [[0.0]] * 3, [1.0, 2.0, 3.0])
    finding = judged(TOPICS_CARRY_TRAFFIC, {"topics": ["/a", "/b"], "least_messages": 100}, session)
    assert finding.credit == Decimal("0.5")
    assert (
        finding.reason
        == "Nothing subscribes to /a. Nothing subscribes to /b. Too few messages arrived on /b."
    )


def test_what_nothing_hears_is_not_received(tmp_path: Path) -> None:
    """A topic without a compatible subscription keeps the credit that the rubric leaves."""
    parameters = {"topics": ["/a"], "least_messages": 2, "unheard_credit": 0.25}
    for name, offered, requested, credit in (
        ("none", RELIABLE, None, "0.25"),
        ("clash", BEST_EFFORT, RELIABLE, "0.25"),
        ("fits", RELIABLE, RELIABLE, "1"),
    ):
        session = (
            Session(tmp_path / name)
            .messages("/a", [[0.0]] * 2, [1.0, 2.0])
            .endpoint("publisher", "/a", qos=offered)
        )
        if requested is not None:
            session.endpoint("subscription", "/a", qos=requested)
        assert judged(TOPICS_CARRY_TRAFFIC, parameters, session).credit == Decimal(credit)


def test_too_little_traffic_earns_its_share(tmp_path: Path) -> None:
    """Half of the messages are half of the topic, in tenths; under another name half of that is lost."""
    session = Session(tmp_path).messages("/a", [[0.0]] * 2, [1.0, 2.0], sequence=[1, 55])
    wanted = {"topics": ["/a"], "least_messages": 100}
    assert judged(TOPICS_CARRY_TRAFFIC, wanted, session).credit == Decimal("0.5")
    renamed = (
        Session(tmp_path, "renamed")
        .messages("/x", [[0.0]] * 2, [1.0, 2.0], sequence=[1, 200])
        .called("/a=/x")
    )
    assert judged(TOPICS_CARRY_TRAFFIC, wanted, renamed).credit == Decimal("0.5")


@pytest.mark.parametrize(
    ("delay_s", "outcome"), [(3.0, Outcome.INCONCLUSIVE), (0.1, Outcome.PARTIAL)]
)
def test_a_tool_that_had_no_core_may_have_sent_more(
    tmp_path: Path, delay_s: float, outcome: Outcome
) -> None:
    """Timers skip the periods without a core."""
    session = (
        Session(tmp_path)
        .process("it", started_ns=at(0.0), exited_ns=at(10.0))
        .delayed("it", delay_s, 10.0)
    )
    session.messages(TOPIC, [[0.0]] * 200, evenly(20, 9.95))
    assert (
        judged(TOPICS_CARRY_TRAFFIC, {"topics": [TOPIC], "least_messages": 400}, session).outcome
        is outcome
    )


# -- profiles --------------------------------------------------------------------------------------


def profiled(
    folder: Path,
    qos: Qos,
    claim: Qos | None = CLAIM,
    kinds: tuple[str, ...] = ("publisher", "subscription"),
) -> Finding:
    """Judge a topic with this QoS on both sides in the graph, and a requested one in the source."""
    session = Session(folder)
    for kind in kinds:
        session.endpoint(kind, TOPIC, qos=qos)
        if claim is not None:
            session.claim(kind, TOPIC, qos=claim)
    return judged(QOS_PROFILES, PROFILES, session)


def test_a_profile_as_asked_passes(tmp_path: Path) -> None:
    """All four policies right earn all."""
    assert profiled(tmp_path, RELIABLE).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("qos", "claim", "credit", "words"),
    [
        (BEST_EFFORT, CLAIM, "0.75", "reliability best_effort, not reliable"),
        (RELIABLE, replace(CLAIM, depth=1), "0.75", "depth 1, not 10"),
        (RELIABLE, replace(CLAIM, history="keep_all", depth=0), "0.5", "history keep_all"),
    ],
)
def test_each_policy_is_a_part(
    tmp_path: Path, qos: Qos, claim: Qos, credit: str, words: str
) -> None:
    """A wrong policy costs a quarter."""
    finding = profiled(tmp_path, qos, claim)
    assert finding.credit == Decimal(credit)
    assert words in finding.reason


def test_a_history_that_nobody_knows_is_left_to_a_person(tmp_path: Path) -> None:
    """Discovery does not carry it; where the tap noted nothing, nothing is guessed."""
    finding = profiled(tmp_path, RELIABLE, None)
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert "history and depth" in finding.reason


def test_a_side_that_is_missing_costs_half(tmp_path: Path) -> None:
    """A publisher without a subscription shows half of the profile."""
    finding = profiled(tmp_path, RELIABLE, kinds=("publisher",))
    assert finding.credit == Decimal("0.5")
    assert f"no subscription on {TOPIC}" in finding.reason


def test_sides_that_differ_are_distinguished(tmp_path: Path) -> None:
    """Where only the subscription is wrong, reason and measurement say so."""
    session = (
        Session(tmp_path)
        .endpoint("publisher", TOPIC)
        .endpoint("subscription", TOPIC, qos=BEST_EFFORT)
        .process()
    )
    finding = judged(QOS_PROFILES, PROFILES, session)
    assert (
        finding.reason == f"The subscription on {TOPIC} has reliability best_effort, not reliable."
    )
    assert "publisher reliable" in finding.measured
    assert "subscription best_effort" in finding.measured


@pytest.mark.parametrize(("kept", "credit"), [(0, "0"), (1, "0.875")])
def test_a_profile_whose_sides_cannot_connect_compares_nothing(
    tmp_path: Path, kept: int, credit: str
) -> None:
    """A subscription that requests more than is offered keeps the credit that the rubric leaves."""
    session = Session(tmp_path).endpoint("publisher", TOPIC, qos=BEST_EFFORT)
    session.endpoint("subscription", TOPIC)
    for kind in ("publisher", "subscription"):
        session.claim(kind, TOPIC, qos=CLAIM)
    wanted = {**PROFILES, "unmatched_credit": kept}
    assert judged(QOS_PROFILES, wanted, session).credit == Decimal(credit)


@pytest.mark.parametrize(("least", "credit"), [(0.5, "0.5"), (0.75, "0")])
def test_too_few_profiles_that_carry_messages_compare_nothing(
    tmp_path: Path, least: float, credit: str
) -> None:
    """With half of the profiles dead, the other half earns its credit only if the rubric says so."""
    session = Session(tmp_path)
    for topic, offered in ((TOPIC, RELIABLE), ("/test_slow", BEST_EFFORT)):
        session.endpoint("publisher", topic, qos=offered).endpoint("subscription", topic)
        for kind in ("publisher", "subscription"):
            session.claim(kind, topic, qos=CLAIM)
    first: Any = PROFILES["profiles"][0]
    profiles = [first, {**first, "topic": "/test_slow"}]
    wanted = {**PROFILES, "profiles": profiles, "unmatched_credit": 0, "least_matched": least}
    finding = judged(QOS_PROFILES, wanted, session)
    assert finding.credit == Decimal(credit)
    assert ("on 1 of 2 topics" in finding.reason) == (credit == "0")


@pytest.mark.parametrize(
    ("first", "second", "credit"),
    [
        (BEST_EFFORT, RELIABLE, "0"),
        (RELIABLE, RELIABLE, "0.875"),
        (RELIABLE, BEST_EFFORT, "1"),
    ],
)
def test_swapped_profiles_show_the_opposite_of_their_names(
    tmp_path: Path, first: Qos, second: Qos, credit: str
) -> None:
    """One policy that is wrong in one direction is no swap."""
    session = Session(tmp_path)
    for topic, offered in ((TOPIC, first), ("/test_lossy", second)):
        for kind in ("publisher", "subscription"):
            session.endpoint(kind, topic, qos=offered)
            session.claim(kind, topic, qos=CLAIM)
    wanted: Any = PROFILES["profiles"][0]
    profiles = [wanted, {**wanted, "topic": "/test_lossy", "reliability": "best_effort"}]
    rules = {**PROFILES, "profiles": profiles, "swapped_credit": 0, "least_matched": 0.75}
    finding = judged(QOS_PROFILES, rules, session)
    assert finding.credit == Decimal(credit)
    assert ("are swapped" in finding.reason) == (credit == "0")


def test_no_endpoint_earns_nothing(tmp_path: Path) -> None:
    """A topic that is not there has no profile."""
    assert profiled(tmp_path, RELIABLE, kinds=()).outcome is Outcome.FAILED


def test_a_side_that_was_made_and_never_seen_is_undecided(tmp_path: Path) -> None:
    """Discovery may have failed if a tool's publisher was seen, but not its noted subscription."""
    session = Session(tmp_path).endpoint("publisher", TOPIC).claim("publisher", TOPIC, qos=CLAIM)
    session.claim("subscription", TOPIC, qos=CLAIM).process()
    finding = judged(QOS_PROFILES, PROFILES, session)
    assert finding.outcome is Outcome.INCONCLUSIVE
    # The tap's note can be forged, and the graph shows the same in every recording.
    assert finding.settled is not None
    assert finding.settled.outcome is Outcome.PARTIAL


def test_a_pattern_that_does_not_compile_is_a_mistake_of_the_rubric() -> None:
    """A wrong regular expression is refused when the rubric loads."""
    with pytest.raises(ValidationError, match="not a valid regular expression"):
        given(ENDS_BY_ITSELF, {**ENDS, "output": "("})
