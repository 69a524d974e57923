"""Sandboxes go before other work, where the system permits it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from confine.priority import STANDING, put_standing

pytestmark = pytest.mark.live

_WAITING = [sys.executable, "-c", "import sys; sys.stdin.read()"]

# A program that raises its own priority and prints its own nice value and a child's.
_FIRST = """
import os, subprocess, sys
from confine.priority import put_self_first
put_self_first()
child = "import os; print(os.getpriority(os.PRIO_PROCESS, 0))"
print(os.getpriority(os.PRIO_PROCESS, 0), subprocess.check_output([sys.executable, "-c", child], text=True).strip())
"""


def may_raise() -> bool:
    """Return whether this process may give itself a better nice value."""
    tried = "import os; os.setpriority(os.PRIO_PROCESS, 0, -1)"
    return (
        subprocess.run([sys.executable, "-c", tried], capture_output=True, check=False).returncode
        == 0
    )


@contextmanager
def waiting() -> Iterator[int]:
    """Start a process that waits, in a session of its own; gives its id."""
    with subprocess.Popen(_WAITING, stdin=subprocess.PIPE, start_new_session=True) as process:
        yield process.pid
        process.communicate()


def nice_of(pid: int) -> int:
    """Return the nice value of a process."""
    return os.getpriority(os.PRIO_PROCESS, pid)


def test_what_stands_goes_before_what_starts() -> None:
    """A process gets another nice value once it stands where that is permitted, and keeps its own elsewhere."""
    own = nice_of(0)
    with waiting() as pid:
        assert nice_of(pid) == own
        put_standing([pid])
        assert nice_of(pid) == (STANDING if may_raise() else own)


def test_children_of_a_session_do_not_inherit_its_priority() -> None:
    """A child process of a session starts with the usual priority."""
    # In a separate session, because autogroups weigh whole sessions, and all tests share theirs.
    said = subprocess.check_output(
        [sys.executable, "-c", _FIRST], text=True, start_new_session=True
    ).split()
    assert said == [str(STANDING) if may_raise() else str(nice_of(0)), str(max(0, nice_of(0)))]


def test_a_process_that_is_gone_is_no_error() -> None:
    """A student's process may end at any moment."""
    with waiting() as pid:
        pass
    put_standing([pid])


# Goes first for a while, and tells its nice value, and the weight of its session then and afterwards.
_FOR_A_WHILE = """
import os, pathlib
from confine.priority import going_first
weight = pathlib.Path("/proc/self/autogroup")
def told(): return weight.read_text().split()[-1] if weight.exists() else "0"
before = told()
with going_first():
    print(os.getpriority(os.PRIO_PROCESS, 0), told())
print(told() == before)
"""


def test_grade_goes_first_only_while_it_runs() -> None:
    """The previous weight of the terminal's session is restored."""
    said = subprocess.check_output(
        [sys.executable, "-c", _FOR_A_WHILE], text=True, start_new_session=True
    ).split()
    weighed = str(STANDING) if may_raise() and said[1] != "0" else "0"
    assert said == [str(STANDING if may_raise() else nice_of(0)), weighed, "True"]
