"""Where the arm, the camera and the target are: drawn by lot from the seed, and a function of the time."""

import math
import random

import numpy as np

#: Frame -> parent, where it lies there in m, its joint, the axis about which that turns.
LINKS = {
    "turret_link": ("base_link", (0.0, 0.0, 0.20), "turret_joint", (0.0, 0.0, 1.0)),
    "upper_arm_link": ("turret_link", (0.05, 0.0, 0.15), "shoulder_joint", (0.0, 1.0, 0.0)),
    "forearm_link": ("upper_arm_link", (0.0, 0.0, 0.40), "elbow_joint", (0.0, 1.0, 0.0)),
}
#: The camera in forearm_link: position in m; roll, pitch and yaw in degrees.
CAMERA_XYZ, CAMERA_RPY_DEG = (0.08, 0.02, 0.25), (10.0, 40.0, -25.0)
#: Joint -> middle and amplitude of its swing in rad, and its period in ns.
SWINGS = {
    "turret_joint": (0.3, 0.8, 6_000_000_000),
    "shoulder_joint": (0.5, 0.4, 5_000_000_000),
    "elbow_joint": (0.9, 0.5, 4_000_000_000),
}
GRIPPER = "gripper_joint"
#: The order of the joints in a message.
IN_MESSAGES = ("elbow_joint", GRIPPER, "shoulder_joint", "turret_joint")


# -- motions ---------------------------------------------------------------------------------------


def _phase(time_ns, period_ns):
    return 2 * math.pi * (int(time_ns) % period_ns) / period_ns


def angles_at(seed, time_ns):
    """Give the angle of each joint in rad."""
    chance = random.Random(seed)
    shifts = {name: chance.uniform(0, 2 * math.pi) for name in SWINGS}
    angles = {
        name: middle + amplitude * math.sin(_phase(time_ns, period_ns) + shifts[name])
        for name, (middle, amplitude, period_ns) in SWINGS.items()
    }
    return {**angles, GRIPPER: 0.02}


def target_at(seed, time_ns):
    """Give the pose of the target in base_link: on a circle before the arm, turning about itself."""
    shift = random.Random(seed + 1).uniform(0, 2 * math.pi)
    around, turned = _phase(time_ns, 7_000_000_000) + shift, _phase(time_ns, 9_000_000_000)
    position = (0.9 + 0.2 * math.cos(around), 0.3 * math.sin(around), 0.35)
    return position, product(about((0, 0, 1), turned), about((1, 0, 0), 0.6))


# -- poses: a position and a quaternion x, y, z, w -------------------------------------------------


def about(axis, angle):
    """Give the quaternion of a turn."""
    return (*(math.sin(angle / 2) * part for part in axis), math.cos(angle / 2))


def product(p, q):
    """Give the turn by q, and then by p."""
    (px, py, pz, pw), (qx, qy, qz, qw) = p, q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def within(outer, inner):
    """Return the pose of an inner frame, given within `outer`, in the parent frame of `outer`."""
    (at, turn), (x, y, z) = outer, inner[0]
    moved = product(product(turn, (x, y, z, 0.0)), (-turn[0], -turn[1], -turn[2], turn[3]))[:3]
    return tuple(a + b for a, b in zip(at, moved, strict=True)), product(turn, inner[1])


def inverse(pose):
    """Give the pose of the parent in the child."""
    (x, y, z), turn = pose
    back = (-turn[0], -turn[1], -turn[2], turn[3])
    at, _ = within(((0.0, 0.0, 0.0), back), ((-x, -y, -z), (0.0, 0.0, 0.0, 1.0)))
    return at, back


def link_at(frame, angles):
    """Give the pose of a link in its parent."""
    _, at, joint, axis = LINKS[frame]
    return at, about(axis, angles[joint])


def camera():
    """Give the pose of the camera in the link that it is mounted on."""
    roll, pitch, yaw = (
        about(axis, math.radians(a)) for axis, a in zip(np.eye(3).tolist(), CAMERA_RPY_DEG, strict=True)
    )
    return CAMERA_XYZ, product(yaw, product(pitch, roll))


def camera_in_base(angles):
    """Give the pose of the camera in base_link."""
    pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for frame in LINKS:
        pose = within(pose, link_at(frame, angles))
    return within(pose, camera())


# -- what the rubric asks --------------------------------------------------------------------------


def link(streams, parameters, seed):
    """Return a link's poses in its parent at the stamps of its transforms.

    With `late_s`, the poses of a node that stamps with the time of sending; with `by_order`, of one
    that takes joints by their place in the message.
    """
    late_ns = round(parameters.get("late_s", 0.0) * 1e9)
    rows = []
    for time_ns in parameters["times_ns"]:
        angles = angles_at(seed, int(time_ns) - late_ns)
        if parameters.get("by_order"):
            angles = {joint: angles[name] for joint, name in zip(SWINGS, IN_MESSAGES, strict=False)}
        if parameters.get("backwards"):
            angles = {joint: -angle for joint, angle in angles.items()}
        at, turn = link_at(parameters["frame"], angles)
        rows.append([*at, *turn])
    return rows


def stamps(streams, parameters, seed):
    """The stamp of each target."""
    return streams["target"].values


def latest_of(frames, time_ns):
    """The latest stamp, in ns, of the frames that were published until a time."""
    place = np.searchsorted(frames.source_ns, time_ns) - 1
    return round(float(frames.values[max(place, 0), 0]) * 1e9)


def answered(targets, answers):
    """The stamp, in s, of the target that each answer is for: the one with its stamp, or else the last before it."""
    known, own = targets.values[:, 0], answers.values[:, 0]
    alike = np.minimum(np.searchsorted(known, own - SAME_S), len(known) - 1)
    before = np.maximum(np.searchsorted(targets.source_ns, answers.source_ns) - 1, 0)
    # A stamp that was left at 0 names no target.
    named = (np.abs(known[alike] - own) < SAME_S) & (own > SAME_S)
    return known[np.where(named, alike, before)]


#: Stamps that are nearer to each other than this are the same.
SAME_S = 0.001


def seen(streams, parameters, seed):
    """The pose of each answer's target in the camera's frame, of it the position or the orientation.

    `mistake` gives known ones.
    """
    mistake, rows, times = parameters.get("mistake"), [], []
    answers = streams["answers"]
    for stamp_s, source_ns in zip(answered(streams["target"], answers), answers.source_ns, strict=True):
        stamp_ns = round(float(stamp_s) * 1e9)
        looked_ns = latest_of(streams["frames"], source_ns) if mistake == "latest" else stamp_ns
        lens, target = camera_in_base(angles_at(seed, looked_ns)), target_at(seed, stamp_ns)
        pose = within(lens if mistake == "inverse" else inverse(lens), target)
        pose = target if mistake == "unchanged" else pose
        pose = (pose[0], target[1]) if mistake == "not turned" else pose
        if mistake == "only moved":
            pose = tuple(b - a for a, b in zip(lens[0], target[0], strict=True)), target[1]
        if mistake == "only turned":
            pose = within(inverse(((0.0, 0.0, 0.0), lens[1])), target)
        if mistake == "from the right":
            pose = pose[0], product(target[1], inverse(lens)[1])
        rows.append(pose[0 if parameters["of"] == "position" else 1])
        times.append(int(source_ns))
    return {"times_ns": times, "values": rows}
