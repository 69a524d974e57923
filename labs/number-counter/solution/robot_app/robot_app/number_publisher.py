"""Publishes the number of a parameter."""

import rclpy
from example_interfaces.msg import Int64
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

PERIOD_S = 0.2


class NumberPublisher(Node):
    """Publishes `/number`, five times a second."""

    def __init__(self):
        super().__init__("number_publisher")
        self.declare_parameter("number", 2)
        self.numbers = self.create_publisher(Int64, "number", 10)
        self.create_timer(PERIOD_S, self.send)

    def send(self):
        """Publish the number that the parameter has now."""
        self.numbers.publish(Int64(data=self.get_parameter("number").value))


def main():
    try:
        with rclpy.init():
            rclpy.spin(NumberPublisher())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
