"""Refusal to grade other things: a misspelt command, results, and results of another lab."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from grader.cli import main
from grader.commands.grade import is_results
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.result_folder import RECORDINGS, RUBRIC_COPY

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

ROOT = Path(__file__).resolve().parents[2]


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str]:
    """Run the command in this process; returns exit status and errors."""
    status = main([str(argument) for argument in arguments])
    return status, capsys.readouterr().err


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Give results of a class of two."""
    for name in ("ann", "bob"):
        recordings = tmp_path / "results" / name / RECORDINGS
        shutil.copytree(ROOT / "tests/recordings/missing_service_file", recordings)
        shutil.copy(lab_folder() / "rubric.yaml", recordings / RUBRIC_COPY)
    (tmp_path / "results/history/ann").mkdir(parents=True)
    return tmp_path / "results"


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["regard", "submissions/alice"], "regrade"),
        (["exprot", "results/alice", "--fail-under", "1"], "export"),
        (["submissions/alice", "selftets"], "selftest"),
        (["--seed", "3", "regrade", "results/alice"], "regrade"),
    ],
)
def test_a_misspelt_command_grades_nothing(
    arguments: list[str], meant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A misspelt command is wrong usage, wherever it stands, and the command is named."""
    status, errors = run(capsys, *arguments, "-o", tmp_path / "out")
    assert status == 2
    assert f"If you mean the command, put it first: grade {meant}" in errors
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [[], ["--one"], ["--each"]])
def test_results_are_not_graded(
    more: list[str], results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Results of a submission or a class are not graded; the commands for them are named."""
    status, errors = run(capsys, results / "ann", *more, "-o", results.parent / "out")
    assert (status, f"`grade regrade {results / 'ann'}` judges them again" in errors) == (2, True)
    assert "grade report" not in errors
    status, errors = run(capsys, results, *more, "-o", results.parent / "out")
    assert (status, f"`grade regrade {results}` judges them again" in errors) == (2, True)
    assert f"`grade report {results}` writes the class page" in errors
    assert not (results.parent / "out").exists()


@pytest.mark.parametrize(
    "place", ["ann/src/joint_publisher.py", "eve/joint_publisher.py", "eve.zip"]
)
def test_submissions_beside_results_are_submissions(results: Path, place: str) -> None:
    """A folder with recordings and the lab's files, or beside other submissions, is graded."""
    assert is_results(results, read_rubric(None))
    (results / place).parent.mkdir(exist_ok=True)
    (results / place).touch()
    assert not is_results(results, read_rubric(None))


def test_results_of_two_labs_are_parted(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where results of another lab lie nothing is graded, and nothing written."""
    copy = results / "bob" / RECORDINGS / RUBRIC_COPY
    copy.write_text(
        copy.read_text(encoding="utf-8").replace('id: "09-01"', 'id: "other"'), encoding="utf-8"
    )
    before = sorted(results.rglob("*"))
    status, errors = run(capsys, ROOT / "submissions/alice", "-o", results)
    assert status == 2
    assert (
        f"{results / 'bob'}: these are results of Lab other, and the rubric is of Lab 09-01"
        in errors
    )
    assert "Name another folder for these results with -o." in errors
    assert sorted(results.rglob("*")) == before
