"""Numbers over time: elements of messages, and what a program reported against what is right."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from pydantic import Field

from grader.checks.fields import NumbersOf
from grader.evidence.oracle import load_oracle
from grader.evidence.recorded import Floats, NumericStream, Recorded
from grader.evidence.text.printed import reports
from grader.lab import references as ref
from grader.lab.references import Patterns
from grader.report.figures import svg
from grader.report.figures.svg import SINCE, Figure, FigureKind, Frame
from grader.report.figures.timing import FAR_NS

MOST_ELEMENTS = 16
#: A number that is larger than any that is meant cannot be drawn to scale.
_FAR = 1e9


def _thinned(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return at most `svg.MOST_POINTS` points: of each stretch its lowest and highest, so no peak is lost."""
    if len(times) <= svg.MOST_POINTS:
        return times, values
    kept: list[int] = []
    for part in np.array_split(np.arange(len(times)), svg.MOST_POINTS // 2):
        kept += sorted({int(part[np.argmin(values[part])]), int(part[np.argmax(values[part])])})
    return times[kept], values[kept]


@dataclass(frozen=True)
class _Line:
    """One element of one topic's messages over time."""

    role: str
    index: int
    times: Floats
    values: Floats

    @property
    def moves(self) -> bool:
        return bool(self.values.max() > self.values.min())

    def path(self, frame: Frame, width: int, colour: int) -> Markup:
        """Return the line, with fewer points in a narrow picture."""
        step = max(1, len(self.times) // svg.NARROW_POINTS) if width == svg.NARROW else 1
        return frame.path(self.times[::step], self.values[::step], f"line line-{colour}")


def _lines(
    recorded: Recorded, role: str, stream: NumericStream, indices: Sequence[int]
) -> Iterator[_Line]:
    """Give the lines of some elements, as far as they can be drawn to scale."""
    near = np.abs(stream.source_ns - stream.received_ns) < FAR_NS
    for index in indices[:MOST_ELEMENTS]:
        shown = near & (np.abs(stream.values[:, index]) < _FAR)
        if shown.any():
            times = recorded.seconds(stream.source_ns[shown])
            yield _Line(role, index, *_thinned(times, stream.values[shown, index]))


class Series(FigureKind):
    """Elements of an array in the messages of some topics."""

    topics: dict[str, ref.Topic] = Field(description="Role -> topic.")
    field: ref.FieldPath
    indices: tuple[int, ...] | None = None
    unit: str = ""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw one frame an element, the roles in it over each other."""
        lines: list[_Line] = []
        left_out = 0
        for role, topic in self.topics.items():
            stream = recorded.numeric(topic, self.field)
            if stream is None:
                continue
            length = stream.values.shape[1]
            wanted = (
                range(length) if self.indices is None else [i for i in self.indices if i < length]
            )
            left_out = max(left_out, len(wanted) - MOST_ELEMENTS)
            lines += _lines(recorded, role, stream, wanted)
        if not lines:
            return None
        roles = list(dict.fromkeys(line.role for line in lines))
        key = tuple(
            (f"line-{i % 4}", f"{role}: {recorded.used(self.topics[role])}")
            for i, role in enumerate(roles)
        )
        return Figure(
            self._caption(lines, left_out), lambda width: self._paint(lines, roles, width), key
        )

    def _paint(
        self, lines: Sequence[_Line], roles: Sequence[str], width: int
    ) -> tuple[float, list[Markup]]:
        """Paint the frames one below the other, on one scale; elements that never move get a low one."""
        indices = sorted({line.index for line in lines})
        ends = [t for line in lines for t in (line.times[0], line.times[-1])]
        x = (min(ends), max(ends))
        moving = {line.index for line in lines if line.moves}
        y = svg.padded(
            [v for line in lines for v in (line.values.min(), line.values.max())], 0.08, 0.05
        )
        row = 220 if len(indices) == 1 else 130 if len(moving) == 2 else 88
        parts: list[Markup] = []
        top = float(svg.TOP + 8)
        for n, index in enumerate(indices):
            here = [line for line in lines if line.index == index]
            high = row if index in moving or len(indices) == 1 else 26
            middle = here[0].values[0]
            frame = Frame(
                svg.LEFT,
                top,
                width - svg.RIGHT,
                top + high - 12,
                x,
                y if high > 26 else (middle, middle),
            )
            parts += frame.y_axis(4 if high > 100 else 3)
            parts += [line.path(frame, width, roles.index(line.role) % 4) for line in here]
            label = f"{self.field}[{index}]" + (f", {self.unit}" if self.unit and n == 0 else "")
            parts.append(
                svg.text(frame.left + 6, top + (1 if high > 26 else 6), label, "start", "label")
            )
            top += high
        return top + svg.BOTTOM, parts + Frame(svg.LEFT, 0, width - svg.RIGHT, top, x, y).x_axis(
            SINCE
        )

    def _caption(self, lines: Sequence[_Line], left_out: int) -> str:
        moving = [
            f"{line.role} {self.field}[{line.index}] {svg.short(line.values.min())} to {svg.short(line.values.max())}"
            for line in lines
            if line.moves
        ]
        still = len(lines) - len(moving)
        shown = "; ".join(moving[:6]) + ("; …" if len(moving) > 6 else "")
        caption = f"Range in {self.unit or 'numbers'}: {shown}." if moving else "Nothing moves."
        caption += f" {still} of {len(lines)} lines do not move." if still else ""
        return caption + (f" {left_out} further elements are not shown." if left_out > 0 else "")


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
            series = numbers.series(recorded)
            if series is not None:
                drawn += _lines(recorded, name, series, range(series.values.shape[1]))
        if not drawn:
            return None
        names = list(self.lines)
        x = (min(line.times[0] for line in drawn), max(line.times[-1] for line in drawn))
        ends = [v for line in drawn for v in (line.values.min(), line.values.max())]

        def paint(width: int) -> tuple[float, list[Markup]]:
            frame = svg.frame_in(
                width, 260, x, svg.padded([*map(float, ends), *self.limits], 0.06, 1e-3), top=30
            )
            parts = [*frame.y_axis(5), svg.text(4, 16, self.unit or "value", "start", "label")]
            for limit in self.limits:
                parts.append(
                    svg.rule(frame.left, frame.py(limit), frame.right, frame.py(limit), "expected")
                )
            parts += [line.path(frame, width, names.index(line.role)) for line in drawn]
            return 260, parts + frame.x_axis(SINCE)

        ranges = (
            f"{line.role} {svg.short(line.values.min())} to {svg.short(line.values.max())}"
            for line in drawn
        )
        dashed = f" Dashed: {', '.join(map(svg.short, self.limits))}." if self.limits else ""
        key = tuple(
            (f"line-{n}", f"{name}: {self.lines[name].field}") for n, name in enumerate(names)
        )
        return Figure(
            f"Range in {self.unit or 'numbers'}: {'; '.join(ranges)}.{dashed}", paint, key
        )


class Reports(FigureKind):
    """What a process reports, and the oracle that knows what is right."""

    artifact: ref.Artifact
    pattern: Patterns
    streams: dict[str, ref.Topic]
    field: ref.FieldPath
    oracle: ref.Loadable
    parameters: dict[str, Any] = Field(default_factory=dict)
    unit: str = ""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw reported numbers over the values that are right."""
        reported = [
            r for r in reports(recorded, self.artifact, self.pattern) if abs(r.value) < _FAR
        ]
        plateaus = self._plateaus(recorded, lab_folder)
        if not reported and not plateaus:
            return None
        shown = _thinned(
            recorded.seconds(np.array([r.t_ns for r in reported])),
            np.array([r.value for r in reported]),
        )
        spans = [*shown[0], *(t for start_s, end_s, _ in plateaus for t in (start_s, end_s))]
        right = [value for _, _, value in plateaus]
        # One absurd report must not press all others flat.
        limit = max(right) * 4 if right and max(right) > 0 else math.inf
        within = np.abs(shown[1]) <= limit
        far = int(np.sum(~within))

        def paint(width: int) -> tuple[float, list[Markup]]:
            y_range = svg.padded([0.0, *shown[1][within], *right], 0.06, 1e-3)
            frame = svg.frame_in(width, 290, (min(spans), max(spans)), y_range, top=30)
            parts = [*frame.y_axis(5), svg.text(4, 16, self.unit or "value", "start", "label")]
            for start_s, end_s, value in plateaus:
                parts.append(
                    svg.rule(
                        frame.px(start_s),
                        frame.py(value),
                        frame.px(end_s),
                        frame.py(value),
                        "plateau",
                    )
                )
            step = 2 if width == svg.NARROW and len(within) > svg.NARROW_POINTS else 1
            for t, v, near in list(zip(*shown, within, strict=True))[::step]:
                if near:
                    parts.append(
                        svg.tag("circle", cx=frame.px(t), cy=frame.py(v), r=2.4, class_="dot")
                    )
            return 290, parts + frame.x_axis(SINCE)

        caption = f"{len(reported)} reported numbers"
        caption += f" and {len(right)} spans in which the right value is known." if right else "."
        caption += f" {far} lie far outside and are not drawn." if far else ""
        return Figure(
            caption, paint, (("dot", "reported by the program"), ("plateau", "right value"))
        )

    def _plateaus(self, recorded: Recorded, lab_folder: Path) -> list[tuple[float, float, float]]:
        """Return the spans in which the right report is one value: start, end, value."""
        oracle = load_oracle(lab_folder, self.oracle)
        try:
            plateaus = oracle(
                recorded.streams(self.streams, self.field), self.parameters, recorded.record.seed
            )
        except Exception:
            # Commands and states that do not fit together are judged by the checks; here is no line to draw.
            return []
        return [
            (
                recorded.since_start_s(s["start_ns"]),
                recorded.since_start_s(s["end_ns"]),
                float(s["value"]),
            )
            for s in plateaus[: svg.MOST_POINTS]
            if abs(s["value"]) < _FAR
        ]
