"""Publishes at a rate, by absolute deadlines, and prints the real rate.

Arguments: rate in Hz, number of messages, number of receivers. Above 1 kHz the messages of a millisecond are sent
together, because shorter sleeps are inexact.
"""

import json
import sys
import time

import rclpy
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

TOPIC = "/bench"
_MATCH_S = 15.0
_SETTLE_S = 0.5
_LONGEST_BATCH_S = 0.001


def main() -> None:
    """Publish, then wait until the last messages have arrived."""
    rate_hz, count = float(sys.argv[1]), int(sys.argv[2])
    receivers = int(sys.argv[3])
    rclpy.init()
    node = rclpy.create_node("bench_publisher")
    publisher = node.create_publisher(Float64MultiArray, TOPIC, QoSProfile(depth=2000))
    data = serialize_message(Float64MultiArray(data=[0.5] * 7))
    end_s = time.monotonic() + _MATCH_S
    while publisher.get_subscription_count() < receivers and time.monotonic() < end_s:
        time.sleep(0.01)
    time.sleep(_SETTLE_S)
    batch = max(1, round(rate_hz * _LONGEST_BATCH_S))
    begun_s = time.monotonic()
    times_ns = []
    for first in range(0, count, batch):
        wait_s = begun_s + first / rate_hz - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        for _ in range(min(batch, count - first)):
            times_ns.append(time.time_ns())
            publisher.publish(data)
    took_s = (times_ns[-1] - times_ns[0]) / 1e9
    time.sleep(2 * _SETTLE_S)
    print(json.dumps({"published": count, "rate_hz": (count - 1) / took_s}))


if __name__ == "__main__":
    main()
