"""The time of the last commit, read from repositories as git writes them and as attackers do."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import time
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.submission.last_commit import last_commit_time

pytestmark = pytest.mark.slow

ZONE = timezone(timedelta(hours=5, minutes=30))


def git(folder: Path, *arguments: str, at: datetime | None = None) -> str:
    """Run git in a folder, without the configuration of this machine."""
    environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "GIT_CONFIG_NOSYSTEM": "1"}
    environment |= {
        f"GIT_{who}_{what}": "ann" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    if at is not None:
        environment["GIT_AUTHOR_DATE"] = "2020-01-01T00:00:00+00:00"
        environment["GIT_COMMITTER_DATE"] = at.isoformat()
    run = subprocess.run(
        ["git", *arguments], cwd=folder, env=environment, check=True, capture_output=True, text=True
    )
    return run.stdout.strip()


def told_by_git(folder: Path) -> datetime:
    """Ask git itself."""
    return datetime.fromisoformat(git(folder, "log", "-1", "--format=%cI"))


def repository(folder: Path, commits: int = 1, *init: str) -> Path:
    """Make a repository with some commits, a day apart."""
    folder.mkdir()
    git(folder, "init", "-q", "-b", "main", *init)
    for number in range(commits):
        (folder / "node.py").write_text(f"x = {number}\n")
        git(folder, "add", ".")
        # Because of the long message, git stores commits as differences to each other.
        message = (
            "\n".join(f"line {line} of a message that hardly changes" for line in range(40))
            + f"\n{number}"
        )
        git(
            folder,
            "commit",
            "-q",
            "-m",
            message,
            at=datetime(2026, 3, 1 + number, 23, 41, 7, tzinfo=ZONE),
        )
    return folder


@pytest.mark.parametrize("init", [(), ("--object-format=sha256",)])
def test_a_new_repository(tmp_path: Path, init: tuple[str, ...]) -> None:
    """The committer's time is told with its offset, for both kinds of object names."""
    folder = repository(tmp_path / "ann", 2, *init)
    assert last_commit_time(folder) == datetime(2026, 3, 2, 23, 41, 7, tzinfo=ZONE)
    found = last_commit_time(folder)
    assert found is not None
    assert found.utcoffset() == timedelta(hours=5, minutes=30)


@pytest.mark.parametrize("init", [(), ("--object-format=sha256",)])
def test_every_commit_of_a_packed_repository(tmp_path: Path, init: tuple[str, ...]) -> None:
    """Packed references and objects are read, also those that are stored as differences to others."""
    folder = repository(tmp_path / "ann", 8, *init)
    git(folder, "gc", "-q", "--aggressive", "--prune=now")
    git(folder, "pack-refs", "--all")
    assert not (folder / ".git/refs/heads/main").exists()
    (index,) = (folder / ".git/objects/pack").glob("*.idx")
    assert any(
        len(line.split()) == 7 and " commit " in line
        for line in git(folder, "verify-pack", "-v", str(index)).splitlines()
    )
    for commit in git(folder, "rev-list", "HEAD").split():
        git(folder, "checkout", "-q", commit)
        assert last_commit_time(folder) == told_by_git(folder)


def test_commits_reported_by_the_names_of_others(tmp_path: Path) -> None:
    """The other way of storing differences is read as well."""
    folder = repository(tmp_path / "ann", 6)
    git(
        folder,
        "-c",
        "repack.useDeltaBaseOffset=false",
        "repack",
        "-adfq",
        "--window=50",
        "--depth=50",
    )
    git(folder, "prune-packed")
    for commit in git(folder, "rev-list", "HEAD").split():
        git(folder, "checkout", "-q", commit)
        assert last_commit_time(folder) == told_by_git(folder)


def test_branches_with_names_of_their_own(tmp_path: Path) -> None:
    """The branch that is checked out counts, not the newest."""
    folder = repository(tmp_path / "ann", 2)
    git(folder, "checkout", "-q", "-b", "feature/lab-09_late+1", "HEAD~1")
    assert last_commit_time(folder) == datetime(2026, 3, 1, 23, 41, 7, tzinfo=ZONE)


def test_what_is_no_repository(tmp_path: Path) -> None:
    """A folder, a repository without a commit, and one that is elsewhere have no time."""
    assert last_commit_time(tmp_path) is None
    assert last_commit_time(tmp_path / "none") is None
    assert last_commit_time(repository(tmp_path / "empty", 0)) is None
    inside = repository(tmp_path / "ann")
    for name in ("linked", "written"):
        (tmp_path / name).mkdir()
    (tmp_path / "linked/.git").symlink_to(inside / ".git")
    (tmp_path / "written/.git").write_text(f"gitdir: {inside}/.git\n")
    assert last_commit_time(tmp_path / "linked") is None
    assert last_commit_time(tmp_path / "written") is None


def test_nothing_of_a_repository_is_run(tmp_path: Path) -> None:
    """Programs that git itself would start are not: signature checks, monitors, helpers that fetch."""
    folder = repository(tmp_path / "ann")
    for setting in (
        "core.fsmonitor",
        "core.pager",
        "gpg.program",
        "core.sshCommand",
        "core.alternateRefsCommand",
    ):
        git(folder, "config", setting, f"touch {tmp_path}/ran; true")
    git(folder, "config", "log.showSignature", "true")
    for hook in ("post-checkout", "reference-transaction"):
        (folder / ".git/hooks" / hook).write_text(f"#!/bin/sh\ntouch {tmp_path}/ran\n")
        (folder / ".git/hooks" / hook).chmod(0o755)
    assert last_commit_time(folder) == datetime(2026, 3, 1, 23, 41, 7, tzinfo=ZONE)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "head",
    [
        "ref: ../../secret",
        "ref: refs/heads/../../../secret",
        "ref: refs/heads/none",
        "ref: ",
        "z" * 40,
        "0" * 40,
        "",
        "x" * 2_000_000,
    ],
)
def test_heads_that_lead_nowhere(tmp_path: Path, head: str) -> None:
    """A head that is no branch's name and no object's gives no time."""
    folder = repository(tmp_path / "ann")
    (folder / ".git/HEAD").write_text(head)
    assert last_commit_time(folder) is None


def test_special_files_do_not_block(tmp_path: Path) -> None:
    """A named pipe in the place of a file is not waited for."""
    folder = repository(tmp_path / "ann")
    for name in ("HEAD", "refs/heads/main"):
        path = folder / ".git" / name
        kept = path.read_bytes()
        path.unlink()
        os.mkfifo(path)
        assert last_commit_time(folder) is None
        path.unlink()
        path.write_bytes(kept)
    assert last_commit_time(folder) is not None


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a repository with its head stored as a difference."""
    folder = repository(tmp_path_factory.mktemp("packed") / "ann", 5)
    git(folder, "gc", "-q", "--aggressive", "--prune=now")
    git(folder, "checkout", "-q", "HEAD~4")
    return folder


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=30
)
@given(
    suffix=st.sampled_from([".idx", ".pack"]),
    changes=st.lists(
        st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=4)), min_size=1, max_size=4
    ),
)
def test_damage_ends_in_no_time(
    packed: Path, tmp_path: Path, suffix: str, changes: list[tuple[float, bytes]]
) -> None:
    """Whatever bytes are changed in a pack or its index, the answer is a time or none."""
    shutil.rmtree(tmp_path / "ann", ignore_errors=True)
    shutil.copytree(packed, tmp_path / "ann")
    (path,) = (tmp_path / "ann/.git/objects/pack").glob(f"*{suffix}")
    content = bytearray(path.read_bytes())
    for place, change in changes:
        at = int(place * (len(content) - 1))
        content[at : at + len(change)] = change
    path.chmod(0o644)
    path.write_bytes(content)
    found = last_commit_time(tmp_path / "ann")
    assert found is None or found.utcoffset() is not None


def test_a_commit_that_never_ends(tmp_path: Path) -> None:
    """An object of zeros is unpacked to a limit only."""
    import zlib

    folder = repository(tmp_path / "ann")
    name = git(folder, "rev-parse", "HEAD")
    path = folder / ".git/objects" / name[:2] / name[2:]
    path.chmod(0o644)
    path.write_bytes(zlib.compress(b"commit 1\0" + bytes(100 * 1024 * 1024)))
    assert last_commit_time(folder) is None


def test_a_folder_that_cannot_be_looked_into_has_no_commit(tmp_path: Path) -> None:
    """Whatever the system says to a path (here that its name is too long), it is no reason to stop."""
    assert last_commit_time(tmp_path / ("x" * 300)) is None


def test_a_difference_that_lies_without_end_behind(tmp_path: Path) -> None:
    """The distance to a difference's base may be a number of a megabyte. It is not computed."""
    folder = repository(tmp_path / "ann")
    name = git(folder, "rev-parse", "HEAD")
    (folder / ".git/objects" / name[:2] / name[2:]).unlink()
    fan_out = struct.pack(">256I", *(int(first >= int(name[:2], 16)) for first in range(256)))
    offset = struct.pack(">II", 0, 12)
    (folder / ".git/objects/pack/a.idx").write_bytes(
        b"\xfftOc\0\0\0\2" + fan_out + bytes.fromhex(name) + offset
    )
    (folder / ".git/objects/pack/a.pack").write_bytes(
        b"PACK" + bytes(8) + b"\x60" + b"\xff" * 1024 * 1024
    )
    began_s = time.monotonic()
    assert last_commit_time(folder) is None
    assert time.monotonic() - began_s < 12.0
