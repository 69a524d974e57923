"""The ROS graph as one node sees it, as snapshots without the endpoints of the node's own process.

The grader's endpoints are known by their gids, because a student's node may have any name.
"""

from __future__ import annotations

import ctypes
import importlib
import math
import re
import secrets
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeVar

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointTypeEnum
from rclpy.type_hash import TypeHash
from rclpy.type_support import check_for_type_support
from std_msgs.msg import Empty

from grader.live.ros_node.bare_node import BareNode
from grader.recording.session import (
    GRADER_NAMESPACE,
    PROCESS_DIGITS,
    UNKNOWN_NODE,
    Endpoint,
    GraphSnapshot,
    ServiceEndpoint,
)
from ros_bag.definitions import type_hash_of
from ros_bag.qos import Qos

#: Topics and nodes looked at in one snapshot, and endpoints reported; a flood of them must not stall the session.
MAX_TOPICS = 400
MAX_NODES = 400
MAX_ENDPOINTS = 4000
_INFINITE_NS = 2**62
#: Kind of an endpoint by its number in a report.
_KINDS = {each.value: each.name.lower() for each in TopicEndpointTypeEnum}
#: Library below rclpy. Each director would take 1.5 ms to open it.
_RCL = ctypes.CDLL("librcl.so")
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
    """Make a node of the grader without services and without a log."""
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
    """Import the class of an interface's type, e.g. ``std_srvs/srv/SetBool``; raises ImportError if there is none.

    Only types of installed packages are imported: the name may come from outside, and an import executes code.
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
    """Return whether a node or topic (fully qualified) is in the grader's namespace."""
    return name.startswith(GRADER_NAMESPACE + "/")


def _readable(ask: Callable[[], list[T]], otherwise: list[T]) -> list[T]:
    """Return a report of rclpy about the graph; `otherwise` if a name in it is empty or no text."""
    try:
        return ask()
    except (UnicodeDecodeError, RuntimeError):
        return otherwise


def _topics(node: Node | BareNode, known: Collection[str]) -> list[tuple[str, list[str]]]:
    """Return names and types of topics; of those known by name alone where types are not known."""
    facts: list[tuple[str, list[str]]] = [(name, []) for name in known]
    facts = _readable(node.get_topic_names_and_types, facts)
    return [(name, types) for name, types in facts if _TOPIC_NAME.fullmatch(name)]


def gid_prefix_of(node: Node | BareNode) -> str:
    """Return the digits with which the gids of all endpoints of a node's process begin.

    They are read from the graph, on a topic with a secret name.
    """
    topic = f"{GRADER_NAMESPACE}/_{secrets.token_hex(8)}"
    check_for_type_support(Empty)
    handle = node.handle
    with handle:
        publisher = rclpy_implementation.Publisher(
            handle, Empty, topic, QoSProfile(depth=1).get_c_qos_profile()
        )
        (info,) = rclpy_implementation.rclpy_get_publishers_info_by_topic(handle, topic, False)
    publisher.destroy_when_not_in_use()
    return _gid(info["endpoint_gid"])[:PROCESS_DIGITS]


def _gid(numbers: Sequence[int]) -> str:
    return bytes(numbers[:16]).hex()


def _finite(nanoseconds: int) -> int | None:
    return nanoseconds if 0 < nanoseconds < _INFINITE_NS else None


@lru_cache(maxsize=256)
def _qos(
    reliability: int,
    durability: int,
    liveliness: int,
    deadline_ns: int,
    lifespan_ns: int,
    liveliness_lease_ns: int,
) -> Qos:
    """Return a profile by the numbers of its policies; history and depth are unknown in discovery."""
    return Qos(
        reliability=ReliabilityPolicy(reliability).name.lower(),
        durability=DurabilityPolicy(durability).name.lower(),
        deadline_ns=_finite(deadline_ns),
        lifespan_ns=_finite(lifespan_ns),
        liveliness=LivelinessPolicy(liveliness).name.lower(),
        liveliness_lease_ns=_finite(liveliness_lease_ns),
    )


@lru_cache(maxsize=256)
def _hash_text(version: int, value: bytes) -> str:
    return str(TypeHash(version, value))


class TopicGlance(NamedTuple):
    """The types of a topic, and the numbers of its publishers and subscriptions."""

    types: list[str]
    publishers: int
    subscriptions: int


class Glance(NamedTuple):
    """The facts of the graph that cost a tenth of a snapshot: names, types, numbers of endpoints."""

    nodes: list[tuple[str, str]]
    topics: dict[str, TopicGlance]
    #: Names of further topics.
    more: list[str]
    services: list[tuple[str, list[str]]]


class Endpoints:
    """The endpoints of topics as one node sees them, built anew only for topics with a changed report.

    A report is a list of dictionaries. Making rclpy's objects of these, with checks of each value, takes several times as
    long as the report, and the report twenty times as long as a glance.
    """

    def __init__(self, node: Node | BareNode) -> None:
        self._node = node
        #: Topic -> its endpoints by the last reports.
        self._known: dict[str, list[Endpoint]] = {}
        #: Topic -> the glance before its last reports.
        self._glances: dict[str, TopicGlance | None] = {}

    def keep(self, topics: Collection[str]) -> None:
        """Forget all other topics."""
        for name in self._known.keys() - topics:
            del self._known[name]
            self._glances.pop(name, None)

    def forget_glances(self) -> None:
        """Ask for all endpoints again."""
        self._glances.clear()

    def after(self, topic: str, glance: TopicGlance | None) -> list[Endpoint]:
        """Return the endpoints of a topic; the known ones while a glance at it is the same."""
        before = self._glances.get(topic)
        if glance is None or glance != before:
            self._glances[topic] = glance
            return self.of(topic)
        endpoints = self._known[topic]
        if _are_names_missing(endpoints):
            return self.of(topic)
        return endpoints

    def of(self, topic: str) -> list[Endpoint]:
        """Return the endpoints of a topic, publishers first."""
        reports = self._reports(rclpy_implementation.rclpy_get_publishers_info_by_topic, topic)
        reports += self._reports(rclpy_implementation.rclpy_get_subscriptions_info_by_topic, topic)
        endpoints = [_endpoint(topic, report) for report in reports]
        known = self._known.setdefault(topic, endpoints)
        if endpoints == known:
            return known
        self._known[topic] = endpoints
        return endpoints

    def _reports(
        self, ask: Callable[..., list[dict[str, Any]]], topic: str
    ) -> list[dict[str, Any]]:
        handle = self._node.handle
        with handle:
            return _readable(partial(ask, handle, topic, False), [])


def _are_names_missing(endpoints: Iterable[Endpoint]) -> bool:
    """Return whether names of nodes are on their way, which a glance would not show."""
    return any(UNKNOWN_NODE in endpoint.node for endpoint in endpoints)


def _endpoint(topic: str, report: Mapping[str, Any]) -> Endpoint:
    """Return the endpoint of a topic by its report."""
    profile = report["qos_profile"]
    qos = _qos(
        profile["reliability"],
        profile["durability"],
        profile["liveliness"],
        profile["deadline"].nanoseconds,
        profile["lifespan"].nanoseconds,
        profile["liveliness_lease_duration"].nanoseconds,
    )
    type_hash = report["topic_type_hash"]
    return Endpoint(
        kind=_KINDS[report["endpoint_type"]],
        topic=topic,
        type=report["topic_type"],
        type_hash=_hash_text(type_hash["version"], type_hash["value"]),
        node=full_name(report["node_namespace"], report["node_name"]),
        gid=_gid(report["endpoint_gid"]),
        qos=qos,
    )


def snapshot(
    node: Node | BareNode,
    own_prefix: str,
    first: Collection[str],
    before: GraphSnapshot,
    endpoints: Endpoints,
    glance: Glance,
) -> GraphSnapshot:
    """Take a snapshot of the graph, without the endpoints of the process with the prefix `own_prefix`.

    Among too many topics, the topics in `first` are looked at before all others. If names cannot be read, the names of
    the snapshot `before` stand in. The endpoints of topics with the same glance as before are not asked for.
    """
    taken = GraphSnapshot(time.time_ns())
    names = _node_names(node, before)
    topics = _topics_to_look_at(node, first, before, glance)
    taken.endpoints = _student_endpoints(endpoints, topics, own_prefix, glance.topics)
    # Nodes are told apart by their names alone. In the grader's namespace, those with endpoints of others are kept.
    others = {endpoint.node for endpoint in taken.endpoints}
    kept = [full for full in names if not is_reserved(full) or full in others]
    taken.nodes = kept[:MAX_NODES]
    for full in sorted(set(taken.nodes)):
        taken.services += _services_of(node.get_service_names_and_types_by_node, full)
        taken.clients += _services_of(node.get_client_names_and_types_by_node, full)
    if len(taken.nodes) > len(set(taken.nodes)):
        taken.services += _services_of_namesakes(node, taken)
    return taken


def _node_names(node: Node | BareNode, before: GraphSnapshot) -> list[str]:
    """Return the full names of all nodes, sorted, with duplicates."""
    otherwise = []
    for full in before.nodes:
        namespace, name = full.rsplit("/", 1)
        otherwise.append((name, namespace))
    named = _readable(node.get_node_names_and_namespaces, otherwise)
    return sorted(full_name(namespace, name) for name, namespace in named)


def _topics_to_look_at(
    node: Node | BareNode, first: Collection[str], before: GraphSnapshot, glance: Glance
) -> list[str]:
    names = [*glance.topics, *glance.more]
    if not names:  # Perhaps they cannot be read.
        known = {*first, *(endpoint.topic for endpoint in before.endpoints)}
        names = [name for name, _ in _topics(node, known)]
    topics = sorted(name for name in names if not is_reserved(name))
    topics.sort(key=lambda name: name not in first)
    return topics[:MAX_TOPICS]


def _student_endpoints(
    known: Endpoints,
    topics: list[str],
    own_prefix: str,
    glances: Mapping[str, TopicGlance],
) -> list[Endpoint]:
    known.keep(topics)
    endpoints: list[Endpoint] = []
    for topic in topics:
        if len(endpoints) >= MAX_ENDPOINTS:
            break
        found = known.after(topic, glances.get(topic))
        endpoints += [each for each in found if not each.gid.startswith(own_prefix)]
    return sorted(endpoints[:MAX_ENDPOINTS], key=lambda each: (each.topic, each.kind, each.gid))


def _services_of_namesakes(node: Node | BareNode, taken: GraphSnapshot) -> list[ServiceEndpoint]:
    """Return services of several nodes with one name, because the middleware reports only one of them."""
    name = Counter(taken.nodes).most_common(1)[0][0]
    known = {service.name for service in taken.services}
    services = []
    for found in _services_of(lambda *_: node.get_service_names_and_types(), name):
        is_new = found.name not in known and _TOPIC_NAME.fullmatch(found.name)
        if is_new and node.count_services(found.name):
            services.append(found)
    return services


def _glance(node: Node | BareNode) -> Glance:
    """Glance at the graph."""
    topics = _topics(node, ())
    handle = node.handle
    glances = {}
    with handle:
        for name, types in topics[:MAX_TOPICS]:
            publishers = handle.get_count_publishers(name)
            subscriptions = handle.get_count_subscribers(name)
            glances[name] = TopicGlance(types, publishers, subscriptions)
    nodes = _readable(node.get_node_names_and_namespaces, [])
    services = _readable(node.get_service_names_and_types, [])
    return Glance(nodes, glances, [name for name, _ in topics[MAX_TOPICS:]], services)


def _services_of(
    ask: Callable[[str, str], list[tuple[str, list[str]]]], full: str
) -> list[ServiceEndpoint]:
    namespace, name = full.rsplit("/", 1)
    found = _readable(partial(ask, name, namespace or "/"), [])[
        :MAX_TOPICS
    ]  # none where the node left in between
    return [ServiceEndpoint(service, kind, full) for service, kinds in found for kind in kinds]


class GraphEvents:
    """The middleware's signal that the graph of a node has changed, and calls by other threads.

    rclpy does not offer the condition of a node's graph, but can wait for it.
    """

    def __init__(self, node: Node | BareNode) -> None:
        condition_of = _RCL.rcl_node_get_graph_guard_condition
        condition_of.restype = ctypes.c_void_p
        condition_of.argtypes = [ctypes.c_void_p]
        self._add = _RCL.rcl_wait_set_add_guard_condition
        self._add.argtypes = [ctypes.c_void_p] * 3
        context = node.context.handle
        with node.handle, context:
            self._graph = condition_of(node.handle.pointer)
            self._call = rclpy_implementation.GuardCondition(context)
            self._set = rclpy_implementation.WaitSet(0, 2, 0, 0, 0, 0, context)

    def wait(self, time_s: float) -> bool:
        """Wait for a change, a call, or the end of the time; returns whether there was a change."""
        with self._set:
            self._set.clear_entities()
            if self._add(self._set.pointer, self._graph, None) != 0:
                raise RuntimeError("rcl refuses the condition of the graph")
            self._set.add_guard_condition(self._call)
            self._set.wait(round(time_s * 1e9))
            return bool(self._set.is_ready("guard_condition", 0))

    def call(self) -> None:
        """End the wait of another thread, or its next one."""
        self._call.trigger_guard_condition()


class GraphWatch:
    """Takes snapshots when the graph changes, and hands each that differs from the one before on.

    Topics in `first`, which may grow, are looked at before all others.
    """

    #: Shortest time between two glances at the graph, or two questions for its changes, in s.
    PERIOD_S = 0.04
    #: Time to a close look after a change that no glance shows, in s.
    CLOSELY_S = 0.5
    #: Time between close looks although the middleware tells of no change, in s.
    SELDOM_S = 2.0
    #: Longest wait, in s: shorter than a stall of the grader, see `Deadline`.
    _WAIT_S = 0.2
    #: A hostile student can change the graph without end; after so many snapshots, or so much in them, only the
    #: last is kept up.
    MAX_CHANGES, MAX_ENTRIES = 500, 50_000

    def __init__(
        self, node: Node | BareNode, on_change: Callable[[GraphSnapshot], None], first: set[str]
    ) -> None:
        self._node = node
        self.first = first
        self.own_prefix = gid_prefix_of(node)
        self._on_change = on_change
        self._next_s = 0.0
        #: Time of the last close look.
        self._closely_s = -self.SELDOM_S
        self._glance: Glance | None = None
        self._changes = self._entries = 0
        self._endpoints = Endpoints(node)
        self._events = GraphEvents(node)
        self._has_changed = True
        #: Time of the first change since the last close look.
        self._unseen_s = math.inf
        self.last = GraphSnapshot(0)
        #: True while names of nodes in the last snapshot are on their way.
        self._lacks_names = False

    def call(self) -> None:
        """End the wait of another thread, or its next one."""
        self._events.call()

    def wait(self, time_s: float) -> None:
        """Wait for a change, a call, or the end of the time, for a fifth of a second at most; then look at the graph."""
        time_s = min(time_s, self._WAIT_S)
        if self._has_changed:
            left_s = self._next_s - time.monotonic()
            time.sleep(max(0.0, min(time_s, left_s)))
        else:
            self._has_changed = self._events.wait(max(0.0, time_s))
        if time.monotonic() >= self._next_s:
            self._look(now=False)

    def look(self, *, now: bool = False) -> GraphSnapshot:
        """Look at the graph if it has changed (or `now`), and return the last snapshot."""
        if not now and time.monotonic() < self._next_s:
            return self.last
        if not self._has_changed:
            self._has_changed = self._events.wait(0.0)
        if not self._has_changed:
            self._next_s = time.monotonic() + self.PERIOD_S
        return self._look(now=now)

    def _look(self, *, now: bool) -> GraphSnapshot:
        now_s = time.monotonic()
        is_close = now
        if not is_close:
            is_close = self._is_close_look_due(now_s)
        if not any((is_close, self._has_changed)):
            return self.last
        self._next_s = now_s + self.PERIOD_S
        self._unseen_s = min(self._unseen_s, now_s)
        self._has_changed = False
        glance = _glance(self._node)
        if glance == self._glance and not any((is_close, self._lacks_names)):
            return self.last
        self._glance = glance
        if is_close:
            self._endpoints.forget_glances()
            self._closely_s = now_s
            self._unseen_s = math.inf
        taken = snapshot(
            self._node, self.own_prefix, self.first, self.last, self._endpoints, glance
        )
        if not self._changes or taken != replace(self.last, t_ns=taken.t_ns):
            self.last = taken
            self._lacks_names = _are_names_missing(taken.endpoints)
            self._changes += 1
            self._entries += (
                len(taken.nodes) + len(taken.endpoints) + len(taken.services) + len(taken.clients)
            )
            if not self._too_much:
                self._on_change(taken)
        return self.last

    def _is_close_look_due(self, now_s: float) -> bool:
        """Return whether the graph is to be looked at whatever a glance shows."""
        period_s = self.SELDOM_S
        if self._lacks_names:
            period_s = self.CLOSELY_S
        if now_s - self._unseen_s >= self.CLOSELY_S:
            return True
        return now_s - self._closely_s >= period_s

    def close(self) -> None:
        """Hand on how the graph is at the end."""
        taken = self.look(now=True)
        if self._too_much:
            self._on_change(taken)

    @property
    def _too_much(self) -> bool:
        return self._changes > self.MAX_CHANGES or self._entries > self.MAX_ENTRIES
