"""Reports as Moodle and Canvas take them back: in the archive for each system, under the names of its own download."""

from __future__ import annotations

import dataclasses
import io
import itertools
import zipfile
from pathlib import Path

import pytest

from grader.judging import rubrics
from grader.lab.rubric import Rubric
from grader.recording.submission import Identity
from grader.report.exports import CLASS_EXPORTS
from grader.report.exports.returned import Returned, ReturnedClass
from tests.report.exports.importers import User, canvas_feedback, moodle_feedback
from tests.report.exports.returned_class import given_back, taken_in


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


def archive_of(given: ReturnedClass) -> Returned:
    """Make the archive, twice the same."""
    returned = CLASS_EXPORTS["feedback"].render(given)
    assert CLASS_EXPORTS["feedback"].render(given).content == returned.content
    return returned


@pytest.mark.parametrize(
    "folder", ["_assignsubmission_file/", "_assignsubmission_file_/", "_assignsubmission_file_"]
)
def test_moodle_gives_each_report_to_its_student(
    folder: str, tmp_path: Path, rubric: Rubric
) -> None:
    """In folders, as Moodle 4.1 and older ones name them, and in files; also of namesakes and groups."""
    names = ["Änne Müller_11", "Änne Müller_12", "Group 3-Bob O'Brien_13"]
    online = (
        "Änne Müller_11_assignsubmission_onlinetext_"
        + ("/" if folder.endswith("/") else "")
        + "onlinetext.html"
    )
    given = given_back(
        tmp_path,
        taken_in(tmp_path, rubric, [*(f"{n}{folder}joint_publisher.py" for n in names), online]),
    )
    read = moodle_feedback(
        archive_of(given).content, [User(n, "") for n in ("11", "12", "13", "14")]
    )
    assert read == {
        "11": {"report.html": b"<p>Report of \xc3\x84nne_M\xc3\xbcller_11"},
        "12": {"report.html": b"<p>Report of \xc3\x84nne_M\xc3\xbcller_12"},
        "13": {"report.html": b"<p>Report of Group_3-Bob_O_Brien_13"},
    }


def test_canvas_shows_a_file_of_the_kind_that_was_handed_in(tmp_path: Path, rubric: Rubric) -> None:
    """The returned file keeps the name of the student's file.

    A zip holds the page; a program is returned as a report in plain text.
    """
    submission_time = {
        "890": ("67", "lab.zip"),
        "891": ("68", "joint_publisher-2.py"),
        "892": ("68", "notes_1_2.zip"),
        "893": ("69", "joint_publisher.py"),
        "894": ("Xy3z", "lab.zip"),
        "895": ("70", "lab.tar.gz"),
    }
    names = [
        "mulleranne_67_890_lab.zip",
        "bobvan_der_berg_LATE_68_891_joint_publisher-2.py",
        "bobvan_der_berg_LATE_68_892_notes_1_2.zip",
        "celikcem_69_893_joint_publisher.py",
        "anon_Xy3z_894_lab.zip",
        "dan_70_895_lab.tar.gz",
        "eve_71_text.html",
    ]
    returned = archive_of(given_back(tmp_path, taken_in(tmp_path, rubric, names)))
    read = canvas_feedback(returned.content, submission_time)
    assert {user: name for user, (name, _) in read.items()} == {
        "67": "lab.zip",
        "68": "notes_1_2.zip",
        "69": "joint_publisher.py",
        "Xy3z": "lab.zip",
    }
    for user, name in (
        ("67", "mulleranne_67"),
        ("68", "bobvan_der_berg_68"),
        ("Xy3z", "anon_Xy3z"),
    ):
        with zipfile.ZipFile(io.BytesIO(read[user][1])) as inner:
            assert inner.read("report.html") == f"<p>Report of {name}".encode()
    assert b"of 100 points" in read["69"][1]
    assert sorted(itertools.chain(*returned.left_out.values())) == [
        "dan_70",
        "eve_71",
    ]


def test_who_came_another_way_is_named(tmp_path: Path, rubric: Rubric) -> None:
    """Blackboard takes nothing back in an archive, nor do folders; mails can go to those."""
    sources = taken_in(
        tmp_path, rubric, ["Lab 9_ann1_attempt_2026-03-01-12-00-00_joint_publisher.py"]
    )
    returned = archive_of(given_back(tmp_path, sources))
    assert returned.count == 0
    (why,) = returned.left_out
    assert why.startswith("Blackboard takes no files back in an archive")
    given = given_back(tmp_path / "b", sources)
    (given.folder / "ann1/report.html").unlink()
    assert [*archive_of(ReturnedClass(given.entries, given.folder)).left_out] == [
        "there is no report"
    ]


@pytest.mark.parametrize(
    "path", ["../x/", "/etc/", "a/../../b.zip", "a\\b.zip", "a\nb.zip", "./", "a//b.zip", "\udcff/"]
)
def test_nothing_is_written_outside_of_where_it_is_unpacked(
    path: str, tmp_path: Path, rubric: Rubric
) -> None:
    """A path that leads out of the archive is not written.

    Paths in recordings from elsewhere can be anything.
    """
    given = given_back(tmp_path, taken_in(tmp_path, rubric, ["ann_67_1_lab.zip"]))
    (entry,) = given.entries
    hostile = dataclasses.replace(entry, identity=Identity(system="Canvas", handback=(path,)))
    returned = archive_of(ReturnedClass([hostile], given.folder))
    assert (returned.count, [*returned.left_out.values()]) == (0, [["ann_67"]])
    assert zipfile.ZipFile(io.BytesIO(returned.content)).namelist() == []
