"""Brakes before the car hits an obstacle that its laser scanner sees."""

import numpy as np
import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import LaserScan

#: Time to collision below which the car brakes, in s.
THRESHOLD_S = 1.0


class SafetyNode(Node):
    """Hears scans and odometry, and publishes a command to brake when a collision is near."""

    def __init__(self):
        super().__init__("safety_node")
        self.speed = 0.0
        self.drive = self.create_publisher(AckermannDriveStamped, "/drive", 10)
        self.create_subscription(Odometry, "/ego_racecar/odom", self.on_odometry, 10)
        self.create_subscription(LaserScan, "/scan", self.on_scan, 10)

    def on_odometry(self, message):
        """Keep the speed of the car."""
        self.speed = message.twist.twist.linear.x

    def on_scan(self, scan):
        """Brake if the range of a ray would shrink to zero within the threshold."""
        ranges = np.array(scan.ranges)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        shrinks = self.speed * np.cos(angles)
        is_known = np.isfinite(ranges) & (shrinks > 0.0)
        if np.any(ranges[is_known] < THRESHOLD_S * shrinks[is_known]):
            command = AckermannDriveStamped()
            command.header.stamp = scan.header.stamp
            command.drive.speed = 0.0
            self.drive.publish(command)


def main():
    try:
        with rclpy.init():
            rclpy.spin(SafetyNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
