"""A motion to a target: in time, without leaving, without overshoot; and delays of the machine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.checks.motion import greatest, rotated, turned
from grader.result import Finding, Outcome
from tests.synthetic import Session, judged

ODOMETRY = "nav_msgs/msg/Odometry"
GOAL = {
    "topic": "/odom",
    "field": "pose.pose.position",
    "target": {"value": [2.0, 0.0, 0.0]},
    "tolerance": 0.1,
    "within_s": 5.0,
    "none_from_s": 10.0,
    "none_beyond": 1.1,
    "window": "window",
}


def moved(folder: Path, x: Callable[[float], float], until_s: float = 13.0) -> Session:
    """Make a session with a robot at x(t), t seconds after its window begins at 1 s."""
    times = [1.0 + n / 20 for n in range(round((until_s - 1) * 20) + 1)]
    rows = [{"pose": {"pose": {"position": {"x": x(t - 1.0)}}}} for t in times]
    return Session(folder).process().typed("/odom", ODOMETRY, rows, times).window(1.0, until_s)


def reached(folder: Path, x: Callable[[float], float], **more: Any) -> Finding:
    """Judge whether a robot comes to 2 m within 5 s."""
    return judged("reaches", {**GOAL, **more}, moved(folder, x))


def test_who_comes_in_time_and_stays_passes(tmp_path: Path) -> None:
    """At 0.5 m/s, 1.9 m is reached in 3.8 s, and seen with the next message."""
    finding = reached(tmp_path, lambda t: min(2.0, 0.5 * t), hold_s=2.0)
    assert finding.outcome is Outcome.PASSED
    assert "after 3.85 s" in finding.measured


@pytest.mark.parametrize(
    ("speed", "credit"), [(0.38, "1"), (0.36, "0.9"), (0.25, "0.4"), (0.19, "0")]
)
def test_who_comes_late_earns_less_the_later(tmp_path: Path, speed: float, credit: str) -> None:
    """Credit falls from 5 s to 10 s, in steps."""
    finding = reached(tmp_path, lambda t: min(2.0, speed * t))
    assert finding.credit == Decimal(credit)
    assert not finding.reason or "5 s are allowed" in finding.reason


@pytest.mark.parametrize(
    ("stops_at", "credit"), [(1.95, "1"), (1.85, "0.4"), (1.4, "0.2"), (0.8, "0")]
)
def test_who_stops_before_it_earns_by_how_near(
    tmp_path: Path, stops_at: float, credit: str
) -> None:
    """At most half, down to none at 1.1 m."""
    finding = reached(tmp_path, lambda t: min(stops_at, t), hold_s=1.0)
    assert finding.credit == Decimal(credit)


def test_who_only_passes_by_has_not_come_to_stay(tmp_path: Path) -> None:
    """The nearest that is kept counts; without a time to hold it, passing by is enough."""
    drives_by = reached(tmp_path / "by", lambda t: 0.5 * t, hold_s=1.0)
    assert drives_by.outcome is Outcome.PARTIAL
    assert "that it keeps for 1 s" in drives_by.reason
    assert reached(tmp_path / "at", lambda t: 0.5 * t).outcome is Outcome.PASSED


def test_what_the_recording_ends_with_was_not_seen_to_stay(tmp_path: Path) -> None:
    """An arrival in the last moment of the recording shows no stay."""
    finding = reached(tmp_path, lambda t: min(2.0, 2.0 * t / 12), hold_s=1.0)
    assert finding.credit < Decimal("0.5")


def test_who_goes_beyond_loses_a_part(tmp_path: Path) -> None:
    """0.3 m beyond, 0.2 m are allowed."""

    def swings(t: float) -> float:
        return min(t, 2.3) if t < 3 else 2.0

    assert reached(tmp_path / "free", swings).outcome is Outcome.PASSED
    finding = reached(tmp_path / "bound", swings, overshoot=0.2)
    assert finding.credit == Decimal("0.7")
    assert finding.reason == "It goes 0.300 beyond the target; 0.2 is allowed."
    assert reached(tmp_path / "edge", swings, overshoot=0.3001).outcome is Outcome.PASSED


def test_it_counts_from_the_step_that_is_named(tmp_path: Path) -> None:
    """A goal that is sent after 4 s is reached later."""
    session = moved(tmp_path, lambda t: min(2.0, max(0.0, t - 4.0)))
    session.step("publish", "goal").record.steps[-1].ended_ns += 3_000_000_000
    finding = judged("reaches", {**GOAL, "after": "goal"}, session)
    assert finding.outcome is Outcome.PASSED
    assert "after 1.90 s" in finding.measured


def test_a_step_that_was_not_reached_is_charged_where_it_is(tmp_path: Path) -> None:
    """A step that was not reached leaves everything after it untested."""
    session = moved(tmp_path, lambda t: 0.0)
    assert judged("reaches", {**GOAL, "after": "goal"}, session).outcome is Outcome.NOT_REACHED


def _distance(speed: float, t_s: float) -> float:
    """Give the way, at most 2, after a time at a speed."""
    return min(2.0, speed * t_s)


def test_the_machine_s_delay_leaves_lateness_open(tmp_path: Path) -> None:
    """5.4 s with half a second of delay may be full or not; with much more lateness it cannot."""
    for name, speed, outcome in (
        ("near", 0.352, Outcome.INCONCLUSIVE),
        ("far", 0.05, Outcome.FAILED),
    ):
        drives = partial(_distance, speed)
        session = moved(tmp_path / name, drives).disturbed("it", (2.0, 0.5))
        assert judged("reaches", GOAL, session).outcome is outcome


def test_a_machine_that_was_busy_for_long_may_be_why_it_never_came(tmp_path: Path) -> None:
    """Four of twelve seconds leave it open."""
    session = moved(tmp_path, lambda t: min(1.0, t)).disturbed("it", (2.0, 4.0))
    assert judged("reaches", GOAL, session).outcome is Outcome.INCONCLUSIVE


def test_a_field_follows_another_topic(tmp_path: Path) -> None:
    """The target moves; it is looked up as of then."""
    session = moved(tmp_path, lambda t: min(2.0, t))
    times = [0.5 + n / 10 for n in range(130)]
    goals = [{"point": {"x": 5.0 if t < 8 else 2.0}} for t in times]
    session.typed("/goal", "geometry_msgs/msg/PointStamped", goals, times)
    target = {"field": {"topic": "/goal", "field": "point"}}
    finding = judged("reaches", {**GOAL, "target": target, "within_s": 8.0}, session)
    assert finding.outcome is Outcome.PASSED
    assert "after 7.00 s" in finding.measured


def test_an_oracle_gives_the_target(tmp_path: Path) -> None:
    """The oracle receives the streams by role."""
    target = {
        "oracle": "tests/checks/made_up_oracles.py:last",
        "streams": {"input": {"topic": "/odom", "field": "pose.pose.position"}},
    }
    assert reached(tmp_path, lambda t: min(1.5, t), target=target).outcome is Outcome.PASSED


def test_a_silent_topic_fails(tmp_path: Path) -> None:
    """Nothing moves where nothing is published."""
    session = Session(tmp_path).process().window(1.0, 13.0)
    assert judged("reaches", GOAL, session).outcome is Outcome.FAILED


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_angles_are_compared_the_shorter_way_round(one: float, other: float) -> None:
    """A turn more changes nothing, and nothing is more than half a turn off."""
    off = turned(np.array([[one]]), np.array([[other]]))[0]
    assert 0 <= off <= math.pi + 1e-9
    assert turned(np.array([[one + 2 * math.pi]]), np.array([[other]]))[0] == pytest.approx(
        off, abs=1e-6
    )


@given(st.floats(-3.1, 3.1))
def test_a_rotation_is_the_angle_between_two_orientations(yaw: float) -> None:
    """Quaternions of either sign and any length are the same orientation."""
    quaternion = np.array([[0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]])
    straight = np.array([[0.0, 0.0, 0.0, 1.0]])
    for sign in (1.0, -2.0):
        assert rotated(sign * quaternion, straight)[0] == pytest.approx(abs(yaw), abs=1e-6)


@given(st.lists(st.tuples(st.floats(-9, 9), st.integers(1, 20)), min_size=1, max_size=40))
def test_the_greatest_of_each_part_is_found(parts: list[tuple[float, int]]) -> None:
    """The greatest value of each part equals a search of the whole part."""
    values = np.array([value for value, _ in parts])
    ends = np.array([min(n + length, len(parts)) for n, (_, length) in enumerate(parts)])
    assert greatest(values, ends).tolist() == [values[n:end].max() for n, end in enumerate(ends)]


def test_a_flood_is_judged_in_no_more_time_than_its_length(tmp_path: Path) -> None:
    """To stay for half of the time costs as much as to stay for a hundredth of it."""
    values, took_s = np.zeros(300_000), []
    for length in (3_000, 150_000):
        began_s = time.process_time()
        greatest(values, np.minimum(np.arange(len(values)) + length, len(values)))
        took_s.append(time.process_time() - began_s)
    assert took_s[1] < 10 * took_s[0]
