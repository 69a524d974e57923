"""Check of how long it takes from a message to the one that answers it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    Part,
    apart,
    cpu_delay_doubt,
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
from grader.evidence.cpu_delay import Span, shares_around
from grader.evidence.fields import is_number
from grader.evidence.recorded import Floats, Integers
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.result import Finding


class LatencyLimit(Parameters):
    """How soon a share of the messages is answered; credit falls between two limits."""

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
    """A topic, and which field says to what its messages belong."""

    topic: ref.Topic
    field: ref.WordField | None = Field(
        None, description="Field that a message and its answer have alike."
    )


class MessageLatency(OfMessages):
    """Messages are answered soon, and nearly all of them.

    Times are those at which the messages were sent. Each limit counts the same, and what is not answered costs its
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
        """Return by what the messages of a topic belong together; None for one that belongs to none."""
        if self.match == "stamp":
            return context.session.stamps_ns(end.topic)
        values = context.session.stream(end.topic).field(end.field or "")
        return [value if isinstance(value, str) or is_number(value) else None for value in values]


def message_latency(context: Context, p: MessageLatency) -> Finding:
    """Judge quantiles of the times from messages to their answers, less the machine's delays."""
    words = (f"{percent(n.share)} of answers within {n.full_within_s * 1e3:g} ms" for n in p.limits)
    expected = f"{', '.join(words)}; none for {' or '.join(f'{n.none_beyond_s * 1e3:g} ms' for n in p.limits)}"
    if not len(context.session.stream(p.output.topic)):
        return nothing_came(context, p.output.topic, expected)
    asked, answered = _answers(context, p)
    if not len(asked):
        return not_reached(
            f"No message was recorded on {p.input.topic} that could be answered.", expected=expected
        )
    there = answered >= 0
    if not there.any():
        reason = (
            f"No message on {context.session.used(p.output.topic)} answers one on {p.input.topic}."
        )
        return unexplained(failed(expected, f"0 of {len(there)} messages answered", reason))
    lost = lost_share(context, context.session.students, [p.input.topic], asked)
    asked, answered = asked[there], answered[there]
    # What waited while the machine delayed a process is answered for as long after that.
    delays_s = context.session.delays_s(asked - round(_WAITED_S * 1e9), answered)
    took_s: Floats = (answered - asked) / 1e9
    parts = [_within(limit, took_s, np.maximum(took_s - delays_s, 0.0)) for limit in p.limits]
    share, best = (
        sum(getattr(part, key) for part in parts) / len(parts) for key in ("share", "best")
    )
    all_there, most_there = (p.credit(min(1.0, float(there.mean()) + more)) for more in (0.0, lost))
    texts = [*(part.text for part in parts), f"{len(asked)} of {len(there)} messages answered"]
    reasons = [part.reason for part in parts if part.share < 1]
    reasons += [f"{int((~there).sum())} of {len(there)} messages were not answered."] * (
        all_there < 1
    )
    slowest, whole = int(np.argmax(took_s)), Span(int(asked.min()), int(answered.max()))
    where = context.location(p.output.topic, Span(int(asked[slowest]), int(answered[slowest])))
    unsure = lost > 0 or any(part.doubt for part in parts)
    doubt = (
        cpu_delay_doubt(context.session.longest_delay_s(whole), whole.duration_s) if unsure else ""
    )
    finding = (share * all_there, expected, "; ".join(texts), " ".join(reasons))
    return graded(*finding, where=(where,), best=best * most_there, doubt=doubt)


#: So long before a message a delay may keep its answer waiting.
_WAITED_S = 0.05


def _within(limit: LatencyLimit, took_s: Floats, least_s: Floats) -> Part:
    """Judge a quantile by the bounds that the number of messages and the machine's delays leave.

    Where the delays do not decide what it earns, they count no further: of the few messages that they touched, one is
    often among the slowest of all, up to which the bounds of a sample reach.
    """

    def earned(times_s: Floats, share: float) -> float:
        return quantise(
            ramp(float(np.quantile(times_s, share)), limit.full_within_s, limit.none_beyond_s),
            _LEVELS,
        )

    low, high = shares_around(limit.share, len(took_s))
    touched = earned(took_s, limit.share) != earned(least_s, limit.share)
    worst, best = earned(took_s if touched else least_s, high), earned(least_s, low)
    shown_s = float(np.quantile(took_s, limit.share))
    shown = apart(shown_s * 1e3, limit.full_within_s * 1e3, limit.none_beyond_s * 1e3, places=1)
    reason = f"{percent(limit.share)} of the answers take up to {shown} ms."
    doubt = "The machine's delays decide it." if touched else ""
    return Part(worst, f"{percent(limit.share)} within {shown} ms", reason, max(worst, best), doubt)


#: A quantile is known only to some part of itself.
_LEVELS = CREDIT_LEVELS // 2


def _answers(context: Context, p: MessageLatency) -> tuple[Integers, Integers]:
    """Return when messages were sent, and when their answers were, -1 where there is none.

    What was sent before the first answer, or too late to be answered, is left out.
    """
    inputs, outputs = (context.session.stream(end.topic) for end in (p.input, p.output))
    if p.match == "next":
        asked, sent = np.sort(inputs.source_ns), np.sort(outputs.source_ns)
        after = np.searchsorted(sent, asked)
        found = np.where(after < len(sent), sent[np.minimum(after, len(sent) - 1)], -1)
        next_ns = np.append(asked[1:], np.iinfo(np.int64).max)
        answered = np.where(found < next_ns, found, -1)
    else:
        sent_ns = dict(
            zip(
                reversed(p.keys(context, p.output)),
                reversed(outputs.source_ns.tolist()),
                strict=True,
            )
        )
        sent_ns.pop(None, None)
        asked = inputs.source_ns
        answered = np.array(
            [sent_ns.get(key, -1) for key in p.keys(context, p.input)], dtype=np.int64
        )
    answered = np.where(answered < asked, -1, answered)  # What came before it does not answer it.
    first_ns = int(asked[answered >= 0].min(initial=outputs.source_ns.max()))
    due = p.due(context, asked, first_ns, max(limit.none_beyond_s for limit in p.limits))
    return asked[due], answered[due]
