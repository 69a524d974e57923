"""Publishes 100 times a second, as steadily as rclpy does."""

import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray


class Beat(Node):
    """The node that is heard."""

    def __init__(self):
        super().__init__("beat")
        self.publisher = self.create_publisher(Float64MultiArray, "/beat", 10)
        self.create_timer(0.01, lambda: self.publisher.publish(Float64MultiArray(data=[0.0] * 7)))


rclpy.init()
try:
    rclpy.spin(Beat())
except KeyboardInterrupt:
    pass
finally:
    rclpy.try_shutdown()
