"""A robot with two driven wheels as a ROS 2 node: moves as `/cmd_vel` says, publishes `/odom`."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass

from grader.reference_node import Configuration, StopRequest, reference_node, run, sleep_until


@dataclass(frozen=True)
class RobotSettings:
    """Settings that the rubric may choose."""

    rate_hz: float = 20.0


def play(configuration: Configuration, settings: RobotSettings, stop: StopRequest) -> None:
    """Step the robot at its rate until a stop is requested."""
    with reference_node("robot") as reference:
        from geometry_msgs.msg import Twist
        from nav_msgs.msg import Odometry

        command = Twist()

        def hear(message: Twist) -> None:
            nonlocal command
            command = message

        subscription = reference.node.create_subscription(
            Twist, configuration.name("/cmd_vel"), hear, 10
        )
        states = reference.open_publisher(Odometry, configuration.name("/odom"), 10)
        print("ready", flush=True)
        reference.wait_until_recorded(stop, 5.0)
        x = y = yaw = 0.0
        start_ns, count, substeps = time.monotonic_ns(), 0, 10
        while not stop:
            for substep in range(substeps):
                at_s = (count + substep / substeps) / settings.rate_hz
                sleep_until(start_ns + round(at_s * 1e9), stop)
                with subscription.handle:
                    while (taken := subscription.handle.take_message(Twist, False)) is not None:
                        hear(taken[0])
                step_s = 1 / settings.rate_hz / substeps
                yaw += command.angular.z * step_s
                x += command.linear.x * math.cos(yaw) * step_s
                y += command.linear.x * math.sin(yaw) * step_s
            state = Odometry(child_frame_id="base_link")
            state.header.frame_id = "odom"
            state.header.stamp = reference.node.get_clock().now().to_msg()
            state.pose.pose.position.x, state.pose.pose.position.y = x, y
            state.pose.pose.orientation.z, state.pose.pose.orientation.w = (
                math.sin(yaw / 2),
                math.cos(yaw / 2),
            )
            states.publish(state)
            count += 1


if __name__ == "__main__":
    sys.exit(run(RobotSettings, play))
