"""The director: one trusted process in a sandbox that probes the ROS graph and records all traffic.

It reads one JSON request a line from standard input, and writes lines of JSON to standard output: the name of a list of
the session's record with an entry for it, or "answer" with outcome ("done", "timeout", "cancelled" or "failed") and
result. It answers once when it is ready, and then to each request but the last. It starts no process and parses no
file of a student's.

Requests: ``{"op": "wait_for", ...}``, ``observe``, ``publish``, ``call``, ``send_goal``, ``get_parameters``,
``set_parameters``, ``change_state``, ``forget``, ``stop``; ``{"op": "cancel"}`` ends the one under way.
"""

from __future__ import annotations

import dataclasses
import json
import queue
import shutil
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rclpy.service_introspection import ServiceIntrospectionState

from grader.evidence.near_miss import Candidate, candidates_in, near_miss
from grader.live.ros_node.deadline import Deadline
from grader.live.ros_node.filling import DoesNotFit, fields_in, filled
from grader.live.ros_node.goals import ActionProbe, GoalStep
from grader.live.ros_node.graph import GraphWatch, interface_named, new_context, silent_node
from grader.live.ros_node.plain import plain
from grader.live.ros_node.recorder import DEFAULT_LIMIT_BYTES, Recorder
from grader.recording.bag import BagWriter
from grader.recording.session import (
    AWAITED,
    GRADER_NAMESPACE,
    STANDARD_TOPICS,
    UNKNOWN_NODE,
    Endpoint,
    GraphSnapshot,
    Published,
    Qos,
    ServiceEndpoint,
    Trusted,
)
from grader.recording.trusted_channel import digest

#: Once a student's node shows other endpoints, how long the wanted name may still take to appear.
_NEAR_MISS_AFTER_S = 2.0
_NO_ANSWER = "the node's parameter services do not answer"
_NO_LIFECYCLE = "it offers no get_state service that answers, as a lifecycle node does"
_STUCK = "the transition was not answered"
#: What is passed on of a state's name.
_LONGEST_LABEL = 40
_STANDARD_PARAMETERS = ("use_sim_time", "start_type_description_service")
_SPIN_S = 0.01
#: How long a publisher of ours waits until the subscriptions of the student and the recorder are matched.
_MATCH_S = 3.0
#: How long it takes until the other side knows of a subscription that is matched on ours; it tells nobody.
_KNOWN_S = 0.1
#: How long it stays for a subscription that has not taken all of it.
_ACKNOWLEDGED_S = 1.0
#: In a network that is not the sandbox's own, how long to look for nodes that do not belong there.
_FOREIGN_S = 0.5
#: How long a service may take to come up, and to answer once it has left a call unanswered: its long wait was that one.
_BRIEFLY_S = 3.0
#: How long to wait once more for what did not come up, if nothing was started, was done or changed in the graph since.
_AGAIN_S = 0.5
#: How long a service that is called may be gone from the graph, as it is when its node has ended.
_GONE_S = 1.0
#: Service events that the middleware keeps until the recorder has them.
_EVENTS_DEPTH = 100
#: Of the disk's free space a bag takes one part in so many at most, so that no flood of messages fills it.
_SHARE_OF_FREE = 20
#: A recording of this size at least is as good as any: what fills it is a flood, and not for want of disk.
_ENOUGH_BYTES = 64 * 2**20
#: What is passed on of the names of a node's parameters.
_MOST_DECLARED = 200


#: Outcome and result of a request.
Answer = tuple[str, dict[str, Any]]


class Cancelled(Exception):
    """The session no longer needs the answer, for the student's processes are gone."""


class Director:
    """Serves the requests of one session, whose bag of a name goes to a folder.

    All nodes but `reference_nodes` (fully qualified) are the student's; `expected` are names that the rubric uses,
    which are never taken for a misspelling of another.
    """

    def __init__(
        self, folder: Path, name: str, domain_id: int, reference_nodes: set[str], expected: set[str]
    ) -> None:
        self._context = new_context(domain_id)
        self._node = silent_node("probe", self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._limit_bytes = min(
            DEFAULT_LIMIT_BYTES, shutil.disk_usage(folder).free // _SHARE_OF_FREE
        )
        self._recorder = Recorder(BagWriter(folder, name), domain_id, limit_bytes=self._limit_bytes)
        self._watch = GraphWatch(self._node, self._on_change, {*expected, *STANDARD_TOPICS})
        self._problems: list[str] = []
        self._reference_nodes, self._expected = reference_nodes, expected
        self._names: dict[str, str] = {}
        self._domain_id = domain_id
        self._forgotten: set[str] = set()
        self._clients: dict[tuple[str, str, int], Client[Any, Any]] = {}
        self._probes: dict[tuple[str, str], ActionProbe] = {}
        self._silent: set[str] = set()
        self._missing: set[tuple[str, int]] = set()
        self._requests: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._cancelled = False

    def serve(self) -> None:
        """Answer requests until `stop` or the end of input."""
        self._require_empty_graph()
        threading.Thread(target=self._listen, daemon=True).start()
        _send("trusted", Trusted("director", self._watch.own_prefix))
        _send("answer", ("done", {}))
        while True:
            try:
                request = self._requests.get(timeout=GraphWatch.PERIOD_S)
            except queue.Empty:
                self._watch.look()
                continue
            if request is None:
                break
            _send("answer", self._answer(request))
        self._watch.close()
        self._recorder.stop()
        unrecorded = self._recorder.unrecorded
        if self._limit_bytes < _ENOUGH_BYTES and any(left_out.messages for left_out in unrecorded):
            self._problems.append(
                f"the disk had room for a recording of {self._limit_bytes / 1e6:.0f} MB only"
            )
        for problem in self._problems + self._recorder.problems:
            _send("problems", problem)
        for left_out in unrecorded:
            _send("unrecorded", left_out)

    def _require_empty_graph(self) -> None:
        """See to it that nothing is in the graph before the first process is started: it would be taken for its."""
        # A network with loopback alone is the sandbox's own, and new.
        shared = any(name != "lo" for _, name in socket.if_nameindex())
        foreign_nodes: set[str] = set()

        def named() -> list[str]:
            graph = self._watch.look(now=True)
            foreign_nodes.update(graph.nodes, (endpoint.node for endpoint in graph.endpoints))
            return sorted(name for name in foreign_nodes if UNKNOWN_NODE not in name)

        self._until(named, _FOREIGN_S if shared else 0.0)
        if foreign_nodes:
            who = ", ".join(named()[:5]) or "not known by name"
            self._problems.append(
                f"before anything was started, there were other ROS nodes in its network: {who}"
            )

    def _listen(self) -> None:
        """Take requests as they come; the session sends one only when the one before was answered."""
        for line in sys.stdin:
            request = json.loads(line)
            self._cancelled = request["op"] in ("cancel", "stop")
            if request["op"] == "stop":
                break
            if not self._cancelled:
                self._requests.put(request)
        self._cancelled = True
        self._requests.put(None)

    def _answer(self, request: dict[str, Any]) -> Answer:
        self._processes = int(request.get("processes", 0))
        try:
            answer: Answer = getattr(self, f"_do_{request['op']}")(request)
        except Cancelled:
            return "cancelled", {}
        except DoesNotFit as problem:
            return "failed", {"problem": str(problem)}
        except Exception as problem:  # Whatever it is, the session must hear of it and go on.
            return "failed", {"problem": f"{type(problem).__name__}: {problem}"}
        if answer[0] == "done":
            self._missing.clear()
        return answer

    def _on_change(self, graph: GraphSnapshot) -> None:
        self._missing.clear()
        self._recorder.follow(graph.endpoints)
        _send("graph", graph)

    def _spin(self) -> None:
        self._executor.spin_once(timeout_sec=_SPIN_S)
        self._watch.look()

    def _until(
        self, condition: Callable[[], object], timeout_s: float, *, spins: bool = False
    ) -> bool:
        deadline = Deadline(timeout_s)
        while not condition():
            if self._cancelled:
                raise Cancelled
            if deadline.passed():
                return False
            # Only answers to our own calls need an executor, and spinning one costs some thirty times as much as this.
            if spins:
                self._spin()
            else:
                time.sleep(_SPIN_S)
                self._watch.look()
        return True

    def _until_up(self, name: str, condition: Callable[[], object], timeout_s: float) -> bool:
        wanted, again = (name, self._processes), Deadline(_AGAIN_S)
        self._until(lambda: condition() or (wanted in self._missing and again.passed()), timeout_s)
        is_up = bool(condition())
        self._missing |= set() if is_up else {wanted}
        return is_up

    # -- waiting ------------------------------------------------------------------------------

    def _do_wait_for(self, request: Mapping[str, Any]) -> Answer:
        kind = next(k for k in AWAITED if request.get(k))
        wanted, wanted_type = request[kind], request.get("type")
        started_s = time.monotonic()
        since_s: float | None = (
            None  # when a node of the student's was first there without the wanted name
        )

        # Graph of the last search and whether near misses counted then. A graph of thousands of names is searched once.
        looked_at: tuple[GraphSnapshot | None, bool] = (None, False)
        latest: list[Candidate] = []

        def found() -> list[Candidate]:
            nonlocal since_s, looked_at, latest
            since_s = (since_s or time.monotonic()) if self._students() else None
            is_near = since_s is not None and time.monotonic() - since_s > _NEAR_MISS_AFTER_S
            if looked_at[0] is not self._watch.last or looked_at[1] != is_near:
                looked_at = (self._watch.last, is_near)
                latest = self._found(kind, wanted, wanted_type, is_near=is_near)
            return latest

        is_there = self._until_up(wanted, found, float(request["timeout_s"]))
        waited = {"waited_s": round(time.monotonic() - started_s, 3)}
        if not is_there:
            return "timeout", {
                **waited,
                "there": sorted({c.name for c in self._candidates(kind, wanted)})[:50],
            }
        meant = min(found(), key=lambda c: (c.type != wanted_type, c.name != wanted))
        if meant.name != wanted:
            self._names[wanted] = meant.name
            self._watch.first.add(meant.name)
        if kind == "action":
            # So that the server knows it by the time that it sends a goal. A type that cannot be used is met there.
            with suppress(Exception):
                self._probe(meant.name, meant.type)
        return "done", {**waited, "name": meant.name, "type": meant.type}

    def _found(
        self, kind: str, wanted: str, wanted_type: str | None, *, is_near: bool
    ) -> list[Candidate]:
        """Return the candidates with a name; without any, and if `is_near`, the one with the nearest name."""
        candidates = self._candidates(kind, wanted)
        # What stood for it before does so for as long as it is there.
        same = [c for c in candidates if c.name in (wanted, self._names.get(wanted))]
        if same or not is_near:
            return same
        taken = self._expected | set(self._names.values())
        guess = near_miss(wanted, wanted_type, [c for c in candidates if c.name not in taken])
        return [guess] if guess is not None else []

    def _students(self) -> list[str]:
        return [n for n in self._watch.last.nodes if n not in self._reference_nodes]

    def _candidates(self, kind: str, wanted: str) -> list[Candidate]:
        return candidates_in(self._watch.last, kind, wanted, self._reference_nodes, self._forgotten)

    def _do_forget(self, request: Mapping[str, Any]) -> Answer:
        """Take the endpoints that are there as those of a dead process, which may stay in the graph for a while."""
        self._forgotten = {e.gid for e in self._watch.look(now=True).endpoints}
        return "done", {}

    def _do_observe(self, request: Mapping[str, Any]) -> Answer:
        topic = request.get("first_message_on")
        if topic:
            actual = self._names.get(topic, topic)
            if not self._until(
                lambda: any(n for (t, _), n in self._recorder.counts.items() if t == actual),
                float(request["timeout_s"]),
            ):
                return "timeout", {"topic": actual}
        opened_ns = time.time_ns()
        self._until(lambda: False, float(request["duration_s"]))
        return "done", {"opened_ns": opened_ns, "closed_ns": time.time_ns()}

    def _do_publish(self, request: Mapping[str, Any]) -> Answer:
        topic = self._names.get(request["topic"], request["topic"])
        kind = interface_named(request["type"])
        # Compatible with every request. All messages are kept, since the student's side may be matched later
        # than ours, and then asks for those that it has missed.
        offered = QoSProfile(
            depth=int(request["count"]), durability=DurabilityPolicy.TRANSIENT_LOCAL
        )
        context = new_context(
            self._domain_id
        )  # its own, since the student may use another type on this topic
        node = silent_node("publisher", context)
        publisher = node.create_publisher(kind, topic, offered)
        self._record(topic, request["type"], "transient_local")
        data = serialize_message(filled(kind, request["message"]))
        sent = 0
        try:
            students = [
                e
                for e in self._watch.last.endpoints
                if e.kind == "subscription" and e.topic == topic
            ]
            # The recorder's subscription is one more.
            matched = self._until(
                lambda: publisher.get_subscription_count() > len(students), _MATCH_S
            )
            while sent < int(request["count"]):
                publisher.publish(data)
                sent += 1
                self._until(lambda: False, 1.0 / float(request["rate_hz"]))
            publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))
        finally:
            _send("published", Published("director", topic, request["type"], digest(data) * sent))
            node.destroy_node()
            context.shutdown()
        return "done", {"topic": topic, "matched": matched}

    # -- services -----------------------------------------------------------------------------

    def _ready_client(
        self, service: str, service_type: str, number: int, timeout_s: float
    ) -> Client[Any, Any] | None:
        key = (service, service_type, number)
        if key not in self._clients:
            client = self._node.create_client(interface_named(service_type), service)
            client.configure_introspection(
                self._node.get_clock(),
                QoSProfile(depth=_EVENTS_DEPTH),
                ServiceIntrospectionState.CONTENTS,
            )
            self._clients[key] = client
            events, events_type = f"{service}/_service_event", f"{service_type}_Event"
            self._record(events, events_type)
            self._until(lambda: self._recorder.matched(events, events_type) > number, _MATCH_S)
        return (
            self._clients[key]
            if self._until_up(service, self._clients[key].service_is_ready, timeout_s)
            else None
        )

    def _record(self, topic: str, topic_type: str, durability: str = "volatile") -> None:
        """Have a topic of our own recorded, which no snapshot of the graph shows."""
        offered = Qos(reliability="reliable", durability=durability)
        self._recorder.follow(
            [Endpoint("publisher", topic, topic_type, "", f"{GRADER_NAMESPACE}/probe", "", offered)]
        )

    def _do_call(self, request: Mapping[str, Any]) -> Answer:
        service = self._names.get(request["service"], request["service"])
        services = [s for s in self._watch.last.services if "/srv/" in s.type]
        kind, timeout_s = (
            _offered_type(services, service, request["type"]),
            float(request["timeout_s"]),
        )
        briefly_s = min(timeout_s, _BRIEFLY_S)
        timeout_s = briefly_s if service in self._silent else timeout_s
        clients = [
            self._ready_client(service, kind, n, briefly_s) for n in range(int(request["clients"]))
        ]
        if any(client is None for client in clients):
            return "timeout", {"service": service, "calls": [], "problem": "the service is not up"}
        message_type = interface_named(kind).Request
        sent = fields_in(message_type, request["request"])
        message = filled(message_type, sent)
        idle, calls = [client for client in clients if client is not None], list[_Call]()
        finished: list[dict[str, Any]] = []
        left, end_s = int(request["repeat"]), time.monotonic() + float(request["at_most_s"])
        while calls or (left and time.monotonic() < end_s):
            while idle and left and time.monotonic() < end_s:
                calls.append(_Call(idle.pop(0), message, timeout_s))
                left -= 1
            for call in tuple(calls):
                if (record := call.finish()) is not None:
                    finished.append(record)
                    calls.remove(call)
                    idle.append(call.client)
            if self._cancelled:
                raise Cancelled
            self._spin()
            if len(finished) >= 2 and finished[-1]["response"] is None:
                break  # A service that does not answer twice is not asked fifty times.
        is_answered = all(c["response"] is not None for c in finished)
        self._silent |= set() if is_answered else {service}
        result = {"service": service, "type": kind, "request": sent, "calls": finished}
        # A service that is gone would never have answered, however busy the machine.
        late = "failed" if any(c.get("gone") for c in finished) else "timeout"
        return ("done" if is_answered else late), result

    def _probe(self, action: str, action_type: str) -> ActionProbe:
        key = (action, action_type)
        if key not in self._probes:
            self._probes[key] = ActionProbe(self._node, action, action_type)
        return self._probes[key]

    def _do_send_goal(self, request: Mapping[str, Any]) -> Answer:
        action, timeout_s = (
            self._names.get(request["action"], request["action"]),
            float(request["timeout_s"]),
        )
        kind = _offered_type(self._watch.last.actions, action, request["type"])
        probe, about = (
            self._probe(action, kind),
            {"action": action, "type": kind, "goals": list[Any]()},
        )
        if not self._until_up(action, lambda: probe.ready, min(timeout_s, _BRIEFLY_S)):
            return "timeout", {**about, "problem": "the action server is not up"}
        self._until(
            lambda: self._recorder.matched(f"{action}/_action/feedback", f"{kind}_FeedbackMessage"),
            _MATCH_S,
        )
        self._until(lambda: False, _KNOWN_S)
        timeout_s = min(timeout_s, _BRIEFLY_S) if action in self._silent else timeout_s
        given = (
            values for values in (request["goal"], request["newer_goal"]) if values is not None
        )
        goal_type = probe.type.Goal
        goals = [_goal_of(goal_type, values) for values in given]
        step = GoalStep(probe, request, timeout_s, *goals)
        try:
            # The step has a deadline of its own.
            self._until(step.advance, 2 * timeout_s, spins=True)
        except Cancelled:
            step.outcome = "cancelled"
        result = step.result()
        self._silent |= {action} if result["goals"][0]["accepted"] is None else set()
        return step.outcome, {**about, **result}

    def _ask(
        self,
        request: Mapping[str, Any],
        operation: str,
        package: str = "rcl_interfaces",
        **fields: Any,
    ) -> Any:
        """Call one of the parameter services of a request's node, or of another package; None without an answer."""
        service_type = f"{package}/srv/{operation.title().replace('_', '')}"
        timeout_s = float(request["timeout_s"])
        client = self._ready_client(
            f"{self._node_name(request)}/{operation}", service_type, 0, timeout_s
        )
        if client is None:
            return None
        future = client.call_async(interface_named(service_type).Request(**fields))
        self._until(future.done, timeout_s, spins=True)
        return future.result() if future.done() else None

    def _node_name(self, request: Mapping[str, Any]) -> str:
        wanted = request["node"] if request["node"].startswith("/") else "/" + request["node"]
        return str(self._names.get(request["node"], self._names.get(wanted, wanted)))

    def _do_get_parameters(self, request: Mapping[str, Any]) -> Answer:
        node = self._node_name(request)
        listed = self._ask(request, "list_parameters")
        declared = list(listed.result.names) if listed is not None else []
        names = [n for n in request.get("names", declared[:_MOST_DECLARED]) if n in declared]
        got = self._ask(request, "get_parameters", names=names) if listed is not None else None
        if got is None:
            return "timeout", {"node": node, "problem": _NO_ANSWER}
        values = {
            name: {
                "type": Parameter.Type(v.type).name.lower(),
                "value": plain(parameter_value_to_python(v)),
            }
            for name, v in zip(names, got.values, strict=False)
        }
        return "done", {
            "node": node,
            "declared": plain(declared[:_MOST_DECLARED]),
            "values": values,
        }

    def _do_set_parameters(self, request: Mapping[str, Any]) -> Answer:
        """Set parameters; one of another type, or of a misspelt name, as the student has it.

        Either is charged where it is looked for; here it is seen what the parameter does.
        """
        if request["refusal_expected"]:
            return self._set_invalid(request)
        meant: dict[str, str] = {}
        node, refused = self._node_name(request), self._refused(request, request["values"])
        if refused:
            held = self._held(request)
            for name in tuple(refused):
                value, own = (
                    request["values"][name],
                    name if name in held else _misspelt(name, request["values"], held),
                )
                if (
                    own is not None
                    and self._refused(request, {own: in_type_of(held[own], value)}) == {}
                ):
                    del refused[name]
                    meant |= {name: own} if own != name else {}
        if refused is None:
            return "timeout", {"node": node, "problem": _NO_ANSWER}
        names = {"names": meant} if meant else {}
        return ("failed" if refused else "done"), plain({"node": node, "refused": refused, **names})

    def _held(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of all of a node's parameters, as far as they are passed on."""
        got = self._do_get_parameters(
            {key: value for key, value in request.items() if key != "names"}
        )[1]
        return {name: entry["value"] for name, entry in got.get("values", {}).items()}

    def _set_invalid(self, request: Mapping[str, Any]) -> Answer:
        """Set values that are to be refused, and set back what was not, so that what follows is not affected.

        A number goes in the type that the parameter has, since for another type rclpy refuses it by itself.
        """
        node, wanted, held = self._node_name(request), request["values"], self._held(request)
        before = {name: held[name] for name in wanted if name in held}
        refused = self._refused(
            request, {n: in_type_of(before.get(n), v) for n, v in wanted.items()}
        )
        after = (
            {n: v for n, v in self._held(request).items() if n in wanted}
            if refused is not None
            else {}
        )
        kept = {"node": node, "refused": refused or {}, "before": before, "after": after}
        if changed := {n: v for n, v in before.items() if n in after and after[n] != v}:
            self._refused(request, changed)
        answered = refused is not None and before.keys() == after.keys()
        return ("done" if answered else "timeout"), plain(
            kept | ({} if answered else {"problem": _NO_ANSWER})
        )

    def _do_change_state(self, request: Mapping[str, Any]) -> Answer:
        node, about = self._node_name(request), "lifecycle_msgs"
        before = self._ask(request, "get_state", about)
        # By its label: an id that is not possible in the node's state ends a node of rclpy.
        transition = interface_named("lifecycle_msgs/msg/Transition")(label=request["transition"])
        called_ns = time.time_ns()
        changed = (
            self._ask(request, "change_state", about, transition=transition)
            if before is not None
            else None
        )
        answered_ns = time.time_ns()
        after = self._ask(request, "get_state", about) if changed is not None else None
        if before is None or changed is None or after is None:
            return "timeout", {"node": node, "problem": _NO_LIFECYCLE if before is None else _STUCK}
        states = {
            key: state.current_state.label[:_LONGEST_LABEL]
            for key, state in (("before", before), ("after", after))
        }
        times = {"called_ns": called_ns, "answered_ns": answered_ns}
        return "done", {"node": node, "success": changed.success, **states, **times}

    def _refused(
        self, request: Mapping[str, Any], values: Mapping[str, Any]
    ) -> dict[str, str] | None:
        """Set parameters; returns the reasons for which some were refused, None if there was no answer."""
        given = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        answer = self._ask(request, "set_parameters", parameters=given)
        if answer is None:
            return None
        return {
            n: r.reason for n, r in zip(values, answer.results, strict=False) if not r.successful
        }


def _misspelt(name: str, values: Mapping[str, Any], held: Mapping[str, Any]) -> str | None:
    """Return the declared parameter that was meant by a name, if one of the value's type is like it."""
    fitting = [n for n, v in held.items() if type(v) is type(values[name]) and n not in values]
    near = near_miss(name, "", [Candidate(n, "") for n in fitting if n not in _STANDARD_PARAMETERS])
    return near.name if near is not None else None


class _Call:
    """A call that is under way."""

    def __init__(self, client: Client[Any, Any], message: Any, timeout_s: float) -> None:
        self.client = client
        self._started_ns, self._deadline = time.time_ns(), Deadline(timeout_s)
        self._gone = Deadline(_GONE_S)
        self._future = client.call_async(message)
        self._ended_ns = 0
        self._future.add_done_callback(self._end)

    def _end(self, _: object) -> None:
        self._ended_ns = time.time_ns()

    def finish(self) -> dict[str, Any] | None:
        """Return the record of a call that has ended (answered, too late, or its service gone), else None."""
        self._gone = self._gone if not self.client.service_is_ready() else Deadline(_GONE_S)
        gone = self._gone.passed()
        late = self._deadline.passed() or gone
        if not self._future.done() and not late:
            return None
        answer = self._future.result() if self._future.done() else None
        if answer is None:
            self.client.remove_pending_request(self._future)
        # The callback runs in the executor, so it may come after we have seen the answer.
        ended_ns = self._ended_ns or time.time_ns()
        record = {"started_ns": self._started_ns, "ended_ns": ended_ns, "response": plain(answer)}
        stall_ns = round(self._deadline.stall_s * 1e9)
        record |= {"held_up_ns": stall_ns} if stall_ns else {}
        return record | {"gone": True} if gone and answer is None else record


def _offered_type(offers: Iterable[ServiceEndpoint], name: str, wanted: str) -> str:
    """Return the type by which a service or action can be used: another is charged where it is offered, and answers."""
    offered = [offer.type for offer in offers if offer.name == name]
    for kind in offered if wanted not in offered else ():
        with suppress(ImportError):
            interface_named(kind)
            return kind
    return wanted


def _goal_of(goal_type: Any, values: Mapping[str, Any]) -> Any:
    """Return a goal; raises DoesNotFit if the type has none of the fields, since another goal would be sent."""
    known = fields_in(goal_type, values)
    return filled(goal_type, known or values)


def in_type_of(held: Any, value: Any) -> Any:
    """Return a parameter's new value in the type of the one that it holds: false becomes "false" or "False"."""
    if isinstance(held, str):
        text = str(value).lower() if isinstance(value, bool) else str(value)
        return text.capitalize() if held[:1].isupper() else text
    try:
        return type(held)(value) if isinstance(held, (bool, int, float)) else value
    except (TypeError, ValueError):
        return value


def _send(kind: str, what: Any) -> None:
    sys.stdout.write(json.dumps([kind, what], default=dataclasses.asdict) + "\n")
    sys.stdout.flush()
