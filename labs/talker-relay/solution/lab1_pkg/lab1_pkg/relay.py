"""Passes drive commands on, with three times the speed and the steering angle."""

import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

FACTOR = 3.0


class Relay(Node):
    """Hears `drive`, and publishes `drive_relay`."""

    def __init__(self):
        super().__init__("relay")
        self.tripled = self.create_publisher(AckermannDriveStamped, "drive_relay", 10)
        self.create_subscription(AckermannDriveStamped, "drive", self.pass_on, 10)

    def pass_on(self, command):
        """Publish a command that is three times the one that came."""
        answer = AckermannDriveStamped()
        answer.header = command.header
        answer.drive.speed = FACTOR * command.drive.speed
        answer.drive.steering_angle = FACTOR * command.drive.steering_angle
        self.tripled.publish(answer)


def main():
    try:
        with rclpy.init():
            rclpy.spin(Relay())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
