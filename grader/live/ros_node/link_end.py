"""The two ends of a link that loses and delays: one publishes with profiles as they were offered, one subscribes.

Each is a program that `grader.live.session.link` starts on its side of the link; it writes lines of JSON, and goes on
by lines that it reads.
"""

from __future__ import annotations

import json
import os
import select
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription

from grader.lab.steps.link import LinkedTopic
from grader.live.ros_node.graph import interface_named, new_context, silent_node
from grader.live.ros_node.link_plan import LinkPlan
from ros_bag.qos import Qos

#: Longest times for the ends to find each other, and for both sides to know, in s.
_MATCH_S, _KNOWN_S = 3.0, 0.1
_LOOK_S = 0.01
_WAIT_NS = 20_000_000
#: Time between two looks for messages of earlier levels, in s.
_EARLIER_S = 0.05
#: More than are sent: a longer queue would take memory and change nothing.
_DEEPEST = 2000
#: Size limit of an empty message, in bytes: a student's type may have fields of any fixed size.
_LARGEST_MESSAGE_BYTES = 64 * 1024
_SHORTEST_LIFESPAN_NS = 1_000_000
_READ_BYTES = 4096


def carried(qos: Qos) -> Qos:
    """Return a student's profile without its deadline, liveliness and lease, and with a lifespan of 1 ms at least.

    These decide nothing about arrival, but set timers in the grader's processes: a deadline of 1 µs keeps a core busy.
    """
    lifespan_ns = qos.lifespan_ns
    if lifespan_ns is not None:
        lifespan_ns = max(lifespan_ns, _SHORTEST_LIFESPAN_NS)
    return replace(
        qos,
        deadline_ns=None,
        lifespan_ns=lifespan_ns,
        liveliness="unknown",
        liveliness_lease_ns=None,
    )


def is_compatible(topic: LinkedTopic) -> bool:
    """Return whether the middleware would match both sides of a topic, by all policies of both profiles."""
    assert topic.offered is not None
    assert topic.requested is not None
    compatibility, _ = qos_check_compatible(profile_of(topic.offered), profile_of(topic.requested))
    return bool(compatibility != QoSCompatibility.ERROR)


def profile_of(qos: Qos) -> QoSProfile:
    """Return the QoS profile of a recorded one, with the usual history and depth if they are unknown."""
    known = qos.history in ("keep_last", "keep_all")
    more: dict[str, Any] = {
        name: Duration(nanoseconds=value)
        for name, value in (
            ("deadline", qos.deadline_ns),
            ("lifespan", qos.lifespan_ns),
            ("liveliness_lease_duration", qos.liveliness_lease_ns),
        )
        if value is not None
    }
    if qos.liveliness in ("automatic", "manual_by_topic"):
        more["liveliness"] = LivelinessPolicy[qos.liveliness.upper()]
    return QoSProfile(
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
        history=HistoryPolicy[qos.history.upper()] if known else HistoryPolicy.KEEP_LAST,
        depth=min(qos.depth, _DEEPEST) if known else 10,
        **more,
    )


def _name(number: int, level: int) -> str:
    return f"/link/topic_{number}/level_{level}"


def _say(*what: object) -> None:
    print(json.dumps(what), flush=True)


@contextmanager
def _node(name: str) -> Iterator[Node]:
    context = new_context(0)
    node = silent_node(name, context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


# -- the end that sends ----------------------------------------------------------------------------


def send(plan: LinkPlan) -> None:
    """Publish each topic; says when a level begins and how many messages were sent, and goes on when it is asked to."""
    with _node("link_sender") as node:
        messages = [_message_of(topic.type) for topic in plan.topics]
        publishers = [
            [
                _publisher(node, topic, _name(number, level))
                for number, topic in enumerate(plan.topics)
            ]
            for level in range(len(plan.loss))
        ]
        compatible = [is_compatible(topic) for topic in plan.topics]
        end_s = time.monotonic() + _MATCH_S
        while time.monotonic() < end_s and not all(
            publisher.get_subscription_count() or not fits
            for row in publishers
            for publisher, fits in zip(row, compatible, strict=True)
        ):
            time.sleep(_LOOK_S)
        time.sleep(_KNOWN_S)
        for level, row in enumerate(publishers):
            _say("begin", level)
            _say(
                "sent",
                level,
                _publish(list(zip(row, messages, strict=True)), plan.rate_hz, plan.duration_s),
            )
            if not sys.stdin.readline():
                return
        _say("done")
        sys.stdin.readline()  # The last messages must stay available for retransmission.


def _message_of(topic_type: str) -> bytes:
    """Return an empty message of a type, or end this program if it is too large for the link."""
    message = serialize_message(interface_named(topic_type)())
    if len(message) > _LARGEST_MESSAGE_BYTES:
        print(
            f"an empty {topic_type} has {len(message)} bytes, more than the {_LARGEST_MESSAGE_BYTES} of the link",
            file=sys.stderr,
        )
        raise SystemExit(1)
    return bytes(message)


def _publisher(node: Node, topic: LinkedTopic, name: str) -> Any:
    assert topic.offered is not None
    return node.create_publisher(
        interface_named(topic.type),
        name,
        profile_of(carried(topic.offered)),
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
    )


def _publish(each: Sequence[tuple[Any, bytes]], rate_hz: float, duration_s: float) -> int:
    """Publish a message on each topic at a rate, and return how many on each; as a timer does, missed ones are left."""
    due_s = time.monotonic()
    end_s, count = due_s + duration_s, 0
    while due_s < end_s:
        for publisher, message in each:
            publisher.publish(message)
        count += 1
        now_s = time.monotonic()
        due_s += (max(0, (now_s - due_s) * rate_hz) // 1 + 1) / rate_hz
        time.sleep(max(0.0, due_s - now_s))
    return count


# -- the end that receives -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Reader:
    """A subscription, with the publication sequence number and the latency in µs of each received message."""

    subscription: Subscription
    number: int
    level: int
    late: bool
    received: list[tuple[int, int]] = field(default_factory=list)

    def take(self) -> None:
        """Take the messages that have arrived."""
        take, kind = self.subscription.handle.take_message, self.subscription.msg_type
        while (message := take(kind, True)) is not None:
            info: Mapping[str, int] = message[1]
            latency_ns = time.time_ns() - info["source_timestamp"]
            self.received.append((info["publication_sequence_number"], latency_ns // 1000))


class _Receiver:
    """All subscriptions, in one set that is waited for: rclpy's executors take thirty times as long for a message."""

    def __init__(self, node: Node, plan: LinkPlan) -> None:
        self._node, self._plan = node, plan
        self.readers: list[_Reader] = []
        #: Level of the messages that come now.
        self._level = 0
        self._take_earlier_s = 0.0
        #: Topics with a subscription, by number.
        self._compatible = {n: t for n, t in enumerate(plan.topics) if is_compatible(t)}
        self._late = [0] * len(plan.loss)
        for level in range(len(plan.loss)):
            self.join(level, late=False)

    def join(self, level: int, *, late: bool) -> None:
        """Subscribe to all topics of a level."""
        self._late[level] += late
        for number, topic in self._compatible.items():
            assert topic.requested is not None
            made = self._node.create_subscription(
                interface_named(topic.type),
                _name(number, level),
                lambda message: None,
                profile_of(carried(topic.requested)),
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )
            self.readers.append(_Reader(made, number, level, late))
        self._choose()

    def _choose(self) -> None:
        """Wait from now on for messages of the present level and later ones.

        Each wait costs the more, the more subscriptions it is for; little comes for earlier levels.
        """
        self._waited: dict[int, _Reader] = {}
        self._earlier: list[_Reader] = []
        for reader in self.readers:
            if reader.level < self._level:
                self._earlier.append(reader)
            else:
                self._waited[reader.subscription.handle.pointer] = reader
        context = self._node.context.handle
        self._set = rclpy_implementation.WaitSet(len(self._waited), 0, 0, 0, 0, 0, context)

    def wait(self) -> None:
        """Wait for messages, and take them."""
        if not self.readers:
            time.sleep(_WAIT_NS / 1e9)
            return
        self._set.clear_entities()
        for reader in self._waited.values():
            self._set.add_subscription(reader.subscription.handle)
        self._set.wait(_WAIT_NS)
        reached = self._level
        for pointer in self._set.get_ready_entities("subscription"):
            reader = self._waited[pointer]
            reader.take()
            reached = max(reached, reader.level)
        if reached > self._level:
            self._level = reached
            self._choose()
        self._take_earlier()

    def _take_earlier(self) -> None:
        """Take messages of earlier levels, now and then."""
        now_s = time.monotonic()
        if now_s >= self._take_earlier_s:
            self._take_earlier_s = now_s + _EARLIER_S
            for reader in self._earlier:
                reader.take()

    def received(self) -> list[list[dict[str, Any]]]:
        """Take the last messages, and return all by topic and level, also for each subscription that joined late."""
        found: list[list[dict[str, Any]]] = [
            [
                {"received": [], "late": self._none_late(n, level)}
                for level in range(len(self._late))
            ]
            for n in range(len(self._plan.topics))
        ]
        for reader in self.readers:
            reader.take()
            here = found[reader.number][reader.level]
            if reader.late:
                here["late"].append([number for number, _ in reader.received])
            else:
                here["received"] = reader.received
        return found

    def _none_late(self, number: int, level: int) -> list[list[int]]:
        """Return an empty list for each late subscription to a topic with incompatible sides."""
        return [] if number in self._compatible else [[] for _ in range(self._late[level])]


def receive(plan: LinkPlan) -> None:
    """Subscribe to each topic until the input ends; a number in it is a level to which it subscribes once more."""
    with _node("link_receiver") as node:
        receiver = _Receiver(node, plan)
        commands = select.poll()
        commands.register(0, select.POLLIN)
        while True:
            receiver.wait()
            if commands.poll(0):
                words = os.read(0, _READ_BYTES).split()
                if not words:
                    break
                for word in words:
                    receiver.join(int(word), late=True)
        _say("received", receiver.received())
