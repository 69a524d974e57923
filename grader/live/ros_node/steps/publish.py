"""The action of the step `publish`: messages that every subscription of the student can receive."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from grader.lab.steps.base import Answer
from grader.lab.steps.publish import PublishResult, PublishStep
from grader.live.ros_node.filling import filled
from grader.live.ros_node.graph import interface_named, new_context, silent_node
from grader.live.ros_node.probe import MATCH_S, Probe
from grader.live.ros_node.reports import report
from grader.recording.session import Published
from grader.recording.trusted_channel import digest

#: Time in s that the publisher stays for a subscription that has not received everything.
_ACKNOWLEDGED_S = 1.0


def publish(probe: Probe, step: PublishStep) -> Answer:
    """Publish from a node of its own; if the student subscribes with other types only, publish nothing.

    Nothing would arrive, and a recording holds one type a topic, the type of the messages on it.
    """
    topic = probe.name(step.topic)
    types = _subscribed_types(probe, topic)
    if types:
        if step.type not in types:
            return Answer("done", PublishResult(topic=topic, matched=False))
    kind = interface_named(step.type)
    # Compatible with every request. All messages are kept, because the student's side may be matched later than the
    # grader's, and then asks for those that it has missed.
    offered = QoSProfile(depth=step.count, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    context = new_context(probe.domain_id)
    node = silent_node("publisher", context)
    publisher = node.create_publisher(kind, topic, offered)
    probe.record(topic, step.type, "transient_local")
    data = serialize_message(filled(kind, step.message))
    sent = 0
    try:
        matched = _is_matched(probe, publisher, topic)
        while sent < step.count:
            publisher.publish(data)
            sent += 1
            probe.wait(1.0 / step.rate_hz)
        publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))
        probe.wait(step.observe_s)
    finally:
        report("published", Published("director", topic, step.type, digest(data) * sent))
        node.destroy_node()
        context.shutdown()
    return Answer("done", PublishResult(topic=topic, matched=matched))


def _subscribed_types(probe: Probe, topic: str) -> set[str]:
    """Return the types of the student's subscriptions on a topic."""
    types = set()
    for endpoint in probe.watch.last.endpoints:
        if (endpoint.kind, endpoint.topic) == ("subscription", topic):
            types.add(endpoint.type)
    return types


def _is_matched(probe: Probe, publisher: Publisher[object], topic: str) -> bool:
    """Wait for the subscriptions of the student and of the recorder."""
    students = 0
    for endpoint in probe.watch.last.endpoints:
        students += endpoint.kind == "subscription" and endpoint.topic == topic
    return probe.until(lambda: publisher.get_subscription_count() > students, MATCH_S)
