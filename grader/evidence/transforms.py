"""Transforms between frames as nodes broadcast them: each frame's parent, its pose there, and the time.

A pose holds seven numbers: x, y and z in m, and a quaternion x, y, z, w. An array `float64[n, 7]` holds the poses at n
times.

References
----------
tf2's `BufferCore` interpolates positions linearly and quaternions along the great circle, and does not extrapolate.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grader.evidence.cpu_delay import Span
from grader.evidence.fields import numbers_of, time_ns
from grader.evidence.recorded import Floats, Integers
from ros_bag.reading import Stream

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
#: Transforms of a topic that are read.
_MOST_TRANSFORMS = 200_000
#: Pairs of frame and parent of a topic that are read.
_MOST_EDGES = 1000
#: Characters of a frame's name that are read.
_LONGEST_NAME = 100
#: Times at which a pose is evaluated.
_MOST_TIMES = 200
#: Cosine of half the angle below which quaternions are interpolated along a straight line.
_SAME = 1 - 1e-9
#: Numbers of a pose.
_POSE_LENGTH = 7
_IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
#: Factors that turn a quaternion into its conjugate.
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])

#: Names of parent and child.
Edge = tuple[str, str]
#: A stamp in ns, the time of publication in ns, and a pose.
_Row = tuple[int, int, Floats]


@dataclass(frozen=True, eq=False)
class Broadcast:
    """All transforms of one frame in one parent on one topic, in the order of their stamps."""

    #: Without a leading slash.
    parent: str
    child: str
    static: bool
    #: True if a name was sent with a leading slash.
    slashed: bool
    #: int64[n]: Stamps.
    stamps_ns: Integers
    #: int64[n]: Times of publication.
    source_ns: Integers
    #: float64[n, 7]: Poses of the child in the parent, as they were sent.
    poses: Floats

    def within(self, span: Span | None) -> Broadcast:
        """Return the transforms published within a span; all of them without a span, or if they are static."""
        if span is None or self.static:
            return self
        started = self.source_ns >= span.start_ns
        rows = started & (self.source_ns <= span.end_ns)
        stamps_ns = self.stamps_ns[rows]
        source_ns = self.source_ns[rows]
        poses = self.poses[rows]
        return replace(self, stamps_ns=stamps_ns, source_ns=source_ns, poses=poses)

    def exchanged(self) -> Broadcast:
        """Return the broadcast with the names of parent and child exchanged, and the same numbers."""
        return replace(self, parent=self.child, child=self.parent)

    def at(self, times_ns: Integers) -> Floats:
        """Return the poses at some times, interpolated.

        A static pose is the last one at all times. Other poses are NaN before the first stamp and after the last.
        """
        if self.static:
            last = unit(self.poses[-1:])
            return np.repeat(last, len(times_ns), axis=0)
        stamps_ns, rows = np.unique(self.stamps_ns, return_index=True)
        poses = unit(self.poses[rows])
        last_row = len(stamps_ns) - 1
        found_rows = np.searchsorted(stamps_ns, times_ns)
        after = np.clip(found_rows, min(1, last_row), last_row)
        before = np.maximum(after - 1, 0)
        lengths = np.maximum(stamps_ns[after] - stamps_ns[before], 1)
        shares = (times_ns - stamps_ns[before]) / lengths
        found = _between(poses[before], poses[after], shares)
        found[times_ns < stamps_ns[0]] = np.nan
        found[times_ns > stamps_ns[-1]] = np.nan
        return found


@dataclass(frozen=True)
class _Transform:
    """A transform of a message: names as they were sent, stamp in ns, pose."""

    parent: str
    child: str
    stamp_ns: int
    pose: Floats


def broadcasts(stream: Stream, *, static: bool) -> tuple[Broadcast, ...]:
    """Return the broadcasts of a topic, one for each pair of frame and parent; none of a topic of another type."""
    rows: dict[Edge, list[_Row]] = {}
    slashed: set[Edge] = set()
    for source_ns, sent in _sent(stream):
        transform = _read(sent)
        if transform is None:
            continue
        parent = transform.parent.removeprefix("/")
        child = transform.child.removeprefix("/")
        edge = (parent, child)
        if edge not in rows and len(rows) >= _MOST_EDGES:
            continue
        row = (transform.stamp_ns, source_ns, transform.pose)
        rows.setdefault(edge, []).append(row)
        if edge != (transform.parent, transform.child):
            slashed.add(edge)
    found = []
    for edge, listed in rows.items():
        found.append(_broadcast(edge, static, edge in slashed, listed))
    return tuple(found)


def _read(sent: Any) -> _Transform | None:
    """Return a transform of a message; None if it is not valid.

    A student's workspace can define the type again, with other fields.
    """
    with suppress(Exception):
        header = sent.header
        parent = str(header.frame_id)[:_LONGEST_NAME]
        child = str(sent.child_frame_id)[:_LONGEST_NAME]
        stamp_ns = time_ns(header.stamp)
        pose = numbers_of(sent.transform)
        if stamp_ns is None or pose is None:
            return None
        if len(pose) == _POSE_LENGTH:
            return _Transform(parent, child, int(np.int64(stamp_ns)), pose)
    return None


def _sent(stream: Stream) -> Iterator[tuple[int, Any]]:
    """Yield the transforms of a topic's messages, each with the time at which its message was published."""
    if stream.topic_type != TF_MESSAGE:
        return
    left = _MOST_TRANSFORMS
    listed = stream.field("transforms")
    for source_ns, transforms in zip(stream.source_ns.tolist(), listed, strict=False):
        if not isinstance(transforms, list):
            continue
        for transform in transforms[:left]:
            yield source_ns, transform
            left -= 1


def _broadcast(edge: Edge, static: bool, slashed: bool, rows: Sequence[_Row]) -> Broadcast:
    ordered = sorted(rows, key=lambda row: row[:2])
    stamps_ns, source_ns, poses = zip(*ordered, strict=True)
    return Broadcast(
        *edge,
        static,
        slashed,
        np.array(stamps_ns, dtype=np.int64),
        np.array(source_ns, dtype=np.int64),
        np.array(poses),
    )


class FrameTree:
    """Frames with one parent each; of several parents of a frame, the last that is given."""

    def __init__(self, edges: Iterable[Broadcast]) -> None:
        self.edges: dict[str, Broadcast] = {}
        for edge in edges:
            if len(edge.stamps_ns):
                self.edges[edge.child] = edge

    def path(self, frame: str) -> list[Broadcast]:
        """Return the edges from a frame up to its root, or once round a circle."""
        found: dict[str, Broadcast] = {}
        while frame in self.edges and frame not in found:
            edge = self.edges[frame]
            found[frame] = edge
            frame = edge.parent
        return list(found.values())

    def between(self, frame: str, other: str) -> tuple[list[Broadcast], list[Broadcast]] | None:
        """Return the edges from each of two frames up to their first common frame; None if there is none."""
        if not self._is_known(frame) or not self._is_known(other):
            return None
        up = self.path(frame)
        down = self.path(other)
        above = [frame]
        above.extend(edge.parent for edge in up)
        above_other = [other]
        above_other.extend(edge.parent for edge in down)
        for steps, name in enumerate(above):
            if name in above_other:
                return up[:steps], down[: above_other.index(name)]
        return None

    def _is_known(self, frame: str) -> bool:
        if frame in self.edges:
            return True
        return any(edge.parent == frame for edge in self.edges.values())

    def pose(self, frame: str, other: str, times_ns: Integers) -> Floats | None:
        """Return the poses of a frame in another at some times; None if the tree does not connect them."""
        ways = self.between(frame, other)
        if ways is None:
            return None
        inside = _chained(ways[0], times_ns)
        outside = _chained(ways[1], times_ns)
        return composed(inverse(outside), inside)

    def rolled(self, edges: Sequence[Broadcast]) -> FrameTree:
        """Return the tree with the quaternions of some edges read in the order w, x, y, z."""
        read = list(self.edges.values())
        for edge in edges:
            quaternions = np.roll(edge.poses[:, 3:], -1, axis=1)
            poses = np.hstack((edge.poses[:, :3], quaternions))
            read.append(replace(edge, poses=poses))
        return FrameTree(read)

    def times_ns(self, frame: str, other: str) -> Integers:
        """Return evenly chosen stamps at which the pose of a frame in another, connected one is known."""
        ways = self.between(frame, other) or ([], [])
        edges = ways[0] + ways[1]
        moving = [edge.stamps_ns for edge in edges if not edge.static]
        if not moving:
            only_ns = edges[0].stamps_ns[-1] if edges else 0
            return np.array([only_ns], dtype=np.int64)
        stamps_ns = np.unique(np.concatenate(moving))
        start_ns = max(each[0] for each in moving)
        end_ns = min(each[-1] for each in moving)
        is_shared = (stamps_ns >= start_ns) & (stamps_ns <= end_ns)
        shared: Integers = stamps_ns[is_shared]
        every = -(-len(shared) // _MOST_TIMES) or 1
        return shared[::every]


def parents_of(edges: Iterable[Edge]) -> dict[str, list[str]]:
    """Return the parents of each child, without repetitions."""
    found: dict[str, list[str]] = {}
    for parent, child in edges:
        parents = found.setdefault(child, [])
        if parent not in parents:
            parents.append(parent)
    return found


def circle_in(parents: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the frames of a circle, each followed by one of its parents; empty if there is no circle.

    For example `["a", "b", "a"]`.
    """
    done: set[str] = set()
    for start in parents:
        way: list[str] = []
        frame: str | None = start
        while frame is not None and frame not in done:
            if frame in way:
                break
            way.append(frame)
            above = parents.get(frame, ())
            frame = above[0] if above else None
        if frame in way:
            return [*way[way.index(frame) :], frame]
        done.update(way)
    return []


# -- poses -----------------------------------------------------------------------------------------


def unit(poses: Floats) -> Floats:
    """Return poses with quaternions of length 1; a quaternion of length 0 becomes NaN."""
    quaternions = poses[:, 3:]
    norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.hstack((poses[:, :3], quaternions / norms))


def pose_of(xyz: Sequence[float], rpy: Sequence[float]) -> Floats:
    """Return a pose from a position and angles about fixed axes, as in URDF.

    Parameters
    ----------
    xyz
        Position in m.
    rpy
        Roll, pitch and yaw in rad.

    Returns
    -------
    float64[1, 7]
    """
    position = np.array([xyz], dtype=np.float64)
    rotation = _IDENTITY[np.newaxis, 3:]
    for angle, axis in zip(rpy, np.eye(3), strict=True):
        vector = np.sin(angle / 2) * axis
        turn = np.array([[*vector, np.cos(angle / 2)]])
        rotation = _product(turn, rotation)
    return np.hstack((position, rotation))


def composed(outer: Floats, inner: Floats) -> Floats:
    """Return poses given in a frame (`inner`) as poses in the frame that this frame is given in (`outer`)."""
    rotations = outer[:, 3:]
    positions = outer[:, :3] + _rotated(rotations, inner[:, :3])
    return np.hstack((positions, _product(rotations, inner[:, 3:])))


def inverse(poses: Floats) -> Floats:
    """Return the poses of the parent in the child."""
    back = poses[:, 3:] * _CONJUGATE
    return np.hstack((-_rotated(back, poses[:, :3]), back))


def poses_apart(poses: Floats, others: Floats) -> tuple[Floats, Floats]:
    """Return the distances between poses in m, and the angles in degrees: float64[n] each."""
    apart = poses[:, :3] - others[:, :3]
    distance_m = np.linalg.norm(apart, axis=1)
    # The cosine of a small angle is 1 except for rounding; the tangent is exact.
    turn = _product(poses[:, 3:] * _CONJUGATE, others[:, 3:])
    sine = np.linalg.norm(turn[:, :3], axis=1)
    angle = 2 * np.arctan2(sine, np.abs(turn[:, 3]))
    return distance_m, np.degrees(angle)


def _chained(way: Sequence[Broadcast], times_ns: Integers) -> Floats:
    """Return the poses of the first frame of a way up in the last parent."""
    poses = np.tile(_IDENTITY, (len(times_ns), 1))
    for edge in way:
        poses = composed(edge.at(times_ns), poses)
    return poses


def _between(before: Floats, after: Floats, shares: NDArray[np.float64]) -> Floats:
    """Interpolate between poses: share 0 is the pose before, 1 the pose after."""
    share = shares[:, np.newaxis]
    position = before[:, :3] + share * (after[:, :3] - before[:, :3])
    start = before[:, 3:]
    target = after[:, 3:]
    cosine = np.sum(start * target, axis=1, keepdims=True)
    # The shorter of the two ways round.
    target = np.where(cosine < 0, -target, target)
    cosine = np.clip(np.abs(cosine), 0.0, 1.0)
    is_straight = cosine > _SAME
    angle = np.arccos(cosine)
    sine = np.where(is_straight, 1.0, np.sin(angle))
    start_part = np.where(is_straight, 1 - share, np.sin((1 - share) * angle) / sine)
    target_part = np.where(is_straight, share, np.sin(share * angle) / sine)
    rotation = start_part * start + target_part * target
    return unit(np.hstack((position, rotation)))


def _product(p: Floats, q: Floats) -> Floats:
    """Multiply quaternions, float64[n, 4] each."""
    px, py, pz, pw = p.T
    qx, qy, qz, qw = q.T
    x = pw * qx + px * qw + py * qz - pz * qy
    y = pw * qy - px * qz + py * qw + pz * qx
    z = pw * qz + px * qy - py * qx + pz * qw
    w = pw * qw - px * qx - py * qy - pz * qz
    return np.stack((x, y, z, w), axis=1)


def _rotated(quaternions: Floats, vectors: Floats) -> Floats:
    """Rotate vectors, float64[n, 3]."""
    axes = quaternions[:, :3]
    turned = np.cross(axes, vectors)
    change = quaternions[:, 3:] * turned + np.cross(axes, turned)
    found: Floats = vectors + 2 * change
    return found
