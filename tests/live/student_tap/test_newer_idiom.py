"""An idiom of a newer ROS 2 works on this one, and is noted."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import INSIDE_FOLDER
from grader.live.student_tap.claims import claims_in
from grader.recording.session import NEWER_IDIOM

pytestmark = pytest.mark.live

PROGRAM = """
import rclpy
from rclpy.node import Node

with rclpy.init(args=None):
    node = Node("newer")
    print(rclpy.ok(), node.get_name())
print(rclpy.ok())
rclpy.init()
rclpy.shutdown()
"""


def test_a_context_manager_of_rclpy_works_and_is_noted(tmp_path: Path) -> None:
    """`with rclpy.init():` shuts down at its end; a plain call of `rclpy.init` is not noted."""
    program = tmp_path / "newer.py"
    program.write_text(PROGRAM)
    read, write = os.pipe()
    try:
        run = subprocess.run(
            [sys.executable, str(program)],
            env={**os.environ, "PYTHONPATH": str(INSIDE_FOLDER), "GRADER_TAP_FD": str(write)},
            pass_fds=[write],
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        os.close(write)
    with os.fdopen(read, encoding="utf-8") as notes:
        claims = claims_in(notes.read(), "newer", f"{tmp_path}/")
    assert (run.returncode, run.stdout, run.stderr) == (0, "True newer\nFalse\n", "")
    (claim,) = [claim for claim in claims if claim.kind == NEWER_IDIOM]
    assert (claim.name, claim.file, claim.line) == ("with rclpy.init()", "newer.py", 5)
