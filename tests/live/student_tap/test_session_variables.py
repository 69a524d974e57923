"""A student's program has the session's domain and RMW, whatever its code asks for."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from grader.evidence.session_variables import PREFIXES
from grader.live.sandbox.environment import INSIDE_FOLDER
from grader.live.student_tap.claims import claims_in
from grader.recording.session import SESSION_VARIABLE

pytestmark = pytest.mark.live

VALUES = {"ROS_DOMAIN_ID": "5", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
PROGRAM = """
import os
os.environ["RMW_IMPLEMENTATION"] = "rmw_cyclonedds_cpp"
import rclpy
from rclpy.node import Node
os.environ["ROS_DOMAIN_ID"] = "30"
rclpy.init(domain_id=42)
node = Node("far")
print(node.context.get_domain_id(), rclpy.get_rmw_implementation_identifier())
print(os.environ["ROS_DOMAIN_ID"])
rclpy.shutdown()
rclpy.init(domain_id=5)
print(Node("near").context.get_domain_id())
"""


def test_a_program_keeps_the_sessions_domain_and_rmw(tmp_path: Path) -> None:
    """Each other value is noted with its line; the session's own value is no wish for another one."""
    program = tmp_path / "far.py"
    program.write_text(PROGRAM)
    read, write = os.pipe()
    variables = {
        **os.environ,
        **VALUES,
        "PYTHONPATH": str(INSIDE_FOLDER),
        "GRADER_TAP_FD": str(write),
        "GRADER_SESSION_VARIABLES": json.dumps({"prefixes": PREFIXES, "values": VALUES}),
    }
    try:
        run = subprocess.run(
            [sys.executable, str(program)],
            env=variables,
            pass_fds=[write],
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        os.close(write)
    with os.fdopen(read, encoding="utf-8") as notes:
        claims = claims_in(notes.read(), "far", f"{tmp_path}/")
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == "5 rmw_fastrtps_cpp\n5\n5\n"
    asked = [(c.name, c.value, c.file, c.line) for c in claims if c.kind == SESSION_VARIABLE]
    assert asked == [
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp", "far.py", 4),
        ("ROS_DOMAIN_ID", "30", "far.py", 7),
        ("ROS_DOMAIN_ID", "42", "far.py", 7),
    ]
