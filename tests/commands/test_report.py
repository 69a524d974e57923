"""`grade report`: page and table from existing results, and messages about folders without any."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path

import pytest

from grader import result_folder
from grader.cli import main
from grader.judging import rubrics
from grader.lab.rubric import Rubric
from grader.recording.submission import read_submission, write_submission
from tests.regraded import judge_results, regraded

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

KEPT = Path(__file__).resolve().parents[1] / "recordings"


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


@pytest.fixture(scope="module")
def judged(rubric: Rubric, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the results of three kept recordings."""
    results = tmp_path_factory.mktemp("results")
    for name in ("solution", "wrong_topic", "best_effort_publisher"):
        shutil.copytree(KEPT / name, results / name / result_folder.RECORDINGS)
        (results / name / result_folder.RECORDINGS / result_folder.RUBRIC_COPY).write_text(
            rubric.text, encoding="utf-8"
        )
        judge_results(results / name, rubric)
    return results


@pytest.fixture
def results(judged: Path, tmp_path: Path) -> Path:
    """Give a copy of the results to write into."""
    shutil.copytree(judged, tmp_path / "results")
    return tmp_path / "results"


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output and errors."""
    status = main(["report", *map(str, arguments)])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


def grades(results: Path) -> dict[str, dict[str, str]]:
    """Read the table that was written."""
    with (results / result_folder.GRADES_FILE).open(encoding="utf-8-sig", newline="") as stream:
        return {row["submission"]: row for row in csv.DictReader(stream)}


def test_page_and_table_are_written_and_reported(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command prints the number of results and the files; the table has all points."""
    status, output, _ = run(capsys, results)
    assert status == 0
    assert output.splitlines()[0] == "3 submissions, 3 graded, median 22 of 100; 0 need attention."
    assert output.splitlines()[1:] == [
        f"Class: {results / 'index.html'}",
        f"Grades: {results / 'grades.csv'}",
    ]
    assert {name: row["total"] for name, row in grades(results).items()} == {
        "best_effort_publisher": "22",
        "solution": "100",
        "wrong_topic": "16",
    }
    page = (results / result_folder.CLASS_PAGE).read_text(encoding="utf-8")
    assert 'href="wrong_topic/report.html"' in page


def test_writing_it_again_gives_the_same_bytes(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its own files are no submissions, and nothing depends on the time."""
    files = [results / name for name in (result_folder.CLASS_PAGE, result_folder.GRADES_FILE)]
    run(capsys, results)
    first = [file.read_bytes() for file in files]
    run(capsys, results)
    assert [file.read_bytes() for file in files] == first


def test_those_who_handed_in_nothing_stay(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The list is kept with the results, so that a report without it lists the same students."""
    roster = tmp_path / "class.csv"
    roster.write_text("name,student_id\nsolution,007\nnobody,8\n", encoding="utf-8")
    run(capsys, results, "--class-list", roster)
    before, page = grades(results), (results / result_folder.CLASS_PAGE).read_bytes()
    roster.unlink()
    _, output, _ = run(capsys, results)
    assert output.startswith("4 submissions, 3 graded")
    assert grades(results) == before
    assert (results / result_folder.CLASS_PAGE).read_bytes() == page
    run(capsys, results, "--class-list", results / result_folder.CLASS_LIST_FILE)
    assert grades(results) == before
    roster.write_text("name,student_id\nsolution,007\n", encoding="utf-8")
    run(capsys, results, "--class-list", roster)
    run(capsys, results)
    assert "nobody" not in grades(results), "the list given last counts"


def test_a_list_in_a_submission_is_nobodys_word(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where results lie in a student's folder, a list that lies there adds nobody."""
    recordings = results / "solution" / result_folder.RECORDINGS
    record = read_submission(recordings)
    record.source = str(tmp_path)
    write_submission(recordings, record)
    (results / result_folder.CLASS_LIST_FILE).write_text("name\nnobody\n", encoding="utf-8")
    run(capsys, results)
    assert "nobody" not in grades(results)


def test_a_list_adds_ids_and_who_is_missing(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A student without a submission is listed, and needs attention."""
    roster = tmp_path / "class.csv"
    roster.write_text("name,student_id\nsolution,007\nnobody,8\n", encoding="utf-8")
    _, output, _ = run(capsys, results, "--class-list", roster)
    assert output.startswith("4 submissions, 3 graded, median 22 of 100; 1 needs attention.")
    table = grades(results)
    assert (
        table["solution"]["student_id"],
        table["nobody"]["total"],
        table["nobody"]["needs"],
    ) == (
        "007",
        "",
        "not graded",
    )


def test_no_name_is_in_an_anonymous_page_or_table(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both are written under pseudonyms, beside the real page and the grade book, which stay as they are."""
    run(capsys, results)
    main(["export", str(results), "--to=moodle"])
    capsys.readouterr()
    real = {path: path.read_bytes() for path in results.rglob("*") if path.is_file()}
    status, output, _ = run(capsys, results, "--anonymous")
    assert status == 0
    with (results / "grades-anonymous.csv").open(encoding="utf-8-sig", newline="") as stream:
        assert [row["submission"] for row in csv.DictReader(stream)] == [
            "Student 01",
            "Student 02",
            "Student 03",
        ]
    for name in ("index-anonymous.html", "grades-anonymous.csv"):
        assert str(results / name) in output
        text = (results / name).read_text(encoding="utf-8")
        assert "wrong_topic" not in text
        assert "best_effort_publisher" not in text
    assert {path: path.read_bytes() for path in real} == real


def test_results_of_two_labs_are_not_summed_up(
    results: Path, rubric: Rubric, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which is of another is named, and nothing is written."""
    other = rubric.text.replace('id: "09-01"', 'id: "other"')
    (results / "wrong_topic" / result_folder.RECORDINGS / result_folder.RUBRIC_COPY).write_text(
        other, encoding="utf-8"
    )
    status, _, errors = run(capsys, results)
    assert status == 2
    assert (
        f"{results / 'wrong_topic'}: these are results of Lab other, and the rubric is of Lab 09-01"
        in errors
    )
    assert not (results / result_folder.CLASS_PAGE).exists()


def test_results_of_one_submission_are_no_class(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Results of one submission are refused, because they have a page already."""
    status, _, errors = run(capsys, results / "solution")
    assert status == 3
    assert "These are the results of one submission; its page is report.html." in errors


def test_the_rubric_is_that_of_most(
    results: Path, tmp_path: Path, rubric: Rubric, capsys: pytest.CaptureFixture[str]
) -> None:
    """One judged by another rubric is told; with that rubric given, the two others are."""
    other = tmp_path / "other.yaml"
    other.write_text(rubric.text + "\n# Changed since.\n", encoding="utf-8")
    shutil.copy(other, results / "solution" / result_folder.RECORDINGS / result_folder.RUBRIC_COPY)
    judge_results(results / "solution", rubrics.read_rubric(other))
    run(capsys, results)
    assert {name: row["needs"] for name, row in grades(results).items() if row["needs"]} == {
        "solution": "other rubric"
    }
    run(capsys, results, "--rubric", other)
    assert [name for name, row in grades(results).items() if row["needs"]] == [
        "best_effort_publisher",
        "wrong_topic",
    ]


def test_the_rubric_is_the_one_that_was_applied_last(
    results: Path, tmp_path: Path, rubric: Rubric, capsys: pytest.CaptureFixture[str]
) -> None:
    """After a new rubric was applied to the class, the page is made by it without naming it again."""
    new = tmp_path / "new.yaml"
    new.write_text(
        rubric.text.replace("title: Commands arrive at 100 Hz", "title: Commands are quick")
    )
    assert main(["regrade", str(results), "--rubric", str(new), "--apply"]) == 0
    run(capsys, results)
    assert not [name for name, row in grades(results).items() if row["needs"] == "other rubric"]
    page = (results / result_folder.CLASS_PAGE).read_text(encoding="utf-8")
    assert "Commands are quick" in page
    assert "Commands arrive at 100 Hz" not in page


@pytest.mark.parametrize("there", [False, True])
def test_a_folder_without_results_is_refused(
    there: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No page over nobody is written where somebody gave the wrong folder."""
    folder = tmp_path / "empty"
    if there:
        (folder / "notes").mkdir(parents=True)
    status, _, errors = run(capsys, folder)
    assert status == 3
    assert (
        "there are no results of submissions in it" if there else "there is no such folder"
    ) in errors
    assert not (folder / "index.html").exists()


def test_a_wrong_list_is_refused_before_anything_is_written(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A list that is none ends with 3, and says why."""
    (tmp_path / "class.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    status, _, errors = run(capsys, results, "--class-list", tmp_path / "class.csv")
    assert status == 3
    assert "no column 'name'" in errors
    assert not (results / result_folder.CLASS_PAGE).exists()


# -- what changed ------------------------------------------------------------------------------


def test_a_resubmission_says_what_was_won_and_lost(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The result before is kept with the recordings: the report and the class page compare with it, each time alike."""
    before = (results / "wrong_topic" / result_folder.RESULT_FILE).read_text(encoding="utf-8")
    earlier = results / "solution" / result_folder.RECORDINGS / result_folder.EARLIER_FILE
    earlier.write_text(before, encoding="utf-8")
    regraded(results / "solution")
    report = (results / "solution" / result_folder.REPORT_FILE).read_text(encoding="utf-8")
    assert "Changes since your previous submission" in report
    assert "→ 100 points" in report
    assert re.search(r'Won</b> [^\n]*<a href="#check-publisher\.\w+">[^<]+</a> \+\d', report)
    regraded(results / "solution")
    assert (results / "solution" / result_folder.REPORT_FILE).read_text(encoding="utf-8") == report
    assert "since your previous" not in (
        results / "wrong_topic" / result_folder.REPORT_FILE
    ).read_text(encoding="utf-8")
    assert run(capsys, results)[0] == 0
    page = (results / result_folder.CLASS_PAGE).read_text(encoding="utf-8")
    assert "1 submission has a result of before: 1 with more points now" in page
    assert run(capsys, results, "--anonymous")[0] == 0
    assert "What changed" not in (results / result_folder.ANONYMOUS_PAGE).read_text(
        encoding="utf-8"
    )


def test_two_runs_over_a_class_are_compared(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--before` names the results of another run, and students are found there by their names."""
    other = tmp_path / "first due date"
    shutil.copytree(results, other)
    shutil.copy(other / "wrong_topic" / result_folder.RESULT_FILE, other / "solution")
    shutil.rmtree(other / "best_effort_publisher")
    assert run(capsys, results, "--before", other)[0] == 0
    page = (results / result_folder.CLASS_PAGE).read_text(encoding="utf-8")
    assert (
        "2 submissions have a result of before: 1 with more points now, 0 with fewer, 1 with as many"
        in page
    )
    status, _, said = run(capsys, results, "--before", tmp_path / "nowhere")
    assert status == 3
    assert "no such folder" in said
