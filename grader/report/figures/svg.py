"""Pictures as inline SVG: a canvas for marks, a frame with axes, and figures.

The page's style sheet gives each style class its colours and fonts. A wide picture also has a narrow form for phones.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from markupsafe import Markup, escape

from grader.evidence.recorded import Floats, Recorded
from grader.lab.references import Parameters
from grader.report.escape import shown

#: A number, or an array of numbers.
Number = TypeVar("Number", float, Floats)

#: Widths of pictures in px: over the whole page, half of it, and on a phone.
WIDE, HALF, NARROW = 920, 440, 330
#: Margins around a frame in px.
LEFT, RIGHT, TOP, BOTTOM = 50, 14, 14, 44
#: Points of a line in a narrow picture.
NARROW_POINTS = 120
#: Points of a line in a wide picture; more cannot be told apart.
MOST_POINTS = 300
#: Distance in px from a straight line, up to which a point of a curve is left out, and most such points in a row.
_BEND, _PASSED = 0.05, 5
#: Anchor of texts, except where they say another.
_MIDDLE = "middle"
#: Elements without content.
_SHAPES = ("circle", "line", "path", "polyline", "rect")
#: Label of an axis of times.
SINCE = "seconds since the session's start"


@dataclass(frozen=True)
class Range:
    """The numbers from a lowest to a highest one."""

    low: float
    high: float

    @property
    def length(self) -> float:
        """Distance between both ends; 1 if they are equal, as a divisor."""
        return (self.high - self.low) or 1.0

    def clip(self, value: float) -> float:
        """Return the number of the range that is nearest to a value."""
        return min(self.high, max(self.low, value))


class Canvas:
    """A picture of a fixed width; each mark covers the marks drawn before it."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.height = 0.0
        self.marks: list[Markup] = []
        #: Edges of the time axis in px, and the seconds of the session there; empty without one.
        self.time_axis = ""

    @property
    def narrow(self) -> bool:
        """True for the form of a picture on phones."""
        return self.width <= NARROW

    def frame(self, height: float, x: Range, y: Range, top: float) -> Frame:
        """Set the picture's height, and return its only frame."""
        self.height = height
        return Frame(self, LEFT, top, self.width - RIGHT, height - BOTTOM, x, y)

    def add(self, name: str, content: str | Markup = "", **attributes: str | float) -> None:
        """Add an element as `tag` writes it."""
        mark = tag(name, content, **attributes)
        self.marks.append(mark)

    def text(
        self, x: float, y: float, content: str, anchor: str = _MIDDLE, class_: str = "tick"
    ) -> None:
        """Write a line of text; `anchor` is start, middle or end."""
        attributes: dict[str, str | float] = {"x": x, "y": y}
        if anchor != _MIDDLE:
            attributes["text_anchor"] = anchor
        self.add("text", content, **attributes, class_=class_)

    def horizontal(self, left: float, right: float, y: float, class_: str) -> None:
        """Draw a horizontal line."""
        self.add("line", x1=left, y1=y, x2=right, y2=y, class_=class_)

    def vertical(self, x: float, top: float, bottom: float, class_: str) -> None:
        """Draw a vertical line."""
        self.add("line", x1=x, y1=top, x2=x, y2=bottom, class_=class_)

    def rect(
        self, x: float, y: float, width: float, height: float, class_: str, **more: float
    ) -> None:
        """Draw a rectangle with further attributes."""
        self.add("rect", "", x=x, y=y, width=width, height=height, **more, class_=class_)

    def dot(self, x: float, y: float, radius: float, class_: str) -> None:
        """Draw a circle."""
        self.add("circle", cx=x, cy=y, r=radius, class_=class_)

    def dots(self, points: Iterable[Sequence[float]], radius: float, class_: str) -> None:
        """Draw equal circles around points (x, y), as the round ends of lines without a length."""
        self.add("path", d=_moves(points, "m", "h0"), stroke_width=2 * radius, class_=class_)

    def path(self, steps: str, class_: str) -> None:
        """Draw a path; `steps` is its `d` attribute, such as `M4 8v10`."""
        self.add("path", d=steps, class_=class_)

    def curve(self, points: Iterable[Sequence[float]], class_: str) -> None:
        """Draw a line through many points (x, y), in half of the text that a polyline takes."""
        self.add("path", d=_moves(_bends(points), "l"), class_=class_)

    def polyline(self, points: Iterable[Sequence[float] | Floats], class_: str) -> None:
        """Draw a line through points (x, y)."""
        written = [f"{x:.1f},{y:.1f}" for x, y in points]
        self.add("polyline", points=" ".join(written), class_=class_)


def _moves(points: Iterable[Sequence[float]], step: str, mark: str = "") -> str:
    """Return the steps of a path through points, each relative to the previous one, in tenths of a pixel.

    For example the points (5, 7) and (6.5, 6.8) with the step `l` give "M5 7l1.5-.2", and with the step `m` and the
    mark `h0` "M5 7h0m1.5-.2h0". Points at infinity are left out.
    """
    steps = []
    command = "M"
    last_x = last_y = 0
    for x, y in points:
        if not math.isfinite(x):
            continue
        if not math.isfinite(y):
            continue
        tenths_x = round(x * 10)
        tenths_y = round(y * 10)
        right = _tenths(tenths_x - last_x)
        down = _tenths(tenths_y - last_y)
        between = f"{right} {down}".replace(" -", "-")
        steps.append(f"{command}{between}{mark}")
        last_x = tenths_x
        last_y = tenths_y
        command = step
    return "".join(steps)


def _bends(points: Iterable[Sequence[float]]) -> list[Sequence[float]]:
    """Return points without those that the line through the others passes within a twentieth of a pixel."""
    kept: list[Sequence[float]] = []
    passed: list[Sequence[float]] = []
    for point in points:
        if not kept:
            kept.append(point)
            continue
        if not _passes(kept[-1], point, passed):
            kept.append(passed[-1])
            passed = []
        passed.append(point)
    kept += passed[-1:]
    return kept


def _passes(
    start: Sequence[float], end: Sequence[float], points: Sequence[Sequence[float]]
) -> bool:
    """Tell whether a straight line to the right passes a few points, or any number of a level line."""
    width = end[0] - start[0]
    rise = end[1] - start[1]
    if not 0 < width < math.inf:
        return not points
    looked_at = points[-_PASSED:]
    if rise:
        looked_at = points
        if len(points) > _PASSED:
            return False
    for x, y in looked_at:
        share = (x - start[0]) / width
        distance = abs(y - start[1] - share * rise)
        if not 0 <= share <= 1:
            return False
        if not distance < _BEND:
            return False
    return True


def _tenths(count: int) -> str:
    """Write a number of tenths for a path: `1.5`, `-.2`, `3`."""
    text = f"{count / 10:.1f}"
    text = text.removesuffix(".0")
    if abs(count) < 10:
        text = text.replace("0.", ".")
    return text


#: Draws a picture on a canvas of some width, and sets its height.
Paint = Callable[[Canvas], None]


@dataclass(frozen=True)
class Figure:
    """A part of a report: a picture, a table written by the template, or both."""

    #: Contents of the picture in words and numbers.
    caption: str = ""
    paint: Paint | None = None
    #: Style class and meaning of each sort of mark.
    key: tuple[tuple[str, str], ...] = ()
    #: True if two figures of this kind fit side by side; such a figure has one form only.
    half: bool = False
    #: Macro of the template that writes `content`.
    table: str = ""
    content: Any = None
    title: str = ""
    session: str = ""
    #: Ids of the checks that lost points for the facts in the figure.
    shows: tuple[str, ...] = ()

    def svg(self, name: str, width: int) -> Markup:
        """Return the picture; `name` is unique in the page."""
        assert self.paint is not None
        canvas = Canvas(width)
        self.paint(canvas)
        title = tag("title", self.title, id=f"{name}-t")
        description = tag("desc", self.caption, id=f"{name}-d")
        content = Markup("").join([title, description, *canvas.marks])
        return tag(
            "svg",
            content,
            viewBox=f"0 0 {width} {canvas.height}",
            role="img",
            aria_labelledby=f"{name}-t {name}-d",
            data_time=canvas.time_axis,
            text_anchor=_MIDDLE,
            class_="chart",
        )


#: Figures of each criterion, by its id.
FiguresOf = Mapping[str, Sequence[Figure]]


class FigureKind(Parameters):
    """A kind of figure: its settings in the rubric, and the way it is drawn."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw a recording; return None if it holds nothing to be shown."""
        raise NotImplementedError


def duration(seconds: float) -> str:
    """Write a time in s, ms or µs: `1.5 s`, `20 ms`."""
    size = abs(seconds)
    if size >= 1 or size == 0:
        return f"{short(seconds)} s"
    if size >= 1e-3:
        return f"{short(seconds * 1e3)} ms"
    return f"{short(seconds * 1e6)} µs"


def short(value: float) -> str:
    """Write a number with three significant digits: `0.0123`, `1.2`, `4.56e+07`."""
    if not math.isfinite(value):
        return str(value)
    if value == 0:
        return f"{value:.0f}"
    size = abs(value)
    if size < 1e-3 or size >= 1e6:
        return f"{value:.2e}"
    digits = max(0, 2 - math.floor(math.log10(size)))
    text = f"{value:.{digits}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return text


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers between two bounds, about `most` or fewer."""
    if not math.isfinite(high - low) or high <= low:
        return [low]
    step = _round_step((high - low) / max(1, most))
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [n * step for n in range(first, last + 1)]


def _round_step(least: float) -> float:
    """Return the smallest of 1, 2, 5, 10, 20 ... (or 0.1, 0.2, 0.5 ...) that is not below a number."""
    power = 10.0 ** math.floor(math.log10(least))
    for multiple in (1, 2, 5):
        if multiple * power >= least * 0.999:
            return multiple * power
    return 10 * power


def padded(values: Iterable[float], share: float, least: float) -> Range:
    """Return the range of values, widened at both ends by a share of its length or by `least`."""
    known = list(values)
    low = min(known)
    high = max(known)
    margin = max((high - low) * share, least)
    return Range(low - margin, high + margin)


def tag(name: str, content: str | Markup = "", **attributes: str | float) -> Markup:
    """Return an element, such as `<text x="4" text-anchor="end" class="tick">5</text>`.

    Names of attributes are written with hyphens and without a trailing underscore. Text is escaped, and made visible
    as `shown` does.
    """
    parts = []
    for key, value in attributes.items():
        attribute = key.rstrip("_").replace("_", "-")
        if isinstance(value, str):
            written = str(escape(value))
        else:
            written = f"{value:.1f}".removesuffix(".0")
        parts.append(f' {attribute}="{written}"')
    if name in _SHAPES:
        return Markup(f"<{name}{''.join(parts)}/>")
    if not isinstance(content, Markup):
        content = escape(shown(content))
    return Markup(f"<{name}{''.join(parts)}>{content}</{name}>")


def directions(turn: float, rise: float) -> tuple[Floats, Floats]:
    """Return the directions in space that a picture shows to the right and upwards, for the angles of its view in rad."""
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    flat = np.sin(rise)
    up = np.array([-np.cos(turn) * flat, -np.sin(turn) * flat, np.cos(rise)])
    return right, up


@dataclass(frozen=True)
class Frame:
    """A rectangle of a picture, and the numbers at its edges."""

    canvas: Canvas
    left: float
    top: float
    right: float
    bottom: float
    x: Range
    y: Range

    @property
    def middle(self) -> float:
        """Horizontal middle in px."""
        return (self.left + self.right) / 2

    def px(self, value: Number) -> Number:
        """Return the position of a number, or of each number of an array, on the x axis in px."""
        width = self.right - self.left
        from_low = value - self.x.low
        return self.left + width * from_low / self.x.length

    def py(self, value: Number) -> Number:
        """Return the position of a number, or of each number of an array, on the y axis in px."""
        height = self.bottom - self.top
        from_low = value - self.y.low
        return self.bottom - height * from_low / self.y.length

    def line(
        self, times: Sequence[float] | Floats, values: Sequence[float] | Floats, class_: str
    ) -> None:
        """Draw a line through points."""
        # A curve reads its points one by one, and reading numbers of numpy takes longer than reading Python's.
        x = self.px(np.asarray(times)).tolist()
        y = self.py(np.asarray(values)).tolist()
        self.canvas.curve(zip(x, y, strict=True), class_)

    def level(self, value: float, class_: str) -> None:
        """Draw a horizontal line over the whole frame at a number of the y axis."""
        self.canvas.horizontal(self.left, self.right, self.py(value), class_)

    def y_axis(self, most: int, scale: float = 1.0) -> None:
        """Draw horizontal lines with their numbers, about `most` or fewer."""
        for value in ticks(self.y.low * scale, self.y.high * scale, most):
            at = value / scale
            self.level(at, "grid")
            baseline = self.py(at) + 4
            self.canvas.text(self.left - 7, baseline, short(value), "end")

    def x_axis(self, label: str, scale: float = 1.0) -> None:
        """Draw the axis at the bottom with its numbers."""
        canvas = self.canvas
        if label == SINCE:
            canvas.time_axis = f"{self.left} {self.right} {self.x.low:.3f} {self.x.high:.3f}"
        canvas.horizontal(self.left, self.right, self.bottom, "axis")
        most = round((self.right - self.left) / 75)
        for value in ticks(self.x.low * scale, self.x.high * scale, most):
            x = self.px(value / scale)
            canvas.vertical(x, self.bottom, self.bottom + 4, "axis")
            canvas.text(x, self.bottom + 17, short(value))
        canvas.text(self.middle, self.bottom + 36, label, class_="label")

    def log_axis(self, top: float, bottom: float, *, dense: bool) -> None:
        """Draw vertical lines at powers of ten, if dense also at their doubles and fivefolds.

        The x axis holds the logarithms of times in s.
        """
        factors = (1, 2, 5) if dense else (1,)
        highest = math.ceil(self.x.high)
        powers = range(math.floor(self.x.low), highest + 1)
        for power, factor in itertools.product(powers, factors):
            value = math.log10(factor) + power
            if self.x.low <= value <= self.x.high:
                x = self.px(value)
                self.canvas.vertical(x, top, bottom, "grid")
                self.canvas.text(x, bottom + 14, duration(factor * 10.0**power))
