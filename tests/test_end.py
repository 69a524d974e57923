"""The end of the command: nothing is lost although Python does not take its modules apart."""

from __future__ import annotations

import subprocess
import sys

_END = """\
import atexit, sys, threading, time
from grader import cli

{before}
cli._status_of = lambda arguments: print("printed") or 3
status = cli.main()
print("here", status)
"""


def ended(before: str = "") -> subprocess.CompletedProcess[str]:
    """Run a command that prints a line and ends with 3."""
    command = [sys.executable, "-I", "-c", _END.format(before=before)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_process_ends_with_its_output_and_status() -> None:
    """Output to a pipe is buffered, and written at the end."""
    told = ended()
    assert (told.stdout, told.returncode, told.stderr) == ("printed\n", 3, "")


def test_functions_for_the_end_run() -> None:
    """Libraries register functions for the end of a process, with output of their own."""
    told = ended('atexit.register(print, "left")')
    assert (told.stdout, told.returncode) == ("printed\nleft\n", 3)


def test_other_threads_come_to_their_end() -> None:
    """A thread at work finishes, as at Python's own end."""
    told = ended('threading.Timer(0.3, print, ["late"]).start()')
    assert told.stdout == "printed\nhere 3\nlate\n"


def test_a_closed_output_is_reported_as_by_python() -> None:
    """Output that cannot be written ends with Python's message and status."""
    told = ended("import os; os.close(1)")
    assert told.returncode == 120
    assert "Bad file descriptor" in told.stderr


def test_arguments_of_a_caller_end_nothing() -> None:
    """A test, for example, goes on after a command."""
    program = "from grader import cli; print(cli.main(['help', 'nonsense']))"
    command = [sys.executable, "-I", "-c", program]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.stdout == "2\n"
