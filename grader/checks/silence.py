"""Checks of when nothing is published: until something happened, and after something did."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    apart,
    cpu_delay_doubt,
    failed,
    graded,
    not_reached,
    passed,
    quantise,
    ramp,
    unexplained,
)
from grader.checks.fields import Between, NumbersOf, moment
from grader.evidence.cpu_delay import Span
from grader.lab import references as ref
from grader.lab.references import Parameters
from grader.result import Finding


class Condition(NumbersOf, Between):
    """Numbers of a message lie within limits for the first time."""

    def first_ns(self, context: Context) -> int | None:
        """Return when that was; None if never."""
        series = self.series(context.session)
        if series is None:
            return None
        fits = self.hold(series.values).all(axis=1)
        return int(series.source_ns[fits][0]) if fits.any() else None


class SilentUntil(Parameters):
    """Nothing is published on a topic before a step, another topic's first message, or a condition; then it begins."""

    example: ClassVar = {"step": "step"}
    exactly_one = ("step", "message_on", "condition")

    topic: ref.Topic
    step: ref.AnyStep | None = Field(None, description="Label of the step that begins it.")
    message_on: ref.Topic | None = Field(None, description="Topic whose first message begins it.")
    condition: Condition | None = Field(
        None, description="What a field has to be for the first time."
    )
    tolerance_s: float = Field(0.05, ge=0, description="How much earlier a message may be stamped.")
    begins_within_s: float | None = Field(
        5.0, gt=0, description="How soon it then begins; null if it need not."
    )

    def begins_ns(self, context: Context) -> int | None:
        """Return from when on it may publish; None if that never came."""
        if self.step is not None:
            step = context.session.step(self.step)
            return step.started_ns if step is not None else None
        if self.condition is not None:
            return self.condition.first_ns(context)
        times = context.session.stream(self.message_on or "").source_ns
        return int(times.min()) if len(times) else None

    @property
    def words(self) -> str:
        """What it waits for, in words."""
        if self.condition is not None:
            return f"{self.condition.field} of {self.condition.topic} is as asked"
        return (
            f"the step '{self.step}'"
            if self.step is not None
            else f"the first message on {self.message_on}"
        )


def silent_until(context: Context, p: SilentUntil) -> Finding:
    """Judge by the first messages on the topic; none that came too early is the machine's doing."""
    expected = f"nothing on {p.topic} until {p.words}"
    begins_ns, times = p.begins_ns(context), context.session.stream(p.topic).source_ns
    early = (
        times[times < (begins_ns - round(p.tolerance_s * 1e9))] if begins_ns is not None else times
    )
    if len(early):
        at_s, span = moment(context, p.topic, int(early.min()))
        then = (
            f"{p.words} came at {context.session.since_start_s(begins_ns):.2f} s"
            if begins_ns
            else "that never came"
        )
        reason = f"Messages come from {at_s:.2f} s on; {then}."
        return failed(
            expected,
            f"{len(early)} messages too early",
            reason,
            where=(context.location(p.topic, span),),
        )
    if begins_ns is None:
        return not_reached(f"Not tested, because this never came: {p.words}.", expected=expected)
    if p.begins_within_s is None or (
        len(times) and times.min() <= begins_ns + round(p.begins_within_s * 1e9)
    ):
        first = (
            f"first message at {moment(context, p.topic, int(times.min()))[0]:.2f} s"
            if len(times)
            else "nothing"
        )
        return passed(expected, first)
    span = Span(begins_ns, begins_ns + round(p.begins_within_s * 1e9))
    delay_s = context.session.longest_delay_s(span)
    reason = f"Nothing comes in the {p.begins_within_s:g} s after that either, so the silence proves nothing."
    came_ns = int(
        times.min(initial=context.session.record.ended_ns)
    )  # What is not seen may come after the end.
    best = float((came_ns - span.end_ns) / 1e9 <= delay_s)
    return unexplained(
        graded(
            0.0,
            expected,
            "nothing afterwards",
            reason,
            best=best,
            doubt=cpu_delay_doubt(delay_s, span.duration_s),
        )
    )


class StopsPublishing(Parameters):
    """A topic falls silent after a step, and stays so."""

    topic: ref.Topic
    step: ref.AnyStep = Field(description="Label of the step that ends it.")
    within_s: float = Field(gt=0, description="Time after the step in which it may still publish.")
    none_from_s: float | None = Field(
        None, gt=0, description="Later messages leave no credit; else none are allowed."
    )
    until: ref.AnyStep | None = Field(
        None, description="Label of the step before which it counts; else the end."
    )


def stops_publishing(context: Context, p: StopsPublishing) -> Finding:
    """Judge by the last message after the step."""
    expected = f"nothing on {p.topic} later than {p.within_s:g} s after '{p.step}'"
    step, times = context.session.step(p.step), context.session.stream(p.topic).source_ns
    if step is None:
        return not_reached(
            f"Not tested, because the step '{p.step}' was not reached.", expected=expected
        )
    if not (times <= step.ended_ns).any():
        return not_reached(
            f"Not tested, because nothing was published before '{p.step}'.", expected=expected
        )
    until = context.session.step(p.until) if p.until is not None else None
    until_ns = until.started_ns if until is not None else context.session.record.ended_ns
    last_ns = int(times[times <= until_ns].max(initial=step.ended_ns))
    late_s = max(0.0, (last_ns - step.ended_ns) / 1e9)
    delay_s = context.session.longest_delay_s(Span(step.ended_ns, max(last_ns, step.ended_ns)))
    shares = (ramp(s, p.within_s, p.none_from_s or p.within_s) for s in (late_s, late_s - delay_s))
    share, best = (quantise(each, CREDIT_LEVELS) for each in shares)
    count = int(((times > step.ended_ns + round(p.within_s * 1e9)) & (times <= until_ns)).sum())
    shown = apart(late_s, p.within_s, places=2)
    reason = f"{count} messages came later, the last one {shown} s after the step."
    measured, doubt = f"last message {shown} s after the step", cpu_delay_doubt(delay_s, late_s)
    where = (context.location(p.topic, Span(step.ended_ns, last_ns)),)
    return graded(share, expected, measured, reason, where=where, best=best, doubt=doubt)
