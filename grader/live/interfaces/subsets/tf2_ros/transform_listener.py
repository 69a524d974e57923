"""Hears transforms and puts them into a buffer."""

import threading
from contextlib import suppress

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage


class TransformListener:
    """Subscribes to /tf and /tf_static for a buffer."""

    def __init__(self, buffer, node, *, spin_thread=False, qos=None, static_qos=None):
        self.buffer, self.node = buffer, node
        changing = QoSProfile(depth=100) if qos is None else qos
        kept = (
            QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            if static_qos is None
            else static_qos
        )
        # Reentrant: a callback that waits for a transform must not block its arrival.
        group = ReentrantCallbackGroup()
        self.tf_sub = node.create_subscription(
            TFMessage, "/tf", self._changed, changing, callback_group=group
        )
        self.tf_static_sub = node.create_subscription(
            TFMessage, "/tf_static", self._stays, kept, callback_group=group
        )
        if spin_thread:
            self.executor = SingleThreadedExecutor()
            self.executor.add_node(node)
            self.dedicated_listener_thread = threading.Thread(target=self._spin, daemon=True)
            self.dedicated_listener_thread.start()

    def unregister(self):
        """Hear no more."""
        self.node.destroy_subscription(self.tf_sub)
        self.node.destroy_subscription(self.tf_static_sub)

    def _spin(self):
        with suppress(ExternalShutdownException):
            self.executor.spin()

    def _changed(self, message):
        for transform in message.transforms:
            self.buffer.set_transform(transform, "default_authority")

    def _stays(self, message):
        for transform in message.transforms:
            self.buffer.set_transform_static(transform, "default_authority")
