"""Properties in signal temporal logic over fields: credit by robustness, the worst moment, vacuous passes."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from grader.result import Finding, Outcome
from tests.synthetic import Session, judged

SIGNALS = {
    "near": {"topic": "/scan", "field": "ranges", "of_several": "least"},
    "v": {"topic": "/cmd_vel", "field": "linear"},
}
STOPS = "always(implies(near < 0.5, eventually[0, 1](v <= 0.05)))"


def drive(folder: Path, near: Callable[[float], float], v: Callable[[float], float]) -> Session:
    """Make a session of ten seconds with a robot near an obstacle, driving at a speed."""
    times = [1.0 + n / 10 for n in range(101)]
    scans = [{"ranges": [math.inf, near(t - 1.0)]} for t in times]
    twists = [{"linear": {"x": v(t - 1.0)}} for t in times]
    session = Session(folder).process().typed("/scan", "sensor_msgs/msg/LaserScan", scans, times)
    return session.typed("/cmd_vel", "geometry_msgs/msg/Twist", twists, times).window(1.0, 11.0)


def braked(folder: Path, after_s: float, to: float = 0.0, **more: Any) -> Finding:
    """Judge a robot that comes near at 5 s and slows down some time after."""
    session = drive(
        folder, lambda t: 2.0 if t < 5 else 0.4, lambda t: 0.3 if t < 5 + after_s else to
    )
    parameters = {"signals": SIGNALS, "property": STOPS, "window": "window", **more}
    return judged("signal_property", parameters, session)


def test_a_property_that_holds_passes(tmp_path: Path) -> None:
    """The robot stops 0.5 s after it comes near."""
    finding = braked(tmp_path, 0.5)
    assert finding.outcome is Outcome.PASSED
    assert finding.measured.startswith("holds by 0.05")


def test_one_that_does_not_shows_the_moment_with_the_values(tmp_path: Path) -> None:
    """1.5 s are too late, from the moment on at which it came near."""
    finding = braked(tmp_path, 1.5)
    assert finding.outcome is Outcome.FAILED
    assert "near = 0.4, v = 0.3" in finding.reason
    assert finding.where[0].start_s is not None
    assert 6.0 <= finding.where[0].start_s <= 7.5


@pytest.mark.parametrize(
    ("to", "credit"), [(0.05, "1"), (0.07, "0.8"), (0.1, "0.5"), (0.15, "0"), (0.3, "0")]
)
def test_robustness_is_credit_where_the_rubric_gives_its_scale(
    tmp_path: Path, to: float, credit: str
) -> None:
    """From 0 to 0.1 m/s too fast."""
    assert braked(tmp_path, 0.5, to, none_below=-0.1).credit == Decimal(credit)


def test_a_vacuous_pass_is_said_and_earns_what_the_rubric_says(tmp_path: Path) -> None:
    """A robot that never comes near shows nothing."""
    for credit in (0.0, 0.5):
        session = drive(tmp_path / str(credit), lambda t: 2.0, lambda t: 0.3)
        parameters = {"signals": SIGNALS, "property": STOPS, "vacuous_credit": credit}
        finding = judged("signal_property", parameters, session)
        assert float(finding.credit) == credit
        assert finding.reason == "Not tested in this run: 'near < 0.5' was never true."


def test_signals_are_held_or_on_the_line_between(tmp_path: Path) -> None:
    """Between 0 and 1 lies 0.5 on the line, and 0 where the last value holds."""
    for between, outcome in (("hold", Outcome.FAILED), ("linear", Outcome.PASSED)):
        rows = [{"data": 0.0}, {"data": 1.0}, {"data": 0.0}]
        session = Session(tmp_path / between).typed(
            "/f", "std_msgs/msg/Float64", rows, [1.0, 2.0, 3.0]
        )
        signals = {"f": {"topic": "/f", "field": "data", "between": between}}
        parameters = {"signals": signals, "property": "eventually(0.4 < f < 0.6)"}
        assert judged("signal_property", parameters, session).outcome is outcome


def test_a_property_that_the_machine_may_have_broken_is_in_doubt(tmp_path: Path) -> None:
    """A delay about the moment leaves it open, one at another time does not."""
    for at_s, outcome in ((6.5, Outcome.INCONCLUSIVE), (2.0, Outcome.FAILED)):
        session = drive(
            tmp_path / str(at_s), lambda t: 2.0 if t < 5 else 0.4, lambda t: 0.3 if t < 6.2 else 0.0
        )
        session.disturbed("it", (at_s, 0.4))
        parameters = {"signals": SIGNALS, "property": STOPS}
        assert judged("signal_property", parameters, session).outcome is outcome


def test_a_silent_signal_fails_and_a_short_one_is_not_tested(tmp_path: Path) -> None:
    """Without a signal a property can neither hold nor fail."""
    silent = Session(tmp_path / "silent").process().window(1.0, 11.0)
    assert (
        judged("signal_property", {"signals": SIGNALS, "property": STOPS}, silent).outcome
        is Outcome.FAILED
    )
    short = drive(tmp_path / "short", lambda t: 2.0, lambda t: 0.0)
    parameters = {"signals": SIGNALS, "property": "always[0, 60](v < 1)"}
    finding = judged("signal_property", parameters, short)
    assert finding.outcome is Outcome.NOT_REACHED
    assert "10.0 s" in finding.reason


def test_a_mistake_in_a_property_is_told_when_the_rubric_loads(tmp_path: Path) -> None:
    """A mistake in a property is reported with its place."""
    with pytest.raises(
        ValidationError, match=r"there is no signal 'w', only [^(]+ \(at character 8"
    ):
        judged(
            "signal_property", {"signals": SIGNALS, "property": "always(w < 1)"}, Session(tmp_path)
        )


@pytest.mark.parametrize("window", [(0.2, 0.8), (4.0, 8.0)])
def test_a_signal_outside_the_window_shows_nothing(
    tmp_path: Path, window: tuple[float, float]
) -> None:
    """Messages before the end of the node or after the window say nothing about the window."""
    session = (
        Session(tmp_path)
        .process()
        .typed("/v", "std_msgs/msg/Float64", [{}, {}], [1.0, 2.0])
        .window(*window)
    )
    parameters = {
        "signals": {"v": {"topic": "/v", "field": "data"}},
        "property": "always(v < 1)",
        "window": "window",
    }
    finding = judged("signal_property", parameters, session)
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "No message arrived on /v in the time that counts."
