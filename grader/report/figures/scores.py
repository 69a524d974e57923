"""How the points of a class are spread."""

from __future__ import annotations

from markupsafe import Markup

from grader.cohort.statistics import Spread
from grader.report.figures.svg import BOTTOM, Figure, Frame, rect, rule, short, text
from grader.report.views import tenths


def scores_figure(spread: Spread) -> Figure:
    """Draw how many have how many points, with the median and the middle half."""
    possible = float(spread.possible) or 1.0

    def paint(width: int) -> tuple[float, list[Markup]]:
        frame = Frame(
            14,
            44,
            width - 14,
            250 - BOTTOM,
            (0, possible),
            (0, max(bar.count for bar in spread.bars)),
        )
        quarters = (spread.first_quartile, spread.median, spread.third_quartile)
        low, middle, high = (
            frame.px(min(possible, max(0.0, float(quarter)))) for quarter in quarters
        )
        parts = [rect(low, frame.top - 10, high - low, frame.bottom - frame.top + 10, "quartiles")]
        for bar in spread.bars:
            if bar.count:
                x, y = frame.px(float(bar.low)) + 2, frame.py(bar.count)
                wide = frame.px(float(bar.high)) - x - 2
                parts.append(rect(x, y, wide, frame.bottom - y, "bar", rx=2))
                parts.append(text(x + wide / 2, y - 6, str(bar.count), class_="note"))
        parts.append(rule(middle, frame.top - 16, middle, frame.bottom, "expected"))
        anchor = "end" if middle > width * 0.8 else "start" if middle < width * 0.2 else "middle"
        parts.append(
            text(middle, frame.top - 24, f"median {tenths(spread.median)}", anchor, "label")
        )
        return 250, parts + frame.x_axis("points")

    caption = (
        f"{spread.count} graded. Bars are {short(possible / len(spread.bars))} points wide. "
        f"The middle half, shaded, has {tenths(spread.first_quartile)} to {tenths(spread.third_quartile)} points."
    )
    return Figure(caption, paint, half=True, title="How the points are spread")
