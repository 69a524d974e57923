"""Checks of what a node publishes: topic, rate, evenness, values, motion, QoS offered."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

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
    not_reached,
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
from grader.evidence.cpu_delay import Calm, Span, calm_intervals, shares_around
from grader.evidence.recorded import Floats, NumericStream
from grader.evidence.schedule import kept_schedule
from grader.evidence.sinusoid import Sinusoid, fit_sinusoid
from grader.evidence.timing import Timing, timing_of
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.recording.session import Claim, Endpoint
from grader.result import Finding, Outcome

_NUMBER = re.compile(r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")


class TopicPublished(OfEndpoint):
    """A node publishes a type on a topic. Name, type and node name count in parts."""

    artifact: ref.Artifact
    topic: ref.RosName
    type: ref.MessageType


def topic_published(context: Context, p: TopicPublished) -> Finding:
    """Judge whether the artifact's node publishes on the topic, under the right names."""
    expected = f"messages of type {p.type} on {p.topic}" + (
        f", from node {p.node}" if p.node else ""
    )
    endpoints = student_endpoints(context, p.topic, "publisher")
    stream = context.session.stream(p.topic)
    if not endpoints and not len(stream):
        fallback = f"Nothing was published on {p.topic}, nor on a topic of a similar name, within the time allowed."
        return unexplained(failed(expected, "no publisher in the graph", fallback))
    used = context.session.used(p.topic)
    types = [*(e.type for e in endpoints), *([stream.topic_type] if len(stream) else [])]
    found_type = next(
        (t for t in types if t != p.type), p.type
    )  # one that fits does not make up for another
    if not len(stream):
        reason = (
            f"The publisher on {used} exists, but sent no message.{_by_timer(_timers(context))}"
        )
        return unexplained(
            failed(expected, f"{found_type} on {used}, 0 messages", reason, hint=_NO_TIMER_HINT)
        )
    nodes = [e.node for e in endpoints]
    wrong = p.faults("topic", (p.topic, p.type), (used, found_type), nodes)
    wrong += [
        (p.other_type_costs, reason) for reason in _wrong_definition(context, used, endpoints)
    ]
    wrong += p.node_faults(nodes)
    measured = f"{len(stream)} messages of type {found_type} on {used}" + (
        f", from {nodes[0]}" if nodes else ""
    )
    where = (*claimed_at(claim_of(context, "publisher", p.topic)), context.location(p.topic))
    return of_parts(expected, [Part(1.0, measured)], costs=wrong, where=where)


def _wrong_definition(context: Context, topic: str, endpoints: Sequence[Endpoint]) -> list[str]:
    """Judge the definitions that publishers announce for their types, by the hashes of those that are installed."""
    hashes = {
        i.topic_type: i.type_hash
        for i in context.session.bag.topics
        if i.topic == topic and i.type_hash
    }
    for endpoint in endpoints:
        announced, known = endpoint.type_hash, hashes.get(endpoint.type)
        if announced.startswith("RIHS01_") and known is not None and announced != known:
            short, right = announced[:15], known[:15]
            return [
                f"{endpoint.type} is announced with another definition ({short}...) than it has ({right}...)."
            ]
    return []


_NO_TIMER_HINT = (
    "Call publish() from a timer that the node creates, and spin the node. With use_sim_time, which belongs into the "
    "launch file, timers wait for /clock, which nobody sends here."
)


class _Timed(Parameters):
    """Base of checks that measure times between the messages of a topic."""

    topic: ref.Topic
    process: ref.Process
    window: ref.Window | None = Field(
        None, description="Label of the observe step; else the whole session."
    )

    def measured(self, context: Context) -> tuple[Timing | None, Span | None, float, str]:
        """Return timing, window, the machine's delay in it in s, and a clause.

        Where stamps cannot be true, the timing is that of arrival, as the clause says, with the recorder's delay too.
        """
        span, run = (
            context.session.window(self.window) if self.window else None,
            context.session.process(self.process),
        )
        timing = timing_of(context.session.stream(self.topic), span)
        if span is None:
            return timing, None, 0.0, ""
        delay_s = context.session.machine_delay_s(run, span) if run is not None else 0.0
        late_s = context.session.recorder_delay_s(span)
        way = list(context.session.recorders)
        if run is not None:
            way.insert(0, run)
        delays = [context.session.delays(r) for r in way if r.disturbed is not None]
        if timing is None or not timing.contradicted_by_arrival(0.0 if delays else late_s, delays):
            return timing, span, delay_s, ""
        by = " by times of arrival, as the time stamps are not the times of publication"
        return timing.arrived, span, delay_s + late_s, by

    def calm(
        self, context: Context, timing: Timing, by: str, delay_s: float, harmless_s: float
    ) -> Calm | None:
        """Return, where the machine delayed it notably, the gaps that this did not affect; None if too few."""
        run = context.session.process(self.process)
        notable = delay_s > _NOTABLE_DELAY * timing.written / timing.rate_hz
        if (
            run is None
            or run.disturbed is None
            or by
            or timing.burst_error_hz is not None
            or not notable
        ):
            return None
        calm = calm_intervals(
            context.session.delays(run), timing.times_ns, timing.intervals_s, harmless_s
        )
        return calm if calm.is_enough else None


#: Share of a span for which a process was delayed, from which that is the reason of a doubt.
_NOTABLE_DELAY = 0.005


def _doubt(delay_s: float, length_s: float) -> str:
    """Say that the machine keeps a share from being decided, if it does."""
    return cpu_delay_doubt(delay_s, length_s) if delay_s > _NOTABLE_DELAY * length_s else ""


class TopicRate(_Timed):
    """A topic is published at a rate; credit falls in even steps between two deviations."""

    rate_hz: float = Field(gt=0)
    full_within: Share = Field(
        description="Relative deviation up to which credit is full, e.g. 2%."
    )
    zero_beyond: Share = Field(description="Relative deviation from which there is none.")


def topic_rate(context: Context, p: TopicRate) -> Finding:
    """Judge the rate from source timestamps and sequence numbers, by the bounds between which it surely was."""
    timing, span, delay_s, by = p.measured(context)
    full, zero = (
        [f"{p.rate_hz * (1 + sign * share):g}" for sign in (-1, 1)]
        for share in (p.full_within, p.zero_beyond)
    )
    expected = f"{full[0]} to {full[1]} Hz for full credit; less the further off; none below {zero[0]} or above {zero[1]} Hz"
    timers, location = _timers(context), context.location(p.topic, span)
    where = (*(claimed_at(timers[0]) if len(timers) == 1 else ()), location)
    if timing is None:
        times_ns = context.session.stream(p.topic).source_ns
        count = (
            int(((times_ns >= span.start_ns) & (times_ns <= span.end_ns)).sum())
            if span
            else len(times_ns)
        )
        reason = f"Only {count} messages arrived, too few to measure a rate."
        return failed(expected, f"{count} messages", reason, where=where)
    length_s = span.duration_s if span else timing.written / timing.rate_hz
    delay_s = min(delay_s, 0.5 * length_s)
    bounds_hz, error_hz, by = _rate_between(context, p, timing, span, delay_s, by)
    rate_hz = min(max(timing.rate_hz, bounds_hz[0] + error_hz), bounds_hz[1] - error_hz)
    nearest_hz = min(max(p.rate_hz, bounds_hz[0]), bounds_hz[1])
    furthest_off, nearest_off = (
        max(abs(hz / p.rate_hz - 1) for hz in bounds_hz),
        abs(nearest_hz / p.rate_hz - 1),
    )
    worst, best = (ramp(off, p.full_within, p.zero_beyond) for off in (furthest_off, nearest_off))
    silent_s, of_s = _silence_s(context, p, span)
    if silent_s - delay_s > max(_SILENT_S, _SILENT_INTERVALS * timing.median_s):
        sent_s = of_s - silent_s
        measured = f"{timing.rate_hz:.2f} Hz for {sent_s:.1f} s, then nothing for {silent_s:.1f} s"
        reason = f"Messages stop after {sent_s:.1f} s of the {of_s:.1f} s. The program ran on without publishing."
        share = quantise(min(best, ramp(silent_s / of_s, p.full_within, p.zero_beyond)))
        hint = "Publish for as long as the node runs; its output shows what ended or stopped it."
        return unexplained(graded(share, expected, measured, reason, hint=hint, where=(location,)))
    shown_hz = apart(rate_hz, *(p.rate_hz * (1 + k * p.full_within) for k in (-1, 1)), places=2)
    longest = (
        f", the longest interval {timing.intervals_s.max():.2f} s"
        if len(timing.intervals_s)
        else ""
    )
    measured = f"{shown_hz} Hz ± {max(error_hz, 0.01):.2f} Hz ({timing.written} messages in {length_s:.1f} s{longest}){by}"
    reason = f"Messages come at {_compared(rate_hz, p)}.{_by_timer(timers)}"
    doubt = _doubt(delay_s, length_s)
    return graded(
        worst, expected, measured, reason, where=where, best=best, levels=CREDIT_LEVELS, doubt=doubt
    )


def _compared(rate_hz: float, p: TopicRate) -> str:
    """Say by how much a rate differs from the one asked for."""
    times = rate_hz / p.rate_hz
    off = apart(100 * abs(times - 1), 0, 100 * p.full_within, places=1)
    than = (
        f"{off}% {'slower' if times < 1 else 'faster'} than" if times < 2 else f"{times:.3g} times"
    )
    return f"{apart(rate_hz, p.rate_hz, places=1)} Hz, {than} {p.rate_hz:g} Hz"


def _rate_between(
    context: Context, p: TopicRate, timing: Timing, span: Span | None, delay_s: float, by: str
) -> tuple[tuple[float, float], float, str]:
    """Return the bounds of the rate in Hz, the error of its measurement, and by what it was measured."""
    length_s = span.duration_s if span else timing.written / timing.rate_hz
    run, before_s = context.session.process(p.process), 0.0
    if run is not None and span is not None:
        before_s = context.session.machine_delay_s(
            run, Span(min(run.started_ns, span.start_ns), span.start_ns)
        )
    least_hz, most_hz = _bounds_hz(timing, length_s, delay_s, before_s, p.rate_hz)
    error_hz = timing.burst_error_hz or 2 * timing.deviation_s() * timing.rate_hz / max(
        length_s, 1e-9
    )
    bounds_hz = (least_hz - error_hz, most_hz + error_hz)
    harmless_s = _HARMLESS * timing.median_s
    calm = p.calm(context, timing, by, delay_s, harmless_s)
    if calm is None or run is None:
        return bounds_hz, error_hz, by
    bounds_hz = _within(calm.rate_hz(), bounds_hz)  # what the undisturbed intervals say alone
    delays = [delay for delay in context.session.delays(run) if delay.delay_ns > harmless_s * 1e9]
    if (schedule := kept_schedule(calm, delays, timing)) is not None:
        bounds_hz = _within(schedule.bounds_hz(), bounds_hz)
    return bounds_hz, (bounds_hz[1] - bounds_hz[0]) / 2, calm.said


#: A delay of this share of an interval does not change how many there are.
_HARMLESS = 0.2


def _within(bounds: tuple[float, float], others: tuple[float, float]) -> tuple[float, float]:
    """Return bounds as far as they lie within others, which hold whatever the machine did."""
    least, most = (min(max(bound, others[0]), others[1]) for bound in bounds)
    return least, most


def _by_timer(timers: Sequence[Claim]) -> str:
    """Say what the period of the node's only timer is, where its source says so."""
    named = len(timers) == 1 and _NUMBER.fullmatch(timers[0].name)
    return f" The timer's period is {float(timers[0].name):g} s." if named else ""


#: A topic on which nothing came for so long, and for so many of its intervals, had ended.
_SILENT_S, _SILENT_INTERVALS = 0.5, 10


def _silence_s(context: Context, p: TopicRate, span: Span | None) -> tuple[float, float]:
    """Return for how long at the end of its window nothing came, and how long the window was to be."""
    stream = context.session.stream(p.topic)
    source_ns = stream.source_ns
    if span is not None:
        before, after = source_ns <= span.end_ns, source_ns > span.end_ns
        last_ns = int(source_ns[before].max())
        missed = (
            int(stream.sequence[after].min() - stream.sequence[before].max()) if after.any() else 0
        )
        # What was sent and not recorded is the recorder's loss, of which only the next message tells.
        return (span.end_ns - last_ns) / 1e9 if missed <= 1 else 0.0, span.duration_s
    step = context.session.step(p.window) if p.window else None
    if step is None or step.outcome != "cancelled":
        return 0.0, 1.0
    # The program ended within the window, which opens with the first message.
    of_s = float(step.parameters["duration_s"])
    lasted_s = (int(source_ns.max()) - max(int(source_ns.min()), step.started_ns)) / 1e9
    return max(0.0, of_s - lasted_s), of_s


def _bounds_hz(
    timing: Timing, length_s: float, delay_s: float, before_s: float, wanted_hz: float
) -> tuple[float, float]:
    """Return the lowest and the highest rate, up to the one wanted, that the node may have had on a machine of its own.

    It lost at most the time for which it was ready and had no core, and may have made up for what it could not send
    before the window. What its usual interval shows is not changed by a few delays; many can lengthen half of them.
    """
    usual_hz = 1 / timing.median_s if timing.median_s > 0 else timing.rate_hz
    least_hz = max(timing.rate_hz * length_s / (length_s + before_s), usual_hz, wanted_hz)
    longer_s = (
        2 * delay_s / max(len(timing.intervals_s), 1) if delay_s > MANY_DELAYS * length_s else 0.0
    )
    usual_hz = 1 / (timing.median_s - longer_s) if timing.median_s > longer_s else float("inf")
    most_hz = min(without_delay(timing.rate_hz, delay_s, length_s), usual_hz, wanted_hz)
    return min(timing.rate_hz, least_hz), max(timing.rate_hz, most_hz)


def _timers(context: Context) -> list[Claim]:
    """Return the timers that the student's nodes made, by the tap."""
    return [c for c in context.session.record.claims if c.kind == "timer" and claimed_at(c)]


#: Credit for evenness comes in halves: a quantile is known only to some part of itself.
_JITTER_LEVELS = 2


class TopicJitter(_Timed):
    """Messages are evenly spaced: a quantile of the intervals' distances from their median."""

    full_within_s: float = Field(gt=0)
    zero_beyond_s: float = Field(gt=0)
    share: Share = Field(0.95, description="The quantile.")


def topic_jitter(context: Context, p: TopicJitter) -> Finding:
    """Judge the evenness of intervals between consecutive samples."""
    timing, span, delay_s, by = p.measured(context)
    half_within_s = (p.full_within_s + p.zero_beyond_s) / _JITTER_LEVELS
    expected = (
        f"{percent(p.share)} of the gaps between messages within {p.full_within_s * 1e3:g} ms of the usual gap; "
        f"half credit within {half_within_s * 1e3:g} ms"
    )
    where = (context.location(p.topic, span),)
    if timing is None or not len(timing.intervals_s):
        return failed(
            expected,
            "too few messages",
            "Too few messages arrived to measure the gaps between them.",
            where=where,
        )
    least, largest = shares_around(p.share, len(timing.intervals_s))
    least_s, largest_s = timing.deviation_s(least, delay_s), timing.deviation_s(largest)
    if (calm := p.calm(context, timing, by, delay_s, p.full_within_s / 2)) is not None:
        least_s, largest_s = _within(calm.deviations_s(p.share), (least_s, largest_s))
        by = calm.said
    deviation_s = min(max(timing.deviation_s(p.share), least_s), largest_s)
    longest = f"longest {timing.intervals_s.max() * 1e3:.1f} ms"
    limits_ms = (p.full_within_s * 1e3, p.zero_beyond_s * 1e3)
    shown_ms = apart(deviation_s * 1e3, *limits_ms, places=2)
    measured = (
        f"{percent(p.share)} within {shown_ms} ms of {timing.median_s * 1e3:.2f} ms ({longest}){by}"
    )
    worst, best = (ramp(d, p.full_within_s, p.zero_beyond_s) for d in (largest_s, least_s))
    off = f"{apart(deviation_s * 1e3, *limits_ms, places=1)} ms off the usual {timing.median_s * 1e3:.1f} ms"
    reason = f"One gap in {round(1 / (1 - p.share))} is more than {off}."
    doubt = _doubt(delay_s, span.duration_s if span else float(timing.intervals_s.sum()))
    return graded(
        worst,
        expected,
        measured,
        reason,
        where=where,
        best=best,
        levels=_JITTER_LEVELS,
        doubt=doubt,
    )


class MessageValues(Parameters):
    """Every message holds a number of finite values in a field."""

    topic: ref.Topic
    field: ref.FieldPath
    length: int
    reach: float | None = Field(None, gt=0, description="No value may lie farther from 0.")
    unsafe_by: ref.EarlierCheckId | None = Field(
        None,
        description="Check of what the values do; where it failed, they are not safe, and worth nothing.",
    )


def message_values(context: Context, p: MessageValues) -> Finding:
    """Judge the length and finiteness of a field; credit in parts."""
    within = f", none beyond ±{p.reach:g}" if p.reach is not None else ""
    expected = f"{p.length} finite numbers in '{p.field}' of every message{within}"
    rows = context.session.rows(p.topic, p.field)
    if not rows:
        return unexplained(failed(expected, "no messages", "No message arrived."))
    lengths = [len(row) if row is not None else 0 for row in rows]
    finite = [row is not None and bool(np.isfinite(row).all()) for row in rows]
    others = sum(n != p.length for n in lengths)
    good = sum(n == p.length and ok for n, ok in zip(lengths, finite, strict=True))
    usual = max(set(lengths), key=lengths.count)
    measured = f"{good} of {len(rows)} messages hold {p.length} finite numbers"
    reasons = (
        [f"{others} of {len(rows)} messages do not hold {p.length} numbers (most hold {usual})."]
        if others
        else []
    )
    if not all(finite):
        reasons.append(f"{finite.count(False)} messages hold numbers that are not finite.")
    sizes = [
        float(np.abs(row).max()) if row is not None and ok and len(row) else 0.0
        for row, ok in zip(rows, finite, strict=True)
    ]
    farthest = max(sizes)
    if p.reach is not None and farthest > p.reach:
        first = next(n for n, size in enumerate(sizes) if size > p.reach)
        at_ns = int(context.session.stream(p.topic).source_ns[first])
        where = (context.location(p.topic, Span(at_ns, at_ns)),)
        reason = f"A value of {farthest:.2f} is beyond ±{p.reach:g}."
        return failed(expected, f"{measured}, up to {farthest:.2f}", reason, where=where)
    if (
        unsafe := context.findings.get(p.unsafe_by or "")
    ) is not None and unsafe.outcome is Outcome.FAILED:
        reason = " ".join([*reasons, unsafe.reason])
        return failed(
            expected, unsafe.measured or measured, reason, hint=unsafe.hint, where=unsafe.where
        )
    # One bad message is as clear as many, however often it comes.
    share = 1.0 if good == len(rows) else min(quantise(good / len(rows)), 1 - 1 / CREDIT_LEVELS)
    return graded(share, expected, measured, " ".join(reasons))


class Component(Parameters):
    """One element of the message that follows amplitude·sin(2π·frequency·t)."""

    index: int = Field(ge=0)
    amplitude: float = Field(gt=0)
    frequency_hz: float = Field(gt=0)


class Slip(Parameters):
    """A known mistake, by the factors that it puts on amplitude and frequency."""

    amplitude: float = Field(1.0, gt=0)
    frequency: float = Field(1.0, gt=0)
    meaning: str


class Sinusoids(Parameters):
    """Elements of a message follow sinusoids, the others stay at zero."""

    topic: ref.Topic
    field: ref.FieldPath
    components: tuple[Component, ...] = Field(min_length=1)
    tick_s: float = Field(gt=0, description="Time step per message with which the node computes.")
    others_still: int = Field(
        0, description="The elements up to this one that have no component stay at 0."
    )
    reach: float | None = Field(
        None, gt=0, description="No element may go farther from 0: nothing is earned then."
    )
    starts_within: float | None = Field(
        None, gt=0, description="So near 0 each element begins; one that jumps there earns nothing."
    )
    tolerance: Share = 0.05
    phase_tolerance: Share = Field(
        0.125, description="Share of a period by which a sinusoid may begin elsewhere."
    )
    slips: tuple[Slip, ...] = ()
    phase_credit: Share = Field(
        2 / 3, description="Credit of one that begins at another place of its period."
    )


def sinusoids(context: Context, p: Sinusoids) -> Finding:
    """Judge amplitude and frequency, both by the clock and by counting messages.

    A wrong rate is charged elsewhere. What sends a joint where it must not go earns nothing.
    """
    wanted = ", ".join(
        f"{c.amplitude:g}·sin(2π·{c.frequency_hz:g}·t) in [{c.index}]" for c in p.components
    )
    expected = f"{wanted}, the others 0"
    series = context.session.numeric(p.topic, p.field, finite=False)
    if series is None or len(series.values) < _FEWEST:
        return not_reached(
            "Too few messages with numbers arrived to see a motion.", expected=expected
        )
    fits = {component.index: _fits(series, component, p) for component in p.components}
    parts = [
        _judge_component(series, component, p, fits[component.index]) for component in p.components
    ]
    moving = ", ".join(map(str, _others_that_move(series.values, p)))
    parts.append(
        Part(0.0, "", f"Element {moving} should stay at 0, but does not.") if moving else Part(1.0)
    )
    unmoved = [
        component
        for component, part in zip(p.components, parts, strict=False)
        if part.share < _RECOGNISED
    ]
    danger, first = _danger(series, p, fits)
    if not danger:
        places = [(component.index, _element_of(series, component, p)) for component in unmoved]
        danger = " ".join(
            f"The motion of element {own} is in element {n}." for own, n in places if n is not None
        )
    ends_ns = (int(series.source_ns[n]) for n in ((0, -1) if first is None else (first, first)))
    where = (context.location(p.topic, Span(*ends_ns)),)
    if danger:
        measured = "; ".join(part.text for part in parts if part.text)
        reason = " ".join([danger, *(part.reason for part in parts if part.reason)])
        return failed(expected, measured, reason, where=where)
    return of_parts(expected, parts, where=where)


#: A component that earns less may be in another element.
_RECOGNISED = 0.5
#: From one of so many first messages on, by the steps of those that follow it, it is known where the motion begins.
_FIRST_MESSAGES = 10


#: By the index of an element: what it may follow, by the clock and by counting messages.
_Fits = Mapping[int, Sequence[Sinusoid]]


def _danger(series: NumericStream, p: Sinusoids, fits: _Fits) -> tuple[str, int | None]:
    """Say by which values a joint would go where it must not, or would not know where to go, and in which message.

    Empty if by none, and no message if by all of them.
    """
    values = series.values
    if values.shape[1] != (p.others_still or values.shape[1]):
        return f"There are {values.shape[1]} elements for {p.others_still} joints.", None
    finite = np.isfinite(values)
    if lacking := ", ".join(str(n) for n in np.flatnonzero(finite.mean(axis=0) < _RECOGNISED)):
        return f"Element {lacking} is not a number.", None
    sizes = np.where(finite, np.abs(values), 0.0)
    if p.reach is not None and (far := float(sizes.max())) > p.reach:
        first = int(np.argmax(sizes.max(axis=1) > p.reach))
        return (
            f"Element {int(sizes.max(axis=0).argmax())} goes as far as {far:.2f}, beyond ±{p.reach:g}.",
            first,
        )
    few = slice(_FIRST_MESSAGES)
    steps = (
        np.abs(np.diff(sizes[few], axis=0)) / np.maximum(1, np.diff(series.sequence[few]))[:, None]
    )
    nearest = sizes[0] - (series.sequence[0] - 1) * steps.max(axis=0, initial=0.0)
    begins = dict(enumerate(nearest)) if series.sequence[0] <= _FIRST_MESSAGES else _begins(p, fits)
    element = max(begins, key=lambda n: begins[n], default=0)
    if p.starts_within is not None and begins.get(element, 0.0) > p.starts_within:
        return f"Element {element} jumps to {begins[element]:.2f} with the first message.", 0
    return "", None


def _begins(p: Sinusoids, fits: _Fits) -> dict[int, float]:
    """Return how far from 0 the elements began that move as they should, by their motion since then."""
    right = ((c.index, _earliest(fits[c.index], c, p)) for c in p.components)
    return {
        index: fit.amplitude * abs(np.sin(fit.phase)) for index, fit in right if fit is not None
    }


#: So many messages show a motion.
_FEWEST = 20


def _element_of(series: NumericStream, c: Component, p: Sinusoids) -> int | None:
    """Return the other element that moves as a component should."""
    places = (i for i in range(min(p.others_still, series.values.shape[1])) if i != c.index)
    finite = (i for i in places if np.isfinite(series.values[:, i]).all())
    moved = (
        c.model_copy(update={"index": i})
        for i in finite
        if float(np.ptp(series.values[:, i])) > c.amplitude
    )
    return next((m.index for m in moved if _earliest(_fits(series, m, p), m, p) is not None), None)


def _others_that_move(values: Floats, p: Sinusoids) -> list[int]:
    used = {c.index for c in p.components}
    smallest = min(c.amplitude for c in p.components)
    others = [i for i in range(min(p.others_still, values.shape[1])) if i not in used]
    sizes = np.where(np.isfinite(values), np.abs(values), 0.0).max(
        axis=0
    )  # what is no number is charged elsewhere
    return [i for i in others if float(sizes[i]) > p.tolerance * smallest]


def _judge_component(
    series: NumericStream, c: Component, p: Sinusoids, fits: Sequence[Sinusoid]
) -> Part:
    if c.index >= series.values.shape[1]:
        return Part(0.0, f"no element {c.index}", f"Messages have no element {c.index}.")
    values = series.values[np.isfinite(series.values[:, c.index]), c.index]
    if len(values) < _FEWEST:
        return Part(0.0, f"[{c.index}] is not a number", f"Element {c.index} is not a number.")
    best = min(fits, key=lambda fit: _badness(fit, c))
    amplitude, frequency = (
        apart(got, *(wanted * (1 + k * p.tolerance) for k in (-1, 1)), places=3)
        for got, wanted in ((best.amplitude, c.amplitude), (best.frequency_hz, c.frequency_hz))
    )
    text = f"[{c.index}] {amplitude} at {frequency} Hz"
    if (early := _earliest(fits, c, p)) is not None:
        if abs(early.phase) <= 2 * np.pi * p.phase_tolerance:
            return Part(1.0, text)
        begins = (
            f"{np.degrees(early.phase):.0f}° into its sine instead of at 0° (180° inverts the sign)"
        )
        reason = f"Element {c.index} has the right amplitude and frequency, but begins {begins}."
        return Part(p.phase_credit, text, reason)
    if float(np.ptp(values)) < p.tolerance * c.amplitude:
        return Part(0.0, f"[{c.index}] does not move", f"Element {c.index} does not move.")
    clean = best.residual < 0.2 * c.amplitude
    centred = abs(best.offset) <= p.tolerance * c.amplitude
    right = [abs(ratio - 1) <= p.tolerance and clean for ratio in _ratios(best, c)]
    reason = f"Element {c.index} has amplitude {amplitude} and frequency {frequency} Hz"
    reason += "" if centred else f" about {best.offset:.3f} instead of 0"
    reason += f" (wanted {c.amplitude:g} and {c.frequency_hz:g} Hz){'' if clean else ', and is no clean sine'}."
    factors = np.array(_ratios(best, c))
    slip = next(
        (s.meaning for s in p.slips if np.allclose(factors, (s.amplitude, s.frequency), rtol=0.05)),
        "",
    )
    return Part(0.5 * (right[1] + (right[0] and centred)), text, f"{reason} {slip}".strip())


def _ratios(fit: Sinusoid, c: Component) -> tuple[float, float]:
    return fit.amplitude / c.amplitude, fit.frequency_hz / c.frequency_hz


#: Frequencies that are searched, in parts of the one wanted.
_SLOWEST, _FASTEST = 0.1, 20


def _earliest(fits: Sequence[Sinusoid], c: Component, p: Sinusoids) -> Sinusoid | None:
    """Return the fit that begins nearest to the start of its sine, of those that are right; None if none is."""
    return min(
        (f for f in fits if _badness(f, c) <= p.tolerance),
        key=lambda fit: abs(fit.phase),
        default=None,
    )


def _fits(series: NumericStream, c: Component, p: Sinusoids) -> list[Sinusoid]:
    """Return the fits of an element from the first message on: by the clock, by counting, or by its own period.

    By that the clock is set right, which does not tell the messages that a machine kept from being sent in time.
    """
    if c.index >= series.values.shape[1] or np.isfinite(series.values[:, c.index]).sum() < _FEWEST:
        return []
    series = series.only(np.isfinite(series.values[:, c.index]))
    by_count: Floats = (series.sequence - 1) * np.float64(p.tick_s)
    bounds = (_SLOWEST * c.frequency_hz, _FASTEST * c.frequency_hz)
    fits = [
        fit_sinusoid(times, series.values[:, c.index], *bounds)
        for times in (_since_first_s(series), by_count)
    ]
    if _earliest(fits, c, p) is None:
        usual_s = (
            float(np.median(np.diff(series.source_ns) / np.maximum(np.diff(series.sequence), 1)))
            / 1e9
        )
        by_period: Floats = (series.sequence - 1) * np.float64(usual_s)
        fits.append(fit_sinusoid(by_period, series.values[:, c.index], *bounds))
    return fits


def _since_first_s(series: NumericStream) -> Floats:
    """Return the time of each message since the node's first, which may not have been recorded."""
    times_s: Floats = (series.source_ns - series.source_ns[0]) / np.float64(1e9)
    written = int(series.sequence[-1] - series.sequence[0])
    missed_s = (int(series.sequence[0]) - 1) * float(times_s[-1]) / written if written > 0 else 0.0
    shifted: Floats = times_s + max(0.0, missed_s)
    return shifted


def _badness(fit: Sinusoid, c: Component) -> float:
    """Return the largest relative deviation of a fit from a component."""
    off = [abs(ratio - 1) for ratio in _ratios(fit, c)]
    return max(*off, abs(fit.offset) / c.amplitude, fit.residual / c.amplitude)


class OfferedQos(QosWanted):
    """A publisher offers a QoS profile; what discovery does not carry is taken from the source, as advice only."""


def offered_qos(context: Context, p: OfferedQos) -> Finding:
    """Judge reliability and durability from discovery; history and depth only advise."""
    return qos_as_wanted(context, p, "publisher", "offers")
