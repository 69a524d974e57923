"""The director: one trusted process in a sandbox that probes the ROS graph and records all traffic.

It starts no process and parses no file of a student.

Requests are lines of JSON on standard input. The director answers when it is ready, and then each request but
`cancel` and `stop`. The next request comes after the answer to the previous one.

======================================================  =======================================================
``{"op": "publish", "processes": 3, "step": {...}}``    does a step: its kind, the number of processes that the
                                                        session has started, and the parameters of the step
``{"op": "forget"}``                                    takes the present endpoints for those of an ended process
``{"op": "cancel"}``                                    ends the request under way
``{"op": "stop"}``                                      ends the director
======================================================  =======================================================

Messages to the session are lines of JSON on standard output, see `grader.live.ros_node.reports`. An answer is
``["answer", [outcome, result]]``, for example ``["answer", ["done", {"topic": "/chatter", "matched": true}]]``.
"""

from __future__ import annotations

import json
import queue
import socket
import sys
import threading
from pathlib import Path
from typing import Any

from grader.lab.steps import STEPS
from grader.lab.steps.base import Answer, StepResult
from grader.live.ros_node.filling import DoesNotFit
from grader.live.ros_node.graph import GraphWatch
from grader.live.ros_node.probe import Cancelled, Probe
from grader.live.ros_node.reports import report
from grader.live.ros_node.steps import ACTIONS
from grader.recording.session import UNKNOWN_NODE, Trusted

#: Time in s to look for nodes that do not belong into a network which is not the sandbox's own.
_FOREIGN_S = 0.5
#: A recording of this size that is full was filled by a flood of messages, and not for want of disk space.
_ENOUGH_BYTES = 64 * 2**20
#: Names of foreign nodes that are told.
_MOST_NAMED = 5


class Director:
    """Serves the requests of one session; for the parameters see `Probe`."""

    def __init__(
        self,
        folder: Path,
        name: str,
        domain_id: int,
        reference_nodes: set[str],
        expected: set[str],
    ) -> None:
        self._probe = Probe(folder, name, domain_id, reference_nodes, expected)
        self._problems: list[str] = []
        self._requests: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()

    def serve(self) -> None:
        """Answer requests until `stop` or the end of input."""
        self._require_empty_graph()
        threading.Thread(target=self._listen, daemon=True).start()
        watch = self._probe.watch
        report("trusted", Trusted("director", watch.own_prefix))
        _send(Answer("done"))
        while True:
            try:
                request = self._requests.get_nowait()
            except queue.Empty:
                watch.wait(GraphWatch.CLOSELY_S)
                continue
            if request is None:
                break
            _send(self._answer(request))
        watch.close()
        self._close_recorder()

    def _close_recorder(self) -> None:
        recorder, limit_bytes = self._probe.recorder, self._probe.limit_bytes
        # The process ends now, and leaves the graph with it.
        recorder.finish()
        left_out = recorder.unrecorded
        if limit_bytes < _ENOUGH_BYTES and any(each.messages for each in left_out):
            size = f"{limit_bytes / 1e6:.0f} MB"
            self._problems.append(f"the disk had room for a recording of {size} only")
        for problem in self._problems + recorder.problems:
            report("problems", problem)
        for each in left_out:
            report("unrecorded", each)

    def _require_empty_graph(self) -> None:
        """Note nodes that are in the graph before the session starts any, which would pass for the student's."""
        # A network with loopback alone is the sandbox's own, and new.
        shared = any(name != "lo" for _, name in socket.if_nameindex())
        foreign: set[str] = set()

        def named() -> list[str]:
            graph = self._probe.watch.look(now=True)
            foreign.update(graph.nodes)
            foreign.update(endpoint.node for endpoint in graph.endpoints)
            return sorted(name for name in foreign if UNKNOWN_NODE not in name)

        self._probe.until(named, _FOREIGN_S if shared else 0.0)
        if foreign:
            nodes = ", ".join(named()[:_MOST_NAMED]) or "not known by name"
            self._problems.append(
                f"before anything was started, there were other ROS nodes in its network: {nodes}"
            )

    def _listen(self) -> None:
        """Take requests as they come."""
        for line in sys.stdin:
            request = json.loads(line)
            self._probe.cancelled = request["op"] in ("cancel", "stop")
            if request["op"] == "stop":
                break
            if not self._probe.cancelled:
                self._requests.put(request)
            self._probe.watch.call()
        self._probe.cancelled = True
        self._requests.put(None)
        self._probe.watch.call()

    def _answer(self, request: dict[str, Any]) -> Answer:
        try:
            answer = self._act(request)
        except Cancelled:
            return Answer("cancelled")
        except DoesNotFit as problem:
            return Answer("failed", StepResult(str(problem)))
        except Exception as problem:  # The session must hear of any problem and go on.
            return Answer("failed", StepResult(f"{type(problem).__name__}: {problem}"))
        if answer.outcome == "done":
            self._probe.forget_missing()
        return answer

    def _act(self, request: dict[str, Any]) -> Answer:
        probe, op = self._probe, request["op"]
        probe.processes = int(request.get("processes", 0))
        if op == "forget":
            probe.forgotten = {endpoint.gid for endpoint in probe.watch.look(now=True).endpoints}
            return Answer("done")
        model = STEPS[op]
        return ACTIONS[model](probe, model.model_validate(request["step"]))


def _send(answer: Answer) -> None:
    report("answer", (answer.outcome, answer.result.to_plain()))
