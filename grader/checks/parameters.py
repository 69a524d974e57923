"""Checks of parameters that are set while a node runs: their effects, and refusals of invalid values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from grader.checks.answers import unanswered
from grader.checks.base import (
    Context,
    Part,
    failed,
    graded,
    of_parts,
    passed,
    unexplained,
)
from grader.checks.publisher import TopicRate, topic_rate
from grader.checks.service import answer_of
from grader.evidence import bounds
from grader.evidence.bounds import Interval
from grader.evidence.cpu_delay import Span
from grader.evidence.fields import equal_within, value_at
from grader.evidence.recorded import Booleans
from grader.evidence.timing import timing_of
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern, Share
from grader.lab.steps.set_parameters import SetParametersResult, SetParametersStep
from grader.result import Finding, Location, Outcome


class ParameterEffect(Parameters):
    """A parameter that is set while the node runs changes a rate, a field or an answer as required."""

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
        for value in (self.old, self.new):
            if self.is_rate and isinstance(value, (bool, str)):
                raise ValueError("a rate is a number of Hz")
        return self

    @property
    def is_rate(self) -> bool:
        """True if the rate of the topic counts."""
        return self.topic is not None and self.field is None and self.text is None

    @property
    def what(self) -> str:
        """The quantity that must change, in words."""
        if self.is_rate:
            return f"the rate of {self.topic} in Hz"
        return f"{self.field or self.text or self.answer}"

    def fits(self, value: Any, wanted: Any) -> bool:
        """Tell whether a value is the wanted one, up to the tolerance."""
        if self.is_rate:
            tolerance = self.full_within * abs(wanted)
        else:
            tolerance = self.tolerance
        return equal_within(value, wanted, tolerance)

    def measured(self, context: Context, label: str | None) -> Any:
        """Return the quantity as a step shows it; None if it shows nothing."""
        if label is None:
            return None
        if self.answer is not None:
            return value_at(answer_of(context.session.step(label)), self.answer)
        span = context.session.window(label)
        if self.topic is None or span is None:
            return None
        if self.is_rate:
            timing = timing_of(context.session.stream(self.topic), span)
            return timing.rate_hz if timing is not None else None
        if self.text is not None:
            return self._most_frequent_text(context, self.topic, self.text, span)
        return self._median(context, self.topic, self.field or "", span)

    @staticmethod
    def _most_frequent_text(context: Context, topic: str, field: str, span: Span) -> str | None:
        """Return the most frequent text of a field within a span."""
        inside = _inside(context, topic, span)
        texts = filter(None, compress(context.session.texts(topic, field), inside))
        most_common = Counter(texts).most_common(1)
        return most_common[0][0] if most_common else None

    @staticmethod
    def _median(context: Context, topic: str, field: str, span: Span) -> float | None:
        """Return the median of the first numbers of a field within a span."""
        inside = _inside(context, topic, span)
        numbers = []
        for row in compress(context.session.rows(topic, field), inside):
            if row is not None and len(row):
                numbers.append(row[0])
        return float(np.median(numbers)) if numbers else None


def _inside(context: Context, topic: str, span: Span) -> Booleans:
    """Return which messages of a topic lie within a span."""
    source_ns = context.session.stream(topic).source_ns
    inside: Booleans = (source_ns >= span.start_ns) & (source_ns <= span.end_ns)
    return inside


@dataclass(frozen=True)
class _Observed:
    """The quantity before the change, after it, and after a restart with the new value."""

    before: Any
    after: Any
    restarted: Any


@dataclass(frozen=True)
class _Mistake:
    """A known mistake, the credit that it leaves, and its remedy."""

    credit: float
    reason: str
    hint: str = ""


def parameter_effect(context: Context, p: ParameterEffect) -> Finding:
    """Judge the effect of the parameter, and name the mistake if there is none."""
    expected = f"{p.what}: {_shown(p.old)}, and {_shown(p.new)} when the parameter is set"
    step = context.session.step(p.set_step)
    silent = unanswered(context, step, expected)
    if silent is not None:
        return silent
    refused = None
    if step is not None:
        refused = SetParametersResult.of(step).refused
    if refused:
        return _could_not_be_set(expected, refused)
    before = p.measured(context, p.before)
    after = p.measured(context, p.after)
    restarted = p.measured(context, p.restarted)
    observed = _Observed(before, after, restarted)
    measured = f"{_shown(observed.before)}, then {_shown(observed.after)}"
    if p.restarted is not None:
        measured += f"; after a restart with it {_shown(observed.restarted)}"
    if observed.after is None:
        return _nothing(context, p, expected, measured)
    where = (_location_after(context, p),)
    if p.is_rate:
        finding = replace(_rate(context, p), expected=expected, measured=measured)
    elif p.fits(observed.after, p.new):
        finding = passed(expected, measured, where=where)
    else:
        reason = f"After the parameter was set, {p.what} is {_shown(observed.after)}."
        finding = failed(expected, measured, reason, where=where)
    if finding.outcome is Outcome.INCONCLUSIVE:
        return finding
    return _with_mistake(context, p, observed, finding, where)


def _could_not_be_set(expected: str, refused: Mapping[str, Any]) -> Finding:
    """State that the node refused to set the parameter."""
    answers = []
    for name, problem in refused.items():
        answers.append(f"{name}: {str(problem)[:_MOST_SHOWN].rstrip('.')}")
    reason = f"The parameter could not be set while the node ran: {'; '.join(answers)}."
    return failed(expected, "refused", reason, hint=_SET_HINT)


def _with_mistake(
    context: Context,
    p: ParameterEffect,
    observed: _Observed,
    finding: Finding,
    where: Sequence[Location],
) -> Finding:
    """Return a finding, with a known mistake if one explains it.

    It is undecided if the machine delays leave open whether there is a mistake.
    """
    mistake = _mistake(p, observed)
    credits = _possible_credits(context, p, observed, float(finding.credit))
    least = min(credits)
    most = max(credits)
    if least != most:
        return graded(
            least,
            finding.expected,
            finding.measured,
            mistake.reason,
            best=most,
            doubt=_BUSY,
            where=where,
        )
    if not mistake.reason:
        return finding
    return graded(
        mistake.credit,
        finding.expected,
        finding.measured,
        mistake.reason,
        hint=mistake.hint,
        where=where,
    )


def _possible_credits(
    context: Context, p: ParameterEffect, observed: _Observed, credit: float
) -> list[float]:
    """Return the credit for each combination of values that may have been without machine delays."""
    after = observed.after
    credits = []
    for before in _possible(context, p, p.before, observed.before, after):
        for restarted in _possible(context, p, p.restarted, observed.restarted, p.new):
            mistake = _mistake(p, _Observed(before, after, restarted))
            credits.append(mistake.credit if mistake.reason else credit)
    return credits


_BUSY = "Not your fault: the grading computer was too busy to measure the rate that this one is compared with."


def _possible(
    context: Context, p: ParameterEffect, label: str | None, value: Any, other: Any
) -> list[Any]:
    """Return the values that a step may have shown without machine delays.

    For a rate these are the measured one, the highest possible one, and the one nearest to another.
    """
    span = None
    if label is not None:
        span = context.session.window(label)
    if not p.is_rate or span is None or value is None:
        return [value]
    seen = bounds.count(value, bounds.longest_delay(context.session, span))
    return [value, seen.high, seen.nearest(float(other))]


def _mistake(p: ParameterEffect, observed: _Observed) -> _Mistake:
    """Return the known mistake that explains some values; its reason is empty if there is none."""
    before = observed.before
    after = observed.after
    if before is None:
        return _Mistake(0.0, "")
    if p.old != p.new and p.fits(after, before):
        return _unchanged(p, observed)
    if p.is_rate and p.fits(after, before + float(p.new)):
        reason = "The old timer runs on beside the new one, so that their rates add up."
        return _Mistake(0.0, reason, _TIMER_HINT)
    return _Mistake(0.0, "")


def _unchanged(p: ParameterEffect, observed: _Observed) -> _Mistake:
    """Return the mistake of a parameter that changed nothing."""
    hint = _TIMER_HINT if p.is_rate else _READ_HINT
    if p.fits(observed.restarted, p.new):
        at_start = _AT_START
        if p.is_rate:
            at_start = "The timer keeps its old period until the node is restarted."
        return _Mistake(p.restart_credit, at_start, hint)
    if p.fits(observed.after, p.new):
        return _Mistake(0.0, f"It was {_shown(observed.before)} before, so nothing changed.")
    stays = f"The parameter was accepted, but {p.what} stays at {_shown(observed.after)}"
    if observed.restarted is not None:
        return _Mistake(0.0, f"{stays}, after a restart too: it is declared but ignored.")
    return _Mistake(0.0, f"{stays}.", hint)


_AT_START = "The new value takes effect only after a restart: the parameter is read once, when the node starts."
_READ_HINT = "Read it with self.get_parameter(...) whenever it is used, or take it over in a parameter callback."
_TIMER_HINT = "In a callback of add_post_set_parameters_callback, cancel the timer and create one with the new period."
_SET_HINT = "Declare it with a default of the type that the lab gives it, not read-only; others can then set it."


def _rate(context: Context, p: ParameterEffect) -> Finding:
    """Judge the rate after the change, by the bounds that the machine delays leave."""
    limits = {"full_within": p.full_within, "zero_beyond": p.zero_beyond}
    asked = {"topic": p.topic, "process": p.process, "window": p.after, "rate_hz": float(p.new)}
    return topic_rate(context, TopicRate.model_validate({**asked, **limits}))


def _location_after(context: Context, p: ParameterEffect) -> Location:
    """Point at the topic after the change; at the whole session if the effect is not on a topic."""
    span = None
    if p.topic:
        span = context.session.window(p.after)
    return context.location(p.topic, span)


def _nothing(context: Context, p: ParameterEffect, expected: str, measured: str) -> Finding:
    """State that nothing was seen after the change."""
    span = context.session.window(p.after)
    reason = f"After the parameter was set, nothing was seen of {p.what}."
    credit = Interval(0.0, 0.0)
    if span is not None:
        run = context.session.process(p.process)
        credit = bounds.absence(_MUCH, bounds.delay_of(context.session, run, span))
    return unexplained(
        graded(credit.low, expected, measured, reason, best=credit.high, doubt=credit.why)
    )


#: Delayed share of a window from which a process may have shown nothing for that.
_MUCH = 0.5


def _shown(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, float):
        return f"{value:.4g}"
    return repr(value)[:_MOST_SHOWN]


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
    """Judge refusals by the node's answer, and by its values before and after."""
    step = context.session.step(p.step)
    if step is None:
        wanted = {}
    else:
        wanted = SetParametersStep.given(step).values
    values = ", ".join(f"{name} = {value!r}" for name, value in wanted.items())
    expected = f"refuses {values}, and keeps what it has"
    silent = unanswered(context, step, expected)
    if silent is not None:
        return silent
    if step is None:
        return failed(expected, "", "")
    result = SetParametersResult.of(step)
    parts = [_refusal(p, name, value, result) for name, value in wanted.items()]
    return of_parts(expected, parts, where=(context.location(),))


def _refusal(p: ParameterRejected, name: str, value: Any, result: SetParametersResult) -> Part:
    """Judge the answer of a node to an invalid value."""
    before = {} if result.before is None else result.before
    after = {} if result.after is None else result.after
    refused = result.reasons
    if name not in before:
        reason = f"{name} is not declared, so that refusing it proves nothing."
        return Part(0.0, f"no {name}", reason)
    if name not in refused:
        reason = f"{name} accepts {value!r}."
        return Part(0.0, f"{name} was set to {value!r}", reason, hint=_REFUSE_HINT)
    why = str(refused[name])[:_MOST_SHOWN]
    now = _shown(after.get(name))
    text = f"{name}: refused ({why or 'no reason'}), then {now}"
    if before[name] != after.get(name):
        changed = f"{name} was {_shown(before[name])}, and is {now}"
        return Part(p.changed_credit, text, f"{changed} after it refused {value!r}.")
    if not why.strip():
        reason = f"{name} refuses {value!r} without a reason."
        return Part(p.reasonless_credit, text, reason, hint="Give SetParametersResult a reason.")
    notes: tuple[str, ...] = ()
    if p.reason is not None and not search(p.reason, why):
        notes = (f"The reason {why!r} for {name} is not worded as in the lab.",)
    return Part(1.0, text, notes=notes)


_REFUSE_HINT = "Return SetParametersResult(successful=False, reason=...) from a callback of add_on_set_parameters_callback."
