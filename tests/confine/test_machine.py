"""Samples of the machine: clocks read together, and the CPU time of all processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from confine.cgroup import SandboxCgroup, cgroup_parents
from confine.machine import cpu_quota, read_clocks, wait_for_calm


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


@pytest.mark.parametrize(
    ("membership", "files", "cores"),
    [
        ("0::/a/b", {"a/cpu.max": "150000 100000", "a/b/cpu.max": "max 100000"}, 1.5),
        ("0::/", {"cpu.max": "200000 100000"}, 2.0),
        ("0::/a", {"a/cpu.max": "max 100000"}, None),
        (
            "5:cpu,cpuacct:/a\n4:memory:/m\n0::/",
            {
                "cpu,cpuacct/a/cpu.cfs_quota_us": "50000",
                "cpu,cpuacct/a/cpu.cfs_period_us": "100000",
            },
            0.5,
        ),
        ("1:cpu:/", {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, None),
        ("0::/../elsewhere", {}, None),
    ],
)
def test_quota_is_the_smallest_of_all_groups_above(
    tmp_path: Path, membership: str, files: dict[str, str], cores: float | None
) -> None:
    """Both versions of control groups limit the time of cores, at any level."""
    for name, text in files.items():
        file = tmp_path / "cgroup" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{text}\n", encoding="ascii")
    (tmp_path / "membership").write_text(f"{membership}\n", encoding="utf-8")
    assert cpu_quota(tmp_path / "cgroup", tmp_path / "membership") == cores
