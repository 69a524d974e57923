"""Records the topic in the plainest way: an executor's callback passes each message to rosbags."""

import json
import tempfile
import time
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Float64MultiArray

from bench.programs.publisher import TOPIC
from bench.programs.work import end_of_input

#: Length of the queue, equal to the other recorder's.
_DEPTH = 10_000


def main() -> None:
    """Record until standard input ends."""
    rclpy.init()
    node = rclpy.create_node("bench_recorder")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    sequences = set()
    ended = end_of_input()
    with (
        tempfile.TemporaryDirectory(prefix="bench-bag-") as scratch,
        Writer(Path(scratch) / "bag", version=9) as bag,
    ):
        store = get_typestore(Stores.ROS2_JAZZY)
        connection = bag.add_connection(TOPIC, "std_msgs/msg/Float64MultiArray", typestore=store)

        def on_message(data: bytes, info: dict[str, int]) -> None:
            sequences.add(info["publication_sequence_number"])
            bag.write(connection, time.time_ns(), data)

        node.create_subscription(
            Float64MultiArray, TOPIC, on_message, QoSProfile(depth=_DEPTH), raw=True
        )
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.1)
    print(json.dumps({"recorded": len(sequences)}))


if __name__ == "__main__":
    main()
