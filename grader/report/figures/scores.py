"""The distribution of points in a class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from grader.cohort.statistics import Bar, Spread
from grader.report.figures.svg import BOTTOM, Canvas, Figure, Frame, Range, short
from grader.report.views import tenths

_HEIGHT = 250


def scores_figure(spread: Spread) -> Figure:
    """Draw the number of submissions by points, with the median and the middle half."""
    histogram = _Histogram(spread, float(spread.possible) or 1.0)
    return Figure(histogram.caption, histogram.paint, half=True, title="How the points are spread")


@dataclass(frozen=True)
class _Histogram:
    """The distribution of points, drawn as bars."""

    spread: Spread
    #: Points at the right edge.
    possible: float

    @property
    def caption(self) -> str:
        spread = self.spread
        width = short(self.possible / len(spread.bars))
        first, third = tenths(spread.first_quartile), tenths(spread.third_quartile)
        return (
            f"{spread.count} graded. Bars are {width} points wide. "
            f"The middle half, shaded, has {first} to {third} points."
        )

    def paint(self, canvas: Canvas) -> None:
        canvas.height = _HEIGHT
        highest = max(bar.count for bar in self.spread.bars)
        points, counts = Range(0, self.possible), Range(0, highest)
        frame = Frame(canvas, 14, 44, canvas.width - 14, _HEIGHT - BOTTOM, points, counts)
        self._shade_middle_half(frame)
        _paint_bars(frame, self.spread.bars)
        self._mark_median(frame)
        frame.x_axis("points")

    def _shade_middle_half(self, frame: Frame) -> None:
        first = frame.px(frame.x.clip(float(self.spread.first_quartile)))
        third = frame.px(frame.x.clip(float(self.spread.third_quartile)))
        height = frame.bottom - frame.top + 10
        frame.canvas.rect(first, frame.top - 10, third - first, height, "quartiles")

    def _mark_median(self, frame: Frame) -> None:
        canvas = frame.canvas
        x = frame.px(frame.x.clip(float(self.spread.median)))
        canvas.vertical(x, frame.top - 16, frame.bottom, "expected")
        anchor = "middle"
        if x > canvas.width * 0.8:
            anchor = "end"
        elif x < canvas.width * 0.2:
            anchor = "start"
        label = f"median {tenths(self.spread.median)}"
        canvas.text(x, frame.top - 24, label, anchor, "label")


def _paint_bars(frame: Frame, bars: Sequence[Bar]) -> None:
    canvas = frame.canvas
    for bar in bars:
        if not bar.count:
            continue
        left = frame.px(float(bar.low)) + 2
        width = frame.px(float(bar.high)) - left - 2
        top = frame.py(bar.count)
        canvas.rect(left, top, width, frame.bottom - top, "bar", rx=2)
        canvas.text(left + width / 2, top - 6, str(bar.count), class_="note")
