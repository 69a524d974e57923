"""Says where the laser is mounted."""

import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros import StaticTransformBroadcaster


class LaserFrame(Node):
    def __init__(self):
        super().__init__("laser_frame")
        self.broadcaster = StaticTransformBroadcaster(self)
        transform = TransformStamped()
        transform.header.stamp = self.get_clock().now().to_msg()
        transform.header.frame_id = "base_link"
        transform.child_frame_id = "laser"
        transform.transform.translation.x = 0.18
        transform.transform.translation.z = 0.12
        transform.transform.rotation.z = math.sin(math.radians(30) / 2)
        transform.transform.rotation.w = math.cos(math.radians(30) / 2)
        self.broadcaster.sendTransform(transform)


def main():
    rclpy.init()
    node = LaserFrame()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
