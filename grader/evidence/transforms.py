"""Transforms between frames as nodes broadcast them: which frame is whose child, where it lies there, and when.

A pose is seven numbers: x, y and z in m, and a quaternion x, y, z, w; `float64[n, 7]` are the poses at n times.

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
from grader.recording.bag import Stream

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
#: What is looked at: a flood of transforms, of frames, or of a name's characters says no more.
_MOST_TRANSFORMS, _MOST_EDGES, _LONGEST_NAME = 200_000, 1000, 100
#: Times at which a pose is looked at.
_MOST_TIMES = 200
#: Quaternions so close to each other are interpolated in a straight line.
_SAME = 1 - 1e-9


@dataclass(frozen=True, eq=False)
class Broadcast:
    """All that was sent of one frame in one parent on one topic, in the order of its stamps."""

    #: Without the slash that they may have been sent with.
    parent: str
    child: str
    static: bool
    #: Whether a name was sent with a leading slash.
    slashed: bool
    #: int64[n]: The stamps, and when each was published.
    stamps_ns: Integers
    source_ns: Integers
    #: float64[n, 7]: The poses of the child in the parent as they were sent.
    poses: Floats

    def within(self, span: Span | None) -> Broadcast:
        """Return what was published within a span; of static ones, and without a span, all."""
        if span is None or self.static:
            return self
        rows = (self.source_ns >= span.start_ns) & (self.source_ns <= span.end_ns)
        return replace(
            self,
            stamps_ns=self.stamps_ns[rows],
            source_ns=self.source_ns[rows],
            poses=self.poses[rows],
        )

    def exchanged(self) -> Broadcast:
        """Return it with parent and child the other way round, for the same numbers."""
        return replace(self, parent=self.child, child=self.parent)

    def at(self, times_ns: Integers) -> Floats:
        """Return the poses at some times, interpolated; not a number outside of what was sent, unless it is static."""
        if self.static:
            return np.repeat(unit(self.poses[-1:]), len(times_ns), axis=0)
        stamps_ns, rows = np.unique(self.stamps_ns, return_index=True)
        poses = unit(self.poses[rows])
        after = np.clip(
            np.searchsorted(stamps_ns, times_ns), min(1, len(stamps_ns) - 1), len(stamps_ns) - 1
        )
        before = np.maximum(after - 1, 0)
        lengths = np.maximum(stamps_ns[after] - stamps_ns[before], 1)
        found = _between(poses[before], poses[after], (times_ns - stamps_ns[before]) / lengths)
        found[(times_ns < stamps_ns[0]) | (times_ns > stamps_ns[-1])] = np.nan
        return found


def broadcasts(stream: Stream, *, static: bool) -> tuple[Broadcast, ...]:
    """Return what was broadcast on a topic, one entry for each frame and parent; nothing of another type."""
    rows: dict[tuple[str, str], list[tuple[int, int, Floats]]] = {}
    slashed: set[tuple[str, str]] = set()
    for source_ns, each in _sent(stream):
        if (read := _read(each)) is None:
            continue
        names, stamp_ns, pose = read
        edge = (names[0].removeprefix("/"), names[1].removeprefix("/"))
        if edge in rows or len(rows) < _MOST_EDGES:
            rows.setdefault(edge, []).append((stamp_ns, source_ns, pose))
            slashed |= {edge} if edge != names else set()
    return tuple(_broadcast(edge, static, edge in slashed, listed) for edge, listed in rows.items())


def _read(transform: Any) -> tuple[tuple[str, str], int, Floats] | None:
    """Return the names in a transform, its stamp in ns and its pose; None for what is none.

    The student's workspace may define the type anew, with whatever fields.
    """
    with suppress(Exception):
        names = (
            str(transform.header.frame_id)[:_LONGEST_NAME],
            str(transform.child_frame_id)[:_LONGEST_NAME],
        )
        stamp_ns, pose = time_ns(transform.header.stamp), numbers_of(transform.transform)
        if stamp_ns is not None and pose is not None and len(pose) == 7:
            return names, int(np.int64(stamp_ns)), pose
    return None


def _sent(stream: Stream) -> Iterator[tuple[int, Any]]:
    """Give the transforms of a topic's messages, each with its message's time of publication."""
    listed = stream.field("transforms") if stream.topic_type == TF_MESSAGE else []
    left = _MOST_TRANSFORMS
    for source_ns, transforms in zip(stream.source_ns.tolist(), listed, strict=False):
        for each in transforms[:left] if isinstance(transforms, list) else ():
            yield source_ns, each
            left -= 1


def _broadcast(
    edge: tuple[str, str], static: bool, slashed: bool, rows: Sequence[tuple[int, int, Floats]]
) -> Broadcast:
    ordered = sorted(rows, key=lambda row: row[:2])
    stamps_ns, source_ns = (np.array([row[n] for row in ordered], dtype=np.int64) for n in (0, 1))
    return Broadcast(
        *edge, static, slashed, stamps_ns, source_ns, np.array([row[2] for row in ordered])
    )


class FrameTree:
    """Frames with one parent each; where a frame has several, with the last that is given."""

    def __init__(self, edges: Iterable[Broadcast]) -> None:
        self.edges = {edge.child: edge for edge in edges if len(edge.stamps_ns)}

    def path(self, frame: str) -> list[Broadcast]:
        """Return what leads from a frame up to its root, or once round a circle."""
        found: dict[str, Broadcast] = {}
        while frame in self.edges and frame not in found:
            found[frame] = self.edges[frame]
            frame = found[frame].parent
        return list(found.values())

    def between(self, frame: str, other: str) -> tuple[list[Broadcast], list[Broadcast]] | None:
        """Return what leads from two frames up to the first that is above both; None where none is."""
        up, down = self.path(frame), self.path(other)
        ours, theirs = (
            [start, *(edge.parent for edge in way)] for start, way in ((frame, up), (other, down))
        )
        known = all(
            name in self.edges or any(e.parent == name for e in self.edges.values())
            for name in (frame, other)
        )
        common = next((name for name in ours if name in theirs), None)
        if common is None or not known:
            return None
        return up[: ours.index(common)], down[: theirs.index(common)]

    def pose(self, frame: str, other: str, times_ns: Integers) -> Floats | None:
        """Return the poses of a frame in another at some times; None where the tree does not connect them."""
        ways = self.between(frame, other)
        if ways is None:
            return None
        inside, outside = (_chained(way, times_ns) for way in ways)
        return composed(inverse(outside), inside)

    def rolled(self, edges: Sequence[Broadcast]) -> FrameTree:
        """Return the tree in which some quaternions are read as if they had been sent in the order w, x, y, z."""
        read = (
            replace(
                edge, poses=np.hstack((edge.poses[:, :3], np.roll(edge.poses[:, 3:], -1, axis=1)))
            )
            for edge in edges
        )
        return FrameTree([*self.edges.values(), *read])

    def times_ns(self, frame: str, other: str) -> Integers:
        """Return stamps, evenly chosen, at which all is known that lies between two frames that are connected."""
        ways = self.between(frame, other) or ([], [])
        edges = [edge for way in ways for edge in way]
        moving = [edge.stamps_ns for edge in edges if not edge.static]
        if not moving:
            return np.array([edges[0].stamps_ns[-1] if edges else 0], dtype=np.int64)
        stamps_ns = np.unique(np.concatenate(moving))
        start_ns, end_ns = max(each[0] for each in moving), min(each[-1] for each in moving)
        shared: Integers = stamps_ns[(stamps_ns >= start_ns) & (stamps_ns <= end_ns)]
        return shared[:: -(-len(shared) // _MOST_TIMES) or 1]


def parents_of(edges: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Return the parents of each child, by pairs of a parent and a child."""
    found: dict[str, list[str]] = {}
    for parent, child in edges:
        found.setdefault(child, []).append(parent)
    return {child: list(dict.fromkeys(parents)) for child, parents in found.items()}


def circle_in(parents: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the frames of a circle, in which each has the next as a parent; empty if there is none."""
    done: set[str] = set()
    for start in parents:
        way: list[str] = []
        frame: str | None = start
        while frame is not None and frame not in done and frame not in way:
            way.append(frame)
            frame = next(iter(parents.get(frame, ())), None)
        if frame in way:
            return [*way[way.index(frame) :], frame]
        done.update(way)
    return []


# -- poses -----------------------------------------------------------------------------------------


def unit(poses: Floats) -> Floats:
    """Return poses with quaternions of length 1; one of length 0 is not a number."""
    norms = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.hstack((poses[:, :3], poses[:, 3:] / norms))


def pose_of(xyz: Sequence[float], rpy: Sequence[float]) -> Floats:
    """Return a pose, float64[1, 7], by position in m and by roll, pitch and yaw in rad about fixed axes, as in URDF."""
    roll, pitch, yaw = (
        np.array([[*(np.sin(angle / 2) * axis), np.cos(angle / 2)]])
        for angle, axis in zip(rpy, np.eye(3), strict=True)
    )
    return np.hstack((np.array([xyz], dtype=np.float64), _product(yaw, _product(pitch, roll))))


def composed(outer: Floats, inner: Floats) -> Floats:
    """Return the poses in a frame of what has the poses `inner` in another that itself has the poses `outer` there."""
    return np.hstack(
        (outer[:, :3] + _rotated(outer[:, 3:], inner[:, :3]), _product(outer[:, 3:], inner[:, 3:]))
    )


def inverse(poses: Floats) -> Floats:
    """Return the poses of the parent in the child."""
    back = poses[:, 3:] * np.array([-1.0, -1.0, -1.0, 1.0])
    return np.hstack((-_rotated(back, poses[:, :3]), back))


def poses_apart(poses: Floats, others: Floats) -> tuple[Floats, Floats]:
    """Return how far poses are apart, in m and in degrees: float64[n] each."""
    distance_m = np.linalg.norm(poses[:, :3] - others[:, :3], axis=1)
    # By the tangent, since the cosine of a small angle is 1 but for rounding.
    turn = _product(poses[:, 3:] * np.array([-1.0, -1.0, -1.0, 1.0]), others[:, 3:])
    angle = 2 * np.arctan2(np.linalg.norm(turn[:, :3], axis=1), np.abs(turn[:, 3]))
    return distance_m, np.degrees(angle)


def _chained(way: Sequence[Broadcast], times_ns: Integers) -> Floats:
    """Return the poses of the first frame of a way up in the last parent."""
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(times_ns), 1))
    for edge in way:
        poses = composed(edge.at(times_ns), poses)
    return poses


def _between(before: Floats, after: Floats, shares: NDArray[np.float64]) -> Floats:
    """Interpolate between poses."""
    share = shares[:, np.newaxis]
    position = before[:, :3] + share * (after[:, :3] - before[:, :3])
    cosine = np.sum(before[:, 3:] * after[:, 3:], axis=1, keepdims=True)
    target = np.where(cosine < 0, -after[:, 3:], after[:, 3:])  # the shorter of the two ways round
    cosine = np.clip(np.abs(cosine), 0.0, 1.0)
    angle, straight = np.arccos(cosine), cosine > _SAME
    sine = np.where(straight, 1.0, np.sin(angle))
    parts = [np.where(straight, part, np.sin(part * angle) / sine) for part in (1 - share, share)]
    return unit(np.hstack((position, parts[0] * before[:, 3:] + parts[1] * target)))


def _product(p: Floats, q: Floats) -> Floats:
    (px, py, pz, pw), (qx, qy, qz, qw) = p.T, q.T
    return np.stack(
        (
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ),
        axis=1,
    )


def _rotated(quaternions: Floats, vectors: Floats) -> Floats:
    turned = np.cross(quaternions[:, :3], vectors)
    found: Floats = vectors + 2 * (
        quaternions[:, 3:] * turned + np.cross(quaternions[:, :3], turned)
    )
    return found
