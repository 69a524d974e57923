"""The schedule of a publisher under repeated machine delays: its rate, and its own omissions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from grader.evidence.cpu_delay import Delay, calm_intervals
from grader.evidence.recorded import Floats
from grader.evidence.schedule import Schedule, kept_schedule
from grader.evidence.timing import Timing, timing_of
from ros_bag.reading import Stream
from tests.synthetic import at

LENGTH_S = 6.0


def stops(chance: np.random.Generator) -> list[tuple[float, float]]:
    """Draw when a machine stops a process, and until when: a quarter of the time, for 5 to 30 ms."""
    found, now_s = [], 0.0
    while (now_s := now_s + chance.exponential(0.0525)) < LENGTH_S:
        found.append((now_s, now_s := now_s + chance.uniform(0.005, 0.030)))
    return found


def until_it_runs(due_s: float, stopped: list[tuple[float, float]]) -> float:
    """Return when something is done that was due at a time."""
    return next((end for start, end in stopped if start <= due_s < end), due_s)


Program = Callable[[np.random.Generator, list[tuple[float, float]]], Floats]


def timer(rate_hz: float, skipped: float = 0.0, late_s: float = 0.0002) -> Program:
    """Return a timer that skips missed ticks, like rcl's; some callbacks send no message."""

    def run(chance: np.random.Generator, stopped: list[tuple[float, float]]) -> Floats:
        times, tick = [], 0
        while (due_s := tick / rate_hz) < LENGTH_S:
            at_s = until_it_runs(due_s + chance.uniform(0, late_s), stopped)
            if chance.random() >= skipped:
                times.append(at_s)
            tick = max(tick + 1, int(np.ceil(at_s * rate_hz - late_s * rate_hz)))
        return np.array(times)

    return run


def makes_up(rate_hz: float) -> Program:
    """Return a loop that sleeps until its next time, and sends all overdue messages at once."""

    def run(chance: np.random.Generator, stopped: list[tuple[float, float]]) -> Floats:
        times = [0.0]
        for tick in range(1, int(LENGTH_S * rate_hz)):
            times.append(until_it_runs(max(tick / rate_hz, times[-1] + 1e-4), stopped))
        return np.array(times)

    return run


def sleeps(rate_hz: float) -> Program:
    """A loop that sleeps for a period after each message, from whenever that was."""

    def run(chance: np.random.Generator, stopped: list[tuple[float, float]]) -> Floats:
        times = [0.0]
        while times[-1] < LENGTH_S:
            times.append(
                until_it_runs(times[-1] + 1 / rate_hz + chance.uniform(0, 0.0002), stopped)
            )
        return np.array(times)

    return run


def observed(program: Program, seed: int) -> tuple[Timing, Schedule | None]:
    """Give the timing of a program on such a machine, and its schedule."""
    chance = np.random.default_rng(seed)
    stopped = stops(chance)
    times_ns = np.array([at(t) for t in program(chance, stopped)], dtype=np.int64)
    numbers = np.arange(1, len(times_ns) + 1)
    timing = timing_of(
        Stream("/a", "", times_ns + 1000, times_ns, numbers, tuple(b"" for _ in times_ns)), None
    )
    assert timing is not None
    delays = [Delay(at(start), at(end), round((end - start) * 1e9)) for start, end in stopped]
    calm = calm_intervals(delays, timing.times_ns, timing.intervals_s, 0.2 * timing.median_s)
    return timing, kept_schedule(calm, delays, timing)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("program", "rate_hz"),
    [
        (timer(100), 100),
        (timer(98.2), 98.2),
        (timer(90), 90),
        (timer(100, late_s=0.003), 100),
        (makes_up(97.8), 97.8),
    ],
    ids=["100 Hz", "98.2 Hz", "90 Hz", "late by chance", "makes up"],
)
def test_the_rate_of_a_schedule_is_known_to_a_thousandth(
    program: Program, rate_hz: float, seed: int
) -> None:
    """The rate is found although messages are missing, without help of their number."""
    timing, schedule = observed(program, seed)
    assert schedule is not None
    least_hz, most_hz = schedule.bounds_hz()
    assert least_hz <= rate_hz <= most_hz
    assert most_hz - least_hz < 0.004 * rate_hz
    assert least_hz > timing.rate_hz or timing.rate_hz == pytest.approx(rate_hz, rel=0.01), (
        "the machine took a part"
    )


@pytest.mark.parametrize("seed", range(5))
def test_what_a_program_leaves_out_by_itself_is_not_laid_at_the_machines_door(seed: int) -> None:
    """A callback that sends nothing one time in ten makes 90 Hz of a timer of 100."""
    _, schedule = observed(timer(100, skipped=0.1), seed)
    assert schedule is not None
    least_hz, most_hz = schedule.bounds_hz()
    assert least_hz <= 90 <= most_hz < 97
    assert schedule.rate_hz == pytest.approx(100, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_a_loop_that_begins_anew_after_each_delay_keeps_to_none(seed: int) -> None:
    """The times after a delay say nothing about the times before it."""
    assert observed(sleeps(90), seed)[1] is None


@pytest.mark.parametrize("rate_hz", [30, 3000])
def test_where_a_schedule_cannot_be_looked_for_there_is_none(rate_hz: float) -> None:
    """Too few undisturbed messages, or so many that their intervals tell enough."""
    assert observed(timer(rate_hz), 0)[1] is None
