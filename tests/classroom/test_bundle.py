"""Folders as bytes: the same files come out that went in, and nothing else."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path

import pytest

from grader.classroom.cluster import packed, unpack
from grader.classroom.fingerprint import files_below


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder."""
    found = {}
    for path in folder.rglob("*"):
        if path.is_file():
            found[path.relative_to(folder).as_posix()] = path.read_bytes()
    return found


def test_a_folder_there_and_back(tmp_path: Path) -> None:
    """All files come out with their bytes, whatever they are called."""
    origin, target = tmp_path / "origin", tmp_path / "target"
    names = ["a.py", "deep/er/b.bin", "häuser und ödland.md", "日本.txt", "x" * 200, "-rf", "empty"]
    for number, name in enumerate(names):
        (origin / name).parent.mkdir(parents=True, exist_ok=True)
        (origin / name).write_bytes(bytes([number]) * number * 1000)
    target.mkdir()
    unpack(packed(dict(files_below(origin))), target)
    assert contents(target) == contents(origin)


def test_chosen_files_under_other_names(tmp_path: Path) -> None:
    """Files come out under the names that they were given."""
    (tmp_path / "one").write_text("1")
    target = tmp_path / "target"
    unpack(packed({"lab/first": tmp_path / "one"}), target)
    assert contents(target) == {"lab/first": b"1"}


def member(name: str, kind: bytes = tarfile.REGTYPE, linked: str = "") -> bytes:
    """Return an archive of one member."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        info = tarfile.TarInfo(name)
        info.type, info.linkname = kind, linked
        archive.addfile(info)
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        member("../outside"),
        member("a/../../outside"),
        member("/tmp/outside"),
        member("link", tarfile.SYMTYPE, "/etc"),
        member("link", tarfile.LNKTYPE, "../outside"),
        member("pipe", tarfile.FIFOTYPE),
        member("folder", tarfile.DIRTYPE),
    ],
    ids=["above", "above by way of a folder", "absolute", "link", "hard link", "pipe", "folder"],
)
def test_nothing_but_files_below_the_folder(tmp_path: Path, content: bytes) -> None:
    """A name that leads out of the folder, a link, or anything that is no file is refused."""
    target = tmp_path / "target"
    target.mkdir()
    with pytest.raises(ValueError, match="cannot be part of a bundle"):
        unpack(content, target)
    assert [path.name for path in tmp_path.iterdir()] == ["target"]
    assert list(target.iterdir()) == []
