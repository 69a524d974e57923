"""Environments of students' processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import student_environment
from grader.live.sandbox.installation import wheels_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


def test_what_a_program_left_at_home_does_not_run_in_the_next(tmp_path: Path) -> None:
    """A student's interpreter reads no files of its user's home.

    An interpreter outside of any virtual environment does.
    """
    python = Path(
        sys.base_prefix, "bin", f"python{sys.version_info.major}.{sys.version_info.minor}"
    )
    environment = student_environment(wheels_of(python), str(tmp_path), "/ws", "/inside", 0)
    own = Path(
        tmp_path,
        ".local/lib",
        f"python{sys.version_info.major}.{sys.version_info.minor}",
        "site-packages",
    )
    own.mkdir(parents=True)
    Path(own, "left.pth").write_text("import os; os.write(1, b'it runs')\n")
    run = subprocess.run([python, "-c", "pass"], env=environment, capture_output=True, check=True)
    assert run.stdout == b""
