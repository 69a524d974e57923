"""Pictures as inline SVG: axes, lines and marks.

Colours and letters come from the page's style sheet by class. A wide picture has a narrow form for a phone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from grader.evidence.recorded import Floats, Recorded
from grader.lab.references import Parameters
from grader.report.escape import shown

WIDE, HALF, NARROW = 920, 440, 330
LEFT, RIGHT, TOP, BOTTOM = 50, 14, 14, 44
NARROW_POINTS = 160
#: More points than these no eye tells apart.
MOST_POINTS = 400
SINCE = "seconds since the session's start"

#: Gives the height and the parts of a picture of some width.
Paint = Callable[[int], tuple[float, list[Markup]]]


@dataclass(frozen=True)
class Figure:
    """What a part of a report shows: a picture, with or without a table or tree that the template writes."""

    #: What the picture shows, in words and numbers.
    caption: str = ""
    paint: Paint | None = None
    #: Style class and meaning of each sort of mark.
    key: tuple[tuple[str, str], ...] = ()
    #: Whether two of this kind fit side by side; then it has one form only.
    half: bool = False
    #: The template's macro that writes `content`.
    table: str = ""
    content: Any = None
    title: str = ""
    session: str = ""
    #: Ids of the checks whose loss it shows.
    shows: tuple[str, ...] = ()

    def svg(self, name: str, width: int) -> Markup:
        """Return the picture; `name` is unique in the page."""
        assert self.paint is not None
        height, parts = self.paint(width)
        heads = tag("title", self.title, id=f"{name}-t") + tag("desc", self.caption, id=f"{name}-d")
        return tag(
            "svg",
            heads + Markup("").join(parts),
            viewBox=f"0 0 {width} {height}",
            role="img",
            aria_labelledby=f"{name}-t {name}-d",
            class_="chart",
        )


class FigureKind(Parameters):
    """A kind of figure: its settings in the rubric, and how it is drawn."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw what a recording holds; None where that is nothing that could be shown."""
        raise NotImplementedError


def duration(seconds: float) -> str:
    """Write a short time with the unit that suits it."""
    size = abs(seconds)
    if size >= 1 or size == 0:
        return f"{short(seconds)} s"
    return f"{short(seconds * 1e3)} ms" if size >= 1e-3 else f"{short(seconds * 1e6)} µs"


def short(value: float) -> str:
    """Write a number with three significant digits."""
    if not math.isfinite(value):
        return str(value)
    if value and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.2e}"
    digits = 2 - math.floor(math.log10(abs(value))) if value else 0
    text = f"{value:.{max(0, digits)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers between two bounds, at most about `most`."""
    if not math.isfinite(high - low) or high <= low:
        return [low]
    raw = (high - low) / max(1, most)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [n * step for n in range(first, math.floor(high / step + 1e-9) + 1)]


def padded(values: Iterable[float], share: float, least: float) -> tuple[float, float]:
    """Return bounds with some air around values."""
    known = list(values)
    low, high = min(known), max(known)
    air = max((high - low) * share, least)
    return low - air, high + air


def tag(name: str, content: str | Markup = "", **attributes: str | float) -> Markup:
    """Return an element; `class_` and `text_anchor` become class and text-anchor, and text is made fit to be shown."""
    parts = []
    for key, value in attributes.items():
        written = escape(value) if isinstance(value, str) else f"{value:.1f}".removesuffix(".0")
        parts.append(f' {key.rstrip("_").replace("_", "-")}="{written}"')
    inside = content if isinstance(content, Markup) else escape(shown(content))
    return Markup(f"<{name}{''.join(parts)}>{inside}</{name}>")


def text(x: float, y: float, content: str, anchor: str = "middle", class_: str = "tick") -> Markup:
    """Return a line of text; `anchor` is start, middle or end."""
    return tag("text", content, x=x, y=y, text_anchor=anchor, class_=class_)


def rule(x1: float, y1: float, x2: float, y2: float, class_: str) -> Markup:
    """Return a straight line."""
    return tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=class_)


def rect(x: float, y: float, width: float, height: float, class_: str, **more: float) -> Markup:
    """Return a rectangle, with more attributes."""
    return tag("rect", "", x=x, y=y, width=width, height=height, **more, class_=class_)


@dataclass(frozen=True)
class Frame:
    """A rectangle of a picture, and the numbers at its edges."""

    left: float
    top: float
    right: float
    bottom: float
    x: tuple[float, float]
    y: tuple[float, float]

    def px(self, value: float) -> float:
        """Return where a number lies on the x axis."""
        low, high = self.x
        return self.left + (self.right - self.left) * (value - low) / ((high - low) or 1.0)

    def py(self, value: float) -> float:
        """Return where a number lies on the y axis."""
        low, high = self.y
        return self.bottom - (self.bottom - self.top) * (value - low) / ((high - low) or 1.0)

    def path(
        self, times: Sequence[float] | Floats, values: Sequence[float] | Floats, class_: str
    ) -> Markup:
        """Return a line through points."""
        points = " ".join(
            f"{self.px(t):.1f},{self.py(v):.1f}" for t, v in zip(times, values, strict=True)
        )
        return tag("polyline", points=points, class_=class_)

    def y_axis(self, most: int, scale: float = 1.0) -> list[Markup]:
        """Return at most about so many horizontal lines with their numbers."""
        parts = []
        for value in ticks(self.y[0] * scale, self.y[1] * scale, most):
            at = self.py(value / scale)
            parts += [
                rule(self.left, at, self.right, at, "grid"),
                text(self.left - 7, at + 4, short(value), "end"),
            ]
        return parts

    def x_axis(self, label: str, scale: float = 1.0) -> list[Markup]:
        """Return the axis at the bottom with its numbers."""
        parts = [rule(self.left, self.bottom, self.right, self.bottom, "axis")]
        for value in ticks(
            self.x[0] * scale, self.x[1] * scale, round((self.right - self.left) / 75)
        ):
            at = self.px(value / scale)
            parts += [
                rule(at, self.bottom, at, self.bottom + 4, "axis"),
                text(at, self.bottom + 17, short(value)),
            ]
        return [*parts, text((self.left + self.right) / 2, self.bottom + 36, label, class_="label")]

    def log_axis(self, top: float, bottom: float, *, dense: bool) -> list[Markup]:
        """Return the lines of times whose logarithms are on the x axis: powers of ten, and if dense what is between."""
        parts = []
        low, high = self.x
        for power in range(math.floor(low), math.ceil(high) + 1):
            for factor in (1, 2, 5) if dense else (1,):
                value = math.log10(factor) + power
                if low <= value <= high:
                    at = self.px(value)
                    parts.append(rule(at, top, at, bottom, "grid"))
                    parts.append(text(at, bottom + 14, duration(factor * 10.0**power)))
        return parts


def frame_in(
    width: float, height: float, x: tuple[float, float], y: tuple[float, float], top: float
) -> Frame:
    """Return the frame of a picture of one frame."""
    return Frame(LEFT, top, width - RIGHT, height - BOTTOM, x, y)
