"""Check of a motion: a field comes to a target in time, stays there, and does not go beyond it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    Part,
    apart,
    failed,
    graded,
    not_reached,
    quantise,
    ramp,
)
from grader.checks.fields import InWindow, NumbersOf, moment, nothing_came
from grader.evidence import bounds
from grader.evidence.bounds import MANY_DELAYS, Delayed, Interval
from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Floats, Integers, NumericStream
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.result import Finding

#: Function from values and targets, a row for each time, to their distances.
Measure = Callable[[Floats, Floats], Floats]


def straight(values: Floats, others: Floats) -> Floats:
    """Return the Euclidean distance."""
    distances: Floats = np.sqrt(((values - others) ** 2).sum(axis=-1))
    return distances


def turned(values: Floats, others: Floats) -> Floats:
    """Return the distance of angles in rad, the shorter way round."""
    turn = 2 * np.pi
    shifted = (values - others + np.pi) % turn
    return straight(shifted - np.pi, np.zeros(1))


def _or_infinite(lengths: Floats) -> Floats:
    """Return lengths as divisors: infinite instead of 0, and of not-a-numbers."""
    divisors: Floats = np.where(lengths > 0, lengths, np.inf)
    return divisors


def rotated(values: Floats, others: Floats) -> Floats:
    """Return the angle in rad between two orientations, as quaternions x, y, z and w of any length but 0."""
    lengths = np.linalg.norm(values, axis=-1)
    other_lengths = np.linalg.norm(others, axis=-1)
    products = (values * others).sum(axis=-1)
    cosines = np.abs(products) / _or_infinite(lengths * other_lengths)
    angles: Floats = 2 * np.arccos(np.clip(cosines, 0, 1))
    return angles


DISTANCES: Mapping[str, Measure] = {"straight": straight, "angle": turned, "rotation": rotated}
Distance = Literal["straight", "angle", "rotation"]


class Target(Parameters):
    """Target of a field: a value, another topic's field at the same time, or an oracle's value."""

    exactly_one = ("value", "field", "oracle")

    value: float | tuple[float, ...] | None = Field(
        None, description="A number, or one for each of the field's."
    )
    field: NumbersOf | None = Field(
        None, description="Topic and field that is followed as it moves."
    )
    oracle: ref.Loadable | None = Field(
        None, description="file.py:function beside the rubric, that returns a value."
    )
    streams: Mapping[str, NumbersOf] = Field(
        default_factory=dict, description="Role that the oracle knows -> field."
    )
    parameters: Mapping[str, Any] = Field(
        default_factory=dict, description="Passed on to the oracle."
    )

    def at(self, context: Context, times_ns: np.typing.NDArray[np.int64]) -> Floats | None:
        """Return the target at some times, a row each; None if it was not recorded."""
        if self.field is not None:
            return self._followed(context, self.field, times_ns)
        value = self.value
        if self.oracle is not None:
            streams = {role: each.series(context.session) for role, each in self.streams.items()}
            if None in streams.values():
                return None
            oracle = context.oracle(self.oracle)
            value = oracle(streams, dict(self.parameters), context.session.record.seed)
        row = np.atleast_1d(np.asarray(value, dtype=np.float64))
        return np.broadcast_to(row, (len(times_ns), len(row)))

    @staticmethod
    def _followed(context: Context, field: NumbersOf, times_ns: Integers) -> Floats | None:
        """Return the last value of another field at some times, a row each."""
        series = field.series(context.session)
        if series is None:
            return None
        places = np.searchsorted(series.source_ns, times_ns, side="right") - 1
        last: Floats = series.values[np.maximum(places, 0)]
        return last


class Reaches(InWindow, NumbersOf):
    """A field comes near a target in time after a step or a window's start, and stays there.

    The time of arrival decides the credit. Without an arrival, the nearest distance earns a part.
    """

    example: ClassVar = {"target": {"value": 1.0}}

    target: Target = Field(description="Where it has to come.")
    distance: Distance = Field(
        "straight",
        description="How far it is off: straight (Euclidean), angle (rad), rotation (of quaternions, rad).",
    )
    tolerance: float = Field(gt=0, description="How near is near enough.")
    hold_s: float = Field(0.0, ge=0, description="How long it has to stay so near.")
    after: ref.AnyStep | None = Field(
        None, description="Label of the step after which it counts; else the window."
    )
    within_s: float = Field(gt=0, description="Time within which it comes there, for full credit.")
    none_from_s: float | None = Field(
        None, gt=0, description="Time from which it is too late for any credit."
    )
    near_credit: Share = Field(
        0.5, description="Most credit of one that never comes to stay, by how near it comes."
    )
    none_beyond: float | None = Field(
        None, gt=0, description="Distance beyond which there is no credit for that."
    )
    overshoot: float | None = Field(
        None, ge=0, description="How far it may go beyond the target, seen from its start."
    )
    overshoot_costs: Share = Field(0.3, description="Share of the credit that going farther costs.")

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> Reaches:
        if isinstance(self.target.value, tuple) and self.pattern is None:
            ref.holds(info, self.topic, self.field, len(self.target.value))
        if (self.none_from_s or np.inf) <= self.within_s:
            raise ValueError("none_from_s must be more than within_s")
        if (self.none_beyond or np.inf) <= self.tolerance:
            raise ValueError("none_beyond must be more than tolerance")
        if self.overshoot is not None and self.distance != "straight":
            raise ValueError("what goes beyond a target is known of a straight distance only")
        return self

    def timely(self, late_s: float) -> float:
        """Return the credit of an arrival so long after the start."""
        return ramp(late_s, self.within_s, self.none_from_s or self.within_s)

    def counts(self, context: Context) -> Span | None:
        """Return the time that counts; None if it never began."""
        record = context.session.record
        window = self.span(context)
        if self.window is not None and window is None:
            return None
        start_ns = window.start_ns if window is not None else record.started_ns
        if self.after is not None:
            step = context.session.step(self.after)
            if step is None:
                return None
            start_ns = step.ended_ns
        end_ns = window.end_ns if window is not None else record.ended_ns
        return Span(start_ns, end_ns)


def reaches(context: Context, p: Reaches) -> Finding:
    """Judge the time of arrival at the target, or else the nearest approach."""
    hold = f" and stays for {p.hold_s:g} s" if p.hold_s else ""
    expected = (
        f"{p.field} within {p.tolerance:g} of its target after {p.within_s:g} s at most{hold}"
    )
    span = p.counts(context)
    if span is None:
        reason = "Not tested: the step after which the motion counts was not reached."
        return not_reached(reason, expected=expected)
    series = p.series(context.session, span)
    if series is None:
        return nothing_came(context, p.topic, expected)
    target = p.target.at(context, series.source_ns)
    if target is None:
        return not_reached("Not tested: the target was not recorded.", expected=expected)
    width = series.values.shape[1]
    if target.shape[1] not in (1, width):
        reason = f"{p.field} holds {width} numbers, the target {target.shape[1]}."
        return failed(expected, f"{width} numbers", reason)
    off = DISTANCES[p.distance](series.values, target)
    part = _arrival(context, p, span, series, off)
    if p.overshoot is not None:
        beyond = _overshoot(series.values, target)
        part = _less_for_overshoot(part, p, p.overshoot, beyond)
    low = quantise(part.share, CREDIT_LEVELS)
    best = max(low, quantise(part.best or 0.0, CREDIT_LEVELS))
    return graded(
        low, expected, part.text, part.reason, where=part.where, best=best, doubt=part.doubt
    )


def _less_for_overshoot(part: Part, p: Reaches, allowed: float, beyond: float) -> Part:
    """Return an arrival with less credit if the motion went too far beyond the target."""
    if beyond <= allowed:
        return part
    kept = 1 - p.overshoot_costs
    shown = apart(beyond, allowed, places=3)
    reason = f"{part.reason} It goes {shown} beyond the target; {allowed:g} is allowed."
    share = part.share * kept
    best = (part.best or 0.0) * kept
    text = f"{part.text}, {shown} beyond"
    return replace(part, share=share, best=best, text=text, reason=reason.strip())


def _arrival(context: Context, p: Reaches, span: Span, series: NumericStream, off: Floats) -> Part:
    """Judge the time at which it came to stay near enough, or else the nearest place where it stayed.

    Parameters
    ----------
    off
        float64[n]: Distance from the target at each message.
    """
    approach = _approach(context, p, series, off)
    late_s = (approach.here.start_ns - span.start_ns) / 1e9
    after = apart(late_s, p.within_s, places=2)
    if approach.distance <= p.tolerance:
        until = Span(span.start_ns, approach.here.end_ns)
        delayed = bounds.longest_delay(context.session, until)
        delayed = replace(delayed, length_s=span.duration_s)
        part = _came(p, bounds.latency(late_s, delayed), after)
    else:
        part = _stayed_off(p, approach, bounds.longest_delay(context.session, span))
    text = f"within {approach.shown} after {after} s"
    where = (context.location(p.topic, approach.here),)
    return replace(part, text=text, where=where)


@dataclass(frozen=True)
class _Approach:
    """Arrival of a motion, or its nearest place."""

    #: Time in seconds since the session's start, and the span of this time alone.
    at_s: float
    here: Span
    #: Distance that it kept for the required time; infinite if it kept none.
    distance: float
    #: The distance in words, or the least one if it kept none.
    shown: str


def _approach(context: Context, p: Reaches, series: NumericStream, off: Floats) -> _Approach:
    """Find the first message from which on a motion stays near enough, or else the nearest one."""
    held = _most_within(series, off, p.hold_s)
    place = int(np.argmin(held))
    if held[place] <= p.tolerance:
        place = int(np.argmax(held <= p.tolerance))
    at_s, here = moment(context, p.topic, int(series.source_ns[place]))
    distance = float(held[place])
    if np.isinf(distance):
        shown = f"{off.min():.3f}"
    else:
        shown = apart(distance, p.tolerance, places=3)
    return _Approach(at_s, here, distance, shown)


def _came(p: Reaches, took_s: Interval, after: str) -> Part:
    """Judge an arrival by its time."""
    share = took_s.credit(p.timely)
    reason = ""
    if share.low < 1:
        reason = f"The target is reached after {after} s; {p.within_s:g} s are allowed."
    return Part.between(share, reason=reason)


def _stayed_off(p: Reaches, approach: _Approach, delayed: Delayed) -> Part:
    """Judge a motion that never arrived, by its distance."""
    none_beyond = p.none_beyond or p.tolerance
    share = p.near_credit * ramp(approach.distance, p.tolerance, none_beyond)
    stays = f" that it keeps for {p.hold_s:g} s" if p.hold_s else ""
    nearest = f"the nearest{stays} is {approach.shown}, at {approach.at_s:.2f} s"
    reason = f"Not reached: {nearest}; {p.tolerance:g} is near enough."
    possible = bounds.absence(MANY_DELAYS, delayed)
    return Part(share, reason=reason, best=max(share, possible.high), doubt=possible.why)


def _most_within(series: NumericStream, off: Floats, hold_s: float) -> Floats:
    """Return the greatest distance in the time after each message; infinite if its end was not recorded.

    A message holds until the next one. A stay that ends with the recording was not seen.
    """
    times_ns = series.source_ns
    hold_ns = round(hold_s * 1e9)
    ends = np.searchsorted(times_ns, times_ns + hold_ns, side="right")
    held = greatest(off, ends)
    gap_ns = 0
    if len(times_ns) > 1:
        gap_ns = int(np.median(np.diff(times_ns)))
    recorded_until_ns = times_ns[-1] + gap_ns
    held[times_ns + hold_ns > recorded_until_ns] = np.inf
    return held


def greatest(values: Floats, ends: Integers) -> Floats:
    """Return the greatest value from each place up to its end.

    It is the greater one of two overlapping parts, each a power of two long.
    """
    starts: Integers = np.arange(len(values))
    found: Floats = values.copy()
    most = values
    width = 1
    while len(most):
        fit = ends - starts >= width
        first = most[starts[fit]]
        last = most[ends[fit] - width]
        found[fit] = np.maximum(first, last)
        most = np.maximum(most[:-width], most[width:])
        width *= 2
    return found


def _overshoot(values: Floats, target: Floats) -> float:
    """Return the distance beyond the target, along the way from the first value."""
    way = target - values[0]
    ways = np.broadcast_to(way, values.shape)
    lengths = np.linalg.norm(ways, axis=1)
    products = ((values - target) * way).sum(axis=1)
    along = products / _or_infinite(lengths)
    return float(max(0.0, along.max()))
