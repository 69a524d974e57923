"""Bounds of a measured value on an idle machine.

Machine delays make messages and answers late and let queues overflow, and the count of events falls. They never make
a program faster. Each function states this for one kind of value as an `Interval`; a check turns both ends into
credit, and a difference leaves it undecided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from grader.evidence.cpu_delay import (
    Calm,
    Delay,
    Span,
    calm_intervals,
    delay_before,
    shares_around,
)
from grader.evidence.recorded import Booleans, Floats, Integers, Recorded
from grader.evidence.schedule import kept_schedule
from grader.evidence.timing import Timing, timing_of
from grader.recording.session import ProcessRun

#: Shortest delay given as a cause, in s; two decimal places show it.
_LEAST_DELAY_S = 0.005
#: Least share of delays in a span after which every event in the span may depend on them.
MANY_DELAYS = 0.25
#: Largest share of a time that delays are taken to have cost; a process that runs for less shows nothing.
_MOST_DELAYED = 0.9
#: Delayed share of a span from which the delay is the reason of a doubt.
_NOTABLE_DELAY = 0.005
#: Share of an interval up to which a delay does not change the number of intervals.
_HARMLESS = 0.2
#: Delayed share of the allowed time of a message from which it may be late.
_FELT = 0.2
#: Longest time from a delay to a message that still waits for it, in s.
_WAITED_S = 0.05


@dataclass(frozen=True)
class Interval:
    """Least and greatest value on an idle machine."""

    low: float
    high: float
    #: Sentence on the delay behind the difference; empty if no delay is long enough to be shown.
    why: str = ""

    def nearest(self, value: float) -> float:
        """Return the value of the interval nearest to another one."""
        return min(max(value, self.low), self.high)

    def widened(self, error: float) -> Interval:
        """Return the interval with an error of measurement at both ends."""
        return replace(self, low=self.low - error, high=self.high + error)

    def within(self, other: Interval) -> Interval:
        """Return the interval, cut to another one."""
        return replace(self, low=other.nearest(self.low), high=other.nearest(self.high))

    def meets(self, other: Interval) -> bool:
        """Return whether a value can lie in both intervals."""
        return self.low <= other.high and other.low <= self.high

    def off(self, wanted: float) -> Interval:
        """Return the relative distance from a wanted value.

        Example
        -------
        `Interval(97, 103).off(100)` is 0 to 0.03.
        """
        least_off = abs(self.nearest(wanted) / wanted - 1)
        most_off = max(abs(self.low / wanted - 1), abs(self.high / wanted - 1))
        return Interval(least_off, most_off, self.why)

    def credit(self, credit_of: Callable[[float], float]) -> Interval:
        """Return the least and the greatest credit, for a credit that rises or falls with the value."""
        ends = (credit_of(self.low), credit_of(self.high))
        if ends[0] == ends[1]:
            return Interval(*ends)
        return Interval(min(ends), max(ends), self.why)


# -- delays ----------------------------------------------------------------------------------------


@dataclass(frozen=True, order=True)
class Delayed:
    """Machine delay within a time, both in seconds."""

    delay_s: float
    length_s: float

    @property
    def why(self) -> str:
        """Sentence on the delay as a cause; empty if it is too short to be shown."""
        return cpu_delay_doubt(self.delay_s, self.length_s)

    def exceeds(self, share: float) -> bool:
        """Return whether the delay is more than a share of the time."""
        return self.delay_s > share * self.length_s


def cpu_delay_doubt(delay_s: float, length_s: float) -> str:
    """Say that the delay of the machine may be the cause of a fault; empty for a delay too short to be shown."""
    if delay_s < _LEAST_DELAY_S:
        return ""
    return f"Not your fault: the grading computer was too busy to measure this ({delay_s:.2f} s of {length_s:.1f} s)."


def delay_of(recorded: Recorded, run: ProcessRun | None, span: Span) -> Delayed:
    """Return the delay of a process within a span; 0 without the process."""
    delay_s = 0.0
    if run is not None:
        delay_s = recorded.machine_delay_s(run, span)
    return Delayed(delay_s, span.duration_s)


def longest_delay(recorded: Recorded, span: Span) -> Delayed:
    """Return the delay of the most delayed process within a span."""
    return Delayed(recorded.longest_delay_s(span), span.duration_s)


def asking_delay(recorded: Recorded, span: Span, held_up_ns: int) -> Delayed:
    """Return the longest delay within a span, and those of the recorder and of the asking process in addition.

    The asking process reports its own delay.
    """
    own_s = recorded.recorder_delay_s(span) + held_up_ns / 1e9
    return Delayed(recorded.longest_delay_s(span) + own_s, span.duration_s)


# -- values ----------------------------------------------------------------------------------------


def without_delay(value: float, delay_s: float, length_s: float) -> float:
    """Return the most that a count or a rate may have been without the delay of the machine."""
    return value / (1 - min(_MOST_DELAYED, delay_s / max(length_s, 1e-9)))


def count(seen: float, delayed: Delayed) -> Interval:
    """Return the bounds of a number of events, or of their rate.

    Example
    -------
    80 messages in 10 s with 2 s of delays may have been up to 100.
    """
    most = without_delay(seen, delayed.delay_s, delayed.length_s)
    return Interval(seen, most, delayed.why)


def latency(took_s: float, delayed: Delayed) -> Interval:
    """Return the bounds of a duration in s: without the delay it is shorter by at most that."""
    least_s = max(0.0, took_s - delayed.delay_s)
    return Interval(min(took_s, least_s), took_s, delayed.why)


def latencies(recorded: Recorded, starts_ns: Integers, ends_ns: Integers) -> tuple[Floats, Floats]:
    """Return the least and the greatest times between messages and their answers, in s.

    A message waiting for a delayed process is answered as much later.
    """
    took_s: Floats = (ends_ns - starts_ns) / 1e9
    waiting_ns = starts_ns - round(_WAITED_S * 1e9)
    delays_s = recorded.delays_s(waiting_ns, ends_ns)
    least_s: Floats = np.maximum(took_s - delays_s, 0.0)
    return least_s, took_s


def made_late(
    recorded: Recorded, starts_ns: Integers, ends_ns: Integers, within_s: float
) -> Booleans:
    """Return for each span whether its delays can make a message late, by its allowed time in s."""
    return recorded.delays_s(starts_ns, ends_ns) > _FELT * within_s


def arrival(late_s: float, delayed: Delayed) -> Interval:
    """Return whether something late came in time: 0 as it was seen, and 1 if a delay can have made it late."""
    return _possibly(delayed, late_s <= delayed.delay_s)


def absence(share: float, *delays: Delayed) -> Interval:
    """Return whether something was there unseen: 0 as it was seen, and 1 if delays took most of each time.

    Parameters
    ----------
    share
        Least delayed share of each time.
    delays
        Delays within the times without it.
    """
    delay_s = sum(each.delay_s for each in delays)
    whole = Delayed(delay_s, sum(each.length_s for each in delays))
    are_long = all(each.exceeds(share) for each in delays)
    return _possibly(whole, are_long and bool(whole.why))


def _possibly(delayed: Delayed, is_possible: bool) -> Interval:
    if is_possible:
        return Interval(0.0, 1.0, delayed.why)
    return Interval(0.0, 0.0)


def lost_share(
    recorded: Recorded, runs: Iterable[ProcessRun], depth: int, times_ns: Integers
) -> float:
    """Return the greatest share of messages possibly lost by one of some processes.

    A process loses nothing while the queues of its subscriptions have room.

    Parameters
    ----------
    depth
        Depth of its shortest queue.
    times_ns
        int64[n]: Source timestamps of the messages.
    """
    span = Span(int(times_ns.min()), int(times_ns.max()))
    length_s = max(span.duration_s, 1e-9)
    room_s = max(0, depth - 1) * length_s / len(times_ns)
    shares = [recorded.backlog(run, span, room_s).lost_s / length_s for run in runs]
    return max(shares, default=0.0)


# -- publications ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measured(Interval):
    """Bounds of a value, with its error and method."""

    #: Error of the measurement; the bounds include it.
    error: float = 0.0
    #: Clause about the method of measurement; empty if by source timestamps.
    method: str = ""

    def likely(self, value: float) -> float:
        """Return a measured value, moved between the bounds without their error."""
        return min(max(value, self.low + self.error), self.high - self.error)


@dataclass(frozen=True)
class Publication:
    """Timing of a topic within a window, and the delays of its publisher."""

    recorded: Recorded
    #: The publishing process; None if it is unknown.
    run: ProcessRun | None
    timing: Timing
    #: The window; None if the check has none, or if it never opened.
    span: Span | None
    #: Machine delay of the process within the window, in seconds.
    delay_s: float = 0.0
    #: Clause about the method of measurement; empty if by source timestamps.
    method: str = ""

    @property
    def length_s(self) -> float:
        """Length of the window in seconds, or of the whole publication if there is none."""
        if self.span is not None:
            return self.span.duration_s
        return self.timing.written / self.timing.rate_hz

    def part(self, span: Span, timing: Timing) -> Publication:
        """Return the publication within a part of its window."""
        delay_s = delay_of(self.recorded, self.run, span).delay_s
        return replace(self, timing=timing, span=span, delay_s=delay_s)

    def with_bounded_delay(self) -> Publication:
        """Return the publication with a delay of at most nine tenths of its time."""
        return replace(self, delay_s=min(self.delay_s, _MOST_DELAYED * self.length_s))

    @property
    def before_s(self) -> float:
        """Machine delay of the process between its start and the window, in seconds."""
        if self.run is None or self.span is None:
            return 0.0
        before = Span(min(self.run.started_ns, self.span.start_ns), self.span.start_ns)
        return self.recorded.machine_delay_s(self.run, before)

    def why(self, length_s: float) -> str:
        """Say that the machine keeps a value from being measured, if it delayed a notable share of a time."""
        delayed = Delayed(self.delay_s, length_s)
        if delayed.exceeds(_NOTABLE_DELAY):
            return delayed.why
        return ""

    def calm(self, harmless_s: float) -> Calm | None:
        """Return the undisturbed intervals, if the machine delayed the process notably.

        None too if too few intervals remain, or if the method of measurement cannot tell them apart.
        """
        timing = self.timing
        if self.run is None or self.run.disturbed is None:
            return None
        if self.method or timing.burst_error_hz is not None:
            return None
        if self.delay_s <= _NOTABLE_DELAY * timing.written / timing.rate_hz:
            return None
        delays = self.recorded.delays(self.run)
        calm = calm_intervals(delays, timing.times_ns, timing.intervals_s, harmless_s)
        if calm.is_enough:
            return calm
        return None


def publication_of(
    recorded: Recorded, topic: str, run: ProcessRun | None, span: Span | None
) -> Publication | None:
    """Measure the timing of a topic; None if too few messages arrived.

    Impossible source timestamps are replaced by times of arrival, and the recorder's delay is then added to the machine
    delay.
    """
    timing = timing_of(recorded.stream(topic), span)
    if timing is None:
        return None
    if span is None:
        return Publication(recorded, run, timing, None)
    delay_s = delay_of(recorded, run, span).delay_s
    recorder_delay_s = recorded.recorder_delay_s(span)
    delays = _delays_on_the_way(recorded, run)
    excused_s = recorder_delay_s
    if delays:
        excused_s = 0.0
    if timing.arrived is None or not timing.contradicted_by_arrival(excused_s, delays):
        return Publication(recorded, run, timing, span, delay_s)
    method = " by times of arrival, as the time stamps are not the times of publication"
    return Publication(recorded, run, timing.arrived, span, delay_s + recorder_delay_s, method)


def _delays_on_the_way(recorded: Recorded, run: ProcessRun | None) -> list[tuple[Delay, ...]]:
    """Return the delays of each watched process between a publication and its recording."""
    processes = list(recorded.recorders)
    if run is not None:
        processes.insert(0, run)
    return [recorded.delays(each) for each in processes if each.disturbed is not None]


def rate(published: Publication, wanted_hz: float) -> Measured:
    """Return the bounds of a publishing rate in Hz, narrowed by undisturbed intervals if there are enough."""
    timing = published.timing
    length_s = published.length_s
    ends_error_hz = 2 * timing.deviation_s() * timing.rate_hz / max(length_s, 1e-9)
    error_hz = timing.burst_error_hz or ends_error_hz
    bounds = undelayed_rate(published, wanted_hz).widened(error_hz)
    why = published.why(length_s)
    harmless_s = _HARMLESS * timing.median_s
    calm = published.calm(harmless_s)
    if calm is None or published.run is None:
        return Measured(bounds.low, bounds.high, why, error_hz, published.method)
    bounds = Interval(*calm.rate_hz()).within(bounds)
    delays = published.recorded.delays(published.run)
    harmful = [delay for delay in delays if delay.delay_ns > harmless_s * 1e9]
    schedule = kept_schedule(calm, harmful, timing)
    if schedule is not None:
        bounds = Interval(*schedule.bounds_hz()).within(bounds)
    error_hz = (bounds.high - bounds.low) / 2
    return Measured(bounds.low, bounds.high, why, error_hz, calm.said)


def undelayed_rate(published: Publication, wanted_hz: float) -> Interval:
    """Return the lowest and the highest rate of a program on an idle machine, by all intervals, in Hz.

    Neither bound goes beyond the wanted rate. The program lost at most its time of waiting for a core, and may have
    sent messages late that were due before the window. A few delays do not change the median interval; many, or short
    ones in most intervals, lengthen half of the intervals.
    """
    timing = published.timing
    length_s = published.length_s
    usual_hz = timing.rate_hz
    if timing.median_s > 0:
        usual_hz = 1 / timing.median_s
    early_hz = timing.rate_hz * length_s / (length_s + published.before_s)
    least_hz = max(early_hz, usual_hz, wanted_hz)
    delayed = Delayed(published.delay_s, length_s)
    longer_s = 0.0
    if delayed.exceeds(MANY_DELAYS):
        longer_s = 2 * delayed.delay_s / max(len(timing.intervals_s), 1)
    usual_s = min(timing.median_s - longer_s, _undelayed_median_s(published))
    undelayed_hz = math.inf
    if usual_s > 0:
        undelayed_hz = 1 / usual_s
    most_hz = min(count(timing.rate_hz, delayed).high, undelayed_hz, wanted_hz)
    return Interval(min(timing.rate_hz, least_hz), max(timing.rate_hz, most_hz))


def _undelayed_median_s(published: Publication) -> float:
    """Return the median of the intervals without the delays within each, in s."""
    timing = published.timing
    if published.run is None or not published.run.disturbed or not len(timing.intervals_s):
        return timing.median_s
    delays = published.recorded.delays(published.run)
    starts_ns = timing.times_ns - np.round(timing.intervals_s * 1e9).astype(np.int64)
    within_ns = delay_before(delays, timing.times_ns) - delay_before(delays, starts_ns)
    return float(np.median(timing.intervals_s - within_ns / 1e9))


def gaps(published: Publication, share: float, harmless_s: float) -> Measured:
    """Return the bounds of a quantile of the intervals' distances from their median, in s.

    Undisturbed intervals narrow the bounds if there are enough.

    Parameters
    ----------
    share
        The quantile.
    harmless_s
        Longest delay without an effect.
    """
    timing = published.timing
    length_s = float(timing.intervals_s.sum())
    if published.span is not None:
        length_s = published.span.duration_s
    least, largest = shares_around(share, len(timing.intervals_s))
    least_s = timing.deviation_s(least, published.delay_s)
    bounds = Interval(least_s, timing.deviation_s(largest))
    method = published.method
    calm = published.calm(harmless_s)
    if calm is not None:
        bounds = Interval(*calm.deviations_s(share)).within(bounds)
        method = calm.said
    return Measured(bounds.low, bounds.high, published.why(length_s), 0.0, method)
