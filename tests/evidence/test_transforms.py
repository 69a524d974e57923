"""Transforms: composition, interpolation and trees against computations of another kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from grader.evidence.cpu_delay import Span
from grader.evidence.transforms import (
    TF_MESSAGE,
    Broadcast,
    FrameTree,
    broadcasts,
    circle_in,
    composed,
    inverse,
    parents_of,
    pose_of,
    poses_apart,
    unit,
)
from ros_bag.definitions import SEPARATOR
from tests.synthetic import START_NS, Session, at

Floats = NDArray[np.float64]
numbers = st.floats(-10, 10, allow_subnormal=False)


def is_rotation(pose: Floats) -> bool:
    """Return whether a quaternion is long enough to be divided by its length."""
    return bool(np.linalg.norm(pose[3:]) > 0.01)


poses = (
    arrays(np.float64, 7, elements=numbers)
    .filter(is_rotation)
    .map(lambda pose: unit(pose[np.newaxis]))
)


def matrix(pose: Floats) -> Floats:
    """Give the homogeneous matrix of a pose; the columns of its rotation are written out by Rodrigues' formula."""
    x, y, z, w = pose[0, 3:]
    angle, norm = 2 * np.arctan2(np.linalg.norm([x, y, z]), w), float(np.linalg.norm([x, y, z]))
    if norm > 0:
        axis = np.array([x, y, z]) / norm
    else:
        axis = np.array([0.0, 0.0, 1.0])
    across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    found = np.eye(4)
    found[:3, :3] = np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
    found[:3, 3] = pose[0, :3]
    return found


@given(poses, poses)
def test_poses_compose_as_matrices_multiply(outer: Floats, inner: Floats) -> None:
    """Quaternions and homogeneous matrices agree."""
    assert np.allclose(matrix(composed(outer, inner)), matrix(outer) @ matrix(inner), atol=1e-9)
    assert np.allclose(matrix(inverse(outer)), np.linalg.inv(matrix(outer)), atol=1e-9)


@given(poses, poses)
def test_the_distance_of_poses_is_that_of_matrices(one: Floats, other: Floats) -> None:
    """The angle between rotations follows from their matrices, for both signs of a quaternion."""
    distance_m, angle_deg = poses_apart(one, other * np.array([1, 1, 1, -1, -1, -1, -1]))
    between = matrix(one)[:3, :3].T @ matrix(other)[:3, :3]
    cosine = np.clip((np.trace(between) - 1) / 2, -1, 1)
    assert distance_m[0] == pytest.approx(np.linalg.norm(matrix(one)[:3, 3] - matrix(other)[:3, 3]))
    assert np.cos(np.radians(angle_deg[0])) == pytest.approx(cosine, abs=1e-9)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_roll_pitch_and_yaw_turn_about_fixed_axes(rpy: list[float]) -> None:
    """Roll first, then pitch, then yaw, each about the axes of the parent."""
    axes = []
    for n, angle in enumerate(rpy):
        axes.append(pose_of((0, 0, 0), [angle if n == k else 0.0 for k in range(3)]))
    roll, pitch, yaw = map(matrix, axes)
    assert np.allclose(matrix(pose_of((0, 0, 0), rpy)), yaw @ pitch @ roll, atol=1e-9)


def edge(parent: str, child: str, *stamped: tuple[int, Floats], static: bool = False) -> Broadcast:
    """Return the transforms broadcast for a frame, each published at its stamp."""
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in stamped], dtype=np.int64)
    return Broadcast(
        parent, child, static, False, stamps_ns, stamps_ns, np.vstack([pose for _, pose in stamped])
    )


@given(st.lists(poses, min_size=4, max_size=4), st.integers(0, 3), st.integers(0, 3))
def test_any_two_frames_of_a_tree_are_connected_by_what_lies_between(
    chain: list[Floats], one: int, other: int
) -> None:
    """In a tree with two branches, a pose is the product of matrices up to the root and down."""
    parents, frames = ["root", "a", "root", "c"], ["a", "b", "c", "d"]
    tree = FrameTree(
        edge(parent, frame, (0, pose), static=True)
        for parent, frame, pose in zip(parents, frames, chain, strict=True)
    )
    in_root = {"root": np.eye(4)}
    for parent, frame, pose in zip(parents, frames, chain, strict=True):
        in_root[frame] = in_root[parent] @ matrix(pose)
    found = tree.pose(frames[one], frames[other], tree.times_ns(frames[one], frames[other]))
    assert found is not None
    assert np.allclose(
        matrix(found), np.linalg.inv(in_root[frames[other]]) @ in_root[frames[one]], atol=1e-8
    )


@given(poses, poses, st.floats(0, 1))
def test_between_two_stamps_a_frame_turns_evenly(first: Floats, last: Floats, share: float) -> None:
    """The position is on the straight line, and the angle to the first pose is its share of the whole."""
    length_ns = 10**9
    found = edge("a", "b", (START_NS, first), (START_NS + length_ns, last)).at(
        np.array([START_NS + round(share * length_ns)], dtype=np.int64)
    )
    whole, part = poses_apart(first, last)[1][0], poses_apart(first, found)[1][0]
    assert part == pytest.approx(share * whole, abs=1e-3)
    assert np.allclose(found[0, :3], (1 - share) * first[0, :3] + share * last[0, :3], atol=1e-6)


def test_nothing_is_known_outside_of_what_was_sent_unless_it_is_static() -> None:
    """Nothing is extrapolated.

    A static frame keeps its last transform, and a transform sent twice counts once.
    """
    here, there = pose_of((1, 0, 0), (0, 0, 0)), pose_of((2, 0, 0), (0, 0, 0))
    times_ns = np.array([5, 10, 20, 25], dtype=np.int64)
    moving = edge("a", "b", (10, here), (10, here), (20, there)).at(times_ns)
    assert np.isnan(moving[[0, 3], 0]).all()
    assert moving[1:3, 0].tolist() == [1.0, 2.0]
    assert (
        edge("a", "b", (10, here), (20, there), static=True).at(times_ns)[:, 0].tolist()
        == [2.0] * 4
    )
    assert edge("a", "b", (10, here)).at(times_ns)[1, 0] == 1.0


def test_a_circle_and_two_parents_are_found() -> None:
    """A circle is named by its frames; looking a pose up in one ends."""
    pairs = [("a", "b"), ("b", "c"), ("c", "a"), ("root", "d"), ("other", "d")]
    assert circle_in(parents_of(pairs)) == ["b", "a", "c", "b"]
    assert parents_of(pairs)["d"] == ["root", "other"]
    assert circle_in(parents_of(pairs[3:])) == []
    here = pose_of((1, 0, 0), (0, 0, 0))
    tree = FrameTree(edge(parent, child, (0, here), static=True) for parent, child in pairs)
    assert tree.pose("a", "d", np.array([0])) is None
    assert tree.pose("nobody", "nobody", np.array([0])) is None


def transform(parent: str, child: str, time_s: float, x: float = 0.0) -> dict[str, Any]:
    """Give a transform of a message."""
    stamp = {"sec": at(time_s) // 10**9, "nanosec": at(time_s) % 10**9}
    pose = {"translation": {"x": x}, "rotation": {"w": 1.0}}
    return {
        "header": {"frame_id": parent, "stamp": stamp},
        "child_frame_id": child,
        "transform": pose,
    }


def test_messages_are_read_by_frame(tmp_path: Path) -> None:
    """Several transforms in a message, names with slashes, stamps out of order, and a window."""
    sent = [
        [transform("/odom", "base", 1.2), transform("base", "laser", 1.1)],
        [transform("odom", "base", 1.1, 2.0)],
    ]
    recorded = (
        Session(tmp_path)
        .typed("/tf", TF_MESSAGE, [{"transforms": each} for each in sent], [1.2, 1.4])
        .recorded()
    )
    base, laser = broadcasts(recorded.stream("/tf"), static=False)
    assert (base.parent, base.child, base.slashed, laser.slashed) == ("odom", "base", True, False)
    assert base.stamps_ns.tolist() == [at(1.1), at(1.2)]
    assert base.poses[:, 0].tolist() == [2.0, 0.0]
    assert len(base.within(Span(at(1.3), at(2.0))).stamps_ns) == 1


def test_other_types_and_floods_give_nothing_and_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A topic of another type has no transforms, and of a flood of frames only the first are kept."""
    monkeypatch.setattr("grader.evidence.transforms._MOST_EDGES", 3)
    many = [{"transforms": [transform("map", f"frame{n}", 1.0) for n in range(5)]}]
    session = Session(tmp_path).typed("/tf", TF_MESSAGE, many, [1.0])
    session.typed("/other", "geometry_msgs/msg/TransformStamped", [transform("a", "b", 1.0)], [1.0])
    recorded = session.recorded()
    assert len(broadcasts(recorded.stream("/tf"), static=False)) == 3
    assert broadcasts(recorded.stream("/other"), static=False) == ()


ANEW = """Sent[] transforms
{line}
MSG: tf2_msgs/Sent
Head header
{name} child_frame_id
float64[7] transform
{line}
MSG: tf2_msgs/Head
{name} frame_id
When stamp
{line}
MSG: tf2_msgs/When
int64 sec
float64 nanosec
"""


@pytest.mark.parametrize(
    ("name", "value", "sec", "nanosec"),
    [
        ("string", "base", 2**62, 0.0),
        ("string", "base", 1, np.inf),
        ("uint8[]", np.zeros(3, np.uint8), 1, np.nan),
    ],
)
def test_a_type_that_is_defined_anew_breaks_nothing(
    tmp_path: Path, name: str, value: Any, sec: int, nanosec: float
) -> None:
    """A student's type of the same name with other fields is no transform."""
    definition = ANEW.format(line=SEPARATOR, name=name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, TF_MESSAGE))
    of = {kind: store.types[f"tf2_msgs/msg/{kind}"] for kind in ("Sent", "Head", "When")}
    sent = of["Sent"](of["Head"](value, of["When"](sec, nanosec)), value, np.ones(7))
    data = bytes(store.serialize_cdr(store.types[TF_MESSAGE]([sent]), TF_MESSAGE))
    stream = (
        Session(tmp_path).raw("/tf", TF_MESSAGE, definition, [data], [1.0]).recorded().stream("/tf")
    )
    assert stream.field("transforms")[0]
    assert broadcasts(stream, static=False) == ()


def test_transforms_that_are_no_list_are_none(tmp_path: Path) -> None:
    """Numbers in place of a list of transforms give none."""
    data = b"\0\1\0\0" + b"\2\0\0\0" + b"\1\1"
    stream = (
        Session(tmp_path)
        .raw("/tf", TF_MESSAGE, "uint8[] transforms", [data], [1.0])
        .recorded()
        .stream("/tf")
    )
    assert len(stream.field("transforms")[0]) == 2
    assert broadcasts(stream, static=False) == ()
