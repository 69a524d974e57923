"""Bounds of measured values: worked examples of what a machine can have caused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grader.evidence import bounds
from grader.evidence.bounds import Delayed, Interval, Publication
from grader.evidence.cpu_delay import Span
from tests.synthetic import Session, at, evenly

TOPIC = "/commands"
WINDOW = Span(at(1), at(7))


def published(folder: Path, times_s: list[float], *delays: tuple[float, float]) -> Publication:
    """Return a publication between 1 s and 7 s, with delays of its process as (start, length)."""
    session = Session(folder).process("it").messages(TOPIC, [[0.0]] * len(times_s), times_s)
    session.window(1.0, 7.0).disturbed("it", *delays)
    recorded = session.recorded()
    found = bounds.publication_of(recorded, TOPIC, recorded.process("it"), WINDOW)
    assert found is not None
    return found


# -- intervals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "least", "most"),
    [(97, 103, 0, 0.03), (90, 95, 0.05, 0.1), (110, 120, 0.1, 0.2), (100, 100, 0, 0)],
    ids=["around", "below", "above", "equal"],
)
def test_distances_from_a_wanted_value(low: float, high: float, least: float, most: float) -> None:
    """The nearest value of an interval has the least distance, one of its ends the greatest."""
    off = Interval(low, high).off(100)
    assert (off.low, off.high) == pytest.approx((least, most))


def test_credit_is_that_of_the_ends_in_order() -> None:
    """A credit that falls with the value has its least at the upper end."""
    credit = Interval(0.2, 0.6, "busy").credit(lambda value: 1 - value)
    assert (credit.low, credit.high) == pytest.approx((0.4, 0.8))
    assert credit.why == "busy"


def test_equal_credit_has_no_cause_to_name() -> None:
    """A delay that changes no credit is not given as a cause."""
    assert Interval(0.2, 0.6, "busy").credit(lambda value: 1.0).why == ""


def test_an_interval_is_cut_to_another_one() -> None:
    """Only the part within the other interval is left, or the end that is nearest to it."""
    assert Interval(90, 110).within(Interval(95, 120)) == Interval(95, 110)
    assert Interval(90, 92).within(Interval(95, 120)) == Interval(95, 95)
    assert Interval(95, 110).widened(5) == Interval(90, 115)


# -- counts, times and events ----------------------------------------------------------------------


def test_a_count_may_have_been_higher_by_the_delayed_time() -> None:
    """80 messages in 10 s with 2 s of delays may have been up to 100; delays cost nine tenths at most."""
    counted = bounds.count(80, Delayed(2.0, 10.0))
    assert (counted.low, counted.high) == pytest.approx((80, 100))
    assert "2.00 s of 10.0 s" in counted.why
    assert bounds.count(80, Delayed(9.5, 10.0)).high == pytest.approx(800)


def test_a_delay_too_short_to_be_shown_is_not_named() -> None:
    """Two decimal places show 5 ms."""
    assert Delayed(0.004, 1.0).why == ""
    assert Delayed(0.005, 1.0).why != ""


@pytest.mark.parametrize(
    ("delay_s", "least_s"), [(0.0, 0.3), (0.1, 0.2), (0.5, 0.0)], ids=["none", "a part", "longer"]
)
def test_an_answer_took_at_most_the_delay_less(delay_s: float, least_s: float) -> None:
    """The machine can only have made it later, and nothing is answered before it was asked."""
    took = bounds.latency(0.3, Delayed(delay_s, 1.0))
    assert (took.low, took.high) == pytest.approx((least_s, 0.3))


def test_each_answer_has_the_delays_of_its_own_time(tmp_path: Path) -> None:
    """A delay of 0.1 s shortens the answer that waited for it, and no other one."""
    recorded = Session(tmp_path).process("it").disturbed("it", (2.0, 0.1)).recorded()
    asked_ns = np.array([at(1.0), at(2.0)])
    answered_ns = np.array([at(1.2), at(2.3)])
    least_s, took_s = bounds.latencies(recorded, asked_ns, answered_ns)
    assert took_s == pytest.approx([0.2, 0.3])
    assert least_s == pytest.approx([0.2, 0.2], abs=1e-6)
    late = bounds.made_late(recorded, asked_ns, answered_ns, 0.3)
    assert late.tolist() == [False, True]


@pytest.mark.parametrize(
    ("delay_s", "most"), [(0.0, 0), (0.19, 0), (0.2, 1), (0.5, 1)],
    ids=["none", "too short", "just long enough", "longer"],
)  # fmt: skip
def test_a_late_event_came_in_time_if_a_delay_is_as_long(delay_s: float, most: float) -> None:
    """A delay of 0.2 s explains an event that is 0.2 s late."""
    came = bounds.arrival(0.2, Delayed(delay_s, 1.0))
    assert (came.low, came.high) == (0, most)
    assert bool(came.why) == bool(most)


def test_an_event_may_be_unseen_if_most_of_each_time_was_delayed() -> None:
    """One undelayed time shows that nothing was there, and so does a delay too short to be shown."""
    long, short = Delayed(0.6, 1.0), Delayed(0.4, 1.0)
    assert bounds.absence(0.5, long, long).high == 1
    assert bounds.absence(0.5, long, short).high == 0
    assert bounds.absence(0.5, Delayed(0.002, 0.003)).high == 0
    assert "1.20 s of 2.0 s" in bounds.absence(0.5, long, long).why


@pytest.mark.parametrize(("depth", "lost"), [(1, 0.1), (51, 0.05), (1000, 0.0)])
def test_a_queue_saves_the_messages_that_it_has_room_for(
    tmp_path: Path, depth: int, lost: float
) -> None:
    """In a delay of 1 s of 10 s, 100 of 1,000 messages come; a queue of 51 keeps 50 of them."""
    recorded = Session(tmp_path).process("it").disturbed("it", (5.0, 1.0)).recorded()
    times_ns = np.linspace(at(0), at(10), 1001).astype(np.int64)
    share = bounds.lost_share(recorded, recorded.students, depth, times_ns)
    assert share == pytest.approx(lost, abs=0.005)


# -- publications ----------------------------------------------------------------------------------


def test_an_undelayed_rate_is_known_exactly(tmp_path: Path) -> None:
    """Without delays only the error of the measurement is left."""
    rate = bounds.rate(published(tmp_path, evenly(50, 8.0)), 50)
    assert (rate.low, rate.high) == pytest.approx((50, 50), abs=0.05)
    assert rate.why == ""
    assert rate.likely(50.0) == pytest.approx(50, abs=0.05)


def test_a_delay_before_undisturbed_intervals_leaves_the_rate_known(tmp_path: Path) -> None:
    """Messages missed in one delay of 1 s do not count; the rest tells the rate of 50 Hz."""
    due_s = np.array(evenly(50, 8.0))
    times_s = list(due_s[(due_s <= 3.0) | (due_s >= 4.0)])
    rate = bounds.rate(published(tmp_path, times_s, (3.0, 1.0)), 50)
    assert (rate.low, rate.high) == pytest.approx((50, 50), abs=0.5)
    assert "not busy" in rate.method


def test_a_rate_is_not_raised_beyond_the_wanted_one(tmp_path: Path) -> None:
    """45 Hz in 6 s with 1.2 s of delays may have been 50 Hz as asked, but not the 56 Hz that fit too."""
    found = replace(published(tmp_path, evenly(45, 8.0)), delay_s=1.2)
    rate = bounds.undelayed_rate(found, 50)
    assert rate.low == pytest.approx(45, abs=0.1)
    assert 45 <= rate.high <= 50


def test_unevenness_by_one_delay_does_not_count(tmp_path: Path) -> None:
    """A delay that moves ten of 300 messages leaves the evenness of the others."""
    due_s = np.array(evenly(50, 8.0))
    sent_s = np.where((due_s > 3.8) & (due_s < 4.0), 4.0, due_s)
    times_s = list(sent_s + np.arange(len(sent_s)) * 1e-5)
    gaps = bounds.gaps(published(tmp_path, times_s, (3.8, 0.2)), 0.99, 0.0015)
    blamed = bounds.gaps(published(tmp_path / "idle", times_s), 0.99, 0.0015)
    assert gaps.high < 0.001
    assert blamed.high > 0.01
