"""The action of the step `call`: calls of a service, by several clients at a time."""

from __future__ import annotations

import time
from typing import Any

from rclpy.client import Client

from grader.lab.steps.base import Answer
from grader.lab.steps.call import CallRecord, CallResult, CallStep
from grader.live.ros_node.deadline import Deadline
from grader.live.ros_node.filling import fields_in, filled
from grader.live.ros_node.graph import interface_named
from grader.live.ros_node.plain import plain
from grader.live.ros_node.probe import BRIEFLY_S, Cancelled, Probe, offered_type

#: Time in s that a called service may be gone from the graph, as it is when its node has ended.
_GONE_S = 1.0


def call(probe: Probe, step: CallStep) -> Answer:
    """Call the service until all calls are made, the time is over, or it has left two calls unanswered."""
    service = probe.name(step.service)
    services = [each for each in probe.watch.last.services if "/srv/" in each.type]
    kind = offered_type(services, service, step.type)
    clients = _clients(probe, service, kind, step)
    if not clients:
        return Answer("timeout", CallResult("the service is not up", service))
    message_type = interface_named(kind).Request
    sent = fields_in(message_type, step.request)
    timeout_s = step.timeout_s
    if service in probe.silent:
        timeout_s = min(timeout_s, BRIEFLY_S)
    series = _Series(clients, filled(message_type, sent), timeout_s, step)
    while series.goes_on():
        series.advance()
        if probe.cancelled:
            raise Cancelled
        probe.take_answers()
        if series.is_hopeless:
            break
    is_answered = all(record.response is not None for record in series.finished)
    if not is_answered:
        probe.silent.add(service)
    result = CallResult(service=service, type=kind, request=sent, calls=series.finished)
    if is_answered:
        return Answer("done", result)
    # A service that is gone would never have answered, however busy the machine.
    is_gone = any(record.gone for record in series.finished)
    return Answer("failed" if is_gone else "timeout", result)


def _clients(probe: Probe, service: str, kind: str, step: CallStep) -> list[Client[Any, Any]]:
    """Return the clients of a step; none if the service is not up."""
    timeout_s = min(step.timeout_s, BRIEFLY_S)
    numbers = range(step.clients)
    for number in numbers:
        probe.make_client(service, kind, number)
    clients = [probe.ready_client(service, kind, number, timeout_s) for number in numbers]
    ready = [client for client in clients if client is not None]
    return ready if len(ready) == len(clients) else []


class _Series:
    """The calls of a step; each client makes one at a time."""

    def __init__(
        self, clients: list[Client[Any, Any]], message: Any, timeout_s: float, step: CallStep
    ) -> None:
        self._idle = clients
        self._message = message
        self._timeout_s = timeout_s
        self._left = step.repeat
        self._end_s = time.monotonic() + step.at_most_s
        self._under_way: list[_Call] = []
        self.finished: list[CallRecord] = []

    def goes_on(self) -> bool:
        """Return whether calls are under way or may still be made."""
        return bool(self._under_way) or self._may_call()

    def _may_call(self) -> bool:
        return self._left > 0 and time.monotonic() < self._end_s

    def advance(self) -> None:
        """Start calls with idle clients, and collect ended calls."""
        while self._idle and self._may_call():
            self._under_way.append(_Call(self._idle.pop(0), self._message, self._timeout_s))
            self._left -= 1
        for each in tuple(self._under_way):
            record = each.finish()
            if record is not None:
                self.finished.append(record)
                self._under_way.remove(each)
                self._idle.append(each.client)

    @property
    def is_hopeless(self) -> bool:
        """True if a service has left calls unanswered, and need not be called fifty times."""
        return len(self.finished) >= 2 and self.finished[-1].response is None


class _Call:
    """A call that is under way."""

    def __init__(self, client: Client[Any, Any], message: Any, timeout_s: float) -> None:
        self.client = client
        self._started_ns = time.time_ns()
        self._deadline = Deadline(timeout_s)
        self._gone = Deadline(_GONE_S)
        self._future = client.call_async(message)
        self._ended_ns = 0
        self._future.add_done_callback(self._end)

    def _end(self, _: object) -> None:
        self._ended_ns = time.time_ns()

    def finish(self) -> CallRecord | None:
        """Return the record of a call that has ended (answered, too late, or its service gone), else None."""
        if self.client.service_is_ready():
            self._gone = Deadline(_GONE_S)
        is_gone = self._gone.passed()
        is_late = self._deadline.passed() or is_gone
        if not self._future.done() and not is_late:
            return None
        answer = self._future.result() if self._future.done() else None
        if answer is None:
            self.client.remove_pending_request(self._future)
        return CallRecord(
            started_ns=self._started_ns,
            # A call without an answer ends now.
            ended_ns=self._ended_ns or time.time_ns(),
            response=plain(answer),
            held_up_ns=round(self._deadline.stall_s * 1e9),
            gone=is_gone and answer is None,
        )
