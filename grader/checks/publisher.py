"""Checks of a publishing node: topic, rate, evenness and offered QoS."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from grader.checks.base import (
    CREDIT_LEVELS,
    MANY_DELAYS,
    Context,
    Part,
    apart,
    cpu_delay_doubt,
    failed,
    graded,
    of_parts,
    percent,
    quantise,
    ramp,
    unexplained,
    without_delay,
)
from grader.checks.endpoints import (
    OfEndpoint,
    QosWanted,
    claim_of,
    claimed_at,
    qos_as_wanted,
    student_endpoints,
)
from grader.evidence.cpu_delay import Calm, Delay, Span, calm_intervals, shares_around
from grader.evidence.schedule import kept_schedule
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
    costs = _publisher_costs(context, p, endpoints, found_type)
    source = claimed_at(claim_of(context, "publisher", p.topic))
    where = (*source, context.location(p.topic))
    return of_parts(expected, [Part(1.0, measured)], costs=costs, where=where)


def _was_cut_short(context: Context, topic: str) -> bool:
    """Return whether the recorder left out messages on a topic."""
    for gap in context.session.record.unrecorded:
        if gap.topic == topic:
            return True
    return False


def _publisher_costs(
    context: Context, p: TopicPublished, endpoints: Sequence[Endpoint], found_type: str
) -> list[tuple[float, str]]:
    """Return the cost of each wrong name, type and definition, with a sentence about it."""
    used = context.session.used(p.topic)
    nodes = [endpoint.node for endpoint in endpoints]
    costs = p.faults("topic", (p.topic, p.type), (used, found_type), nodes)
    wrong_definition = _wrong_definition(context, used, endpoints)
    if wrong_definition:
        costs.append((p.other_type_costs, wrong_definition))
    return costs + p.node_faults(nodes)


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
    reason = f"The publisher on {used} exists, but no message from it arrived.{_by_timer(_timers(context))}"
    measured = f"{found_type} on {used}, 0 messages"
    if not _ran_on(context, p.artifact):
        return unexplained(failed(expected, measured, reason, hint=_NO_TIMER_HINT))
    part = Part(p.silent_credit, measured, reason, hint=_NO_TIMER_HINT)
    costs = _publisher_costs(context, p, endpoints, found_type)
    silent = of_parts(expected, [part], costs=costs, where=(context.location(p.topic),))
    return unexplained(replace(silent, is_silent=True))


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


@dataclass(frozen=True)
class _Measurement:
    """Timing of a topic within the window of a check."""

    #: None if too few messages arrived.
    timing: Timing | None
    #: The window; None if the check has none, or if it never opened.
    span: Span | None
    #: Machine delay of the process within the window, in seconds.
    delay_s: float = 0.0
    #: Clause about the method of measurement; empty if by source timestamps.
    method: str = ""


class _Timed(Parameters):
    """Base of checks that measure times between the messages of a topic."""

    topic: ref.Topic
    process: ref.Process
    window: ref.Window | None = Field(
        None, description="Label of the observe step; else the whole session."
    )

    def measured(self, context: Context) -> _Measurement:
        """Measure the timing of the topic.

        Impossible source timestamps are replaced by times of arrival, and the recorder's delay is
        then added to the machine delay.
        """
        session = context.session
        span = session.window(self.window) if self.window else None
        timing = timing_of(session.stream(self.topic), span)
        if span is None:
            return _Measurement(timing, None)
        run = self.run(context)
        delay_s = session.machine_delay_s(run, span) if run is not None else 0.0
        recorder_delay_s = session.recorder_delay_s(span)
        delays = _delays_on_the_way(context, run)
        excused_s = 0.0 if delays else recorder_delay_s
        if timing is None or not timing.contradicted_by_arrival(excused_s, delays):
            return _Measurement(timing, span, delay_s)
        method = " by times of arrival, as the time stamps are not the times of publication"
        return _Measurement(timing.arrived, span, delay_s + recorder_delay_s, method)

    def run(self, context: Context) -> ProcessRun | None:
        """Return the process that publishes: by its name, or in another session by its call for the publisher."""
        run = context.session.process(self.process)
        claim = claim_of(context, "publisher", self.topic) if run is None else None
        return context.session.process(claim.process) if claim is not None else run

    def calm(
        self, context: Context, measurement: _Measurement, timing: Timing, harmless_s: float
    ) -> Calm | None:
        """Return the undisturbed intervals, if the machine delayed the process notably.

        None too if too few intervals remain, or if the method of measurement cannot tell them apart.
        """
        run = self.run(context)
        if run is None or run.disturbed is None:
            return None
        if measurement.method or timing.burst_error_hz is not None:
            return None
        notable = measurement.delay_s > _NOTABLE_DELAY * timing.written / timing.rate_hz
        if not notable:
            return None
        delays = context.session.delays(run)
        calm = calm_intervals(delays, timing.times_ns, timing.intervals_s, harmless_s)
        return calm if calm.is_enough else None


def _delays_on_the_way(context: Context, run: ProcessRun | None) -> list[tuple[Delay, ...]]:
    """Return the delays of each watched process between a publication and its recording."""
    processes = list(context.session.recorders)
    if run is not None:
        processes.insert(0, run)
    return [context.session.delays(each) for each in processes if each.disturbed is not None]


#: Delayed share of a span from which the delay is the reason of a doubt.
_NOTABLE_DELAY = 0.005


def _doubt(delay_s: float, length_s: float) -> str:
    """Say that the machine keeps a share from being decided, if it does."""
    if delay_s > _NOTABLE_DELAY * length_s:
        return cpu_delay_doubt(delay_s, length_s)
    return ""


class TopicRate(_Timed):
    """A topic is published at a rate; credit falls in even steps between two deviations."""

    rate_hz: float = Field(gt=0)
    full_within: Share = Field(
        description="Relative deviation up to which credit is full, e.g. 2%."
    )
    zero_beyond: Share = Field(description="Relative deviation from which there is none.")


@dataclass(frozen=True)
class _Rate:
    """Bounds of a publishing rate in Hz, as far as the recording and the machine delays tell."""

    least_hz: float
    most_hz: float
    #: Error of the measurement; the bounds include it.
    error_hz: float
    #: Clause about the method of measurement; empty if by source timestamps.
    method: str

    def nearest(self, rate_hz: float) -> float:
        """Return the rate within the bounds that is nearest to another one."""
        return min(max(rate_hz, self.least_hz), self.most_hz)

    def likely(self, rate_hz: float) -> float:
        """Return a measured rate, moved between the bounds without their error."""
        low_hz = self.least_hz + self.error_hz
        high_hz = self.most_hz - self.error_hz
        return min(max(rate_hz, low_hz), high_hz)

    def shares(self, p: TopicRate) -> tuple[float, float]:
        """Return the worst and the best share of credit that the rate can earn."""
        least_off = abs(self.least_hz / p.rate_hz - 1)
        most_off = abs(self.most_hz / p.rate_hz - 1)
        furthest_off = max(least_off, most_off)
        nearest_off = abs(self.nearest(p.rate_hz) / p.rate_hz - 1)
        worst = ramp(furthest_off, p.full_within, p.zero_beyond)
        best = ramp(nearest_off, p.full_within, p.zero_beyond)
        return worst, best


def topic_rate(context: Context, p: TopicRate) -> Finding:
    """Judge the rate by its bounds, from source timestamps and sequence numbers."""
    measurement = p.measured(context)
    timing = measurement.timing
    if timing is None:
        return _too_few_messages(context, p, measurement.span)
    length_s = _length_s(timing, measurement.span)
    measurement = replace(measurement, delay_s=min(measurement.delay_s, 0.5 * length_s))
    rate = _rate_between(context, p, measurement, timing)
    silence = _silence(context, p, measurement.span)
    longest_pause_s = max(_SILENT_S, _SILENT_INTERVALS * timing.median_s)
    if silence.length_s - measurement.delay_s > longest_pause_s:
        return _stopped(context, p, measurement.span, timing, rate, silence)
    timers = _timers(context)
    rate_hz = rate.likely(timing.rate_hz)
    worst, best = rate.shares(p)
    change = _change(context, p, measurement, timing)
    if change is not None and quantise(change.share(p)) <= quantise(worst) < 1:
        return _changed(context, p, change)
    return graded(
        worst,
        _expected_rate(p),
        _shown_rate(p, rate, rate_hz, timing, length_s),
        f"Messages come at {_compared(rate_hz, p)}.{_by_timer(timers)}",
        where=_rate_locations(context, p, measurement.span, timers),
        best=best,
        levels=CREDIT_LEVELS,
        doubt=_doubt(measurement.delay_s, length_s),
    )


def _length_s(timing: Timing, span: Span | None) -> float:
    """Return the length of a window in seconds, or of the whole publication if there is none."""
    return span.duration_s if span else timing.written / timing.rate_hz


def _around_hz(p: TopicRate, deviation: float) -> tuple[float, float]:
    """Return the two rates at a relative deviation from the wanted one."""
    return p.rate_hz * (1 - deviation), p.rate_hz * (1 + deviation)


def _expected_rate(p: TopicRate) -> str:
    full_low, full_high = _around_hz(p, p.full_within)
    zero_low, zero_high = _around_hz(p, p.zero_beyond)
    full = f"{full_low:g} to {full_high:g} Hz for full credit"
    return f"{full}; less the further off; none below {zero_low:g} or above {zero_high:g} Hz"


def _shown_rate(p: TopicRate, rate: _Rate, rate_hz: float, timing: Timing, length_s: float) -> str:
    shown_hz = apart(rate_hz, *_around_hz(p, p.full_within), places=2)
    counted = f"{timing.written} messages in {length_s:.1f} s"
    if len(timing.intervals_s):
        counted += f", the longest interval {timing.intervals_s.max():.2f} s"
    return f"{shown_hz} Hz ± {max(rate.error_hz, 0.01):.2f} Hz ({counted}){rate.method}"


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
    arrived = f"Only {count} messages arrived" if count else "No message arrived"
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
    rate: _Rate,
    silence: _Silence,
) -> Finding:
    """State that messages stop before the end of the window."""
    sent_s = silence.window_s - silence.length_s
    measured = (
        f"{timing.rate_hz:.2f} Hz for {sent_s:.1f} s, then nothing for {silence.length_s:.1f} s"
    )
    reason = f"Messages stop after {sent_s:.1f} s of the {silence.window_s:.1f} s. The program ran on without publishing."
    hint = "Publish for as long as the node runs; its output shows what ended or stopped it."
    _, best = rate.shares(p)
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
        nearest_off = min(abs(rate_hz / p.rate_hz - 1) for rate_hz in rates_hz)
        return ramp(nearest_off, p.full_within, p.zero_beyond)


#: Shortest part of a window with a rate of its own, in s.
_LASTING_S = 1.0


def _change(
    context: Context, p: TopicRate, measurement: _Measurement, timing: Timing
) -> _Change | None:
    """Divide a window where the count of messages departs most from an even one.

    None without two lasting parts of different usual intervals.
    """
    span = measurement.span
    is_even = not measurement.method and timing.burst_error_hz is None
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
    differs = abs(after.median_s / max(before.median_s, 1e-9) - 1) > p.full_within
    if not differs:
        return None
    most_hz = _most_hz(context, p, after, second)
    return _Change(before, after, second, first.duration_s, most_hz)


def _most_hz(context: Context, p: TopicRate, timing: Timing, span: Span) -> float:
    """Return the highest rate that a part of a window may have had on an idle machine, in Hz."""
    run = p.run(context)
    delay_s = context.session.machine_delay_s(run, span) if run is not None else 0.0
    late_s = _delay_before_s(context, run, span)
    _, most_hz = _bounds_hz(timing, span.duration_s, delay_s, late_s, p.rate_hz)
    return most_hz


def _turn_ns(timing: Timing) -> int:
    """Return the time at which the count of messages departs most from an even one."""
    times = timing.times_ns - timing.times_ns[0]
    numbers = timing.numbers - timing.numbers[0]
    departures = np.abs(numbers / max(1, numbers[-1]) - times / max(1, times[-1]))
    return int(timing.times_ns[int(np.argmax(departures))])


def _changed(context: Context, p: TopicRate, change: _Change) -> Finding:
    """Grade the rate with which a node goes on after a change."""
    before_hz = f"{change.before.rate_hz:.1f} Hz for {change.before_s:.1f} s"
    after_hz = f"{change.after.rate_hz:.1f} Hz"
    return graded(
        change.share(p),
        _expected_rate(p),
        f"{before_hz}, then {after_hz} for {change.span.duration_s:.1f} s",
        f"The rate changes: messages come at {before_hz}, then at {after_hz}.",
        hint="Publish at the same rate for as long as the node runs.",
        where=(context.location(p.topic, change.span),),
        levels=CREDIT_LEVELS,
    )


def _compared(rate_hz: float, p: TopicRate) -> str:
    """Say how much a rate differs from the wanted one."""
    times = rate_hz / p.rate_hz
    if times < 2:
        off = apart(100 * abs(times - 1), 0, 100 * p.full_within, places=1)
        direction = "slower" if times < 1 else "faster"
        than = f"{off}% {direction} than"
    else:
        than = f"{times:.3g} times"
    return f"{apart(rate_hz, p.rate_hz, places=1)} Hz, {than} {p.rate_hz:g} Hz"


def _rate_between(
    context: Context, p: TopicRate, measurement: _Measurement, timing: Timing
) -> _Rate:
    """Return the bounds of the rate, narrowed by undisturbed intervals if there are enough."""
    length_s = _length_s(timing, measurement.span)
    run = p.run(context)
    before_s = _delay_before_s(context, run, measurement.span)
    bounds_hz = _bounds_hz(timing, length_s, measurement.delay_s, before_s, p.rate_hz)
    ends_error_hz = 2 * timing.deviation_s() * timing.rate_hz / max(length_s, 1e-9)
    error_hz = timing.burst_error_hz or ends_error_hz
    bounds_hz = (bounds_hz[0] - error_hz, bounds_hz[1] + error_hz)
    harmless_s = _HARMLESS * timing.median_s
    calm = p.calm(context, measurement, timing, harmless_s)
    if calm is None or run is None:
        return _Rate(*bounds_hz, error_hz, measurement.method)
    # The undisturbed intervals alone.
    least_hz, most_hz = _within(calm.rate_hz(), bounds_hz)
    delays = [delay for delay in context.session.delays(run) if delay.delay_ns > harmless_s * 1e9]
    schedule = kept_schedule(calm, delays, timing)
    if schedule is not None:
        least_hz, most_hz = _within(schedule.bounds_hz(), (least_hz, most_hz))
    return _Rate(least_hz, most_hz, (most_hz - least_hz) / 2, calm.said)


def _delay_before_s(context: Context, run: ProcessRun | None, span: Span | None) -> float:
    """Return the machine delay of a process between its start and a window, in seconds."""
    if run is None or span is None:
        return 0.0
    before = Span(min(run.started_ns, span.start_ns), span.start_ns)
    return context.session.machine_delay_s(run, before)


#: Share of an interval up to which a delay does not change the number of intervals.
_HARMLESS = 0.2


def _within(bounds: tuple[float, float], others: tuple[float, float]) -> tuple[float, float]:
    """Return bounds, cut to others that hold for every delay of the machine."""
    least = min(max(bounds[0], others[0]), others[1])
    most = min(max(bounds[1], others[0]), others[1])
    return least, most


def _by_timer(timers: Sequence[Claim]) -> str:
    """State the period of the node's only timer, if its source gives a number."""
    if len(timers) != 1 or not _NUMBER.fullmatch(timers[0].name):
        return ""
    return f" The timer's period is {float(timers[0].name):g} s."


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


def _bounds_hz(
    timing: Timing, length_s: float, delay_s: float, before_s: float, wanted_hz: float
) -> tuple[float, float]:
    """Return the lowest and the highest rate that the node may have had on an idle machine.

    Neither bound goes beyond the wanted rate. The node lost at most the time that it waited for a
    core, and may have sent messages late that were due before the window. A few delays do not
    change the median interval; many can lengthen half of the intervals.
    """
    usual_hz = 1 / timing.median_s if timing.median_s > 0 else timing.rate_hz
    least_hz = max(timing.rate_hz * length_s / (length_s + before_s), usual_hz, wanted_hz)
    longer_s = 0.0
    if delay_s > MANY_DELAYS * length_s:
        longer_s = 2 * delay_s / max(len(timing.intervals_s), 1)
    undelayed_hz = float("inf")
    if timing.median_s > longer_s:
        undelayed_hz = 1 / (timing.median_s - longer_s)
    unheld_hz = without_delay(timing.rate_hz, delay_s, length_s)
    most_hz = min(unheld_hz, undelayed_hz, wanted_hz)
    return min(timing.rate_hz, least_hz), max(timing.rate_hz, most_hz)


def _timers(context: Context) -> list[Claim]:
    """Return the timers that the student's nodes made, by the tap."""
    claims = context.session.record.claims
    return [claim for claim in claims if claim.kind == "timer" and claimed_at(claim)]


#: Credit levels of evenness: a quantile has an error, so credit comes in halves.
_JITTER_LEVELS = 2


class TopicJitter(_Timed):
    """Messages are evenly spaced: a quantile of the intervals' distances from their median."""

    full_within_s: float = Field(gt=0)
    zero_beyond_s: float = Field(gt=0)
    share: Share = Field(0.95, description="The quantile.")


@dataclass(frozen=True)
class _Jitter:
    """Bounds of a quantile of the intervals' distances from their median, in seconds."""

    least_s: float
    largest_s: float
    #: Clause about the method of measurement; empty if by source timestamps.
    method: str


def topic_jitter(context: Context, p: TopicJitter) -> Finding:
    """Judge the evenness of intervals between consecutive samples."""
    measurement = p.measured(context)
    span = measurement.span
    timing = measurement.timing
    expected = _expected_jitter(p)
    where = (context.location(p.topic, span),)
    if timing is None or not len(timing.intervals_s):
        reason = "Too few messages arrived to measure the gaps between them."
        return unexplained(failed(expected, "too few messages", reason, where=where))
    jitter = _jitter_between(context, p, measurement, timing)
    deviation_s = min(max(timing.deviation_s(p.share), jitter.least_s), jitter.largest_s)
    limits_ms = (p.full_within_s * 1e3, p.zero_beyond_s * 1e3)
    off_ms = apart(deviation_s * 1e3, *limits_ms, places=1)
    off = f"{off_ms} ms off the usual {timing.median_s * 1e3:.1f} ms"
    length_s = span.duration_s if span else float(timing.intervals_s.sum())
    return graded(
        ramp(jitter.largest_s, p.full_within_s, p.zero_beyond_s),
        expected,
        _shown_jitter(p, timing, apart(deviation_s * 1e3, *limits_ms, places=2)) + jitter.method,
        f"One gap in {round(1 / (1 - p.share))} is more than {off}.",
        where=where,
        best=ramp(jitter.least_s, p.full_within_s, p.zero_beyond_s),
        levels=_JITTER_LEVELS,
        doubt=_doubt(measurement.delay_s, length_s),
    )


def _expected_jitter(p: TopicJitter) -> str:
    half_within_s = (p.full_within_s + p.zero_beyond_s) / _JITTER_LEVELS
    full = f"{percent(p.share)} of the gaps between messages within {p.full_within_s * 1e3:g} ms of the usual gap"
    return f"{full}; half credit within {half_within_s * 1e3:g} ms"


def _shown_jitter(p: TopicJitter, timing: Timing, shown_ms: str) -> str:
    longest_ms = timing.intervals_s.max() * 1e3
    median_ms = timing.median_s * 1e3
    return f"{percent(p.share)} within {shown_ms} ms of {median_ms:.2f} ms (longest {longest_ms:.1f} ms)"


def _jitter_between(
    context: Context, p: TopicJitter, measurement: _Measurement, timing: Timing
) -> _Jitter:
    """Return the bounds of the quantile, narrowed by undisturbed intervals if there are enough."""
    least, largest = shares_around(p.share, len(timing.intervals_s))
    least_s = timing.deviation_s(least, measurement.delay_s)
    largest_s = timing.deviation_s(largest)
    calm = p.calm(context, measurement, timing, p.full_within_s / 2)
    if calm is None:
        return _Jitter(least_s, largest_s, measurement.method)
    least_s, largest_s = _within(calm.deviations_s(p.share), (least_s, largest_s))
    return _Jitter(least_s, largest_s, calm.said)


class OfferedQos(QosWanted):
    """A publisher offers a QoS profile. History and depth come from the source and only advise."""


def offered_qos(context: Context, p: OfferedQos) -> Finding:
    """Judge reliability and durability from discovery; history and depth only advise."""
    return qos_as_wanted(context, p, "publisher", "offers")
