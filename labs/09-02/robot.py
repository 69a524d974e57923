"""The robot as a ROS 2 node: joint states and a target, or in place of the student's nodes the frames themselves.

All of it is a function of the system's time and the seed, as `oracles.py` says, so that the oracles know it too.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from grader.reference_node import reference_node, run, sleep_until

#: Rates: joint states at every second of these ticks, a target at every fourth, between two joint
#: states.
TICKS_HZ, JOINTS_EVERY, TARGET_EVERY = 100, 2, 4
#: Targets come once the frames of their times have been heard.
FIRST_TARGET = 60
#: Age of a measurement at its arrival.
JOINTS_LATE_NS, TARGET_LATE_NS = 40_000_000, 100_000_000


@dataclass(frozen=True)
class Settings:
    """Messages that the node publishes."""

    joints: bool = False
    frames: bool = False
    target: bool = False


def stamp_of(time_ns):
    """Give a time as a message."""
    return Time(nanoseconds=time_ns).to_msg()


def filled(transform, parent, child, time_ns, pose):
    """Put a pose into a transform."""
    transform.header.stamp = stamp_of(time_ns)
    transform.header.frame_id, transform.child_frame_id = parent, child
    t, r = transform.transform.translation, transform.transform.rotation
    (t.x, t.y, t.z), (r.x, r.y, r.z, r.w) = pose
    return transform


def joint_state(oracles, seed, time_ns):
    """Give the joint states at a time."""
    angles = oracles.angles_at(seed, time_ns)
    message = JointState(name=list(oracles.IN_MESSAGES), position=[angles[name] for name in oracles.IN_MESSAGES])
    message.header.stamp = stamp_of(time_ns)
    return message


def links(oracles, seed, time_ns):
    """Give the transforms of all links at a time."""
    angles = oracles.angles_at(seed, time_ns)
    return TFMessage(
        transforms=[
            filled(TransformStamped(), parent, child, time_ns, oracles.link_at(child, angles))
            for child, (parent, *_) in oracles.LINKS.items()
        ]
    )


def target_pose(oracles, seed, time_ns):
    """Give the pose of the target at a time."""
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = stamp_of(time_ns), "base_link"
    p, o = message.pose.position, message.pose.orientation
    (p.x, p.y, p.z), (o.x, o.y, o.z, o.w) = oracles.target_at(seed, time_ns)
    return message


class Publishers:
    """Publishers of the messages that the settings ask for; None for all others."""

    def __init__(self, reference, configuration, settings):
        def opened(kind, name, qos=10):
            return reference.open_publisher(kind, configuration.name(name), qos)

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.joints = opened(JointState, "/joint_states") if settings.joints else None
        self.moving = opened(TFMessage, "/tf") if settings.frames else None
        self.fixed = opened(TFMessage, "/tf_static", latched) if settings.frames else None
        self.target = opened(PoseStamped, "/target") if settings.target else None


def publish_tick(publishers, oracles, seed, tick):
    """Publish the messages due at a tick."""
    now_ns = time.time_ns()
    measured_ns = now_ns - JOINTS_LATE_NS
    joints_due = tick % JOINTS_EVERY == 0
    target_due = tick > FIRST_TARGET and tick % TARGET_EVERY == 1
    if publishers.joints and joints_due:
        publishers.joints.publish(joint_state(oracles, seed, measured_ns))
    if publishers.moving and joints_due:
        publishers.moving.publish(links(oracles, seed, measured_ns))
    if publishers.target and target_due:
        publishers.target.publish(target_pose(oracles, seed, now_ns - TARGET_LATE_NS))


def play(configuration, settings, stop):
    """Publish until a stop is requested."""
    # `python -I` leaves the script's own folder off the path.
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    import oracles

    seed = configuration.seed
    with reference_node("robot") as reference:
        publishers = Publishers(reference, configuration, settings)
        print("ready", flush=True)

        def heard(publisher):
            return publisher.subscription_count > configuration.subscriptions.get(publisher.topic, 0)

        reference.wait_until_recorded(stop, 5, heard)
        if publishers.fixed:
            mount = filled(TransformStamped(), "forearm_link", "camera_link", time.time_ns(), oracles.camera())
            publishers.fixed.publish(TFMessage(transforms=[mount]))
        start_ns, tick = time.monotonic_ns(), 0
        while not stop:
            publish_tick(publishers, oracles, seed, tick)
            tick += 1
            sleep_until(start_ns + round(tick / TICKS_HZ * 1e9), stop)


if __name__ == "__main__":
    sys.exit(run(Settings, play))
