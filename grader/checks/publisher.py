"""Checks of a publishing node: topic, rate, evenness and offered QoS."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    Part,
    apart,
    failed,
    graded,
    of_parts,
    percent,
    quantise,
    ramp,
    unexplained,
)
from grader.checks.endpoints import (
    OfEndpoint,
    QosWanted,
    claim_of,
    claimed_at,
    qos_as_wanted,
    student_endpoints,
)
from grader.evidence import bounds
from grader.evidence.bounds import Interval, Measured, Publication
from grader.evidence.cpu_delay import Span
from grader.evidence.timing import Timing, timing_of
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.lab.steps.observe import ObserveStep
from grader.recording.session import Claim, Endpoint, ProcessRun
from grader.result import Finding, Location

_NUMBER = re.compile(r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")


class TopicPublished(OfEndpoint):
    """A node publishes a type on a topic. Name, type and node name count in parts."""

    artifact: ref.Artifact
    topic: ref.RosName
    type: ref.MessageType
    silent_credit: Share = Field(
        0.0,
        description="Credit of a publisher in the graph that sends nothing, while its program runs.",
    )

    def sought(self) -> Sequence[ref.Sought]:
        """Return the publisher."""
        return (ref.Sought("publisher", self.topic, self.type),)


def topic_published(context: Context, p: TopicPublished) -> Finding:
    """Judge whether the artifact's node publishes on the topic, under the right names."""
    expected = f"messages of type {p.type} on {p.topic}"
    if p.node:
        expected += f", from node {p.node}"
    endpoints = student_endpoints(context, p.topic, "publisher")
    stream = context.session.stream(p.topic)
    count = stream.recorded
    if not endpoints and not count:
        fallback = f"Nothing was published on {p.topic}, nor on a topic of a similar name, within the time allowed."
        return unexplained(failed(expected, "no publisher in the graph", fallback))
    used = context.session.used(p.topic)
    types = [endpoint.type for endpoint in endpoints]
    if count:
        types.append(stream.topic_type)
    # One right type does not make up for a wrong one.
    found_type = _first_other(types, p.type)
    if not count:
        return _never_sent(context, p, expected, endpoints)
    measured = f"{count} messages of type {found_type} on {used}"
    if _was_cut_short(context, used):
        measured = f"at least {measured}"
    if endpoints:
        measured += f", from {endpoints[0].node}"
    part = _endpoint_part(measured, _endpoint_costs(context, p, endpoints, found_type))
    part = context.charge_part(part, endpoint_cause(p.topic))
    costs = p.node_faults([endpoint.node for endpoint in endpoints])
    where = (
        *claimed_at(claim_of(context, "publisher", p.topic)),
        context.location(p.topic),
    )
    return of_parts(expected, [part], costs=costs, where=where)


def _was_cut_short(context: Context, topic: str) -> bool:
    """Return whether the recorder left out messages on a topic."""
    for gap in context.session.record.unrecorded:
        if gap.topic == topic:
            return True
    return False


def _endpoint_part(measured: str, costs: Sequence[tuple[float, str]]) -> Part:
    """Return the part of the right names, less the cost of each wrong one."""
    part = Part(1.0, measured)
    for cost, reason in costs:
        left = max(0.0, part.share - cost)
        part = replace(part, share=left, reason=f"{part.reason} {reason}".strip())
    return part


def endpoint_cause(topic: str) -> str:
    """Name the mistake of a topic with another name or type."""
    return f"endpoint {topic}"


def _endpoint_costs(
    context: Context, p: TopicPublished, endpoints: Sequence[Endpoint], found_type: str
) -> list[tuple[float, str]]:
    """Return the cost of a wrong topic, type and definition, with a sentence about each."""
    used = context.session.used(p.topic)
    nodes = [endpoint.node for endpoint in endpoints]
    costs = p.faults("topic", (p.topic, p.type), (used, found_type), nodes)
    wrong_definition = _wrong_definition(context, used, endpoints)
    if wrong_definition:
        costs.append((p.other_type_costs, wrong_definition))
    return costs


def _first_other(types: Sequence[str], wanted: str) -> str:
    """Return the first type other than the wanted one, or the wanted one if there is no other."""
    for each in types:
        if each != wanted:
            return each
    return wanted


def _never_sent(
    context: Context, p: TopicPublished, expected: str, endpoints: Sequence[Endpoint]
) -> Finding:
    """State that a publisher exists and sent nothing.

    If its program ran on, the publisher was not in the graph by chance: it earns a part, and other checks can rely on it.
    """
    used = context.session.used(p.topic)
    found_type = _first_other([endpoint.type for endpoint in endpoints], p.type)
    reason = f"The publisher on {used} exists, but no message from it was recorded.{_by_timer(_timers(context))}"
    measured = f"{found_type} on {used}, no message recorded"
    if not _ran_on(context, p.artifact):
        return unexplained(failed(expected, measured, reason, hint=_NO_TIMER_HINT))
    hint = _silent_hint(context, p.artifact)
    part = Part(p.silent_credit, measured, reason, hint=hint)
    costs = _endpoint_costs(context, p, endpoints, found_type)
    costs += p.node_faults([endpoint.node for endpoint in endpoints])
    silent = of_parts(expected, [part], costs=costs, where=(context.location(p.topic),))
    return unexplained(replace(silent, is_silent=True))


def _silent_hint(context: Context, artifact: str) -> str:
    """Say how to mend a program that ran on and sent nothing; its only timer may have had no time to fire."""
    period_s = _only_period_s(_timers(context))
    if period_s is None:
        return _NO_TIMER_HINT
    for run in context.session.processes_of(artifact):
        if run.interrupted_ns is None:
            continue
        lasted_s = (run.interrupted_ns - run.started_ns) / 1e9
        if period_s >= lasted_s:
            return _SECONDS_HINT
    return _NO_TIMER_HINT


def _ran_on(context: Context, artifact: str) -> bool:
    """Tell whether the last process of an artifact ran until it was interrupted."""
    runs = context.session.processes_of(artifact)
    return bool(runs) and runs[-1].interrupted_ns is not None


def _wrong_definition(context: Context, topic: str, endpoints: Sequence[Endpoint]) -> str:
    """Say that a publisher announces another definition of its type than the installed one.

    The hashes of both are compared. Empty if they are equal or unknown.
    """
    installed = {}
    for info in context.session.bag.topics:
        if info.topic == topic and info.type_hash:
            installed[info.topic_type] = info.type_hash
    for endpoint in endpoints:
        announced = endpoint.type_hash
        known = installed.get(endpoint.type)
        if known is None or not announced.startswith("RIHS01_"):
            continue
        if announced != known:
            short = announced[:15]
            right = known[:15]
            return f"{endpoint.type} is announced with another definition ({short}...) than it has ({right}...)."
    return ""


_NO_TIMER_HINT = (
    "Call publish() from a timer that the node creates, and spin the node. With use_sim_time, which belongs into the "
    "launch file, timers wait for /clock, which nobody sends here."
)
_SECONDS_HINT = (
    "Give create_timer() its period in seconds, as a number below 1 for several messages a second: the timer first fires "
    "after one period, and the program was stopped before."
)


class _Timed(Parameters):
    """Base of checks that measure times between the messages of a topic."""

    topic: ref.Topic
    process: ref.Process
    window: ref.Window | None = Field(
        None, description="Label of the observe step; else the whole session."
    )

    def span(self, context: Context) -> Span | None:
        """Return the window of the check; None if it has none, or if it never opened."""
        return context.session.window(self.window) if self.window else None

    def publication(self, context: Context, span: Span | None) -> Publication | None:
        """Measure the timing of the topic, and the delays of its publisher; None with too few messages."""
        return bounds.publication_of(context.session, self.topic, self.run(context), span)

    def run(self, context: Context) -> ProcessRun | None:
        """Return the process that publishes: by its name, or in another session by its call for the publisher."""
        run = context.session.process(self.process)
        claim = claim_of(context, "publisher", self.topic) if run is None else None
        return context.session.process(claim.process) if claim is not None else run


class TopicRate(_Timed):
    """A topic is published at a rate; credit falls in even steps between two deviations."""

    rate_hz: float = Field(gt=0)
    full_within: Share = Field(
        description="Relative deviation up to which credit is full, e.g. 2%."
    )
    zero_beyond: Share = Field(description="Relative deviation from which there is none.")
    at_least: bool = Field(False, description="Whether a higher rate costs nothing.")

    def counted_hz(self, rate_hz: float) -> float:
        """Return the rate that counts: at most the wanted one if a higher rate costs nothing."""
        return min(rate_hz, self.rate_hz) if self.at_least else rate_hz


def _rate_shares(p: TopicRate, rate: Interval) -> Interval:
    """Return the worst and the best share of credit that a rate can earn."""
    counted = Interval(p.counted_hz(rate.low), p.counted_hz(rate.high), rate.why)
    return counted.off(p.rate_hz).credit(lambda off: ramp(off, p.full_within, p.zero_beyond))


def topic_rate(context: Context, p: TopicRate) -> Finding:
    """Judge the rate by its bounds, from source timestamps and sequence numbers."""
    span = p.span(context)
    published = p.publication(context, span)
    if published is None:
        return _too_few_messages(context, p, span)
    published = published.with_bounded_delay()
    timing = published.timing
    rate = bounds.rate(published, p.rate_hz)
    silence = _silence(context, p, span)
    longest_pause_s = max(_SILENT_S, _SILENT_INTERVALS * timing.median_s)
    if silence.length_s - published.delay_s > longest_pause_s:
        return _stopped(context, p, span, timing, rate, silence)
    timers = _timers(context)
    rate_hz = rate.likely(timing.rate_hz)
    shares = _rate_shares(p, rate)
    change = _change(context, p, published, p.rate_hz)
    if change is not None and quantise(change.share(p)) <= quantise(shares.low) < 1:
        return _changed(context, p, change)
    return graded(
        shares.low,
        _expected_rate(p),
        _shown_rate(p, rate, rate_hz, timing, published.length_s),
        f"Messages come at {_compared(rate_hz, p)}.{_by_timer(timers)}",
        where=_rate_locations(context, p, span, timers),
        best=shares.high,
        levels=CREDIT_LEVELS,
        doubt=shares.why,
        hint=_pacing_hint(context, p, timers),
    )


_SHORT_CALLBACK_HINT = "Keep the callback of the timer short: no sleep, no waiting, little output."
_SLEEP = re.compile(r"\bsleep\s*\(")


def _pacing_hint(context: Context, p: TopicRate, timers: Sequence[Claim]) -> str:
    """Say how to mend the rate, by the timer or the sleep in the program; empty if it shows neither.

    Example
    -------
    "Give the timer a period of 0.01 s."
    """
    if not timers:
        run = p.run(context)
        path = None
        if run is not None:
            path = context.path_of(run.artifact or "")
        if _SLEEP.search(context.submission.texts.get(path or "", "")):
            return "Publish from a timer: a loop with a sleep adds the time of its work to each period."
        return ""
    period_s = _only_period_s(timers)
    if period_s is None:
        return ""
    wanted_s = 1 / p.rate_hz
    if abs(period_s / wanted_s - 1) > p.full_within:
        return f"Give the timer a period of {wanted_s:g} s."
    return _SHORT_CALLBACK_HINT


def _around_hz(p: TopicRate, deviation: float) -> tuple[float, float]:
    """Return the two rates at a relative deviation from the wanted one."""
    return p.rate_hz * (1 - deviation), p.rate_hz * (1 + deviation)


def _expected_rate(p: TopicRate) -> str:
    full_low, full_high = _around_hz(p, p.full_within)
    zero_low, zero_high = _around_hz(p, p.zero_beyond)
    if p.at_least:
        return (
            f"at least {full_low:g} Hz for full credit; less if slower; none below {zero_low:g} Hz"
        )
    full = f"{full_low:g} to {full_high:g} Hz for full credit"
    return f"{full}; less the further off; none below {zero_low:g} or above {zero_high:g} Hz"


def _shown_rate(
    p: TopicRate, rate: Measured, rate_hz: float, timing: Timing, length_s: float
) -> str:
    shown_hz = apart(rate_hz, *_around_hz(p, p.full_within), places=2)
    counted = f"{timing.written} messages in {length_s:.1f} s"
    if rate.method:
        counted = f"in all, {counted}"
    if len(timing.intervals_s):
        counted += f", the longest interval {timing.intervals_s.max():.2f} s"
    return f"{shown_hz} Hz ± {max(rate.error, 0.01):.2f} Hz{rate.method} ({counted})"


def _rate_locations(
    context: Context, p: TopicRate, span: Span | None, timers: Sequence[Claim]
) -> tuple[Location, ...]:
    """Point at the only timer of the node, if there is one, and at the topic."""
    location = context.location(p.topic, span)
    if len(timers) == 1:
        return (*claimed_at(timers[0]), location)
    return (location,)


def _too_few_messages(context: Context, p: TopicRate, span: Span | None) -> Finding:
    """State that too few messages arrived to measure a rate."""
    times_ns = context.session.stream(p.topic).source_ns
    count = len(times_ns)
    if span:
        inside = (times_ns >= span.start_ns) & (times_ns <= span.end_ns)
        count = int(inside.sum())
    arrived = f"Only {count} messages were recorded" if count else "No message was recorded"
    reason = f"{arrived}, too few to measure a rate."
    where = _rate_locations(context, p, span, _timers(context))
    return unexplained(failed(_expected_rate(p), f"{count} messages", reason, where=where))


@dataclass(frozen=True)
class _Silence:
    """Silence at the end of a window."""

    length_s: float
    #: Intended length of the window.
    window_s: float


def _stopped(
    context: Context,
    p: TopicRate,
    span: Span | None,
    timing: Timing,
    rate: Interval,
    silence: _Silence,
) -> Finding:
    """State that messages stop before the end of the window."""
    sent_s = silence.window_s - silence.length_s
    measured = (
        f"{timing.rate_hz:.2f} Hz for {sent_s:.1f} s, then nothing for {silence.length_s:.1f} s"
    )
    reason = f"Messages stop after {sent_s:.1f} s of the {silence.window_s:.1f} s. The program ran on without publishing."
    hint = "Publish for as long as the node runs; its output shows what ended or stopped it."
    best = _rate_shares(p, rate).high
    silent_share = silence.length_s / silence.window_s
    share = quantise(min(best, ramp(silent_share, p.full_within, p.zero_beyond)))
    where = (context.location(p.topic, span),)
    return unexplained(graded(share, _expected_rate(p), measured, reason, hint=hint, where=where))


@dataclass(frozen=True)
class _Change:
    """A window divided where its rate changes most."""

    before: Timing
    after: Timing
    #: The second part of the window.
    span: Span
    #: Length of the first part, in s.
    before_s: float
    #: Highest rate in the second part without the delays of the machine, in Hz.
    most_hz: float

    def share(self, p: TopicRate) -> float:
        """Return the best share of credit that the second part can earn, by its rate or by its usual interval.

        A single gap leaves the usual interval as it is, and the rate of the whole window tells of it.
        """
        rates_hz = (self.after.rate_hz, self.most_hz, 1 / max(self.after.median_s, 1e-9))
        nearest_off = min(abs(p.counted_hz(rate_hz) / p.rate_hz - 1) for rate_hz in rates_hz)
        return ramp(nearest_off, p.full_within, p.zero_beyond)


#: Shortest part of a window with a rate of its own, in s.
_LASTING_S = 1.0
#: Relative difference of usual intervals from which a rate has changed.
_OTHER_RATE = 0.02


def _change(
    context: Context, p: _Timed, published: Publication, wanted_hz: float
) -> _Change | None:
    """Divide a window where the count of messages departs most from an even one.

    None without two lasting parts of different usual intervals, and none if the delays of the machine explain the
    difference of their rates.
    """
    timing = published.timing
    span = published.span
    is_even = not published.method and timing.burst_error_hz is None
    if span is None or not is_even or not len(timing.times_ns):
        return None
    turn_ns = _turn_ns(timing)
    first = Span(span.start_ns, turn_ns)
    second = Span(turn_ns, span.end_ns)
    if min(first.duration_s, second.duration_s) < _LASTING_S:
        return None
    stream = context.session.stream(p.topic)
    before = timing_of(stream, first)
    after = timing_of(stream, second)
    if before is None or after is None:
        return None
    differs = abs(after.median_s / max(before.median_s, 1e-9) - 1) > _OTHER_RATE
    if not differs:
        return None
    rate_before = bounds.undelayed_rate(published.part(first, before), wanted_hz)
    rate_after = bounds.undelayed_rate(published.part(second, after), wanted_hz)
    if rate_before.meets(rate_after):
        return None
    return _Change(before, after, second, first.duration_s, rate_after.high)


def _turn_ns(timing: Timing) -> int:
    """Return the time at which the count of messages departs most from an even one."""
    times = timing.times_ns - timing.times_ns[0]
    numbers = timing.numbers - timing.numbers[0]
    departures = np.abs(numbers / max(1, numbers[-1]) - times / max(1, times[-1]))
    return int(timing.times_ns[int(np.argmax(departures))])


def _changed(context: Context, p: TopicRate, change: _Change) -> Finding:
    """Grade the rate with which a node goes on after a change, and point at the timers that may set it."""
    before_hz = f"{change.before.rate_hz:.1f} Hz for {change.before_s:.1f} s"
    after_hz = f"{change.after.rate_hz:.1f} Hz"
    places: list[Location] = []
    for timer in _timers(context):
        places += claimed_at(timer)
    changed = graded(
        change.share(p),
        _expected_rate(p),
        f"{before_hz}, then {after_hz} for {change.span.duration_s:.1f} s",
        f"The rate changes: messages come at {before_hz}, then at {after_hz}.",
        hint="Publish at the same rate for as long as the node runs: make one timer, and keep its period.",
        where=(*dict.fromkeys(places), context.location(p.topic, change.span)),
        levels=CREDIT_LEVELS,
    )
    return context.charge(changed, _changed_rate_of(p))


def _changed_rate_of(p: _Timed) -> str:
    """Name the mistake of a rate that changes, by its topic; it makes the intervals uneven too."""
    return f"changed rate of {p.topic}"


def _compared(rate_hz: float, p: TopicRate) -> str:
    """Say how much a rate differs from the wanted one."""
    times = rate_hz / p.rate_hz
    rate = apart(rate_hz, p.rate_hz, places=1)
    wanted = f"{p.rate_hz:g}"
    if times >= 2:
        return f"{rate} Hz, {times:.3g} times {wanted} Hz"
    off_percent = 100 * abs(times - 1)
    full_percent = 100 * p.full_within
    off = apart(off_percent, 0, full_percent, places=1)
    if times < 1:
        return f"{rate} Hz, {off}% slower than {wanted} Hz"
    return f"{rate} Hz, {off}% faster than {wanted} Hz"


def _by_timer(timers: Sequence[Claim]) -> str:
    """State the period of the node's only timer, if its source gives a number."""
    period_s = _only_period_s(timers)
    if period_s is None:
        return ""
    return f" The timer's period is {period_s:g} s."


def _only_period_s(timers: Sequence[Claim]) -> float | None:
    """Return the period of the node's only timer in seconds; None for several, or for no number."""
    if len(timers) != 1:
        return None
    if not _NUMBER.fullmatch(timers[0].name):
        return None
    return float(timers[0].name)


#: Shortest silence after which a topic has ended, in seconds and in intervals of the topic.
_SILENT_S, _SILENT_INTERVALS = 0.5, 10


def _silence(context: Context, p: TopicRate, span: Span | None) -> _Silence:
    """Measure the silence at the end of a check's window."""
    stream = context.session.stream(p.topic)
    source_ns = stream.source_ns
    if span is not None:
        before = source_ns <= span.end_ns
        after = source_ns > span.end_ns
        last_ns = int(source_ns[before].max())
        missed = 0
        if after.any():
            missed = int(stream.sequence[after].min() - stream.sequence[before].max())
        # Only the next message tells of messages that the recorder lost.
        length_s = (span.end_ns - last_ns) / 1e9 if missed <= 1 else 0.0
        return _Silence(length_s, span.duration_s)
    step = context.session.step(p.window) if p.window else None
    if step is None or step.outcome != "cancelled":
        return _Silence(0.0, 1.0)
    # The program ended within the window, which opens with the first message.
    window_s = ObserveStep.given(step).duration_s
    first_ns = max(int(source_ns.min()), step.started_ns)
    lasted_s = (int(source_ns.max()) - first_ns) / 1e9
    return _Silence(max(0.0, window_s - lasted_s), window_s)


def _timers(context: Context) -> list[Claim]:
    """Return the timers that the student's nodes made, by the tap."""
    timers = []
    for claim in context.session.record.claims:
        if claim.kind == "timer" and claimed_at(claim):
            timers.append(claim)
    return timers


#: Credit levels of evenness: a quantile has an error, so credit comes in halves.
_JITTER_LEVELS = 2


class TopicJitter(_Timed):
    """Messages are evenly spaced: a quantile of the intervals' distances from their median."""

    full_within_s: float = Field(gt=0)
    zero_beyond_s: float = Field(gt=0)
    share: Share = Field(0.95, description="The quantile.")


def topic_jitter(context: Context, p: TopicJitter) -> Finding:
    """Judge the evenness of intervals between consecutive samples; a change of the rate is a mistake of its own."""
    span = p.span(context)
    published = p.publication(context, span)
    where = (context.location(p.topic, span),)
    if published is None or not len(published.timing.intervals_s):
        reason = "Too few messages arrived to measure the gaps between them."
        return unexplained(failed(_expected_jitter(p), "too few messages", reason, where=where))
    uneven = _unevenness(context, p, published)
    if not uneven.outcome.took_points:
        return uneven
    change = _change(context, p, published, published.timing.rate_hz)
    if change is None:
        return uneven
    return _uneven_by_change(context, p, uneven, change)


def _unevenness(context: Context, p: TopicJitter, published: Publication) -> Finding:
    """Grade the quantile of the intervals' distances from their median."""
    timing = published.timing
    jitter = bounds.gaps(published, p.share, p.full_within_s / 2)
    deviation_s = jitter.nearest(timing.deviation_s(p.share))
    limits_ms = (p.full_within_s * 1e3, p.zero_beyond_s * 1e3)
    off_ms = apart(deviation_s * 1e3, *limits_ms, places=1)
    off = f"{off_ms} ms off the usual {timing.median_s * 1e3:.1f} ms"
    shares = jitter.credit(lambda off_s: ramp(off_s, p.full_within_s, p.zero_beyond_s))
    return graded(
        shares.low,
        _expected_jitter(p),
        _shown_jitter(p, timing, apart(deviation_s * 1e3, *limits_ms, places=2)) + jitter.method,
        f"One gap in {round(1 / (1 - p.share))} is more than {off}.",
        where=(context.location(p.topic, p.span(context)),),
        best=shares.high,
        levels=_JITTER_LEVELS,
        doubt=shares.why,
        hint=_SHORT_CALLBACK_HINT if _timers(context) else "",
    )


def _uneven_by_change(context: Context, p: TopicJitter, found: Finding, change: _Change) -> Finding:
    """State that a change of the rate makes the intervals uneven: no gap is usual over the whole window."""
    before = f"{change.before.median_s * 1e3:.1f} ms"
    after = f"{change.after.median_s * 1e3:.1f} ms"
    measured = f"usual gaps of {before}, then of {after}"
    reason = (
        f"The usual gap changes from {before} to {after}, so no gap is usual over the whole time."
    )
    hint = "Keep one rate; the gaps are even then."
    changed = replace(found, measured=measured, reason=reason, hint=hint)
    return context.charge(changed, _changed_rate_of(p))


def _expected_jitter(p: TopicJitter) -> str:
    half_within_s = (p.full_within_s + p.zero_beyond_s) / _JITTER_LEVELS
    full = f"{percent(p.share)} of the gaps between messages within {p.full_within_s * 1e3:g} ms of the usual gap"
    return f"{full}; half credit within {half_within_s * 1e3:g} ms"


def _shown_jitter(p: TopicJitter, timing: Timing, shown_ms: str) -> str:
    longest_ms = timing.intervals_s.max() * 1e3
    median_ms = timing.median_s * 1e3
    return f"{percent(p.share)} within {shown_ms} ms of {median_ms:.2f} ms (longest {longest_ms:.1f} ms)"


class OfferedQos(QosWanted):
    """A publisher offers a QoS profile. History and depth come from the source and only advise."""

    type: ref.MessageType | None = Field(
        None,
        description="Type of the topic; with it, another type or topic costs all, because nothing connects.",
    )

    @property
    def other_domain_costs(self) -> float:
        """The cost of another topic."""
        return float(self.type is not None)


def offered_qos(context: Context, p: OfferedQos) -> Finding:
    """Judge reliability and durability from discovery; history and depth only advise."""
    finding = qos_as_wanted(context, p, "publisher", "offers")
    reason = _unconnected(context, p)
    if not reason:
        return finding
    cause = endpoint_cause(p.topic)
    if context.charged_under(cause):
        return finding
    hint = f"Publish {p.type} on {p.topic}: only then do the lab's subscriptions connect."
    stray = failed(finding.expected, finding.measured, reason, hint=hint, where=finding.where)
    return context.charge(stray, cause)


def _unconnected(context: Context, p: OfferedQos) -> str:
    """Say why no program of the lab connects with the publisher, whatever its QoS; empty if one can."""
    if p.type is None:
        return ""
    used = context.session.used(p.topic)
    if used != p.topic:
        return f"It publishes on {used}, to which no program of the lab subscribes."
    for endpoint in student_endpoints(context, p.topic, "publisher"):
        if endpoint.type != p.type:
            return f"Its type is {endpoint.type}, which no subscription of the lab takes."
    return ""
