"""Publishes a recording again on a ROS graph, at the pace at which it was received."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from grader.live.ros_node.graph import interface_named, new_context, silent_node
from grader.recording.bag import Bag, TopicInfo
from grader.recording.definitions import type_hash_of

CLOCK = "/clock"
#: Between two messages, the clock goes on so often, as that of `ros2 bag play` does.
CLOCK_HZ = 40
#: Nothing that was just published is lost for want of room, or of time at the end.
_DEPTH, _ACKNOWLEDGED_S = 1000, 1.0
_LOOK_S = 0.05


class Player:
    """A node that publishes what a bag holds, on the graph that the environment names (ROS_DOMAIN_ID and the like).

    `topics` limits it to some; `left_out` says why others cannot be published here.
    """

    def __init__(self, bag: Bag, topics: Collection[str] = ()) -> None:
        self._bag = bag
        self._context = new_context(None)
        self._node = silent_node("player", self._context)
        self._publishers: dict[tuple[str, str], Any] = {}
        self.played: list[TopicInfo] = []
        self.left_out: dict[str, str] = {}
        # Of a topic with two types only one can be in a participant: that with the most messages.
        for info in sorted(bag.topics, key=lambda info: (info.topic, -info.count)):
            if info.count and (not topics or info.topic in topics):
                self._add(info)
        self._clock = None if CLOCK in {i.topic for i in self.played} else self._node.create_publisher(Clock, CLOCK, 10)

    def await_subscription(self, timeout_s: float) -> None:
        """Wait until somebody subscribes to one of its topics, but not for long: nobody need."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s and not any(p.get_subscription_count() for p in self._publishers.values()):
            time.sleep(_LOOK_S)

    def _add(self, info: TopicInfo) -> None:
        try:
            if info.type_hash and type_hash_of(info.topic_type) not in ("", info.type_hash):
                raise ImportError(f"{info.topic_type} is defined otherwise here")
            kind = interface_named(info.topic_type)
            publisher = self._node.create_publisher(kind, info.topic, _offered(info.qos_text))
        except Exception as problem:  # Names and types are a student's, and rcl has many ways to refuse them.
            self.left_out[info.topic] = str(problem).splitlines()[0]
        else:
            self._publishers[info.topic, info.topic_type] = publisher
            self.played.append(info)

    def play(self, start_ns: int, rate: float = 1.0) -> int:
        """Publish all that was received from a time on, and return how many messages that were."""
        began_ns, count = time.monotonic_ns(), 0
        for received_ns, topic, data in self._bag.messages(self._publishers):
            if received_ns >= start_ns:
                self._wait(start_ns, began_ns, (received_ns - start_ns) / rate, rate)
                self._publishers[topic].publish(data)
                count += 1
        return count

    def _wait(self, start_ns: int, began_ns: int, due_ns: float, rate: float) -> None:
        while (waits_ns := due_ns - (passed_ns := time.monotonic_ns() - began_ns)) > 0:
            if self._clock is not None:
                seconds, nanoseconds = divmod(start_ns + round(passed_ns * rate), 10**9)
                message = Clock()
                message.clock.sec, message.clock.nanosec = seconds, nanoseconds
                self._clock.publish(message)
            time.sleep(min(waits_ns / 1e9, 1 / CLOCK_HZ))

    def close(self) -> None:
        """Leave the graph, once what was published has arrived, but soon."""
        deadline_s = time.monotonic() + _ACKNOWLEDGED_S
        for publisher in (p for p in self._publishers.values() if p.get_subscription_count()):
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline_s - time.monotonic())))
        self._node.destroy_node()
        self._context.shutdown()


def _offered(qos_text: str) -> QoSProfile:
    """Return what suits all of a topic's recorded publishers, as far as it decides who receives: the weakest of it."""
    profiles: Sequence[dict[str, Any]] = yaml.safe_load(qos_text) or []
    best_effort = any(profile.get("reliability") == "best_effort" for profile in profiles)
    latched = bool(profiles) and all(profile.get("durability") == "transient_local" for profile in profiles)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
