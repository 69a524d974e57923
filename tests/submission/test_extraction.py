"""Intake of submissions: kept files, left-out files with reasons, and refused submissions."""

from __future__ import annotations

import gzip
import io
import os
import shutil
import stat
import tarfile
import tempfile
import unicodedata
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.errors import SubmissionError
from grader.submission.extraction import (
    LIMITS,
    Intake,
    Limits,
    Piece,
    SubmissionSource,
    names_in,
    open_submission,
)
from tests.submission.hostile_archives import tar_of, zip_of

pytestmark = pytest.mark.slow

ELF = b"\x7fELF\x02\x01\x01" + bytes(64)
PROGRAM = b"import rclpy\n"


def kept(intake: Intake) -> dict[str, bytes]:
    """Give the files that were extracted; each is a regular one."""
    found = {}
    for path in intake.folder.rglob("*"):
        assert not path.is_symlink()
        if not path.is_dir():
            assert path.is_file()
            found[path.relative_to(intake.folder).as_posix()] = path.read_bytes()
    return found


def take(
    path: Path | SubmissionSource, limits: Limits = LIMITS
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Take a submission in; return its files and the left-out ones."""
    with open_submission(path, limits=limits) as intake:
        return kept(intake), intake.left_out


def lay_out(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def refused(path: Path | SubmissionSource) -> SubmissionError:
    """Give the error with which a submission is refused."""
    with pytest.raises(SubmissionError) as caught, open_submission(path):
        pass
    assert caught.value.exit_status == 3
    assert caught.value.location
    assert caught.value.remedy
    return caught.value


@pytest.fixture(params=["folder", "zip", "tar"])
def form(request: pytest.FixtureRequest) -> str:
    """Return each form of a submission."""
    return str(request.param)


def handed_in(form: str, path: Path, files: Mapping[str, bytes]) -> Path:
    """Hand files in as a folder or as an archive."""
    if form == "folder":
        return lay_out(path / "ann", files)
    archive = path / "ann.bin"  # archives are known by their contents
    archive.write_bytes(
        zip_of(files.items()) if form == "zip" else gzip.compress(tar_of(files.items()))
    )
    return archive


# -- what is kept ------------------------------------------------------------------------------------


def test_files_come_in_whatever_the_form(form: str, tmp_path: Path) -> None:
    """Sources, documents and pictures come in as they are, under their names."""
    files = {
        "README.md": b"# Lab\n",
        "src/p/joint_publisher.py": PROGRAM,
        "Größe/图.png": b"\x89PNG\r\n\x1a\n" + bytes(99),
        "report.pdf": b"%PDF-1.7",
        "report.docx": zip_of([("word/document.xml", b"<w/>")]),
        "empty.py": b"",
        "mesh.obj": b"v 0 0 0\n",
    }
    assert take(handed_in(form, tmp_path, files)) == (files, ())


def test_the_clean_folder_is_gone_afterwards(tmp_path: Path) -> None:
    """Nothing of a submission stays, also not of one that is refused."""
    prefix = f"{uuid.uuid4().hex}-"
    with open_submission(lay_out(tmp_path / "ann", {"a.py": b""}), prefix=prefix) as intake:
        assert intake.source.name == "ann"
        assert intake.folder.is_dir()
    (tmp_path / "bad.zip").write_bytes(zip_of([("a.py", PROGRAM)])[:-10])
    with pytest.raises(SubmissionError), open_submission(tmp_path / "bad.zip", prefix=prefix):
        pass
    assert not list(Path(tempfile.gettempdir()).glob(f"{prefix}*"))


@pytest.mark.parametrize(
    "name", ["alice.zip", "alice.tar.gz", "alice.TGZ", "alice.tar.xz", "alice"]
)
def test_an_archive_has_the_name_of_its_file(tmp_path: Path, name: str) -> None:
    """The suffix is no part of the name, and says nothing of the contents."""
    (tmp_path / name).write_bytes(zip_of([("a.py", PROGRAM)]))
    with open_submission(tmp_path / name) as intake:
        assert (intake.source.name, list(kept(intake))) == ("alice", ["a.py"])


def test_a_single_file_is_a_submission(tmp_path: Path) -> None:
    """A file that is no archive is handed in as it is."""
    (tmp_path / "node.py").write_bytes(PROGRAM)
    assert take(tmp_path / "node.py") == ({"node.py": PROGRAM}, ())


def test_what_changes_meanwhile_does_not_matter(tmp_path: Path) -> None:
    """The clean folder is a copy."""
    folder = lay_out(tmp_path / "ann", {"a.py": b"1"})
    with open_submission(folder) as intake:
        (folder / "a.py").write_bytes(b"2")
        assert kept(intake) == {"a.py": b"1"}


def test_pieces_make_one_submission(tmp_path: Path) -> None:
    """Loose files come in under the names that they are given, and parts of an archive under theirs."""
    lay_out(
        tmp_path,
        {
            "ann_1_2_a-1.py": b"1",
            "big.zip": zip_of([("ann/b.py", b"2"), ("bob/b.py", b"3"), ("c", b"4")]),
        },
    )
    pieces = (
        Piece(tmp_path / "ann_1_2_a-1.py", name="a.py"),
        Piece(tmp_path / "big.zip", "ann/"),
        Piece(tmp_path / "big.zip", "c", "c.md"),
    )
    assert take(SubmissionSource("ann", pieces, location="here")) == (
        {"a.py": b"1", "b.py": b"2", "c.md": b"4"},
        (),
    )


def test_the_time_is_that_of_the_newest_file_that_came_in(tmp_path: Path) -> None:
    """Files that are left out do not count, and no file tells when a submission was handed in."""
    members = []
    for day, name in enumerate(["a.py", "b.py", "x.pyc", "build/c.py"], 1):
        info = tarfile.TarInfo(name)
        info.mtime = int(datetime(2026, 3, day, tzinfo=UTC).timestamp())
        members.append((info, PROGRAM))
    (tmp_path / "ann.tar").write_bytes(tar_of(members))
    with open_submission(tmp_path / "ann.tar") as intake:
        assert intake.source.newest_file == datetime(2026, 3, 2, tzinfo=UTC)
        assert intake.source.submitted_at is None
    told = datetime(2026, 4, 1, tzinfo=UTC)
    with open_submission(
        replace(SubmissionSource.of(tmp_path / "ann.tar"), submitted_at=told)
    ) as intake:
        assert intake.source.submitted_at == told
    with open_submission(lay_out(tmp_path / "ann", {"a.py": b""})) as intake:
        assert intake.source.submitted_at is None


# -- what is left out --------------------------------------------------------------------------------


def test_compiled_code_is_left_out(form: str, tmp_path: Path) -> None:
    """Compiled files are recognised by name or by first bytes."""
    compiled = {
        "mod.cpython-311-x86_64-linux-gnu.so": b"",
        "cache.pyc": b"",
        "tool.exe": b"",
        "publisher": ELF,
        "photo.png": ELF,
        "node.py": b"MZ\x90\x00",
    }
    files, left_out = take(
        handed_in(form, tmp_path, {**compiled, "MZ.md": b"MZ is how programs begin."})
    )
    assert list(files) == ["MZ.md"]
    assert sorted(left_out) == sorted(f"{name}: compiled code" for name in compiled)


def test_what_tools_made_is_left_out_in_a_line_each(form: str, tmp_path: Path) -> None:
    """Folders of tools are named once, and litter of file managers is not even named."""
    made = [
        "build/a.py",
        "build/b.py",
        "ws/install/lib/a.py",
        ".git/HEAD",
        "e/lib/site-packages/rclpy/a.py",
    ]
    litter = [".DS_Store", "src/Thumbs.db", "src/._node.py"]
    files, left_out = take(
        handed_in(form, tmp_path, dict.fromkeys([*made, *litter, "src/node.py"], PROGRAM))
    )
    assert list(files) == ["src/node.py"]
    folders = [".git/", "build/", "e/lib/site-packages/", "ws/install/"]
    assert sorted(left_out) == [f"{folder}: made by a tool" for folder in folders]


def test_links_are_left_out_and_never_followed(tmp_path: Path) -> None:
    """Links to other files and to folders, also to themselves and to nowhere, are listed."""
    secret = lay_out(tmp_path, {"secret.py": b"secret"}) / "secret.py"
    folder = lay_out(tmp_path / "ann", {"a.py": b"1"})
    targets = {
        "file.py": secret,
        "folder": tmp_path,
        "loop": folder / "loop",
        "self": folder,
        "gone": tmp_path / "no",
    }
    for name, target in targets.items():
        (folder / name).symlink_to(target)
    files, left_out = take(folder)
    assert files == {"a.py": b"1"}
    assert sorted(left_out) == sorted(f"{name}: a symbolic link" for name in targets)


@pytest.mark.parametrize("form", ["folder", "tar", "zip"])
def test_a_link_to_a_file_of_the_submission_is_a_copy_of_it(form: str, tmp_path: Path) -> None:
    """Links by relative paths are followed within the submission, also to another link, and never above it."""
    folder = lay_out(tmp_path / "ann", {"nodes/a.py": b"1", "pkg/b.py": b"2"})
    inside = {"pkg/a.py": "../nodes/a.py", "pkg/again.py": "a.py", "b.py": "pkg/../pkg/b.py"}
    outside = {"pkg/up.py": "../../ann/pkg/b.py", "whole": "pkg", "pkg/loop.py": "loop.py"}
    for name, target in {**inside, **outside}.items():
        (folder / name).symlink_to(target)
    (tmp_path / "b.py").write_bytes(b"secret")
    files, left_out = take(packed_with_links(form, folder))
    wanted = {"nodes/a.py": b"1", "pkg/a.py": b"1", "pkg/again.py": b"1"}
    assert files == wanted | {"pkg/b.py": b"2", "b.py": b"2"}
    assert sorted(left_out) == sorted(f"{name}: a symbolic link" for name in outside)


def packed_with_links(form: str, folder: Path) -> Path:
    """Pack a folder with its links; a zip by the mode of its members, as `zip --symlinks` does."""
    if form == "folder":
        return folder
    archive = folder.with_suffix(f".{form}")
    if form != "zip":
        with tarfile.open(archive, "w") as tar:
            for path in sorted(folder.iterdir()):
                tar.add(path, path.name)
        return archive
    with zipfile.ZipFile(archive, "w") as packed:
        for path in sorted(folder.rglob("*")):
            info = zipfile.ZipInfo(path.relative_to(folder).as_posix())
            if path.is_symlink():
                info.external_attr = (stat.S_IFLNK | 0o777) << 16
                packed.writestr(info, str(path.readlink()))
            elif path.is_file():
                packed.writestr(info, path.read_bytes())
    return archive


def test_links_in_a_tar_lead_nowhere(tmp_path: Path) -> None:
    """A file below a link to a folder elsewhere lands in a folder of its own."""
    link, hard = tarfile.TarInfo("out"), tarfile.TarInfo("hard.py")
    link.type, link.linkname, hard.type, hard.linkname = (
        tarfile.SYMTYPE,
        str(tmp_path),
        tarfile.LNKTYPE,
        "a.py",
    )
    (tmp_path / "ann.tar").write_bytes(
        tar_of([("a.py", b"1"), (link, b""), ("out/b.py", b"2"), (hard, b"")])
    )
    files, left_out = take(tmp_path / "ann.tar")
    assert files == {"a.py": b"1", "out/b.py": b"2"}
    assert left_out == ("hard.py: a hard link", "out: a symbolic link")
    assert not (tmp_path / "b.py").exists()


def test_a_given_path_may_be_a_link(tmp_path: Path) -> None:
    """The path of a submission may be a link; the submission has the name of the target."""
    lay_out(tmp_path / "ann", {"a.py": b"1"})
    (tmp_path / "latest").symlink_to(tmp_path / "ann")
    with open_submission(tmp_path / "latest") as intake:
        assert (intake.source.name, list(kept(intake))) == ("ann", ["a.py"])


def test_special_files_are_never_opened(tmp_path: Path) -> None:
    """Opening a named pipe or socket would block, and a huge sparse file is not read."""
    import socket

    folder = lay_out(tmp_path / "ann", {"a.py": b"1"})
    os.mkfifo(folder / "pipe.py")
    with socket.socket(socket.AF_UNIX) as listener, (folder / "sparse.bin").open("wb") as sparse:
        here = Path.cwd()
        os.chdir(folder)
        listener.bind("socket.py")
        os.chdir(here)
        sparse.truncate(10 * 1024**4)
        files, left_out = take(folder)
    assert files == {"a.py": b"1"}
    assert left_out == (
        "pipe.py: not a regular file",
        "socket.py: not a regular file",
        "sparse.bin: larger than 8 MiB",
    )


@pytest.mark.usefixtures("plain_user")
def test_what_may_not_be_read_is_left_out() -> None:
    """A file or folder without permission is listed and does not end the grading; without any, it is refused."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = lay_out(Path(scratch, "ann"), {"a.py": b"1", "b.py": b"2", "src/c.py": b"3"})
        (folder / "b.py").chmod(0)
        (folder / "src").chmod(0)
        assert take(folder) == (
            {"a.py": b"1"},
            ("b.py: not readable", "src: a folder that is not readable"),
        )
        folder.chmod(0)
        assert "may not be read" in refused(folder).problem
        for path in (folder, folder / "src"):
            path.chmod(0o700)


def test_names_that_lead_outside_are_left_out(tmp_path: Path) -> None:
    """Nothing is written beside the clean folder, whatever the archive says."""
    names = ["../up.py", "a/../../up.py", "/tmp/abs.py", "C:\\abs.py", "..\\up.py", "ok.py"]
    for archive in (
        zip_of([(name, b"x") for name in names]),
        tar_of([(name, b"x") for name in names]),
    ):
        (tmp_path / "ann").write_bytes(archive)
        with open_submission(tmp_path / "ann") as intake:
            assert list(kept(intake)) == ["ok.py"]
            assert len(intake.left_out) == 5
            assert not list(intake.folder.parent.rglob("up.py"))
        assert not Path("/tmp/abs.py").exists()


def test_hostile_names_are_cleaned_and_reported(tmp_path: Path) -> None:
    """A name with characters that steer a screen is kept without them; folders written the Windows way are folders."""
    names = ["src\\p\\node.py", "gpj.\u202eyp.exe.md", "a\x1b[2Jb.py", "dots. ."]
    (tmp_path / "ann").write_bytes(zip_of([(name, PROGRAM) for name in names]))
    files, left_out = take(tmp_path / "ann")
    assert sorted(files) == ["a[2Jb.py", "dots", "gpj.yp.exe.md", "src/p/node.py"]
    assert len(left_out) == 3
    assert all(line.isprintable() and "used, without" in line for line in left_out)
    folder = tmp_path / "bob"
    folder.mkdir()
    (folder / os.fsdecode(b"caf\xe9.py")).write_bytes(b"1")
    assert list(take(folder)[0]) == ["café.py"]


def test_names_that_collide_on_other_systems(tmp_path: Path) -> None:
    """Among names that differ only in case or letter form, the first is kept.

    The others are listed.
    """
    names = [
        "Node.py",
        "node.py",
        "größe.py",
        unicodedata.normalize("NFD", "größe.py"),
        "SRC/a.py",
        "src/b.py",
    ]
    (tmp_path / "ann").write_bytes(tar_of([(name, name.encode()) for name in names]))
    files, left_out = take(tmp_path / "ann")
    assert sorted(files) == ["Node.py", "SRC/a.py", "größe.py", "src/b.py"]
    assert files["größe.py"] == "größe.py".encode()
    assert [line.split(": ")[1].split()[:3] for line in left_out] == [
        ["its", "name", "differs"]
    ] * 2


def test_of_one_name_the_last_counts(tmp_path: Path) -> None:
    """As with tar and unzip, a later file of the same name replaces the earlier one; that is told."""
    for archive in (tar_of([("a.py", b"1"), ("a.py", b"22")]), zip_of([("a.py", b"1")])):
        (tmp_path / "ann").write_bytes(archive)
        files, left_out = take(tmp_path / "ann")
        if b"22" in archive:
            assert (files, left_out) == (
                {"a.py": b"22"},
                ("a.py: an earlier file of the same name",),
            )
    with zipfile.ZipFile(tmp_path / "ann", "w") as twice:
        twice.writestr("a.py", b"1")
        with pytest.warns(UserWarning, match="Duplicate"):
            twice.writestr("a.py", b"22")
    assert take(tmp_path / "ann")[0] == {"a.py": b"22"}


def test_a_file_in_a_folders_place_is_left_out(tmp_path: Path) -> None:
    """A path cannot be both a file and a folder; the first entry is kept."""
    members = [("a", b"1"), ("a/b.py", b"2"), ("c/d.py", b"3"), ("c", b"4")]
    (tmp_path / "ann").write_bytes(tar_of(members))
    files, left_out = take(tmp_path / "ann")
    assert files == {"a": b"1", "c/d.py": b"3"}
    assert left_out == (
        "a/b.py: a file where another has a folder",
        "c: a file where another has a folder",
    )


# -- archives within ---------------------------------------------------------------------------------


def test_an_archive_within_an_archive_is_unpacked(form: str, tmp_path: Path) -> None:
    """A single archive beside documents is unpacked, up to two levels deep."""
    inner = zip_of([("lab/node.py", PROGRAM)])
    files = {"lab.zip": inner, "report.pdf": b"%PDF", "README.md": b"#"}
    assert take(handed_in(form, tmp_path, files)) == (
        {"lab/node.py": PROGRAM, "report.pdf": b"%PDF", "README.md": b"#"},
        (),
    )
    twice = {"lab.tar.gz": gzip.compress(tar_of([("lab.zip", inner)]))}
    shutil.rmtree(tmp_path)
    tmp_path.mkdir()
    assert take(handed_in(form, tmp_path, twice))[0] == {"lab/node.py": PROGRAM}


def test_other_archives_are_left_out(form: str, tmp_path: Path) -> None:
    """Beside programs, or beside another archive, none is unpacked; a disguise does not help."""
    inner = zip_of([("evil.py", b"1")])
    files = {"node.py": PROGRAM, "old.zip": inner, "hidden.py": inner, "data": gzip.compress(b"x")}
    kept_files, left_out = take(handed_in(form, tmp_path, files))
    assert list(kept_files) == ["node.py"]
    assert sorted(left_out) == [
        f"{name}: an archive within the submission" for name in ("data", "hidden.py", "old.zip")
    ]


def test_of_several_archives_none_is_chosen(form: str, tmp_path: Path) -> None:
    """Where nothing but archives was handed in, the refusal says that it is not known which of them counts."""
    files = {name: zip_of([("node.py", PROGRAM)]) for name in ("lab.zip", "lab (1).zip")}
    assert (
        "one of several; it is not clear which" in refused(handed_in(form, tmp_path, files)).remedy
    )


def test_archives_without_end_end(tmp_path: Path) -> None:
    """Archives nested without end are left out at the third level."""
    packed = zip_of([("node.py", PROGRAM)])
    for _ in range(4):
        packed = zip_of([("again.zip", packed)])
    (tmp_path / "ann.zip").write_bytes(packed)
    assert "an archive within the submission" in refused(tmp_path / "ann.zip").remedy


# -- limits ------------------------------------------------------------------------------------------


def test_large_files_are_left_out(form: str, tmp_path: Path) -> None:
    """A file above the limit is listed, one at the limit comes in."""
    limits = replace(LIMITS, file_bytes=100_000)
    files = {"bag.mcap": os.urandom(100_001), "node.py": os.urandom(100_000)}
    kept_files, left_out = take(handed_in(form, tmp_path, files), limits)
    assert list(kept_files) == ["node.py"]
    assert left_out == ("bag.mcap: larger than 0 MiB",)


def test_data_does_not_crowd_out_sources(form: str, tmp_path: Path) -> None:
    """Sources have room of their own, in number and in size, wherever in the order they come."""
    pictures = {f"data/{number:03}.png": bytes(100) for number in range(30)}
    sources = {f"src/{number:03}.py": b"x" * 100 for number in range(20)}
    for limits in (replace(LIMITS, files=20), replace(LIMITS, other_bytes=2000, source_bytes=2000)):
        files, left_out = take(handed_in(form, tmp_path, {**pictures, **sources}), limits)
        assert set(sources) <= set(files)
        assert (len(files), len(left_out)) == (40, 10)


def test_more_than_anyone_hands_in_is_refused(form: str, tmp_path: Path) -> None:
    """A submission of too many files is refused as a whole, since which of them count nobody knows."""
    path = handed_in(form, tmp_path, {f"{number:03}.py": b"" for number in range(100)})
    with (
        pytest.raises(SubmissionError, match="more than 50 files"),
        open_submission(path, limits=replace(LIMITS, members=50)),
    ):
        pass


def test_deep_folders_are_left_out(form: str, tmp_path: Path) -> None:
    """Folders within each other are entered up to a depth."""
    deep = "/".join(["d"] * 21)
    path = handed_in(form, tmp_path, {f"{deep}/a.py": b"", f"{deep[2:]}/b.py": b""})
    files, left_out = take(path)
    assert list(files) == [f"{deep[2:]}/b.py"]
    assert len(left_out) == 1
    assert left_out[0].endswith("too many folders deep")


def test_a_folder_of_endless_depth_is_taken_in(tmp_path: Path) -> None:
    """Thousands of folders within each other end nothing."""
    folder = lay_out(tmp_path / "ann", {"a.py": b"1"})
    here = Path.cwd()
    os.chdir(folder)
    try:
        for _ in range(2000):
            Path("deep").mkdir()
            os.chdir("deep")
        assert take(folder)[0] == {"a.py": b"1"}
        for _ in range(2000):  # too deep for the removal of temporary folders
            os.chdir("..")
            Path("deep").rmdir()
    finally:
        os.chdir(here)


def test_thousands_that_are_left_out_are_grouped(form: str, tmp_path: Path) -> None:
    """The list stays short for its reader.

    It counts further files by reason, and keeps rare ones.
    """
    files = dict.fromkeys(
        [f"{number:04}.pyc" for number in range(1284)] + ["build/x.py", "z.zip", "node.py"], PROGRAM
    )
    _, left_out = take(handed_in(form, tmp_path, {**files, "z.zip": zip_of([])}))
    assert len(left_out) == 13
    rare = {
        "build/: made by a tool",
        "and 1,274 more: compiled code",
        "z.zip: an archive within the submission",
    }
    assert rare <= set(left_out)


# -- what is refused ---------------------------------------------------------------------------------


def test_a_path_that_is_not_there(tmp_path: Path) -> None:
    """A misspelt path is answered with folders and archives that are there."""
    lay_out(tmp_path, {"ann/a.py": b"", "bob.zip": b"", "notes.txt": b""})
    error = refused(tmp_path / "anne")
    assert error.problem == "there is no such submission"
    assert error.remedy.endswith("there is: ann.")
    assert refused(tmp_path / "x/y/z").remedy == "Check the path."
    assert "bob.zip" in refused(tmp_path / "zzzzzzzzz").remedy


def test_what_is_neither_folder_nor_file(tmp_path: Path) -> None:
    """A pipe, a device, a link to itself and a path that is too long end soon, and with a remedy."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path / "loop", tmp_path / ("x" * 300)):
        refused(path)


def test_nothing_is_no_submission(tmp_path: Path) -> None:
    """An empty submission is refused, and one with only left-out files, which are named."""
    (tmp_path / "ann/src").mkdir(parents=True)
    (tmp_path / "zip").write_bytes(zip_of([]))
    (tmp_path / "tar").write_bytes(gzip.compress(tar_of([])))
    for name in ("ann", "zip"):
        assert refused(tmp_path / name).problem == "the submission is empty"
    (tmp_path / "ann/src/a.pyc").touch()
    assert "src/a.pyc: compiled code" in refused(tmp_path / "ann").remedy
    assert (
        refused(SubmissionSource("ann", (), location="Canvas")).problem == "the submission is empty"
    )


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (zip_of([("a.py", PROGRAM * 100)])[:-30], "damaged"),
        (gzip.compress(tar_of([("a.py", os.urandom(9999))]))[:5000], "damaged"),
        (b"7z\xbc\xaf\x27\x1c" + bytes(100), "7z"),
        (b"Rar!\x1a\x07\x01\x00" + bytes(100), "rar"),
        (gzip.compress(b"no tar at all"), "damaged"),
    ],
    ids=["half a zip", "half a tar", "7z", "rar", "no tar"],
)
def test_archives_that_cannot_be_read(tmp_path: Path, content: bytes, problem: str) -> None:
    """Damage and unsupported formats are named, also within another archive."""
    (tmp_path / "ann.zip").write_bytes(content)
    assert problem in refused(tmp_path / "ann.zip").problem
    (tmp_path / "outer.zip").write_bytes(zip_of([("lab.zip", content)]))
    assert problem in refused(tmp_path / "outer.zip").problem


def test_a_password_is_reported(tmp_path: Path) -> None:
    """A zip with a password is refused, with a remedy."""
    packed = bytearray(zip_of([("a.py", PROGRAM)]))
    for at in (6, packed.index(b"PK\x01\x02") + 8):
        packed[at] |= 1
    (tmp_path / "ann.zip").write_bytes(packed)
    error = refused(tmp_path / "ann.zip")
    assert "password" in error.problem
    assert "without" in error.remedy


# -- anything ----------------------------------------------------------------------------------------

NAME = st.text(st.sampled_from("ab./\\ \u202e\u0308üÄ:\0\udce9"), max_size=12)
MEMBERS = st.lists(st.tuples(NAME, st.binary(max_size=20)), max_size=12)


def safely_taken(path: Path) -> None:
    """Take any submission in.

    Check that its files are regular, inside, and named in printable text.
    """
    try:
        with open_submission(path) as intake:
            atomic_replacement = {p.name for p in intake.folder.parent.iterdir()} - {"submission"}
            assert all(name.startswith(("partial", "archive-")) for name in atomic_replacement)
            for name in kept(intake):
                assert name.isprintable()
                name.encode("utf-8")
            assert all(line.isprintable() for line in intake.left_out)
            assert len(intake.left_out) <= 12 * 2
    except SubmissionError:
        assert refused(path).problem.isprintable()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(members=MEMBERS)
def test_any_tar_comes_in_safely(members: Sequence[tuple[str, bytes]], tmp_path: Path) -> None:
    """Whatever names a tar has, nothing leaves the clean folder."""
    (tmp_path / "any").write_bytes(tar_of(members, tarfile.GNU_FORMAT))
    safely_taken(tmp_path / "any")


@pytest.mark.filterwarnings("ignore:Duplicate name")
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    members=MEMBERS,
    damage=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=4),
)
def test_any_zip_comes_in_safely(
    members: Sequence[tuple[str, bytes]], damage: Sequence[tuple[int, int]], tmp_path: Path
) -> None:
    """Whatever names a zip has, and whatever has happened to it, nothing leaves the clean folder."""
    packed = bytearray(
        zip_of(
            [
                (name.replace("\udce9", "").split("\0")[0] or "-", content)
                for name, content in members
            ]
        )
    )
    for at, value in damage:
        packed[at % len(packed)] = value
    (tmp_path / "any").write_bytes(packed)
    safely_taken(tmp_path / "any")


def test_names_in_an_archive(tmp_path: Path) -> None:
    """Names are listed in the form for asking for a part; other files give none."""
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as archive:
        for name, kind in (("./ann", tarfile.DIRTYPE), ("./ann\\a.py", tarfile.REGTYPE)):
            info = tarfile.TarInfo(name)
            info.type = kind
            archive.addfile(info)
    lay_out(
        tmp_path, {"a.tar": file.getvalue(), "b.zip": b"no zip", "c.zip": zip_of([("x", b"")])[:-9]}
    )
    assert names_in(tmp_path / "a.tar") == ["ann/", "ann/a.py"]
    assert [names_in(tmp_path / name) for name in ("b.zip", "c.zip", "none.zip", "")] == [None] * 4


def test_folders_have_a_bound(tmp_path: Path) -> None:
    """Files that need more folders than a session's disk has room for are left out, and those beside them are not."""
    lay_out(
        tmp_path / "s",
        {"a/b/one.py": PROGRAM, "a/b/two.py": PROGRAM, "c/d/three.py": PROGRAM, "main.py": PROGRAM},
    )
    files, left_out = take(tmp_path / "s", Limits(folders=3))
    assert sorted(files) == ["a/b/one.py", "a/b/two.py", "main.py"]
    assert left_out == ("c/d/three.py: more than 3 folders",)
