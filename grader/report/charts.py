"""Pictures as inline SVG: axes, lines and marks from the data of `grader.evidence.figures`.

Colours and letters come from the page's style sheet by class, so that a picture follows light, dark and
print. A picture that is wide on a desk has a narrow form for a phone, so that its letters stay legible.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from grader.cohort.summary import Spread
from grader.evidence.figures import (
    Calls,
    Distribution,
    Figure,
    Intervals,
    Latency,
    Line,
    Rate,
    Reports,
    Series,
)
from grader.report.untrusted import line as one_line
from grader.report.views import tenths

WIDE, HALF, NARROW = 920, 440, 400
_LEFT, _RIGHT, _TOP, _BOTTOM = 50, 14, 14, 44
_NARROW_POINTS = 160
_SINCE = "seconds since the session's start"


@dataclass(frozen=True)
class Chart:
    """One picture in its forms.

    Attributes
    ----------
    wide : Markup
        For a desk and for print.
    narrow : Markup or None
        For a phone; None where the first form serves there too.
    caption : str
        What it shows, in words and numbers.
    key : tuple of (str, str)
        Style class and meaning of each sort of mark.
    """

    wide: Markup
    narrow: Markup | None
    caption: str
    key: tuple[tuple[str, str], ...] = ()

    @property
    def half(self) -> bool:
        """Whether two of this kind fit side by side."""
        return self.narrow is None


# -- words and numbers -------------------------------------------------------------------------


def duration(seconds: float) -> str:
    """Write a short time with the unit that suits it."""
    size = abs(seconds)
    if size >= 1 or size == 0:
        return f"{_short(seconds)} s"
    return f"{_short(seconds * 1e3)} ms" if size >= 1e-3 else f"{_short(seconds * 1e6)} µs"


def _short(value: float) -> str:
    """Write a number with three significant digits."""
    if not math.isfinite(value):
        return str(value)
    if value and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.2e}"
    digits = 2 - math.floor(math.log10(abs(value))) if value else 0
    text = f"{value:.{max(0, digits)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers between two bounds, at most about `most`."""
    if not math.isfinite(high - low) or high <= low:
        return [low]
    raw = (high - low) / max(1, most)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [n * step for n in range(first, math.floor(high / step + 1e-9) + 1)]


def _padded(values: Iterable[float], share: float = 0.08, least: float = 1e-9) -> tuple[float, float]:
    """Return bounds with some air around values."""
    known = list(values)
    low, high = min(known), max(known)
    air = max((high - low) * share, least)
    return low - air, high + air


# -- SVG ---------------------------------------------------------------------------------------


def _tag(name: str, content: str | Markup = "", **attributes: str | float) -> Markup:
    """Return an element; `class_` and `text_anchor` become class and text-anchor."""
    parts = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(_coordinate(value))}"' for key, value in attributes.items()
    )
    return Markup(f"<{name}{parts}>{escape(content)}</{name}>")


def _coordinate(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.1f}".removesuffix(".0")


def _text(x: float, y: float, text: str, anchor: str = "middle", class_: str = "tick") -> Markup:
    return _tag("text", text, x=x, y=y, text_anchor=anchor, class_=class_)


def _rule(x1: float, y1: float, x2: float, y2: float, class_: str) -> Markup:
    return _tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=class_)


def _svg(width: float, height: float, name: str, title: str, caption: str, parts: Iterable[Markup]) -> Markup:
    heads = _tag("title", title, id=f"{name}-t") + _tag("desc", caption, id=f"{name}-d")
    return _tag(
        "svg",
        heads + Markup("").join(parts),
        viewBox=f"0 0 {width} {height}",
        role="img",
        aria_labelledby=f"{name}-t {name}-d",
        class_="chart",
    )


@dataclass(frozen=True)
class _Frame:
    """A rectangle of the picture, and the numbers at its edges."""

    left: float
    top: float
    right: float
    bottom: float
    x: tuple[float, float]
    y: tuple[float, float]

    def px(self, value: float) -> float:
        low, high = self.x
        return self.left + (self.right - self.left) * (value - low) / ((high - low) or 1.0)

    def py(self, value: float) -> float:
        low, high = self.y
        return self.bottom - (self.bottom - self.top) * (value - low) / ((high - low) or 1.0)

    def path(self, times: Sequence[float], values: Sequence[float], class_: str) -> Markup:
        points = " ".join(f"{self.px(t):.1f},{self.py(v):.1f}" for t, v in zip(times, values, strict=True))
        return _tag("polyline", points=points, class_=class_)

    def y_axis(self, most: int = 5, scale: float = 1.0) -> list[Markup]:
        parts = []
        for value in _ticks(self.y[0] * scale, self.y[1] * scale, most):
            at = self.py(value / scale)
            parts.append(_rule(self.left, at, self.right, at, "grid"))
            parts.append(_text(self.left - 7, at + 4, _short(value), "end"))
        return parts

    def x_axis(self, label: str, scale: float = 1.0) -> list[Markup]:
        parts = [_rule(self.left, self.bottom, self.right, self.bottom, "axis")]
        for value in _ticks(self.x[0] * scale, self.x[1] * scale, round((self.right - self.left) / 75)):
            at = self.px(value / scale)
            parts.append(_rule(at, self.bottom, at, self.bottom + 4, "axis"))
            parts.append(_text(at, self.bottom + 17, _short(value)))
        parts.append(_text((self.left + self.right) / 2, self.bottom + 36, label, class_="label"))
        return parts


def _frame(width: float, height: float, x: tuple[float, float], y: tuple[float, float], top: float = _TOP) -> _Frame:
    return _Frame(_LEFT, top, width - _RIGHT, height - _BOTTOM, x, y)


def _both(
    name: str, title: str, caption: str, paint: Callable[[int], tuple[float, list[Markup]]]
) -> tuple[Markup, Markup]:
    """Paint a picture in its wide and its narrow form."""
    images = []
    for suffix, width in (("w", WIDE), ("n", NARROW)):
        height, parts = paint(width)
        images.append(_svg(width, height, f"{name}-{suffix}", title, caption, parts))
    return images[0], images[1]


@functools.singledispatch
def chart_of(figure: Figure, name: str) -> Chart | None:
    """Draw a figure; None for one that is a table or a tree, which the template writes.

    Parameters
    ----------
    name : str
        Unique in the page.
    """
    return None


# -- timing ------------------------------------------------------------------------------------


@chart_of.register
def intervals_chart(figure: Intervals, name: str) -> Chart:
    """Draw the histogram of a topic's intervals around the expected one."""
    width, height = HALF, 260
    total = sum(figure.counts) + figure.below + figure.above
    low, high = figure.edges_s[0], figure.edges_s[-1]
    scale, unit = (1.0, "s") if high >= 1 else (1e3, "ms")
    frame = _frame(width, height, (low, high), (0, max(1, *figure.counts) * 1.05), top=32)
    parts = frame.y_axis(4)
    for left, right, count in zip(figure.edges_s, figure.edges_s[1:], figure.counts, strict=False):
        if count:
            x, y = frame.px(left) + 0.5, frame.py(count)
            thick = max(1.0, frame.px(right) - x - 0.5)
            parts.append(_tag("rect", x=x, y=y, width=thick, height=frame.bottom - y, class_="bar"))
    at = frame.px(figure.expected_s)
    parts.append(_rule(at, frame.top - 8, at, frame.bottom, "expected"))
    parts.append(_text(at, frame.top - 14, f"expected {duration(figure.expected_s)}", class_="note"))
    if figure.below:
        parts.append(_text(frame.left + 4, frame.top + 8, f"{figure.below} shorter", "start", "note"))
    if figure.above:
        parts.append(_text(frame.right, frame.top + 8, f"{figure.above} longer", "end", "note"))
    parts += frame.x_axis(f"time between messages on {one_line(figure.topic, 30)}, {unit}", scale)
    caption = (
        f"{total} intervals, median {duration(figure.median_s)}; 95 % lie between {duration(figure.low_s)} "
        f"and {duration(figure.high_s)}. Expected: {duration(figure.expected_s)}."
    )
    return Chart(_svg(width, height, name, figure.title, caption, parts), None, caption)


@chart_of.register
def rate_chart(figure: Rate, name: str) -> Chart:
    """Draw a topic's rate over time with the expected one."""
    width, height = HALF, 260
    largest = max(abs(rate - figure.expected_hz) for rate in figure.rates_hz) * 1.2
    reach = max(0.1 * figure.expected_hz, largest)
    bottom = 0.0 if reach >= 0.5 * figure.expected_hz else figure.expected_hz - reach
    span = (figure.times_s[0], figure.times_s[-1])
    frame = _frame(width, height, span, (bottom, figure.expected_hz + reach), top=32)
    parts = frame.y_axis(5)
    parts.append(_text(4, 16, "messages a second", "start", "label"))
    at = frame.py(figure.expected_hz)
    parts.append(_rule(frame.left, at, frame.right, at, "expected"))
    meaning = f"dashed: expected {_short(figure.expected_hz)} Hz"
    parts.append(_text(frame.right, frame.top - 6, meaning, "end", "note"))
    edges = [t for t in figure.times_s for _ in (0, 1)][1:-1]
    steps = [rate for rate in figure.rates_hz for _ in (0, 1)]
    parts.append(frame.path(edges, steps, "line line-0"))
    parts += frame.x_axis(_SINCE)
    width_s = (span[1] - span[0]) / len(figure.rates_hz)
    caption = (
        f"Between {_short(min(figure.rates_hz))} and {_short(max(figure.rates_hz))} messages a second on "
        f"{one_line(figure.topic, 60)}, each step over {duration(width_s)}. "
        f"Expected: {_short(figure.expected_hz)}."
    )
    return Chart(_svg(width, height, name, figure.title, caption, parts), None, caption)


# -- values ------------------------------------------------------------------------------------


@chart_of.register
def series_chart(figure: Series, name: str) -> Chart:
    """Draw elements of messages over time: one frame an element, the roles in it over each other."""
    roles = list(dict.fromkeys(line.role for line in figure.lines))
    caption = _series_caption(figure)
    wide, narrow = _both(name, figure.title, caption, lambda width: _series(figure, roles, width))
    key = tuple((f"line-{i % 4}", f"{role}: {_topic_of(figure, role)}") for i, role in enumerate(roles))
    return Chart(wide, narrow, caption, key)


def _series(figure: Series, roles: Sequence[str], width: int) -> tuple[float, list[Markup]]:
    """Paint the frames one below the other, on one scale; elements that never move get a low one."""
    indices = sorted({line.index for line in figure.lines})
    times = [t for line in figure.lines for t in (line.times_s[0], line.times_s[-1])]
    x = (min(times), max(times))
    moving = {line.index for line in figure.lines if max(line.values) > min(line.values)}
    y = _padded([v for line in figure.lines for v in (min(line.values), max(line.values))], least=0.05)
    row = 220 if len(indices) == 1 else 130 if len(moving) == 2 else 88
    parts: list[Markup] = []
    top = float(_TOP + 8)
    for n, index in enumerate(indices):
        lines = [line for line in figure.lines if line.index == index]
        high = row if index in moving or len(indices) == 1 else 26
        middle = lines[0].values[0]
        frame = _Frame(_LEFT, top, width - _RIGHT, top + high - 12, x, y if high > 26 else (middle, middle))
        parts += frame.y_axis(4 if high > 100 else 3)
        parts += [_curve(frame, line, roles.index(line.role), width) for line in lines]
        label = f"{figure.field}[{index}]" + (f", {figure.unit}" if figure.unit and n == 0 else "")
        parts.append(_text(frame.left + 6, top + (1 if high > 26 else 6), label, "start", "label"))
        top += high
    return top + _BOTTOM, parts + _Frame(_LEFT, 0, width - _RIGHT, top, x, y).x_axis(_SINCE)


def _curve(frame: _Frame, line: Line, role: int, width: int) -> Markup:
    step = max(1, len(line.times_s) // _NARROW_POINTS) if width == NARROW else 1
    return frame.path(line.times_s[::step], line.values[::step], f"line line-{role % 4}")


def _topic_of(figure: Series, role: str) -> str:
    return next(line.topic for line in figure.lines if line.role == role)


def _series_caption(figure: Series) -> str:
    unit = f" {figure.unit}" if figure.unit else ""
    moving = [
        f"{line.role} {figure.field}[{line.index}] {_short(min(line.values))} to {_short(max(line.values))}"
        for line in figure.lines
        if max(line.values) > min(line.values)
    ]
    shown = "; ".join(moving[:6]) + ("; …" if len(moving) > 6 else "")
    still = len(figure.lines) - len(moving)
    rest = f" {still} of {len(figure.lines)} lines do not move." if still else ""
    more = f" {figure.left_out} further elements are not shown." if figure.left_out > 0 else ""
    return (f"Range in{unit or ' numbers'}: {shown}." if moving else "Nothing moves.") + rest + more


@chart_of.register
def reports_chart(figure: Reports, name: str) -> Chart:
    """Draw reported numbers over the values that are right."""
    times = [*figure.times_s, *(t for p in figure.plateaus for t in (p.start_s, p.end_s))]
    right = [p.value for p in figure.plateaus]
    # One absurd report must not press all others flat.
    limit = max(right) * 4 if right and max(right) > 0 else math.inf
    within = [v for v in figure.values if -limit <= v <= limit]
    far = len(figure.values) - len(within)
    values = [0.0, *within, *right]

    def paint(width: int) -> tuple[float, list[Markup]]:
        height = 290
        frame = _frame(width, height, (min(times), max(times)), _padded(values, 0.06, 1e-3), top=30)
        parts = frame.y_axis(5)
        parts.append(_text(4, 16, figure.unit or "value", "start", "label"))
        for plateau in figure.plateaus:
            y = frame.py(plateau.value)
            parts.append(_rule(frame.px(plateau.start_s), y, frame.px(plateau.end_s), y, "plateau"))
        step = 2 if width == NARROW and len(figure.values) > _NARROW_POINTS else 1
        marks = list(zip(figure.times_s, figure.values, strict=True))[::step]
        parts += [
            _tag("circle", cx=frame.px(t), cy=frame.py(v), r=2.4, class_="dot")
            for t, v in marks
            if -limit <= v <= limit
        ]
        return height, parts + frame.x_axis(_SINCE)

    caption = f"{figure.total} reported numbers"
    caption += f" and {len(right)} spans in which the right value is known." if right else "."
    caption += f" {far} lie far outside and are not drawn." if far else ""
    wide, narrow = _both(name, figure.title, caption, paint)
    key = (("dot", "reported by the program"), ("plateau", "right value"))
    return Chart(wide, narrow, caption, key)


# -- services ----------------------------------------------------------------------------------


@chart_of.register
def calls_chart(figure: Calls, name: str) -> Chart:
    """Draw each call of a service at its time, as high as it took long."""
    calls = [call for group in figure.groups for call in group.calls]
    answered = [call.latency_s for call in calls if call.answer is not None]
    slowest = max(answered or [call.latency_s for call in calls])
    start, end = min(c.start_s for c in calls), max(c.start_s for c in calls)
    scale, unit = (1.0, "s") if slowest >= 1 else (1e3, "ms")

    def paint(width: int) -> tuple[float, list[Markup]]:
        height = 260
        x = _padded((start, end), 0.04, 0.02)
        frame = _frame(width, height, x, (0, slowest * 1.15 or 1e-3), top=52)
        parts = frame.y_axis(4, scale)
        parts.append(_text(4, 16, f"time until the answer, {unit}", "start", "label"))
        for n, mark in enumerate(figure.marks):
            at = frame.px(mark.at_s)
            parts.append(_rule(at, frame.top - 6 - 14 * (n % 2), at, frame.bottom, "mark"))
            aside, gap = ("end", -3) if at > width * 0.6 else ("start", 3)
            parts.append(_text(at + gap, frame.top - 8 - 14 * (n % 2), one_line(mark.text, 30), aside, "note"))
        for call in calls:
            at, height_at = frame.px(call.start_s), frame.py(min(call.latency_s, slowest))
            parts.append(_rule(at, frame.bottom, at, height_at, "stem"))
            parts.append(_call_mark(at, height_at, call.answer is not None, call.accepted))
        return height, parts + frame.x_axis(_SINCE)

    silent = len(calls) - len(answered)
    caption = f"{len(calls)} calls of {one_line(figure.service, 60)}; "
    caption += f"the slowest answer took {duration(slowest)}." if answered else "none was answered."
    caption += f" {silent} got no answer in time." if silent and answered else ""
    wide, narrow = _both(name, figure.title, caption, paint)
    kinds = {(call.answer is not None, call.accepted) for call in calls}
    return Chart(wide, narrow, caption, tuple(_call_key(*kind) for kind in sorted(kinds, key=str)))


def _call_mark(x: float, y: float, answered: bool, accepted: bool | None) -> Markup:
    if not answered:
        path = f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8"
        return _tag("path", d=path, class_="call-silent")
    if accepted is False:
        path = f"M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5 -5z"
        return _tag("path", d=path, class_="call-refused")
    return _tag("circle", cx=x, cy=y, r=4, class_="call-accepted")


def _call_key(answered: bool, accepted: bool | None) -> tuple[str, str]:
    if not answered:
        return "call-silent", "no answer in time"
    if accepted is None:
        return "call-accepted", "answered"
    return ("call-accepted", "answered: true") if accepted else ("call-refused", "answered: false")


# -- latency -----------------------------------------------------------------------------------


@chart_of.register
def latency_chart(figure: Latency, name: str) -> Chart:
    """Draw each topic's latencies as a box over a strip of single messages, on a logarithmic axis."""
    floor = 1e-6
    most = max(d.most_s for d in figure.distributions)
    least = min(min(d.sample_s) for d in figure.distributions)
    x = (math.log10(max(least, floor)) - 0.1, math.log10(max(most, floor)) + 0.1)

    def paint(width: int) -> tuple[float, list[Markup]]:
        row, top = 62, 8
        height = top + row * len(figure.distributions) + _BOTTOM + 4
        frame = _Frame(14, top, width - _RIGHT, height - _BOTTOM, x, (0, 1))
        parts = []
        for power in range(math.floor(x[0]), math.ceil(x[1]) + 1):
            for factor in (1, 2, 5):
                at = math.log10(factor) + power
                if x[0] <= at <= x[1] and (factor == 1 or width > NARROW or x[1] - x[0] < 2):
                    parts.append(_rule(frame.px(at), top, frame.px(at), frame.bottom + 4, "grid"))
                    parts.append(_text(frame.px(at), frame.bottom + 17, duration(factor * 10.0**power)))
        for n, distribution in enumerate(figure.distributions):
            parts += _box(frame, distribution, top + row * n, floor, width)
        middle = (frame.left + frame.right) / 2
        label = "time from sending to arrival at the recorder (logarithmic)"
        return height, [*parts, _text(middle, frame.bottom + 36, label, class_="label")]

    caption = " ".join(
        f"{one_line(d.topic, 60)}: half within {duration(d.median_s)}, 95 % within {duration(d.high_s)}, "
        f"longest {duration(d.most_s)}."
        for d in figure.distributions
    )
    wide, narrow = _both(name, figure.title, caption, paint)
    return Chart(wide, narrow, caption, (("box", "middle half, line at the median"), ("dot", "single messages")))


def _box(frame: _Frame, d: Distribution, top: float, floor: float, width: int) -> list[Markup]:
    def at(seconds: float) -> float:
        return frame.px(math.log10(max(seconds, floor)))

    middle = top + 34
    step = 2 if width == NARROW else 1
    parts = [_text(frame.left, top + 14, f"{one_line(d.topic, 40)} ({d.count})", "start", "label")]
    for n, sample in enumerate(d.sample_s[::step]):
        # The golden ratio spreads the points evenly over the strip's height without chance.
        spread = (n * 0.618034) % 1.0
        parts.append(_tag("circle", cx=at(sample), cy=middle + 9 + 9 * spread, r=1.6, class_="dot faint"))
    parts.append(_rule(at(d.low_s), middle, at(d.high_s), middle, "whisker"))
    left, right = at(d.quarter_s), at(d.three_quarters_s)
    parts.append(_tag("rect", x=left, y=middle - 7, width=max(2.0, right - left), height=14, class_="box"))
    parts.append(_rule(at(d.median_s), middle - 7, at(d.median_s), middle + 7, "median"))
    return parts


# -- a class -----------------------------------------------------------------------------------


def scores_chart(spread: Spread, name: str) -> Chart:
    """Draw how many have how many points, with the median and the middle half."""
    width, height = HALF, 250
    most = max(bar.count for bar in spread.bars)
    possible = float(spread.possible) or 1.0
    frame = _Frame(14, 44, width - 14, height - _BOTTOM, (0, possible), (0, most))
    quarters = (spread.first_quartile, spread.median, spread.third_quartile)
    low, middle, high = (frame.px(min(possible, max(0.0, float(quarter)))) for quarter in quarters)
    top = frame.top - 10
    parts = [_tag("rect", x=low, y=top, width=high - low, height=frame.bottom - top, class_="quartiles")]
    for bar in spread.bars:
        if bar.count:
            x, y = frame.px(float(bar.low)) + 2, frame.py(bar.count)
            thick = frame.px(float(bar.high)) - x - 2
            parts.append(_tag("rect", x=x, y=y, width=thick, height=frame.bottom - y, rx=2, class_="bar"))
            parts.append(_text(x + thick / 2, y - 6, str(bar.count), class_="note"))
    parts.append(_rule(middle, frame.top - 16, middle, frame.bottom, "expected"))
    anchor = "end" if middle > width * 0.8 else "start" if middle < width * 0.2 else "middle"
    parts.append(_text(middle, frame.top - 24, f"median {tenths(spread.median)}", anchor, "label"))
    parts += frame.x_axis("points")
    caption = (
        f"{spread.count} graded. Bars are {_short(possible / len(spread.bars))} points wide. "
        f"The middle half, shaded, has {tenths(spread.first_quartile)} to {tenths(spread.third_quartile)} points."
    )
    return Chart(_svg(width, height, name, "How the points are spread", caption, parts), None, caption)
