"""Values in messages of real types, which students choose."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Polygon, PoseWithCovariance
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64, Float64MultiArray, Header, Int32

from grader.live.ros_node.filling import DoesNotFit, fields_in, filled


def test_what_fits_is_serialized() -> None:
    """Whole numbers are written into fields of floats, also in arrays and in messages within messages."""
    values = {"pose": {"position": {"x": 1}}, "covariance": [0] * 36}
    sent = deserialize_message(
        serialize_message(filled(PoseWithCovariance, values)), PoseWithCovariance
    )
    assert (sent.pose.position.x, list(sent.covariance)) == (1.0, [0.0] * 36)
    points = filled(Polygon, {"points": [{"x": 1, "y": 2.5}]}).points
    assert (points[0].x, points[0].y) == (1.0, 2.5)


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (Int32, {"data": 1.5}, "the field data of std_msgs/msg/Int32 is of type int32, and cannot"),
        (Int32, {"data": 2**40}, "cannot hold 1099511627776"),
        (Int32, {"data": True}, None),
        (Int32, {"data": {"a": 1}}, "of type int32 cannot hold {'a': 1}"),
        (Int32, {"other": 1}, "std_msgs/msg/Int32 has no field other"),
        (Float64, {"data": "1"}, "of type double, and cannot hold '1'"),
        (Header, {"stamp": 5}, "of type builtin_interfaces/Time, and cannot hold 5"),
        (Header, {"frame_id": 5}, "of type string, and cannot hold 5"),
        (Polygon, {"points": 5}, "cannot hold 5"),
        (Polygon, {"points": {"x": 5}}, "cannot hold {'x': 5}"),
        (Polygon, {"points": [{"q": 1}]}, "geometry_msgs/msg/Point32 has no field q"),
        (Float64MultiArray, {"data": ["a"]}, "cannot hold ['a']"),
        (PoseWithCovariance, {"covariance": [0] * 3}, "of type double[36], and cannot hold"),
    ],
)
def test_what_does_not_fit_is_refused_with_words(
    kind: Any, values: dict[str, Any], words: str | None
) -> None:
    """No value reaches the C code that it would end; True counts as the number that it is."""
    if words is None:
        serialize_message(filled(kind, values))
        return
    with pytest.raises(DoesNotFit) as caught:
        filled(kind, values)
    assert words in str(caught.value)


def test_fields_that_a_type_has_not_are_left_out() -> None:
    """A student's type may have other fields than the lab's."""
    assert fields_in(Header, {"frame_id": "a", "seq": 1}) == {"frame_id": "a"}
