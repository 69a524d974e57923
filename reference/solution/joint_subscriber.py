#!/usr/bin/env python3
"""Compare what the arm was told with what it does.

The node `joint_state_subscriber` listens to `/joint_commands` and `/joint_states`, logs the tracking
error of each state, and prints statistics per joint when it is stopped.
"""

from collections import deque

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray

HISTORY_LENGTH = 1000  # 10 s at 100 Hz: recent behaviour, in bounded memory
MINIMUM_SAMPLES = 10  # below this a mean says more about chance than about the arm


class JointStateSubscriber(Node):
    """Tracks the error between the latest command and each measured state."""

    def __init__(self):
        """Subscribe to both topics with the QoS that the publishers offer."""
        super().__init__("joint_state_subscriber")
        self.command = None  # no command is known until the first one arrives
        self.errors = deque(maxlen=HISTORY_LENGTH)  # drops the oldest sample by itself

        qos = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=10)
        self.create_subscription(Float64MultiArray, "/joint_commands", self.on_command, qos)
        self.create_subscription(Float64MultiArray, "/joint_states", self.on_state, qos)

    def on_command(self, message):
        """Keep the newest command; older ones no longer matter."""
        self.command = np.array(message.data)

    def on_state(self, message):
        """Record and log the error of one state."""
        # The arm may speak before the controller does; then there is nothing to compare with.
        if self.command is None:
            return
        state = np.array(message.data)
        if state.shape != self.command.shape:
            self.get_logger().warning(
                f"Ignored a state of {state.size} joints for {self.command.size} commands"
            )
            return
        error = self.command - state
        self.errors.append(error)
        rms = np.sqrt(np.mean(error**2))  # over the joints, of this one state
        self.get_logger().info(f"RMS tracking error: {rms:.4f} rad")

    def statistics(self):
        """Return mean |error|, max |error| and RMS per joint, or None while samples are too few."""
        if len(self.errors) < MINIMUM_SAMPLES:
            return None
        errors = np.array(self.errors)  # shape (samples, joints)
        # Absolute values: otherwise an error to the left would cancel one to the right.
        magnitudes = np.abs(errors)
        return {
            "Mean": magnitudes.mean(axis=0),
            "Max": magnitudes.max(axis=0),
            "RMS": np.sqrt(np.mean(errors**2, axis=0)),
        }


def print_statistics(node):
    """Print the statistics that `node` gathered to standard output."""
    # print() and not the logger: rclpy is shut down by now, and its logger with it.
    statistics = node.statistics()
    if statistics is None:
        print(f"Too few samples for statistics ({len(node.errors)} of {MINIMUM_SAMPLES})")
        return
    print("Error Statistics:")
    for name, values in statistics.items():
        print(f"{name}: {values}")


def main(args=None):
    """Run the node until it is stopped, then print the statistics."""
    rclpy.init(args=args)
    node = JointStateSubscriber()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # the ordinary ends of this node
    finally:
        print_statistics(node)
        node.destroy_node()
        rclpy.try_shutdown()  # Ctrl-C has already shut down; this does not mind


if __name__ == "__main__":
    main()
