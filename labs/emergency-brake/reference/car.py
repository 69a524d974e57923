"""A car on a straight line, with a laser scanner and odometry."""

import math
import sys
import time
from dataclasses import dataclass

import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from grader.reference_node import reference_node, run, sleep_until

STEP_HZ = 50
RAYS = 181
#: Every so many rays nothing comes back.
HOLES = {7: math.inf, 11: math.nan}
LEAST_M, MOST_M = 0.06, 10.0
#: Deceleration of the brake, in m/s².
BRAKE = 5.0
HALF_ANGLE = 0.75 * math.pi


@dataclass(frozen=True)
class Settings:
    #: "wall": the car drives towards a wall in a wide room, and obeys. "harmless": it drives along a corridor, stands
    #: before a wall, and reverses, whatever it is told.
    scene: str = "wall"
    speed: float = 2.0
    wall_m: float = 6.0


@dataclass
class Car:
    x: float = 0.0
    speed: float = 0.0
    wall_x: float = math.inf
    half_width: float = 6.0
    scans: bool = True


def ranges_of(car, count):
    """Return the distance to the nearest wall on each ray."""
    found = []
    for i in range(RAYS):
        angle = -HALF_ANGLE + i * 2 * HALF_ANGLE / (RAYS - 1)
        ahead = (car.wall_x - car.x) / math.cos(angle) if math.cos(angle) > 1e-6 else math.inf
        aside = car.half_width / abs(math.sin(angle)) if abs(math.sin(angle)) > 1e-6 else math.inf
        distance = min(ahead, aside)
        for every, value in HOLES.items():
            if (i + count) % every == 0 and i != RAYS // 2:
                distance = value
        found.append(math.inf if distance > MOST_M else distance)
    return found


def drive_to_a_wall(car, t_s, settings, is_braking):
    """Drive on at full speed, or brake; a car that has reached the wall stands."""
    car.wall_x = settings.wall_m
    if is_braking:
        car.speed = max(0.0, car.speed - BRAKE / STEP_HZ)
    elif t_s < 1 / STEP_HZ:
        car.speed = settings.speed
    car.x += car.speed / STEP_HZ
    if car.x >= car.wall_x:
        car.x, car.speed = car.wall_x, 0.0


def drive_harmlessly(car, t_s, settings, is_braking):
    """Drive along a corridor, stand 0.3 m before a wall, reverse from it; between these no scans come."""
    car.half_width = 1.5
    car.scans = not (3.0 <= t_s < 3.4 or 5.0 <= t_s < 5.4)
    if t_s < 3.0:
        car.speed, car.wall_x = settings.speed, math.inf
    elif t_s < 5.0:
        car.speed, car.wall_x = 0.0, car.x + 0.3
    else:
        car.speed = -1.0
    car.x += car.speed / STEP_HZ


SCENES = {"wall": drive_to_a_wall, "harmless": drive_harmlessly}


def play(configuration, settings, stop):
    with reference_node("car") as reference:
        is_braking = False

        def hear(command):
            nonlocal is_braking
            if command.drive.speed == 0.0:
                is_braking = True

        node = reference.node
        quality = rclpy.qos.qos_profile_sensor_data
        node.create_subscription(AckermannDriveStamped, configuration.name("/drive"), hear, quality)
        scans = reference.open_publisher(LaserScan, configuration.name("/scan"), 10)
        odometry = reference.open_publisher(Odometry, configuration.name("/ego_racecar/odom"), 10)
        print("ready", flush=True)
        reference.wait_until_recorded(stop, timeout_s=5)
        car, start_ns, count = Car(), time.monotonic_ns(), 0
        while not stop:
            rclpy.spin_once(node, timeout_sec=0)
            SCENES[settings.scene](car, count / STEP_HZ, settings, is_braking)
            stamp = node.get_clock().now().to_msg()
            odometry.publish(odometry_of(car, stamp))
            # Two scans in five steps, 20 a second.
            if car.scans and count % 5 in (1, 3):
                scans.publish(scan_of(car, stamp, count))
            count += 1
            sleep_until(start_ns + round(count / STEP_HZ * 1e9), stop)


def odometry_of(car, stamp):
    message = Odometry()
    message.header.stamp, message.header.frame_id = stamp, "map"
    message.child_frame_id = "ego_racecar/base_link"
    message.pose.pose.position.x = car.x
    message.pose.pose.orientation.w = 1.0
    message.twist.twist.linear.x = car.speed
    return message


def scan_of(car, stamp, count):
    message = LaserScan()
    message.header.stamp, message.header.frame_id = stamp, "ego_racecar/laser"
    message.angle_min, message.angle_max = -HALF_ANGLE, HALF_ANGLE
    message.angle_increment = 2 * HALF_ANGLE / (RAYS - 1)
    message.scan_time = 0.05
    message.range_min, message.range_max = LEAST_M, MOST_M
    message.ranges = ranges_of(car, count)
    return message


sys.exit(run(Settings, play))
