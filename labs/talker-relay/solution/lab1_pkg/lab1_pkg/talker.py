"""Publishes drive commands with the speed and the steering angle of two parameters."""

import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

PERIOD_S = 0.005


class Talker(Node):
    """Publishes `drive`; `v` is the speed in m/s, `d` the steering angle in rad."""

    def __init__(self):
        super().__init__("talker")
        self.declare_parameter("v", 0.0)
        self.declare_parameter("d", 0.0)
        self.drive = self.create_publisher(AckermannDriveStamped, "drive", 10)
        self.create_timer(PERIOD_S, self.send)

    def send(self):
        """Publish one command, with the values that the parameters have now."""
        command = AckermannDriveStamped()
        command.header.stamp = self.get_clock().now().to_msg()
        command.drive.speed = self.get_parameter("v").value
        command.drive.steering_angle = self.get_parameter("d").value
        self.drive.publish(command)


def main():
    try:
        with rclpy.init():
            rclpy.spin(Talker())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
