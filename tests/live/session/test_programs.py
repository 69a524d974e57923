"""Reference nodes as a session starts them."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

pytestmark = pytest.mark.live

#: A reference node with a standard input that says when it is read.
_NODE = """
import io
import sys
from dataclasses import dataclass

from std_msgs.msg import Empty

from grader.reference_node import reference_node, run


class Input(io.StringIO):
    def readline(self):
        line = super().readline()
        print("read", line.strip(), flush=True)
        return line


@dataclass(frozen=True)
class Settings:
    pass


def play(configuration, settings, stop):
    with reference_node("beacon") as reference:
        reference.open_publisher(Empty, "/beacon", 1)
        print("opened", flush=True)


sys.stdin = Input('{"seed": 1}\\nprotected\\n')
sys.exit(run(Settings, play))
"""


def test_a_reference_node_opens_no_endpoint_before_its_name_is_protected() -> None:
    """Another program can speak in a node's name, as an RTPS packet says it, once an endpoint is known."""
    run = subprocess.run(
        [sys.executable, "-c", _NODE, "-"], capture_output=True, text=True, check=True, timeout=60
    )
    said = [line.split()[0] for line in run.stdout.splitlines()]
    assert said[:4] == ["read", "participant", "read", "opened"], run.stdout
