"""The watch over resources of students' processes, with real files and processes."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from confine.machine import available_share, processes_of_user
from confine.scratch import remove_tree
from grader.live.process import guard
from grader.live.process.guard import Guard
from grader.live.process.process import RunningProcess
from grader.recording.session import ProcessRun
from tests.live.small_lab import until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


def watched(area: Path, *, sized: bool = False) -> tuple[ProcessRun, list[str]]:
    """Look once at a sleeping process; returns its record and the reported problems."""
    record, problems = ProcessRun("it", "student", []), list[str]()

    async def look() -> None:
        running = await RunningProcess.start(
            record, [sys.executable, "-c", "import time; time.sleep(60)"], environment={}
        )
        watch = Guard(
            lambda: [running],
            None,
            {"/tmp": area},
            sized=sized,
            user=None,
            on_problem=problems.append,
        )
        await watch.look()
        await running.kill()

    asyncio.run(look())
    return record, problems


def test_who_takes_little_goes_on(tmp_path: Path) -> None:
    """A few files and folders are no limit."""
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "file").write_text("x")
    record, problems = watched(tmp_path)
    assert (record.limit, problems) == (None, [])


def test_folders_that_nobody_can_count_are_too_many(tmp_path: Path) -> None:
    """A thousand folders within each other are not followed to their end."""
    here = os.open(tmp_path, os.O_RDONLY)
    for _ in range(1000):
        os.mkdir("d", dir_fd=here)
        inner = os.open("d", os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = inner
    os.close(here)
    record, _ = watched(tmp_path)
    remove_tree(tmp_path / "d")  # which pytest could not
    assert (record.limit, record.ended_by) == ("files", "limit")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is closed to root")
def test_folders_that_are_closed_to_us_are_too_many(tmp_path: Path) -> None:
    """A closed folder counts as too many files, because it could hold anything."""
    (tmp_path / "closed").mkdir(mode=0)
    record, _ = watched(tmp_path)
    (tmp_path / "closed").chmod(0o700)
    assert record.limit == "files"


def test_where_memory_runs_out_nobody_is_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process is ended before the machine is, and the session says why it decides nothing."""
    assert 0 < available_share() <= 1
    monkeypatch.setattr(guard, "_LEAST_AVAILABLE", 1.1)
    record, problems = watched(tmp_path)
    assert (record.limit, record.ended_by) == (None, "kill")
    assert problems == ["the machine ran out of memory while it was recorded"]


def test_where_the_disk_runs_out_nobody_is_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files that are open and have no name stand in no folder: the process is ended before the disk is full."""
    monkeypatch.setattr(guard, "_LEAST_FREE", 1.1)
    record, problems = watched(tmp_path)
    assert (record.limit, record.ended_by) == (None, "kill")
    assert problems == ["the disk ran out of space while it was recorded"]


#: Leaves twenty processes behind that are below nobody's any more, then goes on.
STRAYS = "for i in $(seq 20); do (sleep 60 &); done; echo left; sleep 60"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give programs a user of their own")
def test_processes_that_got_away_count_and_end(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Stray processes of a program's user count as its own and end with it.

    This goes for programs that share process ids with others.
    """
    monkeypatch.setattr(guard, "PROCESSES", 20)
    user, record = 64290, ProcessRun("it", "student", [])

    async def look() -> None:
        command = ["setpriv", "--reuid", str(user), "--clear-groups", "sh", "-c", STRAYS]
        running = await RunningProcess.start(record, command, environment={"PATH": os.defpath})
        watch = Guard(
            lambda: [running],
            None,
            {"/tmp": tmp_path},
            sized=False,
            user=user,
            on_problem=lambda _: None,
        )
        while not record.output:
            await asyncio.sleep(0.05)
        await watch.look()
        await running.kill()

    asyncio.run(asyncio.wait_for(look(), 60))
    assert record.limit == "processes"
    until(lambda: not [pid for pid in processes_of_user(user) if lives(pid)])


def lives(pid: int) -> bool:
    """Say if a process lives; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.skipif(os.geteuid() != 0, reason="only root mounts file systems here")
def test_a_full_area_is_noted_and_a_missing_one_is_passed_over(tmp_path: Path) -> None:
    """A process beside a full file system of its own is not ended: the limit is noted."""
    record, _ = watched(tmp_path / "missing", sized=True)
    assert record.limit is None
    area = tmp_path / "area"
    area.mkdir()
    subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(area)], check=True, timeout=10
    )
    try:
        record, _ = watched(area, sized=True)
        assert record.limit is None
        with suppress(OSError):
            (area / "file").write_bytes(bytes(2**20))
        record, _ = watched(area, sized=True)
        assert (record.limit, record.ended_by) == ("disk", "kill")
    finally:
        subprocess.run(["umount", "--lazy", str(area)], check=True, timeout=10)
