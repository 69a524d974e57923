"""Check of the time from a message to its answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    apart,
    failed,
    graded,
    not_reached,
    percent,
    quantise,
    ramp,
    unexplained,
)
from grader.checks.fields import OfMessages, nothing_came
from grader.checks.subscriber import lost_share
from grader.evidence import bounds
from grader.evidence.cpu_delay import Span, shares_around
from grader.evidence.fields import is_number
from grader.evidence.recorded import Booleans, Floats, Integers
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.result import Finding


class LatencyLimit(Parameters):
    """Time within which a share of the messages is answered; credit falls between two limits."""

    share: Share = Field(description="Share of the messages, e.g. 50% for the median, or 95%.")
    full_within_s: float = Field(
        gt=0, description="Time within which they are answered for full credit."
    )
    none_beyond_s: float = Field(gt=0, description="Time beyond which there is none.")

    @model_validator(mode="after")
    def _falls(self) -> LatencyLimit:
        if self.none_beyond_s <= self.full_within_s:
            raise ValueError("none_beyond_s must be more than full_within_s")
        return self


class End(Parameters):
    """A topic, and the field that matches its messages."""

    topic: ref.Topic
    field: ref.WordField | None = Field(
        None, description="Field that a message and its answer have alike."
    )


class MessageLatency(OfMessages):
    """Messages are answered soon, and nearly all of them.

    Times are those at which the messages were sent. Each limit counts the same, and unanswered messages cost their
    share of all.
    """

    input: End = Field(description="The messages that are answered, the grader's or the student's.")
    output: End = Field(description="Their answers.")
    match: Literal["stamp", "field", "next"] = Field(
        description="The answer has the message's header stamp, or the same value in the fields named; or it is the "
        "next message after it, where messages come slower than answers."
    )
    limits: tuple[LatencyLimit, ...] = Field(min_length=1, description="Shares with their limits.")
    full_from: Share = Field(0.95, description="Share of answered messages that costs nothing.")

    @model_validator(mode="after")
    def _has_fields(self, info: ValidationInfo) -> MessageLatency:
        if self.match == "stamp":
            ref.stamped(info, (self.input.topic, self.output.topic))
        if self.match == "field" and None in (self.input.field, self.output.field):
            raise ValueError("to match by field, input and output must name one")
        return self

    def keys(self, context: Context, end: End) -> Sequence[object]:
        """Return the matching key of each message of a topic; None if it has none."""
        if self.match == "stamp":
            return context.session.stamps_ns(end.topic)
        values = context.session.stream(end.topic).field(end.field or "")
        keys: list[object] = []
        for value in values:
            is_key = isinstance(value, str) or is_number(value)
            keys.append(value if is_key else None)
        return keys

    @property
    def expected(self) -> str:
        """State the limits in words."""
        words = []
        limits = []
        for limit in self.limits:
            words.append(
                f"{percent(limit.share)} of answers within {limit.full_within_s * 1e3:g} ms"
            )
            limits.append(f"{limit.none_beyond_s * 1e3:g} ms")
        return f"{', '.join(words)}; none for {' or '.join(limits)}"


@dataclass(frozen=True)
class _Quantile:
    """Credit of one limit, as far as the recording and the machine delays tell."""

    share: float
    best: float
    text: str
    reason: str
    #: True if the machine delays decide the credit.
    is_unsure: bool


@dataclass(frozen=True)
class _Answers:
    """Messages and their answers, both by their source timestamps in ns."""

    #: int64[n]: Times of the messages that could be answered.
    asked_ns: Integers
    #: int64[n]: Times of their answers, -1 if there is none.
    answered_ns: Integers

    @property
    def there(self) -> Booleans:
        """Which messages were answered."""
        return self.answered_ns >= 0

    def only_answered(self) -> _Answers:
        """Return the messages with an answer."""
        return _Answers(self.asked_ns[self.there], self.answered_ns[self.there])

    @property
    def took_s(self) -> Floats:
        """Times between messages and their answers, in seconds."""
        took_s: Floats = (self.answered_ns - self.asked_ns) / 1e9
        return took_s

    @property
    def slowest(self) -> Span:
        """The span between a message and its answer that is longest."""
        index = int(np.argmax(self.took_s))
        return Span(int(self.asked_ns[index]), int(self.answered_ns[index]))

    @property
    def whole(self) -> Span:
        """The span from the first message to the last answer."""
        return Span(int(self.asked_ns.min()), int(self.answered_ns.max()))


def message_latency(context: Context, p: MessageLatency) -> Finding:
    """Judge quantiles of the times from messages to their answers, less the machine delays."""
    if not len(context.session.stream(p.output.topic)):
        return nothing_came(context, p.output.topic, p.expected)
    answers = _answers(context, p)
    count = len(answers.asked_ns)
    if not count:
        reason = f"No message was recorded on {p.input.topic} that could be answered."
        return not_reached(reason, expected=p.expected)
    if not answers.there.any():
        reason = (
            f"No message on {context.session.used(p.output.topic)} answers one on {p.input.topic}."
        )
        return unexplained(failed(p.expected, f"0 of {count} messages answered", reason))
    return _judge_answers(context, p, answers)


def _judge_answers(context: Context, p: MessageLatency, answers: _Answers) -> Finding:
    """Judge how many messages were answered, and how soon."""
    lost = lost_share(context, context.session.students, [p.input.topic], answers.asked_ns)
    there = answers.only_answered()
    quantiles = _quantiles(context, p, there)
    texts = []
    reasons = []
    for quantile in quantiles:
        texts.append(quantile.text)
        if quantile.share < 1:
            reasons.append(quantile.reason)
    count = len(answers.asked_ns)
    answered = len(there.asked_ns)
    texts.append(f"{answered} of {count} messages answered")
    answered_share = float(answers.there.mean())
    kept = p.credit(min(1.0, answered_share))
    if kept < 1:
        reasons.append(f"{count - answered} of {count} messages were not answered.")
    kept_at_best = p.credit(min(1.0, answered_share + lost))
    share = _mean([quantile.share for quantile in quantiles])
    best = _mean([quantile.best for quantile in quantiles])
    return graded(
        kept * share,
        p.expected,
        "; ".join(texts),
        " ".join(reasons),
        where=(context.location(p.output.topic, there.slowest),),
        best=kept_at_best * best,
        doubt=_doubt(context, there, quantiles, lost),
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _quantiles(context: Context, p: MessageLatency, there: _Answers) -> list[_Quantile]:
    """Judge each limit by the answered messages."""
    least_s, took_s = bounds.latencies(context.session, there.asked_ns, there.answered_ns)
    quantiles = []
    for limit in p.limits:
        quantiles.append(_within(limit, took_s, least_s))
    return quantiles


def _doubt(context: Context, there: _Answers, quantiles: Sequence[_Quantile], lost: float) -> str:
    """Say that the machine keeps the latency from being decided, if it does."""
    if lost > 0 or any(each.is_unsure for each in quantiles):
        return bounds.longest_delay(context.session, there.whole).why
    return ""


def _within(limit: LatencyLimit, took_s: Floats, least_s: Floats) -> _Quantile:
    """Judge a quantile by its bounds, which follow from the number of messages and the machine delays.

    The delays count only if they change the credit of the quantile itself. Of the few messages that
    they touch, one is often among the slowest, and the upper bound of a small sample reaches those.

    Parameters
    ----------
    took_s, least_s
        float64[n]: Latencies as measured, and less the machine delays.
    """
    low, high = shares_around(limit.share, len(took_s))
    is_touched = _earned(limit, took_s, limit.share) != _earned(limit, least_s, limit.share)
    worst = _earned(limit, took_s if is_touched else least_s, high)
    best = _earned(limit, least_s, low)
    shown_ms = float(np.quantile(took_s, limit.share)) * 1e3
    shown = apart(shown_ms, limit.full_within_s * 1e3, limit.none_beyond_s * 1e3, places=1)
    share = percent(limit.share)
    text = f"{share} within {shown} ms"
    reason = f"{share} of the answers take up to {shown} ms."
    return _Quantile(worst, max(worst, best), text, reason, is_touched)


def _earned(limit: LatencyLimit, times_s: Floats, share: float) -> float:
    """Return the credit of a quantile of some times."""
    quantile_s = float(np.quantile(times_s, share))
    return quantise(ramp(quantile_s, limit.full_within_s, limit.none_beyond_s), _LEVELS)


#: Credit levels of a latency; fewer than usual, because a quantile has an error.
_LEVELS = CREDIT_LEVELS // 2


def _answers(context: Context, p: MessageLatency) -> _Answers:
    """Return the messages that could be answered, and their answers.

    Messages before the first answer, or too late for one, are left out.
    """
    inputs = context.session.stream(p.input.topic)
    outputs = context.session.stream(p.output.topic)
    if p.match == "next":
        asked = np.sort(inputs.source_ns)
        answered = _next_after(asked, np.sort(outputs.source_ns))
    else:
        asked = inputs.source_ns
        sent_ns = _first_by_key(p.keys(context, p.output), outputs.source_ns.tolist())
        keys = p.keys(context, p.input)
        answered = np.array([sent_ns.get(key, -1) for key in keys], dtype=np.int64)
    # An earlier message is no answer.
    answered = np.where(answered < asked, -1, answered)
    first_ns = int(asked[answered >= 0].min(initial=outputs.source_ns.max()))
    slowest_s = max(limit.none_beyond_s for limit in p.limits)
    due = p.due(context, asked, first_ns, slowest_s)
    return _Answers(asked[due], answered[due])


def _next_after(asked: Integers, sent: Integers) -> Integers:
    """Return the first time of an answer between each message and the next; -1 if there is none."""
    after = np.searchsorted(sent, asked)
    last = len(sent) - 1
    candidates = sent[np.minimum(after, last)]
    found = np.where(after <= last, candidates, -1)
    next_ns = np.append(asked[1:], np.iinfo(np.int64).max)
    answered: Integers = np.where(found < next_ns, found, -1)
    return answered


def _first_by_key(keys: Sequence[object], times_ns: Sequence[int]) -> dict[object, int]:
    """Return the time of the first message of each key, without messages that have none."""
    found: dict[object, int] = {}
    for key, time_ns in zip(keys, times_ns, strict=True):
        if key is not None:
            found.setdefault(key, time_ns)
    return found
