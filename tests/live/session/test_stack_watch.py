"""The lines at which real programs hang, in a real session."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.hang import hang_of
from grader.evidence.recorded import Recorded
from tests.live.small_lab import SET_BOOL, make_lab

pytestmark = pytest.mark.live

SERVICE = """
import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool

class Mode(Node):
    def __init__(self):
        super().__init__('NAME')
        self.create_service(SetBool, '/NAME', self.on_request)
        self.other = self.create_client(SetBool, '/other')

    def on_request(self, request, response):
        BODY
        response.success = True
        return response

rclpy.init()
rclpy.spin(Mode())
"""
#: Name of a program -> body of its callback before the answer.
BODIES = {
    "nested": "rclpy.spin_until_future_complete(self, self.other.call_async(SetBool.Request()))",
    "call": "self.other.call(SetBool.Request())",
    "busy": "_ = [None for _ in iter(int, 1)]",
    "fine": "pass",
}
#: A publisher that handles each signal itself, and waits for a timer that nobody runs.
RATE = """
import signal
import rclpy
from std_msgs.msg import String

for number in (signal.SIGALRM, signal.SIGUSR1, signal.SIGUSR2, signal.SIGHUP):
    signal.signal(number, lambda *given: None)
rclpy.init()
node = rclpy.create_node('rate')
publisher = node.create_publisher(String, '/chatter', 10)
rate = node.create_rate(10)
while rclpy.ok():
    publisher.publish(String(data='x'))
    rate.sleep()
"""


def hang(recorded: Recorded, name: str, sources: Mapping[str, str]) -> Diagnosis | None:
    """Return where a program hangs."""
    texts = {f"{each}.py": text for each, text in sources.items()}
    stacks = [stack for stack in recorded.record.stacks if stack.process == name]
    return hang_of(stacks, list(texts), texts)


def test_the_line_that_hangs_is_named(tmp_path: Path) -> None:
    """A nested spin, a call and a busy loop in a callback, and a rate without spin; none of it for a working node."""
    sources = {
        name: SERVICE.replace("NAME", name).replace("BODY", body) for name, body in BODIES.items()
    }
    steps: list[dict[str, Any]] = [{"start": {"student": name}} for name in (*BODIES, "rate")]
    for name in BODIES:
        asked = {"service": f"/{name}", "type": SET_BOOL}
        steps.append({"wait_for": {**asked, "timeout_s": 10}})
        steps.append({"call": {**asked, "request": {"data": True}, "timeout_s": 0.5}})
    steps.append({"interrupt": {"process": "*", "timeout_s": 1}})
    sources["rate"] = RATE
    recorded = make_lab(tmp_path, sources, {"only": steps}).record()["only"]
    found = {name: hang(recorded, name, sources) for name in sources}
    kinds = {name: each.kind for name, each in found.items() if each is not None}
    assert kinds == {
        "nested": "nested-spin",
        "call": "call-in-callback",
        "busy": "callback-stays",
        "rate": "rate-without-spin",
    }
    for name in ("nested", "call", "busy"):
        each = found[name]
        assert each is not None
        assert (each.file, each.line, each.subject) == (f"{name}.py", 13, "on_request")
    assert len(recorded.record.stacks) <= 60
    assert recorded.record.problems == []
