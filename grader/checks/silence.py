"""Checks of silence on a topic: until an event, and after one."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from grader.checks.base import (
    Context,
    failed,
    graded,
    not_reached,
    passed,
    unexplained,
)
from grader.checks.fields import Between, NumbersOf, moment
from grader.evidence import bounds
from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Integers
from grader.lab import references as ref
from grader.lab.references import Parameters
from grader.result import Finding


class Condition(NumbersOf, Between):
    """Numbers of a message lie within limits for the first time."""

    def first_ns(self, context: Context) -> int | None:
        """Return the time of the first such message; None if there is none."""
        series = self.series(context.session)
        if series is None:
            return None
        fits = self.hold(series.values).all(axis=1)
        if fits.any():
            return int(series.source_ns[fits][0])
        return None


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
        """Return the time from which it may publish; None if that never came."""
        if self.step is not None:
            step = context.session.step(self.step)
            return step.started_ns if step is not None else None
        if self.condition is not None:
            return self.condition.first_ns(context)
        times = context.session.stream(self.message_on or "").source_ns
        if len(times):
            return int(times.min())
        return None

    @property
    def words(self) -> str:
        """The event that begins it, in words."""
        if self.condition is not None:
            return f"{self.condition.field} of {self.condition.topic} is as asked"
        if self.step is not None:
            return f"the step '{self.step}'"
        return f"the first message on {self.message_on}"


def silent_until(context: Context, p: SilentUntil) -> Finding:
    """Judge the first messages on the topic; the machine cannot make a message too early."""
    expected = f"nothing on {p.topic} until {p.words}"
    begins_ns = p.begins_ns(context)
    times = context.session.stream(p.topic).source_ns
    early = times
    if begins_ns is not None:
        early = times[times < (begins_ns - round(p.tolerance_s * 1e9))]
    if len(early):
        return _too_early(context, p, expected, early, begins_ns)
    if begins_ns is None:
        return not_reached(f"Not tested, because this never came: {p.words}.", expected=expected)
    first_ns = None
    if len(times):
        first_ns = int(times.min())
    if p.begins_within_s is None:
        return passed(expected, _first_message(context, first_ns))
    end_ns = begins_ns + round(p.begins_within_s * 1e9)
    if first_ns is not None and first_ns <= end_ns:
        return passed(expected, _first_message(context, first_ns))
    span = Span(begins_ns, end_ns)
    reason = f"Nothing comes in the {p.begins_within_s:g} s after that either, so the silence proves nothing."
    return _never_began(context, expected, reason, span, first_ns)


def _first_message(context: Context, first_ns: int | None) -> str:
    if first_ns is None:
        return "nothing"
    return f"first message at {context.session.since_start_s(first_ns):.2f} s"


def _too_early(
    context: Context, p: SilentUntil, expected: str, early: Integers, begins_ns: int | None
) -> Finding:
    """State that messages came before the event."""
    at_s, span = moment(context, p.topic, int(early.min()))
    then = "that never came"
    if begins_ns:
        then = f"{p.words} came at {context.session.since_start_s(begins_ns):.2f} s"
    reason = f"Messages come from {at_s:.2f} s on; {then}."
    where = (context.location(p.topic, span),)
    return failed(expected, f"{len(early)} messages too early", reason, where=where)


def _never_began(
    context: Context, expected: str, reason: str, span: Span, first_ns: int | None
) -> Finding:
    """State that no message came in the time after the event, unless the machine may have delayed it."""
    # A message that was not seen may come after the end of the session.
    came_ns = context.session.record.ended_ns
    if first_ns is not None:
        came_ns = min(came_ns, first_ns)
    late_s = (came_ns - span.end_ns) / 1e9
    credit = bounds.arrival(late_s, bounds.longest_delay(context.session, span))
    finding = graded(
        credit.low, expected, "nothing afterwards", reason, best=credit.high, doubt=credit.why
    )
    return unexplained(finding)
