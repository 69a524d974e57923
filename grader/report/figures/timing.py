"""Times of messages: intervals, rates and latencies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from grader.evidence.recorded import Booleans, Floats, Integers, NumericStream, Recorded
from grader.evidence.timing import Timing, timing_of
from grader.lab import references as ref
from grader.report.escape import line
from grader.report.figures.svg import (
    BOTTOM,
    MOST_POINTS,
    RIGHT,
    SINCE,
    Canvas,
    Figure,
    FigureKind,
    Frame,
    Range,
    duration,
    short,
)
from ros_bag.reading import Stream

RATE_BIN_S = 0.5
HISTOGRAM_BINS = 41
#: Distance of a source timestamp from the message's arrival, in ns. Larger distances cannot be drawn to scale; a program
#: can send any timestamp.
_FAR_NS = 10_000_000_000
#: Longest time between the first message and a later one, in ns.
_LONGEST_NS = 3600 * 10**9
_HEIGHT = 260


def stamped_near_arrival(stream: Stream | NumericStream) -> Booleans:
    """Return which messages were stamped near their arrival: bool[n]."""
    near: Booleans = np.abs(stream.source_ns - stream.received_ns) < _FAR_NS
    return near


def plausible(stream: Stream) -> Stream:
    """Return the messages of a stream that were stamped near their arrival and arrived near the first one."""
    first_ns = stream.received_ns.min() if len(stream) else 0
    stamped_near = stamped_near_arrival(stream)
    arrived_near = stream.received_ns - first_ns < _LONGEST_NS
    return stream.only(stamped_near & arrived_near)


class ExpectedRate(FigureKind):
    """A topic, and the rate at which messages are expected on it."""

    topic: ref.Topic
    rate_hz: float = Field(gt=0)


# -- intervals ---------------------------------------------------------------------------------


class Intervals(ExpectedRate):
    """Histogram of the times between consecutive messages, around the expected one."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the intervals as bars."""
        timing = timing_of(plausible(recorded.stream(self.topic)), None)
        if timing is None or not len(timing.intervals_s):
            return None
        topic = recorded.used(self.topic)
        histogram = _Histogram.of(topic, timing.intervals_s, 1 / self.rate_hz)
        return Figure(histogram.caption(timing), histogram.paint, half=True)


@dataclass(frozen=True)
class _Histogram:
    """Intervals between the messages of a topic, counted in bins."""

    topic: str
    intervals_s: Floats
    expected_s: float
    #: float64[HISTOGRAM_BINS + 1]: The expected interval is in the middle bin, unless the first bin is cut at 0.
    edges_s: Floats
    counts: Integers

    @classmethod
    def of(cls, topic: str, intervals_s: Floats, expected_s: float) -> _Histogram:
        """Count intervals in bins that reach as far as 99 % of them, within limits."""
        outer_s = np.quantile(intervals_s, [0.005, 0.995])
        reach_s = float(np.max(np.abs(outer_s - expected_s))) * 1.25
        reach_s = max(reach_s, 0.05 * expected_s)
        reach_s = min(reach_s, 5 * expected_s)
        lowest_s = max(0.0, expected_s - reach_s)
        edges_s = np.linspace(lowest_s, expected_s + reach_s, HISTOGRAM_BINS + 1)
        counts, _ = np.histogram(intervals_s, edges_s)
        return cls(topic, intervals_s, expected_s, edges_s, counts)

    def caption(self, timing: Timing) -> str:
        low_s, high_s = np.quantile(self.intervals_s, [0.025, 0.975])
        return (
            f"{len(self.intervals_s)} intervals, median {duration(timing.median_s)}; "
            f"95 % lie between {duration(low_s)} and {duration(high_s)}. "
            f"Expected: {duration(self.expected_s)}."
        )

    def paint(self, canvas: Canvas) -> None:
        highest = max(1, *self.counts) * 1.05
        x = Range(self.edges_s[0], self.edges_s[-1])
        frame = canvas.frame(_HEIGHT, x, Range(0, highest), top=32)
        frame.y_axis(4)
        self._paint_bars(frame)
        self._mark_expected(frame)
        self._count_outside(frame)
        self._label(frame)

    def _paint_bars(self, frame: Frame) -> None:
        bins = itertools.pairwise(self.edges_s)
        for (low_s, high_s), count in zip(bins, self.counts, strict=True):
            if count:
                left = frame.px(low_s) + 0.5
                width = max(1.0, frame.px(high_s) - left - 0.5)
                top = frame.py(count)
                frame.canvas.rect(left, top, width, frame.bottom - top, "bar")

    def _mark_expected(self, frame: Frame) -> None:
        canvas = frame.canvas
        x = frame.px(self.expected_s)
        canvas.vertical(x, frame.top - 8, frame.bottom, "expected")
        words = f"expected {duration(self.expected_s)}"
        canvas.text(x, frame.top - 14, words, class_="note")

    def _count_outside(self, frame: Frame) -> None:
        canvas = frame.canvas
        y = frame.top + 8
        shorter = int(np.sum(self.intervals_s < self.edges_s[0]))
        if shorter:
            canvas.text(frame.left + 4, y, f"{shorter} shorter", "start", "note")
        longer = int(np.sum(self.intervals_s > self.edges_s[-1]))
        if longer:
            canvas.text(frame.right, y, f"{longer} longer", "end", "note")

    def _label(self, frame: Frame) -> None:
        scale, unit = 1e3, "ms"
        if self.edges_s[-1] >= 1:
            scale, unit = 1.0, "s"
        label = f"time between messages on {line(self.topic, 30)}, {unit}"
        frame.x_axis(label, scale)


# -- rates -------------------------------------------------------------------------------------


class Rate(ExpectedRate):
    """Messages written a second, over time."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the rate in each bin, by the publisher's sequence numbers, with the expected one."""
        stream = plausible(recorded.stream(self.topic))
        order = np.argsort(stream.source_ns, kind="stable")
        times_s = recorded.seconds(stream.source_ns[order])
        if len(times_s) < 3 or times_s[-1] <= times_s[0]:
            return None
        edges_s, rates_hz = _rates(times_s, stream.sequence[order])
        chart = _Rates(recorded.used(self.topic), self.rate_hz, edges_s, rates_hz)
        return Figure(chart.caption, chart.paint, half=True)


@dataclass(frozen=True)
class _Rates:
    """The rate on a topic over time, drawn as steps."""

    topic: str
    expected_hz: float
    edges_s: Floats
    #: float64[n]: Rates between the n + 1 edges.
    rates_hz: Floats

    @property
    def caption(self) -> str:
        topic = line(self.topic, 60)
        lowest = short(min(self.rates_hz))
        highest = short(max(self.rates_hz))
        length_s = self.edges_s[-1] - self.edges_s[0]
        bin_s = length_s / len(self.rates_hz)
        return (
            f"Between {lowest} and {highest} messages a second on {topic}, "
            f"each step over {duration(bin_s)}. Expected: {short(self.expected_hz)}."
        )

    @property
    def range(self) -> Range:
        """Rates around the expected one, down to 0 if the recorded ones reach half of the way."""
        expected = self.expected_hz
        farthest = max(np.abs(self.rates_hz - expected))
        reach = max(0.1 * expected, farthest * 1.2)
        if reach >= 0.5 * expected:
            low = 0.0
        else:
            low = expected - reach
        return Range(low, expected + reach)

    def paint(self, canvas: Canvas) -> None:
        x = Range(self.edges_s[0], self.edges_s[-1])
        frame = canvas.frame(_HEIGHT, x, self.range, top=32)
        frame.y_axis(5)
        canvas.text(4, 16, "messages a second", "start", "label")
        self._mark_expected(frame)
        times_s = np.repeat(self.edges_s, 2)[1:-1]
        frame.line(times_s, np.repeat(self.rates_hz, 2), "line line-0")
        frame.x_axis(SINCE)

    def _mark_expected(self, frame: Frame) -> None:
        frame.level(self.expected_hz, "expected")
        words = f"dashed: expected {short(self.expected_hz)} Hz"
        frame.canvas.text(frame.right, frame.top - 6, words, "end", "note")


def _rates(times_s: Floats, sequence: Integers) -> tuple[Floats, Floats]:
    """Return the edges of bins in s, and the rate in each bin in Hz.

    Parameters
    ----------
    times_s
        float64[n]: Source timestamps in ascending order.
    sequence
        int64[n]: Publication sequence numbers of the same messages.
    """
    written = sequence
    if not np.all(np.diff(sequence) > 0):
        # Numbers of several publishers interleave; only the recorded messages can be counted.
        written = np.arange(len(times_s), dtype=np.int64)
    edges_s = _bin_edges(times_s[0], times_s[-1])
    # Whole messages per bin would round the rate; the number is interpolated linearly between two messages.
    numbers = np.interp(edges_s, times_s, written)
    return edges_s, np.diff(numbers) / np.diff(edges_s)


def _bin_edges(first_s: float, last_s: float) -> Floats:
    """Return the edges of bins of `RATE_BIN_S`, or of equal bins if these do not fit."""
    bins = max(1, round(float(last_s - first_s) / RATE_BIN_S))
    bins = min(bins, MOST_POINTS)
    edges_s = first_s + RATE_BIN_S * np.arange(bins + 1, dtype=np.float64)
    if bins == MOST_POINTS or edges_s[-1] > last_s:
        return np.linspace(first_s, last_s, bins + 1)
    return edges_s


# -- latencies ---------------------------------------------------------------------------------

#: Shortest latency on the logarithmic axis, in s.
_FLOOR_S = 1e-6
#: Height of a topic's row and upper end of the first row in px.
_ROW, _TOP = 62, 8


class Latency(FigureKind):
    """Times from sending to arrival at the recorder, by topic."""

    topics: tuple[ref.Topic, ...]

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw each topic's latencies as a box over a strip of single messages, on a logarithmic axis."""
        by_topic: dict[str, _Latencies] = {}
        for topic in self.topics:
            stream = plausible(recorded.stream(topic))
            if len(stream):
                used = recorded.used(topic)
                delays_s = (stream.received_ns - stream.source_ns) / 1e9
                by_topic[used] = _Latencies(used, delays_s)
        if not by_topic:
            return None
        chart = _LatencyChart(list(by_topic.values()))
        key = (("box", "middle half, line at the median"), ("dot", "single messages"))
        return Figure(chart.caption, chart.paint, key)


@dataclass(frozen=True)
class _Latencies:
    """The latencies of a topic's messages in s, in the order of arrival."""

    topic: str
    delays_s: Floats

    @property
    def few_s(self) -> Floats:
        """Latencies of some messages, evenly chosen."""
        count = len(self.delays_s)
        shown = min(count, MOST_POINTS // 2)
        places = np.linspace(0, count - 1, shown).astype(int)
        few_s: Floats = self.delays_s[np.unique(places)]
        return few_s

    @property
    def sentence(self) -> str:
        """Sentence of the caption."""
        half_s, most_s = np.quantile(self.delays_s, [0.5, 0.95])
        longest_s = self.delays_s.max()
        return (
            f"{line(self.topic, 60)}: half within {duration(half_s)}, "
            f"95 % within {duration(most_s)}, longest {duration(longest_s)}."
        )

    def paint(self, frame: Frame, top: float) -> None:
        label = f"{line(self.topic, 40)} ({len(self.delays_s)})"
        frame.canvas.text(frame.left, top + 14, label, "start", "label")
        self._paint_messages(frame, top + 43)
        self._paint_box(frame, top + 34)

    def _paint_messages(self, frame: Frame, top: float) -> None:
        """Draw some messages as dots in a strip."""
        canvas = frame.canvas
        few_s = self.few_s
        if canvas.narrow:
            few_s = few_s[::2]
        # Multiples of the golden ratio spread the dots evenly over the strip's height, without chance.
        heights = top + 9 * (np.arange(len(few_s)) * 0.618034 % 1.0)
        places = [_place(frame, delay_s) for delay_s in few_s]
        canvas.dots(zip(places, heights, strict=True), 1.6, "dots faint")

    def _paint_box(self, frame: Frame, middle: float) -> None:
        """Draw the middle 90 % and the middle half of the latencies."""
        canvas = frame.canvas
        bounds_s = np.quantile(self.delays_s, [0.05, 0.25, 0.5, 0.75, 0.95])
        places = [_place(frame, bound_s) for bound_s in bounds_s]
        low, first_quarter, median, third_quarter, high = places
        canvas.horizontal(low, high, middle, "whisker")
        width = max(2.0, third_quarter - first_quarter)
        canvas.rect(first_quarter, middle - 7, width, 14, "box")
        canvas.vertical(median, middle - 7, middle + 7, "median")


@dataclass(frozen=True)
class _LatencyChart:
    """The latencies of some topics, one row each."""

    topics: Sequence[_Latencies]

    @property
    def caption(self) -> str:
        return " ".join(topic.sentence for topic in self.topics)

    @property
    def range(self) -> Range:
        """Logarithms of the latencies that are drawn."""
        shortest_s = min(topic.few_s.min() for topic in self.topics)
        longest_s = max(topic.delays_s.max() for topic in self.topics)
        return Range(_logarithm(shortest_s) - 0.1, _logarithm(longest_s) + 0.1)

    def paint(self, canvas: Canvas) -> None:
        x = self.range
        height = _TOP + _ROW * len(self.topics) + BOTTOM + 4
        canvas.height = height
        frame = Frame(canvas, 14, _TOP, canvas.width - RIGHT, height - BOTTOM, x, Range(0, 1))
        dense = not canvas.narrow or x.high - x.low < 2
        frame.log_axis(_TOP, frame.bottom + 4, dense=dense)
        for n, topic in enumerate(self.topics):
            topic.paint(frame, _TOP + _ROW * n)
        label = "from sending to the recorder (logarithmic)"
        canvas.text(frame.middle, frame.bottom + 36, label, class_="label")


def _logarithm(seconds: float) -> float:
    return math.log10(max(seconds, _FLOOR_S))


def _place(frame: Frame, seconds: float) -> float:
    """Return the position of a time on a logarithmic axis in px."""
    return frame.px(_logarithm(seconds))
