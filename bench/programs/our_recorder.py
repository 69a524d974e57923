"""Records the topic as a session's director does, and prints the number of messages and their rate.

Arguments: "busy" or "idle".
"""

import json
import os
import sys
import tempfile
from pathlib import Path

from bench.programs.publisher import TOPIC
from bench.programs.work import until_told
from grader.evidence.timing import timing_of
from grader.live.ros_node.recorder import Recorder
from grader.recording.session import Endpoint
from ros_bag.qos import Qos
from ros_bag.reading import Bag
from ros_bag.writing import BagWriter


def main() -> None:
    """Record until standard input ends."""
    with tempfile.TemporaryDirectory(prefix="bench-bag-") as scratch:
        folder = Path(scratch) / "bag"
        recorder = Recorder(BagWriter(folder, "bench"), int(os.environ["ROS_DOMAIN_ID"]))
        offered = Qos("reliable", "volatile")
        recorder.follow(
            [Endpoint("publisher", TOPIC, "std_msgs/msg/Float64MultiArray", "", "/x", "", offered)]
        )
        until_told(sys.argv[1] == "busy")
        recorder.stop()
        stream = Bag.open(folder).stream(TOPIC)
        timing = timing_of(stream, None)
    rate_hz = timing.rate_hz if timing is not None else 0.0
    print(json.dumps({"recorded": len(set(stream.sequence.tolist())), "rate_hz": rate_hz}))


if __name__ == "__main__":
    main()
