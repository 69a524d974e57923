"""The ROS graph as one node sees it, as snapshots without the grader's own nodes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from grader.recording.session import Endpoint, GraphSnapshot, Qos, ServiceOffer

#: Namespace of the grader's own nodes; they are no part of a snapshot.
GRADER_NAMESPACE = "/_grader"
#: Topics looked at in one snapshot; a flood of topics must not stall the session.
MAX_TOPICS = 400
_INFINITE_NS = 2**62


def full_name(namespace: str, name: str) -> str:
    """Join a node's namespace and name."""
    return f"{namespace.rstrip('/')}/{name}"


def is_ours(node: str) -> bool:
    """Whether a node (fully qualified) is the grader's own probe or recorder."""
    return node.startswith(GRADER_NAMESPACE + "/")


def _finite(nanoseconds: int) -> int | None:
    return nanoseconds if 0 < nanoseconds < _INFINITE_NS else None


def qos_of(profile: QoSProfile) -> Qos:
    """Convert a profile from discovery; history and depth are unknown there."""
    return Qos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        deadline_ns=_finite(profile.deadline.nanoseconds),
        lifespan_ns=_finite(profile.lifespan.nanoseconds),
        liveliness=profile.liveliness.name.lower(),
        liveliness_lease_ns=_finite(profile.liveliness_lease_duration.nanoseconds),
    )


def _endpoint(info: Any, topic: str) -> Endpoint:
    return Endpoint(
        kind=info.endpoint_type.name.lower(),
        topic=topic,
        type=info.topic_type,
        type_hash=str(info.topic_type_hash) if info.topic_type_hash else "",
        node=full_name(info.node_namespace, info.node_name),
        gid="".join(f"{byte:02x}" for byte in info.endpoint_gid[:16]),
        qos=qos_of(info.qos_profile),
    )


def snapshot(node: Node) -> GraphSnapshot:
    """Take a snapshot of the graph, without the grader's own nodes."""
    taken = GraphSnapshot(time.time_ns())
    for name, namespace in node.get_node_names_and_namespaces():
        full = full_name(namespace, name)
        if not is_ours(full):
            taken.nodes.append(full)
    taken.nodes.sort()
    topics = sorted(name for name, _ in node.get_topic_names_and_types())
    for topic in topics[:MAX_TOPICS]:
        infos = node.get_publishers_info_by_topic(topic) + node.get_subscriptions_info_by_topic(topic)
        taken.endpoints += [e for e in (_endpoint(info, topic) for info in infos) if not is_ours(e.node)]
    for full in sorted(set(taken.nodes)):
        taken.services += _services_of(node, full)
    return taken


def _services_of(node: Node, full: str) -> list[ServiceOffer]:
    namespace, name = full.rsplit("/", 1)
    try:
        offered = node.get_service_names_and_types_by_node(name, namespace or "/")
    except RuntimeError:  # The node left in between.
        return []
    return [ServiceOffer(service, kind, full) for service, kinds in offered[:MAX_TOPICS] for kind in kinds]


class GraphWatch:
    """Takes snapshots when the graph changes, and hands each on.

    Parameters
    ----------
    on_change : callable
        Called with each snapshot that differs from the one before.
    """

    #: How often the graph is looked at; one look takes well under a millisecond.
    PERIOD_S = 0.04
    #: A hostile student can change the graph without end; after so many snapshots only the last is kept up.
    MAX_CHANGES = 500

    def __init__(self, node: Node, on_change: Callable[[GraphSnapshot], None]) -> None:
        self._node = node
        self._on_change = on_change
        self._next_s = 0.0
        self._changes = 0
        self._key: object = None
        self.last = GraphSnapshot(0)

    def look(self, *, now: bool = False) -> GraphSnapshot:
        """Look at the graph if it is time to (or `now`), and return the last snapshot."""
        if not now and time.monotonic() < self._next_s:
            return self.last
        self._next_s = time.monotonic() + self.PERIOD_S
        taken = snapshot(self._node)
        key = (
            tuple(taken.nodes),
            tuple(sorted((e.gid, e.kind, e.topic, e.type, e.node) for e in taken.endpoints)),
            tuple((s.name, s.type, s.node) for s in taken.services),
        )
        if key != self._key:
            self._key, self.last = key, taken
            self._changes += 1
            if self._changes <= self.MAX_CHANGES:
                self._on_change(taken)
        return self.last
