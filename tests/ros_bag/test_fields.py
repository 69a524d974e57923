"""Types are known by their fields: at a path, and by the numbers in them."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from ros_bag.fields import (
    PACKAGES_OF_ROSBAGS,
    NoSuchField,
    holds_numbers,
    is_number,
    numbers_in,
    type_at,
)

POINT = "geometry_msgs/msg/Point"


@pytest.mark.parametrize(
    ("name", "path", "spelled"),
    [
        ("geometry_msgs/msg/PoseStamped", "pose.position.x", "float64"),
        ("geometry_msgs/msg/PoseStamped", "pose.position", POINT),
        ("std_msgs/msg/Float64MultiArray", "data", "float64[]"),
        ("std_msgs/msg/Float64MultiArray", "data[3]", "float64"),
        ("tf2_msgs/msg/TFMessage", "transforms[0].child_frame_id", "string"),
        ("nobody_msgs/msg/Unknown", "data", None),
    ],
)
def test_a_path_leads_to_a_type(name: str, path: str, spelled: str | None) -> None:
    """Messages within messages and elements of arrays are entered; nothing is known of an unknown type."""
    assert type_at(name, path) == spelled


def test_a_missing_field_is_told_with_the_known_ones() -> None:
    """The error names the type without the field, and lists its fields."""
    with pytest.raises(NoSuchField, match=f"{POINT} has no field 'w'") as caught:
        type_at("geometry_msgs/msg/Pose", "position.w")
    assert (caught.value.field, caught.value.known) == ("w", ("x", "y", "z"))


@pytest.mark.parametrize("path", ["data[0]", "data.", "0", ""])
def test_a_wrong_path_is_refused(path: str) -> None:
    """A text has no elements, and a path begins with a name."""
    with pytest.raises(ValueError, match=r"no elements|no path|no field"):
        type_at("std_msgs/msg/String", path)


@pytest.mark.parametrize(
    ("spelled", "holds", "count"),
    [
        ("float64", True, 1),
        ("bool", True, 1),
        ("string", False, 1),
        ("float64[]", True, None),
        (POINT, True, 3),
        ("geometry_msgs/msg/Quaternion", True, 4),
        ("builtin_interfaces/msg/Time", True, 1),
        ("std_msgs/msg/Header", False, 2),
        ("nobody_msgs/msg/Unknown", True, None),
    ],
)
def test_numbers_in_a_type_are_counted(spelled: str, holds: bool, count: int | None) -> None:
    """A vector has a number for each axis, a time has one; an unknown type may hold numbers."""
    assert holds_numbers(spelled) is holds
    assert numbers_in(spelled) == count


def test_texts_and_messages_are_no_numbers() -> None:
    """A type is a number by its spelling, with all lengths of integers and floats."""
    assert all(map(is_number, ("int8", "uint64", "float32", "double", "byte", "char")))
    assert not any(map(is_number, ("string", "float64[]", POINT)))


def test_the_packages_of_rosbags_are_listed() -> None:
    """A type of another package is looked up without the descriptions of `rosbags`."""
    known = get_typestore(Stores.ROS2_JAZZY).fielddefs
    assert {name.partition("/")[0] for name in known} == PACKAGES_OF_ROSBAGS
