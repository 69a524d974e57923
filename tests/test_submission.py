"""Submissions as they are handed in: found whatever their shape, refused with a remedy where there is nothing."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from grader import submission as module
from grader.errors import SubmissionError
from grader.pipeline import read_rubric
from grader.recording.submission import SubmissionRecord
from grader.rubric import Rubric
from grader.submission import decode_text, read_submission_folder

SOLUTION = Path(__file__).resolve().parents[1] / "reference/solution"
FILES = {
    "publisher": "joint_publisher.py",
    "subscriber": "joint_subscriber.py",
    "service": "robot_service.py",
    "launch": "robot_launch.py",
    "qos": "qos_comparison.py",
}


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Give a copy of the solution."""
    shutil.copytree(SOLUTION, tmp_path / "ann", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "ann"


def found(record: SubmissionRecord) -> dict[str, str | None]:
    """Give the path of each artifact."""
    return {fact.name: fact.path for fact in record.artifacts}


def test_bare_files_are_found_by_name(folder: Path, rubric: Rubric) -> None:
    """The five files under their names are the five artifacts, and their texts are kept."""
    record = read_submission_folder(folder, rubric)
    assert found(record) == FILES
    assert {fact.found_by for fact in record.artifacts} == {"name"}
    assert set(FILES.values()) <= set(record.texts)
    assert record.name == "ann"


def test_nested_files_are_found(folder: Path, rubric: Rubric, tmp_path: Path) -> None:
    """Files some folders down are found, the one nearest to the root first."""
    (tmp_path / "outer/a/b").mkdir(parents=True)
    shutil.move(folder, tmp_path / "outer/a/b/work")
    shutil.copy(SOLUTION / "joint_publisher.py", tmp_path / "outer/a/joint_publisher.py")
    record = read_submission_folder(tmp_path / "outer", rubric)
    assert found(record)["service"] == "a/b/work/robot_service.py"
    publisher = next(fact for fact in record.artifacts if fact.name == "publisher")
    assert publisher.path == "a/joint_publisher.py"
    assert publisher.candidates == ["a/b/work/joint_publisher.py"]


@pytest.mark.parametrize(
    "name", ["joint_pub.py", "JointPublisher.py", "joint-publisher.py", "joint_publisher (1).py", "joint_publisher"]
)
def test_a_similar_name_is_taken_and_told(folder: Path, rubric: Rubric, name: str) -> None:
    """A near miss of a file's name, or none of its suffix, is taken for the file."""
    (folder / "joint_publisher.py").rename(folder / name)
    fact = next(a for a in read_submission_folder(folder, rubric).artifacts if a.name == "publisher")
    assert (fact.path, fact.found_by) == (name, "near miss")


def test_contents_give_a_file_away(folder: Path, rubric: Rubric) -> None:
    """A file of quite another name is found by the words that the rubric names."""
    (folder / "robot_service.py").rename(folder / "exercise3.py")
    assert found(read_submission_folder(folder, rubric))["service"] == "exercise3.py"


def test_a_file_is_taken_for_one_artifact_only(folder: Path, rubric: Rubric) -> None:
    """A file that stands under its own name is not taken for another that is missing."""
    (folder / "joint_publisher.py").unlink()
    paths = found(read_submission_folder(folder, rubric))
    assert paths["publisher"] is None
    assert paths["subscriber"] == "joint_subscriber.py"


def test_two_missing_files_are_not_found_in_one(folder: Path, rubric: Rubric) -> None:
    """One file that is similar to two missing ones is taken once."""
    (folder / "joint_publisher.py").rename(folder / "joint_pubscriber.py")
    (folder / "joint_subscriber.py").unlink()
    paths = found(read_submission_folder(folder, rubric))
    assert (paths["publisher"], paths["subscriber"]) == ("joint_pubscriber.py", None)


def test_copies_that_tools_made_are_not_the_students(folder: Path, rubric: Rubric) -> None:
    """Files in build, install, caches and hidden tools' folders do not count."""
    for tool in ("build/p", "install/p/lib", "__pycache__", ".git", "venv/lib", "__MACOSX"):
        (folder / tool).mkdir(parents=True)
        shutil.copy(folder / "joint_publisher.py", folder / tool / "joint_publisher.py")
    record = read_submission_folder(folder, rubric)
    assert next(a for a in record.artifacts if a.name == "publisher").candidates == []
    assert not any(file.path.startswith(("build", "install", ".git")) for file in record.files)


def test_line_ends_and_byte_order_marks_make_no_difference(folder: Path, rubric: Rubric) -> None:
    """A file from another editor is read all the same."""
    path = folder / "joint_publisher.py"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    text = read_submission_folder(folder, rubric).texts["joint_publisher.py"]
    assert not text.startswith("\ufeff")
    assert "\r\n" in text


def test_text_that_is_no_utf8_is_read() -> None:
    """Latin-1 is read where UTF-8 fails."""
    assert decode_text("Größe".encode("latin-1")) == "Größe"


def test_links_are_never_followed(folder: Path, rubric: Rubric, tmp_path: Path) -> None:
    """Links to files and folders, also to themselves, are left out and listed."""
    secret = tmp_path / "secret.py"
    secret.write_text("# joint_command_publisher create_publisher")
    (folder / "joint_publisher.py").unlink()
    (folder / "joint_publisher.py").symlink_to(secret)
    (folder / "loop").symlink_to(folder)
    (folder / "up").symlink_to("/")
    record = read_submission_folder(folder, rubric)
    assert found(record)["publisher"] is None
    assert "joint_publisher.py: not a regular file" in record.left_out
    assert not any("secret" in text for text in record.texts)


def test_what_is_no_regular_file_is_left_out(folder: Path, rubric: Rubric) -> None:
    """A named pipe does not block the reader."""
    os.mkfifo(folder / "pipe.py")
    assert "pipe.py: not a regular file" in read_submission_folder(folder, rubric).left_out


def test_large_files_are_left_out(folder: Path, rubric: Rubric) -> None:
    """A file above the limit is listed, and a long text is not kept for reading."""
    with (folder / "bag.mcap").open("wb") as file:
        file.truncate(module.MAX_FILE_BYTES + 1)
    (folder / "long.md").write_text("x" * (module.MAX_TEXT_BYTES + 1))
    record = read_submission_folder(folder, rubric)
    assert "bag.mcap: larger than 8 MiB" in record.left_out
    assert "long.md" not in record.texts
    assert "long.md" in {file.path for file in record.files}


def test_too_many_files_are_cut_off(folder: Path, rubric: Rubric) -> None:
    """Only so many files are read, and the record says so."""
    (folder / "zz").mkdir()
    for number in range(module.MAX_FILES + 5):
        (folder / f"zz/{number:05}.py").touch()
    record = read_submission_folder(folder, rubric)
    assert len(record.files) == module.MAX_FILES
    assert "more than 2000 files" in record.left_out[-1]
    assert found(record) == FILES


def test_binary_files_have_no_text(folder: Path, rubric: Rubric) -> None:
    """A file with zero bytes is kept as a fact, not as text; compiled Python is left out."""
    (folder / "joint_publisher.py").write_bytes(b"\0\1\2")
    (folder / "x.pyc").write_bytes(b"\0")
    record = read_submission_folder(folder, rubric)
    assert "joint_publisher.py" not in record.texts
    assert "x.pyc: compiled Python" in record.left_out


@pytest.fixture
def plain_user() -> Iterator[None]:
    """Let the superuser be somebody who may not read everything, for a while."""
    if os.geteuid() == 0:
        os.seteuid(65534)
        yield
        os.seteuid(0)
    else:
        yield


@pytest.mark.usefixtures("plain_user")
def test_a_file_that_cannot_be_read_is_left_out(rubric: Rubric) -> None:
    """A file without permission to read is listed and does not end the grading."""
    with tempfile.TemporaryDirectory() as scratch:
        for name in ("joint_publisher.py", "robot_service.py"):
            Path(scratch, name).write_text("x = 1\n")
        Path(scratch, "joint_publisher.py").chmod(0)
        record = read_submission_folder(Path(scratch), rubric)
    assert found(record)["publisher"] is None
    assert found(record)["service"] == "robot_service.py"
    assert record.left_out == ["joint_publisher.py: not readable"]


def test_names_that_are_no_unicode_are_shown(folder: Path, rubric: Rubric) -> None:
    """A file name of bytes that are no UTF-8 does not end the grading."""
    (folder / os.fsdecode(b"caf\xe9.py")).write_text("x = 1")
    record = read_submission_folder(folder, rubric)
    assert all(file.path.isprintable() for file in record.files)


def test_the_hash_changes_with_any_file(folder: Path, rubric: Rubric) -> None:
    """Equal files give equal hashes wherever they lie, and one more byte another."""
    first = read_submission_folder(folder, rubric).sha256
    copy = folder.parent / "bob"
    shutil.copytree(folder, copy)
    os.utime(copy / "README.md", (time.time() - 1000,) * 2)
    assert read_submission_folder(copy, rubric).sha256 == first
    (copy / "README.md").write_text((copy / "README.md").read_text() + "!")
    assert read_submission_folder(copy, rubric).sha256 != first


# -- nothing to grade ------------------------------------------------------------------------------


def refused(folder: Path, rubric: Rubric) -> SubmissionError:
    """Give the error with which a folder is refused."""
    with pytest.raises(SubmissionError) as caught:
        read_submission_folder(folder, rubric)
    assert caught.value.exit_status == 3
    assert caught.value.where == str(folder)
    assert caught.value.remedy
    return caught.value


def test_a_folder_that_is_not_there_is_refused_with_its_neighbours(folder: Path, rubric: Rubric) -> None:
    """A misspelt path is answered with names that are there."""
    error = refused(folder.parent / "anne", rubric)
    assert error.problem == "there is no such submission"
    assert "ann" in error.remedy.split(": ")[-1]
    assert refused(folder.parent / "x/y/z", rubric).remedy == "Check the path."


def test_a_file_is_refused(folder: Path, rubric: Rubric) -> None:
    """An archive or a single file is no folder, and the remedy says to unpack."""
    assert "Unpack" in refused(folder / "README.md", rubric).remedy


def test_an_empty_folder_is_refused(tmp_path: Path, rubric: Rubric) -> None:
    """A folder without files, or with empty folders only, is empty."""
    (tmp_path / "ann/src").mkdir(parents=True)
    assert "empty" in refused(tmp_path / "ann", rubric).problem


def test_a_folder_of_something_else_is_refused(tmp_path: Path, rubric: Rubric) -> None:
    """Where nothing looks like an artifact, the files that are expected are named."""
    (tmp_path / "ann").mkdir()
    (tmp_path / "ann/notes.txt").write_text("hello")
    assert "joint_publisher.py" in refused(tmp_path / "ann", rubric).remedy


def test_a_folder_of_submissions_is_no_submission(tmp_path: Path, rubric: Rubric) -> None:
    """Two students' folders beside each other are not graded as one."""
    for name in ("ann", "bob"):
        shutil.copytree(SOLUTION, tmp_path / "class" / name)
    record = read_submission_folder(tmp_path / "class", rubric)
    assert all(fact.candidates for fact in record.artifacts)
