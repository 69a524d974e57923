"""The number of cores visible to a student's program."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from grader.live.sandbox.environment import INSIDE_FOLDER

pytestmark = pytest.mark.live

# The executor is made after the process was held to a core, as where its node is seen before that.
_LATE = """
import os, posix, rclpy
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
there = len(os.sched_getaffinity(0))
posix.sched_setaffinity(0, {min(posix.sched_getaffinity(0))})
print(there, MultiThreadedExecutor()._executor._max_workers, len(posix.sched_getaffinity(0)))
"""


@pytest.mark.parametrize("allowed", [None, 1])
def test_an_executor_has_several_threads_whenever_it_is_made(allowed: int | None) -> None:
    """Neither that the grader holds the process to a core, nor a machine of one core, leaves it a single one."""
    cores = sorted(os.sched_getaffinity(0))[:allowed]
    said = subprocess.run(
        ["taskset", "-c", ",".join(map(str, cores)), sys.executable, "-c", _LATE],
        env={**os.environ, "PYTHONPATH": str(INSIDE_FOLDER)},
        capture_output=True,
        text=True,
        check=True,
    )
    there, threads, held = map(int, said.stdout.split())
    assert (there, threads, held) == (max(2, len(cores)), max(2, len(cores)), 1)
    assert "single thread" not in said.stderr
