"""Removal of temporary folders of ended gradings, and of no others."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from confine.scratch import remove_stale, remove_tree, scratch_prefix

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")

_LEAVES_ONE = """
import tempfile
from confine.scratch import scratch_prefix
print(tempfile.mkdtemp(prefix=scratch_prefix()), flush=True)
input()
"""


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a temporary folder of the test's own."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_what_a_killed_process_left_is_removed(temporary: Path) -> None:
    """A folder stays while its process lives, with all that is in it, and goes after a kill -9."""
    process = subprocess.Popen(
        [sys.executable, "-c", _LEAVES_ONE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )
    with process:
        assert process.stdout is not None
        folder = Path(process.stdout.readline().strip())
        (folder / "deep").mkdir()
        (folder / "deep" / "file").write_text("x")
        assert remove_stale() == []
        assert folder.parent == temporary
        process.kill()
    assert remove_stale() == [folder.name]
    assert not folder.exists()


def test_a_number_that_was_given_again_is_another_process(temporary: Path) -> None:
    """A folder of an earlier process with the number of one that lives is removed."""
    mine = Path(tempfile.mkdtemp(prefix=scratch_prefix()))
    words = mine.name.split("-")
    earlier = temporary / "-".join([*words[:3], str(int(words[3]) - 1), *words[4:]])
    earlier.mkdir()
    assert remove_stale() == [earlier.name]
    assert mine.is_dir()


@pytest.mark.parametrize(
    "name", ["confine-", "confine-stage-x", "confine-1-2", "other-1-99999999-1-x"]
)
def test_folders_of_others_stay(temporary: Path, name: str) -> None:
    """Folders with names of another form stay untouched."""
    (temporary / name).mkdir()
    assert remove_stale() == []
    assert (temporary / name).is_dir()


def test_another_namespace_stays(temporary: Path) -> None:
    """A folder of another container stays, because its process cannot be seen from here."""
    words = scratch_prefix().split("-")
    folder = temporary / "-".join([words[0], str(int(words[1]) + 1), "99999999", "1", "x"])
    folder.mkdir()
    assert remove_stale() == []
    assert folder.is_dir()


def test_links_are_not_followed(temporary: Path) -> None:
    """A link under the name of a folder that is left, which anybody may make, costs nobody a file."""
    words = scratch_prefix().split("-")
    victim = temporary / "victim"
    victim.mkdir()
    (victim / "file").write_text("x")
    link = temporary / "-".join([words[0], words[1], "99999999", "1", "x"])
    link.symlink_to(victim)
    assert remove_stale() == []
    assert (victim / "file").is_file()


@pytest.mark.skipif(not shutil.which("rm"), reason="coreutils remove what Python cannot")
def test_folders_deeper_than_python_follows_are_removed(tmp_path: Path) -> None:
    """Thousands of nested folders are removed, even if one is closed to its owner.

    The targets of links stay.
    """
    kept = tmp_path / "kept"
    kept.mkdir()
    folder = tmp_path / "scratch"
    folder.mkdir()
    (folder / "link").symlink_to(kept)
    here = os.open(folder, os.O_RDONLY)
    for number in range(3000):
        os.mkdir("d", dir_fd=here)
        inner = os.open("d", os.O_RDONLY, dir_fd=here)
        if number == 2000:
            os.fchmod(inner, 0o500)
            os.close(inner)
            break
        os.close(here)
        here = inner
    os.close(here)
    remove_tree(folder)
    assert not folder.exists()
    assert kept.is_dir()
