"""Check of a property of signals over time, in signal temporal logic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, StringConstraints, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    graded,
    not_reached,
    quantise,
    ramp,
)
from grader.checks.fields import InWindow, NumbersOf, moment, nothing_came
from grader.evidence import bounds
from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Floats, Integers, NumericStream
from grader.evidence.temporal_logic import Property, Robustness, TooShortError
from grader.lab.references import Share
from grader.lab.yaml_with_lines import mistakes_at
from grader.result import Finding

#: Greatest number of steps of a signal; the longest session has fewer of 10 ms.
_MOST_STEPS = 100_000


class Signal(NumbersOf):
    """A number over time, from a field."""

    of_several: Literal["length", "least", "greatest"] = Field(
        "length",
        description="What counts where the field holds several numbers: their Euclidean length, or one.",
    )
    between: Literal["hold", "linear"] = Field(
        "hold",
        description="Value between two messages: that of the last one, or on the line between the two.",
    )

    def seen(self, context: Context) -> NumericStream | None:
        """Return its messages; a least or greatest number may stand among others that are not finite."""
        return self.series(context.session, finite=self.of_several == "length")

    def at(self, series: NumericStream, times_ns: Integers) -> Floats:
        """Return its values at some times."""
        values = self._single(series.values)
        if self.between == "linear":
            return np.interp(times_ns, series.source_ns, values)
        places = np.searchsorted(series.source_ns, times_ns, side="right") - 1
        held: Floats = values[np.maximum(places, 0)]
        return held

    def _single(self, rows: Floats) -> Floats:
        """Return one number for each row."""
        if rows.shape[1] == 1:
            return rows[:, 0]
        single: Floats
        if self.of_several == "least":
            single = np.fmin.reduce(rows, axis=1)
        elif self.of_several == "greatest":
            single = np.fmax.reduce(rows, axis=1)
        else:
            single = np.linalg.norm(rows, axis=1)
        return single


class SignalProperty(InWindow):
    """A property of signals in signal temporal logic holds, as always(implies(near < 1, eventually[0, 2](v < 0.1))).

    Its robustness earns credit: the margin by which it holds or misses, in the unit of the compared values. It counts
    from the window's start on, or from the first message of the signal that begins last.
    """

    example: ClassVar = {
        "signals": {"speed": {"topic": "/chatter", "field": "data"}},
        "property": "always(abs(speed) <= 0.5)",
    }

    signals: Mapping[Annotated[str, StringConstraints(pattern=r"^[A-Za-z_]\w*$")], Signal] = Field(
        min_length=1, description="Name in the property -> topic and field."
    )
    property: str = Field(
        description="Comparisons of the signals, with + - * / abs min max; and or not implies(a, b); always(a), "
        "eventually(a), until(a, b), each with bounds in s as in always[0, 2](a). Equal numbers are compared by "
        "abs(a - b) <= 0.01."
    )
    step_s: float = Field(
        0.01, gt=0, description="Time between samples, to which the bounds are rounded."
    )
    full_from: float = Field(0.0, description="Robustness from which credit is full.")
    none_below: float | None = Field(
        None, description="Robustness up to which there is none; else full or none."
    )
    vacuous_credit: Share = Field(
        0.0, description="Credit where the condition of an implication is never true."
    )

    @model_validator(mode="after")
    def _can_be_read(self) -> SignalProperty:
        try:
            self.read()
        except ValueError as problem:
            raise mistakes_at([(("property",), str(problem))]) from problem
        if self.none_below is not None and self.none_below >= self.full_from:
            raise mistakes_at([(("none_below",), "must be less than full_from")])
        return self

    def read(self) -> Property:
        """Return the property; raises ValueError if it is none."""
        return Property.parse(self.property, self.signals)


def signal_property(context: Context, p: SignalProperty) -> Finding:
    """Judge the robustness, and show the signals' values at the deciding moment."""
    streams: dict[str, NumericStream] = {}
    for name, signal in p.signals.items():
        stream = signal.seen(context)
        if stream is None:
            return nothing_came(context, signal.topic, p.property)
        streams[name] = stream
    span = _common_span(context, p, streams)
    if span.end_ns < span.start_ns:
        latest = max(streams, key=lambda name: int(streams[name].source_ns[0]))
        return nothing_came(context, p.signals[latest].topic, p.property)
    length_ns = span.end_ns - span.start_ns
    step_ns = round(max(p.step_s * 1e9, length_ns / _MOST_STEPS))
    times_ns = np.arange(span.start_ns, span.end_ns + 1, step_ns, dtype=np.int64)
    signals = {}
    for name, stream in streams.items():
        signals[name] = p.signals[name].at(stream, times_ns)
    try:
        found = p.read().robustness(signals, step_ns / 1e9)
    except TooShortError:
        reason = f"The signals were seen for {length_ns / 1e9:.1f} s, which is too short for it."
        return not_reached(reason, expected=p.property)
    return _judged(context, p, found, signals, int(times_ns[found.worst]))


def _common_span(context: Context, p: SignalProperty, streams: Mapping[str, NumericStream]) -> Span:
    """Return the part of the window after all signals began and before the last ended."""
    record = context.session.record
    counts = p.span(context) or Span(record.started_ns, record.ended_ns)
    begins_ns = [int(stream.source_ns[0]) for stream in streams.values()]
    ends_ns = [int(stream.source_ns[-1]) for stream in streams.values()]
    return Span(max(counts.start_ns, *begins_ns), min(counts.end_ns, max(ends_ns)))


def _judged(
    context: Context,
    p: SignalProperty,
    found: Robustness,
    signals: Mapping[str, Floats],
    worst_ns: int,
) -> Finding:
    """Grade the robustness.

    Parameters
    ----------
    worst_ns
        The deciding moment, in ns of the system clock.
    """
    topic = next(iter(p.signals.values())).topic
    at_s, here = moment(context, topic, worst_ns)
    shown = _values_at(signals, found.worst)
    measured = "holds" if found.value > 0 else "missed"
    measured += f" by {abs(found.value):.3g}, decided at {at_s:.2f} s: {shown}"
    where = (context.location(topic, here),)
    share = _share(p, found.value)
    if share == 1.0 and found.never:
        reason = f"Not tested in this run: '{found.never[0]}' was never true."
        return graded(p.vacuous_credit, p.property, measured, reason, where=where, notes=(reason,))
    about = Span(here.start_ns - _ABOUT_NS, here.end_ns + _ABOUT_NS)
    possible = bounds.absence(_MANY_DELAYS, bounds.longest_delay(context.session, about))
    reason = f"The property does not hold at {at_s:.2f} s: {shown}."
    best = max(share, possible.high)
    return graded(share, p.property, measured, reason, where=where, best=best, doubt=possible.why)


def _values_at(signals: Mapping[str, Floats], place: int) -> str:
    """Write the values of all signals at a step: `near = 0.4, v = 0.3`."""
    values = [f"{name} = {signal[place]:.4g}" for name, signal in signals.items()]
    return ", ".join(values)


def _share(p: SignalProperty, robustness: float) -> float:
    """Return the share of credit of a robustness."""
    if p.none_below is None:
        return float(robustness >= p.full_from)
    return quantise(ramp(-robustness, -p.full_from, -p.none_below), CREDIT_LEVELS)


#: Time about the deciding moment that is looked at, in ns, and delayed share of it that can be the reason of a miss.
_ABOUT_NS, _MANY_DELAYS = 1_000_000_000, 0.1
