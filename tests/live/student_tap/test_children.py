"""Claims of processes that a student's program starts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.live.small_lab import TEXT, record_one

pytestmark = pytest.mark.live

_TALKER = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

def talk():
    rclpy.init()
    node = Node("talker")
    node.create_publisher(String, "/chatter", 7)
    rclpy.spin(node)
"""
_SPAWNS = """
import multiprocessing
if __name__ == "__main__":
    child = multiprocessing.get_context("spawn").Process(target=talk, daemon=True)
    child.start()
    child.join()
"""
_STARTS = """
import subprocess, sys
if len(sys.argv) > 1 and sys.argv[-1] == "talk":
    talk()
else:
    subprocess.run([sys.executable, __file__, "talk"])
"""


@pytest.mark.parametrize("start", [_SPAWNS, _STARTS], ids=["multiprocessing", "subprocess"])
def test_claims_of_a_child_process_are_noted(start: str, tmp_path: Path) -> None:
    """The history of its publisher is known although a child process of Python makes it."""
    steps: list[dict[str, Any]] = [
        {"wait_for": {"publisher": "/chatter", "type": TEXT, "timeout_s": 20}},
        {"observe": {"duration_s": 0.2}},
    ]
    recorded = record_one(tmp_path, _TALKER + start, steps)
    claims = recorded.claims_of("publisher", "/chatter")
    assert [(claim.process, claim.qos.depth) for claim in claims if claim.qos] == [("node", 7)]
    assert recorded.record.problems == []
