"""Values of any field of any message, as numbers, texts and times."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grader.evidence.fields import equal_within, value_at
from grader.evidence.recorded import Recorded
from ros_bag.definitions import SEPARATOR
from tests.synthetic import Session, at, evenly

TIMES = evenly(10, 0.5)


def recorded(folder: Path, kind: str, fields: dict[str, Any]) -> Recorded:
    """Record messages that are all alike."""
    return Session(folder).typed("/it", kind, [fields] * len(TIMES), TIMES).recorded()


@pytest.mark.parametrize(
    ("kind", "fields", "path", "numbers"),
    [
        ("std_msgs/msg/Float32", {"data": 0.5}, "data", [0.5]),
        ("std_msgs/msg/Bool", {"data": True}, "data", [1.0]),
        ("geometry_msgs/msg/Pose", {"position": {"x": 1.0, "z": 3.0}}, "position", [1.0, 0.0, 3.0]),
        ("geometry_msgs/msg/Pose", {"position": {"x": 1.0, "z": 3.0}}, "position.z", [3.0]),
        (
            "geometry_msgs/msg/PoseStamped",
            {"pose": {"orientation": {"w": 1.0}}},
            "pose.orientation",
            [0, 0, 0, 1.0],
        ),
        ("geometry_msgs/msg/Twist", {"angular": {"z": -2.0}}, "angular.z", [-2.0]),
        ("sensor_msgs/msg/LaserScan", {"ranges": [1.0, 2.5]}, "ranges", [1.0, 2.5]),
        ("sensor_msgs/msg/LaserScan", {"ranges": [1.0, 2.5]}, "ranges[1]", [2.5]),
        (
            "geometry_msgs/msg/Polygon",
            {"points": [{"x": 1.0}, {"y": 2.0}]},
            "points",
            [1.0, 0, 0, 0, 2.0, 0],
        ),
        ("geometry_msgs/msg/Polygon", {"points": [{"x": 1.0}, {"y": 2.0}]}, "points[1].y", [2.0]),
        ("std_msgs/msg/Header", {"stamp": {"sec": 3, "nanosec": 500_000_000}}, "stamp", [3.5]),
        (
            "nav_msgs/msg/Odometry",
            {"pose": {"covariance": [0.25] * 36}},
            "pose.covariance[35]",
            [0.25],
        ),
    ],
)
def test_numbers_are_found_in_any_field(
    tmp_path: Path, kind: str, fields: dict[str, Any], path: str, numbers: list[float]
) -> None:
    """A number, an array and fields made of numbers give a row; an index selects one element."""
    series = recorded(tmp_path, kind, fields).numeric("/it", path)
    assert series is not None
    assert series.values.tolist() == [numbers] * len(TIMES)
    assert series.index.tolist() == list(range(len(TIMES)))


@pytest.mark.parametrize(
    ("kind", "fields", "path"),
    [
        ("geometry_msgs/msg/PoseStamped", {"header": {"frame_id": "map"}}, "header"),
        ("geometry_msgs/msg/PoseStamped", {}, "pose.position[0]"),
        ("geometry_msgs/msg/PoseStamped", {}, "pose.posture.x"),
        ("geometry_msgs/msg/Polygon", {"points": [{}] * 4000}, "points"),
        ("std_msgs/msg/String", {"data": "1.5"}, "data"),
    ],
)
def test_what_holds_no_numbers_gives_none(
    tmp_path: Path, kind: str, fields: dict[str, Any], path: str
) -> None:
    """Texts, missing fields and vectors that are too long give no numbers."""
    assert recorded(tmp_path, kind, fields).numeric("/it", path) is None


def test_texts_and_stamps_stand_by_message(tmp_path: Path) -> None:
    """Each message has its own text and stamp, or none."""
    header = {"stamp": {"sec": 2, "nanosec": 7}, "frame_id": "map"}
    session = recorded(tmp_path, "geometry_msgs/msg/PoseStamped", {"header": header})
    assert session.texts("/it", "header.frame_id") == ("map",) * len(TIMES)
    assert session.texts("/it", "header.stamp") == (None,) * len(TIMES)
    assert session.stamps_ns("/it") == (2_000_000_007,) * len(TIMES)
    assert session.stamps_ns("/it", "header.frame_id") == (None,) * len(TIMES)


def test_times_and_rows_keep_together_when_some_are_left_out(tmp_path: Path) -> None:
    """The remaining rows of a series keep their times and places."""
    messages = [{"data": float(n)} for n in range(len(TIMES))]
    series = (
        Session(tmp_path)
        .typed("/it", "std_msgs/msg/Float64", messages, TIMES, 0.01)
        .recorded()
        .numeric("/it", "data")
    )
    assert series is not None
    rest = series.only(np.array([True, False, False, True, False, True]))
    assert rest.values[:, 0].tolist() == rest.index.tolist() == [0, 3, 5]
    assert rest.source_ns.tolist() == [at(TIMES[n]) for n in (0, 3, 5)]
    assert rest.received_ns.tolist() == [at(TIMES[n] + 0.01) for n in (0, 3, 5)]


RESULT = {"pose": {"x": 1.0, "name": "a"}, "rows": [1, 2.5], "done": True}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("pose.x", 1.0),
        ("rows[1]", 2.5),
        ("rows.0", 1),
        ("rows[2]", None),
        ("pose.y", None),
        ("rows.x", None),
    ],
)
def test_values_of_what_stands_in_a_result_are_found_by_paths(path: str, value: object) -> None:
    """A missing field or element has no value."""
    assert value_at(RESULT, path) == value


@pytest.mark.parametrize(
    ("wanted", "tolerance", "equal"),
    [
        ({"pose": {"x": 1.25}}, 0.25, True),
        ({"pose": {"x": 1.25}}, 0.2, False),
        ({"pose": {"x": 1, "name": "a"}, "done": True}, 0.0, True),
        ({"pose": {"name": "b"}}, 1.0, False),
        ({"pose.x": 1.0, "rows": [1, 2.4]}, 0.11, True),
        ({"rows": [1]}, 1.0, False),
        ({"rows": [1, "2.5"]}, 1.0, False),
        ({"rows": {"x": 1}}, 1.0, False),
        ({}, 0.0, True),
    ],
)
def test_values_are_compared_within_a_tolerance(
    wanted: dict[str, Any], tolerance: float, equal: bool
) -> None:
    """Numbers may differ; texts and lengths may not; fields that nobody asked for do not count."""
    assert equal_within(RESULT, wanted, tolerance) is equal
    assert not equal_within({"x": float("nan")}, {"x": 1.0}, 1e9)


@pytest.mark.parametrize(
    ("got", "right"), [(math.inf, True), (-math.inf, False), (1.0, False), (math.nan, False)]
)
def test_an_infinite_number_equals_itself(got: float, right: bool) -> None:
    """A laser's range is infinite where nothing is, and the difference of two such is no number."""
    assert equal_within(got, math.inf, 0.1) is right


def test_an_element_that_is_true_or_false_is_a_number(tmp_path: Path) -> None:
    """A true or false element is a number, like a true or false field."""
    session = (
        Session(tmp_path)
        .raw("/it", "own/msg/Flags", "bool[] data\n", [b"\0\1\0\0\2\0\0\0\0\1"], [1.0])
        .recorded()
    )
    assert [row.tolist() for row in session.rows("/it", "data[1]") if row is not None] == [[1.0]]


def test_an_element_that_is_not_there_is_not_another_field(tmp_path: Path) -> None:
    """The seventh joint of two gets no default value, unlike a field that only another type has."""
    assert (
        recorded(tmp_path, "sensor_msgs/msg/JointState", {"position": [1.0, 2.0]}).numeric(
            "/it", "position[6]"
        )
        is None
    )


def test_a_type_of_the_students_own_has_no_stamp_that_breaks_a_check(tmp_path: Path) -> None:
    """Fields of a student's own type, whatever their names, are no time."""
    definition = f"H header\n{SEPARATOR}\nMSG: own/H\nT stamp\n{SEPARATOR}\nMSG: own/T\nint32 sec\nstring nanosec\n"
    message = b"\0\1\0\0" + struct.pack("<iI", 1, 2) + b"x\0"
    session = Session(tmp_path).raw("/it", "own/msg/It", definition, [message], [1.0]).recorded()
    assert session.stamps_ns("/it") == (None,)
