"""Paths named by somebody else are found beneath their folder, or not at all."""

from __future__ import annotations

import errno
import os
import stat
import sys
import threading
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

from grader.submission.beneath import (
    copy_tree,
    is_regular_beneath,
    open_beneath,
    open_regular_beneath,
    restore_way,
)

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="students' paths are resolved on Linux alone"
)


@pytest.fixture
def top(tmp_path: Path) -> Iterator[Path]:
    """Give a folder with links in it, beside one that is none of its."""
    for folder in ("top/a/b", "outside"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "top/a/file").write_text("mine")
    (tmp_path / "outside/file").write_text("theirs")
    (tmp_path / "top/out").symlink_to(tmp_path / "outside")
    (tmp_path / "top/in").symlink_to("a")
    (tmp_path / "top/file").symlink_to("a/file")
    (tmp_path / "top/proc").symlink_to("/proc/self/cwd")
    os.mkfifo(tmp_path / "top/pipe")
    yield tmp_path / "top"
    assert [p.name for p in sorted((tmp_path / "outside").rglob("*"))] == ["file"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["outside", "top"]


ELSEWHERE = [
    "../outside/file",
    "a/../../outside/file",
    "a/../a/file",
    "/etc/passwd",
    "//etc/passwd",
    "out/file",
    "in/file",
    "file",
    "proc/pyproject.toml",
    "a\0b",
    "x" * 300,
    "a/" * 3000 + "file",
    "gone",
    "..",
    "a",
    "pipe",
]


@pytest.mark.parametrize("path", ELSEWHERE)
def test_what_leads_elsewhere_is_not_opened(top: Path, path: str) -> None:
    """Steps upwards, whole paths, links on the way or at its end, pipes and names that none can have are refused."""
    with pytest.raises(OSError):
        open_regular_beneath(top, path)
    assert not is_regular_beneath(top, path)


def test_what_lies_beneath_is_opened(top: Path) -> None:
    """A plain path is read, from a folder's path or from its descriptor, and the path that is refused is named."""
    folder = os.open(top, os.O_RDONLY)
    for above in (top, folder):
        with os.fdopen(open_regular_beneath(above, "a/file")) as file:
            assert file.read() == "mine"
    os.close(folder)
    with pytest.raises(OSError, match=r"leads outside.*\.\./outside") as refused:
        open_beneath(top, "../outside")
    assert refused.value.errno == errno.EXDEV


@pytest.mark.parametrize(
    "flags", [os.O_PATH, os.O_PATH | os.O_DIRECTORY, os.O_RDONLY, os.O_WRONLY | os.O_CREAT]
)
@pytest.mark.parametrize("path", ["out", "out/new", "in/b"])
def test_no_way_of_opening_follows_a_link(top: Path, path: str, flags: int) -> None:
    """Neither is a link's target made, nor is a descriptor got of it or of the link."""
    with pytest.raises(OSError):
        open_beneath(top, path, flags, 0o600)


@pytest.mark.parametrize(
    "way",
    ["../outside/new", "a/../../outside/new", "out/new", "out", "/new", "a/file/new", "proc/x"],
)
def test_no_folder_is_made_elsewhere(top: Path, way: str) -> None:
    """A path that leads out is refused, and folders outside keep their rights."""
    (top.parent / "outside").chmod(0o700)
    with pytest.raises(OSError):
        restore_way(top, PurePosixPath(way), 0o755)
    assert stat.S_IMODE((top.parent / "outside").stat().st_mode) == 0o700


def test_a_way_is_restored(top: Path) -> None:
    """Folders that are missing are made, and those that were closed are opened, as far as the way goes."""
    (top / "a").chmod(0o000)
    restore_way(top, PurePosixPath("a/b/c/d"), 0o755)
    assert {
        stat.S_IMODE((top / part).stat().st_mode) for part in ("a", "a/b", "a/b/c", "a/b/c/d")
    } == {0o755}


def test_a_tree_is_copied_as_it_is(top: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Files with their rights, folders and links are copied; pipes and targets of links are not."""
    (top / "a/program").write_text("x")
    (top / "a/program").chmod(0o4711)
    target = tmp_path_factory.mktemp("copy")
    copy_tree(top, target)
    assert (target / "a/file").read_text() == "mine"
    assert stat.S_IMODE((target / "a/program").stat().st_mode) == 0o755
    assert (target / "a/b").is_dir()
    assert (target / "out").readlink() == top.parent / "outside"
    assert not os.path.lexists(target / "pipe")


def test_a_tree_that_changes_meanwhile_lets_nothing_in(
    top: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A folder and a file that become links between two looks bring nothing from outside into the copy."""
    ended = threading.Event()
    moved = top.parent / "top/moved"

    def exchange() -> None:
        while not ended.is_set():
            for name, target in (("a", "outside"), ("a/file", "outside/file")):
                (top / name).rename(moved)
                (top / name).symlink_to(top.parent / target)
                (top / name).unlink()
                moved.rename(top / name)

    thread = threading.Thread(target=exchange)
    thread.start()
    try:
        for number in range(200):
            target = tmp_path_factory.mktemp(f"copy{number}")
            copy_tree(top, target)
            files = (p for p in target.rglob("*") if p.is_file() and not p.is_symlink())
            assert all(p.read_text() == "mine" for p in files)
    finally:
        ended.set()
        thread.join()
