"""Rates and intervals of a topic, from what the middleware stamped; the recorder's own delays do not enter.

References
----------
DDS puts the writer's source timestamp and publication sequence number on every sample, so
``(sequence_last - sequence_first) / (source_last - source_first)`` is the rate at which samples were
written even if some were lost on the way to the recorder.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from grader.evidence.cpu_delay import Delay, Span
from grader.evidence.recorded import Floats, Integers
from grader.recording.bag import Stream


@dataclass(frozen=True)
class Timing:
    """How a topic was published within a span."""

    #: Samples written a second.
    rate_hz: float
    #: Samples written, from the sequence numbers.
    written: int
    #: Samples written but not recorded.
    lost: int
    #: float64[n]: Times between consecutive samples, without those across a gap.
    intervals_s: Floats
    #: int64[n]: Source timestamps of the samples that end the intervals.
    times_ns: Integers
    #: int64[n]: Their sequence numbers.
    numbers: Integers
    #: Error of the rate where samples come in bursts; None where they do not.
    burst_error_hz: float | None = None
    #: The same samples by the times at which the recorder received them.
    arrived: Timing | None = None
    #: int64[2, n]: Stamp and arrival of each sample.
    ways_ns: Integers = field(default_factory=lambda: np.empty((2, 0), dtype=np.int64))

    @property
    def median_s(self) -> float:
        """Median interval in s; not a number if there is none."""
        return float(np.median(self.intervals_s)) if len(self.intervals_s) else float("nan")

    def deviation_s(self, share: float = 0.95, excused_s: float = 0.0) -> float:
        """Return a quantile, from 0 to 1, of the intervals' distances from their median, in s.

        Up to the delay for which somebody else is to blame, in all, the largest distances are left out.
        """
        if not len(self.intervals_s):
            return float("nan")
        distances = np.sort(np.abs(self.intervals_s - self.median_s))[::-1]
        # A late sample lengthens one interval and shortens the next: two distances for one delay.
        left_out = (
            int(np.searchsorted(np.cumsum(distances), 2 * excused_s, side="right"))
            if excused_s > 0
            else 0
        )
        kept = distances[left_out:]
        return float(np.quantile(kept, share)) if len(kept) else 0.0

    def contradicted_by_arrival(
        self, excused_s: float, delays: Iterable[Sequence[Delay]] = ()
    ) -> bool:
        """Whether samples did not leave when they are stamped: the stamps are the work of the publisher's process.

        Delays of processes on the way excuse what lies within them; of what is known in all only, the most that it can.

        Within a machine a sample is received some 0.1 ms after it was written, or later where one of the two has no
        core. In 558 recorded topics of honest and hostile programs, on two cores with up to 14 processes ready to run,
        the times on the way, those left out that the recorder's delay explains, differed by 1.0 ms at most.
        """
        stalled = round(2 * excused_s * self.rate_hz)
        if self.arrived is None or stalled > _MOST_STALLED * self.ways_ns.shape[1]:
            return False
        on_the_way = np.diff(self.ways_ns, axis=0)[0] / 1e9
        soonest = np.quantile(on_the_way, 0.1)
        for each in filter(None, delays):
            edges = np.array(
                [edge for d in each for edge in ((d.start_ns, 0), (d.end_ns, d.delay_ns))]
            ).T
            on_the_way -= (
                np.diff(np.interp(self.ways_ns, edges[0], np.cumsum(edges[1])), axis=0)[0] / 1e9
            )
        latest = np.quantile(np.sort(on_the_way)[: len(on_the_way) - stalled], 0.9)
        return bool(latest - soonest > _UNEVEN_WAY_S)


#: By how much the times on the way may differ, and the share of samples that the recorder may delay for it to show.
_UNEVEN_WAY_S, _MOST_STALLED = 0.003, 0.7


def timing_of(stream: Stream, span: Span | None) -> Timing | None:
    """Measure a topic's timing within a span; None with fewer than three samples in it.

    Samples of several publishers interleave, so that only those of one are measured. The error of the rate is the
    jitter of the two samples at the ends over the span: below 0.1 % for a span of seconds. Where samples come in
    bursts, the slope of all is taken instead.
    """
    order = np.argsort(stream.source_ns, kind="stable")
    source, received, sequence = (
        stream.source_ns[order],
        stream.received_ns[order],
        stream.sequence[order],
    )
    if span is not None:
        inside = (source >= span.start_ns) & (source <= span.end_ns)
        source, received, sequence = source[inside], received[inside], sequence[inside]
    if len(source) < 3:
        return None
    chosen = _of_one_publisher(sequence)
    source, received, sequence = source[chosen], received[chosen], sequence[chosen]
    stamped = _timed(source, sequence)
    if stamped is None:
        return None
    return replace(
        stamped, arrived=_timed(received, sequence), ways_ns=np.stack((source, received))
    )


def _timed(times: Integers, sequence: Integers) -> Timing | None:
    """Measure samples of rising sequence numbers by some times of theirs, in ns."""
    if len(times) < 3 or times[-1] <= times[0]:
        return None
    written = int(sequence[-1] - sequence[0])
    steps = np.diff(sequence)
    ends, numbers = times[1:][steps == 1], sequence[1:][steps == 1]
    intervals = np.diff(times)[steps == 1] / 1e9
    rate_hz, error_hz = written / ((times[-1] - times[0]) / 1e9), None
    if len(intervals) and np.median(intervals) < _BURSTS / rate_hz:
        rate_hz, error_hz = _slope(times, sequence)
    lost = written + 1 - len(times)
    return Timing(float(rate_hz), written + 1, lost, intervals, ends, numbers, error_hz)


#: Where the usual interval is shorter than this part of the mean one, samples come in bursts.
_BURSTS = 0.5


def _slope(source: Integers, sequence: Integers) -> tuple[float, float]:
    """Return the slope of sequence numbers over time, and its error, both in Hz.

    The samples of a burst are not independent, so that the bursts count: the error of a slope is that of n
    independent values, ``residual · √(12/n) / length``, twice.
    """
    times = (source - source[0]) / np.float64(1e9)
    slope, start = np.polyfit(times, (sequence - sequence[0]).astype(np.float64), 1)
    residual = float(np.std(sequence - sequence[0] - slope * times - start))
    length_s = float(times[-1])
    bursts = max(2.0, length_s / float(np.diff(times).max()))
    return float(slope), 2 * residual * float(np.sqrt(12 / bursts)) / length_s


def _of_one_publisher(sequence: Integers) -> Integers:
    """Return which samples are of that publisher which has most: their numbers follow one another.

    What is missing between them was lost, if none of what was before came after it.
    """
    if (np.diff(sequence) > 0).all():
        return np.arange(len(sequence))
    numbers = sequence.tolist()
    runs: list[list[int]] = []
    ends: dict[int, list[list[int]]] = {}
    for place, number in enumerate(numbers):
        before = [run for run in ends.pop(number - 1, ()) if place - run[-1] <= _MOST_PUBLISHERS]
        if before:
            run, *ends[number - 1] = before
        else:
            runs.append(run := [])
        run.append(place)
        ends.setdefault(number, []).append(run)
    whole: list[list[int]] = []
    for run in runs:
        gone = {
            numbers[run[0]] - numbers[w[-1]]: w for w in whole[-_MOST_PUBLISHERS:] if w[-1] < run[0]
        }
        fewest = min(
            (lost for lost, w in gone.items() if 0 < lost <= _MOST_LOST * (run[0] - w[-1])),
            default=None,
        )
        if fewest is not None:
            gone[fewest].extend(run)
        else:
            whole.append(run)
    return np.array(max(whole, key=len))


#: So many publishers of a topic are told apart: one that sends again after more samples of others is a new one.
_MOST_PUBLISHERS = 20
#: For each sample that came meanwhile, so many were lost at most.
_MOST_LOST = 10
