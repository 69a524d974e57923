#!/usr/bin/env python3
"""Compare four QoS profiles side by side for ten seconds.

The node `qos_comparison` publishes the time of sending on one topic for each profile, receives it again,
and prints how many messages arrived and how late. What the numbers mean is discussed in README.md.
"""

import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray

DURATION_S = 10.0
PERIOD_S = 0.01

PROFILES = {
    # Telemetry: only the newest value counts, and a lost one is soon replaced.
    "best_effort": QoSProfile(
        reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=1
    ),
    # Nothing may be missing: the writer resends until the reader has acknowledged.
    "reliable": QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=10),
    # Cameras, lidars: fresh rather than complete, with a small buffer against short delays.
    "sensor_data": QoSProfile(
        reliability=ReliabilityPolicy.BEST_EFFORT,
        history=HistoryPolicy.KEEP_LAST,
        depth=5,
        durability=DurabilityPolicy.VOLATILE,
    ),
    # A target: the last one must arrive, also at a controller that joins late; older ones are obsolete.
    "control_command": QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    ),
}


class QoSComparison(Node):
    """Sends and receives on all profiles at once, so that they meet the same conditions."""

    def __init__(self):
        """Create a publisher and a subscription for each profile, and start the clock."""
        super().__init__("qos_comparison")
        # Not self.publishers: rclpy's Node already has a read-only property of that name.
        self.profile_publishers = {}
        self.latencies_ms = {name: [] for name in PROFILES}
        for name, profile in PROFILES.items():
            topic = f"/test_{name}"
            self.profile_publishers[name] = self.create_publisher(Float64MultiArray, topic, profile)
            self.create_subscription(Float64MultiArray, topic, self.receiver(name), profile)

        self.finished = Future()
        self.create_timer(PERIOD_S, self.publish_all)
        self.create_timer(DURATION_S, lambda: self.finished.set_result(True))
        self.started_s = time.monotonic()

    def publish_all(self):
        """Send the present time on every topic."""
        for publisher in self.profile_publishers.values():
            # Taken anew for each message; otherwise the last topic would look slower than the first.
            publisher.publish(Float64MultiArray(data=[time.time()]))

    def receiver(self, name):
        """Return the callback for profile `name`."""

        # A function that makes the callback, since a lambda in the loop would only see the last name.
        def on_message(message):
            self.latencies_ms[name].append((time.time() - message.data[0]) * 1000.0)

        return on_message

    def print_results(self):
        """Print a line for each profile."""
        # Measured, not assumed: the run is shorter if someone presses Ctrl-C.
        print(f"QoS Comparison Results ({time.monotonic() - self.started_s:.1f}s):")
        print("-" * 60)
        for name, latencies in self.latencies_ms.items():
            if latencies:
                average = sum(latencies) / len(latencies)
                summary = f"avg latency: {average:.2f}ms, max: {max(latencies):.2f}ms"
            else:
                summary = "no latency data"
            print(f"{name:20s}: {len(latencies):5d} msgs, {summary}")


def main(args=None):
    """Run the comparison once and print its results."""
    rclpy.init(args=args)
    node = QoSComparison()
    try:
        rclpy.spin_until_future_complete(node, node.finished)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # stopped early: what was measured so far is still worth printing
    finally:
        node.print_results()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
