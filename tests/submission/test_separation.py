"""Files inside a submission are never decisions, output folders, or another student's results."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from grader import result_folder
from grader.errors import UsageError
from grader.judging.rubrics import read_overrides, read_rubric
from grader.lab.kept_lab import KEPT
from grader.lab.rubric import Rubric
from grader.recording.submission import Person, SubmissionRecord, write_submission
from grader.report.exports import EXPORTS
from grader.result_folder import OVERRIDES_FILE, RECORDINGS
from grader.submission.discovery import Discovery, Shape, find_submissions
from grader.submission.extraction import SubmissionSource
from grader.submission.separation import (
    lies_within,
    require_no_links,
    require_same_source,
    uncounted_overrides,
    with_earlier,
)

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="links are made otherwise on Windows"
)

LAB = ("joint_publisher.py", "robot_service.py", "README.md")
OVERRIDES = "overrides:\n  - {submission: '*', bonus: 5, reason: All is well., who: An Instructor, when: 2026-01-01}\n"


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


def lay_out(folder: Path, *names: str) -> Path:
    """Write files that hold their own names."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Make a student's repository, which brought results along."""
    lay_out(tmp_path / "outside/alice", "kept")
    folder = lay_out(tmp_path / "alice", *LAB, "results/alice/result.json")
    (folder / "results/overrides.yaml").write_text(OVERRIDES)
    return folder


# -- decisions, and places to write --------------------------------------------------------------------


def test_overrides_in_a_submission_are_no_decision(
    repository: Path, rubric: Rubric, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Overrides in a submission are reported and do not count, however the folder is typed.

    Overrides beside the submission, or given, do.
    """
    source, results = str(repository), repository / "results"
    monkeypatch.chdir(repository)
    for typed in (results, Path("results"), repository / "../alice/results", Path("./results/")):
        assert not read_overrides(None, typed, rubric, [source]).sha256
        assert "does not count" in (uncounted_overrides(typed, [source]) or "")
    assert read_overrides(results / "overrides.yaml", results, rubric, [source]).sha256
    for elsewhere in (
        "",
        f"{source}x",
        str(repository.parent / "bob"),
        f"{repository.parent}/class.zip: alice/",
    ):
        assert read_overrides(None, results, rubric, [elsewhere]).sha256
        assert uncounted_overrides(results, [elsewhere]) is None


@pytest.mark.parametrize(
    ("link", "target"),
    [
        ("results", "../outside"),
        ("results", "code"),
        ("results/alice", "../../outside/alice"),
        ("results/alice/recordings", "../../../outside/alice"),
        ("results/audit.jsonl", "../../outside/audit.jsonl"),
        ("results/history/alice/0123.json", "/etc/nothing"),
        ("results/.unfinished", "/etc"),
    ],
)
def test_links_that_a_submission_brought_are_no_place_to_write(
    repository: Path, link: str, target: str
) -> None:
    """A link on the way to the results or in them is refused and named, with its target."""
    place = repository / link
    if place.is_dir():
        place.rename(repository / "code")
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to(target)
    assert lies_within(repository / "results", [str(repository)])
    with pytest.raises(UsageError, match="holds a link") as refused:
        require_no_links(repository / "results", [str(repository)])
    assert refused.value.location == str(place)
    require_no_links(repository / "results", [str(repository.parent / "bob")])


def test_an_export_may_lie_beside_links_but_not_behind_one(repository: Path) -> None:
    """A form for another system goes into the submission's own folder, and through none of its links."""
    (repository / "out").symlink_to("../outside")
    require_no_links(repository, [str(repository)], inside=False)
    for way in ("out", "out/deeper"):
        with pytest.raises(UsageError, match="holds a link"):
            require_no_links(repository / way, [str(repository)], inside=False)


def test_links_of_the_instructors_are_followed(repository: Path) -> None:
    """Where nothing is the submission's, a link on the way is the instructor's own; so is one above the repository."""
    (repository.parent / "desk").symlink_to("outside")
    require_no_links(repository.parent / "desk/results", [str(repository)])
    assert not lies_within(repository.parent / "desk/results", [str(repository)])
    (repository.parent / "home").symlink_to(".")
    require_no_links(repository.parent / "home/alice/results", [str(repository)])
    assert lies_within(repository.parent / "home/alice/results", [str(repository)])


# -- results of others ---------------------------------------------------------------------------------


def test_results_of_another_path_are_not_replaced_unawares(tmp_path: Path) -> None:
    """Results know their source path. Results without a path, or from the same, may be replaced."""
    (tmp_path / "bob" / RECORDINGS).mkdir(parents=True)
    require_same_source(tmp_path / "bob", "/class/mallory/bob")
    write_submission(tmp_path / "bob" / RECORDINGS, SubmissionRecord("bob", source="/class/bob"))
    require_same_source(tmp_path / "bob", "/class/bob")
    require_same_source(tmp_path / "bob", "")
    with pytest.raises(UsageError, match=r"made from /class/bob.*another submission"):
        require_same_source(tmp_path / "bob", "/class/mallory/bob")
    (tmp_path / "bob" / RECORDINGS / "submission.json").write_text("none")
    require_same_source(tmp_path / "bob", "/class/mallory/bob")


METADATA = "submission_7:\n  :submitters:\n  - :name: bob\n    :sid: '7'\n  :created_at: 2026-01-01 00:00:00.000000000 Z\n"


def test_each_submission_has_a_path_of_its_own(rubric: Rubric, tmp_path: Path) -> None:
    """A path in mallory's folder never equals bob's, whatever its name."""
    lay_out(tmp_path / "class/bob", *LAB)
    lay_out(tmp_path / "class/mallory/bob", *LAB)
    lay_out(tmp_path / "class/mallory/eve", *LAB)
    lay_out(tmp_path / "class/oscar/submission_7", *LAB)
    (tmp_path / "class/oscar/submission_metadata.yml").write_text(METADATA)

    def sources(*path: str) -> dict[str, str]:
        found = find_submissions([tmp_path.joinpath("class", *path)], rubric)
        return {source.name: source.origin for source in found.submissions}

    above = os.path.realpath(tmp_path / "class")
    assert sources() == {name: f"{above}/{name}" for name in ("bob", "mallory", "oscar")}
    assert sources("bob") == {"bob": f"{above}/bob"}
    assert sources("mallory") == {name: f"{above}/mallory/{name}" for name in ("bob", "eve")}
    assert set(sources("oscar").values()) == {f"{above}/oscar"}


def test_a_repository_is_no_download(rubric: Rubric, tmp_path: Path) -> None:
    """Files that a learning-management system writes are a student's own in a repository and beside the lab's files."""
    for name, mark in (("cloned", ".git/HEAD"), ("bare", "joint_publisher.py")):
        folder = lay_out(
            tmp_path / name,
            mark,
            "submission_7/joint_publisher.py",
            "submission_7/robot_service.py",
        )
        (folder / "submission_metadata.yml").write_text(METADATA)
        assert [h.name for h in find_submissions([folder], rubric).submissions] == [name]


# -- classes -------------------------------------------------------------------------------------------


def found_in(folder: Path, rubric: Rubric) -> Discovery:
    """Look for each submission in a folder."""
    return find_submissions([folder], rubric, shape=Shape.EACH)


@pytest.mark.parametrize("place", ["recordings", "results/eve/recordings", "a/b/recordings"])
def test_a_submission_with_recordings_is_graded(place: str, rubric: Rubric, tmp_path: Path) -> None:
    """Results that somebody keeps beside their work do not hide it; a folder of results alone is named."""
    lay_out(tmp_path / "class/ann", *LAB)
    lay_out(tmp_path / "class/eve", *LAB, f"{place}/submission.json")
    lay_out(tmp_path / "class/results", "ann/recordings/submission.json", "ann/report.html")
    found = found_in(tmp_path / "class", rubric)
    assert [source.name for source in found.submissions] == ["ann", "eve"]
    assert [line.rsplit(": ", 2)[1:] for line in found.not_understood] == [
        ["results", "results of an earlier grading"]
    ]


def test_no_submission_is_called_like_what_lies_among_results(
    rubric: Rubric, tmp_path: Path
) -> None:
    """One that is called so, in whatever letters, gets a mark, and that is said."""
    names = names_among_results()
    for name in names:
        lay_out(tmp_path / "class" / name, *LAB)
    found = found_in(tmp_path / "class", rubric)
    assert len(found.submissions) == len(names)
    given = {source.name.casefold() for source in found.submissions}
    assert given.isdisjoint(name.casefold() for name in names)
    assert not any(map(result_folder.is_reserved, given))
    assert len(given) == len(names)
    assert sum(": called " in line for line in found.understood) == len(names)
    single = find_submissions([tmp_path / "class/history"], rubric)
    assert [h.name.startswith("history-") for h in single.submissions] == [True]


def names_among_results() -> list[str]:
    """Return the names of files and folders among results, some of them in other letters."""
    found = {OVERRIDES_FILE, KEPT, "overrides.yml", "Index.HTML", "HISTORY"}
    found |= {"Recordings", "RUBRIC-edited.YAML"}
    found.update(form.file_name for form in EXPORTS.values())
    for name, value in vars(result_folder).items():
        if re.fullmatch("[A-Z][A-Z_0-9]*", name):
            found.add(value)
    return sorted(found)


def test_other_dots_in_names_are_no_endings_of_files(rubric: Rubric, tmp_path: Path) -> None:
    """Names such as `ann.lee` stay as they are."""
    plain = ["Dr._Who", "ann.lee", "j.smith.2", "v1.0"]
    for name in plain:
        lay_out(tmp_path / "others" / name, *LAB)
    found = found_in(tmp_path / "others", rubric)
    assert sorted(source.name for source in found.submissions) == plain


# -- who handed it in, by earlier results --------------------------------------------------------------


def graded_with_a_list(tmp_path: Path, rubric: Rubric) -> tuple[Path, Path]:
    """Give a download of Moodle, and results of it that a class list was given with."""
    names = [
        "Ann_11_assignsubmission_file_/joint_publisher.py",
        "Bob_12_assignsubmission_file_/joint_publisher.py",
    ]
    path = lay_out(tmp_path / "export", *names)
    listed = tmp_path / "class.csv"
    listed.write_text(
        "name,student_id,email,team\nAnn,0012,ann@uni.example,A\nCem,0014,,A\n", encoding="utf-8"
    )
    for source in find_submissions([path], rubric, class_list=listed).submissions:
        folder = tmp_path / "results" / source.name / RECORDINGS
        folder.mkdir(parents=True)
        record = SubmissionRecord(
            source.name,
            student_id=source.student_id,
            identity=source.identity,
            source=source.origin,
        )
        write_submission(folder, record)
    return path, tmp_path / "results"


def test_what_earlier_results_know_of_a_student_is_not_asked_for_again(
    rubric: Rubric, tmp_path: Path
) -> None:
    """A class list given once counts for the next run, beside the new download."""
    path, results = graded_with_a_list(tmp_path, rubric)
    first, bob = (
        with_earlier(source, results) for source in find_submissions([path], rubric).submissions
    )
    assert [person.student_id for person in first.identity.people] == ["0012", "0014"]
    assert (first.student_id, first.identity.people[0].moodle) == ("0012", "11")
    assert first.identity.people[0].email == "ann@uni.example"
    assert (first.identity.system, first.identity.handback) == (
        "Moodle",
        ("Ann_11_assignsubmission_file_/",),
    )
    assert (bob.student_id, bob.identity.people) == ("12", (Person("Bob", moodle="12"),))


def test_results_of_another_path_or_in_a_submission_say_nothing_of_anybody(
    rubric: Rubric, tmp_path: Path
) -> None:
    """A namesake's address is not taken over, nor one that a student wrote into results of their own."""
    path, results = graded_with_a_list(tmp_path, rubric)
    for source in find_submissions([path], rubric).submissions:
        other = replace(source, origin=str(tmp_path / "another"))
        assert with_earlier(other, results) == other
        results.rename(path / "results")
        assert with_earlier(source, path / "results") == source
        (path / "results").rename(results)


@pytest.mark.parametrize(
    "content", ["", "[]", '{"schema": "ros-lab-grader/submission/v1", "identity": {"people": [1]}}']
)
def test_what_is_no_record_tells_nothing_of_anybody(content: str, tmp_path: Path) -> None:
    """A file that is not there, is something else, or would never end, does not keep a submission from being graded."""
    for name in ("ann", "cem"):
        (tmp_path / name / RECORDINGS).mkdir(parents=True)
    (tmp_path / "ann" / RECORDINGS / "submission.json").write_text(content, encoding="utf-8")
    os.mkfifo(tmp_path / "cem" / RECORDINGS / "submission.json")
    for name in ("ann", "bob", "cem"):
        source = SubmissionSource(name, (), "7")
        assert with_earlier(source, tmp_path) == source
