"""Measures a topic's rate by the documented method of `ros2 topic hz`.

The program subscribes with the sensor-data profile, notes the time in each callback, and prints the inverse of the mean
interval over the last 10,000 messages. Arguments: "busy" or "idle".
"""

import json
import sys
import time
from collections import deque

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float64MultiArray

from bench.programs.publisher import TOPIC
from bench.programs.work import PERIOD_S, end_of_input, work

_WINDOW = 10_000


def main() -> None:
    """Measure until standard input ends."""
    rclpy.init()
    node = rclpy.create_node("bench_rate")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    times_s: deque[float] = deque(maxlen=_WINDOW + 1)
    node.create_subscription(
        Float64MultiArray,
        TOPIC,
        lambda message: times_s.append(time.monotonic()),
        qos_profile_sensor_data,
    )
    if sys.argv[1] == "busy":
        node.create_timer(PERIOD_S, work)
    ended = end_of_input()
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rate_hz = (len(times_s) - 1) / (times_s[-1] - times_s[0]) if len(times_s) > 1 else 0.0
    print(json.dumps({"recorded": len(times_s), "rate_hz": rate_hz}))


if __name__ == "__main__":
    main()
