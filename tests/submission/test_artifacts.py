"""Submissions that were extracted: found whatever their shape, refused with a remedy where there is nothing."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from grader.errors import SubmissionError
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.recording.submission import SubmissionRecord
from grader.submission import artifacts as module
from grader.submission.artifacts import read_submission, read_submission_folder
from grader.submission.extraction import Intake, SubmissionSource, open_submission
from grader.submission.file_names import MAX_TEXT_BYTES
from grader.submission.texts import decode_text

SOLUTION = Path(__file__).resolve().parents[2] / "reference/solution"
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
    "name",
    [
        "joint_pub.py",
        "JointPublisher.py",
        "joint-publisher.py",
        "joint_publisher (1).py",
        "joint_publisher",
    ],
)
def test_a_similar_name_is_taken_and_reported(folder: Path, rubric: Rubric, name: str) -> None:
    """A near miss of a file's name, or none of its suffix, is taken for the file."""
    (folder / "joint_publisher.py").rename(folder / name)
    fact = next(
        a for a in read_submission_folder(folder, rubric).artifacts if a.name == "publisher"
    )
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


def test_nodes_in_one_file_are_found_by_their_entry_points(tmp_path: Path, rubric: Rubric) -> None:
    """A package that runs several nodes from one file has all of them.

    A node without entry point is missing.
    """
    points = "['joint_publisher = arm.nodes:a', 'joint_subscriber = arm.nodes:b']"
    files = {
        "package.xml": "<package><name>arm</name><export><build_type>ament_python</build_type></export></package>",
        "setup.py": f"from setuptools import setup\nsetup(entry_points={{'console_scripts': {points}}})\n",
        "arm/nodes.py": "def a(): ...\ndef b(): ...\n",
        "robot_launch.py": "",
    }
    for path, text in files.items():
        (tmp_path / "ann" / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "ann" / path).write_text(text)
    record = read_submission_folder(tmp_path / "ann", rubric)
    one = "arm/nodes.py"
    wanted = {
        "publisher": one,
        "subscriber": one,
        "service": None,
        "launch": "robot_launch.py",
        "qos": None,
    }
    assert found(record) == wanted
    assert {fact.found_by for fact in record.artifacts if fact.path == one} == {"near miss"}


def test_two_missing_files_are_not_found_in_one(folder: Path, rubric: Rubric) -> None:
    """One file that is similar to two missing ones is taken once."""
    (folder / "joint_publisher.py").rename(folder / "joint_pubscriber.py")
    (folder / "joint_subscriber.py").unlink()
    paths = found(read_submission_folder(folder, rubric))
    assert (paths["publisher"], paths["subscriber"]) == ("joint_pubscriber.py", None)


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
    assert decode_text("Größe".encode("utf-16")) == "Größe"


def test_binary_and_long_files_have_no_text(folder: Path, rubric: Rubric) -> None:
    """A file with zero bytes, and a text that nobody has written, are kept as facts, not as texts."""
    (folder / "joint_publisher.py").write_bytes(b"\0\1\2")
    (folder / "long.md").write_text("x" * (MAX_TEXT_BYTES + 1))
    (folder / "figure.png").write_bytes(b"\x89PNG")
    record = read_submission_folder(folder, rubric)
    assert {"joint_publisher.py", "long.md", "figure.png"} <= {file.path for file in record.files}
    assert not {"joint_publisher.py", "long.md", "figure.png"} & set(record.texts)


def test_of_too_many_texts_the_small_ones_are_read(folder: Path, rubric: Rubric) -> None:
    """Students write small files. If all text is too much, tables and logs are dropped first."""
    (folder / "logs").mkdir()
    for number in range(20):
        (folder / f"logs/{number:02}.txt").write_text("x" * MAX_TEXT_BYTES)
    texts = read_submission_folder(folder, rubric).texts
    assert set(FILES.values()) <= set(texts)
    assert sum(map(len, texts.values())) > module.MAX_TEXTS_CHARACTERS - MAX_TEXT_BYTES
    assert sum(map(len, texts.values())) <= module.MAX_TEXTS_CHARACTERS


def test_files_are_in_order_and_links_are_none(folder: Path, rubric: Rubric) -> None:
    """Files come by name, each folder's before those below it; nothing but regular files counts."""
    (folder / "a/b").mkdir(parents=True)
    for name in ("a/z.py", "a/b/a.py"):
        (folder / name).touch()
    os.mkfifo(folder / "pipe.py")
    (folder / "link.py").symlink_to("joint_publisher.py")
    paths = [file.path for file in read_submission_folder(folder, rubric).files]
    assert paths == [*sorted(p.name for p in SOLUTION.glob("*.*")), "a/z.py", "a/b/a.py"]


def test_an_archive_is_read_as_its_folder(folder: Path, rubric: Rubric) -> None:
    """A zip of a folder's contents gives the same facts, with the time of its newest file."""
    shutil.make_archive(str(folder), "zip", folder)
    direct = read_submission_folder(folder, rubric)
    with open_submission(folder.with_suffix(".zip")) as intake:
        packed = read_submission(intake, rubric)
    assert packed.submitted_at is None
    assert packed.newest_file is not None
    newest = max(path.stat().st_mtime for path in folder.iterdir())
    assert (
        abs(datetime.fromisoformat(packed.newest_file).timestamp() - newest) <= 2
    )  # the resolution of zip
    assert (packed.source, direct.source) == (str(folder.with_suffix(".zip")), "")
    packed.newest_file, packed.source = None, ""
    assert packed == direct


def test_what_is_known_of_the_intake_is_recorded(folder: Path, rubric: Rubric) -> None:
    """Name, time and left-out files go into the record."""
    time = datetime(2026, 3, 2, 23, 41, tzinfo=UTC)
    record = read_submission(
        Intake(
            folder, SubmissionSource("Ann Müller", (), submitted_at=time), ("x.pyc: compiled code",)
        ),
        rubric,
    )
    assert (record.name, record.left_out) == ("Ann Müller", ["x.pyc: compiled code"])
    assert record.submitted_at == "2026-03-02T23:41:00+00:00"


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
    assert caught.value.location == str(folder)
    assert caught.value.remedy
    return caught.value


def test_an_empty_folder_is_refused(tmp_path: Path, rubric: Rubric) -> None:
    """A folder without files, or with empty folders only, is empty."""
    (tmp_path / "ann/src").mkdir(parents=True)
    assert "empty" in refused(tmp_path / "ann", rubric).problem


def test_a_folder_of_something_else_is_refused(tmp_path: Path, rubric: Rubric) -> None:
    """Where nothing looks like an artifact, the files that are expected are named."""
    (tmp_path / "ann").mkdir()
    (tmp_path / "ann/notes.txt").write_text("hello")
    assert "joint_publisher.py" in refused(tmp_path / "ann", rubric).remedy


@pytest.mark.parametrize(
    ("lab", "submission"),
    [(None, "labs/09-02/solution"), ("labs/09-02", "reference/solution")],
    ids=["one", "other"],
)
def test_what_is_of_another_lab_is_refused(
    lab: str | None, submission: str, rubric: Rubric
) -> None:
    """A launch file that starts none of the lab's programs earns nothing in another lab's place."""
    if lab is None:
        asked = rubric
    else:
        asked = read_rubric(SOLUTION.parents[1] / lab / "rubric.yaml")
    with pytest.raises(SubmissionError, match=f"to lab {asked.lab.id}; it may be of another lab"):
        read_submission_folder(SOLUTION.parents[1] / submission, asked)


def test_a_launch_file_alone_is_a_submission(tmp_path: Path, rubric: Rubric) -> None:
    """Whatever it is called, it is of the lab where it starts one of the lab's programs."""
    (tmp_path / "all.launch.py").write_text("Node(package='mine', executable='joint_publisher')")
    assert found(read_submission_folder(tmp_path, rubric))["launch"] == "all.launch.py"


def test_a_folder_of_submissions_is_no_submission(tmp_path: Path, rubric: Rubric) -> None:
    """Two students' folders beside each other are not graded as one."""
    for name in ("ann", "bob"):
        shutil.copytree(SOLUTION, tmp_path / "class" / name)
    record = read_submission_folder(tmp_path / "class", rubric)
    assert all(fact.candidates for fact in record.artifacts)


@pytest.mark.usefixtures("plain_user")
@pytest.mark.parametrize(
    ("closed", "missing", "refused"),
    [
        ("robot_service.py", "", True),
        ("README.md", "", True),
        ("helpers/tables.py", "", True),
        ("photo.png", "", False),
        ("helpers", "", False),
        ("helpers", "robot_service.py", True),
        ("photo.png", "robot_service.py", False),
    ],
)
def test_what_a_grade_may_rest_on_must_be_readable(
    rubric: Rubric, closed: str, missing: str, refused: bool
) -> None:
    """A file that is there and may not be read is not missing: no points are lost, the submission is refused."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, "ann")
        (folder / "helpers").mkdir(parents=True)
        for name in (*FILES.values(), "README.md", "helpers/tables.py", "photo.png"):
            (folder / name).write_text("x = 1\n")
        if missing:
            (folder / missing).unlink()
        (folder / closed).chmod(0)
        with open_submission(folder) as intake:
            if refused:
                with pytest.raises(SubmissionError, match=f"{closed}.* may not be read") as caught:
                    read_submission(intake, rubric)
                assert caught.value.exit_status == 3
                assert "chmod" in caught.value.remedy
            else:
                assert found(read_submission(intake, rubric))["publisher"] == "joint_publisher.py"
        (folder / closed).chmod(0o700)


def test_nodes_that_are_composed_in_one_file_are_all_found_there(
    tmp_path: Path, rubric: Rubric
) -> None:
    """A file with telltale calls of several artifacts stands for each.

    A file that only names them does not.
    """
    (tmp_path / "ann").mkdir()
    text = (
        "# joint_command_publisher: create_publisher; joint_state_subscriber: create_subscription\n"
    )
    (tmp_path / "ann/arm.py").write_text(text)
    (tmp_path / "ann/robot_launch.py").write_text("'robot_mode_service'")
    wanted = {
        "publisher": "arm.py",
        "subscriber": "arm.py",
        "service": None,
        "launch": "robot_launch.py",
        "qos": None,
    }
    assert found(read_submission_folder(tmp_path / "ann", rubric)) == wanted


def test_a_readme_in_utf_16_is_a_text(tmp_path: Path) -> None:
    """Editors of Windows save "Unicode" in two bytes a character, which are no sign of a binary file."""
    (tmp_path / "joint_publisher.py").write_text("import rclpy\n")
    (tmp_path / "README.md").write_text("# Größe\n", encoding="utf-16")
    (tmp_path / "data.txt").write_bytes(b"a\0b")
    texts = read_submission_folder(tmp_path, read_rubric(None)).texts
    assert texts["README.md"] == "# Größe\n"
    assert "data.txt" not in texts


def test_a_notebook_is_named(tmp_path: Path) -> None:
    """Nodes start from files; a notebook alone holds none."""
    (tmp_path / "lab09.ipynb").write_text('{"cells": []}')
    with pytest.raises(SubmissionError, match=r"in a notebook, lab09\.ipynb") as raised:
        read_submission_folder(tmp_path, read_rubric(None))
    assert "Hand in the programs as files: joint_publisher.py, " in raised.value.remedy


def test_a_compiled_executable_stands_for_an_artifact(tmp_path: Path, rubric: Rubric) -> None:
    """The source of an executable with the artifact's name is its file, in any language; it must be there."""
    manifest = (
        "<package><name>arm</name><export><build_type>ament_cmake</build_type></export></package>"
    )
    script = (
        "add_executable(joint_publisher src/helper.hpp src/main.cpp)\n"
        "add_executable(robot_service src/missing.cpp)\n"
    )
    files = {
        "arm/package.xml": manifest,
        "arm/CMakeLists.txt": script,
        "arm/src/main.cpp": "int main() {}",
        "arm/robot_launch.py": "",
    }
    for path, text in files.items():
        (tmp_path / "ann" / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "ann" / path).write_text(text)
    paths = found(read_submission_folder(tmp_path / "ann", rubric))
    assert paths["publisher"] == "arm/src/main.cpp"
    assert paths["service"] is None
