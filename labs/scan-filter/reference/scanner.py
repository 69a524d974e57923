"""A laser scanner in a room, past which a box moves."""

import math
import random
import sys
import time
from dataclasses import dataclass

from rclpy.qos import QoSProfile
from sensor_msgs.msg import LaserScan

from grader.reference_node import reference_node, run, sleep_until

RAYS = 91
LEAST, MOST = 0.125, 8.0


@dataclass(frozen=True)
class Settings:
    topic: str = "/scan"
    rate_hz: float = 20.0
    raw: bool = True  # with infinite ranges and outliers
    steady: bool = False  # the box stays near: 0.75 m at least, once in ten scans


def distance_of_box(count, settings):
    if settings.steady:
        return 0.75 + 0.05 * (count % 10)
    phase = (count / settings.rate_hz) % 6.0  # towards the robot for 3 s, and away for 3 s
    return 3.0 - 0.9 * phase if phase < 3 else 0.3 + 0.9 * (phase - 3)


def ranges_of(count, settings, chance):
    ranges = [5.0 + math.sin(0.1 * i) + chance.uniform(-0.01, 0.01) for i in range(RAYS)]
    middle = 10 + (count * 2) % (RAYS - 20)
    for i in range(middle - 4, middle + 5):
        ranges[i] = distance_of_box(count, settings) + 0.02 * abs(i - middle)
    if settings.raw:
        for i in range(60, 70):  # an open door: nothing comes back
            ranges[(i + count) % RAYS] = math.inf
        for i in chance.sample(range(2, RAYS - 2, 4), 6):
            ranges[i] = chance.choice([0.01, 0.2, 9.5, math.inf])
    return ranges


def play(configuration, settings, stop):
    with reference_node("scanner") as reference:
        # Offers more than the scanner of the handout, so that a reliable subscription, which a check charges, hears it.
        publisher = reference.open_publisher(LaserScan, configuration.name(settings.topic), QoSProfile(depth=5))
        print("ready", flush=True)
        reference.wait_until_recorded(stop, timeout_s=5)
        chance = random.Random(configuration.seed)
        start_ns, count = time.monotonic_ns(), 0
        while not stop:
            message = LaserScan()
            message.header.stamp = reference.node.get_clock().now().to_msg()
            message.header.frame_id = "laser"
            message.angle_min, message.angle_max = -math.pi / 2, math.pi / 2
            message.angle_increment = math.pi / (RAYS - 1)
            message.scan_time = 1 / settings.rate_hz
            message.range_min, message.range_max = LEAST, MOST
            message.ranges = ranges_of(count, settings, chance)
            publisher.publish(message)
            count += 1
            sleep_until(start_ns + round(count / settings.rate_hz * 1e9), stop)


sys.exit(run(Settings, play))
