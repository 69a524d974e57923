"""An action server that looks at some scans."""

import math
import threading

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from scan_interfaces.action import Sweep
from sensor_msgs.msg import LaserScan


class SweepServer(Node):
    def __init__(self):
        super().__init__("sweep_server")
        self.arrived = threading.Condition()
        self.nearest = []
        group = ReentrantCallbackGroup()
        self.create_subscription(
            LaserScan, "/scan_filtered", self.on_scan, qos_profile_sensor_data, callback_group=group
        )
        self.server = ActionServer(
            self,
            Sweep,
            "/sweep",
            self.execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT if goal.scans > 0 else GoalResponse.REJECT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def on_scan(self, scan):
        with self.arrived:
            self.nearest.append(min(scan.ranges))
            self.arrived.notify_all()

    def execute(self, handle):
        result = Sweep.Result(minimum=math.inf)
        feedback = Sweep.Feedback()
        with self.arrived:
            seen = len(self.nearest)
        while result.counted < handle.request.scans:
            with self.arrived:
                self.arrived.wait_for(lambda: len(self.nearest) > seen, timeout=0.1)
                new = self.nearest[seen:]
            seen += len(new)
            if handle.is_cancel_requested:
                handle.canceled()
                return result
            for distance in new[: handle.request.scans - result.counted]:
                result.counted += 1
                result.minimum = min(result.minimum, distance)
                feedback.counted, feedback.minimum = result.counted, result.minimum
                handle.publish_feedback(feedback)
        handle.succeed()
        return result


def main():
    rclpy.init()
    node = SweepServer()
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
