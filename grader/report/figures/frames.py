"""The frames that nodes broadcast: as a tree, and where they lie in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from grader.evidence.recorded import Floats, Recorded
from grader.evidence.transforms import Broadcast, FrameTree, broadcasts, composed
from grader.lab import references as ref
from grader.report.escape import line
from grader.report.figures.svg import Figure, FigureKind, short, tag, text

#: Frames that are drawn, and how deep the tree is.
_MOST_FRAMES, _DEEPEST = 24, 12
_ROW, _INDENT, _SPACE = 22, 16, 300
#: Below this width the tree stands above the space, and not beside it.
_SIDE_BY_SIDE = 600
#: From where space is seen, in degrees: about the vertical, and above the floor.
_TURN, _RISE = np.radians((35.0, 22.0))
#: Length of an axis, as a share of the space that all frames take.
_AXIS_SHARE = 0.14
#: Width of a letter of a name, and height of a line.
_LETTER, _LINE = 7, 13


@dataclass(frozen=True)
class _Drawn:
    """A frame: how deep it lies in the tree, what is said of it, and its pose in the root."""

    name: str
    depth: int
    words: str
    parent: int | None
    pose: Floats


class Frames(FigureKind):
    """All frames as a tree, and where they lie in space at the last time that is known of each."""

    topic: ref.Topic = "/tf"
    static_topic: ref.Topic = "/tf_static"

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the trees one below the other, and the first of them in space."""
        of_topics = ((self.topic, False), (self.static_topic, True))
        tree = FrameTree(
            edge
            for topic, static in of_topics
            for edge in broadcasts(recorded.stream(topic), static=static)
        )
        frames = _frames_of(tree)
        if not frames:
            return None
        roots = sum(frame.parent is None for frame in frames)

        def paint(width: int) -> tuple[float, list[Markup]]:
            listed = [part for n, frame in enumerate(frames) for part in _row(n, frame)]
            below = 0 if width >= _SIDE_BY_SIDE else len(frames) * _ROW + 10
            left = width * 0.45 if not below else 0.0
            return max(len(frames) * _ROW + 8, below + _SPACE), listed + _in_space(
                frames, left, below, width - left
            )

        known = f"{len(tree.edges)} frame{'s' * (len(tree.edges) != 1)} below {roots} root{'s' * (roots != 1)}"
        caption = f"{known}, at the last time that is known of each."
        return Figure(caption, paint, (("line-0", "x"), ("line-1", "y"), ("line-2", "z")))


def _frames_of(tree: FrameTree) -> list[_Drawn]:
    """Return the roots, each with what lies below it; of a circle nothing is below a root."""
    below: dict[str, list[Broadcast]] = {}
    for edge in tree.edges.values():
        below.setdefault(edge.parent, []).append(edge)
    roots = [name for name in below if name not in tree.edges]
    found: list[_Drawn] = []
    nothing = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    waiting: list[tuple[str, int, str, int | None, str]] = [
        (root, 0, "", None, root) for root in reversed(roots)
    ]
    while waiting and len(found) < _MOST_FRAMES:
        name, depth, words, parent, root = waiting.pop()
        times_ns = tree.times_ns(name, root)[-1:]
        pose = tree.pose(name, root, times_ns) if depth else nothing
        found.append(
            _Drawn(
                line(name, 40),
                depth,
                words,
                parent,
                nothing if pose is None or not len(pose) else pose,
            )
        )
        if depth < _DEEPEST:
            place = len(found) - 1
            waiting += [
                (e.child, depth + 1, _words(e), place, root) for e in reversed(below.get(name, []))
            ]
    return found


def _words(edge: Broadcast) -> str:
    """Say how a frame was sent."""
    if edge.static:
        return "static"
    # By the usual gap, whatever pauses there are.
    gaps_ns = np.diff(np.unique(edge.source_ns))
    return f"{short(1e9 / float(np.median(gaps_ns)))} Hz" if len(gaps_ns) else "sent once"


def _row(number: int, frame: _Drawn) -> list[Markup]:
    x, y = 6 + _INDENT * frame.depth, 16 + _ROW * number
    branch: list[Markup] = []
    if frame.parent is not None:
        top = 20 + _ROW * frame.parent
        branch = [tag("path", d=f"M{x - 10} {top}V{y - 4}H{x - 2}", class_="stem", fill="none")]
    label = Markup("{} {}").format(
        tag("tspan", frame.name, class_="label"), tag("tspan", frame.words)
    )
    return [*branch, tag("text", label, x=x, y=y, text_anchor="start")]


def _in_space(frames: Sequence[_Drawn], left: float, top: float, width: float) -> list[Markup]:
    """Draw each frame as three axes, with a line from its parent's, and its name."""
    poses = np.vstack([frame.pose for frame in frames])
    finite: NDArray[np.bool_] = np.isfinite(poses.sum(axis=1))
    size = float(np.ptp(poses[finite, :3], axis=0).max(initial=0.0)) or 1.0
    # The ends of the axes, as poses in each frame.
    ends = [
        composed(poses, np.tile([*(size * _AXIS_SHARE * axis), 0, 0, 0, 1], (len(poses), 1)))
        for axis in np.eye(3)
    ]
    flat = np.stack([_projected(rows[:, :3]) for rows in (poses, *ends)], axis=1)
    low, high = (of(flat[finite].reshape(-1, 2), axis=0) for of in (np.min, np.max))
    scale = min(
        (width - 130) / max(high[0] - low[0], 1e-9), (_SPACE - 40) / max(high[1] - low[1], 1e-9)
    )
    spare = width - 130 - (high[0] - low[0]) * scale
    flat = np.array([left + 20 + spare / 2, top + 20]) + (flat - low) * scale
    parts, names, places = list[Markup](), list[Markup](), list[tuple[float, float, float]]()
    for frame, known, (origin, *tips) in zip(frames, finite, flat, strict=True):
        if not known:
            continue
        if frame.parent is not None and finite[frame.parent]:
            parts.append(_segment(flat[frame.parent, 0], origin, "stem"))
        parts += [_segment(origin, tip, f"line line-{n}") for n, tip in enumerate(tips)]
        place = _free(
            (float(origin[0]) + 5, float(origin[1]) + 19, _LETTER * len(frame.name)), places
        )
        names.append(text(*place[:2], frame.name, "start", "note"))
        places.append(place)
    return parts + names


def _free(
    place: tuple[float, float, float], taken: Sequence[tuple[float, float, float]]
) -> tuple[float, float, float]:
    """Return a place for a name (left, baseline, length), as far below another as it takes to be read."""
    left, y, length = place
    # From above to below, each once: two baselines that are a line apart may be less than that by a rounding.
    for low in sorted(
        low for start, low, long in taken if start < left + length and left < start + long
    ):
        if abs(low - y) < _LINE:
            y = low + _LINE
    return left, y, length


def _projected(points: Floats) -> Floats:
    """Return where points lie in the picture, downwards: float64[n, 2]."""
    right = np.array([-np.sin(_TURN), np.cos(_TURN), 0.0])
    up = np.array([-np.cos(_TURN) * np.sin(_RISE), -np.sin(_TURN) * np.sin(_RISE), np.cos(_RISE)])
    return np.stack((points @ right, -(points @ up)), axis=-1)


def _segment(start: Floats, end: Floats, class_: str) -> Markup:
    return tag(
        "polyline", points=f"{start[0]:.1f},{start[1]:.1f} {end[0]:.1f},{end[1]:.1f}", class_=class_
    )
