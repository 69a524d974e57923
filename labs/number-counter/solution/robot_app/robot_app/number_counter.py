"""Adds up numbers, until it is told to start again."""

import rclpy
from example_interfaces.msg import Int64
from example_interfaces.srv import SetBool
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class NumberCounter(Node):
    """Hears `/number`, publishes the sum on `/number_count`, and serves `/reset_counter`."""

    def __init__(self):
        super().__init__("number_counter")
        self.total = 0
        self.sums = self.create_publisher(Int64, "number_count", 10)
        self.create_subscription(Int64, "number", self.add, 10)
        self.create_service(SetBool, "reset_counter", self.reset)

    def add(self, message):
        """Add a number, and publish the sum."""
        self.total += message.data
        self.sums.publish(Int64(data=self.total))

    def reset(self, request, response):
        """Set the sum to zero if the request holds true."""
        if request.data:
            self.total = 0
        response.success = request.data
        response.message = "The sum is zero." if request.data else "Nothing was changed."
        return response


def main():
    try:
        with rclpy.init():
            rclpy.spin(NumberCounter())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
