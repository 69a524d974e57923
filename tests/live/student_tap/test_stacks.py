"""The text of `faulthandler`, read with care; a process without the tap is not disturbed."""

from __future__ import annotations

import subprocess
import time

import pytest

from grader.live.student_tap.stacks import ALL_THREADS, ask, threads_in
from grader.recording.session import StackFrame

pytestmark = pytest.mark.live

TEXT = """\
{"kind": "started"}
  File "/nowhere.py", line 1 in before
Thread 0x00007f8 (most recent call first):
  File "/ws/src/n\\xf6de.py", line 12 in on_request
  File "/venv/rclpy/executors.py", line 310 in spin
{"kind": "timer", "name": "1"}

Current thread 0x00007f9 [python] (most recent call first):
  File "/ws/src/main.py", line 3 in <module>
  File broken
Stack (most recent call first):
"""


def test_frames_are_read_by_thread() -> None:
    """Other lines are skipped, and characters are shown as they are."""
    assert threads_in(TEXT, "/ws/src/") == [
        [
            StackFrame("nöde.py", 12, "on_request"),
            StackFrame("/venv/rclpy/executors.py", 310, "spin"),
        ],
        [StackFrame("main.py", 3, "<module>")],
    ]


def test_a_forged_answer_is_bounded() -> None:
    """Neither threads nor frames without end are kept."""
    thread = "Thread 0x1 (most recent call first):\n" + '  File "a.py", line 1 in f\n' * 500
    threads = threads_in(thread * 500, "")
    assert len(threads) <= 16
    assert max(map(len, threads)) <= 60


def test_a_process_without_the_tap_is_left_alone() -> None:
    """The signal would end a program that does not handle it."""
    with subprocess.Popen(["sleep", "20"]) as process:
        ask(process.pid, ALL_THREADS)
        time.sleep(0.1)
        assert process.poll() is None
        process.kill()
