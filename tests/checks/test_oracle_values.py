"""Published values against an oracle: by stamp, order and time; known mistakes; lost messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.result import Finding, Outcome
from ros_bag.qos import Qos
from tests.synthetic import START_NS, Session, at, judged

STAMPED, FLOAT = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Float64"
ORACLES = "tests/checks/made_up_oracles.py"
BY_STAMP = {
    "topic": "/out",
    "field": "point.x",
    "streams": {"input": {"topic": "/in", "field": "point.x"}},
    "oracle": f"{ORACLES}:scaled",
    "for_each": "input",
    "match": "stamp",
    "tolerance": 0.01,
    "alternatives": [{"parameters": {"factor": 1.0}, "meaning": "the input itself", "credit": 0.3}],
}
IN_ORDER = {
    **BY_STAMP,
    "field": "data",
    "match": "order",
    "streams": {"input": {"topic": "/in", "field": "data"}},
}
BY_TIME = {
    **IN_ORDER,
    "oracle": f"{ORACLES}:sine",
    "for_each": None,
    "match": "interpolated",
    "within_s": 0.02,
    "alternatives": [],
}
COUNT = 100


def stamped(x: float, time_s: float) -> dict[str, Any]:
    """Give a message with its stamp."""
    since = at(time_s) - START_NS
    return {
        "header": {"stamp": {"sec": since // 10**9, "nanosec": since % 10**9}},
        "point": {"x": x},
    }


def answered(folder: Path, answer: Callable[[int], float | None], lag_s: float = 0.002) -> Session:
    """Make a session with a node that answers 100 inputs at 20 Hz, each with a number or not."""
    times = [1.0 + n / 20 for n in range(COUNT)]
    answers = [(answer(n), t) for n, t in enumerate(times)]
    sent = [(x, t) for x, t in answers if x is not None]
    session = Session(folder).process(interrupted_ns=at(6.2))
    session.typed("/in", STAMPED, [stamped(float(n), t) for n, t in enumerate(times)], times)
    return session.typed(
        "/out", STAMPED, [stamped(x, t) for x, t in sent], [t + lag_s for _, t in sent]
    )


def by_stamp(folder: Path, answer: Callable[[int], float | None], **more: Any) -> Finding:
    """Judge answers by their stamps."""
    return judged("topic_equals_oracle", {**BY_STAMP, **more}, answered(folder, answer))


def test_right_answers_pass(tmp_path: Path) -> None:
    """Right answers are twice their input, within one hundredth."""
    assert by_stamp(tmp_path / "a", lambda n: 2.0 * n).outcome is Outcome.PASSED
    assert by_stamp(tmp_path / "b", lambda n: 2.0 * n + 0.0099).outcome is Outcome.PASSED


def test_the_first_wrong_message_is_shown_with_what_is_right(tmp_path: Path) -> None:
    """One in four is off by a little too much."""
    finding = by_stamp(tmp_path, lambda n: 2.0 * n + 0.011 * (n % 4 == 3))
    assert finding.credit == Decimal("0.7")
    assert finding.measured == "75 of 100 messages right"
    assert finding.reason == "At 1.15 s it publishes 6.011; right is 6."


def test_what_is_relative_grows_with_the_value(tmp_path: Path) -> None:
    """1 % of 2·n."""
    assert by_stamp(tmp_path / "a", lambda n: 2.019 * n, relative="1%").outcome is Outcome.PASSED
    assert (
        by_stamp(tmp_path / "b", lambda n: 2.022 * n, relative="1%").outcome is not Outcome.PASSED
    )


def test_missing_and_superfluous_messages_count(tmp_path: Path) -> None:
    """An unanswered input counts as missing, and a second answer as superfluous."""
    finding = by_stamp(tmp_path / "missing", lambda n: 2.0 * n if n % 10 or not n else None)
    assert (finding.measured, finding.credit) == (
        "91 of 100 messages right, 9 missing",
        Decimal("0.9"),
    )
    session = answered(tmp_path / "twice", lambda n: 2.0 * n)
    again = [stamped(2.0 * n, 1.0 + n / 20) for n in range(50)]
    session.typed("/out", STAMPED, again, [6.0 + n / 100 for n in range(50)])
    finding = judged("topic_equals_oracle", BY_STAMP, session)
    assert "100 of 150 messages right, 50 superfluous" in finding.measured


def test_who_stops_answering_is_not_excused(tmp_path: Path) -> None:
    """Half of the messages have no answer."""
    assert by_stamp(tmp_path, lambda n: 2.0 * n if n < 50 else None).credit == Decimal("0.5")


def test_who_begins_late_is_for_a_moment(tmp_path: Path) -> None:
    """A subscription that is matched late misses the first ones; not more than 2 s of them."""
    assert (
        by_stamp(tmp_path / "a", lambda n: 2.0 * n if n >= 10 else None).outcome is Outcome.PASSED
    )
    assert by_stamp(tmp_path / "b", lambda n: 2.0 * n if n >= 80 else None).credit < Decimal("0.5")


def test_a_known_mistake_is_named_and_earns_its_credit(tmp_path: Path) -> None:
    """Other parameters of the oracle explain the numbers."""
    finding = by_stamp(tmp_path, float)
    assert finding.credit == Decimal("0.3")
    assert finding.reason.endswith("Your numbers match the input itself.")


def test_what_the_machine_kept_from_the_node_is_in_doubt(tmp_path: Path) -> None:
    """Answers that are missing while the node was delayed for a second, with a queue of one, may be the machine's."""
    session = answered(tmp_path, lambda n: 2.0 * n if not 20 <= n < 40 else None).disturbed(
        "it", (2.0, 1.0)
    )
    session.claim("subscription", "/in", qos=Qos("reliable", "volatile", depth=1))
    finding = judged("topic_equals_oracle", BY_STAMP, session)
    assert finding.outcome is Outcome.INCONCLUSIVE
    assert finding.reason.startswith("Not your fault")


def test_wrong_values_are_never_the_machine_s(tmp_path: Path) -> None:
    """Numbers that answer a stamp are the node's own."""
    session = answered(tmp_path, lambda n: 3.0 * n).disturbed("it", (2.0, 0.5))
    assert judged("topic_equals_oracle", BY_STAMP, session).outcome is Outcome.FAILED


def plain(
    folder: Path, values: Sequence[float], out_times: Sequence[float], sequence_from: int = 0
) -> Session:
    """Make a session of plain numbers: inputs 0, 1, 2 ... at 20 Hz, and a node's."""
    times = [1.0 + n / 20 for n in range(COUNT)]
    session = Session(folder).process(interrupted_ns=at(6.2))
    session.typed("/in", FLOAT, [{"data": float(n)} for n in range(COUNT)], times)
    return session.typed("/out", FLOAT, [{"data": v} for v in values], out_times)


def test_in_order_the_nth_answers_the_nth_and_it_may_begin_late(tmp_path: Path) -> None:
    """The start that fits best counts."""
    for first in (0, 7):
        times = [1.001 + n / 20 for n in range(first, COUNT)]
        session = plain(tmp_path / str(first), [2.0 * n for n in range(first, COUNT)], times)
        assert judged("topic_equals_oracle", IN_ORDER, session).outcome is Outcome.PASSED
    session = plain(
        tmp_path / "wrong",
        [2.0 * n for n in range(COUNT)][::-1],
        [1.001 + n / 20 for n in range(COUNT)],
    )
    assert judged("topic_equals_oracle", IN_ORDER, session).outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("late_s", "outcome"), [(0.0, Outcome.PASSED), (0.02, Outcome.PASSED), (0.2, Outcome.FAILED)]
)
def test_at_its_time_a_value_may_be_a_little_old(
    tmp_path: Path, late_s: float, outcome: Outcome
) -> None:
    """sin(t - 0.02) is right where values may be 0.02 s old, and sin(t - 0.2) is not."""
    times = [1.5 + n / 7.3 for n in range(30)]
    session = plain(tmp_path, [math.sin(t - 1.0 - late_s) for t in times], times)
    finding = judged(
        "topic_equals_oracle", {**BY_TIME, "tolerance": 0.002, "none_below": 0.5}, session
    )
    assert finding.outcome is outcome


def test_a_value_that_the_machine_made_old_is_in_doubt(tmp_path: Path) -> None:
    """A message sent after a machine delay was right before the delay."""
    times = [1.5 + n / 7.3 for n in range(30)]
    values = [math.sin(t - 1.0 - (0.2 if 10 <= n < 13 else 0.0)) for n, t in enumerate(times)]
    session = plain(tmp_path, values, times)
    session.disturbed("it", *((times[n] - 0.015, 0.014) for n in range(10, 13)))
    assert (
        judged("topic_equals_oracle", {**BY_TIME, "tolerance": 0.002}, session).outcome
        is Outcome.INCONCLUSIVE
    )


def test_another_number_of_elements_fails(tmp_path: Path) -> None:
    """A point is three numbers, its x one."""
    finding = by_stamp(tmp_path, float, field="point")
    assert finding.reason == "A message holds 3 numbers, not 1."


def test_without_inputs_nothing_can_be_said(tmp_path: Path) -> None:
    """Missing inputs are charged elsewhere."""
    session = Session(tmp_path).process().typed("/out", STAMPED, [stamped(1.0, 1.0)], [1.0])
    assert judged("topic_equals_oracle", BY_STAMP, session).outcome is Outcome.NOT_REACHED


def test_messages_of_another_length_are_wrong(tmp_path: Path) -> None:
    """Messages of another length cannot be compared, and are not ignored."""
    kind = "std_msgs/msg/Float64MultiArray"
    session = Session(tmp_path).process(interrupted_ns=at(6.2))
    times = [1.0 + n / 20 for n in range(COUNT)]
    session.typed("/in", FLOAT, [{"data": float(n)} for n in range(COUNT)], times)
    rows = [{"data": [math.sin(t - 1.0)] if n % 5 else [0.0, 0.0]} for n, t in enumerate(times)]
    session.typed("/out", kind, rows, times)
    finding = judged("topic_equals_oracle", {**BY_TIME, "tolerance": 0.002}, session)
    assert finding.measured == "80 of 100 messages right, 20 with another number of values"
    assert finding.credit == Decimal("0.8")


def test_between_sparse_times_of_an_oracle_lies_a_line_or_nothing(tmp_path: Path) -> None:
    """At 1 Hz a value in between is interpolated; `nearest` compares only values near a time."""
    times = [1.0, 2.0, 3.0]
    session = Session(tmp_path).process().typed("/in", FLOAT, [{}] * 3, times)
    halfway = math.sin(1.0) / 2
    session.typed("/out", FLOAT, [{"data": 0.0}, {"data": halfway}], [1.01, 1.5])
    for match, measured in (
        ("interpolated", "2 of 2 messages right"),
        ("nearest", "1 of 1 messages right"),
    ):
        finding = judged(
            "topic_equals_oracle",
            {**BY_TIME, "match": match, "tolerance": 0.02},
            session.recorded(),
        )
        assert finding.measured == measured


def test_in_order_a_second_publisher_is_superfluous(tmp_path: Path) -> None:
    """Wrong numbers beside the right ones do not make up for themselves."""
    times = [1.001 + n / 20 for n in range(COUNT)]
    session = plain(tmp_path, [2.0 * n for n in range(COUNT)], times)
    session.typed("/out", FLOAT, [{"data": -5.0}] * COUNT, [t + 0.001 for t in times])
    finding = judged("topic_equals_oracle", IN_ORDER, session)
    assert (finding.measured, finding.credit) == (
        "100 of 200 messages right, 100 superfluous",
        Decimal("0.5"),
    )


def test_in_order_a_window_may_begin_in_the_middle(tmp_path: Path) -> None:
    """Messages outside the window keep their place in the order, and are not judged."""
    session = plain(
        tmp_path, [2.0 * n for n in range(COUNT)], [1.001 + n / 20 for n in range(COUNT)]
    ).window(4.0, 5.5)
    finding = judged("topic_equals_oracle", {**IN_ORDER, "window": "window"}, session)
    assert finding.outcome is Outcome.PASSED
    assert finding.measured == "30 of 30 messages right"


def test_in_order_what_the_machine_kept_away_does_not_shift_what_follows(tmp_path: Path) -> None:
    """Five inputs are lost in a delay; the answers to the other inputs still match."""
    heard = [n for n in range(COUNT) if not 40 <= n < 45]
    times, values = [1.001 + n / 20 for n in heard], [2.0 * n for n in heard]
    session = plain(tmp_path / "delayed", values, times).disturbed("it", (2.99, 0.25))
    finding = judged("topic_equals_oracle", {**IN_ORDER, "full_from": "90%"}, session)
    assert (finding.outcome, finding.measured) == (
        Outcome.PASSED,
        "95 of 100 messages right, 5 missing",
    )
    assert (
        judged("topic_equals_oracle", IN_ORDER, session.recorded()).outcome is Outcome.INCONCLUSIVE
    )
    values[60] = -1.0
    session = plain(tmp_path / "wrong", values, times).disturbed("it", (2.99, 0.25))
    finding = judged("topic_equals_oracle", {**IN_ORDER, "full_from": "90%"}, session)
    assert finding.measured == "94 of 100 messages right, 5 missing"
    session = plain(tmp_path / "idle", values, times)
    assert (
        judged("topic_equals_oracle", {**IN_ORDER, "full_from": "90%"}, session).outcome
        is Outcome.PARTIAL
    )


@pytest.mark.parametrize(("missed", "outcome"), [(100, Outcome.PASSED), (350, Outcome.FAILED)])
def test_in_order_it_may_begin_a_second_late_at_any_rate(
    tmp_path: Path, missed: int, outcome: Outcome
) -> None:
    """At 100 Hz that is a hundred messages."""
    times = [1.0 + n / 100 for n in range(500)]
    session = Session(tmp_path).process(interrupted_ns=at(6.2))
    session.typed("/in", FLOAT, [{"data": float(n)} for n in range(500)], times)
    answers = [{"data": 2.0 * n} for n in range(missed, 500)]
    session.typed("/out", FLOAT, answers, [t + 0.001 for t in times[missed:]])
    assert (
        judged("topic_equals_oracle", {**IN_ORDER, "none_below": 0.5}, session).outcome is outcome
    )


@pytest.mark.parametrize(("ended_by", "credit"), [("itself", "0.1"), ("interrupt", "1")])
def test_who_ends_by_itself_leaves_the_rest_unanswered(
    tmp_path: Path, ended_by: str, credit: str
) -> None:
    """Only the grader's own end is an excuse."""
    session = answered(tmp_path, lambda n: 2.0 * n if n < 12 else None)
    (run,) = session.record.processes
    run.exited_ns, run.ended_by = at(1.61), ended_by
    run.interrupted_ns = at(1.6) if ended_by == "interrupt" else None
    assert judged("topic_equals_oracle", BY_STAMP, session).credit == Decimal(credit)


def scanned(folder: Path, second: float) -> Finding:
    """Judge a node that doubles a laser's ranges; the second range is infinite."""
    scan, times = "sensor_msgs/msg/LaserScan", [1.0 + n / 20 for n in range(20)]
    session = Session(folder).process(interrupted_ns=at(2.1))
    session.typed("/in", scan, [{"ranges": [1.0, math.inf, float(n)]} for n in range(20)], times)
    session.typed(
        "/out",
        scan,
        [{"ranges": [2.0, second, 2.0 * n]} for n in range(20)],
        [t + 0.001 for t in times],
    )
    streams = {"input": {"topic": "/in", "field": "ranges", "finite": False}}
    return judged(
        "topic_equals_oracle",
        {**IN_ORDER, "field": "ranges", "streams": streams, "relative": 0.1},
        session,
    )


@pytest.mark.parametrize(
    ("second", "credit"), [(math.inf, "1"), (9.0, "0"), (-math.inf, "0"), (math.nan, "0")]
)
def test_infinite_ranges_are_compared_too(tmp_path: Path, second: float, credit: str) -> None:
    """Infinite is right where the oracle says so, and nothing else is."""
    assert scanned(tmp_path, second).credit == Decimal(credit)
