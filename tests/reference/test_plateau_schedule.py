"""The plateau stimulus's schedule: its times, and how clearly it tells mistakes apart."""

import sys
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from plateau_schedule import COMMAND, STATE, Event, PlateauSettings, plateaus, schedule

from tests.thorough import part

SEEDS = part(range(200), 8)
CLEAR = 0.05

Floats = NDArray[np.float64]


def subscriber_errors(events: Iterable[Event]) -> Floats:
    """Give the errors that a correct subscriber computes, one row a state after the first command."""
    command, errors = None, []
    for event in events:
        if event.role == COMMAND:
            command = np.array(event.values)
        elif command is not None:
            errors.append(command - np.array(event.values))
    return np.array(errors)


def apart(right: Floats, wrong: Floats) -> NDArray[np.bool_]:
    """Tell for each joint whether two statistics differ by more than the clear margin."""
    return np.asarray(np.abs(right - wrong) > CLEAR * np.maximum(np.abs(right), np.abs(wrong)))


def test_schedule_has_the_promised_length() -> None:
    """States come alone for half a second, then 1,100 states with a command known, all within 9 s."""
    events = schedule(1)
    first = next(k for k, event in enumerate(events) if event.role == COMMAND)
    assert first == 75
    assert sum(event.role == STATE for event in events[first:]) == 1100
    assert events[-1].t_s < 9.0


def test_schedule_is_in_order_and_silent_around_commands() -> None:
    """Times never go back, and a new command comes in a silence before and after it."""
    settings = PlateauSettings()
    events = schedule(2, settings)
    assert all(a.t_s <= b.t_s for a, b in pairwise(events))
    times_s = np.array([event.t_s for event in events])
    begins_s: dict[tuple[float, ...], float] = {}
    for event in events:
        begins_s.setdefault(event.values, event.t_s)
    length_s = (settings.command_repeats - 1) * settings.command_interval_s
    _, drawn = plateaus(2, settings)
    for plateau in drawn:
        t_s = begins_s[plateau.command]
        assert t_s - times_s[times_s < t_s].max() == pytest.approx(settings.silence_s)
        assert begins_s[plateau.state] - t_s == pytest.approx(length_s + settings.silence_s)


def test_commands_go_on_at_the_rate_of_a_controller() -> None:
    """A subscriber with a use of its own for each command reports on two of three states, in each phase."""
    settings = PlateauSettings(rate_hz=150)
    reported = Counter(
        event.values
        for before, event in pairwise(schedule(3, settings))
        if (before.role, event.role) == (COMMAND, STATE)
    )
    _, drawn = plateaus(3, settings)
    for plateau in drawn:
        share = reported[plateau.state] / plateau.states
        assert share == pytest.approx(2 / 3, abs=0.02)


def test_schedule_comes_from_the_seed_alone() -> None:
    """The same seed gives the same schedule, and another seed gives other values."""
    assert schedule(5) == schedule(5)
    assert schedule(5) != schedule(6)


@pytest.mark.parametrize("seed", SEEDS)
def test_command_and_state_change_on_every_joint(seed: int) -> None:
    """From each plateau to the next the command changes clearly, and the state on every joint."""
    _, drawn = plateaus(seed)
    for a, b in pairwise(drawn):
        assert max(abs(x - y) for x, y in zip(a.command, b.command, strict=True)) > 0.1
        assert all(x != y for x, y in zip(a.state, b.state, strict=True))
        assert all(abs(value) < 3.5 for value in (*b.command, *b.state))


@pytest.mark.parametrize("seed", SEEDS)
def test_statistics_of_common_mistakes_stand_clear(seed: int) -> None:
    """Per joint, the right statistics differ by more than 5 % from each common mistake's."""
    everything = subscriber_errors(schedule(seed))
    kept = everything[-1000:]
    mean, largest = np.abs(kept).mean(axis=0), np.abs(kept).max(axis=0)
    rms = np.sqrt((kept**2).mean(axis=0))
    assert apart(mean, rms).all(), "mean and RMS"
    assert apart(mean, np.abs(kept.mean(axis=0))).all(), "signed mean"
    assert apart(rms, kept.std(axis=0)).all(), "standard deviation"
    assert 3 <= apart(largest, kept.max(axis=0)).sum() < 7, "signed maximum"
    assert apart(largest, np.percentile(np.abs(kept), 95, axis=0)).all(), "95th percentile"
    for other in (everything, everything[:1000], everything[-100:]):
        assert apart(mean, np.abs(other).mean(axis=0)).all(), "mean of another history"
        assert apart(rms, np.sqrt((other**2).mean(axis=0))).all(), "RMS of another history"
        assert apart(largest, np.abs(other).max(axis=0)).all(), "maximum of another history"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_history_of_100_is_told_from_the_last_state(seed: int) -> None:
    """The last phase is shorter than that history, so that their means differ by more than 5 % on each joint."""
    everything = np.abs(subscriber_errors(schedule(seed)))
    assert apart(everything[-100:].mean(axis=0), everything[-1]).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_reports_of_common_mistakes_stand_clear(seed: int) -> None:
    """On each plateau the RMS over joints differs by more than 5 % from wrong formulas and other plateaus."""
    _, drawn = plateaus(seed)
    errors = np.array([plateau.error for plateau in drawn])
    rms = np.sqrt((errors**2).mean(axis=1))
    wrong = (
        np.abs(errors).mean(axis=1),
        np.abs(errors.mean(axis=1)),
        np.linalg.norm(errors, axis=1),
        np.abs(errors).max(axis=1),
        np.abs(errors).sum(axis=1),
        (errors**2).mean(axis=1),
    )
    for values in wrong[:-1]:
        assert apart(rms, values).all()
    # The mean square equals its root where that is 1, so it may come near it on one plateau.
    assert apart(rms, wrong[-1]).sum() >= len(drawn) - 1
    ordered = np.sort(rms)
    assert apart(ordered[1:], ordered[:-1]).all()


@pytest.mark.parametrize("plateau_count", [5, 7, 9])
def test_other_numbers_of_plateaus_can_be_drawn(plateau_count: int) -> None:
    """The number of plateaus is free within its limits."""
    for seed in range(5):
        _, drawn = plateaus(seed, PlateauSettings(plateaus=plateau_count))
        assert len(drawn) == plateau_count
