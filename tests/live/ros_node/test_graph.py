"""Snapshots of a real graph, and how many of them are handed on."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Empty

from grader.live.ros_node.graph import Endpoints, GraphWatch, TopicGlance, interface_named
from grader.recording.session import GraphSnapshot
from ros_bag.qos import Qos
from tests.reference.live_graph import use_private_graph

pytestmark = pytest.mark.live

TOPICS = 60
#: Opens a publisher each time that it is told to.
GROWS = f"""
import sys, rclpy
from std_msgs.msg import Empty
rclpy.init()
node = rclpy.create_node("grows")
for number in range({TOPICS}):
    sys.stdin.readline()
    node.create_publisher(Empty, f"/many/topic{{number}}", 1)
sys.stdin.read()
"""


class _ShortWatch(GraphWatch):
    """Has soon seen enough."""

    MAX_CHANGES, MAX_ENTRIES = 1000, 300


@pytest.fixture
def node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """Make a node of the grader's, which looks at the graph."""
    domain_id = use_private_graph(monkeypatch.setenv, tmp_path)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id))
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain_id)
    made = Node("looks", context=context)
    yield made
    made.destroy_node()
    context.shutdown()


def test_of_a_graph_that_grows_without_end_some_snapshots_and_the_last_are_handed_on(
    node: Node,
) -> None:
    """A graph that grows without end is kept within a bound, and its last state is always known."""
    told: list[GraphSnapshot] = []
    watch = _ShortWatch(node, told.append, set())
    with subprocess.Popen([sys.executable, "-c", GROWS], stdin=subprocess.PIPE, text=True) as other:
        assert other.stdin is not None
        end_s = time.monotonic() + 60
        for number in range(TOPICS):
            other.stdin.write("\n")
            other.stdin.flush()
            while topics_in(watch.look(now=True)) <= number and time.monotonic() < end_s:
                time.sleep(0.005)
        before = list(told)
        watch.close()
        other.stdin.close()
    assert sum(len(graph.endpoints) for graph in before) <= _ShortWatch.MAX_ENTRIES
    assert 0 < len(before) < TOPICS
    assert topics_in(told[-1]) == TOPICS


class _PatientWatch(GraphWatch):
    """Never looks unless it is told that the graph has changed."""

    CLOSELY_S = SELDOM_S = 1000.0
    _WAIT_S = 30.0


def quiet_for_s(watch: GraphWatch, time_s: float) -> float:
    """Wait for a change or a call, and return how long that took, in s."""
    begun_s = time.monotonic()
    watch.wait(time_s)
    return time.monotonic() - begun_s


def test_a_wait_ends_with_a_change_or_a_call(node: Node) -> None:
    """A graph at rest costs nothing: it is looked at when the middleware tells of a change."""
    watch = _PatientWatch(node, lambda graph: None, set())
    while quiet_for_s(watch, 0.5) < 0.5:  # its own endpoints
        pass
    with subprocess.Popen([sys.executable, "-c", GROWS], stdin=subprocess.PIPE, text=True) as other:
        assert other.stdin is not None
        other.stdin.write("\n")
        other.stdin.flush()
        while topics_in(watch.last) < 1:
            assert quiet_for_s(watch, 25) < 20
        while quiet_for_s(watch, 0.5) < 0.5:
            pass
        threading.Timer(0.1, watch.call).start()
        assert quiet_for_s(watch, 25) < 20
        other.stdin.close()
    assert topics_in(watch.last) == 1


def topics_in(graph: GraphSnapshot) -> int:
    """Count the topics that the other process has opened."""
    return len(
        {endpoint.topic for endpoint in graph.endpoints if endpoint.topic.startswith("/many/")}
    )


def test_endpoints_are_built_anew_if_their_report_changed(node: Node) -> None:
    """A publisher that takes the place of another one is seen, although there is still one."""
    endpoints = Endpoints(node)

    def offered() -> list[str]:
        return [each.qos.reliability for each in endpoints.of("/it")]

    def until(reliabilities: list[str]) -> None:
        end_s = time.monotonic() + 20
        while offered() != reliabilities:
            assert time.monotonic() < end_s
            time.sleep(0.01)

    first = node.create_publisher(Empty, "/it", 1)
    until(["reliable"])
    assert endpoints.of("/it") is endpoints.of("/it")
    node.destroy_publisher(first)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_publisher(Empty, "/it", best_effort)
    until(["best_effort"])
    known = endpoints.of("/it")
    endpoints.keep([])
    assert endpoints.of("/it") is not known


class _TrustingWatch(GraphWatch):
    """Looks closely after changes alone."""

    SELDOM_S = 1000.0


def test_a_change_that_no_glance_shows_is_found_soon(node: Node) -> None:
    """A publisher that takes the place of another one between two glances is in a snapshot half a second later."""
    watch = _TrustingWatch(node, lambda graph: None, set())
    watch.own_prefix = "none"  # Its own endpoints are looked at.

    def until(reliabilities: list[str]) -> None:
        end_s = time.monotonic() + 60
        while offered_on("/it", watch.look()) != reliabilities:
            assert time.monotonic() < end_s
            time.sleep(0.005)

    first = node.create_publisher(Empty, "/it", 1)
    until(["reliable"])
    while quiet_for_s(watch, 0.2) < 0.2:
        pass
    watch.look(now=True)
    node.destroy_publisher(first)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_publisher(Empty, "/it", best_effort)
    until(["best_effort"])


def offered_on(topic: str, graph: GraphSnapshot) -> list[str]:
    """Return the reliabilities of the publishers on a topic."""
    return [each.qos.reliability for each in graph.endpoints if each.topic == topic]


def test_endpoints_are_asked_for_if_a_glance_changed(node: Node) -> None:
    """The endpoints of a topic are the known ones while a glance at it is the same, and until all are asked for."""
    endpoints = Endpoints(node)
    one = TopicGlance(["std_msgs/msg/Empty"], 1, 0)
    assert endpoints.after("/it", one) == []
    node.create_publisher(Empty, "/it", 1)
    end_s = time.monotonic() + 20
    while not Endpoints(node).of("/it"):
        assert time.monotonic() < end_s
    assert endpoints.after("/it", one) == []
    assert len(endpoints.after("/it", one._replace(publishers=2))) == 1
    node.create_publisher(Empty, "/it", 1)
    while len(Endpoints(node).of("/it")) < 2:
        assert time.monotonic() < end_s
    assert len(endpoints.after("/it", one._replace(publishers=2))) == 1
    endpoints.forget_glances()
    assert len(endpoints.after("/it", one._replace(publishers=2))) == 2


@pytest.mark.parametrize(
    "name", ["unittest/__main__/X", "unittest/srv/X", "std_srvs/srv/None", "../srv/X", "x"]
)
def test_a_type_that_no_package_defines_is_not_imported(name: str) -> None:
    """A type of no installed package is not imported: a node that announces it runs no code here.

    The imported code could end this process.
    """
    with pytest.raises(ImportError, match="no installed package defines"):
        interface_named(name)


def test_endpoints_are_as_rclpy_describes_them(node: Node) -> None:
    """Name, type, hash, gid and all policies match rclpy's own description."""
    lifetime = Duration(seconds=1.5)
    profile = QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        deadline=lifetime,
        lifespan=lifetime,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=lifetime,
    )
    node.create_publisher(Empty, "/it", profile)
    node.create_subscription(Empty, "/it", lambda message: None, 1)
    endpoints = Endpoints(node)
    end_s = time.monotonic() + 20
    while len(endpoints.of("/it")) < 2:
        assert time.monotonic() < end_s
    infos = node.get_publishers_info_by_topic("/it") + node.get_subscriptions_info_by_topic("/it")
    found = []
    for each in endpoints.of("/it"):
        found.append((each.kind, each.type, each.type_hash, each.gid, *policies_of(each.qos)))
    assert found == [description_of(info) for info in infos]
    offered, requested = (endpoint.qos for endpoint in endpoints.of("/it"))
    assert offered.deadline_ns == offered.lifespan_ns == 1_500_000_000
    assert offered.liveliness_lease_ns == 1_500_000_000
    assert requested.deadline_ns is requested.liveliness_lease_ns is None


def policies_of(qos: Qos) -> tuple[str, str, str]:
    """Return the named policies of a profile."""
    return qos.reliability, qos.durability, qos.liveliness


def description_of(info: TopicEndpointInfo) -> tuple[str, ...]:
    """Return rclpy's description of an endpoint in our words."""
    qos = info.qos_profile
    policies = (qos.reliability, qos.durability, qos.liveliness)
    names = [policy.name.lower() for policy in policies]
    gid = bytes(info.endpoint_gid).hex()
    kind = info.endpoint_type.name.lower()
    return (kind, info.topic_type, str(info.topic_type_hash), gid, *names)
