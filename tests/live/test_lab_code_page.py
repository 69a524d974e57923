"""The reference nodes that the page "Code of a lab" shows, run as they stand there."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.documentation import ROOT, blocks

pytestmark = pytest.mark.live


@pytest.mark.parametrize(
    ("name", "names", "published"),
    [
        ("beacon.py", '{"/count": "/counts"}', ["/counts", "std_msgs/msg/Int64"]),
        ("robot.py", "{}", ["/odom", "nav_msgs/msg/Odometry"]),
    ],
)
def test_the_examples_of_reference_nodes_do_what_is_asked_of_one(
    name: str, names: str, published: list[str], tmp_path: Path
) -> None:
    """An example of a reference node prints its name and that it is ready.

    It publishes under the student's name, and at SIGINT prints its publications.
    """
    (block,) = (block for block in blocks(ROOT / "docs/lab-code.md") if block.title == name)
    (tmp_path / name).write_text(block.text, encoding="utf-8")
    command = [sys.executable, str(tmp_path / name), f'{{"seed": 1, "names": {names}}}']
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as node:
        assert node.stdout is not None
        first = [node.stdout.readline().split()[0] for _ in range(2)]
        # Without a recorder it waits for five seconds, and publishes then.
        time.sleep(6)
        node.send_signal(signal.SIGINT)
        last = node.stdout.read().split()
    assert (first, node.returncode) == (["participant", "ready"], 0)
    assert last[:3] == ["published", *published]
    assert len(last[3]) > 12
