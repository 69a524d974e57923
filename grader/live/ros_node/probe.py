"""The director's node in the graph, with everything that the actions of steps use: waiting, names, clients, recorder."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.client import Client
from rclpy.clock import ROSClock
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState

from grader.live.ros_node.answers import Answers
from grader.live.ros_node.bare_node import BareNode
from grader.live.ros_node.deadline import Deadline
from grader.live.ros_node.goals import ActionProbe
from grader.live.ros_node.graph import GraphWatch, interface_named, new_context, silent_node
from grader.live.ros_node.recorder import DEFAULT_LIMIT_BYTES, Recorder
from grader.live.ros_node.reports import report
from grader.recording.session import (
    GRADER_NAMESPACE,
    STANDARD_TOPICS,
    Endpoint,
    GraphSnapshot,
    ServiceEndpoint,
)
from ros_bag.qos import Qos
from ros_bag.writing import BagWriter

#: Longest time in s between two looks at a condition.
_LOOK_S = 0.02
#: The same for a condition on the graph alone: its changes end a wait.
_LOOK_AT_GRAPH_S = 0.1
#: Time in s that a publisher of the grader waits for the subscriptions of the student and of the recorder.
MATCH_S = 3.0
#: Time in s that a service may take to come up, or to answer after it left a call unanswered.
BRIEFLY_S = 3.0
#: Further wait in s for something that did not come up, if nothing was started, was done or changed since.
_AGAIN_S = 0.5
#: Service events that the middleware keeps for the recorder.
_EVENTS_DEPTH = 100
#: A bag takes this part of the free space of the disk at most, against floods of messages.
_SHARE_OF_FREE = 20


class Cancelled(Exception):
    """Raised when the session no longer needs the answer, because the student's processes have ended."""


class Probe:
    """A node that asks and measures; the bag with a name goes to a folder.

    Parameters
    ----------
    reference_nodes
        Full names of the grader's nodes. All other nodes are the student's.
    expected
        Names that the rubric uses. They are never taken for a misspelling of another name.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        domain_id: int,
        reference_nodes: set[str],
        expected: set[str],
    ) -> None:
        self.domain_id = domain_id
        self.reference_nodes = reference_nodes
        self.expected = expected
        self._node = BareNode("probe", new_context(domain_id))
        self._clock = ROSClock()
        #: For actions alone, with a node of their own.
        self._executor: SingleThreadedExecutor | None = None
        self._answers = Answers(self._node.context)
        free_bytes = shutil.disk_usage(folder).free
        self.limit_bytes = min(DEFAULT_LIMIT_BYTES, free_bytes // _SHARE_OF_FREE)
        self.recorder = Recorder(
            BagWriter(folder, name),
            domain_id,
            limit_bytes=self.limit_bytes,
            context=self._node.context,
        )
        self.watch = GraphWatch(self._node, self._on_change, {*expected, *STANDARD_TOPICS})
        #: Name in the rubric -> name that the student uses.
        self.names: dict[str, str] = {}
        #: Gids of endpoints of ended processes.
        self.forgotten: set[str] = set()
        #: Services and actions that left a call or a goal unanswered.
        self.silent: set[str] = set()
        #: Number of processes that were started until now.
        self.processes = 0
        #: True if the request under way has been cancelled.
        self.cancelled = False
        #: Name that did not come up, and the number of processes then.
        self._missing: set[tuple[str, int]] = set()
        self._clients: dict[tuple[str, str, int], Client[Any, Any]] = {}
        #: Clients that the recorder may not know yet.
        self._unmatched: set[tuple[str, str, int]] = set()
        self._actions: dict[tuple[str, str], ActionProbe] = {}

    def _on_change(self, graph: GraphSnapshot) -> None:
        self._missing.clear()
        self.recorder.follow(graph.endpoints)
        report("graph", graph)

    # -- waiting ------------------------------------------------------------------------------

    def spin(self, time_s: float = _LOOK_S) -> None:
        """Take messages of action servers, for a short time, and look at the graph."""
        assert self._executor is not None
        self._executor.spin_once(timeout_sec=min(time_s, _LOOK_S))
        self.watch.look()

    def take_answers(self, time_s: float = _LOOK_S) -> None:
        """Take answers of services, for a short time, and look at the graph."""
        self._answers.take(min(time_s, _LOOK_S))
        self.watch.look()

    def until(
        self,
        condition: Callable[[], object],
        timeout_s: float,
        *,
        wait: Callable[[float], None] | None = None,
        look_s: float = _LOOK_S,
    ) -> bool:
        """Wait for a condition, and return whether it came true in time; raises Cancelled.

        The condition is looked at after `look_s` at the latest. Answers of services and actions need another `wait` than
        the one for the graph: `take_answers` or `spin`.
        """
        wait = wait or self.watch.wait
        deadline = Deadline(timeout_s)
        while not condition():
            if self.cancelled:
                raise Cancelled
            if deadline.passed():
                return False
            wait(min(look_s, deadline.left_s))
        return True

    def wait(self, time_s: float) -> None:
        """Let time pass, and look at the graph; raises Cancelled."""
        deadline = Deadline(time_s)
        while not deadline.passed():
            if self.cancelled:
                raise Cancelled
            self.watch.wait(deadline.left_s)

    def until_in_graph(self, name: str, condition: Callable[[], object], timeout_s: float) -> bool:
        """Wait as `until_up` does for a condition on the last snapshot of the graph alone."""
        return self.until_up(name, condition, timeout_s, _LOOK_AT_GRAPH_S)

    def until_up(
        self,
        name: str,
        condition: Callable[[], object],
        timeout_s: float,
        look_s: float = _LOOK_S,
    ) -> bool:
        """Wait for something in the graph; briefly if the same wait failed and nothing has changed since."""
        wanted = (name, self.processes)
        again = Deadline(_AGAIN_S)

        def is_over() -> object:
            return condition() or (wanted in self._missing and again.passed())

        self.until(is_over, timeout_s, look_s=look_s)
        is_up = bool(condition())
        if not is_up:
            self._missing.add(wanted)
        return is_up

    def forget_missing(self) -> None:
        """Wait for everything as long as at first, because something has changed."""
        self._missing.clear()

    # -- names --------------------------------------------------------------------------------

    def name(self, wanted: str) -> str:
        """Return the name that the student uses for a name in the rubric."""
        return self.names.get(wanted, wanted)

    def node_name(self, wanted: str) -> str:
        """Return the full name that the student uses for a node."""
        if wanted in self.names:
            return self.names[wanted]
        return self.name(wanted if wanted.startswith("/") else f"/{wanted}")

    # -- recording, services, actions ---------------------------------------------------------

    def record(self, topic: str, topic_type: str, durability: str = "volatile") -> None:
        """Record a topic of the grader's own, which no snapshot of the graph shows."""
        offered = Qos(reliability="reliable", durability=durability)
        node = f"{GRADER_NAMESPACE}/probe"
        endpoint = Endpoint("publisher", topic, topic_type, "", node, "", offered)
        self.recorder.follow([endpoint])

    def ready_client(
        self, service: str, service_type: str, number: int, timeout_s: float
    ) -> Client[Any, Any] | None:
        """Return the recorded client of a service with a number; None if the service is not up."""
        key = (service, service_type, number)
        if key not in self._clients:
            self.make_client(*key)
        client = self._clients[key]
        if key in self._unmatched:
            events, events_type = _events_of(service, service_type)
            self.until(lambda: self.recorder.matched(events, events_type) > number, MATCH_S)
            self._unmatched.remove(key)
        is_up = self.until_up(service, client.service_is_ready, timeout_s)
        return client if is_up else None

    def make_client(self, service: str, service_type: str, number: int = 0) -> None:
        """Make the recorded client of a service with a number, and wait for nothing yet."""
        key = (service, service_type, number)
        if key in self._clients:
            return
        client = self._node.create_client(interface_named(service_type), service)
        client.configure_introspection(
            self._clock,
            QoSProfile(depth=_EVENTS_DEPTH),
            ServiceIntrospectionState.CONTENTS,
        )
        self.record(*_events_of(service, service_type))
        self._answers.add(client)
        self._clients[key] = client
        self._unmatched.add(key)

    def ask(self, service: str, service_type: str, timeout_s: float, fields: dict[str, Any]) -> Any:
        """Call a service once with some fields in the request; returns the response; None if there was none."""
        client = self.ready_client(service, service_type, 0, timeout_s)
        if client is None:
            return None
        future = client.call_async(interface_named(service_type).Request(**fields))
        self.until(future.done, timeout_s, wait=self.take_answers)
        return future.result() if future.done() else None

    def action(self, name: str, action_type: str) -> ActionProbe:
        """Return the client of an action."""
        key = (name, action_type)
        if self._executor is None:
            self._executor = SingleThreadedExecutor(context=self._node.context)
            self._executor.add_node(silent_node("actions", self._node.context))
        if key not in self._actions:
            (node,) = self._executor.get_nodes()
            self._actions[key] = ActionProbe(node, name, action_type)
        return self._actions[key]


def _events_of(service: str, service_type: str) -> tuple[str, str]:
    """Return the topic of a service's events, and its type."""
    return f"{service}/_service_event", f"{service_type}_Event"


def offered_type(offers: Iterable[ServiceEndpoint], name: str, wanted: str) -> str:
    """Return a type that a service or action offers and that is installed here, the wanted type if possible.

    Another type than the wanted one is a fault that other checks find; with it, the service still answers.
    """
    offered = [offer.type for offer in offers if offer.name == name]
    if wanted in offered:
        return wanted
    for kind in offered:
        with suppress(ImportError):
            interface_named(kind)
            return kind
    return wanted
