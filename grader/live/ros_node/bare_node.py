"""A node of the grader that asks for the graph and makes clients and subscriptions, and does nothing else.

Rclpy's node has parameters, a clock, and a publisher of parameter events. They take longer to make than the node.
"""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.client import Client
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.type_support import check_for_type_support

from grader.recording.session import GRADER_NAMESPACE

_Names = list[tuple[str, list[str]]]


class BareNode:
    """A node in the grader's namespace. `rclpy.node.Node` has methods with the same names."""

    def __init__(self, name: str, context: Context) -> None:
        self.context = context
        with context.handle:
            #: The node as rclpy's implementation knows it.
            self.handle: Any = rclpy_implementation.Node(
                name, GRADER_NAMESPACE, context.handle, None, False, False
            )
        self._group = MutuallyExclusiveCallbackGroup()

    def get_topic_names_and_types(self) -> _Names:
        """Return the names of topics, and the types of each."""
        with self.handle:
            names: _Names = rclpy_implementation.rclpy_get_topic_names_and_types(self.handle, False)
        return names

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return the names of nodes, with their namespaces."""
        with self.handle:
            names: list[tuple[str, str]] = self.handle.get_node_names_and_namespaces()
        return names

    def get_service_names_and_types(self) -> _Names:
        """Return the names of services, and the types of each."""
        with self.handle:
            names: _Names = rclpy_implementation.rclpy_get_service_names_and_types(self.handle)
        return names

    def get_service_names_and_types_by_node(self, name: str, namespace: str) -> _Names:
        """Return the names of a node's services, and the types of each; RuntimeError if the node is unknown."""
        ask = rclpy_implementation.rclpy_get_service_names_and_types_by_node
        with self.handle:
            names: _Names = ask(self.handle, name, namespace)
        return names

    def get_client_names_and_types_by_node(self, name: str, namespace: str) -> _Names:
        """Return the names of services with a client in a node, and the types of each."""
        ask = rclpy_implementation.rclpy_get_client_names_and_types_by_node
        with self.handle:
            names: _Names = ask(self.handle, name, namespace)
        return names

    def count_services(self, name: str) -> int:
        """Return the number of servers of a service, by its full name."""
        with self.handle:
            return int(self.handle.get_count_services(name))

    def subscribe(self, kind: type, topic: str, profile: QoSProfile) -> Any:
        """Return a subscription of rclpy's implementation, which calls nothing."""
        check_for_type_support(kind)
        with self.handle:
            return rclpy_implementation.Subscription(
                self.handle, kind, topic, profile.get_c_qos_profile()
            )

    def create_client(self, kind: type, service: str) -> Client[Any, Any]:
        """Return a client of a service; no executor takes its answers."""
        check_for_type_support(kind)
        profile = qos_profile_services_default
        with self.handle:
            made = rclpy_implementation.Client(
                self.handle, kind, service, profile.get_c_qos_profile()
            )
        return Client(self.context, made, kind, service, profile, self._group)
