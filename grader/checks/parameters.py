"""Checks of parameters that are set while a node runs: what they change, and which values it refuses."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import compress
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from grader.checks.answers import unanswered
from grader.checks.base import (
    Context,
    Part,
    cpu_delay_doubt,
    failed,
    graded,
    of_parts,
    passed,
    unexplained,
    without_delay,
)
from grader.checks.publisher import TopicRate, topic_rate
from grader.checks.service import answer_of
from grader.evidence.fields import equal_within, value_at
from grader.evidence.timing import timing_of
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern, Share
from grader.result import Finding, Outcome


class ParameterEffect(Parameters):
    """A parameter that is set while the node runs changes a rate, a field or an answer as told."""

    example: ClassVar = {"topic": "/chatter", "old": 1.0, "new": 2.0}
    exactly_one = ("topic", "answer")

    process: ref.Process
    set_step: ref.SetLabel = Field(description="The step that sets the parameter.")
    before: ref.AnyStep = Field(
        description="Label of the observe step, or of the call, before that."
    )
    after: ref.AnyStep
    restarted: ref.AnyStep | None = Field(
        None, description="The same of a node that had the new value from its start."
    )
    topic: ref.Topic | None = Field(
        None, description="Its rate in Hz counts, or the field, or the text."
    )
    field: ref.FieldPath | None = Field(None, description="One number; its median counts.")
    text: ref.TextField | None = Field(None, description="The most frequent text counts.")
    answer: Annotated[str, ref.fields_of_type("_Response", "after")] | None = Field(
        None, description="Path of a field in the answers to the calls before and after."
    )
    old: float | bool | str = Field(description="What it is before.")
    new: float | bool | str
    tolerance: float = Field(1e-6, ge=0, description="Of numbers, but for a rate.")
    full_within: Share = Field(
        0.05, description="Relative deviation of a rate up to which credit is full."
    )
    zero_beyond: Share = Field(
        0.25, description="Relative deviation of a rate from which there is none."
    )
    restart_credit: Share = Field(
        0.5, description="Credit where the new value counts only after a restart."
    )

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> ParameterEffect:
        if self.is_rate and isinstance(self.old, (bool, str)) | isinstance(self.new, (bool, str)):
            raise ValueError("a rate is a number of Hz")
        return self

    @property
    def is_rate(self) -> bool:
        """Whether the rate of the topic counts."""
        return self.topic is not None and self.field is None and self.text is None

    @property
    def what(self) -> str:
        """What is to change."""
        return (
            f"the rate of {self.topic} in Hz"
            if self.is_rate
            else f"{self.field or self.text or self.answer}"
        )

    def fits(self, value: Any, wanted: Any) -> bool:
        """Whether a value is another but for the tolerance."""
        return equal_within(
            value, wanted, self.full_within * abs(wanted) if self.is_rate else self.tolerance
        )

    def measured(self, context: Context, label: str | None) -> Any:
        """Return what a step shows of it; None where that is nothing."""
        session, step = context.session, context.session.step(label) if label is not None else None
        span = session.window(label) if label is not None else None
        if self.answer is not None:
            return value_at(answer_of(step), self.answer)
        if self.topic is None or span is None:
            return None
        stream = session.stream(self.topic)
        if self.is_rate:
            timing = timing_of(stream, span)
            return timing.rate_hz if timing is not None else None
        inside = (stream.source_ns >= span.start_ns) & (stream.source_ns <= span.end_ns)
        if self.text is not None:
            texts = filter(None, compress(session.texts(self.topic, self.text), inside))
            return next((text for text, _ in Counter(texts).most_common(1)), None)
        rows = [
            row
            for row in compress(session.rows(self.topic, self.field or ""), inside)
            if row is not None
        ]
        numbers = [row[0] for row in rows if len(row)]
        return float(np.median(numbers)) if numbers else None


def parameter_effect(context: Context, p: ParameterEffect) -> Finding:
    """Judge what the parameter changed, and name why it did not."""
    expected = f"{p.what}: {_shown(p.old)}, and {_shown(p.new)} when the parameter is set"
    step = context.session.step(p.set_step)
    if (silent := unanswered(context, step, expected)) is not None:
        return silent
    if step is not None and (refused := step.result.get("refused")):
        why = "; ".join(
            f"{name}: {str(reason)[:_MOST_SHOWN].rstrip('.')}" for name, reason in refused.items()
        )
        return failed(
            expected,
            "refused",
            f"The parameter could not be set while the node ran: {why}.",
            hint=_SET_HINT,
        )
    before, after, restarted = (
        p.measured(context, label) for label in (p.before, p.after, p.restarted)
    )
    measured = f"{_shown(before)}, then {_shown(after)}"
    measured += f"; after a restart with it {_shown(restarted)}" if p.restarted is not None else ""
    where = (context.location(p.topic, context.session.window(p.after) if p.topic else None),)
    if after is None:
        return _nothing(context, p, expected, measured)
    if p.is_rate:
        finding = replace(_rate(context, p), expected=expected, measured=measured)
    elif p.fits(after, p.new):
        finding = passed(expected, measured, where=where)
    else:
        finding = failed(
            expected,
            measured,
            f"After the parameter was set, {p.what} is {_shown(after)}.",
            where=where,
        )
    if finding.outcome is Outcome.INCONCLUSIVE:
        return finding
    credit, reason, hint = _mistake(p, before, after, restarted)
    worth = [
        known if mistake else float(finding.credit)
        for old in _possible(context, p, p.before, before, after)
        for new in _possible(context, p, p.restarted, restarted, p.new)
        for known, mistake, _ in (_mistake(p, old, after, new),)
    ]
    if min(worth) == max(worth):
        return (
            graded(credit, expected, measured, reason, hint=hint, where=where)
            if reason
            else finding
        )
    return graded(min(worth), expected, measured, reason, best=max(worth), doubt=_BUSY, where=where)


_BUSY = "Not your fault: the grading computer was too busy to measure the rate that this one is compared with."


def _possible(
    context: Context, p: ParameterEffect, label: str | None, value: Any, other: Any
) -> list[Any]:
    """Return what a step shows; of a rate the most that it may have been without delays, and the nearest to another."""
    span = context.session.window(label) if label is not None else None
    if not p.is_rate or span is None or value is None:
        return [value]
    most = without_delay(value, context.session.longest_delay_s(span), span.duration_s)
    return [value, most, min(max(value, float(other)), most)]


def _mistake(p: ParameterEffect, before: Any, after: Any, restarted: Any) -> tuple[float, str, str]:
    """Return what a known mistake is worth, what it is, and how to fix it; an empty reason where there is none."""
    unchanged = p.old != p.new and before is not None and p.fits(after, before)
    stays = f"The parameter was accepted, but {p.what} stays at {_shown(after)}"
    at_start = (
        "The timer keeps its old period until the node is restarted." if p.is_rate else _AT_START
    )
    summed = p.is_rate and before is not None and p.fits(after, before + float(p.new))
    rows: tuple[tuple[bool, float, str, str], ...] = (
        (
            unchanged and p.fits(restarted, p.new),
            p.restart_credit,
            at_start,
            _TIMER_HINT if p.is_rate else _READ_HINT,
        ),
        (
            unchanged and p.fits(after, p.new),
            0.0,
            f"It was {_shown(before)} before, so nothing changed.",
            "",
        ),
        (
            unchanged and restarted is not None,
            0.0,
            f"{stays}, after a restart too: it is declared but ignored.",
            "",
        ),
        (unchanged, 0.0, f"{stays}.", _TIMER_HINT if p.is_rate else _READ_HINT),
        (
            summed,
            0.0,
            "The old timer runs on beside the new one, so that their rates add up.",
            _TIMER_HINT,
        ),
        (True, 0.0, "", ""),
    )
    return next(row[1:] for row in rows if row[0])


_AT_START = "The new value takes effect only after a restart: the parameter is read once, when the node starts."
_READ_HINT = "Read it with self.get_parameter(...) whenever it is used, or take it over in a parameter callback."
_TIMER_HINT = "In a callback of add_post_set_parameters_callback, cancel the timer and create one with the new period."
_SET_HINT = "Declare it with a default of the type that the lab gives it, not read-only; others can then set it."


def _rate(context: Context, p: ParameterEffect) -> Finding:
    """Judge the rate after the change, within the bounds that the machine's delays leave open."""
    limits = {"full_within": p.full_within, "zero_beyond": p.zero_beyond}
    asked = {"topic": p.topic, "process": p.process, "window": p.after, "rate_hz": float(p.new)}
    return topic_rate(context, TopicRate.model_validate({**asked, **limits}))


def _nothing(context: Context, p: ParameterEffect, expected: str, measured: str) -> Finding:
    """State that nothing was to be seen of it afterwards."""
    span, run = context.session.window(p.after), context.session.process(p.process)
    delay_s = (
        context.session.machine_delay_s(run, span) if span is not None and run is not None else 0.0
    )
    late = span is not None and delay_s > _MUCH * span.duration_s
    doubt = cpu_delay_doubt(delay_s, span.duration_s) if span is not None and late else ""
    reason = f"After the parameter was set, nothing was seen of {p.what}."
    return unexplained(
        graded(0.0, expected, measured, reason, best=1.0 if doubt else None, doubt=doubt)
    )


#: A process that the machine delayed for this share of a window may have shown nothing for that.
_MUCH = 0.5


def _shown(value: Any) -> str:
    return (
        "nothing"
        if value is None
        else f"{value:.4g}"
        if isinstance(value, float)
        else repr(value)[:_MOST_SHOWN]
    )


_MOST_SHOWN = 80


class ParameterRejected(Parameters):
    """A node refuses invalid values of parameters with a reason, and keeps the old ones; each is a part."""

    step: ref.RefusalLabel
    reason: Pattern | None = Field(
        None, description="Regular expression for the reasons; any other is only noted."
    )
    reasonless_credit: Share = Field(0.75, description="Credit of a refusal without a reason.")
    changed_credit: Share = Field(
        0.25, description="Credit of a refusal after which the value is another."
    )


def parameter_rejected(context: Context, p: ParameterRejected) -> Finding:
    """Judge refusals by the node's answer, and by the values that it has before and after."""
    step = context.session.step(p.step)
    wanted = step.parameters.get("values", {}) if step is not None else {}
    expected = f"refuses {', '.join(f'{name} = {value!r}' for name, value in wanted.items())}, and keeps what it has"
    if (silent := unanswered(context, step, expected)) is not None or step is None:
        return silent or failed(expected, "", "")
    parts = [_refusal(p, name, value, step.result) for name, value in wanted.items()]
    return of_parts(expected, parts, where=(context.location(),))


def _refusal(p: ParameterRejected, name: str, value: Any, result: dict[str, Any]) -> Part:
    """Judge what a node did with an invalid value."""
    before, after, refused = (result.get(key, {}) for key in ("before", "after", "refused"))
    if name not in before:
        return Part(
            0.0, f"no {name}", f"{name} is not declared, so that refusing it proves nothing."
        )
    kept = before[name] == after.get(name)
    why = str(refused.get(name, ""))[:_MOST_SHOWN]
    text = f"{name}: refused ({why or 'no reason'}), then {_shown(after.get(name))}"
    if name not in refused:
        reason = f"{name} accepts {value!r}."
        return Part(0.0, f"{name} was set to {value!r}", reason, hint=_REFUSE_HINT)
    if not kept:
        reason = f"{name} was {_shown(before[name])}, and is {_shown(after.get(name))} after it refused {value!r}."
        return Part(p.changed_credit, text, reason)
    if not why.strip():
        reason = f"{name} refuses {value!r} without a reason."
        return Part(p.reasonless_credit, text, reason, hint="Give SetParametersResult a reason.")
    other = p.reason is not None and not search(p.reason, why)
    return Part(
        1.0,
        text,
        notes=(f"The reason {why!r} for {name} is not worded as in the lab.",) if other else (),
    )


_REFUSE_HINT = "Return SetParametersResult(successful=False, reason=...) from a callback of add_on_set_parameters_callback."
