"""Rates and intervals of a topic, from the middleware's stamps; delays of the recorder do not enter.

References
----------
DDS puts the writer's source timestamp and publication sequence number on every sample. Therefore
``(sequence_last - sequence_first) / (source_last - source_first)`` is the rate at which samples were
written, even if some were lost on the way to the recorder.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from grader.evidence.cpu_delay import Delay, Span, delay_before
from grader.evidence.recorded import Floats, Integers
from ros_bag.reading import Stream

#: Largest honest difference of times on the way, in s.
_UNEVEN_WAY_S = 0.003
#: Largest share of samples delayed by the recorder with which that difference is judged.
_MOST_STALLED = 0.7
#: Samples from which a timing is measured.
_FEWEST_SAMPLES = 3
#: Ratio of the median interval to the mean one below which samples come in bursts.
_BURSTS = 0.5
#: Publishers of a topic that are told apart: after this many samples of others, a publisher counts as a new one.
_MOST_PUBLISHERS = 20
#: Samples lost at most for each sample that came meanwhile.
_MOST_LOST = 10


@dataclass(frozen=True)
class Timing:
    """Rate and intervals of a topic within a span."""

    #: Samples written per second.
    rate_hz: float
    #: Samples written, from the sequence numbers.
    written: int
    #: Samples written but not recorded.
    lost: int
    #: float64[n]: Times between consecutive samples, without those across a gap.
    intervals_s: Floats
    #: int64[n]: Source timestamps of the samples that end the intervals.
    times_ns: Integers
    #: int64[n]: Sequence numbers of these samples.
    numbers: Integers
    #: Error of the rate of samples that come in bursts; None if they come one by one.
    burst_error_hz: float | None = None
    #: Timing of the same samples by their times of arrival at the recorder.
    arrived: Timing | None = None
    #: int64[2, n]: Stamp and arrival of each sample.
    ways_ns: Integers = field(default_factory=lambda: np.empty((2, 0), dtype=np.int64))

    @property
    def median_s(self) -> float:
        """Median interval in s; NaN without intervals."""
        if not len(self.intervals_s):
            return float("nan")
        return float(np.median(self.intervals_s))

    def deviation_s(self, share: float = 0.95, excused_s: float = 0.0) -> float:
        """Return a quantile of the intervals' distances from their median, in s.

        Parameters
        ----------
        share
            The quantile, from 0 to 1.
        excused_s
            Sum of delays that the publisher did not cause; as many of the largest distances are left out.
        """
        if not len(self.intervals_s):
            return float("nan")
        off_s = np.abs(self.intervals_s - self.median_s)
        distances = np.sort(off_s)[::-1]
        if excused_s > 0:
            # A late sample lengthens one interval and shortens the next: two distances for one delay.
            sums = np.cumsum(distances)
            left_out = int(np.searchsorted(sums, 2 * excused_s, side="right"))
            distances = distances[left_out:]
        if not len(distances):
            return 0.0
        return float(np.quantile(distances, share))

    def contradicted_by_arrival(
        self, excused_s: float, delays: Iterable[Sequence[Delay]] = ()
    ) -> bool:
        """Return whether samples did not leave at their stamps, so that the publisher's process forged these.

        Parameters
        ----------
        excused_s
            Sum of delays on the way with unknown single values; as many of the latest samples are left out.
        delays
            Delays of each process on the way; they excuse samples within them.

        Notes
        -----
        Within a machine, a sample is received about 0.1 ms after it was written, or later if a process has no core.
        In 558 recorded topics of honest and hostile programs, on two cores with up to 14 processes ready to run, the
        times on the way differed by at most 1.0 ms, without those that a delay of the recorder explains.
        """
        stalled = round(2 * excused_s * self.rate_hz)
        if self.arrived is None or stalled > _MOST_STALLED * self.ways_ns.shape[1]:
            return False
        on_the_way = np.diff(self.ways_ns, axis=0)[0] / 1e9
        soonest = np.quantile(on_the_way, 0.1)
        for each in delays:
            if each:
                explained_ns = np.diff(delay_before(each, self.ways_ns), axis=0)[0]
                on_the_way -= explained_ns / 1e9
        kept = np.sort(on_the_way)[: len(on_the_way) - stalled]
        latest = np.quantile(kept, 0.9)
        return bool(latest - soonest > _UNEVEN_WAY_S)


@dataclass(frozen=True)
class _Samples:
    """Samples of a topic, in the order of their source timestamps: int64[n] each."""

    source_ns: Integers
    received_ns: Integers
    sequence: Integers

    def __len__(self) -> int:
        return len(self.sequence)

    def __getitem__(self, rows: np.typing.NDArray[np.bool_] | Integers) -> _Samples:
        return _Samples(self.source_ns[rows], self.received_ns[rows], self.sequence[rows])


def timing_of(stream: Stream, span: Span | None) -> Timing | None:
    """Measure a topic's timing within a span; None with fewer than three samples.

    Of several publishers, only the one with the most samples is measured.

    Notes
    -----
    The error of the rate is the jitter of the first and the last sample divided by the span: below 0.1 % for a span of
    seconds. The rate of samples that come in bursts is the slope of all samples instead.
    """
    samples = _Samples(stream.source_ns, stream.received_ns, stream.sequence)
    samples = samples[np.argsort(stream.source_ns, kind="stable")]
    if span is not None:
        has_begun = samples.source_ns >= span.start_ns
        samples = samples[has_begun & (samples.source_ns <= span.end_ns)]
    if len(samples) < _FEWEST_SAMPLES:
        return None
    samples = samples[_of_one_publisher(samples.sequence)]
    stamped = _timed(samples.source_ns, samples.sequence)
    if stamped is None:
        return None
    arrived = _timed(samples.received_ns, samples.sequence)
    ways_ns = np.stack((samples.source_ns, samples.received_ns))
    return replace(stamped, arrived=arrived, ways_ns=ways_ns)


def _timed(times_ns: Integers, sequence: Integers) -> Timing | None:
    """Measure samples of rising sequence numbers by their times."""
    if len(times_ns) < _FEWEST_SAMPLES or times_ns[-1] <= times_ns[0]:
        return None
    written = int(sequence[-1] - sequence[0])
    is_next = np.diff(sequence) == 1
    intervals_s = np.diff(times_ns)[is_next] / 1e9
    length_s = (times_ns[-1] - times_ns[0]) / 1e9
    rate_hz = float(written / length_s)
    error_hz = None
    if len(intervals_s) and np.median(intervals_s) < _BURSTS / rate_hz:
        rate_hz, error_hz = _slope(times_ns, sequence)
    count = written + 1
    missing = count - len(times_ns)
    ends_ns = times_ns[1:][is_next]
    numbers = sequence[1:][is_next]
    return Timing(rate_hz, count, missing, intervals_s, ends_ns, numbers, error_hz)


def _slope(times_ns: Integers, sequence: Integers) -> tuple[float, float]:
    """Return the slope of sequence numbers over time, and its error, both in Hz.

    Notes
    -----
    The samples of a burst depend on each other, and the number n of bursts counts: the error of the slope is
    twice that of n independent values, ``residual · √(12/n) / length``.
    """
    times_s = (times_ns - times_ns[0]) / np.float64(1e9)
    numbers = sequence - sequence[0]
    slope, start = np.polyfit(times_s, numbers.astype(np.float64), 1)
    residual = float(np.std(numbers - slope * times_s - start))
    length_s = float(times_s[-1])
    longest_s = float(np.diff(times_s).max())
    bursts = max(2.0, length_s / longest_s)
    error_hz = 2 * residual * float(np.sqrt(12 / bursts)) / length_s
    return float(slope), error_hz


def _of_one_publisher(sequence: Integers) -> Integers:
    """Return the rows of the publisher with the most samples: their numbers follow one another.

    A number missing between two runs was lost, if the first run ended before the second began.
    """
    if (np.diff(sequence) > 0).all():
        return np.arange(len(sequence))
    numbers = sequence.tolist()
    whole: list[list[int]] = []
    for run in _runs(numbers):
        continued = _continued(whole[-_MOST_PUBLISHERS:], run, numbers)
        if continued is None:
            whole.append(run)
        else:
            continued.extend(run)
    return np.array(max(whole, key=len))


def _runs(numbers: Sequence[int]) -> list[list[int]]:
    """Return runs of rows with consecutive numbers, in the order of their first rows."""
    runs: list[list[int]] = []
    ends: dict[int, list[list[int]]] = {}
    for row, number in enumerate(numbers):
        open_runs = []
        for run in ends.pop(number - 1, ()):
            if row - run[-1] <= _MOST_PUBLISHERS:
                open_runs.append(run)
        if open_runs:
            run, *ends[number - 1] = open_runs
        else:
            run = []
            runs.append(run)
        run.append(row)
        ends.setdefault(number, []).append(run)
    return runs


def _continued(
    runs: Sequence[list[int]], next_run: list[int], numbers: Sequence[int]
) -> list[int] | None:
    """Return the run that another continues with the fewest samples lost between; None if there is none."""
    first = next_run[0]
    by_loss: dict[int, list[int]] = {}
    for run in runs:
        if run[-1] < first:
            lost = numbers[first] - numbers[run[-1]]
            by_loss[lost] = run
    for lost in sorted(by_loss):
        run = by_loss[lost]
        if 0 < lost <= _MOST_LOST * (first - run[-1]):
            return run
    return None
