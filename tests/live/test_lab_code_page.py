"""The reference node that the page "Code of a lab" shows, run as it stands there."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.documentation import ROOT, blocks

pytestmark = pytest.mark.live


def test_the_example_of_a_reference_node_does_what_is_asked_of_one(tmp_path: Path) -> None:
    """It says who it is and that it is ready, publishes under the student's name, and says at SIGINT what it was."""
    (block,) = (block for block in blocks(ROOT / "docs/lab-code.md") if block.title == "beacon.py")
    (tmp_path / "beacon.py").write_text(block.text, encoding="utf-8")
    configuration = '{"seed": 1, "names": {"/count": "/counts"}, "with": {"rate_hz": 50}}'
    command = [sys.executable, str(tmp_path / "beacon.py"), configuration]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as beacon:
        assert beacon.stdout is not None
        first = [beacon.stdout.readline().split()[0] for _ in range(2)]
        beacon.send_signal(signal.SIGINT)
        last = beacon.stdout.read().split()
    assert (first, beacon.returncode) == (["participant", "ready"], 0)
    assert last[:3] == ["published", "/counts", "std_msgs/msg/Int64"]
