"""The grader's own part of tf2_ros for Python: composition, interpolation, and errors."""

from __future__ import annotations

import importlib
import math
import sys
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

import grader
from confine.isolation import Isolation, Level
from grader.live.interfaces.build import provide
from ros_bag.interfaces import InterfacePackage

SUBSETS = Path(grader.__file__).parent / "live/interfaces/subsets"


@pytest.fixture
def tf2_ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Give the package; the messages that its broadcasters send are not built here."""
    messages: Any = types.ModuleType("tf2_msgs.msg")
    messages.TFMessage = object
    monkeypatch.setitem(sys.modules, "tf2_msgs", types.ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", messages)
    monkeypatch.syspath_prepend(str(SUBSETS))
    yield importlib.import_module("tf2_ros")
    for name in [name for name in sys.modules if name.split(".")[0] == "tf2_ros"]:
        del sys.modules[name]


def stamped(parent: str, child: str, x: float, yaw: float, at_s: float) -> TransformStamped:
    """Make a transform along x, turned about z."""
    made = TransformStamped()
    made.header.frame_id, made.child_frame_id = parent, child
    made.header.stamp = Time(nanoseconds=round(at_s * 1e9)).to_msg()
    made.transform.translation.x = x
    made.transform.rotation.z, made.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return made


def driving(tf2_ros: Any) -> Any:
    """Make a buffer: odom is 1 m before map for ever, base drives 2 m and turns left from 10 s to 12 s."""
    buffer = tf2_ros.Buffer()
    buffer.set_transform_static(stamped("map", "odom", 1.0, 0.0, 0.0), "test")
    buffer.set_transform(stamped("odom", "base", 0.0, 0.0, 10.0), "test")
    buffer.set_transform(stamped("odom", "base", 2.0, math.pi / 2, 12.0), "test")
    return buffer


def pose(found: Any) -> tuple[float, float, float]:
    """Return x, y and the angle about z of a transform."""
    t, r = found.transform.translation, found.transform.rotation
    return t.x, t.y, 2 * math.atan2(r.z, r.w)


def test_transforms_are_composed_and_interpolated(tf2_ros: Any) -> None:
    """In both directions, between two times, and at the latest that all on the way have in common."""
    buffer = driving(tf2_ros)
    halfway = buffer.lookup_transform("map", "base", Time(seconds=11))
    assert pose(halfway) == pytest.approx((2.0, 0.0, math.pi / 4))
    latest = buffer.lookup_transform("base", "map", Time())
    assert pose(latest) == pytest.approx((0.0, 3.0, -math.pi / 2))
    assert (latest.header.frame_id, latest.child_frame_id, latest.header.stamp.sec) == (
        "base",
        "map",
        12,
    )
    assert pose(buffer.lookup_transform("map", "odom", Time(seconds=500))) == pytest.approx(
        (1.0, 0.0, 0.0)
    )


@pytest.mark.parametrize(
    ("target", "source", "at_s", "error"),
    [
        ("map", "nowhere", 11, "LookupException"),
        ("map", "island", 11, "ConnectivityException"),
        ("map", "base", 13, "ExtrapolationException"),
        ("map", "base", 9, "ExtrapolationException"),
        ("/map", "base", 11, "InvalidArgumentException"),
    ],
)
def test_what_is_not_known_raises_what_the_real_one_raises(
    tf2_ros: Any, target: str, source: str, at_s: int, error: str
) -> None:
    """Unknown transforms raise the same errors as the original, all of them TransformExceptions."""
    buffer = driving(tf2_ros)
    buffer.set_transform(stamped("sea", "island", 0.0, 0.0, 11.0), "test")
    with pytest.raises(getattr(tf2_ros, error)) as raised:
        buffer.lookup_transform(target, source, Time(seconds=at_s))
    assert isinstance(raised.value, tf2_ros.TransformException)
    assert not buffer.can_transform(target, source, Time(seconds=at_s))


def test_a_frame_that_had_another_parent_is_not_connected_then(tf2_ros: Any) -> None:
    """A frame with another parent at that time is not connected, as in the original.

    A node that catches the error goes on.
    """
    buffer = tf2_ros.Buffer()
    buffer.set_transform_static(stamped("hand", "finger", 0.0, 0.0, 0.0), "test")
    for at_s, parent in enumerate(["shelf", "shelf", "finger"]):
        buffer.set_transform(stamped(parent, "cup", 0.0, 0.0, 10 + at_s), "test")
    with pytest.raises(tf2_ros.ConnectivityException):
        buffer.lookup_transform("hand", "cup", Time(seconds=11))
    assert buffer.lookup_transform("hand", "cup", Time(seconds=12)).child_frame_id == "cup"


def test_the_buffer_forgets_what_is_older_than_ten_seconds(tf2_ros: Any) -> None:
    """And takes no transform that is none."""
    buffer = driving(tf2_ros)
    buffer.set_transform(stamped("odom", "base", 5.0, 0.0, 21.0), "test")
    assert not buffer.can_transform("odom", "base", Time(seconds=10.5))
    assert buffer.can_transform("odom", "base", Time(seconds=15))
    for at_s, length in ((22.0, 1.006), (23.0, 0.994), (24.0, 0.0)):
        sent = stamped("odom", "base", 7.0, 0.0, at_s)
        sent.transform.rotation.w = length
        buffer.set_transform(sent, "test")
    assert buffer.lookup_transform("odom", "base", Time()).header.stamp.sec == 21


def test_a_quaternion_that_is_a_little_off_is_taken(tf2_ros: Any) -> None:
    """As the real buffer does, where the square of its length is less than a hundredth off 1."""
    buffer = driving(tf2_ros)
    for at_s, length in ((13.0, 1.0049), (14.0, 0.9951)):
        sent = stamped("odom", "base", 7.0, 0.0, at_s)
        sent.transform.rotation.w = length
        buffer.set_transform(sent, "test")
        assert pose(buffer.lookup_transform("odom", "base", Time(seconds=at_s))) == pytest.approx(
            (7.0, 0.0, 0.0)
        )


def test_what_it_lacks_is_missing_as_a_package_is(tf2_ros: Any) -> None:
    """By an error that names it, whether it is imported or used."""
    with pytest.raises(ModuleNotFoundError, match=r"tf2_ros\.BufferClient"):
        _ = tf2_ros.BufferClient
    with pytest.raises(ModuleNotFoundError, match=r"tf2_ros\.Buffer\.transform_full"):
        driving(tf2_ros).transform_full()


def test_a_package_of_its_name_does_not_take_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lab's nodes import it too, and would not start."""
    monkeypatch.setenv("PATH", str(tmp_path))  # no compiler
    built = provide(
        [InterfacePackage("tf2_ros", {"msg/A.msg": "int8 x\n"})], tmp_path, Isolation(Level.NONE)
    )
    assert "counts" in built.missing["tf2_ros"]


def test_what_it_keeps_does_not_slow_it_down(tf2_ros: Any) -> None:
    """A thousand times as many transforms take about the same time each."""

    def took_s(count: int) -> float:
        buffer = tf2_ros.Buffer()
        for n in range(count):
            buffer.set_transform(stamped("odom", "base", 0.0, 0.0, 10 + 9 * n / count), "test")
        began_s = time.process_time()
        for n in range(20):
            buffer.set_transform(stamped("odom", "base", 0.0, 0.0, 19 + n / 1000), "test")
            buffer.lookup_transform("odom", "base", Time(seconds=15))
        return time.process_time() - began_s

    few_s = min(took_s(20) for _ in range(3))
    assert took_s(20_000) < 5 * few_s
