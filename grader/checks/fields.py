"""Checks of the fields of messages: numbers within limits, texts of a form; and fields as other checks name them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    apart,
    failed,
    graded,
    percent,
    quantise,
    ramp,
    unexplained,
)
from grader.evidence.cpu_delay import Span
from grader.evidence.fields import is_number
from grader.evidence.recorded import Floats, Integers, NumericStream, Recorded, numeric_stream
from grader.lab import references as ref
from grader.lab.patterns import compiled, search
from grader.lab.references import Parameters, Pattern, Share
from grader.result import Finding

#: Of a text so much is compared with a pattern; messages that are meant to be read are shorter.
_MOST_TEXT = 2000


class NumbersOf(Parameters):
    """Numbers in the messages of a topic."""

    topic: ref.Topic
    pattern: Pattern | None = Field(
        None, description="Finds the numbers in a text: its named groups, or all of them, in order."
    )
    field: ref.NumbersField

    @field_validator("pattern")
    @classmethod
    def _has_groups(cls, value: str | None) -> str | None:
        if value is not None and not compiled(value).groups:
            raise ValueError(
                "a group of the pattern has to hold each number, as in 'range=([0-9.]+)'"
            )
        return value

    def rows(self, recorded: Recorded) -> Sequence[Floats | None]:
        """Return the numbers of each message; None where a message has none."""
        if self.pattern is None:
            return recorded.rows(self.topic, self.field)
        return [numbers_in(self.pattern, text) for text in recorded.texts(self.topic, self.field)]

    def series(
        self, recorded: Recorded, span: Span | None = None, *, finite: bool = True
    ) -> NumericStream | None:
        """Return the messages with (finite) numbers by source time, of a span; None without any."""
        found = numeric_stream(recorded.stream(self.topic), self.rows(recorded), finite=finite)
        if found is None or span is None:
            return found
        inside = found.only((found.source_ns >= span.start_ns) & (found.source_ns <= span.end_ns))
        return inside if len(inside.values) else None


class InWindow(Parameters):
    """Base of checks that look at messages, all of them or those of a time."""

    window: ref.Window | None = Field(
        None, description="Label of the observe step; else the whole session."
    )

    def span(self, context: Context) -> Span | None:
        """Return the time that counts; None where that is the whole session, or the step was not reached."""
        return context.session.window(self.window) if self.window else None


class OfMessages(InWindow):
    """Base of checks that count in how many messages all is right."""

    full_from: Share = Field(1.0, description="Share of right messages from which credit is full.")
    none_below: Share = Field(
        0.0, description="Share of right messages up to which there is no credit."
    )

    @model_validator(mode="after")
    def _falls(self) -> OfMessages:
        if self.none_below >= self.full_from:
            raise ValueError("none_below must be less than full_from")
        return self

    def credit(self, share: float) -> float:
        """Return the credit for a share of right messages. One wrong message too many is seen, however many are right.

        A share is known to a part of a message, and not better.
        """
        if share >= self.full_from - 1e-9:
            return 1.0
        return min(
            quantise(ramp(1 - share, 1 - self.full_from, 1 - self.none_below)),
            1 - 1 / CREDIT_LEVELS,
        )

    @property
    def in_messages(self) -> str:
        """In how many messages all has to be right, in words."""
        return (
            "every message" if self.full_from == 1 else f"{percent(self.full_from)} of the messages"
        )

    def due(
        self, context: Context, times_ns: Integers, first_ns: int, within_s: float
    ) -> NDArray[np.bool_]:
        """Return which of some messages have to be answered, so soon: those of the window, or while somebody listened.

        A node listens when it has answered the first, which may be later than it was asked, but not by long.
        """
        span = self.span(context)
        if span is None:
            start_ns = min(first_ns, int(times_ns.min(initial=first_ns)) + LATE_NS)
            span = Span(start_ns, min(_asked_to_end_ns(context)))
        due: NDArray[np.bool_] = (times_ns >= span.start_ns) & (
            times_ns <= span.end_ns - round(within_s * 1e9)
        )
        return due

    def chosen(self, context: Context, topic: str) -> list[int]:
        """Return which messages of a topic's stream count, by source time."""
        source_ns, span = context.session.stream(topic).source_ns, self.span(context)
        order = np.argsort(source_ns, kind="stable").tolist()
        return [i for i in order if span is None or span.start_ns <= source_ns[i] <= span.end_ns]


#: So long after the first message that it could answer a node may begin to listen.
LATE_NS = 2_000_000_000


def _asked_to_end_ns(context: Context) -> list[int]:
    """Return when the student's processes were asked to end, or awaited to; one that ends unasked stops answering."""
    record = context.session.record
    awaited = {
        str(step.parameters.get("process")) for step in record.steps if step.kind == "wait_exit"
    }
    asked = [run.interrupted_ns for run in context.session.students]
    asked += [
        run.exited_ns
        for run in context.session.students
        if run.ended_by == "kill" or run.name in awaited
    ]
    return [record.ended_ns, *filter(None, asked)]


def numbers_in(pattern: str, text: str | None) -> Floats | None:
    """Return the numbers that a pattern finds in a text, by its named groups or all; None where it finds none."""
    found = search(pattern, (text or "")[:_MOST_TEXT])
    if found is None:
        return None
    try:
        return np.array(
            [float(group) for group in found.groupdict().values() or found.groups()],
            dtype=np.float64,
        )
    except (TypeError, ValueError):
        return None


def nothing_came(context: Context, topic: str, expected: str) -> Finding:
    """State that there are no messages to look at."""
    when = " in the time that counts" if len(context.session.stream(topic)) else ""
    reason = f"No message arrived on {context.session.used(topic)}{when}."
    return unexplained(failed(expected, "no messages", reason, where=(context.location(topic),)))


def moment(context: Context, topic: str, t_ns: int) -> tuple[float, Span]:
    """Return a time in s since the session's start, and the span that points at it."""
    return context.session.since_start_s(t_ns), Span(t_ns, t_ns)


#: A limit for all numbers of a field, or one for each.
Limit = float | tuple[float, ...] | None


#: How far a limit is another number as a float32: 0.1 is a little more there. And by which share a change may seem
#: faster, from one message of a timer to the next, than it was computed.
_FLOAT32, _UNEVEN = 1e-7, 0.01


def _of_limit(limit: Limit, otherwise: float) -> Floats:
    limits = np.atleast_1d(np.array(otherwise if limit is None else limit, dtype=np.float64))
    return limits if limit is None else limits + np.copysign(_FLOAT32 * limits, otherwise)


class FieldRange(OfMessages, NumbersOf):
    """Numbers in a field stay within limits, and do not change too fast."""

    low: Limit = Field(None, description="Least value, of all numbers or a list with one for each.")
    high: Limit = Field(
        None, description="Greatest value, of all numbers or a list with one for each."
    )
    change_per_s: float | None = Field(
        None,
        gt=0,
        description="Most by which a number may change in a second, from one message to the next; "
        "messages that come sooner than usual count as if they came as usual.",
    )
    finite: bool = Field(
        True, description="Whether all must be finite; else those that are no numbers are left out."
    )

    @model_validator(mode="after")
    def _limits_something(self) -> FieldRange:
        low, high = _of_limit(self.low, -np.inf), _of_limit(self.high, np.inf)
        if len(low) > 1 and len(high) > 1 and len(low) != len(high):
            raise ValueError(f"low has {len(low)} numbers, high has {len(high)}")
        if (low > high).any():
            raise ValueError("low is above high")
        return self

    @property
    def expected(self) -> str:
        """What is asked for, in words."""
        words = (
            ("at least {}", self.low),
            ("at most {}", self.high),
            ("changing by up to {} a second", self.change_per_s),
        )
        limits = [text.format(limit) for text, limit in words if limit is not None]
        return f"{self.field} {' and '.join(limits) or 'finite'} in {self.in_messages}"


def field_range(context: Context, p: FieldRange) -> Finding:
    """Judge the share of messages within the limits; the worst is shown."""
    rows, chosen = p.rows(context.session), p.chosen(context, p.topic)
    if not chosen:
        return nothing_came(context, p.topic, p.expected)
    over = [_beyond(p, rows[i]) for i in chosen]
    steps, late = _too_fast(context, p, chosen)
    bad = np.array([excess > 0 for excess, _ in over]) | (steps > 0)
    sure = np.array([excess > 0 for excess, _ in over]) | ((steps > 0) & ~late)
    count, good = len(chosen), int((~bad).sum())
    measured = f"{good} of {count} messages"
    doubt = (
        "Not your fault: the grading computer was busy when the numbers seem to change too fast."
    )
    excesses = np.array([excess for excess, _ in over])
    worst = int(np.argmax(excesses if excesses.max() > 0 else steps))
    at_s, span = moment(
        context, p.topic, int(context.session.stream(p.topic).source_ns[chosen[worst]])
    )
    what = (
        over[worst][1]
        or f"{p.field} changes by {steps[worst]:.4g} a second, more than {p.change_per_s}"
    )
    reason = f"At {at_s:.2f} s {what}." + (
        f" So it is in {count - good} messages." if count - good > 1 else ""
    )
    shares = (p.credit(good / count), p.credit(float((~sure).mean())))
    where = (context.location(p.topic, span if bad.any() else p.span(context)),)
    return graded(shares[0], p.expected, measured, reason, where=where, best=shares[1], doubt=doubt)


def _beyond(p: FieldRange, row: Floats | None) -> tuple[float, str]:
    """Return by how much a message's numbers are beyond the limits at most, and say so; 0 where none is."""
    low, high = _of_limit(p.low, -np.inf), _of_limit(p.high, np.inf)
    length = max(len(low), len(high))
    if row is None or not len(row) or length not in (1, len(row)):
        holds = "no numbers" if row is None or not len(row) else f"{len(row)} numbers, not {length}"
        return np.inf, f"the message holds {holds}" + (
            f" in {p.field}" if p.pattern is None else ""
        )
    if p.finite and not np.isfinite(row).all():
        index = int(np.argmin(np.isfinite(row)))
        return np.inf, f"{_element(p, row, index)} is {row[index]}"
    excess = np.nan_to_num(np.maximum(row - high, low - row), nan=0.0, posinf=np.inf)
    index = int(np.argmax(excess))
    if excess[index] <= 0:
        return 0.0, ""
    limits = [float(np.broadcast_to(limit, row.shape)[index]) for limit in (low, high)]
    side = f"below {limits[0]:g}" if row[index] < limits[0] else f"above {limits[1]:g}"
    return float(
        excess[index]
    ), f"{_element(p, row, index)} is {apart(float(row[index]), *limits, places=3)}, {side}"


def _element(p: NumbersOf, row: Floats, index: int) -> str:
    return (
        p.field
        if len(row) == 1
        else f"{p.field}, number {index},"
        if p.pattern
        else f"{p.field}[{index}]"
    )


def _too_fast(
    context: Context, p: FieldRange, chosen: Sequence[int]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return how fast numbers changed before each message, where that was too fast, else 0; and where that is unsure.

    It is where the machine delayed somebody since the message before: what was computed in time was sent late.
    """
    fast, late = np.zeros(len(chosen)), np.zeros(len(chosen), dtype=bool)
    series = p.series(context.session, p.span(context)) if p.change_per_s is not None else None
    if series is None or len(series.values) < 2 or p.change_per_s is None:
        return fast, late
    steps_s = np.diff(series.source_ns) / 1e9
    usual_s = float(np.median(steps_s)) or 1e-9
    rates = np.abs(np.diff(series.values, axis=0)).max(axis=1) / np.maximum(steps_s, usual_s)
    places = {index: n for n, index in enumerate(chosen)}
    rows = [places[int(index)] for index in series.index[1:]]
    fast[rows] = np.where(rates > p.change_per_s * (1 + _UNEVEN), rates, 0.0)
    delays_s = context.session.delays_s(
        series.source_ns[:-1] - round(usual_s * 1e9), series.source_ns[1:]
    )
    late[rows] = delays_s > _DELAYED * usual_s
    return fast, late


#: A delay of this share of the usual time between two messages can make a change look fast.
_DELAYED = 0.2


class Between(Parameters):
    """Limits of a number."""

    low: float | None = Field(None, description="Least value.")
    high: float | None = Field(None, description="Greatest value.")

    def hold(self, numbers: Floats) -> NDArray[np.bool_]:
        """Return which numbers lie within them."""
        found: NDArray[np.bool_] = (numbers >= _of_limit(self.low, -np.inf)) & (
            numbers <= _of_limit(self.high, np.inf)
        )
        return found

    def __str__(self) -> str:
        limits = {"at least": self.low, "at most": self.high}
        return " and ".join(
            f"{words} {limit:g}" for words, limit in limits.items() if limit is not None
        )


class FieldMatches(OfMessages):
    """Texts are of a form, numbers in them lie within limits, and some come in order.

    A number such as an enum is compared as it is written: 3, or 0.5. A pattern is looked for anywhere in the text,
    unless it begins with ^ and ends with $.
    """

    topic: ref.Topic
    field: ref.WordField
    pattern: Pattern = Field(description="Regular expression that is found in every message.")
    numbers: Mapping[str, Between] = Field(
        default_factory=dict,
        description="Named group of the pattern -> limits of the number that it holds.",
    )
    in_order: tuple[Pattern, ...] = Field(
        (),
        description="Regular expressions that are found one after the other, with others between them or not.",
    )
    order_costs: Share = Field(
        0.5, description="Share of the credit that is lost where none of them comes in order."
    )

    @model_validator(mode="after")
    def _groups_are_there(self) -> FieldMatches:
        groups = list(compiled(self.pattern).groupindex)
        for name in self.numbers:
            ref.one_of(name, "named group", groups, " in the pattern")
        return self


def field_matches(context: Context, p: FieldMatches) -> Finding:
    """Judge the share of messages that match, and how much of the order came."""
    values = context.session.stream(p.topic).field(p.field)
    chosen = p.chosen(context, p.topic)
    expected = (
        f"'{p.pattern}' in {p.in_messages}"
        + f", in the order {', '.join(p.in_order)}" * bool(p.in_order)
    )
    if not chosen:
        return nothing_came(context, p.topic, expected)
    texts = [_written(values[i]) for i in chosen]
    faults = list(map(partial(_mismatch, p), texts))
    good = faults.count("")
    share, where, reasons = (
        p.credit(good / len(texts)),
        context.location(p.topic, p.span(context)),
        [],
    )
    if good < len(texts):
        first = next(n for n, fault in enumerate(faults) if fault)
        at_s, span = moment(
            context, p.topic, int(context.session.stream(p.topic).source_ns[chosen[first]])
        )
        reasons, where = [f"At {at_s:.2f} s {faults[first]}."], context.location(p.topic, span)
    came = _came_in_order(p.in_order, texts)
    if came < len(p.in_order):
        share *= 1 - p.order_costs * (1 - came / len(p.in_order))
        after = f" after '{p.in_order[came - 1]}'" if came else ""
        reasons.append(f"'{p.in_order[came]}' does not come{after}.")
    measured = (
        f"{good} of {len(texts)} messages match"
        + f", {came} of {len(p.in_order)} in order" * bool(p.in_order)
    )
    return graded(share, expected, measured, " ".join(reasons), where=(where,))


def _written(value: Any) -> str | None:
    """Return a text, or a number as it is written."""
    if isinstance(value, str):
        return value[:_MOST_TEXT]
    if isinstance(value, (float, np.floating)):
        return f"{value:g}"
    return str(int(value)) if is_number(value) else None


def _mismatch(p: FieldMatches, text: str | None) -> str:
    """Say why a text is not of the form that is asked for; empty where it is."""
    found = search(p.pattern, text) if text is not None else None
    if found is None:
        return f"the message is {(text or '')[:100]!r}"
    for name, limits in p.numbers.items():
        try:
            number = float(found[name])
        except (TypeError, ValueError):
            return f"{name} is {str(found[name])[:40]!r}, no number"
        if not limits.hold(np.array([number]))[0]:
            return f"{name} is {number:g}, not {limits}"
    return ""


def _came_in_order(patterns: Sequence[str], texts: Sequence[str | None]) -> int:
    """Return how many of some patterns, from the first one on, are found one after the other."""
    came = 0
    for text in texts:
        if came < len(patterns) and text is not None and search(patterns[came], text) is not None:
            came += 1
    return came
