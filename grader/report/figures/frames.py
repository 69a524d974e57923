"""The frames that nodes broadcast: as a tree, and in space."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from markupsafe import Markup

from grader.evidence.recorded import Booleans, Floats, Recorded
from grader.evidence.transforms import Broadcast, FrameTree, broadcasts, composed
from grader.lab import references as ref
from grader.report.escape import line
from grader.report.figures.svg import Canvas, Figure, FigureKind, directions, short, tag

_MOST_FRAMES = 24
#: Levels of the tree below its root.
_DEEPEST = 12
#: Heights of a row and of the space, and indentation of a level, in px.
_ROW, _INDENT, _SPACE = 22, 16, 300
#: Width in px from which the space is drawn next to the tree and not below it.
_SIDE_BY_SIDE = 600
#: Viewing direction in radians: about the vertical axis, and above the floor.
_TURN, _RISE = np.radians((35.0, 22.0))
#: Length of an axis, as a share of the extent of all frames.
_AXIS_SHARE = 0.14
#: Width of a name's letter and height of its line in px.
_LETTER, _LINE = 7, 13
#: Margins around the frames in space in px: in total to the left and right, and above and below.
_SIDES, _ENDS = 130, 40
#: Pose of a frame in itself: position, and rotation as a quaternion.
_IDENTITY: Floats = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])


class Frames(FigureKind):
    """All frames as a tree, and where they lie in space at the last time that is known of each."""

    topic: ref.Topic = "/tf"
    static_topic: ref.Topic = "/tf_static"

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw all trees one below the other, and their frames in space."""
        moving = broadcasts(recorded.stream(self.topic), static=False)
        static = broadcasts(recorded.stream(self.static_topic), static=True)
        tree = FrameTree([*moving, *static])
        frames = _frames_of(tree)
        if not frames:
            return None
        key = (("line-0", "x"), ("line-1", "y"), ("line-2", "z"))
        return Figure(_caption(tree, frames), _FramesChart(frames).paint, key)


@dataclass(frozen=True)
class _Drawn:
    """A frame as it is drawn."""

    name: str
    #: Levels below the root.
    depth: int
    #: Description of how the frame was sent.
    words: str
    #: Index of the parent among the drawn frames; None for a root.
    parent: int | None
    #: float64[1, 7]: Pose in the root.
    pose: Floats


def _caption(tree: FrameTree, frames: Sequence[_Drawn]) -> str:
    roots = [frame for frame in frames if frame.parent is None]
    counted = f"{_counted(len(tree.edges), 'frame')} below {_counted(len(roots), 'root')}"
    return f"{counted}, at the last time that is known of each."


def _counted(number: int, noun: str) -> str:
    """Write a number with its noun: `1 frame`, `2 frames`."""
    if number != 1:
        noun += "s"
    return f"{number} {noun}"


# -- the tree ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Waiting:
    """A frame on the way through the tree."""

    name: str
    root: str
    depth: int = 0
    words: str = ""
    parent: int | None = None


def _frames_of(tree: FrameTree) -> list[_Drawn]:
    """Return each root with the frames below it, depth first; frames in a cycle have no root."""
    below = _children(tree.edges.values())
    roots = [name for name in below if name not in tree.edges]
    waiting = [_Waiting(root, root) for root in reversed(roots)]
    found: list[_Drawn] = []
    while waiting and len(found) < _MOST_FRAMES:
        frame = waiting.pop()
        if frame.depth < _DEEPEST:
            waiting += _next_level(frame, below, len(found))
        name = line(frame.name, 40)
        pose = _last_pose(tree, frame)
        found.append(_Drawn(name, frame.depth, frame.words, frame.parent, pose))
    return found


def _children(edges: Iterable[Broadcast]) -> dict[str, list[Broadcast]]:
    """Return the broadcasts of each parent's children."""
    below: dict[str, list[Broadcast]] = {}
    for edge in edges:
        below.setdefault(edge.parent, []).append(edge)
    return below


def _next_level(
    frame: _Waiting, below: Mapping[str, Sequence[Broadcast]], place: int
) -> list[_Waiting]:
    """Return the children of a frame, the last one first, for a stack."""
    children = []
    for edge in reversed(below.get(frame.name, [])):
        child = _Waiting(edge.child, frame.root, frame.depth + 1, _words(edge), place)
        children.append(child)
    return children


def _last_pose(tree: FrameTree, frame: _Waiting) -> Floats:
    """Return the last known pose of a frame in its root."""
    if not frame.depth:
        return _IDENTITY
    times_ns = tree.times_ns(frame.name, frame.root)[-1:]
    pose = tree.pose(frame.name, frame.root, times_ns)
    if pose is None or not len(pose):
        return _IDENTITY
    return pose


def _words(edge: Broadcast) -> str:
    """Describe how a frame was sent: `static`, `50 Hz`, `sent once`."""
    if edge.static:
        return "static"
    gaps_ns = np.diff(np.unique(edge.source_ns))
    if not len(gaps_ns):
        return "sent once"
    # Pauses do not change the median.
    usual_ns = float(np.median(gaps_ns))
    return f"{short(1e9 / usual_ns)} Hz"


# -- the picture -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _FramesChart:
    """Frames as a tree and in space."""

    frames: Sequence[_Drawn]

    def paint(self, canvas: Canvas) -> None:
        for number, frame in enumerate(self.frames):
            _paint_row(canvas, number, frame)
        tree_height = len(self.frames) * _ROW
        if canvas.width >= _SIDE_BY_SIDE:
            left, top = canvas.width * 0.45, 0
        else:
            left, top = 0.0, tree_height + 10
        canvas.height = max(tree_height + 8, top + _SPACE)
        _paint_space(canvas, self.frames, left, top)


def _paint_row(canvas: Canvas, number: int, frame: _Drawn) -> None:
    """Draw a frame's name in the tree, with a branch from its parent."""
    x = 6 + _INDENT * frame.depth
    y = 16 + _ROW * number
    if frame.parent is not None:
        top = 20 + _ROW * frame.parent
        branch = f"M{x - 10} {top}V{y - 4}H{x - 2}"
        canvas.add("path", d=branch, class_="stem", fill="none")
    name = tag("tspan", frame.name, class_="label")
    words = tag("tspan", frame.words)
    canvas.add("text", Markup("{} {}").format(name, words), x=x, y=y, text_anchor="start")


@dataclass(frozen=True)
class _Flat:
    """Frames in the plane of the picture."""

    #: float64[n, 4, 2]: Origin and the ends of three axes of each frame in px.
    points: Floats
    #: bool[n]: Frames with a finite pose; only these are drawn.
    finite: Booleans

    def paint_axes(self, canvas: Canvas, place: int, parent: int | None) -> None:
        """Draw the axes of a frame, with a line from its parent."""
        origin, *tips = self.points[place]
        if parent is not None and self.finite[parent]:
            canvas.polyline([self.points[parent, 0], origin], "stem")
        for number, tip in enumerate(tips):
            canvas.polyline([origin, tip], f"line line-{number}")


def _paint_space(canvas: Canvas, frames: Sequence[_Drawn], left: float, top: float) -> None:
    """Draw each frame as three axes, with a line from its parent, and all names above them."""
    flat = _flat(frames, left, top, canvas.width - left)
    names: list[_Name] = []
    for place in np.flatnonzero(flat.finite).tolist():
        frame = frames[place]
        flat.paint_axes(canvas, place, frame.parent)
        x, y = flat.points[place, 0]
        name = _Name(frame.name, float(x) + 5, float(y) + 19)
        names.append(_moved_down(name, names))
    for name in names:
        canvas.text(name.left, name.baseline, name.text, "start", "note")


def _flat(frames: Sequence[_Drawn], left: float, top: float, width: float) -> _Flat:
    """Project frames to the picture, scaled to a width in px."""
    poses = np.vstack([frame.pose for frame in frames])
    finite: Booleans = np.isfinite(poses.sum(axis=1))
    corners = _axes(poses, _extent(poses[finite]))
    points = np.stack([_projected(each) for each in corners], axis=1)
    drawn = points[finite].reshape(-1, 2)
    low = np.min(drawn, axis=0)
    wide, high = np.max(drawn, axis=0) - low
    room = width - _SIDES
    scale = min(room / max(wide, 1e-9), (_SPACE - _ENDS) / max(high, 1e-9))
    spare = room - wide * scale
    corner = np.array([left + 20 + spare / 2, top + 20])
    return _Flat(corner + (points - low) * scale, finite)


def _extent(poses: Floats) -> float:
    """Return the largest distance of origins along an axis; 1 if all are at one position."""
    extents = np.ptp(poses[:, :3], axis=0)
    return float(extents.max(initial=0.0)) or 1.0


def _axes(poses: Floats, size: float) -> list[Floats]:
    """Return the origins of n frames, and the ends of their x, y and z axes: four times float64[n, 3]."""
    points = [poses[:, :3]]
    for axis in np.eye(3):
        end = [*(size * _AXIS_SHARE * axis), 0, 0, 0, 1]
        ends = composed(poses, np.tile(end, (len(poses), 1)))
        points.append(ends[:, :3])
    return points


def _projected(points: Floats) -> Floats:
    """Return the positions of points in the picture, y downwards: float64[n, 2]."""
    right, up = directions(_TURN, _RISE)
    return np.stack((points @ right, -(points @ up)), axis=-1)


@dataclass(frozen=True)
class _Name:
    """A frame's name in space, at its left end and baseline in px."""

    text: str
    left: float
    baseline: float

    @property
    def right(self) -> float:
        return self.left + _LETTER * len(self.text)


def _moved_down(name: _Name, others: Sequence[_Name]) -> _Name:
    """Return a name below all others that it would cover."""
    beside = []
    for other in others:
        if other.left < name.right and name.left < other.right:
            beside.append(other.baseline)
    # Each baseline is passed once, from above: by rounding, two that are a line apart may appear nearer.
    for baseline in sorted(beside):
        if abs(baseline - name.baseline) < _LINE:
            name = replace(name, baseline=baseline + _LINE)
    return name
