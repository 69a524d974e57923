"""`grade export`: its files, its messages about mistakes, and results that are not whole yet."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from grader.cli import main
from grader.commands.grade import is_results
from grader.errors import RecordingError
from grader.files import UNFINISHED
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.report.exports import CLASS_EXPORTS, EXPORTS
from grader.result_folder import RECORDINGS, RESULT_FILE, RUBRIC_COPY
from tests.report.exports.importers import User, canvas, moodle_feedback
from tests.report.exports.returned_class import results_of, taken_in
from tests.report.exports.sample_results import VARIABLES, every_outcome

pytestmark = pytest.mark.usefixtures("judged_before")

ROOT = Path(__file__).resolve().parents[2]


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output and errors."""
    try:
        status = main(["export", *(str(argument) for argument in arguments)])
    except SystemExit as end:  # argparse
        status = int(end.code or 0)
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Give a results folder with a result."""
    (tmp_path / "ann").mkdir()
    (tmp_path / "ann" / RESULT_FILE).write_text(json.dumps(every_outcome()), encoding="utf-8")
    return tmp_path / "ann"


def test_all_forms_go_into_the_results_folder(
    results: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without file names each form has its own, all are named, and the result stays as it was."""
    for name, value in VARIABLES.items():
        monkeypatch.setenv(name, value)
    before = (results / RESULT_FILE).read_bytes()
    status, out, _ = run(capsys, results, *(f"--to={name}" for name in EXPORTS))
    assert status == 0
    assert out.splitlines() == [str(results / export.file_name) for export in EXPORTS.values()]
    assert {path.name for path in results.iterdir()} == {
        RESULT_FILE,
        *(e.file_name for e in EXPORTS.values()),
    }
    assert (results / RESULT_FILE).read_bytes() == before


@pytest.mark.parametrize("chosen", [["--to=junit", "-o"], ["--to"]])
def test_a_form_goes_into_a_file_of_ones_choice(
    results: Path, tmp_path: Path, chosen: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """By -o for one form, or by NAME=FILE."""
    target = tmp_path / "my.xml"
    last = str(target) if chosen[-1] == "-o" else f"junit={target}"
    assert run(capsys, results, *chosen, last) == (0, f"{target}\n", "")
    assert ElementTree.parse(target).getroot().tag == "testsuites"


def test_a_form_on_the_standard_output_is_alone_there(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A form on the standard output is alone there and can be piped; others go into files."""
    status, out, _ = run(capsys, results, "--to=gradescope=-", "--to=junit")
    assert (status, json.loads(out)["score"]) == (0, 7.5)
    assert (results / "junit.xml").exists()


def test_several_results_have_their_forms_beside_them(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file of one's choice would be overwritten by the next, so it is refused."""
    other = shutil.copytree(results, results.parent / "bob")
    assert run(capsys, results, other, "--to", "junit")[0] == 0
    assert (other / "junit.xml").exists()
    status, _, errors = run(capsys, results, other, "--to", "junit=x.xml")
    assert (status, "leave out the file" in errors) == (2, True)


def test_what_is_no_result_does_not_keep_others_from_their_forms(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With `results/*`, tables and earlier results are among the paths; they are told, and the rest is written."""
    other = shutil.copytree(results, results.parent / "zoe")
    table = results.parent / "grades.csv"
    table.write_text("submission\n", encoding="utf-8")
    status, _, errors = run(capsys, results, table, other, "--to", "junit")
    assert (status, errors.count("grades.csv")) == (6, 1)
    assert (other / "junit.xml").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "name a form with --to"),
        (["--to", "junitt"], "there is no export 'junitt'; did you mean 'junit'?"),
        (["--to", "junit=/dev/stdout"], "- is the standard output"),
        (["--to", "junit", "-o", "/dev/fd/1"], "- is the standard output"),
        (["--to", "junit=a", "-o", "b"], "-o needs a single"),
        (["--to", "junit", "--to", "gradescope", "-o", "b"], "-o needs a single"),
    ],
)
def test_wrong_usage(
    results: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wrong usage ends with status 2 and an error that names the mistake."""
    status, _, errors = run(capsys, results, *arguments)
    assert (status, said in errors) == (2, True)


@pytest.mark.parametrize("content", [None, "{", "[]", "{}", '{"schema": "other"}'])
def test_no_result(results: Path, content: str | None, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a result of this version it ends with 6, and says so."""
    (results / RESULT_FILE).unlink()
    if content is not None:
        (results / RESULT_FILE).write_text(content, encoding="utf-8")
    status, out, errors = run(capsys, results, "--to", "junit")
    assert (status, out) == (6, "")
    assert "result" in errors
    assert not (results / "junit.xml").exists()


def test_missing_variables_are_named(
    results: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Classroom 50's form needs the variables of its runner."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    status, _, errors = run(capsys, results, "--to", "classroom50")
    assert (status, "CLASSROOM, ASSIGNMENT" in errors, "docs/ci.md" in errors) == (70, True, True)


def test_paths_begin_with_the_prefix(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A submission in a folder of its repository is pointed at from the repository's root."""
    _, out, _ = run(capsys, results, "--to", "github-annotations=-", "--path-prefix", "labs/ann")
    assert "file=labs/ann/a.partial.py,line=3" in out


def test_an_absolute_prefix_is_meant_from_the_repository(
    results: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """An absolute prefix, such as a workspace's variable, is taken relative to the repository.

    A file outside of the repository has no location.
    """
    monkeypatch.chdir(tmp_path)
    for prefix, pointed in ((tmp_path / "labs/ann", True), (tmp_path.parent, False)):
        _, out, _ = run(
            capsys, results.resolve(), "--to", "github-annotations=-", "--path-prefix", prefix
        )
        assert ("file=labs/ann/a.partial.py,line=3" in out, "file=" in out) == (pointed, pointed)


def lay_out_running(results: Path, missing: tuple[str, ...]) -> None:
    """Lay out the folder of a running grading, with some sessions not yet recorded."""
    (results / RECORDINGS).mkdir(parents=True)
    recordings = results / UNFINISHED / RECORDINGS
    shutil.copytree(ROOT / "tests/recordings/solution", recordings)
    shutil.copy(lab_folder() / "rubric.yaml", recordings / RUBRIC_COPY)
    for session in missing:
        shutil.rmtree(recordings / session)


def test_a_grading_that_still_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Recorded sessions of a running grading are judged, and the others are undecided.

    Sessions of an earlier grading are not judged.
    """
    results = tmp_path / "ann"
    lay_out_running(results, missing=("subscriber", "launch", "qos"))
    assert run(capsys, results, "--so-far", "--to", "gradescope")[0] == 0
    assert {path.name for path in results.iterdir()} == {UNFINISHED, RECORDINGS, "gradescope.json"}
    data: dict[str, Any] = json.loads((results / "gradescope.json").read_text(encoding="utf-8"))
    waiting = [test for test in data["tests"] if "Not yet run: the session '" in test["output"]]
    judged = [test for test in data["tests"] if test not in waiting]
    assert {(test["tags"][0], "score" in test) for test in waiting} == {
        ("subscriber", False),
        ("launch", False),
        ("qos", False),
    }
    assert {test["status"] for test in judged} == {"passed"}
    assert data["score"] + data["extra_data"]["undecided"] == 100


# -- forms of a class ----------------------------------------------------------------------------------


@pytest.fixture
def of_class(tmp_path: Path) -> Path:
    """Give the results of a download of Moodle, with one student without an ID number."""
    names = []
    for name in ("Änne Müller_11", "Bob_12"):
        names.append(f"{name}_assignsubmission_file_/joint_publisher.py")
    sources = taken_in(
        tmp_path, read_rubric(None), names, "name,student_id,login\nÄnne Müller,0012,am12\n"
    )
    return results_of(tmp_path, sources)


def test_a_class_goes_into_files_of_its_own(
    of_class: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All forms of a class go into files, each with its number of students.

    A student left out is named with the reason, and no result changes.
    """
    before = contents_of(of_class)
    status, out, err = run(capsys, of_class, *(f"--to={name}" for name in CLASS_EXPORTS))
    counts = {
        "moodle": 2,
        "canvas": 1,
        "blackboard": 1,
        "brightspace": 1,
        "feedback": 2,
    }
    assert status == 6
    assert out.splitlines() == [
        f"{of_class / CLASS_EXPORTS[name].file_name}: {n}" for name, n in counts.items()
    ]
    for words in (
        "nothing was written for mail, eml",
        "--class-list",
        "canvas: left out, because none of these is known: ID, SIS User ID, SIS Login ID: Bob_12\n",
        "mail: left out, because no address is known that mail can be sent to: Bob_12, Änne_Müller_11\n",
    ):
        assert words in err
    after = contents_of(of_class)
    assert {path: after[path] for path in before} == before
    assert {path.parent.name for path in after.keys() - before.keys()} == {"exports"}
    rubric = read_rubric(None)
    folders = (of_class.parent, of_class)
    assert list(map(is_results, folders, (rubric, rubric))) == [False, True]


def contents_of(folder: Path) -> dict[Path, bytes]:
    """Return the contents of all files in a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_class_list_adds_whom_the_download_did_not_name(
    of_class: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A class list given with the export adds missing ids, but no student without a submission.

    Columns and files are named as wanted.
    """
    listed = tmp_path / "list.csv"
    listed.write_text("name,student_id,login\nBob,0013,bob13\nEve,0015,eve15\n", encoding="utf-8")
    arguments = (
        "--to",
        "canvas",
        "--class-list",
        listed,
        "--column",
        "Lab 9 (4711)",
        "-o",
        tmp_path / "my.csv",
    )
    assert run(capsys, of_class, *arguments) == (0, f"{tmp_path / 'my.csv'}: 2\n", "")
    users = [User("1", "", "0012"), User("2", "", "0013")]
    assert canvas((tmp_path / "my.csv").read_bytes(), users, {"4711": "x"}) == {
        "4711": {"2": "60.4", "1": "60.8"}
    }


def test_a_table_on_the_standard_output_is_alone_there(
    of_class: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table on the standard output is alone there; other files are named beside it."""
    status, out, err = run(capsys, of_class, "--to=moodle=-", "--to=feedback")
    assert (status, [*csv.DictReader(out.splitlines())][1]["Identifier"]) == (0, "Participant 11")
    assert f"{of_class / 'exports/feedback.zip'}: 2" in err


def test_students_without_a_common_key_go_into_tables_of_their_own(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each table is named with its students and its key.

    The standard output has no room for two tables.
    """
    listed = tmp_path / "list.csv"
    listed.write_text("name,student_id,email\nann,0012,\nben,,ben@uni.example\n", encoding="utf-8")
    shutil.copytree(results, results.parent / "ben")
    folder = results.parent
    status, out, err = run(capsys, folder, "--to=moodle", "--class-list", listed)
    assert (status, out.splitlines()) == (
        0,
        [f"{folder / 'exports' / name}: 1" for name in ("moodle.csv", "moodle-2.csv")],
    )
    assert "choose 'Map from' ID number" in err
    assert "choose 'Map from' Email address" in err
    keys = []
    for name in ("moodle.csv", "moodle-2.csv"):
        keys.append(next(csv.DictReader((folder / "exports" / name).read_text().splitlines())))
    assert (keys[0]["ID number"], keys[1]["Email address"]) == ("0012", "ben@uni.example")
    status, out, err = run(capsys, folder, "--to=moodle=-", "--class-list", listed)
    assert (status, out) == (2, "")
    assert "--class-list" in err


def test_one_submission_goes_back_as_a_class_of_one(
    of_class: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its folder alone is enough, under whatever path."""
    status, out, _ = run(capsys, of_class / "Bob_12/../Bob_12", "--to=feedback")
    assert (status, out) == (0, f"{of_class / 'Bob_12/../Bob_12/exports/feedback.zip'}: 1\n")
    read = moodle_feedback(
        (of_class / "Bob_12/exports/feedback.zip").read_bytes(), [User("12", "")]
    )
    assert read == {"12": {"report.html": b"<p>Report of Bob_12"}}


def test_what_is_undecided_or_not_graded_is_said(
    of_class: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Open points count as not earned in a grade book, and their owners are named."""
    plain = json.loads((of_class / "Bob_12" / RESULT_FILE).read_text())
    check = plain["criteria"][0]["checks"][0]
    check |= {"outcome": "inconclusive", "earned": 0, "undecided": check["possible"]}
    (of_class / "Bob_12" / RESULT_FILE).write_text(json.dumps(plain), encoding="utf-8")
    (of_class / "eve").mkdir()
    (of_class / "eve/report.html").write_text("x")
    _, _, err = run(capsys, of_class, "--to=moodle")
    assert "Left out, because not graded: eve\n" in err
    assert "Exported without their undecided points: Bob_12\n" in err


@pytest.mark.parametrize(
    "arguments", [["--to=canvas", "--to=junit"], ["--to=mail", "--from=nobody"], ["--to=cannvas"]]
)
def test_options_that_do_not_fit_are_refused(
    arguments: list[str], of_class: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is written."""
    assert run(capsys, of_class, *arguments)[0] == 2
    assert not (of_class / "exports").exists()


def test_a_folder_without_results_has_nothing_to_go_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder without results is named, with the remedy."""
    status, _, err = run(capsys, tmp_path, "--to=canvas")
    assert status == 6
    assert "there are no results to export" in err


def test_nothing_is_written_through_a_link_among_results(
    of_class: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder of exports that leads elsewhere is refused, and the files there stay."""
    (tmp_path / "elsewhere").mkdir()
    (of_class / "exports").symlink_to(tmp_path / "elsewhere")
    status, _, err = run(capsys, of_class, "--to=canvas")
    assert status == 2
    assert "is a link" in err
    assert [*(tmp_path / "elsewhere").iterdir()] == []


def test_results_of_two_labs_are_no_column(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Points of one would stand in the other's column, so nothing is written."""
    other = every_outcome()
    other["provenance"]["lab"] = "another"
    (results.parent / "ben").mkdir()
    (results.parent / "ben" / RESULT_FILE).write_text(json.dumps(other), encoding="utf-8")
    status, _, errors = run(capsys, results.parent, "--to=canvas")
    assert status == RecordingError.exit_status
    assert "results of Labs" in errors
    assert not list(results.parent.glob("*.csv"))
