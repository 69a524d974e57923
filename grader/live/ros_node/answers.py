"""Takes the answers to calls of services, without an executor of rclpy.

An executor asks each entity of its nodes at each turn, and runs a coroutine for each answer.
"""

from __future__ import annotations

from contextlib import ExitStack, suppress
from typing import Any

from rclpy.client import Client
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation


class Answers:
    """The answers to all calls of some clients."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._clients: list[Client[Any, Any]] = []
        self._set: Any = None

    def add(self, client: Client[Any, Any]) -> None:
        """Take the answers to a client's calls too."""
        self._clients.append(client)
        handle = self._context.handle
        with handle:
            self._set = rclpy_implementation.WaitSet(0, 0, 0, len(self._clients), 0, 0, handle)

    def take(self, time_s: float) -> None:
        """Wait for an answer, or until the time is over, and hand all answers to their calls."""
        with ExitStack() as held:
            held.enter_context(self._set)
            self._set.clear_entities()
            for client in self._clients:
                held.enter_context(client.handle)
                self._set.add_client(client.handle)
            self._set.wait(max(0, round(time_s * 1e9)))
            ready = self._set.get_ready_entities("client")
            for client in self._clients:
                if client.handle.pointer in ready:
                    _take(client)


def _take(client: Client[Any, Any]) -> None:
    header, response = client.handle.take_response(client.srv_type.Response)
    if header is None:
        return
    with suppress(KeyError):  # The call was given up.
        future = client.get_pending_request(header.request_id.sequence_number)
        future.set_result(response)
