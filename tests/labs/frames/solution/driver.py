"""Broadcasts the frames of a robot that drives a circle."""

import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster


def transform(stamp, parent, child, xyz, yaw):
    """Make a message."""
    message = TransformStamped()
    message.header.stamp = stamp
    message.header.frame_id = parent
    message.child_frame_id = child
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = xyz
    rotation.z, rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


class Driver(Node):
    """Sends where the robot is, 30 times a second, and once where its laser is."""

    def __init__(self):
        """Send what is static, and start the timer."""
        super().__init__("driver")
        self.moving = TransformBroadcaster(self)
        self.static = StaticTransformBroadcaster(self)
        now = self.get_clock().now().to_msg()
        self.static.sendTransform(
            transform(now, "base_link", "laser", (0.2, 0.0, 0.3), math.radians(45.0))
        )
        self.create_timer(1 / 30, self.drive)

    def drive(self):
        """Send where the robot is."""
        now = self.get_clock().now()
        angle = 2 * math.pi * (now.nanoseconds / 1e9 % 20.0) / 20.0
        xyz = (2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.0)
        self.moving.sendTransform(
            transform(now.to_msg(), "odom", "base_link", xyz, angle + math.pi / 2)
        )


def main():
    """Run the node."""
    rclpy.init()
    try:
        rclpy.spin(Driver())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
