"""Motion and values of messages, as Lab 09-01 checks them, and the fit of a sinusoid."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.result import Finding, Outcome
from tests.synthetic import ROOT, Session, evenly, judged

sys.path.insert(0, str(ROOT / "reference"))

from checks.motion import Sinusoid, fit_sinusoid

SINUSOIDS = "reference/checks/motion.py:sinusoids"
MESSAGE_VALUES = "reference/checks/motion.py:message_values"
TOPIC = "/commands"
VALUES = {"topic": TOPIC, "field": "data", "length": 7}
MOTION = {
    "topic": TOPIC,
    "field": "data",
    "tick_s": 0.01,
    "components": [
        {"index": 0, "amplitude": 0.5, "frequency_hz": 0.2},
        {"index": 1, "amplitude": 0.3, "frequency_hz": 0.3},
    ],
    "others_still": 7,
}


def published(folder: Path, times_s: list[float], rows: list[list[float]] | None = None) -> Session:
    """Make a session with a node that publishes messages at these times, all within the window."""
    session = Session(folder).endpoint("publisher", TOPIC).process("it")
    session.messages(TOPIC, rows or [[0.0] * 7] * len(times_s), times_s)
    return session.window(times_s[0] - 0.001, times_s[-1] + 0.001)


# -- values ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "credit", "words"),
    [
        ([0.0] * 7, 1.0, ""),
        ([0.0] * 6, 0.0, "do not hold 7 numbers (most hold 6)"),
        ([float("nan")] + [0.0] * 6, 0.0, "not finite"),
        ([], 0.0, "most hold 0"),
    ],
)
def test_each_message_holds_seven_finite_numbers(
    tmp_path: Path, row: list[float], credit: float, words: str
) -> None:
    """Another length or a number that is not finite costs all, and is told."""
    times = evenly(10, 1.0)
    finding = judged(MESSAGE_VALUES, VALUES, published(tmp_path, times, [row] * len(times)))
    assert float(finding.credit) == credit
    assert words in finding.reason


def test_values_are_credited_by_the_share_of_good_messages(tmp_path: Path) -> None:
    """One bad message in ten costs a tenth."""
    rows = [[0.0] * 7] * 9 + [[float("inf")] * 7]
    finding = judged(MESSAGE_VALUES, VALUES, published(tmp_path, evenly(10, 0.9), rows))
    assert finding.credit == Decimal("0.9")


def test_no_message_has_no_values(tmp_path: Path) -> None:
    """Without a message the check fails."""
    assert judged(MESSAGE_VALUES, VALUES, Session(tmp_path)).outcome is Outcome.FAILED


# -- motion ----------------------------------------------------------------------------------------


def motion(
    times_s: np.ndarray[Any, Any],
    amplitude: float = 0.5,
    frequency_hz: float = 0.2,
    offset: float = 0.0,
    others: float = 0.0,
) -> list[list[float]]:
    """Return rows: element 0 moves by the arguments, 1 as required, and the others are constant."""
    first = offset + amplitude * np.sin(2 * np.pi * frequency_hz * times_s)
    second = 0.3 * np.sin(2 * np.pi * 0.3 * times_s)
    return [[a, b, *[others] * 5] for a, b in zip(first.tolist(), second.tolist(), strict=True)]


def moving(folder: Path, rate_hz: float = 100, by_clock: bool = False, **how: float) -> Finding:
    """Judge the motion of a node with a rate, its time taken from the clock or as 0.01 s a tick."""
    times = np.array(evenly(rate_hz, 6.0))
    if by_clock:
        own = times - times[0]
    else:
        own = np.arange(len(times)) * 0.01
    return judged(SINUSOIDS, MOTION, published(folder, times.tolist(), motion(own, **how)))


def test_the_right_motion_passes(tmp_path: Path) -> None:
    """Both sinusoids as asked, and all else at rest, earn all."""
    assert moving(tmp_path).outcome is Outcome.PASSED


@pytest.mark.parametrize("by_clock", [False, True])
def test_a_wrong_rate_is_not_charged_again(tmp_path: Path, by_clock: bool) -> None:
    """At 70 Hz the motion is right if it is so by the node's ticks or by the clock."""
    assert moving(tmp_path, 70, by_clock).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("how", "credit", "words"),
    [
        ({"amplitude": 0.515}, 1.0, ""),
        ({"amplitude": 0.7}, 0.75, "amplitude 0.700"),
        ({"frequency_hz": 0.3}, 0.6, "frequency 0.300"),
        ({"amplitude": 0.7, "frequency_hz": 0.3}, 0.5, "(wanted 0.5 and 0.2 Hz)"),
        ({"others": 0.1}, 0.667, "Element 2, 3, 4, 5, 6 should stay at 0"),
        ({"amplitude": 0.0}, 0.5, "Element 0 does not move"),
    ],
)
def test_each_wrong_part_of_the_motion_costs_its_part(
    tmp_path: Path, how: dict[str, Any], credit: float, words: str
) -> None:
    """The amplitude costs a quarter, the frequency 0.4; elements that should rest cost a third, and earn nothing at rest."""
    finding = moving(tmp_path, **how)
    assert float(finding.credit) == pytest.approx(credit, abs=0.001)
    assert words in finding.reason


def test_a_motion_in_another_element_earns_nothing(tmp_path: Path) -> None:
    """Counting joints from 1 sends other joints where they must not go, which is said before all else."""
    times = np.array(evenly(100, 6.0))
    rows = [[0.0, *row[:6]] for row in motion(np.arange(len(times)) * 0.01)]
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), rows))
    assert finding.outcome is Outcome.FAILED
    assert finding.reason.startswith(
        "The motion of element 0 is in element 1. The motion of element 1 is in element 2."
    )


def test_a_motion_the_wrong_way_is_named(tmp_path: Path) -> None:
    """A sine with its sign turned round keeps two thirds of its part."""
    times = np.array(evenly(100, 6.0))
    rows = [[-row[0], *row[1:]] for row in motion(np.arange(len(times)) * 0.01)]
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), rows))
    assert float(finding.credit) == pytest.approx(0.833, abs=0.001)
    assert (
        "begins -180° into its sine" in finding.reason
        or "begins 180° into its sine" in finding.reason
    )


def test_a_motion_ten_times_too_fast_is_named(tmp_path: Path) -> None:
    """A t that grows too fast costs the frequency and not the amplitude."""
    finding = moving(tmp_path, frequency_hz=2.0)
    assert float(finding.credit) == pytest.approx(0.6, abs=0.001)
    assert "frequency 2.000 Hz (wanted 0.5 and 0.2 Hz)" in finding.reason


def test_a_slip_that_the_rubric_knows_is_named(tmp_path: Path) -> None:
    """The meaning of a factor on the amplitude is given for the matching element only."""
    times = evenly(100, 6.0)
    rows = [[row[0] * 57.29578, *row[1:]] for row in motion(np.arange(len(times)) * 0.01)]
    wanted = {**MOTION, "slips": [{"amplitude": 57.29578, "meaning": "It is in degrees."}]}
    finding = judged(SINUSOIDS, wanted, published(tmp_path, times, rows))
    assert finding.reason.count("It is in degrees.") == 1


def test_an_offset_is_a_mistake_and_is_named(tmp_path: Path) -> None:
    """A sinusoid that does not swing about zero loses points, and the reason says why."""
    finding = moving(tmp_path, offset=0.2)
    assert float(finding.credit) == pytest.approx(0.75, abs=0.001)
    assert "about 0.200 instead of 0" in finding.reason


def test_a_motion_for_another_number_of_joints_earns_nothing(tmp_path: Path) -> None:
    """A motion of six joints cannot be carried out by an arm of seven."""
    times = np.array(evenly(100, 6.0))
    rows = [row[:6] for row in motion(times - times[0])]
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), rows))
    assert (finding.outcome, finding.reason) == (
        Outcome.FAILED,
        "There are 6 elements for 7 joints.",
    )


def test_a_joint_that_is_sent_no_number_makes_a_motion_worthless(tmp_path: Path) -> None:
    """Where a joint goes that gets NaN, nobody knows."""
    times = np.array(evenly(100, 6.0))
    rows = [[float("nan"), *row[1:]] for row in motion(times - times[0])]
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), rows))
    assert finding.outcome is Outcome.FAILED
    assert "Element 0 is not a number" in finding.reason


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda row, n: [57.29578 * value for value in row], "beyond ±3.1416"),
        (lambda row, n: [row[1], row[0], *row[2:]], "The motion of element 0 is in element 1."),
        (lambda row, n: [*row[:6], 1.2], "Element 6 jumps to 1.20 with the first message."),
        (
            lambda row, n: [0.5 * np.cos(2 * np.pi * 0.2 * 0.01 * n), *row[1:]],
            "Element 0 jumps to 0.50",
        ),
    ],
    ids=["degrees", "swapped", "a joint off its rest", "cosine"],
)
def test_a_motion_that_endangers_earns_nothing_and_makes_its_values_unsafe(
    tmp_path: Path, change: Callable[[list[float], int], list[float]], said: str
) -> None:
    """Where a joint would go where it must not, neither the motion nor the values are worth anything."""
    times = np.array(evenly(100, 6.0))
    rows = [change(row, n) for n, row in enumerate(motion(times - times[0]))]
    session = published(tmp_path, times.tolist(), rows)
    moved = judged(SINUSOIDS, {**MOTION, "reach": 3.1416, "starts_within": 0.1}, session)
    assert (moved.outcome, said in moved.reason) == (Outcome.FAILED, True)
    values = {"topic": "/commands", "field": "data", "length": 7, "unsafe_by": "motion"}
    assert (
        judged(MESSAGE_VALUES, values, session, findings={"motion": moved}).outcome
        is Outcome.FAILED
    )
    kept = judged(
        MESSAGE_VALUES, {**values, "unsafe_credit": 0.5}, session, findings={"motion": moved}
    )
    assert kept.credit == Decimal("0.5")
    harmless = replace(moved, outcome=Outcome.PARTIAL)
    assert (
        judged(MESSAGE_VALUES, values, session, findings={"motion": harmless}).outcome
        is Outcome.PASSED
    )


def test_the_first_message_that_goes_too_far_is_pointed_at(tmp_path: Path) -> None:
    """Motion and values out of reach point at the moment at which they leave it; another motion at all of it."""
    times = np.array(evenly(100, 6.0))
    rows = motion(times - times[0])
    far = published(tmp_path / "far", times.tolist(), [[8 * row[0], *row[1:]] for row in rows])
    left_s = float(times[next(n for n, row in enumerate(rows) if 8 * row[0] > 3.1416)])
    values = {"topic": "/commands", "field": "data", "length": 7, "reach": 3.1416}
    for check, parameters in ((SINUSOIDS, {**MOTION, "reach": 3.1416}), (MESSAGE_VALUES, values)):
        (where,) = judged(check, parameters, far).where
        assert where.start_s == where.end_s == pytest.approx(left_s, abs=1e-3)
        assert str(where).endswith(f"at {where.start_s:.3f} s")
    slow = published(tmp_path / "slow", times.tolist(), motion(times - times[0], frequency_hz=0.4))
    (where,) = judged(SINUSOIDS, MOTION, slow).where
    assert where.start_s == pytest.approx(times[0], abs=1e-3)
    assert where.end_s == pytest.approx(times[-1], abs=1e-3)


@pytest.mark.parametrize(("rate_hz", "missed"), [(100, 0), (100, 5), (100, 40), (50, 9)])
@pytest.mark.parametrize(
    ("angle_rad", "outcome"), [(np.pi / 2, Outcome.FAILED), (0.0, Outcome.PASSED)]
)
def test_a_jump_at_the_start_is_seen_by_the_motion_too(
    tmp_path: Path, rate_hz: float, missed: int, angle_rad: float, outcome: Outcome
) -> None:
    """Later messages show the start of the motion, even if the first ones were not recorded."""
    times = np.array(evenly(rate_hz, 6.0))
    rows = []
    for t in times - times[0]:
        rows.append([0.5 * np.sin(0.4 * np.pi * t + angle_rad), *motion(np.array([t]))[0][1:]])
    session = Session(tmp_path).endpoint("publisher", TOPIC).process("it")
    session.messages(
        TOPIC, rows[missed:], times[missed:].tolist(), sequence=range(missed + 1, len(rows) + 1)
    )
    moved = judged(SINUSOIDS, {**MOTION, "reach": 3.1416, "starts_within": 0.1}, session)
    assert (moved.outcome, "Element 0 jumps to" in moved.reason) == (
        outcome,
        outcome is Outcome.FAILED,
    )


def test_an_element_that_is_not_there_is_named(tmp_path: Path) -> None:
    """With a single element, the second sinusoid is missing."""
    times = np.array(evenly(100, 6.0))
    rows = [row[:1] for row in motion(times - times[0])]
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), rows))
    assert "no element 1" in finding.reason


@pytest.mark.parametrize(("held", "is_named"), [(1, False), (3, False), (100, True)])
def test_a_time_that_advances_in_steps_is_named(tmp_path: Path, held: int, is_named: bool) -> None:
    """A motion by whole seconds keeps each value for a hundred messages."""
    times = np.array(evenly(100, 6.0))
    ticks = np.arange(len(times)) // held * held
    rows = motion(ticks * 0.01)
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), rows))
    assert ("keeps each value for about 100 messages" in finding.reason) == is_named
    assert ("fractions of a second" in finding.hint) == is_named


def test_a_square_wave_is_no_clean_sine(tmp_path: Path) -> None:
    """A motion of another shape is told to be no sine."""
    times = np.array(evenly(100, 6.0))
    rows = motion(times - times[0])
    square = [[0.5 if row[0] > 0 else -0.5, *row[1:]] for row in rows]
    finding = judged(SINUSOIDS, MOTION, published(tmp_path, times.tolist(), square))
    assert finding.outcome is Outcome.PARTIAL
    assert "no clean sine" in finding.reason


# -- the fit of a sinusoid ---

TIMES = np.arange(600) / 100


def wave(
    amplitude: float, frequency_hz: float, phase: float = 0.0, offset: float = 0.0
) -> np.ndarray[Any, Any]:
    """Give a sampled sinusoid of 6 s."""
    values: np.ndarray[Any, Any] = offset + amplitude * np.sin(
        2 * np.pi * frequency_hz * TIMES + phase
    )
    return values


@settings(max_examples=12, deadline=None)
@given(st.floats(0.05, 2), st.floats(0.2, 0.9), st.floats(-3, 3), st.floats(-1, 1))
def test_a_clean_sinusoid_is_found(
    amplitude: float, frequency_hz: float, phase: float, offset: float
) -> None:
    """Amplitude, frequency and offset come back whatever the phase, if a whole period is there."""
    fit = fit_sinusoid(TIMES, wave(amplitude, frequency_hz, phase, offset), 0.02, 1.0)
    assert fit.amplitude == pytest.approx(amplitude, rel=0.01)
    assert fit.frequency_hz == pytest.approx(frequency_hz, rel=0.01)
    assert fit.offset == pytest.approx(offset, abs=0.02)
    assert fit.residual < 0.01


def test_noise_is_left_in_the_residual() -> None:
    """Noise around a sinusoid stays as the residual, and hardly moves the fit."""
    noise = np.random.default_rng(1).normal(0, 0.05, len(TIMES))
    fit = fit_sinusoid(TIMES, wave(0.5, 0.2) + noise, 0.02, 1.0)
    assert fit.residual == pytest.approx(0.05, rel=0.1)
    assert fit.amplitude == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("value", [0.0, 0.7])
def test_a_constant_has_an_amplitude_of_nothing(value: float) -> None:
    """A series that does not move fits with a residual of zero, and no number breaks."""
    fit = fit_sinusoid(TIMES, np.full(len(TIMES), value), 0.02, 1.0)
    assert isinstance(fit, Sinusoid)
    assert fit.residual == pytest.approx(0.0, abs=1e-6)
    assert np.isfinite([fit.amplitude, fit.frequency_hz, fit.offset]).all()


def test_the_frequency_stays_within_its_bounds() -> None:
    """A faster sinusoid than looked for is not found, and the residual says so."""
    fit = fit_sinusoid(TIMES, wave(0.5, 3.0), 0.02, 1.0)
    assert 0.02 <= fit.frequency_hz <= 1.0
    assert fit.residual > 0.3


def test_half_a_million_samples_are_fitted_in_bounded_memory() -> None:
    """A flooded topic is fitted by a part of its samples, and its sinusoid is found all the same."""
    times = np.linspace(0.0, 6.0, 500_000)
    tracemalloc.start()
    found = fit_sinusoid(times, 0.5 * np.sin(2 * np.pi * 0.2 * times), 0.02, 1.0)
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.amplitude == pytest.approx(0.5, rel=0.01)
    assert found.frequency_hz == pytest.approx(0.2, rel=0.01)
    assert most_bytes < 200_000_000


def test_the_largest_numbers_break_nothing() -> None:
    """Numbers with squares beyond the largest float are fitted without an infinity or a warning."""
    values = np.where(np.arange(len(TIMES)) % 2, 1e308, -1e308)
    with np.errstate(all="raise"):
        fit = fit_sinusoid(TIMES, values, 0.02, 1.0)
    assert np.isfinite([fit.amplitude, fit.frequency_hz, fit.offset, fit.residual]).all()
