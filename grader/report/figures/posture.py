"""Animated postures in space: a line through the measured points, and a ghost through the commanded points."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from pydantic import Field

from grader.evidence.recorded import Booleans, Floats, Integers, NumericStream, Recorded
from grader.lab import references as ref
from grader.report.figures.svg import Canvas, Figure, FigureKind, directions, short
from grader.report.figures.timing import stamped_near_arrival

#: Maximum number of postures in a page; enough for more than ten seconds, because the player interpolates between them.
_MOST_FRAMES = 360
#: Maximum number of points in a posture.
_MOST_POINTS = 64
#: Distance from the origin beyond which a point is not drawn, in m.
_FAR_M = 1e6
#: Greatest distance of a measured point from the foot, in the integer units of the page.
_RADIUS_UNITS = 2000
#: Maximum coordinate in these units; a ghost farther away is drawn there.
_MOST_UNITS = 9999
#: Height of the picture in px.
_HEIGHT = 430
_GRID_LINES = 9
#: Widths of the first and last link in px.
_THICKEST, _THINNEST = 13.0, 5.0
#: Duration of the traces behind the tips, in ms.
_TRACE_MS = 2000
#: Longest time for the jump to the first command, in ms.
_SETTLES_MS = 1000


@dataclass(frozen=True)
class Motion:
    """Postures over time for the page's player, in integer units from the first posture's foot, its first point.

    Frames before the first command have no ghost; without a command, no frame has one.
    """

    #: int64[n]: Times of the frames.
    times_ms: Integers
    #: int64[n, points, 3]: Measured postures.
    solid: Integers
    #: int64[frames with a ghost, points, 3]: Commanded postures.
    ghost: Integers
    #: Initial viewing direction in degrees: azimuth from x towards y, and elevation above the floor.
    view: tuple[float, float] = (-58.0, 20.0)
    #: Width of the picture in px; the foot is at its middle.
    width: int = 640

    @property
    def encoded(self) -> Markup:
        """Times and measured postures as text, one row per frame."""
        postures = self.solid.reshape(len(self.solid), -1)
        return encode(np.column_stack((self.times_ms, postures)))

    @property
    def encoded_ghost(self) -> Markup:
        """Postures of the ghost as text, one row per frame."""
        return encode(self.ghost.reshape(len(self.ghost), 3 * self.points))

    @property
    def points(self) -> int:
        """Number of points in a posture."""
        return int(self.solid.shape[1])

    @property
    def first_ghost(self) -> int:
        """Index of the first frame with a ghost."""
        return len(self.solid) - len(self.ghost)

    @property
    def still(self) -> int:
        """Index of the still frame: the one with the greatest distance once settled; without a ghost, the middle one."""
        if not len(self.ghost):
            return len(self.solid) // 2
        return self.first_ghost + int(np.argmax(self.settled_distances))

    @property
    def tip_distances(self) -> Floats:
        """Distances between the last points of posture and ghost, in the frames with a ghost."""
        tips = self.solid[self.first_ghost :, -1]
        distances: Floats = np.linalg.norm(tips - self.ghost[:, -1], axis=1)
        return distances

    @property
    def settled_distances(self) -> Floats:
        """Distances between the tips, 0 until the posture has settled after the first command; all in a short motion."""
        times_ms = self.times_ms[self.first_ghost :]
        is_settled = times_ms >= times_ms[0] + _SETTLES_MS
        if not is_settled.any():
            return self.tip_distances
        distances: Floats = self.tip_distances * is_settled
        return distances


def encode(rows: Integers) -> Markup:
    """Return rows of integers as text, with each number as its difference from the number above.

    Small differences need few letters: the rows (5, 7) and (5, 8) become `IM?A`.

    References
    ----------
    The letters are those of Google's "Encoded Polyline Algorithm Format"; none of them is special in HTML.
    """
    letters = []
    for number in np.diff(rows, axis=0, prepend=0).ravel().tolist():
        rest = number << 1
        if number < 0:
            rest = ~rest
        while rest >= 0x20:
            letters.append(chr((rest & 0x1F | 0x20) + 63))
            rest >>= 5
        letters.append(chr(rest + 63))
    return Markup("".join(letters))


class Posture(FigureKind):
    """An animated robot in space: a line through the points in a topic's messages, each with x, y and z in m."""

    topics: dict[str, ref.Topic] = Field(
        min_length=1,
        max_length=2,
        description="Role -> topic: first the measured points, then the commanded ones as a ghost.",
    )
    field: ref.FieldPath

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the still frame, and pass the whole motion to the page."""
        streams = []
        for topic in self.topics.values():
            streams.append(_drawable(recorded.numeric(topic, self.field)))
        solid, *others = streams
        if solid is None:
            return None
        count = len(solid.values)
        shown: Integers = np.linspace(0, count - 1, _MOST_FRAMES).round().astype(int)
        shown = np.unique(shown)
        ghost = _ghost_rows(solid, others[0] if others else None, shown)
        times_s = recorded.seconds(solid.source_ns[shown])
        motion, unit_m = _motion_of(times_s, solid.values[shown], ghost)
        key = tuple(zip(("line-0", "line-1"), self.topics, strict=False))
        still = _Still(motion)
        return Figure(_caption(motion, unit_m), still.paint, key, content=motion)


def _drawable(stream: NumericStream | None) -> NumericStream | None:
    """Return the messages that can be drawn; None if their numbers are not points, or if fewer than two can be drawn."""
    if stream is None:
        return None
    length = stream.values.shape[1]
    if length % 3 or not 6 <= length <= 3 * _MOST_POINTS:
        return None
    is_near = (np.abs(stream.values) < _FAR_M).all(axis=1)
    drawable = is_near & stamped_near_arrival(stream)
    if drawable.sum() < 2:
        return None
    return stream.only(drawable)


def _ghost_rows(solid: NumericStream, ghost: NumericStream | None, shown: Integers) -> Floats:
    """Return the ghost of each shown posture, without the postures before the first command: float64[n, 3 * points]."""
    length = solid.values.shape[1]
    if ghost is None or ghost.values.shape[1] != length:
        return np.empty((0, length))
    # A command and its posture are published together; the last command before the next posture belongs to the posture.
    end = np.iinfo(np.int64).max
    until_ns = np.append(solid.source_ns[1:], end)
    latest = (np.searchsorted(ghost.source_ns, until_ns) - 1)[shown]
    return ghost.values[latest[latest >= 0]]


def _motion_of(times_s: Floats, solid: Floats, ghost: Floats) -> tuple[Motion, float]:
    """Return the motion in integer units, and the unit in m."""
    solid = _points_of(solid)
    foot = solid[0, 0]
    radius_m = float(np.linalg.norm(solid - foot, axis=2).max())
    unit_m = max(radius_m, 1e-6) / _RADIUS_UNITS
    times_ms = np.rint(times_s * 1000).astype(np.int64)
    whole = _in_units(solid - foot, unit_m)
    whole_ghost = _in_units(_points_of(ghost) - foot, unit_m)
    return Motion(times_ms, whole, whole_ghost), unit_m


def _points_of(rows: Floats) -> Floats:
    """Reshape rows of numbers into points: float64[n, points, 3]."""
    return rows.reshape(len(rows), rows.shape[1] // 3, 3)


def _in_units(points: Floats, unit_m: float) -> Integers:
    """Return points in integer multiples of a unit, clipped to the maximum coordinate."""
    bounded = np.clip(points / unit_m, -_MOST_UNITS, _MOST_UNITS)
    return np.rint(bounded).astype(np.int64)


def _caption(motion: Motion, unit_m: float) -> str:
    if not len(motion.ghost):
        return "There is no ghost, because this recording holds no commanded points to draw."
    at_s = motion.times_ms[motion.still] / 1000
    off_m = float(motion.settled_distances.max()) * unit_m
    if off_m >= 1:
        off = f"{short(off_m)} m"
    else:
        off = f"{short(1000 * off_m)} mm"
    farthest = f"the tip is farthest from its commanded position at {at_s:.2f} s: {off}."
    return f"From {_SETTLES_MS / 1000:g} s after the first command on, {farthest}"


def projected(points: Integers | Floats) -> Floats:
    """Project points into the picture, as seen from the initial viewing direction: float64[..., 2]."""
    turn, rise = np.radians(Motion.view)
    right, up = directions(turn, rise)
    scale = 0.72 * _HEIGHT / _RADIUS_UNITS
    # Seen from the side, the foot is low in the picture, because a robot stands above its floor. Seen from above, the
    # foot is in the middle.
    foot = (0.8 - 0.3 * Motion.view[1] / 90) * _HEIGHT
    x = Motion.width / 2 + scale * (points @ right)
    y = foot - scale * (points @ up)
    return np.stack((x, y), axis=-1)


@dataclass(frozen=True)
class _Still:
    """The still frame of a motion, drawn with the elements that the player moves."""

    motion: Motion

    def paint(self, canvas: Canvas) -> None:
        canvas.height = _HEIGHT
        _paint_floor(canvas)
        self._paint_shadow(canvas)
        self._paint_traces(canvas)
        self._paint_ghost(canvas)
        posture = projected(self.motion.solid[self.motion.still])
        _paint_links(canvas, posture)
        for x, y in posture:
            canvas.dot(x, y, 2.2, "joint")

    def _paint_shadow(self, canvas: Canvas) -> None:
        posture = self.motion.solid[self.motion.still]
        canvas.polyline(projected(posture * [1, 1, 0]), "shadow")

    def _paint_traces(self, canvas: Canvas) -> None:
        """Draw the paths of both tips up to the still frame."""
        motion = self.motion
        now_ms = motion.times_ms[motion.still]
        is_recent: Booleans = motion.times_ms > now_ms - _TRACE_MS
        traced = is_recent & (motion.times_ms <= now_ms)
        ghost_tips = motion.ghost[traced[motion.first_ghost :], -1]
        canvas.polyline(projected(ghost_tips), "ghost-way")
        canvas.polyline(projected(motion.solid[traced, -1]), "way")

    def _paint_ghost(self, canvas: Canvas) -> None:
        """Draw the ghost as a line; without a ghost, the line is empty."""
        frame = self.motion.still - self.motion.first_ghost
        ghost = projected(self.motion.ghost[frame : frame + 1])
        canvas.polyline(ghost.reshape(-1, 2), "ghost")


def _paint_links(canvas: Canvas, posture: Floats) -> None:
    """Draw the links between neighbouring points, each thinner than the previous one."""
    widths = np.linspace(_THICKEST, _THINNEST, max(2, len(posture) - 1))
    links = itertools.pairwise(posture)
    for (start, end), width in zip(links, widths, strict=False):
        x1, y1 = start
        x2, y2 = end
        canvas.add("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke_width=width, class_="link")


def _paint_floor(canvas: Canvas) -> None:
    """Draw a grid on the floor, as one path."""
    reach = np.linspace(-_RADIUS_UNITS, _RADIUS_UNITS, _GRID_LINES)
    along = [[(at, reach[0], 0), (at, reach[-1], 0)] for at in reach]
    across = [[(reach[0], at, 0), (reach[-1], at, 0)] for at in reach]
    segments = []
    for start, end in projected(np.array(along + across)):
        segments.append(f"M{start[0]:.0f} {start[1]:.0f}L{end[0]:.0f} {end[1]:.0f}")
    canvas.path("".join(segments), "floor")
