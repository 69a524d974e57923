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

    def wanted(self, context: Context, other: Mapping[str, Any] | None = None) -> _Wanted | None:
        """Return what is right, with other parameters; None where a stream was not recorded."""
        streams = {
            role: each.series(context.session, finite=each.finite)
            for role, each in self.streams.items()
        }
        if any(stream is None for stream in streams.values()):
            return None
        parameters = {**self.parameters, **(other or {})}
        answer = context.oracle(self.oracle)(streams, parameters, context.session.record.seed)
        if self.for_each is None:
            return _Wanted(np.asarray(answer["times_ns"], np.int64), _rows(answer["values"]))
        asked = streams[self.for_each]
        assert asked is not None
        topic = self.streams[self.for_each].topic
        keys = self.stamps(context, topic, asked.index) if self.match == "stamp" else None
        return _Wanted(asked.source_ns, _rows(answer), keys)

    def stamps(self, context: Context, topic: str, index: Integers) -> Integers:
        """Return the stamps of some messages; -1 where one has none."""
        stamps = context.session.stamps_ns(topic, self.stamp)
        return np.array(
            [-1 if (stamp := stamps[i]) is None else stamp for i in index], dtype=np.int64
        )


def _rows(values: Any) -> Floats:
    rows: Floats = np.asarray(values, dtype=np.float64)
    return rows[:, None] if rows.ndim == 1 else rows


def _asked(rows: Floats) -> Booleans:
    """Return which rows say something: not those that are all not-a-numbers."""
    return np.logical_not(np.isnan(rows).all(axis=1, keepdims=True))[:, 0]


@dataclass(frozen=True)
class _Wanted:
    """What is right: a row a time, and the stamps of the messages that it answers."""

    times_ns: Integers
    values: Floats
    stamps_ns: Integers | None = None

    @property
    def asked(self) -> Booleans:
        """Whether there is something to publish, for each row."""
        return _asked(self.values)


@dataclass(frozen=True)
class _Compared:
    """What was published, beside what is right."""

    #: The messages that are compared, in which the arrays below have their order.
    published: NumericStream
    #: float64[n]: How far each message is off, less what is allowed: right where it is 0 or less.
    excess: Floats
    #: float64[n, m]: What would have been right; not a number where nothing was to be published.
    right: Floats
    #: How many messages were to be published, and how many of these were not.
    wanted: int
    missing: int

    @property
    def right_ones(self) -> int:
        """How many messages are right."""
        return int((self.excess <= 0).sum())


def topic_equals_oracle(context: Context, p: TopicEqualsOracle) -> Finding:
    """Judge the share of right messages among those that came, and those that should have come."""
    allowed = f"± {p.tolerance:g}" + f" and {100 * p.relative:g} % of the value" * (p.relative > 0)
    expected = f"{p.field} on {p.topic} as it follows from {', '.join(n.topic for n in p.streams.values())}, {allowed}"
    published = p.series(context.session, p.span(context), finite=False)
    if published is None:
        return nothing_came(context, p.topic, expected)
    wanted = p.wanted(context)
    if wanted is None or not wanted.asked.any():
        return not_reached(
            "Not tested: nothing was recorded from which the right values follow.",
            expected=expected,
        )
    width, own = wanted.values.shape[1], published.values.shape[1]
    if width != own:
        return failed(
            expected, f"{own} numbers a message", f"A message holds {own} numbers, not {width}."
        )
    found = _compared(context, p, published, wanted)
    odd = len(p.chosen(context, p.topic)) - len(published.values)
    if not len(found.excess):
        return failed(
            expected,
            "0 messages to compare",
            "No message came at a time for which there is a right value.",
        )
    part = _judged(context, p, found, odd)
    where = part.where or (context.location(p.topic, p.span(context)),)
    for other in p.alternatives if part.share < 1 else ():
        another = p.wanted(context, other.parameters)
        if another is None or not another.asked.any():
            continue
        alike = _compared(context, p, published, another)
        if len(alike.excess) and (alike.excess <= 0).mean() >= p.full_from - 1e-9:
            wrong = failed(expected, part.text, part.reason, where=where)
            return other.explains(context, wrong, part.share)
    return graded(
        part.share, expected, part.text, part.reason, where=where, best=part.best, doubt=part.doubt
    )


def _judged(context: Context, p: TopicEqualsOracle, found: _Compared, odd: int) -> Part:
    """Judge how many messages are right, beside odd ones, and how many the machine may have kept from being so."""
    wrong, of = found.excess > 0, len(found.excess) + found.missing + odd
    extra, right = int((~_asked(found.right)).sum()), int((~wrong).sum())
    text = f"{right} of {of} messages right" + f", {found.missing} missing" * (found.missing > 0)
    text += f", {extra} superfluous" * (extra > 0) + f", {odd} with another number of values" * (
        odd > 0
    )
    if right == of:
        return Part(1.0, text)
    excused = min(found.missing, _unsent(context, p, found)) + _old(context, p, found)
    best = p.credit(min(1.0, (right + excused) / of))
    doubt = "Not your fault: the grading computer was so busy that the node may not have got all messages in time."
    reason = f"{found.missing} messages were not answered." * (found.missing > 0)
    reason += f" {odd} messages hold another number of values." * (odd > 0)
    if not wrong.any():
        return Part(p.credit(right / of), text, reason, best, doubt)
    first = int(np.argmax(wrong))
    at_s, span = moment(context, p.topic, int(found.published.source_ns[first]))
    shown, meant = (
        " ".join(f"{n:.5g}" for n in row)
        for row in (found.published.values[first], found.right[first])
    )
    nothing = np.isnan(found.right[first]).all()
    reason = f"At {at_s:.2f} s it publishes {shown}{', where nothing was asked' if nothing else f'; right is {meant}'}."
    return Part(
        p.credit(right / of), text, reason, best, doubt, where=(context.location(p.topic, span),)
    )


def _unsent(context: Context, p: TopicEqualsOracle, found: _Compared) -> int:
    """Return how many messages the recorder may have missed, or the node for the machine's delays."""
    timing = timing_of(context.session.stream(p.topic), p.span(context))
    return (timing.lost if timing is not None else 0) + _unheard(context, p, found.wanted)


def _unheard(context: Context, p: TopicEqualsOracle, wanted: int) -> int:
    """Return how many of the messages that were to be answered the node may not have got for the machine's delays."""
    topics = [each.topic for each in p.streams.values()]
    times = max((context.session.stream(topic).source_ns for topic in topics), key=len)
    return int(np.ceil(lost_share(context, context.session.students, topics, times) * wanted))


def _old(context: Context, p: TopicEqualsOracle, found: _Compared) -> int:
    """Return how many messages may be wrong since they were computed, or sent, late: where times match alone."""
    if p.match in ("stamp", "order"):
        return 0
    times_ns = found.published.source_ns
    late = (
        context.session.delays_s(times_ns - round(p.within_s * 1e9), times_ns)
        > _DELAYED * p.within_s
    )
    return int((late & (found.excess > 0)).sum())


#: A delay of this share of the time by which a value may be old can make it older.
_DELAYED = 0.2


def _compared(
    context: Context, p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted
) -> _Compared:
    if p.match == "stamp":
        assert wanted.stamps_ns is not None
        places = {int(stamp): n for n, stamp in enumerate(wanted.stamps_ns.tolist()) if stamp >= 0}
        stamps = p.stamps(context, p.topic, published.index).tolist()
        return _by_place(
            context, p, published, wanted, np.array([places.get(stamp, -1) for stamp in stamps])
        )
    if p.match == "order":
        return _in_order(context, p, published, wanted)
    return _by_time(p, published, wanted)


def _by_place(
    context: Context,
    p: TopicEqualsOracle,
    published: NumericStream,
    wanted: _Wanted,
    places: Integers,
) -> _Compared:
    """Compare each message with the row at a place, -1 where there is none; what answers it again is superfluous."""
    again = np.ones(len(places), dtype=bool)
    again[np.unique(places, return_index=True)[1]] = False
    places = np.where(again, -1, places)
    right = np.where(places[:, None] >= 0, wanted.values[places], np.nan)
    used, due = places[places >= 0], wanted.asked
    first_ns = int(wanted.times_ns[used].min(initial=published.source_ns[0]))
    due &= p.due(context, wanted.times_ns, first_ns, p.within_s)
    missing = int(due.sum() - due[used].sum())
    return _Compared(published, _excess(p, published.values, right), right, int(due.sum()), missing)


def _in_order(
    context: Context, p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted
) -> _Compared:
    """Compare the n-th message with the n-th row, or one some places after that: a node may begin late."""
    asked, stream = np.flatnonzero(wanted.asked), context.session.stream(p.topic)
    counted = published.sequence - stream.sequence.min()
    begun_ns = min(int(stream.source_ns.min()), int(wanted.times_ns[asked].min()) + LATE_NS)
    missed = int((wanted.times_ns[asked] <= begun_ns).sum())

    def after(skipped: Integers | int) -> _Compared:
        row = counted + skipped
        places = np.where(row < len(asked), asked[np.minimum(row, len(asked) - 1)], -1)
        return _by_place(context, p, published, wanted, places)

    starts = [after(start) for start in range(min(max(missed, 1), _MOST_MISSED))]
    start = int(np.argmax([found.right_ones for found in starts]))
    unheard = min(_unheard(context, p, len(asked)), _MOST_MISSED)
    if not unheard or starts[start].right_ones == len(counted):
        return starts[start]
    later = [starts[start], *(after(start + more) for more in range(1, unheard + 1))]
    return after(start + _skipped(np.array([found.excess <= 0 for found in later])))


def _skipped(right: Booleans) -> Integers:
    """Return how many rows were skipped before each message, by which of them are right after so many: the most are.

    What was skipped once stays so: the count never falls.
    """
    most, counts = right.shape
    whole = np.zeros(most, dtype=np.int64)
    before = np.zeros((counts, most), dtype=np.int64)
    for n in range(counts):
        best = np.maximum.accumulate(whole)
        # Where the best count so far was reached, of those that skip no more than this one.
        before[n] = np.maximum.accumulate(np.where(whole == best, np.arange(most), 0))
        whole = whole[before[n]] + right[:, n]
    found = np.empty(counts, dtype=np.int64)
    last = int(np.argmax(whole))
    for n in reversed(range(counts)):
        found[n] = last
        last = before[n, last]
    return found


#: So many messages a node may miss, before it listens or for the machine's delays, at most.
_MOST_MISSED = 500


def _by_time(p: TopicEqualsOracle, published: NumericStream, wanted: _Wanted) -> _Compared:
    """Compare each message with the values about its time, of which the one that fits best counts."""
    order = np.argsort(wanted.times_ns, kind="stable")
    times, values = wanted.times_ns[order], wanted.values[order]
    tried: list[tuple[Floats, Floats]] = []
    for part in np.linspace(-1.0, 1.0, _TIMES):
        at_ns = published.source_ns + round(part * p.within_s * 1e9)
        right = _at(p, times, values, at_ns)
        tried.append((_excess(p, published.values, right), right))
    best = np.argmin([excess for excess, _ in tried], axis=0)
    rows = np.arange(len(best))
    right = np.array([right for _, right in tried])[best, rows]
    excess = np.array([excess for excess, _ in tried])[best, rows]
    known = _asked(right)  # Where the oracle says nothing, nothing is compared.
    return _Compared(published.only(known), excess[known], right[known], int(known.sum()), 0)


#: Times about that of a message at which it is compared; an odd number has its own among them.
_TIMES = 17


def _at(p: TopicEqualsOracle, times: Integers, values: Floats, at_ns: Integers) -> Floats:
    """Return the right values at some times; not a number where the oracle has none there."""
    if p.match == "interpolated":
        return np.column_stack(
            [np.interp(at_ns, times, each, left=np.nan, right=np.nan) for each in values.T]
        )
    after = np.minimum(np.searchsorted(times, at_ns), len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(at_ns - times[before] <= times[after] - at_ns, before, after)
    near = np.abs(at_ns - times[nearest]) <= p.within_s * 1e9 / (_TIMES - 1) + 1
    right: Floats = np.where(near[:, None], values[nearest], np.nan)
    return right


def _excess(p: TopicEqualsOracle, values: Floats, right: Floats) -> Floats:
    """Return by how much each message is farther off than it may be; infinite where that is not known, or not asked."""
    asked, same = _asked(right), (values == right) | (np.isnan(values) & np.isnan(right))
    values, right = (np.where(same & ~np.isfinite(values), 0.0, each) for each in (values, right))
    size = np.linalg.norm(right, axis=1) if p.distance == "straight" else np.zeros(len(right))
    off: Floats = DISTANCES[p.distance](values, right) - p.tolerance - p.relative * size
    off[np.isnan(off) | ~asked] = np.inf
    return off
