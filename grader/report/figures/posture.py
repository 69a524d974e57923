"""What stands and moves in space, as a line through points: a robot, and where it is commanded to be; to be played."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from pydantic import Field

from grader.evidence.recorded import Floats, Integers, NumericStream, Recorded
from grader.lab import references as ref
from grader.report.figures.svg import Figure, FigureKind, short, tag
from grader.report.figures.timing import FAR_NS

#: So many postures are enough for ten seconds and more, since the page moves evenly from one to the next.
_MOST_FRAMES = 360
_MOST_CHAIN = 64
#: Farther away is nothing that is meant.
_FAR_M = 1e6
#: A page's numbers are whole; so many of them are half the size of what is shown.
_RADIUS_UNITS = 2000
_HEIGHT = 430
_GRID_LINES = 9
_THICKEST, _THINNEST = 13.0, 5.0
#: So long the tip leaves its way behind.
_WAY_MS = 2000


@dataclass(frozen=True)
class Motion:
    """Postures over time, for the page's player: (frames, points, 3) in whole numbers, the foot of the first at zero.

    The ghost, where there is one, has the last frames; before those nothing was commanded.
    """

    times_ms: Integers
    solid: Integers
    ghost: Integers
    #: From where it is seen at first, in degrees: about the vertical axis from x to y, and above the floor.
    view: tuple[float, float] = (-58.0, 20.0)
    #: Of the picture, to whose middle the foot is put.
    width: int = 640

    @property
    def encoded(self) -> Markup:
        """Times and postures, a row a frame."""
        return encoded(np.column_stack((self.times_ms, self.solid.reshape(len(self.solid), -1))))

    @property
    def encoded_ghost(self) -> Markup:
        """The ghost's postures, a row a frame."""
        return encoded(self.ghost.reshape(len(self.ghost), 3 * self.points))

    @property
    def points(self) -> int:
        """How many points a posture has."""
        return int(self.solid.shape[1])

    @property
    def still(self) -> int:
        """The frame to be shown where nothing moves: that of the greatest distance from the ghost, if there is one."""
        if not len(self.ghost):
            return len(self.solid) // 2
        return len(self.solid) - len(self.ghost) + int(np.argmax(self.off))

    @property
    def off(self) -> Floats:
        """How far the last point is from that of the ghost, in each of the ghost's frames."""
        apart: Floats = np.linalg.norm(
            self.solid[len(self.solid) - len(self.ghost) :, -1] - self.ghost[:, -1], axis=1
        )
        return apart


def encoded(rows: Integers) -> Markup:
    """Write whole numbers as text, each as its difference from the one above it; what changes little is short.

    References
    ----------
    The letters are those of Google's "Encoded Polyline Algorithm Format"; none has a meaning in HTML.
    """
    letters = []
    for number in np.diff(rows, axis=0, prepend=0).ravel().tolist():
        rest = number << 1 if number >= 0 else ~(number << 1)
        while rest >= 0x20:
            letters.append(chr((rest & 0x1F | 0x20) + 63))
            rest >>= 5
        letters.append(chr(rest + 63))
    return Markup("".join(letters))


class Posture(FigureKind):
    """A robot in space, to be played: a line through points that a topic carries, x, y and z of each in m."""

    topics: dict[str, ref.Topic] = Field(
        min_length=1,
        max_length=2,
        description="Role -> topic: first what is, then as a ghost what is to be.",
    )
    field: ref.FieldPath

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw one posture, and give all of them to the page."""
        streams = [_in_space(recorded.numeric(topic, self.field)) for topic in self.topics.values()]
        solid, ghost = (*streams, None)[:2]
        if solid is None:
            return None
        shown = np.unique(np.linspace(0, len(solid.values) - 1, _MOST_FRAMES).round().astype(int))
        beside = np.empty((0, solid.values.shape[1]))
        if ghost is not None and ghost.values.shape[1] == solid.values.shape[1]:
            # Both are published together: what belongs to a posture was sent before the next one.
            until = np.append(solid.source_ns[1:], np.iinfo(np.int64).max)
            latest = (np.searchsorted(ghost.source_ns, until) - 1)[shown]
            beside = ghost.values[latest[latest >= 0]]
        motion, unit_m = _whole(
            recorded.seconds(solid.source_ns[shown]), solid.values[shown], beside
        )
        key = tuple(zip(("line-0", "line-1"), self.topics, strict=False))
        return Figure(
            _caption(motion, unit_m), lambda width: (_HEIGHT, _paint(motion)), key, content=motion
        )


def _in_space(stream: NumericStream | None) -> NumericStream | None:
    """Return the messages that can be drawn; None where they hold no points, or do not move."""
    if (
        stream is None
        or stream.values.shape[1] % 3
        or not 6 <= stream.values.shape[1] <= 3 * _MOST_CHAIN
    ):
        return None
    near = (np.abs(stream.values) < _FAR_M).all(axis=1) & (
        np.abs(stream.source_ns - stream.received_ns) < FAR_NS
    )
    return stream.only(near) if near.sum() > 1 else None


def _whole(times_s: Floats, solid: Floats, ghost: Floats) -> tuple[Motion, float]:
    """Return postures in whole numbers, and what their unit is in m; a ghost far out stays near enough to be drawn."""
    solid, ghost = (rows.reshape(len(rows), rows.shape[1] // 3, 3) for rows in (solid, ghost))
    foot = solid[0, 0]
    radius = max(float(np.linalg.norm(solid - foot, axis=2).max()), 1e-6)
    unit_m = radius / _RADIUS_UNITS
    frames = (
        np.rint(np.clip((rows - foot) / unit_m, -9999, 9999)).astype(np.int64)
        for rows in (solid, ghost)
    )
    return Motion(np.rint(times_s * 1000).astype(np.int64), *frames), unit_m


def _caption(motion: Motion, unit_m: float) -> str:
    if not len(motion.ghost):
        return "No command reached it in this recording."
    at_s, off_m = motion.times_ms[motion.still] / 1000, float(motion.off.max()) * unit_m
    off = f"{short(off_m)} m" if off_m >= 1 else f"{short(1000 * off_m)} mm"
    return f"At {at_s:.2f} s the tip is farthest from where it is commanded to be: {off}."


def projected(points: Integers | Floats) -> Floats:
    """Return where points are in the picture as it is seen at first: (..., 2)."""
    turn, rise = np.radians(Motion.view)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    up = np.array([-np.cos(turn) * np.sin(rise), -np.sin(turn) * np.sin(rise), np.cos(rise)])
    # The foot stands low in the picture, since a robot is above its floor, and in the middle where seen from above.
    scale, foot = 0.72 * _HEIGHT / _RADIUS_UNITS, (0.8 - 0.3 * Motion.view[1] / 90) * _HEIGHT
    return np.stack(
        (Motion.width / 2 + scale * (points @ right), foot - scale * (points @ up)), axis=-1
    )


def _line(points: Floats, class_: str) -> Markup:
    return tag("polyline", points=" ".join(f"{x:.1f},{y:.1f}" for x, y in points), class_=class_)


def _paint(motion: Motion) -> list[Markup]:
    """Paint the still in the parts that the player moves: floor, shadow, the tip's ways, ghost, links and joints."""
    frame, first = motion.still, len(motion.solid) - len(motion.ghost)
    posture, ghost = (
        projected(motion.solid[frame]),
        projected(motion.ghost[frame - first : frame - first + 1]),
    )
    recent = (motion.times_ms > motion.times_ms[frame] - _WAY_MS) & (
        motion.times_ms <= motion.times_ms[frame]
    )
    parts = [
        _floor(),
        _line(projected(motion.solid[frame] * [1, 1, 0]), "shadow"),
        _line(projected(motion.ghost[recent[first:], -1]), "ghost-way"),
        _line(projected(motion.solid[recent, -1]), "way"),
        _line(ghost.reshape(-1, 2), "ghost"),
    ]
    widths = np.linspace(_THICKEST, _THINNEST, max(2, motion.points - 1))
    for (a, b), thick in zip(itertools.pairwise(posture), widths, strict=False):
        parts.append(
            tag("line", x1=a[0], y1=a[1], x2=b[0], y2=b[1], stroke_width=thick, class_="link")
        )
    parts += [tag("circle", cx=x, cy=y, r=2.2, class_="joint") for x, y in posture]
    return parts


def _floor() -> Markup:
    """Return a grid on the floor, as one path."""
    reach = np.linspace(-_RADIUS_UNITS, _RADIUS_UNITS, _GRID_LINES)
    along = [[(at, reach[0], 0), (at, reach[-1], 0)] for at in reach]
    across = [[(y, x, z) for x, y, z in line] for line in along]
    lines = projected(np.array(along + across))
    return tag(
        "path",
        d="".join(f"M{a[0]:.0f} {a[1]:.0f}L{b[0]:.0f} {b[1]:.0f}" for a, b in lines),
        class_="floor",
    )
