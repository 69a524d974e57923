"""Drives a robot to a goal."""

import math
import time

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node

GAIN = 0.8
FASTEST = 0.4
SLOWEST = 0.0
DELAY_S = 0.0


class Controller(Node):
    """Commands a speed for each odometry message, as soon as there is a goal."""

    def __init__(self):
        super().__init__("controller")
        self.goal = None
        self.commands = self.create_publisher(Twist, "/cmd_vel", 10)
        self.create_subscription(PoseStamped, "/goal", self.on_goal, 10)
        self.create_subscription(Odometry, "/odom", self.on_odometry, 10)

    def on_goal(self, message):
        """Keep the goal."""
        self.goal = message.pose.position

    def on_odometry(self, message):
        """Turn towards the goal, and drive the slower the nearer it is."""
        if self.goal is None:
            return
        pose = message.pose.pose
        x, y = self.goal.x - pose.position.x, self.goal.y - pose.position.y
        distance = math.hypot(x, y)
        error = math.atan2(y, x) - 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        error = math.atan2(math.sin(error), math.cos(error))
        command = Twist()
        if distance >= 0.02 or SLOWEST > 0:
            command.linear.x = max(
                SLOWEST, min(FASTEST, GAIN * distance) * max(0.0, math.cos(error))
            )
            command.angular.z = max(-1.5, min(1.5, 2.0 * error))
        time.sleep(DELAY_S)
        self.commands.publish(command)


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(Controller())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
