"""Publishes a recording again on a ROS graph, at the pace at which it was received."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from grader.live.ros_node.graph import interface_named, new_context, silent_node
from ros_bag.definitions import type_hash_of
from ros_bag.mcap_file import TopicInfo
from ros_bag.qos import offered_policies
from ros_bag.reading import Bag

_CLOCK = "/clock"
#: Rate of the clock between two messages, as with `ros2 bag play`.
_CLOCK_HZ = 40
#: Longest waits for a subscription at the beginning, and for all arrivals at the end, in s.
_DISCOVERY_S, _ACKNOWLEDGED_S = 2.0, 1.0
#: Time until the other side knows of a subscription matched on ours, and others come too, in s.
_KNOWN_S = 0.5
_LOOK_S = 0.05
#: Nothing that was just published is lost for want of room.
_DEPTH = 1000


class Player:
    """A node that publishes the messages of a bag, or of some topics, on the graph of the environment.

    `topics` describes the publications of each, or why there are none.
    """

    def __init__(self, bag: Bag, only: Collection[str] = ()) -> None:
        self._bag = bag
        self._context = new_context(None)
        self._node = silent_node("player", self._context)
        self._publishers: dict[tuple[str, str], Any] = {}
        self.topics: dict[str, str] = {}
        # A participant can have one type of a topic: the one with the most messages.
        for info in sorted(bag.topics, key=lambda info: (info.topic, -info.count)):
            if info.count and info.topic not in self.topics and (not only or info.topic in only):
                self.topics[info.topic] = self._add(info)
        own_clock = not any(topic == _CLOCK for topic, _ in self._publishers)
        self._clock = self._node.create_publisher(Clock, _CLOCK, 10) if own_clock else None
        self.topics.setdefault(_CLOCK, "the time of the recording")

    def _add(self, info: TopicInfo) -> str:
        """Add a publisher; returns a description of its messages, or why there is none."""
        try:
            if info.type_hash and type_hash_of(info.topic_type) not in ("", info.type_hash):
                raise ImportError(f"{info.topic_type} has another definition here")
            kind = interface_named(info.topic_type)
            publisher = self._node.create_publisher(kind, info.topic, _offered(info.qos_text))
        except (
            Exception
        ) as problem:  # Names and types are a student's, and rcl has many ways to refuse them.
            return f"not played: {problem}"
        self._publishers[info.topic, info.topic_type] = publisher
        return f"{info.count} messages, {info.topic_type}"

    def await_subscription(self) -> None:
        """Wait until somebody subscribes to one of its topics, but not for long: nobody need."""
        deadline_s = time.monotonic() + _DISCOVERY_S
        while time.monotonic() < deadline_s and not any(
            p.get_subscription_count() for p in self._publishers.values()
        ):
            time.sleep(_LOOK_S)
        time.sleep(_KNOWN_S)

    def play(self, start_ns: int, rate: float = 1.0) -> int:
        """Publish all that was received from a time on, and return how many messages that were."""
        began_ns, count = time.monotonic_ns(), 0
        for received_ns, topic, data in self._bag.messages(self._publishers):
            if received_ns >= start_ns:
                due_ns = (received_ns - start_ns) / rate
                while (passed_ns := time.monotonic_ns() - began_ns) < due_ns:
                    self._tell_time(start_ns + round(passed_ns * rate))
                    time.sleep(min((due_ns - passed_ns) / 1e9, 1 / _CLOCK_HZ))
                self._publishers[topic].publish(data)
                count += 1
        return count

    def _tell_time(self, t_ns: int) -> None:
        if self._clock is not None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(t_ns, 10**9)
            self._clock.publish(message)

    def close(self) -> None:
        """Leave the graph once the published messages have arrived, or after a short wait."""
        deadline_s = time.monotonic() + _ACKNOWLEDGED_S
        for publisher in (p for p in self._publishers.values() if p.get_subscription_count()):
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline_s - time.monotonic())))
        self._node.destroy_node()
        self._context.shutdown()


def _offered(qos_text: str) -> QoSProfile:
    """Return the common QoS of a topic's recorded publishers, by the policies that decide matching."""
    offered = offered_policies(qos_text)
    reliable = all(reliability != "best_effort" for reliability, _ in offered)
    latched = bool(offered) and all(durability == "transient_local" for _, durability in offered)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
