"""Expected values of the lab, computed from what was recorded. Pure: numpy only.

Each oracle is called with the recorded streams by role ("command", "state"), the check's parameters and the
session's seed. A stream has the int64 arrays `received_ns`, `source_ns` and `sequence` of n messages in the
order of `source_ns`, and `values`, n rows of float64, one column a joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

HISTORY = 1000
SLACK_STATES = 5
REPORT_TOLERANCE = 0.002
SHORTEST_PLATEAU_STATES = 10


class Stream(Protocol):
    """The recorded messages of one topic in the order of their source timestamps."""

    @property
    def received_ns(self) -> Integers:
        """When the recorder received each message."""

    @property
    def source_ns(self) -> Integers:
        """When the publisher's middleware sent each message."""

    @property
    def sequence(self) -> Integers:
        """Publication sequence number of each message."""

    @property
    def values(self) -> Floats:
        """Data of each message, a row each."""


@dataclass(frozen=True)
class _Tracking:
    """States after the first command, each with the command of its time."""

    source_ns: Integers
    commands: Floats
    states: Floats

    @property
    def errors(self) -> Floats:
        return self.commands - self.states

    def runs(self) -> Iterator[tuple[int, int]]:
        """Give first and last + 1 index of each run of constant command and state."""
        both = np.hstack((self.commands, self.states))
        borders = 1 + np.flatnonzero(np.any(both[1:] != both[:-1], axis=1))
        edges = [0, *borders.tolist(), len(both)]
        return ((a, b) for a, b in pairwise(edges) if b > a)


def _tracking(streams: Mapping[str, Stream], command_kept: str = "latest") -> _Tracking:
    """Give the states with their commands; a subscriber that keeps the first command compares all with that."""
    for role in ("command", "state"):
        if role not in streams:
            raise ValueError(f"the oracle needs the stream {role!r}; name its topic in the rubric")
    command, state = streams["command"], streams["state"]
    current = np.searchsorted(command.source_ns, state.source_ns, side="right") - 1
    known = current >= 0
    current = np.zeros_like(current) if command_kept == "first" else current
    commands = command.values[current[known]] if known.any() else np.empty((0, state.values.shape[1]))
    return _Tracking(state.source_ns[known], commands, state.values[known])


def tracking_plateaus(streams: Mapping[str, Stream], parameters: Mapping[str, Any], seed: int) -> list[dict[str, Any]]:
    """Give the spans of constant command and state with the RMS tracking error that a report must show.

    Parameters
    ----------
    streams : mapping
        Roles "command" and "state".
    parameters : mapping
        `min_states` (10): shorter spans are left out. To recognise mistakes: `formula` ("rms"; or "mean" of |error|,
        "signed" mean, mean "square", standard "deviation"), `over` ("state"; or "history": over all errors so far, at
        most `history` (1000)), `command` ("latest", or "first"), `scale` (1): a factor, as of another unit.
    seed : int
        Not used: the recording holds all that is needed.

    Returns
    -------
    list of dict
        `start_ns`, `end_ns`: source timestamps of the span's first and last state; `value`: the root of the
        mean over joints of (command − state)², in rad. Spans before the first command are left out.

    Raises
    ------
    ValueError
        If a role is missing.
    """
    tracking = _tracking(streams)
    shortest = parameters.get("min_states", SHORTEST_PLATEAU_STATES)
    errors = _tracking(streams, parameters.get("command", "latest")).errors
    history = parameters.get("history", HISTORY) if parameters.get("over", "state") == "history" else 1
    values = _each_reported(errors, parameters.get("formula", "rms"), history) * parameters.get("scale", 1.0)
    return [
        {
            "start_ns": int(tracking.source_ns[a]),
            "end_ns": int(tracking.source_ns[b - 1]),
            "value": float(np.median(values[a:b])),
        }
        for a, b in tracking.runs()
        if b - a >= shortest
    ]


def _each_reported(errors: Floats, formula: str, history: int) -> Floats:
    """Give what is reported on each state by a formula over the joints of the last `history` errors."""
    if formula == "deviation":
        spread: Floats = errors.std(axis=1)
        return spread
    kinds = {"rms": errors**2, "square": errors**2, "mean": np.abs(errors), "signed": errors}
    terms = kinds[formula].mean(axis=1)
    if history > 1:
        total = np.concatenate(([0.0], np.cumsum(terms)))
        last = np.arange(1, len(total))
        first = np.maximum(0, last - history)
        terms = np.maximum(total[last] - total[first], 0.0 if formula in ("rms", "square") else -np.inf) / (
            last - first
        )
    values: Floats = np.sqrt(terms) if formula == "rms" else terms
    return values


def expected_reports(streams: Mapping[str, Stream], parameters: Mapping[str, Any], seed: int) -> int:
    """Give the number of states for which an error can be computed: those after the first command.

    Raises
    ------
    ValueError
        If a role is missing.
    """
    return len(_tracking(streams).source_ns)


@dataclass(frozen=True)
class _Mixture:
    """Which errors a history may hold, and at least and at most how often each."""

    errors: Floats  # (k, joints)
    fewest: Integers  # (k,)
    most: Integers  # (k,)


def _mixture(tracking: _Tracking, history: int | None, slack: int) -> _Mixture:
    """Give what the history may hold if `slack` states of each plateau are in doubt.

    States in doubt may be missing, or the last ones of a plateau may be taken with the next command, when
    a subscriber that fell behind finds both waiting. (The reverse would need a command that arrives
    after states sent a silence later.) Missing states make the history reach back further.
    """
    runs = list(tracking.runs())
    total = len(tracking.source_ns)
    begin = max(0, total - history) if history is not None else 0
    reach = max(0, begin - slack * len(runs))
    errors, fewest, most = [], [], []
    for i, (a, b) in enumerate(runs):
        errors.append(tracking.errors[a])
        fewest.append(max(0, b - max(a, begin) - slack))
        most.append(max(0, b - max(a, reach)))
        if i and a > reach:
            errors.append(tracking.commands[a] - tracking.states[a - 1])
            fewest.append(0)
            most.append(slack)
    return _Mixture(np.array(errors), np.array(fewest), np.array(most))


def _highest_mean(values: Floats, fewest: Integers, most: Integers) -> float:
    """Give the highest mean of values that occur between `fewest` and `most` times.

    Notes
    -----
    The mean is a ratio of two functions linear in the counts, so it is highest at a corner: the greatest
    values as often, all others as seldom as they may. There are only as many such corners as values.
    """
    order = np.argsort(-values, kind="stable")
    v, few, many = values[order], fewest[order], most[order]
    extra = np.concatenate(([0], np.cumsum(many - few)))
    weighted = np.concatenate(([0.0], np.cumsum((many - few) * v)))
    count = extra + few.sum()
    possible = count > 0
    return float(np.max((weighted + (few * v).sum())[possible] / count[possible]))


def _mean_bounds(values: Floats, mixture: _Mixture) -> tuple[list[float], list[float]]:
    columns = values.T
    high = [_highest_mean(column, mixture.fewest, mixture.most) for column in columns]
    low = [-_highest_mean(-column, mixture.fewest, mixture.most) for column in columns]
    return low, high


def _max_bounds(values: Floats, mixture: _Mixture) -> tuple[list[float], list[float]]:
    possible, sure = values[mixture.most > 0], values[mixture.fewest > 0]
    low = sure.max(axis=0) if len(sure) else possible.min(axis=0)
    return low.tolist(), possible.max(axis=0).tolist()


def _statistic(low: list[float], value: Floats, high: list[float]) -> dict[str, list[float]]:
    exact = [float(v) for v in value]
    # Rounding in the bounds' sums must not put the exact value outside of them.
    return {
        "low": [min(a, v) for a, v in zip(low, exact, strict=True)],
        "value": exact,
        "high": [max(b, v) for b, v in zip(high, exact, strict=True)],
    }


def _statistics(errors: Floats, mixture: _Mixture, signed: bool) -> dict[str, dict[str, list[float]]]:
    """Give mean, maximum and RMS of the errors, each with what the mixture makes of it at most."""
    exact, bounded = (errors, mixture.errors) if signed else (np.abs(errors), np.abs(mixture.errors))
    mean_low, mean_high = _mean_bounds(bounded, mixture)
    max_low, max_high = _max_bounds(bounded, mixture)
    square_low, square_high = _mean_bounds(mixture.errors**2, mixture)
    return {
        "mean": _statistic(mean_low, np.mean(exact, axis=0), mean_high),
        "max": _statistic(max_low, np.max(exact, axis=0), max_high),
        "rms": _statistic(
            np.sqrt(square_low).tolist(),
            np.sqrt(np.mean(errors**2, axis=0)),
            np.sqrt(square_high).tolist(),
        ),
    }


def _deviation(errors: Floats, mixture: _Mixture, rms: dict[str, list[float]]) -> dict[str, list[float]]:
    """Give the standard deviation of the errors, bounded by the bounds of RMS and mean: σ² = RMS² − mean²."""
    low, high = (np.array(bound) for bound in _mean_bounds(mixture.errors, mixture))
    nearest = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(np.abs(low), np.abs(high)))
    farthest = np.maximum(np.abs(low), np.abs(high))
    least = np.sqrt(np.maximum(np.array(rms["low"]) ** 2 - farthest**2, 0.0))
    most = np.sqrt(np.maximum(np.array(rms["high"]) ** 2 - nearest**2, 0.0))
    return _statistic(least.tolist(), errors.std(axis=0), most.tolist())


def _reported(tracking: _Tracking, reports: Sequence[Sequence[float]]) -> _Tracking:
    """Give the states that were reported: for each report one of the last run before it whose error it shows."""
    runs = list(tracking.runs())
    values = np.sqrt(np.mean(tracking.errors**2, axis=1))
    rows = []
    for t_ns, value in reports:
        begun = [a for a, _ in runs if tracking.source_ns[a] <= t_ns and abs(values[a] - value) <= REPORT_TOLERANCE]
        rows += begun[-1:]
    return _Tracking(tracking.source_ns[rows], tracking.commands[rows], tracking.states[rows])


def tracking_statistics(
    streams: Mapping[str, Stream], parameters: Mapping[str, Any], seed: int
) -> dict[str, dict[str, list[float]]]:
    """Give the statistics that a subscriber's history of tracking errors must hold at the end.

    Parameters
    ----------
    streams : mapping
        Roles "command" and "state", of a stimulus with constant values on plateaus.
    parameters : mapping
        `history` (1000): number of errors kept, the last ones; None for all since the first command.
        `slack_states` (5): how many states of each plateau may be missing, the last ones included, or
        taken with the next plateau's command.
        `signed` (false): mean and maximum of the error itself, to recognise a forgotten absolute value.
        `keep` ("last", or "first"): which errors a history holds that is full, to recognise one that stops then.
        `command` ("latest", or "first"): with which command states are compared.
        `scale` (1): a factor, to recognise another unit.
        `deviation` (false): the standard deviation in place of the RMS, to recognise `numpy.std`.
        `squared` (false): the mean square in place of the RMS, to recognise a forgotten root.
        `summed` (false): the root of the sum in place of the RMS, to recognise `numpy.linalg.norm`.
        `magnitude` (false): the mean of |error| in place of the RMS.
        `reports` (none): pairs of time (ns) and RMS error as a subscriber reported them. Then the statistics
        are those over the states that it reported, which are fewer where it lost some.
    seed : int
        Not used: the recording holds all that is needed.

    Returns
    -------
    dict
        `mean` and `max` of |error|, `rms` of the error, each over the history and with a number a joint (rad)
        under `value`, and under `low` and `high` the bounds between which doubtful states can move it. Nothing if
        no report shows a state's error.

    Raises
    ------
    ValueError
        If a role is missing, or no state follows a command.
    """
    history = parameters.get("history", HISTORY)
    tracking = _tracking(streams, parameters.get("command", "latest"))
    if parameters.get("reports") is not None:
        tracking = _reported(tracking, parameters["reports"])
        if not len(tracking.source_ns):
            return {}
    if parameters.get("keep", "last") == "first":
        tracking = _Tracking(tracking.source_ns[:history], tracking.commands[:history], tracking.states[:history])
    if not len(tracking.source_ns):
        raise ValueError("no state after a first command was recorded: the stimulus did not run")
    mixture = _mixture(tracking, history, parameters.get("slack_states", SLACK_STATES))
    errors = tracking.errors if history is None else tracking.errors[-history:]
    found = _statistics(errors, mixture, signed=bool(parameters.get("signed", False)))
    if parameters.get("deviation"):
        found["rms"] = _deviation(errors, mixture, found["rms"])
    if parameters.get("squared"):
        found["rms"] = {kind: [x * x for x in row] for kind, row in found["rms"].items()}
    if parameters.get("summed"):
        found["rms"] = {kind: [x * len(errors) ** 0.5 for x in row] for kind, row in found["rms"].items()}
    if parameters.get("magnitude"):
        found["rms"] = found["mean"]
    scale = float(parameters.get("scale", 1.0))
    return {key: {kind: [scale * x for x in row] for kind, row in rows.items()} for key, rows in found.items()}


def controlled(streams: Mapping[str, Stream], parameters: Mapping[str, Any], seed: int) -> Mapping[str, NDArray[Any]]:
    """Commands of a controller with the gain `kp`, at the times of the states; none before it knows a goal."""
    goal, state = streams["goal"], streams["state"]
    place = np.searchsorted(goal.source_ns, state.source_ns, side="right") - 1
    command = state.values + parameters["kp"] * (goal.values[np.maximum(place, 0)] - state.values)
    command[place < 0] = np.nan
    return {"times_ns": state.source_ns, "values": command}
