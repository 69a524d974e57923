#!/usr/bin/env python3
# Lab 09-01, part 2: subscriber
# Alice M.

from collections import deque

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, HistoryPolicy
from std_msgs.msg import Float64MultiArray


class JointStateSubscriber(Node):
    """Compares commands and states and keeps a history of the tracking error."""

    def __init__(self):
        super().__init__('joint_state_subscriber')

        qos = QoSProfile(
            reliability=ReliabilityPolicy.RELIABLE,
            history=HistoryPolicy.KEEP_LAST,
            depth=10,
        )

        self.latest_command = None
        # deque throws away the oldest entry by itself when it is full
        self.error_history = deque(maxlen=1000)

        self.create_subscription(Float64MultiArray, '/joint_commands', self.command_callback, qos)
        self.create_subscription(Float64MultiArray, '/joint_states', self.state_callback, qos)

    def command_callback(self, msg):
        self.latest_command = np.array(msg.data)

    def state_callback(self, msg):
        # no command yet => nothing to compare
        if self.latest_command is None:
            return

        state = np.array(msg.data)
        error = self.latest_command - state
        self.error_history.append(error)

        rms = np.sqrt(np.mean(error ** 2))
        self.get_logger().info(f'RMS tracking error: {rms:.4f} rad')

    def get_statistics(self):
        """Mean, max and RMS of the error for every joint."""
        if len(self.error_history) < 10:
            return None

        errors = np.array(self.error_history)
        return {
            'mean': np.mean(errors, axis=0),
            'max': np.max(np.abs(errors), axis=0),
            'rms': np.sqrt(np.mean(errors ** 2, axis=0)),
        }


def main(args=None):
    rclpy.init(args=args)
    node = JointStateSubscriber()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        stats = node.get_statistics()
        if stats:
            print('Error Statistics:')
            print(f"Mean: {stats['mean']}")
            print(f"Max: {stats['max']}")
            print(f"RMS: {stats['rms']}")
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == '__main__':
    main()
