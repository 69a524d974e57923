"""Broadcasts where the camera is mounted on the forearm."""

import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import StaticTransformBroadcaster


def quaternion(roll, pitch, yaw):
    """Return x, y, z, w of turns about the parent's fixed axes."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


class CameraMount(Node):
    """Sends the transform once; the broadcaster keeps it for nodes that start later."""

    def __init__(self):
        super().__init__("camera_mount")
        self.declare_parameter("camera_frame", "camera_link")
        self.broadcaster = StaticTransformBroadcaster(self)
        mount = TransformStamped()
        mount.header.stamp = self.get_clock().now().to_msg()
        mount.header.frame_id = "forearm_link"
        mount.child_frame_id = self.get_parameter("camera_frame").value
        translation, rotation = mount.transform.translation, mount.transform.rotation
        translation.x, translation.y, translation.z = 0.08, 0.02, 0.25
        angles = (math.radians(degrees) for degrees in (10.0, 40.0, -25.0))
        rotation.x, rotation.y, rotation.z, rotation.w = quaternion(*angles)
        self.broadcaster.sendTransform(mount)


def main():
    """Spin until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(CameraMount())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
