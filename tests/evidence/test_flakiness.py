"""What correct programs meet once in a while too."""

from __future__ import annotations

import pytest

from grader.evidence.flakiness import flaky_end
from grader.recording.session import OutputLine, ProcessRun

_TRACEBACK = """\
Traceback (most recent call last):
  File "/ws/src/joint_subscriber.py", line 93, in <module>
    main()
  File "/ws/src/joint_subscriber.py", line 84, in main
    {call}
  File "{file}", line 7, in {function}
    pass
KeyboardInterrupt"""


def interrupted(file: str, function: str, call: str) -> ProcessRun:
    """Give a process that Ctrl-C ended within a function."""
    text = _TRACEBACK.format(file=file, function=function, call=call)
    lines = [OutputLine(2, "stderr", line) for line in text.splitlines()]
    return ProcessRun("subscriber", "student", [], output=lines, interrupted_ns=1, ended_by="interrupt")


@pytest.mark.parametrize(
    ("run", "is_flaky"),
    [
        (interrupted("/ws/src/joint_subscriber.py", "print_statistics", "print_statistics(node)"), True),
        (interrupted("/opt/rclpy/__init__.py", "spin", "rclpy.spin(node)"), False),
        (interrupted("/opt/rclpy/executors.py", "spin_once", "executor.spin_once()"), False),
    ],
)
def test_ctrl_c_is_to_be_expected_while_a_node_spins(run: ProcessRun, is_flaky: bool) -> None:
    """Spin ends when rclpy hears the signal; Python may raise the exception later, in what follows."""
    assert bool(flaky_end(run)) == is_flaky


def test_an_interrupt_that_nobody_sent_is_the_programs_own() -> None:
    """A program may raise the exception itself."""
    run = interrupted("/ws/src/joint_subscriber.py", "print_statistics", "print_statistics(node)")
    run.interrupted_ns = None
    assert not flaky_end(run)
