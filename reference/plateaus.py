"""The stimulus for a subscriber as a ROS 2 node: plateaus of constant commands and states.

What it publishes is told in `plateau_schedule.py`, how it is started in `reference_node.py`. It prints
`ready`, waits until both topics have their subscriptions, plays the schedule, prints `done`, and stays in
the graph, silent, until it is stopped.
"""

from __future__ import annotations

import sys
import time
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# `python -I` leaves the script's own folder off the path; its sibling modules are found there.
sys.path.insert(0, str(Path(__file__).resolve().parent))

from plateau_schedule import COMMAND, STATE, Event, PlateauSettings, schedule
from reference_node import Configuration, ReferenceNode, StopRequest, ToldPublisher, reference_node, run, sleep_until

TOPICS = {COMMAND: "/joint_commands", STATE: "/joint_states"}
IDLE_NS = 10**9


def message_class(topic_type: str | None) -> Any:
    """Give the message class of a type that can carry the values; the lab's own for all others."""
    if topic_type == "sensor_msgs/msg/JointState":
        from sensor_msgs.msg import JointState

        return JointState
    from std_msgs.msg import Float32MultiArray, Float64MultiArray

    return Float32MultiArray if topic_type == "std_msgs/msg/Float32MultiArray" else Float64MultiArray


def fill(message: Any, values: Sequence[float]) -> None:
    """Put the values into a message of one of these classes."""
    if hasattr(message, "position"):
        message.position = array("d", values)
    else:
        message.data = array(message.data.typecode, values)


def open_publishers(reference: ReferenceNode, configuration: Configuration) -> dict[str, ToldPublisher]:
    """Open a publisher for each role, offering the most, so that every request of QoS is compatible.

    A wrong type is charged elsewhere: where it can carry the values, it is what is published.
    """
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    offered = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=10,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    return {
        role: reference.open_publisher(
            message_class(configuration.types.get(configuration.name(topic))), configuration.name(topic), offered
        )
        for role, topic in TOPICS.items()
    }


def publish_all(publishers: dict[str, ToldPublisher], events: list[Event], stop: StopRequest) -> None:
    """Publish each event at its time, paced by absolute deadlines."""
    messages = {role: publisher.message_class() for role, publisher in publishers.items()}
    start_ns = time.monotonic_ns()
    for event in events:
        sleep_until(start_ns + round(event.t_s * 1e9), stop)
        if stop:
            return
        fill(messages[event.role], event.values)
        publishers[event.role].publish(messages[event.role])


def play(configuration: Configuration, settings: PlateauSettings, stop: StopRequest) -> None:
    """Play the schedule of the seed once, then stay until a stop is requested."""
    with reference_node("plateau_stimulus") as reference:
        publishers = open_publishers(reference, configuration)
        print("ready", flush=True)
        events = schedule(configuration.seed, settings)
        if settings.wait_for_matched:

            def matched(publisher: ToldPublisher) -> bool:
                students = configuration.subscriptions.get(publisher.topic, 0)
                return publisher.subscription_count >= max(settings.subscriptions, students + 1)

            reference.wait_until_recorded(stop, settings.match_timeout_s, matched)
        publish_all(publishers, events, stop)
        if not stop:
            print("done", flush=True)
        while not stop:
            sleep_until(time.monotonic_ns() + IDLE_NS, stop)


if __name__ == "__main__":
    sys.exit(run(PlateauSettings, play))
