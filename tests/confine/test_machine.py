"""Samples of the machine: clocks read together, and the CPU time of all processes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from confine.cgroup import SandboxCgroup, cgroup_parents
from confine.machine import read_clocks, wait_for_calm


def test_a_core_that_is_lost_between_two_clocks_is_no_clock_that_was_set() -> None:
    """The fastest of several readings counts."""
    steady = iter([0, 30_000_000, 30_000_000, 30_000_200])
    told = iter([1_000_000_000, 1_030_000_100])
    assert read_clocks(lambda: next(told), lambda: next(steady)) == (1_030_000_100, 1_000_000_000)


@pytest.mark.parametrize(
    ("waited_us", "most_s", "calm", "looks"),
    [
        ([0, 9000, 9000, 18000, 18000, 18100], 1.0, True, 6),
        ([None], 1.0, True, 1),
        ([*range(0, 10**6, 9000)], 0.03, False, 0),
    ],
    ids=["calm at last", "nothing tells", "never"],
)
def test_what_is_repeated_waits_for_a_calmer_machine(
    waited_us: list[int | None], most_s: float, calm: bool, looks: int
) -> None:
    """Until processes wait for cores little, where the system tells, and not for ever."""
    told = list(waited_us)
    assert wait_for_calm(most_s, 0.01, lambda: told.pop(0)) is calm
    assert not looks or len(waited_us) - len(told) == looks


UNWAITED = """
import os, signal, time
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
if os.fork() == 0:
    while time.process_time() < 0.3:
        pass
    os._exit(0)
try:
    os.wait()
except ChildProcessError:
    pass
"""


def test_a_group_counts_processes_that_nobody_waits_for() -> None:
    """The kernel counts CPU time for the group even when a parent ignores its children's ends."""
    parents = next((parents for parents in cgroup_parents() if parents.cpu is not None), None)
    if parents is None:
        pytest.skip("no control group that counts CPU time can be made here")
    group = SandboxCgroup(parents, f"test-{os.getpid()}")
    try:
        group.make()
        begun_s = os.times().children_user
        subprocess.run(group.entering([sys.executable, "-I", "-c", UNWAITED]), check=True)
        used_ns = group.cpu_ns()
        assert used_ns is not None
        assert used_ns > 0.3e9
        assert os.times().children_user - begun_s < 0.3
    finally:
        group.remove()
