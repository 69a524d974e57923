"""The ROS graph as one node sees it, as snapshots without the endpoints of the node's own process.

What is ours is known by its gid: a student's node may have any name.
"""

from __future__ import annotations

import importlib
import re
import secrets
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_msgs.msg import Empty

from grader.recording.definitions import type_hash_of
from grader.recording.session import (
    GRADER_NAMESPACE,
    PROCESS_DIGITS,
    UNKNOWN_NODE,
    Endpoint,
    GraphSnapshot,
    Qos,
    ServiceEndpoint,
)

#: Topics and nodes looked at in one snapshot, and endpoints reported; a flood of them must not stall the session.
MAX_TOPICS = 400
MAX_NODES = 400
MAX_ENDPOINTS = 4000
_INFINITE_NS = 2**62
#: Names that rcl takes, of 247 characters at most. A program without ROS may have others on DDS, and bytes that are no
#: text; no reference node could be given one of them.
_TOPIC_NAME = re.compile(r"(?=.{1,247}\Z)(?:/[A-Za-z_][A-Za-z0-9_]*)+")

T = TypeVar("T")


def new_context(domain_id: int | None) -> rclpy.Context:
    """Make a context that leaves signals alone, of the environment's domain where none is given."""
    context = rclpy.Context()
    rclpy.init(
        args=[],
        context=context,
        domain_id=domain_id,
        signal_handler_options=rclpy.SignalHandlerOptions.NO,
    )
    return context


def silent_node(name: str, context: rclpy.Context) -> Node:
    """Make a node of the grader's: nobody can ask anything of it, or find its words in the log."""
    return Node(
        name,
        namespace=GRADER_NAMESPACE,
        context=context,
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )


def interface_named(name: str) -> Any:
    """Import the class of an interface's type, e.g. ``std_srvs/srv/SetBool``; raises ImportError without one.

    Only what an installed package defines is imported: the name may come from outside, and a module does what it likes.
    """
    if not type_hash_of(name):
        raise ImportError(f"no installed package defines {name}")
    package, kind, short = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    if kind == "action" and not hasattr(module, short):
        # Some of the messages that an action implies are only in the module that defines it.
        module = sys.modules[getattr(module, short.partition("_")[0]).__module__]
    return getattr(module, short)


def full_name(namespace: str, name: str) -> str:
    """Join a node's namespace and name."""
    return f"{namespace.rstrip('/')}/{name}"


def is_reserved(name: str) -> bool:
    """Whether a node or topic (fully qualified) is in the grader's namespace."""
    return name.startswith(GRADER_NAMESPACE + "/")


def _readable(ask: Callable[[], list[T]], otherwise: list[T]) -> list[T]:
    """Return what rclpy reports of the graph, or something else where a name in it is no text or empty."""
    try:
        return ask()
    except (UnicodeDecodeError, RuntimeError):
        return otherwise


def _topics(node: Node, known: Collection[str]) -> list[tuple[str, list[str]]]:
    """Return names and types of topics; of those known by name alone where types are not known."""
    facts: list[tuple[str, list[str]]] = [(name, []) for name in known]
    facts = _readable(node.get_topic_names_and_types, facts)
    return [(name, types) for name, types in facts if _TOPIC_NAME.fullmatch(name)]


def gid_prefix_of(node: Node) -> str:
    """Return the digits with which the gids of all endpoints of a node's process begin.

    They are read from the graph, on a topic whose name nobody else can know.
    """
    topic = f"{GRADER_NAMESPACE}/_{secrets.token_hex(8)}"
    publisher = node.create_publisher(Empty, topic, 1)
    (info,) = node.get_publishers_info_by_topic(topic)
    node.destroy_publisher(publisher)
    return _gid(info)[:PROCESS_DIGITS]


def _gid(info: Any) -> str:
    return bytes(info.endpoint_gid[:16]).hex()


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


def _endpoints_of(node: Node, topic: str) -> list[Endpoint]:
    return [
        Endpoint(
            kind=info.endpoint_type.name.lower(),
            topic=topic,
            type=info.topic_type,
            type_hash=str(info.topic_type_hash) if info.topic_type_hash else "",
            node=full_name(info.node_namespace, info.node_name),
            gid=_gid(info),
            qos=qos_of(info.qos_profile),
        )
        for ask in (node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic)
        for info in _readable(partial(ask, topic), [])
    ]


def snapshot(
    node: Node, own_prefix: str, first: Collection[str], before: GraphSnapshot
) -> GraphSnapshot:
    """Take a snapshot of the graph, without the endpoints of the process that `own_prefix` is of.

    Of too many topics those of `first` are looked at before all others. Where names are not known, those of the last
    snapshot stand in.
    """
    taken = GraphSnapshot(time.time_ns())
    named = _readable(
        node.get_node_names_and_namespaces, [full.rsplit("/", 1)[::-1] for full in before.nodes]
    )
    taken.nodes = sorted(full_name(namespace, name) for name, namespace in named)
    known = {*first, *(endpoint.topic for endpoint in before.endpoints)}
    topics = sorted(name for name, _ in _topics(node, known) if not is_reserved(name))
    topics.sort(key=lambda name: name not in first)
    for topic in topics[:MAX_TOPICS]:
        if len(taken.endpoints) >= MAX_ENDPOINTS:
            break
        taken.endpoints += [
            e for e in _endpoints_of(node, topic) if not e.gid.startswith(own_prefix)
        ]
    # Nodes are told apart by their names alone. In our namespace those with endpoints of others are kept.
    others = {endpoint.node for endpoint in taken.endpoints}
    taken.endpoints = sorted(
        taken.endpoints[:MAX_ENDPOINTS], key=lambda e: (e.topic, e.kind, e.gid)
    )
    taken.nodes = [full for full in taken.nodes if not is_reserved(full) or full in others][
        :MAX_NODES
    ]
    for full in sorted(set(taken.nodes)):
        taken.services += _services_of(node.get_service_names_and_types_by_node, full)
        taken.clients += _services_of(node.get_client_names_and_types_by_node, full)
    if len(taken.nodes) > len(set(taken.nodes)):
        # Of several nodes of one name the middleware tells the services of one alone.
        several, known = (
            Counter(taken.nodes).most_common(1)[0][0],
            {service.name for service in taken.services},
        )
        for found in _services_of(lambda *_: node.get_service_names_and_types(), several):
            if (
                found.name not in known
                and _TOPIC_NAME.fullmatch(found.name)
                and node.count_services(found.name)
            ):
                taken.services.append(found)
    return taken


def _glance(node: Node) -> object:
    """Return what of the graph costs a tenth of a snapshot to look at: names, types, and how many endpoints."""
    topics = _topics(node, ())
    handle, names = node.handle, [name for name, _ in topics[:MAX_TOPICS]]
    with handle:
        counts = [
            (handle.get_count_publishers(name), handle.get_count_subscribers(name))
            for name in names
        ]
    nodes, services = (
        _readable(ask, [])
        for ask in (node.get_node_names_and_namespaces, node.get_service_names_and_types)
    )
    return nodes, topics, counts, services


def _services_of(
    ask: Callable[[str, str], list[tuple[str, list[str]]]], full: str
) -> list[ServiceEndpoint]:
    namespace, name = full.rsplit("/", 1)
    found = _readable(partial(ask, name, namespace or "/"), [])[
        :MAX_TOPICS
    ]  # none where the node left in between
    return [ServiceEndpoint(service, kind, full) for service, kinds in found for kind in kinds]


class GraphWatch:
    """Takes snapshots when the graph changes, and hands each that differs from the one before on.

    Topics in `first`, which may grow, are looked at before all others.
    """

    #: How often the graph is glanced at, and how often it is looked at closely although nothing seems to have changed.
    PERIOD_S = 0.04
    CLOSELY_S = 0.5
    #: A hostile student can change the graph without end; after so many snapshots, or so much in them, only the
    #: last is kept up.
    MAX_CHANGES, MAX_ENTRIES = 500, 50_000

    def __init__(
        self, node: Node, on_change: Callable[[GraphSnapshot], None], first: set[str]
    ) -> None:
        self._node = node
        self.first = first
        self.own_prefix = gid_prefix_of(node)
        self._on_change = on_change
        self._next_s = self._closely_s = 0.0
        self._glance: object = None
        self._changes = self._entries = 0
        self.last = GraphSnapshot(0)

    def look(self, *, now: bool = False) -> GraphSnapshot:
        """Look at the graph if it is time to (or `now`), and return the last snapshot."""
        if not now and time.monotonic() < self._next_s:
            return self.last
        now_s = time.monotonic()
        self._next_s = now_s + self.PERIOD_S
        glance = _glance(self._node)
        # While the names of nodes are on their way, a glance would not show when they come.
        settled = not any(UNKNOWN_NODE in endpoint.node for endpoint in self.last.endpoints)
        if not now and settled and glance == self._glance and now_s < self._closely_s:
            return self.last
        self._glance, self._closely_s = glance, now_s + self.CLOSELY_S
        taken = snapshot(self._node, self.own_prefix, self.first, self.last)
        if not self._changes or taken != replace(self.last, t_ns=taken.t_ns):
            self.last = taken
            self._changes += 1
            self._entries += (
                len(taken.nodes) + len(taken.endpoints) + len(taken.services) + len(taken.clients)
            )
            if not self._too_much:
                self._on_change(taken)
        return self.last

    def close(self) -> None:
        """Hand on how the graph is at the end."""
        taken = self.look(now=True)
        if self._too_much:
            self._on_change(taken)

    @property
    def _too_much(self) -> bool:
        return self._changes > self.MAX_CHANGES or self._entries > self.MAX_ENTRIES
