"""Check of a property of signals over time, in signal temporal logic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, StringConstraints, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    cpu_delay_doubt,
    graded,
    not_reached,
    quantise,
    ramp,
)
from grader.checks.fields import InWindow, NumbersOf, moment, nothing_came
from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Floats, Integers, NumericStream
from grader.evidence.temporal_logic import Property, Robustness, TooShortError
from grader.lab.references import Share
from grader.lab.yaml_with_lines import mistakes_at
from grader.result import Finding

#: A signal is no longer than this many steps; the longest session has fewer of 10 ms.
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
        """Return its messages; a least or greatest number may stand among others that are none."""
        return self.series(context.session, finite=self.of_several == "length")

    def at(self, series: NumericStream, times_ns: Integers) -> Floats:
        """Return its values at some times."""
        values = series.values[:, 0]
        if series.values.shape[1] > 1:
            several = {"least": np.fmin.reduce, "greatest": np.fmax.reduce}.get(
                self.of_several, np.linalg.norm
            )
            values = several(series.values, axis=1)
        if self.between == "linear":
            return np.interp(times_ns, series.source_ns, values)
        held: Floats = values[
            np.maximum(np.searchsorted(series.source_ns, times_ns, side="right") - 1, 0)
        ]
        return held


class SignalProperty(InWindow):
    """A property of signals in signal temporal logic holds, as always(implies(near < 1, eventually[0, 2](v < 0.1))).

    Its robustness earns credit: by how much it holds, or misses, in the unit of what is compared. It is that from the
    window's start on, or from the first message of the signal that begins last.
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
        if (self.none_below if self.none_below is not None else -np.inf) >= self.full_from:
            raise mistakes_at([(("none_below",), "must be less than full_from")])
        return self

    def read(self) -> Property:
        """Return the property; raises ValueError if it is none."""
        return Property.parse(self.property, self.signals)


def signal_property(context: Context, p: SignalProperty) -> Finding:
    """Judge by the robustness; the moment that decides it is shown with the signals' values."""
    expected, span = p.property, p.span(context)
    series = {name: signal.seen(context) for name, signal in p.signals.items()}
    if absent := next((name for name, found in series.items() if found is None), None):
        return nothing_came(context, p.signals[absent].topic, expected)
    streams = {name: found for name, found in series.items() if found is not None}
    counts = span or Span(context.session.record.started_ns, context.session.record.ended_ns)
    start_ns = max(counts.start_ns, *(int(s.source_ns[0]) for s in streams.values()))
    end_ns = min(counts.end_ns, max(int(s.source_ns[-1]) for s in streams.values()))
    if end_ns < start_ns:
        latest = max(streams, key=lambda name: int(streams[name].source_ns[0]))
        return nothing_came(context, p.signals[latest].topic, expected)
    step_ns = round(max(p.step_s * 1e9, (end_ns - start_ns) / _MOST_STEPS))
    times_ns = np.arange(start_ns, end_ns + 1, step_ns, dtype=np.int64)
    signals = {name: p.signals[name].at(stream, times_ns) for name, stream in streams.items()}
    try:
        found = p.read().robustness(signals, step_ns / 1e9)
    except TooShortError:
        seen_s = (end_ns - start_ns) / 1e9
        return not_reached(
            f"The signals were seen for {seen_s:.1f} s, which is too short for it.",
            expected=expected,
        )
    return _judged(context, p, found, signals, times_ns)


def _judged(
    context: Context,
    p: SignalProperty,
    found: Robustness,
    signals: Mapping[str, Floats],
    times_ns: Integers,
) -> Finding:
    at_s, here = moment(context, p.signals[next(iter(signals))].topic, int(times_ns[found.worst]))
    shown = ", ".join(f"{name} = {values[found.worst]:.4g}" for name, values in signals.items())
    measured = f"{'holds' if found.value > 0 else 'missed'} by {abs(found.value):.3g}, decided at {at_s:.2f} s: {shown}"
    where = (context.location(next(iter(p.signals.values())).topic, here),)
    share = float(found.value >= p.full_from)
    if p.none_below is not None:
        share = quantise(ramp(-found.value, -p.full_from, -p.none_below), CREDIT_LEVELS)
    if share == 1.0 and found.never:
        reason = f"Not tested in this run: '{found.never[0]}' was never true."
        return graded(p.vacuous_credit, p.property, measured, reason, where=where, notes=(reason,))
    about = Span(here.start_ns - _ABOUT_NS, here.end_ns + _ABOUT_NS)
    delay_s = context.session.longest_delay_s(about)
    best = 1.0 if delay_s > _MANY_DELAYS * about.duration_s else share
    reason = f"The property does not hold at {at_s:.2f} s: {shown}."
    doubt = cpu_delay_doubt(delay_s, about.duration_s)
    return graded(share, p.property, measured, reason, where=where, best=best, doubt=doubt)


#: About the moment that decides it, so much time counts; and this share of it, if the machine took it, may be why.
_ABOUT_NS, _MANY_DELAYS = 1_000_000_000, 0.1
