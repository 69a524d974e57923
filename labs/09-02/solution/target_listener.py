"""Says where the target is as the camera sees it."""

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, TransformException, TransformListener


def multiply(p, q):
    """Return the product of two quaternions x, y, z, w."""
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


class TargetListener(Node):
    """Answers each target with a known transform."""

    def __init__(self):
        super().__init__("target_listener")
        self.camera_frame = self.declare_parameter("camera_frame", "camera_link").value
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.publisher = self.create_publisher(PoseStamped, "/target_in_camera", 10)
        self.create_subscription(PoseStamped, "/target", self.on_target, 10)

    def on_target(self, target):
        """Publish where a target is, if the transform at its time is known."""
        stamp = Time.from_msg(target.header.stamp)
        try:
            # The arm has moved since the target was seen, so that the latest transform would be another.
            found = self.buffer.lookup_transform(self.camera_frame, "base_link", stamp).transform
        except TransformException as problem:
            self.get_logger().info(f"left out: {problem}", throttle_duration_sec=1.0)
            return
        q = (found.rotation.x, found.rotation.y, found.rotation.z, found.rotation.w)
        back = (-q[0], -q[1], -q[2], q[3])
        p, o = target.pose.position, target.pose.orientation
        turned = multiply(multiply(q, (p.x, p.y, p.z, 0.0)), back)
        answer = PoseStamped()
        answer.header.stamp = target.header.stamp
        answer.header.frame_id = self.camera_frame
        answer.pose.position.x = turned[0] + found.translation.x
        answer.pose.position.y = turned[1] + found.translation.y
        answer.pose.position.z = turned[2] + found.translation.z
        seen = multiply(q, (o.x, o.y, o.z, o.w))
        orientation = answer.pose.orientation
        orientation.x, orientation.y, orientation.z, orientation.w = seen
        self.publisher.publish(answer)


def main():
    """Spin until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(TargetListener())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
