"""A differential drive without a watchdog: it keeps to its last command, and gives goals."""

import math
import sys
import time
from dataclasses import dataclass

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry

from grader.reference_node import reference_node, run, sleep_until

STEP_HZ = 50.0


@dataclass(frozen=True)
class Settings:
    """Where the robot stands, and where it shall go, and when."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_deg: float = 0.0
    goal_x_m: float = 2.0
    goal_y_m: float = 1.0
    goal_after_s: float = 2.0
    second_goal_after_s: float = 0.0  # 0: there is none
    second_goal_x_m: float = 0.0
    second_goal_y_m: float = 0.0
    largest_mps: float = 2.0
    largest_radps: float = 6.0


def limited(value, largest):
    """Return a command within the motors' limits; 0 if it is not a finite number."""
    return max(-largest, min(largest, value)) if math.isfinite(value) else 0.0


def play(configuration, settings, stop):
    """Move by the latest command until a stop is requested."""
    with reference_node("robot") as reference:
        speed = turning = 0.0

        def hear(command):
            nonlocal speed, turning
            speed = limited(command.linear.x, settings.largest_mps)
            turning = limited(command.angular.z, settings.largest_radps)

        reference.node.create_subscription(
            Twist, configuration.name("/cmd_vel"), hear, rclpy.qos.qos_profile_sensor_data
        )
        odometry = reference.open_publisher(Odometry, configuration.name("/odom"), 10)
        goals = reference.open_publisher(PoseStamped, configuration.name("/goal"), 10)
        print("ready", flush=True)
        reference.wait_until_recorded(stop, timeout_s=5)

        x, y, heading = settings.x_m, settings.y_m, math.radians(settings.heading_deg)
        to_give = [(settings.goal_after_s, settings.goal_x_m, settings.goal_y_m)]
        if settings.second_goal_after_s:
            to_give.append((settings.second_goal_after_s, settings.second_goal_x_m, settings.second_goal_y_m))
        start_ns, steps = time.monotonic_ns(), 0
        while not stop:
            for _ in range(10):
                rclpy.spin_once(reference.node, timeout_sec=0)
            heading += turning / STEP_HZ
            x += speed * math.cos(heading) / STEP_HZ
            y += speed * math.sin(heading) / STEP_HZ
            now = reference.node.get_clock().now().to_msg()
            message = Odometry()
            message.header.stamp = now
            message.header.frame_id, message.child_frame_id = "odom", "base_link"
            message.pose.pose.position.x, message.pose.pose.position.y = x, y
            message.pose.pose.orientation.z = math.sin(heading / 2)
            message.pose.pose.orientation.w = math.cos(heading / 2)
            message.twist.twist.linear.x, message.twist.twist.angular.z = speed, turning
            odometry.publish(message)
            if to_give and steps / STEP_HZ >= to_give[0][0]:
                _, goal_x, goal_y = to_give.pop(0)
                goal = PoseStamped()
                goal.header.stamp, goal.header.frame_id = now, "odom"
                goal.pose.position.x, goal.pose.position.y = goal_x, goal_y
                goal.pose.orientation.w = 1.0
                goals.publish(goal)
            steps += 1
            sleep_until(start_ns + round(steps / STEP_HZ * 1e9), stop)


sys.exit(run(Settings, play))
