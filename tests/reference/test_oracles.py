"""The oracles against a subscriber that is simulated message by message."""

import sys
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from oracles import (
    expected_reports,
    reports_once_per_command,
    tracking_plateaus,
    tracking_statistics,
)
from plateau_schedule import COMMAND, STATE, Event, PlateauSettings, plateaus, schedule

from tests.thorough import part

START_NS = 1_700_000_000 * 10**9
SEEDS = part(range(25), 5)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Recorded:
    """A recorded topic as the engine hands it to an oracle."""

    received_ns: NDArray[np.int64]
    source_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    values: Floats


def recorded(events: Sequence[Event]) -> dict[str, Recorded]:
    """Give the streams that a recorder keeps of the stimulus."""
    streams = {}
    for role in (COMMAND, STATE):
        mine = [event for event in events if event.role == role]
        sent_ns = np.array([START_NS + round(event.t_s * 1e9) for event in mine], dtype=np.int64)
        rows = np.array([event.values for event in mine], dtype=np.float64).reshape(len(mine), 7)
        streams[role] = Recorded(sent_ns + 200_000, sent_ns, np.arange(1, len(mine) + 1), rows)
    return streams


class Subscriber:
    """A subscriber as required by the lab: the latest command, and a limited history of errors."""

    def __init__(self, history: int | None = 1000) -> None:
        self.command: Floats | None = None
        self.errors: deque[Floats] = deque(maxlen=history)
        self.reports: list[float] = []

    def hear(self, event: Event) -> None:
        """Take one message in."""
        values = np.array(event.values)
        if event.role == COMMAND:
            self.command = values
        elif self.command is not None:
            self.errors.append(self.command - values)
            self.reports.append(float(np.sqrt(np.mean(self.errors[-1] ** 2))))

    def statistics(self) -> dict[str, Floats]:
        """Give the statistics that the lab asks for."""
        errors = np.array(self.errors)
        return {
            "mean": np.abs(errors).mean(axis=0),
            "max": np.abs(errors).max(axis=0),
            "rms": np.sqrt((errors**2).mean(axis=0)),
        }


def hear_all(events: Sequence[Event], history: int | None = 1000) -> Subscriber:
    """Give a subscriber that has heard all events."""
    subscriber = Subscriber(history)
    for event in events:
        subscriber.hear(event)
    return subscriber


def border_trouble(events: Sequence[Event], rng: np.random.Generator, most: int) -> list[Event]:
    """Give the events as a tardy subscriber hears them: at each border the last states are lost, or come too late."""
    heard: list[Event] = []
    command: tuple[float, ...] | None = None
    for event in events:
        is_command = event.role == COMMAND
        if is_command and command not in (None, event.values):
            amount = int(rng.integers(0, most + 1))
            late = list(map(heard.pop, _last_states(heard, amount)))
            if rng.random() < 0.5:
                heard += [event, *late]
        if is_command:
            command = event.values
        heard.append(event)
    lost_at_the_end = int(rng.integers(0, most + 1))
    return heard[: len(heard) - lost_at_the_end]


def _last_states(heard: Sequence[Event], amount: int) -> list[int]:
    """Give the places of some states at the end, the last one first."""
    places = np.flatnonzero([event.role == STATE for event in heard]).tolist()
    return places[: -amount - 1 : -1]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("history", [1000, None, 300])
def test_statistics_are_those_of_a_correct_subscriber(seed: int, history: int | None) -> None:
    """The expected values equal a simulated subscriber's, and the bounds enclose them narrowly."""
    events = schedule(seed)
    expected = tracking_statistics(recorded(events), {"history": history}, seed)
    for name, measured in hear_all(events, history).statistics().items():
        statistic = {key: np.array(values) for key, values in expected[name].items()}
        np.testing.assert_allclose(statistic["value"], measured, rtol=1e-12)
        assert (statistic["low"] <= statistic["value"]).all()
        assert (statistic["value"] <= statistic["high"]).all()
        if history == 1000:
            up, down = (1.1, 0.94) if name != "max" else (1.0, 1.0)
            assert (statistic["high"] <= up * statistic["value"]).all()
            assert (statistic["low"] >= down * statistic["value"]).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_bounds_hold_with_trouble_at_the_borders(seed: int) -> None:
    """States lost at a border, or taken with the new command too soon, stay within the bounds."""
    events, rng = schedule(seed), np.random.default_rng(seed)
    expected = tracking_statistics(recorded(events), {}, seed)
    for _ in range(5):
        heard = border_trouble(events, rng, most=5)
        for name, measured in hear_all(heard).statistics().items():
            assert (measured >= np.array(expected[name]["low"]) - 1e-12).all()
            assert (measured <= np.array(expected[name]["high"]) + 1e-12).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_statistics_of_mistakes_are_out_of_bounds(seed: int) -> None:
    """Signed means and histories without end, or of 100, leave the bounds on every joint, maxima on some."""
    events = schedule(seed)
    expected = tracking_statistics(recorded(events), {}, seed)

    def outside(name: str, values: Floats) -> NDArray[np.bool_]:
        low, high = np.array(expected[name]["low"]), np.array(expected[name]["high"])
        return np.asarray((values < 0.99 * low) | (values > 1.01 * high))

    for history in (None, 100):
        for name, values in hear_all(events, history).statistics().items():
            assert outside(name, values).all()
    errors = np.array(hear_all(events).errors)
    assert outside("mean", errors.mean(axis=0)).all()
    assert outside("rms", np.abs(errors).mean(axis=0)).all()
    assert outside("mean", np.sqrt((errors**2).mean(axis=0))).all()
    assert outside("max", errors.max(axis=0)).sum() >= 3


def test_signed_statistics_recognise_a_forgotten_absolute_value() -> None:
    """With `signed`, mean and maximum are taken of the error itself; the RMS is the same."""
    events = schedule(9)
    errors = np.array(hear_all(events).errors)
    signed = tracking_statistics(recorded(events), {"signed": True}, 9)
    np.testing.assert_allclose(signed["mean"]["value"], errors.mean(axis=0))
    np.testing.assert_allclose(signed["max"]["value"], errors.max(axis=0))
    assert signed["rms"] == tracking_statistics(recorded(events), {}, 9)["rms"]


@pytest.mark.parametrize("seed", SEEDS)
def test_plateaus_carry_the_reported_rms(seed: int) -> None:
    """Each plateau has the RMS that a correct subscriber reports throughout it, in the schedule's order."""
    events = schedule(seed)
    spans = tracking_plateaus(recorded(events), {}, seed)
    _, drawn = plateaus(seed)
    assert len(spans) == len(drawn)
    reports = hear_all(events).reports
    for span, plateau in zip(spans, drawn, strict=True):
        mine, reports = reports[: plateau.states], reports[plateau.states :]
        np.testing.assert_allclose(mine, span["value"], rtol=1e-12)
        length_s = (span["end_ns"] - span["start_ns"]) / 1e9
        assert length_s == pytest.approx((plateau.states - 1) / PlateauSettings().rate_hz)
    assert not reports


def test_reports_are_expected_from_the_first_command_on() -> None:
    """States before any command call for no report; every later one does."""
    events = schedule(3)
    assert expected_reports(recorded(events), {}, 3) == len(hear_all(events).reports) == 1100
    early = [event for event in events if event.t_s < 0.5]
    assert expected_reports(recorded(early), {}, 3) == 0
    assert tracking_plateaus(recorded(early), {}, 3) == []


def test_a_command_that_is_used_once_leads_to_a_report_each() -> None:
    """Of several commands without a state between them, the last one leads to a report."""
    events = schedule(3, PlateauSettings(rate_hz=150))
    reports = reports_once_per_command(recorded(events), {}, 3)
    assert reports == pytest.approx(1100 * 100 / 150, rel=0.02)
    assert reports_once_per_command(recorded([e for e in events if e.t_s < 0.5]), {}, 3) == 0


def test_a_stimulus_that_did_not_run_is_no_verdict() -> None:
    """Without states after a command, or without a stream, there is an error and no expected value."""
    early = recorded([event for event in schedule(3) if event.t_s < 0.5])
    with pytest.raises(ValueError, match="did not run"):
        tracking_statistics(early, {}, 3)
    with pytest.raises(ValueError, match="command"):
        tracking_statistics({"state": early["state"]}, {}, 3)


def reported_by(
    events: Sequence[Event], report: Callable[[Floats, list[Floats]], float], *, first: bool
) -> list[float]:
    """Return the reports of a subscriber with its own way of forming them."""
    command, errors, reports = None, [], []
    for event in events:
        values = np.array(event.values)
        if event.role == COMMAND:
            command = values if command is None or not first else command
        elif command is not None:
            errors.append(command - values)
            reports.append(report(errors[-1], errors[-1000:]))
    return reports


@pytest.mark.parametrize(
    ("parameters", "report", "first"),
    [
        (
            {"over": "history"},
            lambda _, history: float(np.sqrt(np.mean(np.array(history) ** 2))),
            False,
        ),
        ({"command": "first"}, lambda error, _: float(np.sqrt(np.mean(error**2))), True),
        ({"formula": "mean"}, lambda error, _: float(np.mean(np.abs(error))), False),
        ({"formula": "square"}, lambda error, _: float(np.mean(error**2)), False),
        ({"formula": "deviation"}, lambda error, _: float(np.std(error)), False),
        ({"formula": "signed"}, lambda error, _: float(np.mean(error)), False),
        (
            {"scale": float(np.degrees(1))},
            lambda error, _: float(np.degrees(np.sqrt(np.mean(error**2)))),
            False,
        ),
    ],
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_known_mistakes_in_the_series_are_recognised(
    seed: int,
    parameters: dict[str, Any],
    report: Callable[[Floats, list[Floats]], float],
    first: bool,
) -> None:
    """The median on each plateau matches a subscriber with the mistake.

    On half of the plateaus it differs from the right one.
    """
    events = schedule(seed)
    reports = reported_by(events, report, first=first)
    right = tracking_plateaus(recorded(events), {}, seed)
    wrong = tracking_plateaus(recorded(events), parameters, seed)
    sent_ns = recorded(events)[STATE].source_ns[-len(reports) :]
    for span in wrong:
        inside = []
        for t, r in zip(sent_ns, reports, strict=True):
            if span["start_ns"] <= t <= span["end_ns"]:
                inside.append(r)
        assert np.median(inside) == pytest.approx(span["value"], abs=1e-9)
    differing = []
    for a, b in zip(wrong, right, strict=True):
        differing.append(abs(a["value"] - b["value"]) > max(0.002, 0.01 * b["value"]))
    assert sum(differing) >= 3


@pytest.mark.parametrize("seed", SEEDS)
def test_a_history_that_stops_when_full_is_recognised(seed: int) -> None:
    """The first 1000 errors give other means than the last, and the oracle gives those."""
    events = schedule(seed)
    errors = np.array(hear_all(events, None).errors)[:1000]
    found = tracking_statistics(recorded(events), {"keep": "first"}, seed)
    right = tracking_statistics(recorded(events), {}, seed)
    assert found["mean"]["value"] == pytest.approx(np.abs(errors).mean(axis=0))
    mean = np.array(found["mean"]["value"])
    assert (
        (mean > np.array(right["mean"]["high"])) | (mean < np.array(right["mean"]["low"]))
    ).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_commands_taken_for_degrees_are_recognised(seed: int) -> None:
    """Series and statistics of a subscriber that converts commands from degrees are given, and are not right."""
    events = schedule(seed)
    in_rad = []
    for event in events:
        values = event.values
        if event.role == COMMAND:
            values = tuple(np.radians(values))
        in_rad.append(event._replace(values=values))
    streams = recorded(events)
    converted = recorded(in_rad)
    for oracle in (tracking_statistics, tracking_plateaus):
        found = oracle(streams, {"command": "degrees"}, seed)
        assert found == oracle(converted, {}, seed)
        assert found != oracle(streams, {}, seed)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_standard_deviation_is_recognised(seed: int) -> None:
    """numpy.std over the history lies within its bounds with trouble at the borders too, and is no right RMS."""
    events = schedule(seed)
    heard = border_trouble(events, np.random.default_rng(seed), 5)
    wrong = np.array(hear_all(heard).errors).std(axis=0)
    found = tracking_statistics(recorded(events), {"deviation": True}, seed)["rms"]
    right = tracking_statistics(recorded(events), {}, seed)["rms"]
    assert (np.array(found["low"]) - 1e-9 <= wrong).all()
    assert (wrong <= np.array(found["high"]) + 1e-9).all()
    assert (wrong < np.array(right["low"])).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_forgotten_root_is_recognised(seed: int) -> None:
    """The mean of the squared errors lies within its bounds, and is no right RMS."""
    events = schedule(seed)
    wrong = (np.array(hear_all(events).errors) ** 2).mean(axis=0)
    found = tracking_statistics(recorded(events), {"squared": True}, seed)["rms"]
    right = tracking_statistics(recorded(events), {}, seed)["rms"]
    assert found["value"] == pytest.approx(wrong)
    assert (wrong < np.array(right["low"])).any()


def test_statistics_in_another_unit_are_recognised() -> None:
    """A factor goes into the value and its bounds alike."""
    streams = recorded(schedule(0))
    plain, scaled = (
        tracking_statistics(streams, {"scale": scale}, 0)["rms"] for scale in (1.0, 10.0)
    )
    assert all(
        np.allclose(10 * np.array(plain[kind]), scaled[kind]) for kind in ("low", "value", "high")
    )


@pytest.mark.parametrize(
    ("mistake", "wrong"),
    [
        ("summed", lambda e: np.sqrt((e**2).sum(axis=0))),
        ("magnitude", lambda e: np.abs(e).mean(axis=0)),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_another_formula_for_the_rms_is_recognised(
    seed: int, mistake: str, wrong: Callable[[Floats], Floats]
) -> None:
    """The root of the sum, and the mean of |error|, lie within their bounds, and are no right RMS."""
    events = schedule(seed)
    value = wrong(np.array(hear_all(events).errors))
    found = tracking_statistics(recorded(events), {mistake: True}, seed)["rms"]
    right = tracking_statistics(recorded(events), {}, seed)["rms"]
    assert found["value"] == pytest.approx(value)
    outside = (value < np.array(right["low"])) | (value > np.array(right["high"]))
    assert outside.any()
