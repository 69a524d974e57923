"""Check of a motion: a field comes to a target in time, stays there, and does not go beyond it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    MANY_DELAYS,
    Context,
    Part,
    apart,
    cpu_delay_doubt,
    failed,
    graded,
    not_reached,
    quantise,
    ramp,
)
from grader.checks.fields import InWindow, NumbersOf, moment, nothing_came
from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Floats, Integers, NumericStream
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.result import Finding

#: Of values and targets, a row a time: how far each is off.
Measure = Callable[[Floats, Floats], Floats]


def straight(values: Floats, others: Floats) -> Floats:
    """Return the Euclidean distance."""
    distances: Floats = np.sqrt(((values - others) ** 2).sum(axis=-1))
    return distances


def turned(values: Floats, others: Floats) -> Floats:
    """Return the distance of angles in rad, the shorter way round."""
    return straight((values - others + np.pi) % (2 * np.pi) - np.pi, np.zeros(1))


def rotated(values: Floats, others: Floats) -> Floats:
    """Return the angle in rad between two orientations, as quaternions x, y, z and w of any length but 0."""
    lengths = np.linalg.norm(values, axis=-1) * np.linalg.norm(others, axis=-1)
    cosines = np.abs((values * others).sum(axis=-1)) / np.where(lengths > 0, lengths, np.inf)
    angles: Floats = 2 * np.arccos(np.clip(cosines, 0, 1))
    return angles


DISTANCES: Mapping[str, Measure] = {"straight": straight, "angle": turned, "rotation": rotated}
Distance = Literal["straight", "angle", "rotation"]


class Target(Parameters):
    """Where a field has to come: a value, another topic's field at the same time, or what an oracle says."""

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
        """Return the target at some times, a row each; None where it was not recorded."""
        if self.field is not None:
            other = self.field.series(context.session)
            if other is None:
                return None
            last: Floats = other.values[
                np.maximum(np.searchsorted(other.source_ns, times_ns, side="right") - 1, 0)
            ]
            return last
        value = self.value
        if self.oracle is not None:
            streams = {
                role: numbers.series(context.session) for role, numbers in self.streams.items()
            }
            if None in streams.values():
                return None
            value = context.oracle(self.oracle)(
                streams, dict(self.parameters), context.session.record.seed
            )
        row = np.atleast_1d(np.asarray(value, dtype=np.float64))
        return np.broadcast_to(row, (len(times_ns), len(row)))


class Reaches(InWindow, NumbersOf):
    """A field comes near a target in time after a step or a window's start, and stays there.

    Credit is that of the time at which it came; where it never came to stay, that of how near it did.
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
        """Return the credit of one that came so long after the start."""
        return ramp(late_s, self.within_s, self.none_from_s or self.within_s)

    def counts(self, context: Context) -> Span | None:
        """Return the time in which it counts; None where that never began."""
        record, window, step = context.session.record, self.span(context), None
        if self.after is not None:
            step = context.session.step(self.after)
        if (self.after is not None and step is None) or (
            self.window is not None and window is None
        ):
            return None
        start_ns = (
            step.ended_ns
            if step is not None
            else window.start_ns
            if window is not None
            else record.started_ns
        )
        return Span(start_ns, window.end_ns if window is not None else record.ended_ns)


def reaches(context: Context, p: Reaches) -> Finding:
    """Judge when the field came to stay at its target, or else how near it came."""
    hold = f" and stays for {p.hold_s:g} s" if p.hold_s else ""
    expected = (
        f"{p.field} within {p.tolerance:g} of its target after {p.within_s:g} s at most{hold}"
    )
    span = p.counts(context)
    if span is None:
        return not_reached(
            "Not tested: the step after which the motion counts was not reached.", expected=expected
        )
    series = p.series(context.session, span)
    target = p.target.at(context, series.source_ns) if series is not None else None
    if series is None:
        return nothing_came(context, p.topic, expected)
    if target is None:
        return not_reached("Not tested: the target was not recorded.", expected=expected)
    if target.shape[1] not in (1, series.values.shape[1]):
        reason = f"{p.field} holds {series.values.shape[1]} numbers, the target {target.shape[1]}."
        return failed(expected, f"{series.values.shape[1]} numbers", reason)
    part = _arrival(context, p, span, series, DISTANCES[p.distance](series.values, target))
    shares, reason, measured = [part.share, part.best or 0.0], part.reason, part.text
    beyond = _overshoot(series.values, target) if p.overshoot is not None else 0.0
    if p.overshoot is not None and beyond > p.overshoot:
        shares = [share * (1 - p.overshoot_costs) for share in shares]
        shown = apart(beyond, p.overshoot, places=3)
        reason = f"{reason} It goes {shown} beyond the target; {p.overshoot:g} is allowed.".strip()
        measured += f", {shown} beyond"
    low, high = (quantise(share, CREDIT_LEVELS) for share in shares)
    return graded(
        low, expected, measured, reason, where=part.where, best=max(low, high), doubt=part.doubt
    )


def _arrival(context: Context, p: Reaches, span: Span, series: NumericStream, off: Floats) -> Part:
    """Judge when it came to stay near enough, or else how near it came to stay at all."""
    held = _most_within(series, off, p.hold_s)
    near = int(np.argmin(held))
    came = bool(held[near] <= p.tolerance)
    first = int(np.argmax(held <= p.tolerance)) if came else near
    at_s, here = moment(context, p.topic, int(series.source_ns[first]))
    late_s = (here.start_ns - span.start_ns) / 1e9
    shown, after = (
        apart(float(held[first]), p.tolerance, places=3),
        apart(late_s, p.within_s, places=2),
    )
    if np.isinf(held[near]):
        shown = f"{off.min():.3f}"
    if came:
        delay_s = context.session.longest_delay_s(Span(span.start_ns, here.end_ns))
        share, best = p.timely(late_s), p.timely(late_s - delay_s)
        reason = (
            f"The target is reached after {after} s; {p.within_s:g} s are allowed."
            if share < 1
            else ""
        )
    else:
        delay_s = context.session.longest_delay_s(span)
        share = p.near_credit * ramp(float(held[near]), p.tolerance, p.none_beyond or p.tolerance)
        best = 1.0 if delay_s > MANY_DELAYS * span.duration_s else share
        stays = f" that it keeps for {p.hold_s:g} s" if p.hold_s else ""
        reason = f"Not reached: the nearest{stays} is {shown}, at {at_s:.2f} s; {p.tolerance:g} is near enough."
    doubt = cpu_delay_doubt(delay_s, span.duration_s)
    text = f"within {shown} after {after} s"
    return Part(share, text, reason, best, doubt, where=(context.location(p.topic, here),))


def _most_within(series: NumericStream, off: Floats, hold_s: float) -> Floats:
    """Return how far it is off at most from each message on for a time; infinite where that is not seen to its end.

    A message is taken to hold until the next one. What ends with the recording was not seen to stay.
    """
    times_ns, hold_ns = series.source_ns, round(hold_s * 1e9)
    ends = np.searchsorted(times_ns, times_ns + hold_ns, side="right")
    held = greatest(off, ends)
    gap_ns = int(np.median(np.diff(times_ns))) if len(times_ns) > 1 else 0
    held[times_ns + hold_ns > times_ns[-1] + gap_ns] = np.inf
    return held


def greatest(values: Floats, ends: Integers) -> Floats:
    """Return the greatest value from each one on up to its end: of two parts that overlap, each a power of two long."""
    starts: Integers = np.arange(len(values))
    found: Floats = values.copy()
    most, width = values, 1
    while len(most):
        fit = ends - starts >= width
        found[fit] = np.maximum(most[starts[fit]], most[ends[fit] - width])
        most, width = np.maximum(most[:-width], most[width:]), 2 * width
    return found


def _overshoot(values: Floats, target: Floats) -> float:
    """Return how far it went beyond the target, along the way from where it began."""
    way = target - values[0]
    lengths = np.linalg.norm(np.broadcast_to(way, values.shape), axis=1)
    along = ((values - target) * way).sum(axis=1) / np.where(lengths > 0, lengths, np.inf)
    return float(max(0.0, along.max()))
