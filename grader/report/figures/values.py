"""Numbers over time: elements of messages, and numbers printed by a program with the right values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from grader.checks.fields import NumbersOf
from grader.evidence.oracle import load_oracle
from grader.evidence.recorded import Booleans, Floats, NumericStream, Recorded
from grader.evidence.text.printed import reports
from grader.lab import references as ref
from grader.lab.references import Patterns
from grader.report.figures.svg import (
    BOTTOM,
    LEFT,
    MOST_POINTS,
    NARROW_POINTS,
    RIGHT,
    SINCE,
    TOP,
    Canvas,
    Figure,
    FigureKind,
    Frame,
    Range,
    padded,
    short,
)
from grader.report.figures.timing import stamped_near_arrival

MOST_ELEMENTS = 16
#: Size of a number that is too large for a real measurement and would flatten all other lines.
_FAR = 1e9


# -- lines -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Line:
    """One element of one topic's messages over time."""

    role: str
    index: int
    times_s: Floats
    values: Floats

    @cached_property
    def lowest(self) -> float:
        return float(self.values.min())

    @cached_property
    def highest(self) -> float:
        return float(self.values.max())

    @property
    def moves(self) -> bool:
        return self.highest > self.lowest

    @property
    def range(self) -> str:
        """Lowest and highest value: `-0.5 to 1.2`."""
        return f"{short(self.lowest)} to {short(self.highest)}"

    def paint(self, frame: Frame, colour: int) -> None:
        """Draw the line, with fewer points in a narrow picture."""
        step = 1
        if frame.canvas.narrow:
            step = max(1, len(self.times_s) // NARROW_POINTS)
        frame.line(self.times_s[::step], self.values[::step], f"line line-{colour}")


def _lines(
    recorded: Recorded, role: str, stream: NumericStream, indices: Sequence[int]
) -> Iterator[_Line]:
    """Yield the lines of some elements, without points too far away to be drawn to scale."""
    stamped_near = stamped_near_arrival(stream)
    for index in indices[:MOST_ELEMENTS]:
        values = stream.values[:, index]
        shown = stamped_near & (np.abs(values) < _FAR)
        if shown.any():
            times_s = recorded.seconds(stream.source_ns[shown])
            yield _Line(role, index, *_thinned(times_s, values[shown]))


def _thinned(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return at most `MOST_POINTS` points: the lowest and highest of each stretch, to keep all peaks."""
    if len(times_s) <= MOST_POINTS:
        return times_s, values
    kept: list[int] = []
    for stretch in np.array_split(np.arange(len(times_s)), MOST_POINTS // 2):
        lowest = int(stretch[np.argmin(values[stretch])])
        highest = int(stretch[np.argmax(values[stretch])])
        kept += sorted({lowest, highest})
    return times_s[kept], values[kept]


def _times_of(lines: Sequence[_Line]) -> Range:
    """Return the time from the first point of all lines to the last one, in s."""
    first_s = min(line.times_s[0] for line in lines)
    last_s = max(line.times_s[-1] for line in lines)
    return Range(first_s, last_s)


def _extremes(lines: Sequence[_Line]) -> list[float]:
    """Return the lowest and the highest value of each line."""
    extremes = []
    for line in lines:
        extremes += [line.lowest, line.highest]
    return extremes


# -- elements of an array ----------------------------------------------------------------------

#: Height in px of the frame of an element that never moves.
_STILL_HEIGHT = 26
#: Ranges in the caption.
_MOST_RANGES = 6
#: Styles of lines.
_COLOURS = 4


class Series(FigureKind):
    """Elements of an array in the messages of some topics."""

    topics: dict[str, ref.Topic] = Field(description="Role -> topic.")
    field: ref.FieldPath
    indices: tuple[int, ...] | None = None
    unit: str = ""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw one frame per element, the roles in it over each other."""
        lines: list[_Line] = []
        left_out = 0
        for role, topic in self.topics.items():
            stream = recorded.numeric(topic, self.field)
            if stream is not None:
                wanted = self._wanted(stream.values.shape[1])
                left_out = max(left_out, len(wanted) - MOST_ELEMENTS)
                lines += _lines(recorded, role, stream, wanted)
        if not lines:
            return None
        chart = _SeriesChart(self.field, self.unit, lines, left_out)
        key = []
        for n, role in enumerate(chart.roles):
            topic = recorded.used(self.topics[role])
            key.append((f"line-{n % _COLOURS}", f"{role}: {topic}"))
        return Figure(chart.caption, chart.paint, tuple(key))

    def _wanted(self, length: int) -> Sequence[int]:
        """Return the indices of the rubric in an array of some length; by default all."""
        if self.indices is None:
            return range(length)
        return [index for index in self.indices if index < length]


@dataclass(frozen=True)
class _Element:
    """An element of the array, with one line per role."""

    index: int
    lines: Sequence[_Line]

    @property
    def moves(self) -> bool:
        return any(line.moves for line in self.lines)


@dataclass(frozen=True)
class _SeriesChart:
    """Elements of an array over time, one frame each."""

    field: str
    unit: str
    lines: Sequence[_Line]
    #: Number of elements beyond those drawn.
    left_out: int

    @cached_property
    def roles(self) -> list[str]:
        """Roles with lines, in the order of the rubric."""
        return list(dict.fromkeys(line.role for line in self.lines))

    @cached_property
    def elements(self) -> list[_Element]:
        """Elements in the order of their indices."""
        elements = []
        for index in sorted({line.index for line in self.lines}):
            lines = [line for line in self.lines if line.index == index]
            elements.append(_Element(index, lines))
        return elements

    @property
    def caption(self) -> str:
        ranges = []
        for line in self.lines:
            if line.moves:
                ranges.append(f"{line.role} {self.field}[{line.index}] {line.range}")
        shown = "; ".join(ranges[:_MOST_RANGES])
        if len(ranges) > _MOST_RANGES:
            shown += "; …"
        caption = "Nothing moves."
        if ranges:
            caption = f"Range in {self.unit or 'numbers'}: {shown}."
        still = len(self.lines) - len(ranges)
        if still:
            caption += f" {still} of {len(self.lines)} lines do not move."
        if self.left_out > 0:
            caption += f" {self.left_out} further elements are not shown."
        return caption

    def paint(self, canvas: Canvas) -> None:
        """Draw the frames one below the other, on one scale; elements that never move get a low one."""
        times_s = _times_of(self.lines)
        values = padded(_extremes(self.lines), 0.08, 0.05)
        right = canvas.width - RIGHT
        top = float(TOP + 8)
        for element in self.elements:
            height = self._height_of(element)
            frame = Frame(canvas, LEFT, top, right, top + height - 12, times_s, values)
            self._paint_element(element, frame, height)
            top += height
        canvas.height = top + BOTTOM
        Frame(canvas, LEFT, 0, right, top, times_s, values).x_axis(SINCE)

    def _height_of(self, element: _Element) -> int:
        """Return the height of an element's frame in px."""
        if len(self.elements) == 1:
            return 220
        if not element.moves:
            return _STILL_HEIGHT
        moving = [each for each in self.elements if each.moves]
        return 130 if len(moving) == 2 else 88

    def _paint_element(self, element: _Element, frame: Frame, height: int) -> None:
        label_y = frame.top + 1
        if height == _STILL_HEIGHT:
            value = element.lines[0].values[0]
            frame = replace(frame, y=Range(value, value))
            label_y = frame.top + 6
        frame.y_axis(4 if height > 100 else 3)
        for line in element.lines:
            line.paint(frame, self.roles.index(line.role) % _COLOURS)
        label = f"{self.field}[{element.index}]"
        if self.unit and element is self.elements[0]:
            label += f", {self.unit}"
        frame.canvas.text(frame.left + 6, label_y, label, "start", "label")


# -- fields ------------------------------------------------------------------------------------


class FieldOverTime(FigureKind):
    """Fields of messages over time in one picture, with the limits or the target that they have."""

    lines: dict[str, NumbersOf] = Field(
        min_length=1, max_length=4, description="Name -> topic and field."
    )
    limits: tuple[float, ...] = Field(
        (), description="Values at which a dashed line is drawn: limits, or a target."
    )
    unit: str = ""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw each element of each field as a line; one name has one colour."""
        drawn: list[_Line] = []
        for name, numbers in self.lines.items():
            stream = numbers.series(recorded)
            if stream is not None:
                drawn += _lines(recorded, name, stream, range(stream.values.shape[1]))
        if not drawn:
            return None
        chart = _FieldChart(list(self.lines), drawn, self.limits, self.unit)
        key = []
        for n, (name, numbers) in enumerate(self.lines.items()):
            key.append((f"line-{n}", f"{name}: {numbers.field}"))
        return Figure(chart.caption, chart.paint, tuple(key))


@dataclass(frozen=True)
class _FieldChart:
    """Lines over time in one frame, with dashed lines at limits."""

    names: Sequence[str]
    lines: Sequence[_Line]
    limits: Sequence[float]
    unit: str

    @property
    def caption(self) -> str:
        ranges = "; ".join(f"{line.role} {line.range}" for line in self.lines)
        caption = f"Range in {self.unit or 'numbers'}: {ranges}."
        if self.limits:
            caption += f" Dashed: {', '.join(map(short, self.limits))}."
        return caption

    def paint(self, canvas: Canvas) -> None:
        values = padded([*_extremes(self.lines), *self.limits], 0.06, 1e-3)
        frame = canvas.frame(260, _times_of(self.lines), values, top=30)
        frame.y_axis(5)
        canvas.text(4, 16, self.unit or "value", "start", "label")
        for limit in self.limits:
            frame.level(limit, "expected")
        for line in self.lines:
            line.paint(frame, self.names.index(line.role))
        frame.x_axis(SINCE)


# -- reported numbers --------------------------------------------------------------------------


class Reports(FigureKind):
    """Numbers reported by a process, over the right values from an oracle."""

    artifact: ref.Artifact
    pattern: Patterns
    streams: dict[str, ref.Topic]
    field: ref.FieldPath
    oracle: ref.Loadable
    parameters: dict[str, Any] = Field(default_factory=dict)
    unit: str = ""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw reported numbers as dots over the right values."""
        times_ns = []
        values = []
        for report in reports(recorded, self.artifact, self.pattern):
            if abs(report.value) < _FAR:
                times_ns.append(report.t_ns)
                values.append(report.value)
        plateaus = self._plateaus(recorded, lab_folder)
        if not values and not plateaus:
            return None
        times_s = recorded.seconds(np.array(times_ns))
        chart = _ReportChart(len(values), *_thinned(times_s, np.array(values)), plateaus, self.unit)
        key = (("dot", "reported by the program"), ("plateau", "right value"))
        return Figure(chart.caption, chart.paint, key)

    def _plateaus(self, recorded: Recorded, lab_folder: Path) -> list[_Plateau]:
        """Return the spans with one right value."""
        oracle = load_oracle(lab_folder, self.oracle)
        streams = recorded.streams(self.streams, self.field)
        try:
            spans = oracle(streams, self.parameters, recorded.record.seed)
        except Exception:
            # The checks judge streams that do not fit together. There is no line to draw.
            return []
        plateaus = []
        for span in spans[:MOST_POINTS]:
            if abs(span["value"]) < _FAR:
                start_s = recorded.since_start_s(span["start_ns"])
                end_s = recorded.since_start_s(span["end_ns"])
                plateaus.append(_Plateau(start_s, end_s, float(span["value"])))
        return plateaus


@dataclass(frozen=True)
class _Plateau:
    """A span of time with one right value."""

    start_s: float
    end_s: float
    value: float


@dataclass(frozen=True)
class _ReportChart:
    """Reported numbers and right values over time."""

    #: Number of all reports.
    count: int
    #: float64[n]: Times of the reports that may be drawn, in s.
    times_s: Floats
    values: Floats
    plateaus: Sequence[_Plateau]
    unit: str

    @cached_property
    def within(self) -> Booleans:
        """Reports that are drawn, because they are at most four times the largest right value."""
        largest = max((plateau.value for plateau in self.plateaus), default=0.0)
        limit = math.inf
        if largest > 0:
            limit = largest * 4
        within: Booleans = np.abs(self.values) <= limit
        return within

    @property
    def caption(self) -> str:
        caption = f"{self.count} reported numbers"
        if self.plateaus:
            caption += f" and {len(self.plateaus)} spans in which the right value is known."
        else:
            caption += "."
        far = int(np.sum(~self.within))
        if far:
            caption += f" {far} lie far outside and are not drawn."
        return caption

    def paint(self, canvas: Canvas) -> None:
        frame = canvas.frame(290, self._times(), self._values(), top=30)
        frame.y_axis(5)
        canvas.text(4, 16, self.unit or "value", "start", "label")
        for plateau in self.plateaus:
            y = frame.py(plateau.value)
            canvas.horizontal(frame.px(plateau.start_s), frame.px(plateau.end_s), y, "plateau")
        self._paint_reports(frame)
        frame.x_axis(SINCE)

    def _times(self) -> Range:
        """Return the time from the first report or span to the last one, in s."""
        times_s = list(self.times_s)
        for plateau in self.plateaus:
            times_s += [plateau.start_s, plateau.end_s]
        return Range(min(times_s), max(times_s))

    def _values(self) -> Range:
        """Return the numbers on the y axis."""
        right = [plateau.value for plateau in self.plateaus]
        return padded([0.0, *self.values[self.within], *right], 0.06, 1e-3)

    def _paint_reports(self, frame: Frame) -> None:
        step = 1
        if frame.canvas.narrow and len(self.values) > NARROW_POINTS:
            step = 2
        reported = zip(self.times_s, self.values, self.within, strict=True)
        points = []
        for time_s, value, near in list(reported)[::step]:
            if near:
                points.append((frame.px(time_s), frame.py(value)))
        frame.canvas.dots(points, 2.4, "dots")
