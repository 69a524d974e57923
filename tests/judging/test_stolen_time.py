"""Rates of programs that the machine stopped for a quarter of the time, a hundred times within their six seconds.

The recordings are of `reference/solution` with one line changed, and of a fixture, beside `bench.load.stolen`.
"""

from __future__ import annotations

import tarfile
from pathlib import Path

import pytest

from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.result import CheckResult

KEPT = Path(__file__).resolve().parents[1] / "stolen_recordings"


def judged(name: str, folder: Path) -> dict[str, CheckResult]:
    """Give the checks of a kept recording."""
    with tarfile.open(KEPT / f"{name}.tar.xz") as archive:
        archive.extractall(folder, filter="data")
    rubric = read_rubric(None)
    return {check.id: check for check in judge(open_recordings(folder, rubric), rubric).every_check}


@pytest.mark.parametrize(
    ("name", "rate_hz", "earned"),
    [
        ("rate_98_5_hz", "98.50 Hz", 6.5),
        ("rate_97_5_hz", "97.50 Hz", 5.9),
        ("rate_90_hz", "90.00 Hz", 3.3),
    ],
)
def test_a_timers_rate_is_known_although_a_sixth_of_its_messages_are_missing(
    name: str, rate_hz: str, earned: float, tmp_path: Path
) -> None:
    """98 Hz are full, and 98.5 and 97.5 Hz are told apart."""
    rate = judged(name, tmp_path)["publisher.rate"]
    assert rate.measured.startswith(f"{rate_hz} ± 0.01 Hz")
    assert (rate.outcome.decided, float(rate.earned)) == (True, earned)


def test_a_loop_with_a_sleep_is_judged_by_its_undisturbed_intervals(tmp_path: Path) -> None:
    """A sleeping loop restarts after each delay, without a schedule.

    A schedule would give another rate.
    """
    rate = judged("drifting_sleep_loop", tmp_path)["publisher.rate"]
    shown_hz, _, _, error_hz, *_ = rate.measured.split()
    assert 86 < float(shown_hz) < 88
    assert 0.1 < float(error_hz) < 0.5


def test_a_rate_that_is_not_decided_is_shown_with_bounds_that_hold_it(tmp_path: Path) -> None:
    """Its timer of 100 Hz sends 85 messages a second here, each late by up to 15 ms: that is near one of the bounds."""
    rate = judged("jitter_15_ms", tmp_path)["publisher.rate"]
    shown_hz, _, _, error_hz, *_ = rate.measured.split()
    assert not rate.outcome.decided
    assert abs(float(shown_hz) - 100) <= float(error_hz) < 6


def test_what_a_program_leaves_out_by_itself_is_not_paid_for_as_stolen(tmp_path: Path) -> None:
    """One callback in 25 of a 100 Hz timer returns at once: 96 Hz are never judged as full."""
    rate = judged("skips_one_in_25", tmp_path)["publisher.rate"]
    assert float(rate.earned) < 5
    assert float(rate.measured.split()[0]) < 98
