"""Undisturbed parts of a measurement, by the times at which the machine delayed a process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grader.evidence.cpu_delay import Calm, Delay, Span, backlog, calm_intervals
from tests.synthetic import Session, at

INFINITE = float("inf")
SPAN = Span(at(0), at(10))


def delay(start_s: float, length_s: float, delay_s: float | None = None) -> Delay:
    """Give a delay; all of its time, unless something else is said."""
    return Delay(
        at(start_s), at(start_s + length_s), round((length_s if delay_s is None else delay_s) * 1e9)
    )


def calm_of(times_s: np.ndarray, *delays: Delay, harmless_s: float = 0.001) -> Calm:
    """Give the calm intervals between messages that were sent at some times."""
    ends_ns = np.array([at(t) for t in times_s[1:]], dtype=np.int64)
    return calm_intervals(delays, ends_ns, np.diff(times_s), harmless_s)


# -- what waits ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("delays", "room_s", "busy", "lost_s"),
    [
        ([], 0.1, 0.5, 0.0),
        ([delay(1, 0.3)], 0.1, 0.5, 0.2),
        ([delay(1, 0.3)], 0.0, 0.5, 0.3),
        ([delay(n / 10, 0.02) for n in range(90)], 0.1, 0.5, 0.0),
        ([delay(n / 10, 0.02) for n in range(90)], 0.1, 0.9, 0.93),
        ([delay(n / 10, 0.1, 0.02) for n in range(90)], 0.1, 0.5, 0.0),
        ([delay(1, 0.08), delay(1.08, 0.08)], 0.1, 0.1, 0.06),
        ([delay(1, 0.5, 0.08), delay(1.5, 0.5, 0.08)], 0.1, 0.1, 0.06),
        ([delay(1, 0.08), delay(1.2, 0.08)], 0.1, 0.1, 0.0),
        ([delay(-1, 1.3)], 0.1, 0.5, 0.2),
    ],
    ids=[
        "nothing", "one that is too long", "no room", "short ones", "short ones, and it is busy itself",
        "short ones that may lie anywhere", "two without a pause", "two that may have been without one",
        "two with a pause", "one that began before",
    ],
)  # fmt: skip
def test_a_queue_overflows_by_what_it_has_no_room_for(
    delays: list[Delay], room_s: float, busy: float, lost_s: float
) -> None:
    """Only a delay too long for a queue loses messages.

    The remaining share of a core empties the queue.
    """
    assert backlog(delays, SPAN, room_s, busy).lost_s == pytest.approx(lost_s, abs=0.03)


def test_short_delays_make_nothing_late() -> None:
    """A second in one piece makes ten seconds of messages 0.1 s late on average.

    A second in a hundred pieces makes them 1 ms late.
    """
    assert backlog([delay(1, 1.0)], SPAN, INFINITE, 0.1).late_s == pytest.approx(0.1)
    assert backlog(
        [delay(n / 10, 0.01) for n in range(100)], SPAN, float("inf"), 0.1
    ).late_s == pytest.approx(0.001, rel=0.1)


# -- what is calm ----------------------------------------------------------------------------------


def test_what_follows_a_delay_is_not_calm_at_once() -> None:
    """A delay of two intervals touches five.

    Three overlap with it; one may hold missed messages, and one gets shorter.
    """
    times_s = np.arange(100) / 10
    assert len(calm_of(times_s).intervals_s) == 99
    calm = calm_of(times_s, delay(3.05, 0.2))
    assert len(calm.intervals_s) == 99 - 5
    assert calm.stretch.max() == 1


def test_harmless_delays_leave_intervals_calm_and_widen_the_rate() -> None:
    """Many moments without a core keep a program from nothing, but together it may have done more."""
    times_s = np.arange(500) / 100
    calm = calm_of(times_s, *(delay(n / 10, 0.01, 0.0005) for n in range(50)))
    assert len(calm.intervals_s) == 499
    assert calm.delayed_share == pytest.approx(0.005, rel=0.05)
    assert calm.rate_hz() == pytest.approx((100.0, 100.5), abs=0.02)


def test_the_rate_in_calm_intervals_holds_the_true_one() -> None:
    """The true rate is found although the timer is stopped a quarter of the time, at random.

    Uneven programs and rates other than 100 Hz are included.
    """
    random = np.random.default_rng(1)
    for period_s, jitter_s in ((0.010, 0.0), (0.0102, 0.0003), (0.0125, 0.004)):
        stops = np.cumsum(random.uniform(0.0525, 0.0825, 90))
        lengths = random.uniform(0.005, 0.030, 90)
        delays = [delay(start, length) for start, length in zip(stops, lengths, strict=True)]
        ticks = np.cumsum(np.maximum(0.001, random.normal(period_s, jitter_s, 620)))
        for start, length in zip(
            stops, lengths, strict=True
        ):  # ticks during a stop come at its end
            ticks = np.where((ticks > start) & (ticks < start + length), start + length, ticks)
        calm = calm_of(np.unique(ticks), *delays)
        least_hz, most_hz = calm.rate_hz()
        assert calm.is_enough
        assert least_hz - 0.01 <= 1 / period_s <= most_hz + 0.01
        assert most_hz - least_hz < 0.01 + 40 * jitter_s / period_s


def test_evenness_is_that_of_calm_intervals() -> None:
    """Unevenness caused by the machine does not count; the program's own does."""
    times_s = np.arange(600) / 100
    stopped = times_s.copy()
    stopped[100:103] += 0.02
    uneven = times_s + np.where(np.arange(600) % 4 == 0, 0.006, 0.0)
    stop = delay(0.995, 0.03)
    assert calm_of(stopped, stop).deviations_s(0.95)[1] < 0.0001
    assert calm_of(stopped).deviations_s(0.995)[1] > 0.005
    assert calm_of(uneven, stop).deviations_s(0.95)[0] > 0.005


def test_a_pause_of_the_programs_own_is_seen_although_the_machine_touched_it() -> None:
    """With delays every 0.07 s no pause of 0.1 s is ever calm.

    The undelayed rest of a pause is the program's.
    """
    times_s = np.concatenate([n + np.arange(90) / 100 for n in range(6)])
    delays = [delay(n * 0.07, 0.015) for n in range(86)]
    assert calm_of(np.arange(600) / 100, *delays).rate_hz()[0] > 99.0
    assert calm_of(times_s, *delays).rate_hz()[0] < 90.0


def test_a_few_intervals_do_not_stand_for_all() -> None:
    """Nothing is concluded from less than half a second of calm intervals."""
    times_s = np.arange(600) / 100
    assert not calm_of(times_s, delay(0.0, 3.8)).is_enough
    assert calm_of(times_s, delay(0.0, 3.2)).is_enough


def test_the_delays_of_many_spans_are_those_of_each(tmp_path: Path) -> None:
    """The most delayed process of the student or reference counts, each delay by its part."""
    session = (
        Session(tmp_path)
        .process("one")
        .process("two", role="reference")
        .process("recorder", role="grader")
    )
    session.disturbed("one", (2.0, 0.2)).disturbed("two", (2.1, 0.4)).disturbed(
        "recorder", (1.0, 5.0)
    )
    recorded = session.recorded()
    starts, ends = np.array([at(1.0), at(2.2), at(4.0)]), np.array([at(2.05), at(3.0), at(5.0)])
    found = recorded.delays_s(starts, ends)
    assert found == pytest.approx([0.05, 0.3, 0.0], abs=1e-6)
    each = []
    for a, b in zip(starts, ends, strict=True):
        each.append(recorded.longest_delay_s(Span(int(a), int(b))))
    assert found == pytest.approx(each, abs=1e-6)
