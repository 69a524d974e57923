"""Check of published values against an oracle's, message by message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from grader.checks.base import Context, Part, failed, graded, not_reached
from grader.checks.fields import LATE_NS, NumbersOf, OfMessages, moment, nothing_came
from grader.checks.motion import DISTANCES, Distance
from grader.checks.subscriber import Alternative, lost_share
from grader.evidence import bounds
from grader.evidence.recorded import Booleans, Floats, Integers, NumericStream
from grader.evidence.timing import timing_of
from grader.lab import references as ref
from grader.lab.references import Share
from grader.result import Finding


class OracleStream(NumbersOf):
    """Numbers that an oracle gets."""

    finite: bool = Field(
        True,
        description="Whether it gets messages of finite numbers only; else all, where infinity says something.",
    )


class TopicEqualsOracle(OfMessages, NumbersOf):
    """Published numbers equal those of an oracle, also where these are infinite or not-a-numbers.

    The oracle gets the streams by role, the parameters and the session's seed. With `for_each` it returns a row of
    numbers for each message of that role, all not-a-numbers where there is nothing to publish. Without, it returns
    `{"times_ns": [...], "values": [...]}`, a row for each time.
    """

    example: ClassVar = {"match": "nearest"}

    stamp: ref.StampField = Field(
        "header.stamp", description="Field with the stamp in both messages."
    )
    streams: Mapping[str, OracleStream] = Field(
        min_length=1, description="Role that the oracle knows -> topic and field."
    )
    oracle: ref.Loadable = Field(description="file.py:function beside the rubric.")
    parameters: Mapping[str, Any] = Field(
        default_factory=dict, description="Passed on to the oracle."
    )
    for_each: str | None = Field(None, description="Role of which each message has its answer.")
    match: Literal["stamp", "order", "nearest", "interpolated"] = Field(
        description="How a published message finds its values: by the stamp that it has from a message of `for_each`; "
        "by order, the n-th for the n-th; or at its time, by the nearest of the oracle's times, or between two of them."
    )
    within_s: float = Field(
        0.05,
        gt=0,
        description="By how much a value may be older or newer where time matches, else how late it may come.",
    )
    tolerance: float = Field(
        ge=0, description="How far a message's numbers may be off together, in their unit."
    )
    relative: Share = Field(
        0.0, description="How far they may be off besides, as a share of the value's size."
    )
    distance: Distance = Field("straight", description="How that is measured, as for reaches.")
    alternatives: tuple[Alternative, ...] = Field(
        (), description="Known mistakes, by other parameters of the oracle."
    )

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> TopicEqualsOracle:
        if self.for_each is not None:
            ref.one_of(self.for_each, "role", self.streams)
            if self.match == "stamp":
                ref.stamped(info, (self.topic, self.streams[self.for_each].topic), self.stamp)
        elif self.match == "stamp":
            raise ValueError(
                "to match by stamp, for_each must say the messages of which role have the stamps"
            )
        return self

    @property
    def expected(self) -> str:
        """State the wanted values and their tolerance in words."""
        topics = ", ".join(stream.topic for stream in self.streams.values())
        allowed = f"± {self.tolerance:g}"
        if self.relative > 0:
            allowed += f" and {100 * self.relative:g} % of the value"
        return f"{self.field} on {self.topic} as it follows from {topics}, {allowed}"

    def wanted(self, context: Context, other: Mapping[str, Any] | None = None) -> _Wanted | None:
        """Return the right values, with other parameters; None if a stream was not recorded."""
        streams: dict[str, NumericStream] = {}
        for role, each in self.streams.items():
            stream = each.series(context.session, finite=each.finite)
            if stream is None:
                return None
            streams[role] = stream
        parameters = {**self.parameters, **(other or {})}
        answer = context.oracle(self.oracle)(streams, parameters, context.session.record.seed)
        if self.for_each is None:
            return _Wanted(np.asarray(answer["times_ns"], np.int64), _rows(answer["values"]))
        asked = streams[self.for_each]
        keys = None
        if self.match == "stamp":
            keys = self.stamps(context, self.streams[self.for_each].topic, asked.index)
        return _Wanted(asked.source_ns, _rows(answer), keys)

    def stamps(self, context: Context, topic: str, index: Integers) -> Integers:
        """Return the stamps of some messages; -1 for a message without one."""
        stamps = context.session.stamps_ns(topic, self.stamp)
        found: list[int] = []
        for i in index:
            stamp = stamps[i]
            if stamp is None:
                stamp = -1
            found.append(stamp)
        return np.array(found, dtype=np.int64)


def _rows(values: Any) -> Floats:
    rows: Floats = np.asarray(values, dtype=np.float64)
    if rows.ndim == 1:
        return rows[:, None]
    return rows


def _asked(rows: Floats) -> Booleans:
    """Return which rows hold a number; a row without one asks for no message."""
    return np.logical_not(np.isnan(rows).all(axis=1, keepdims=True))[:, 0]


@dataclass(frozen=True)
class _Wanted:
    """Right values, a row for each time, and the stamps of the messages that they answer."""

    times_ns: Integers
    values: Floats
    stamps_ns: Integers | None = None

    @property
    def asked(self) -> Booleans:
        """True for each row with something to publish."""
        return _asked(self.values)


@dataclass(frozen=True)
class _Compared:
    """Published messages beside the right values."""

    #: The compared messages, in the order of the arrays below.
    published: NumericStream
    #: float64[n]: Distance of each message from the right values beyond the tolerance; 0 or less if it is right.
    excess: Floats
    #: float64[n, m]: Right values; not a number if nothing was to be published.
    right: Floats
    #: Number of messages that were to be published, and of those that were not.
    wanted: int
    missing: int

    @property
    def right_ones(self) -> int:
        """Number of right messages."""
        return int((self.excess <= 0).sum())

    @property
    def superfluous(self) -> int:
        """Number of messages at times when nothing was to be published."""
        return int((~_asked(self.right)).sum())


def topic_equals_oracle(context: Context, p: TopicEqualsOracle) -> Finding:
    """Judge the share of right messages among those that came, and those that should have come."""
    expected = p.expected
    published = p.series(context.session, p.span(context), finite=False)
    if published is None:
        return nothing_came(context, p.topic, expected)
    wanted = p.wanted(context)
    if wanted is None or not wanted.asked.any():
        reason = "Not tested: nothing was recorded from which the right values follow."
        return not_reached(reason, expected=expected)
    width = wanted.values.shape[1]
    own = published.values.shape[1]
    if width != own:
        reason = f"A message holds {own} numbers, not {width}."
        return failed(expected, f"{own} numbers a message", reason)
    found = _compared(context, p, published, wanted)
    if not len(found.excess):
        reason = "No message came at a time for which there is a right value."
        return failed(expected, "0 messages to compare", reason)
    odd = len(p.chosen(context, p.topic)) - len(published.values)
    part = _judged(context, p, found, odd)
    where = part.where or (context.location(p.topic, p.span(context)),)
    mistake = None
    if part.share < 1:
        mistake = _mistake(context, p, published)
    if mistake is not None:
        wrong = failed(expected, part.text, part.reason, where=where)
        return mistake.explains(context, wrong, part.share)
    return graded(
        part.share, expected, part.text, part.reason, where=where, best=part.best, doubt=part.doubt
    )


def _excused(context: Context, p: TopicEqualsOracle, found: _Compared) -> int:
    """Return the number of messages that the machine's delays can have spoilt."""
    unsent = min(found.missing, _unsent(context, p, found))
    return unsent + _old(context, p, found)


def _mistake(
    context: Context, p: TopicEqualsOracle, published: NumericStream
) -> Alternative | None:
    """Return the first known mistake that matches enough messages for full credit."""
    for other in p.alternatives:
        wanted = p.wanted(context, other.parameters)
        if wanted is None or not wanted.asked.any():
            continue
        alike = _compared(context, p, published, wanted)
        if not len(alike.excess):
            continue
        matching = (alike.excess <= 0).mean()
        if matching >= p.full_from - 1e-9:
            return other
    return None


def _judged(context: Context, p: TopicEqualsOracle, found: _Compared, odd: int) -> Part:
    """Judge the share of right messages.

    Parameters
    ----------
    odd
        Number of messages with another number of values, which were not compared.
    """
    of = len(found.excess) + found.missing + odd
    right = found.right_ones
    text = _counted(found, odd, of)
    if right == of:
        return Part(1.0, text)
    share = p.credit(right / of)
    best = p.credit(min(1.0, (right + _excused(context, p, found)) / of))
    doubt = "Not your fault: the grading computer was so busy that the node may not have got all messages in time."
    wrong = found.excess > 0
    if wrong.any():
        first = int(np.argmax(wrong))
        at_s, span = moment(context, p.topic, int(found.published.source_ns[first]))
        reason = f"At {at_s:.2f} s it publishes {_compared_values(found, first)}."
        where = (context.location(p.topic, span),)
        return Part(share, text, reason, best, doubt, where=where)
    reason = _not_compared(found.missing, odd)
    return Part(share, text, reason, best, doubt)


def _counted(found: _Compared, odd: int, of: int) -> str:
    """State the numbers of right, missing, superfluous and odd messages."""
    text = f"{found.right_ones} of {of} messages right"
    if found.missing > 0:
        text += f", {found.missing} missing"
    if found.superfluous > 0:
        text += f", {found.superfluous} superfluous"
    if odd > 0:
        text += f", {odd} with another number of values"
    return text


def _not_compared(missing: int, odd: int) -> str:
    """Say how many messages were missing, and how many have another number of values."""
    reason = ""
    if missing > 0:
        reason = f"{missing} messages were not answered."
    if odd > 0:
        reason += f" {odd} messages hold another number of values."
    return reason


def _compared_values(found: _Compared, index: int) -> str:
    """Return the numbers of a message and the right ones."""
    shown = _numbers(found.published.values[index])
    if np.isnan(found.right[index]).all():
        return f"{shown}, where nothing was asked"
    return f"{shown}; right is {_numbers(found.right[index])}"


def _numbers(row: Floats) -> str:
    return " ".join(f"{number:.5g}" for number in row)


def _unsent(context: Context, p: TopicEqualsOracle, found: _Compared) -> int:
    """Return the greatest number of messages that the recorder or, by machine delays, the node missed."""
    timing = timing_of(context.session.stream(p.topic), p.span(context))
    lost = timing.lost if timing is not None else 0
    return lost + _unheard(context, p, found.wanted)


def _unheard(context: Context, p: TopicEqualsOracle, wanted: int) -> int:
    """Return the greatest number of wanted messages that the node missed because of machine delays."""
    topics = [each.topic for each in p.streams.values()]
    times = max((context.session.stream(topic).source_ns for topic in topics), key=len)
    lost = lost_share(context, context.session.students, topics, times)
    return int(np.ceil(lost * wanted))


def _old(context: Context, p: TopicEqualsOracle, found: _Compared) -> int:
    """Return the number of messages that may be wrong because of a late computation or publication.

    Only messages that are matched by time can be wrong for that.
    """
    if p.match in ("stamp", "order"):
        return 0
    times_ns = found.published.source_ns
    computed_ns = times_ns - round(p.within_s * 1e9)
    late = bounds.made_late(context.session, computed_ns, times_ns, p.within_s)
    return int((late & (found.excess > 0)).sum())


def _compared(
    context: Context, p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted
) -> _Compared:
    """Compare published messages with the right values, by the rule that the check names."""
    if p.match == "stamp":
        return _by_stamp(context, p, published, wanted)
    if p.match == "order":
        return _in_order(context, p, published, wanted)
    return _by_time(p, published, wanted)


def _by_stamp(
    context: Context, p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted
) -> _Compared:
    """Compare each message with the row of the same stamp."""
    assert wanted.stamps_ns is not None
    row_of = {}
    for row, stamp in enumerate(wanted.stamps_ns.tolist()):
        if stamp >= 0:
            row_of[int(stamp)] = row
    stamps = p.stamps(context, p.topic, published.index).tolist()
    places = np.array([row_of.get(stamp, -1) for stamp in stamps])
    return _by_place(context, p, published, wanted, places)


def _by_place(
    context: Context,
    p: TopicEqualsOracle,
    published: NumericStream,
    wanted: _Wanted,
    places: Integers,
) -> _Compared:
    """Compare each message with a row of the right values.

    A second message for the same row is superfluous.

    Parameters
    ----------
    places
        int64[n]: Row of each message, -1 if there is none.
    """
    _, first_ones = np.unique(places, return_index=True)
    again = np.ones(len(places), dtype=bool)
    again[first_ones] = False
    places = np.where(again, -1, places)
    has_row = places >= 0
    right = np.where(has_row[:, None], wanted.values[places], np.nan)
    used = places[has_row]
    first_ns = int(wanted.times_ns[used].min(initial=published.source_ns[0]))
    due = wanted.asked & p.due(context, wanted.times_ns, first_ns, p.within_s)
    count = int(due.sum())
    missing = count - int(due[used].sum())
    excess = _excess(p, published.values, right)
    return _Compared(published, excess, right, count, missing)


def _in_order(
    context: Context, p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted
) -> _Compared:
    """Compare the n-th message with the n-th row, or with a later one if the node began late."""
    asked = np.flatnonzero(wanted.asked)
    first = context.session.stream(p.topic).sequence.min()
    counted = published.sequence - first

    def after(skipped: Integers | int) -> _Compared:
        row = counted + skipped
        inside = np.minimum(row, len(asked) - 1)
        places = np.where(row < len(asked), asked[inside], -1)
        return _by_place(context, p, published, wanted, places)

    missed = _missed_before(context, p, wanted.times_ns[asked])
    starts = [after(start) for start in range(min(max(missed, 1), _MOST_MISSED))]
    start = int(np.argmax([found.right_ones for found in starts]))
    found = starts[start]
    unheard = min(_unheard(context, p, len(asked)), _MOST_MISSED)
    if not unheard or found.right_ones == len(counted):
        return found
    right = [found.excess <= 0]
    for more in range(1, unheard + 1):
        right.append(after(start + more).excess <= 0)
    return after(start + _skipped(np.array(right)))


def _missed_before(context: Context, p: TopicEqualsOracle, asked_ns: Integers) -> int:
    """Return the greatest number of rows that a node missed before it listened.

    Parameters
    ----------
    asked_ns
        int64[n]: Times of the rows that ask for a message.
    """
    first_sent_ns = int(context.session.stream(p.topic).source_ns.min())
    latest_ns = int(asked_ns.min()) + LATE_NS
    missed = asked_ns <= min(first_sent_ns, latest_ns)
    return int(missed.sum())


def _skipped(right: Booleans) -> Integers:
    """Return the numbers of skipped rows before each message that make the most messages right.

    The number never falls, because a skipped row stays skipped.

    Parameters
    ----------
    right
        bool[numbers, messages]: Whether a message is right after that many skipped rows.
    """
    most, counts = right.shape
    whole = np.zeros(most, dtype=np.int64)
    before = np.zeros((counts, most), dtype=np.int64)
    for n in range(counts):
        best = np.maximum.accumulate(whole)
        # The number that reached the best count so far, among those that skip no more than this one.
        reached = np.where(whole == best, np.arange(most), 0)
        before[n] = np.maximum.accumulate(reached)
        whole = whole[before[n]] + right[:, n]
    found = np.empty(counts, dtype=np.int64)
    last = int(np.argmax(whole))
    for n in reversed(range(counts)):
        found[n] = last
        last = before[n, last]
    return found


#: Greatest number of messages that a node may miss, before it listens or because of machine delays.
_MOST_MISSED = 500


def _by_time(p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted) -> _Compared:
    """Compare each message with the values at several times about its own; the best match counts."""
    order = np.argsort(wanted.times_ns, kind="stable")
    times = wanted.times_ns[order]
    values = wanted.values[order]
    tried_excess: list[Floats] = []
    tried_right: list[Floats] = []
    for part in np.linspace(-1.0, 1.0, _TIMES):
        at_ns = published.source_ns + round(part * p.within_s * 1e9)
        candidate = _at(p, times, values, at_ns)
        tried_right.append(candidate)
        tried_excess.append(_excess(p, published.values, candidate))
    best = np.argmin(tried_excess, axis=0)
    rows = np.arange(len(best))
    right = np.array(tried_right)[best, rows]
    excess = np.array(tried_excess)[best, rows]
    # Nothing is compared unless the oracle has values.
    known = _asked(right)
    return _Compared(published.only(known), excess[known], right[known], int(known.sum()), 0)


#: Number of times at which a message is compared; an odd number includes its own time.
_TIMES = 17


def _at(p: TopicEqualsOracle, times: Integers, values: Floats, at_ns: Integers) -> Floats:
    """Return the right values at some times; not a number if the oracle has none."""
    if p.match == "interpolated":
        columns = [np.interp(at_ns, times, each, left=np.nan, right=np.nan) for each in values.T]
        return np.column_stack(columns)
    after = np.searchsorted(times, at_ns)
    after = np.minimum(after, len(times) - 1)
    before = np.maximum(after - 1, 0)
    since_ns = at_ns - times[before]
    until_ns = times[after] - at_ns
    nearest = np.where(since_ns <= until_ns, before, after)
    off_ns = np.abs(at_ns - times[nearest])
    between_ns = p.within_s * 1e9 / (_TIMES - 1)
    near = off_ns <= between_ns + 1
    right: Floats = np.where(near[:, None], values[nearest], np.nan)
    return right


def _excess(p: TopicEqualsOracle, values: Floats, right: Floats) -> Floats:
    """Return the distance of each message from the right values beyond the tolerance.

    It is infinite if it is not known, or if no message was asked for.
    """
    asked = _asked(right)
    same_nan = np.isnan(values) & np.isnan(right)
    same = (values == right) | same_nan
    same_infinity = same & ~np.isfinite(values)
    values = np.where(same_infinity, 0.0, values)
    right = np.where(same_infinity, 0.0, right)
    off: Floats = DISTANCES[p.distance](values, right) - p.tolerance
    if p.distance == "straight":
        sizes = np.linalg.norm(right, axis=1)
        off = off - p.relative * sizes
    off[np.isnan(off) | ~asked] = np.inf
    return off
