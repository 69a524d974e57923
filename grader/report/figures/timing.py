"""When messages were sent and how long they took: intervals, rates, latencies."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from markupsafe import Markup
from pydantic import Field

from grader.evidence.recorded import Floats, Integers, Recorded
from grader.evidence.timing import timing_of
from grader.lab import references as ref
from grader.recording.bag import Stream
from grader.report.escape import line
from grader.report.figures import svg
from grader.report.figures.svg import SINCE, Figure, FigureKind, Frame

RATE_BIN_S = 0.5
HISTOGRAM_BINS = 41
#: A source timestamp comes over the wire; one that far from the arrival cannot be drawn to scale.
FAR_NS = 10_000_000_000


def plausible(stream: Stream) -> Stream:
    """Return the messages that were stamped near their arrival, and arrived near the first one."""
    early = stream.received_ns.min() if len(stream) else 0
    near = np.abs(stream.source_ns - stream.received_ns) < FAR_NS
    return stream.only(near & (stream.received_ns - early < 3600 * 10**9))


class ExpectedRate(FigureKind):
    """A topic, and at which rate messages are expected on it."""

    topic: ref.Topic
    rate_hz: float = Field(gt=0)


class Intervals(ExpectedRate):
    """Histogram of the times between consecutive messages, around the expected one."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the bins, the middle one around the expected interval unless it is cut at 0."""
        timing = timing_of(plausible(recorded.stream(self.topic)), None)
        if timing is None or not len(timing.intervals_s):
            return None
        intervals, expected = timing.intervals_s, 1 / self.rate_hz
        spread = float(np.max(np.abs(np.quantile(intervals, [0.005, 0.995]) - expected))) * 1.25
        span = min(max(spread, 0.05 * expected), 5 * expected)
        edges = np.linspace(max(0.0, expected - span), expected + span, HISTOGRAM_BINS + 1)
        counts, _ = np.histogram(intervals, edges)
        scale, unit = (1.0, "s") if edges[-1] >= 1 else (1e3, "ms")

        def paint(width: int) -> tuple[float, list[Markup]]:
            frame = svg.frame_in(
                width, 260, (edges[0], edges[-1]), (0, max(1, *counts) * 1.05), top=32
            )
            parts = frame.y_axis(4)
            for left, right, count in zip(edges, edges[1:], counts, strict=False):
                if count:
                    x, y = frame.px(left) + 0.5, frame.py(count)
                    parts.append(
                        svg.rect(x, y, max(1.0, frame.px(right) - x - 0.5), frame.bottom - y, "bar")
                    )
            at = frame.px(expected)
            parts.append(svg.rule(at, frame.top - 8, at, frame.bottom, "expected"))
            parts.append(
                svg.text(at, frame.top - 14, f"expected {svg.duration(expected)}", class_="note")
            )
            if shorter := int(np.sum(intervals < edges[0])):
                parts.append(
                    svg.text(frame.left + 4, frame.top + 8, f"{shorter} shorter", "start", "note")
                )
            if longer := int(np.sum(intervals > edges[-1])):
                parts.append(
                    svg.text(frame.right, frame.top + 8, f"{longer} longer", "end", "note")
                )
            label = f"time between messages on {line(recorded.used(self.topic), 30)}, {unit}"
            return 260, parts + frame.x_axis(label, scale)

        low, high = np.quantile(intervals, [0.025, 0.975])
        caption = (
            f"{len(intervals)} intervals, median {svg.duration(timing.median_s)}; 95 % lie between {svg.duration(low)} "
            f"and {svg.duration(high)}. Expected: {svg.duration(expected)}."
        )
        return Figure(caption, paint, half=True)


class Rate(ExpectedRate):
    """Messages written a second, over time."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the rate in each bin, by the publisher's sequence numbers, with the expected one."""
        stream = plausible(recorded.stream(self.topic))
        order = np.argsort(stream.source_ns, kind="stable")
        times = recorded.seconds(stream.source_ns[order])
        if len(times) < 3 or times[-1] <= times[0]:
            return None
        edges, rates = _rates(times, stream.sequence[order])
        expected = self.rate_hz
        reach = max(0.1 * expected, max(np.abs(rates - expected)) * 1.2)
        bottom = 0.0 if reach >= 0.5 * expected else expected - reach

        def paint(width: int) -> tuple[float, list[Markup]]:
            frame = svg.frame_in(
                width, 260, (edges[0], edges[-1]), (bottom, expected + reach), top=32
            )
            at = frame.py(expected)
            parts = [
                *frame.y_axis(5),
                svg.text(4, 16, "messages a second", "start", "label"),
                svg.rule(frame.left, at, frame.right, at, "expected"),
                svg.text(
                    frame.right,
                    frame.top - 6,
                    f"dashed: expected {svg.short(expected)} Hz",
                    "end",
                    "note",
                ),
                frame.path(np.repeat(edges, 2)[1:-1], np.repeat(rates, 2), "line line-0"),
            ]
            return 260, parts + frame.x_axis(SINCE)

        caption = (
            f"Between {svg.short(min(rates))} and {svg.short(max(rates))} messages a second on "
            f"{line(recorded.used(self.topic), 60)}, each step over "
            f"{svg.duration((edges[-1] - edges[0]) / len(rates))}. Expected: {svg.short(expected)}."
        )
        return Figure(caption, paint, half=True)


def _rates(times: Floats, sequence: Integers) -> tuple[Floats, Floats]:
    """Return bins' edges in s and the messages written a second in each."""
    # Several publishers' numbers interleave, so that what arrived is all that can be counted.
    written = sequence if np.all(np.diff(sequence) > 0) else np.arange(len(times), dtype=np.int64)
    bins = min(max(1, round(float(times[-1] - times[0]) / RATE_BIN_S)), svg.MOST_POINTS)
    edges = times[0] + RATE_BIN_S * np.arange(bins + 1)
    if bins == svg.MOST_POINTS or edges[-1] > times[-1]:
        edges = np.linspace(times[0], times[-1], bins + 1)
    # Between two messages the number written grows in a straight line: no bin is rounded to whole ones.
    return edges, np.diff(np.interp(edges, times, written)) / np.diff(edges)


class Latency(FigureKind):
    """Times from sending to arrival at the recorder, by topic."""

    topics: tuple[ref.Topic, ...]

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw each topic's latencies as a box over a strip of single messages, on a logarithmic axis."""
        streams = {recorded.used(topic): plausible(recorded.stream(topic)) for topic in self.topics}
        delays = {
            topic: (s.received_ns - s.source_ns) / 1e9 for topic, s in streams.items() if len(s)
        }
        if not delays:
            return None
        # Of each topic some messages, in the order of arrival.
        few = {
            t: d[
                np.unique(np.linspace(0, len(d) - 1, min(len(d), svg.MOST_POINTS // 2)).astype(int))
            ]
            for t, d in delays.items()
        }
        x = (
            math.log10(max(min(map(min, few.values())), _FLOOR_S)) - 0.1,
            math.log10(max(max(map(max, delays.values())), _FLOOR_S)) + 0.1,
        )

        def paint(width: int) -> tuple[float, list[Markup]]:
            row, top = 62, 8
            height = top + row * len(delays) + svg.BOTTOM + 4
            frame = Frame(14, top, width - svg.RIGHT, height - svg.BOTTOM, x, (0, 1))
            parts = frame.log_axis(
                top, frame.bottom + 4, dense=width > svg.NARROW or x[1] - x[0] < 2
            )
            for n, (topic, all_s) in enumerate(delays.items()):
                label = f"{line(topic, 40)} ({len(all_s)})"
                parts.append(svg.text(frame.left, top + row * n + 14, label, "start", "label"))
                parts += _box(
                    frame, all_s, few[topic][:: 2 if width == svg.NARROW else 1], top + row * n + 34
                )
            middle = (frame.left + frame.right) / 2
            label = "from sending to the recorder (logarithmic)"
            return height, [*parts, svg.text(middle, frame.bottom + 36, label, class_="label")]

        caption = " ".join(
            f"{line(topic, 60)}: half within {svg.duration(np.quantile(d, 0.5))}, "
            f"95 % within {svg.duration(np.quantile(d, 0.95))}, longest {svg.duration(d.max())}."
            for topic, d in delays.items()
        )
        return Figure(
            caption, paint, (("box", "middle half, line at the median"), ("dot", "single messages"))
        )


#: A logarithmic axis has no place for what is less.
_FLOOR_S = 1e-6


def _box(frame: Frame, delays: Floats, few: Floats, middle: float) -> list[Markup]:
    """Return the middle 90 % and the middle half of latencies, and some of them below."""
    # The golden ratio spreads the points evenly over the strip's height without chance.
    heights = middle + 9 + 9 * (np.arange(len(few)) * 0.618034 % 1.0)
    places = [frame.px(math.log10(max(delay, _FLOOR_S))) for delay in few]
    parts = [
        svg.tag("circle", cx=x, cy=y, r=1.6, class_="dot faint")
        for x, y in zip(places, heights, strict=True)
    ]
    bounds = np.quantile(delays, [0.05, 0.25, 0.5, 0.75, 0.95])
    low, quarter, median, three_quarters, high = (
        frame.px(math.log10(max(b, _FLOOR_S))) for b in bounds
    )
    return [
        *parts,
        svg.rule(low, middle, high, middle, "whisker"),
        svg.rect(quarter, middle - 7, max(2.0, three_quarters - quarter), 14, "box"),
        svg.rule(median, middle - 7, median, middle + 7, "median"),
    ]
