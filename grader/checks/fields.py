"""Checks of the fields of messages: numbers within limits and texts of a form.

Other checks name topics, fields and windows by the base classes here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
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
from grader.evidence import bounds
from grader.evidence.cpu_delay import Span
from grader.evidence.fields import is_number
from grader.evidence.recorded import (
    Booleans,
    Floats,
    Integers,
    NumericStream,
    Recorded,
    numeric_stream,
)
from grader.lab import references as ref
from grader.lab.patterns import compiled, search
from grader.lab.references import Parameters, Pattern, Share
from grader.lab.steps.wait_exit import WaitExitStep
from grader.result import Finding

#: Number of characters of a text that are compared with a pattern; messages for people are shorter.
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
        is_after_start = found.source_ns >= span.start_ns
        is_before_end = found.source_ns <= span.end_ns
        inside = found.only(is_after_start & is_before_end)
        return inside if len(inside.values) else None


class InWindow(Parameters):
    """Base of checks of messages, all of them or those in a window."""

    window: ref.Window | None = Field(
        None, description="Label of the observe step; else the whole session."
    )

    def span(self, context: Context) -> Span | None:
        """Return the window; None if it is the whole session, or if its step was not reached."""
        if self.window:
            return context.session.window(self.window)
        return None


class OfMessages(InWindow):
    """Base of checks that count right messages."""

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
        """Return the credit for a share of right messages.

        One wrong message too many costs a level, however many are right.
        """
        if share >= self.full_from - 1e-9:
            return 1.0
        credit = quantise(ramp(1 - share, 1 - self.full_from, 1 - self.none_below))
        return min(credit, 1 - 1 / CREDIT_LEVELS)

    @property
    def in_messages(self) -> str:
        """The required number of right messages, in words."""
        if self.full_from == 1:
            return "every message"
        return f"{percent(self.full_from)} of the messages"

    def due(self, context: Context, times_ns: Integers, first_ns: int, within_s: float) -> Booleans:
        """Return which of some messages must be answered: those in the window, or while the node listened.

        A node listens from the first message that it answered on, or a bounded time after the first
        message that it could have answered.

        Parameters
        ----------
        times_ns
            int64[n]: Times of the messages.
        first_ns
            Time of the first answered message.
        within_s
            Time that an answer may take.
        """
        span = self.span(context)
        if span is None:
            start_ns = min(first_ns, int(times_ns.min(initial=first_ns)) + LATE_NS)
            span = Span(start_ns, min(_asked_to_end_ns(context)))
        last_ns = span.end_ns - round(within_s * 1e9)
        due: Booleans = (times_ns >= span.start_ns) & (times_ns <= last_ns)
        return due

    def chosen(self, context: Context, topic: str) -> list[int]:
        """Return the places of the counted messages in a topic's stream, by source time."""
        source_ns = context.session.stream(topic).source_ns
        order: list[int] = np.argsort(source_ns, kind="stable").tolist()
        span = self.span(context)
        if span is None:
            return order
        return [place for place in order if span.start_ns <= source_ns[place] <= span.end_ns]


#: Latest time for a node to begin to listen, after the first message.
LATE_NS = 2_000_000_000


def _asked_to_end_ns(context: Context) -> list[int]:
    """Return when the student's processes were asked to end, or awaited to, and the session's end.

    A process that ends unasked stops answering by its own fault.
    """
    record = context.session.record
    awaited = set()
    for step in record.steps:
        if step.kind == WaitExitStep.kind:
            awaited.add(WaitExitStep.given(step).process)
    asked = [record.ended_ns]
    for run in context.session.students:
        if run.interrupted_ns:
            asked.append(run.interrupted_ns)
        was_asked = run.ended_by == "kill" or run.name in awaited
        if run.exited_ns and was_asked:
            asked.append(run.exited_ns)
    return asked


def numbers_in(pattern: str, text: str | None) -> Floats | None:
    """Return the numbers that a pattern finds in a text, by its named groups or else all groups.

    None if it finds none.
    """
    found = search(pattern, (text or "")[:_MOST_TEXT])
    if found is None:
        return None
    groups = found.groupdict().values() or found.groups()
    try:
        return np.array([float(group) for group in groups], dtype=np.float64)
    except (TypeError, ValueError):
        return None


def nothing_came(context: Context, topic: str, expected: str) -> Finding:
    """State that no messages can be judged."""
    when = " in the time that counts" if len(context.session.stream(topic)) else ""
    reason = f"No message arrived on {context.session.used(topic)}{when}."
    return unexplained(failed(expected, "no messages", reason, where=(context.location(topic),)))


def moment(context: Context, topic: str, t_ns: int) -> tuple[float, Span]:
    """Return a time in seconds since the session's start, and a span of this time alone."""
    return context.session.since_start_s(t_ns), Span(t_ns, t_ns)


#: Limit of all numbers of a field, or one for each.
Limit = float | tuple[float, ...] | None


#: Relative error of a limit as a float32, such as 0.1; and relative error of a change per second by an uneven timer.
_FLOAT32, _UNEVEN = 1e-7, 0.01


def _of_limit(limit: Limit, otherwise: float) -> Floats:
    """Return a limit as an array, widened by the error of a float32.

    Parameters
    ----------
    otherwise
        Value without a limit: infinite, with the sign of the side.
    """
    if limit is None:
        return np.array([otherwise], dtype=np.float64)
    limits = np.atleast_1d(np.array(limit, dtype=np.float64))
    return limits + np.copysign(_FLOAT32 * limits, otherwise)


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
        low = _of_limit(self.low, -np.inf)
        high = _of_limit(self.high, np.inf)
        are_both_lists = len(low) > 1 and len(high) > 1
        if are_both_lists and len(low) != len(high):
            raise ValueError(f"low has {len(low)} numbers, high has {len(high)}")
        if (low > high).any():
            raise ValueError("low is above high")
        return self

    @property
    def expected(self) -> str:
        """The limits in words."""
        limits = []
        if self.low is not None:
            limits.append(f"at least {self.low}")
        if self.high is not None:
            limits.append(f"at most {self.high}")
        if self.change_per_s is not None:
            limits.append(f"changing by up to {self.change_per_s} a second")
        return f"{self.field} {' and '.join(limits) or 'finite'} in {self.in_messages}"


@dataclass(frozen=True)
class _Excesses:
    """Excesses of messages over the limits, in the order of their source times."""

    #: float64[n]: Greatest excess over a limit, 0 if there is none.
    values: Floats
    #: The excess of each message in words; empty if there is none.
    words: Sequence[str]
    #: float64[n]: Change per second before each message if it is too fast, else 0.
    rates: Floats
    #: bool[n]: Whether a late publication may explain the rate.
    late: Booleans

    @property
    def bad(self) -> Booleans:
        """Which messages are wrong."""
        found: Booleans = (self.values > 0) | (self.rates > 0)
        return found

    @property
    def surely_bad(self) -> Booleans:
        """Which messages are wrong, whatever the machine did."""
        is_beyond = self.values > 0
        is_too_fast = self.rates > 0
        found: Booleans = is_beyond | (is_too_fast & ~self.late)
        return found

    @property
    def most_right(self) -> float:
        """Greatest share of right messages that the machine's delays allow."""
        right = ~self.surely_bad
        return float(right.mean())

    @property
    def worst(self) -> int:
        """Place of the message with the greatest excess, or else with the fastest change."""
        excesses = self.values
        if excesses.max() <= 0:
            excesses = self.rates
        return int(np.argmax(excesses))

    def described(self, p: FieldRange, place: int) -> str:
        """Put the fault of a message in words."""
        if self.words[place]:
            return self.words[place]
        rate = f"{self.rates[place]:.4g} a second"
        return f"{p.field} changes by {rate}, more than {p.change_per_s}"


_CHANGES_DOUBT = (
    "Not your fault: the grading computer was busy when the numbers seem to change too fast."
)


def field_range(context: Context, p: FieldRange) -> Finding:
    """Judge the share of messages within the limits, and show the worst."""
    chosen = p.chosen(context, p.topic)
    if not chosen:
        return nothing_came(context, p.topic, p.expected)
    excesses = _excesses(context, p, chosen)
    count = len(chosen)
    good = count - int(excesses.bad.sum())
    worst = excesses.worst
    worst_ns = int(context.session.stream(p.topic).source_ns[chosen[worst]])
    at_s, span = moment(context, p.topic, worst_ns)
    reason = f"At {at_s:.2f} s {excesses.described(p, worst)}."
    if count - good > 1:
        reason += f" It is outside of the limits in {count - good} messages."
    where = context.location(p.topic, span)
    if good == count:
        where = context.location(p.topic, p.span(context))
    return graded(
        p.credit(good / count),
        p.expected,
        f"{good} of {count} messages",
        reason,
        where=(where,),
        best=p.credit(excesses.most_right),
        doubt=_CHANGES_DOUBT,
    )


def _excesses(context: Context, p: FieldRange, chosen: Sequence[int]) -> _Excesses:
    """Compare messages with the limits.

    Parameters
    ----------
    chosen
        Places of the messages in the topic's stream.
    """
    rows = p.rows(context.session)
    values = []
    words = []
    for place in chosen:
        value, text = _beyond(p, rows[place])
        values.append(value)
        words.append(text)
    rates, late = _too_fast(context, p, chosen)
    return _Excesses(np.array(values), words, rates, late)


def _beyond(p: FieldRange, row: Floats | None) -> tuple[float, str]:
    """Return the greatest excess of a message's numbers over the limits, and a clause about it.

    The excess is 0 if there is none, and infinite if the numbers cannot be compared.
    """
    if row is None or not len(row):
        return np.inf, f"the message holds no numbers{_in_field(p)}"
    low = _of_limit(p.low, -np.inf)
    high = _of_limit(p.high, np.inf)
    length = max(len(low), len(high))
    if length not in (1, len(row)):
        return np.inf, f"the message holds {len(row)} numbers, not {length}{_in_field(p)}"
    finite = np.isfinite(row)
    if p.finite and not finite.all():
        index = int(np.argmin(finite))
        return np.inf, f"{_element(p, row, index)} is {row[index]}"
    excess = np.maximum(row - high, low - row)
    excess = np.nan_to_num(excess, nan=0.0, posinf=np.inf)
    index = int(np.argmax(excess))
    if excess[index] <= 0:
        return 0.0, ""
    least = float(np.broadcast_to(low, row.shape)[index])
    most = float(np.broadcast_to(high, row.shape)[index])
    element = _element(p, row, index)
    clause = _outside(element, float(row[index]), least, most)
    return float(excess[index]), clause


def _outside(name: str, value: float, least: float, most: float) -> str:
    """Say on which side of its limits a number is."""
    shown = apart(value, least, most, places=3)
    if value < least:
        return f"{name} is {shown}, below {least:g}"
    return f"{name} is {shown}, above {most:g}"


def _in_field(p: FieldRange) -> str:
    if p.pattern is None:
        return f" in {p.field}"
    return ""


def _element(p: NumbersOf, row: Floats, index: int) -> str:
    """Name one number of a field."""
    if len(row) == 1:
        return p.field
    if p.pattern:
        return f"{p.field}, number {index},"
    return f"{p.field}[{index}]"


def _too_fast(context: Context, p: FieldRange, chosen: Sequence[int]) -> tuple[Floats, Booleans]:
    """Return the change per second before each message if it is too fast, else 0, and where it is unsure.

    It is unsure if the machine delayed a process since the previous message, because numbers that
    were computed in time may have been sent late.
    """
    fast = np.zeros(len(chosen))
    late = np.zeros(len(chosen), dtype=bool)
    if p.change_per_s is None:
        return fast, late
    series = p.series(context.session, p.span(context))
    if series is None or len(series.values) < 2:
        return fast, late
    steps_s = np.diff(series.source_ns) / 1e9
    usual_s = float(np.median(steps_s)) or 1e-9
    changes = np.abs(np.diff(series.values, axis=0)).max(axis=1)
    rates = changes / np.maximum(steps_s, usual_s)
    places = {index: place for place, index in enumerate(chosen)}
    rows = [places[int(index)] for index in series.index[1:]]
    is_too_fast = rates > p.change_per_s * (1 + _UNEVEN)
    fast[rows] = np.where(is_too_fast, rates, 0.0)
    before_ns = series.source_ns[:-1] - round(usual_s * 1e9)
    ends_ns = series.source_ns[1:]
    late[rows] = bounds.made_late(context.session, before_ns, ends_ns, usual_s)
    return fast, late


class Between(Parameters):
    """Limits of a number."""

    low: float | None = Field(None, description="Least value.")
    high: float | None = Field(None, description="Greatest value.")

    def hold(self, numbers: Floats) -> Booleans:
        """Return which numbers lie within them."""
        low = _of_limit(self.low, -np.inf)
        high = _of_limit(self.high, np.inf)
        found: Booleans = (numbers >= low) & (numbers <= high)
        return found

    def __str__(self) -> str:
        limits = []
        if self.low is not None:
            limits.append(f"at least {self.low:g}")
        if self.high is not None:
            limits.append(f"at most {self.high:g}")
        return " and ".join(limits)


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
    """Judge the share of messages that match, and the part of the order that came."""
    chosen = p.chosen(context, p.topic)
    expected = _expected_texts(p)
    if not chosen:
        return nothing_came(context, p.topic, expected)
    texts = _texts(context, p, chosen)
    faults = [_mismatch(p, text) for text in texts]
    good = faults.count("")
    reasons = []
    span = p.span(context)
    if good < len(texts):
        reason, span = _first_fault(context, p, chosen, faults)
        reasons.append(reason)
    measured = f"{good} of {len(texts)} messages match"
    came = _came_in_order(p.in_order, texts)
    if p.in_order:
        measured += f", {came} of {len(p.in_order)} in order"
    if came < len(p.in_order):
        reasons.append(_not_in_order(p, came))
    where = (context.location(p.topic, span),)
    share = p.credit(good / len(texts)) * _order_share(p, came)
    return graded(share, expected, measured, " ".join(reasons), where=where)


def _first_fault(
    context: Context, p: FieldMatches, chosen: Sequence[int], faults: Sequence[str]
) -> tuple[str, Span]:
    """Return a sentence about the first message with a fault, and its time."""
    first = next(place for place, fault in enumerate(faults) if fault)
    first_ns = int(context.session.stream(p.topic).source_ns[chosen[first]])
    at_s, span = moment(context, p.topic, first_ns)
    return f"At {at_s:.2f} s {faults[first]}.", span


def _texts(context: Context, p: FieldMatches, chosen: Sequence[int]) -> list[str | None]:
    """Return the texts of some messages; None for one without."""
    values = context.session.stream(p.topic).field(p.field)
    return [_written(values[place]) for place in chosen]


def _expected_texts(p: FieldMatches) -> str:
    expected = f"'{p.pattern}' in {p.in_messages}"
    if p.in_order:
        expected += f", in the order {', '.join(p.in_order)}"
    return expected


def _order_share(p: FieldMatches, came: int) -> float:
    """Return the share of credit that is left after so many patterns came in order."""
    if came == len(p.in_order):
        return 1.0
    missing = 1 - came / len(p.in_order)
    return 1 - p.order_costs * missing


def _not_in_order(p: FieldMatches, came: int) -> str:
    """Say which pattern does not come after the previous one."""
    after = ""
    if came:
        after = f" after '{p.in_order[came - 1]}'"
    return f"'{p.in_order[came]}' does not come{after}."


def _written(value: Any) -> str | None:
    """Return a text, or a number as it is written."""
    if isinstance(value, str):
        return value[:_MOST_TEXT]
    if isinstance(value, (float, np.floating)):
        return f"{value:g}"
    if is_number(value):
        return str(int(value))
    return None


def _mismatch(p: FieldMatches, text: str | None) -> str:
    """Say how a text differs from the required form; empty if it does not."""
    found = None
    if text is not None:
        found = search(p.pattern, text)
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
    """Return the number of patterns, from the first one on, that are found one after the other."""
    came = 0
    for text in texts:
        if came == len(patterns):
            break
        if text is not None and search(patterns[came], text) is not None:
            came += 1
    return came
