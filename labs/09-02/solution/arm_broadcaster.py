"""Broadcasts the frames of the arm, computed from its joint states."""

import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from tf2_ros import TransformBroadcaster

# Child, parent, where it lies there, its joint, and the axis about which that turns.
LINKS = [
    ("turret_link", "base_link", (0.0, 0.0, 0.20), "turret_joint", "z"),
    ("upper_arm_link", "turret_link", (0.05, 0.0, 0.15), "shoulder_joint", "y"),
    ("forearm_link", "upper_arm_link", (0.0, 0.0, 0.40), "elbow_joint", "y"),
]


class ArmBroadcaster(Node):
    """Sends three transforms for each message that holds all the arm's joints."""

    def __init__(self):
        super().__init__("arm_broadcaster")
        self.broadcaster = TransformBroadcaster(self)
        self.create_subscription(JointState, "/joint_states", self.on_joints, 10)

    def on_joints(self, message):
        """Broadcast the transforms that follow from joint states."""
        angles = dict(zip(message.name, message.position, strict=False))
        # Some messages are of the gripper alone.
        if not all(joint in angles for _, _, _, joint, _ in LINKS):
            return
        self.broadcaster.sendTransform([self.transform(link, angles, message.header.stamp) for link in LINKS])

    def transform(self, link, angles, stamp):
        """Return the transform of a link."""
        child, parent, (x, y, z), joint, axis = link
        sent = TransformStamped()
        # Time of the measurement of the joints, not of its broadcast.
        sent.header.stamp = stamp
        sent.header.frame_id = parent
        sent.child_frame_id = child
        sent.transform.translation.x = x
        sent.transform.translation.y = y
        sent.transform.translation.z = z
        setattr(sent.transform.rotation, axis, math.sin(angles[joint] / 2))
        sent.transform.rotation.w = math.cos(angles[joint] / 2)
        return sent


def main():
    """Spin until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(ArmBroadcaster())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
