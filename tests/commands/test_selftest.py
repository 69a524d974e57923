"""`grade selftest`: its choice of fixtures, its words for a difference, and its exit statuses."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from grader.classroom.journal import Journal
from grader.cli import main
from grader.lab.kept_lab import lab_folder

ROOT = Path(__file__).resolve().parents[2]


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output with single spaces, and errors."""
    try:
        status = main(["selftest", *map(str, arguments)])
    except SystemExit as end:  # argparse
        status = int(end.code or 0)
    captured = capsys.readouterr()
    return status, " ".join(captured.out.split()), captured.err


@pytest.fixture
def fixtures(tmp_path: Path) -> Path:
    """Write a folder of fixtures that need no session: one as expected, one that expects too much."""
    for name, outcome in (("good", "failed"), ("bad", "passed")):
        (tmp_path / "fixtures" / name / "submission").mkdir(parents=True)
        (tmp_path / "fixtures" / name / "submission/joint_publisher.py").write_text(
            "import rclpy\n"
        )
        text = "about: a\nsessions: []\ncriteria:\n  documentation:\n    checks:\n"
        for check in ("readme", "code"):
            text += f"      documentation.{check}: {{outcome: {outcome if check == 'readme' else 'failed'}}}\n"
        (tmp_path / "fixtures" / name / "expected.yaml").write_text(text)
    return tmp_path / "fixtures"


@pytest.mark.live
def test_each_fixture_is_compared(
    fixtures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A fixture as expected has a tick, another one shows its differences, and the status is 1."""
    pytest.importorskip("rclpy")
    status, output, _ = run(capsys, "--fixtures", fixtures, "good", "bad", "-o", tmp_path / "kept")
    assert status == 1
    assert "1 of 2 as expected" in output
    assert "bad • documentation.readme is failed, not passed" in output
    assert (tmp_path / "kept/bad/report.html").is_file()


@pytest.mark.live
def test_all_as_expected(fixtures: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The status is 0 if nothing differs."""
    pytest.importorskip("rclpy")
    status, output, _ = run(capsys, "--fixtures", fixtures, "good")
    assert status == 0
    assert "1 of 1 as expected" in output


@pytest.mark.live
def test_a_rubric_that_lost_a_check(
    fixtures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A check missing in the rubric is reported without running anything."""
    pytest.importorskip("rclpy")
    text = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8")
    (tmp_path / "new.yaml").write_text(
        text.replace("id: documentation.readme", "id: documentation.about")
    )
    status, output, _ = run(
        capsys, "--fixtures", fixtures, "--rubric", tmp_path / "new.yaml", "good"
    )
    assert status == 1
    assert "the rubric's criterion 'documentation' has no check 'documentation.readme'" in output


def test_fixtures_that_are_not_there(
    fixtures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unknown name is wrong usage; a folder without fixtures ends with 3; a broken one with 4."""
    status, _, errors = run(capsys, "--fixtures", fixtures, "god")
    assert (status, "there is no fixture 'god'; did you mean 'good'?" in errors) == (2, True)
    status, _, errors = run(capsys, "--fixtures", tmp_path / "none")
    assert (status, "there are no fixtures" in errors) == (3, True)
    (fixtures / "bad/expected.yaml").write_text("about: a\ncolour: red\n")
    status, _, errors = run(capsys, "--fixtures", fixtures)
    assert (status, "expected.yaml:2: colour: unknown key" in errors) == (4, True)


def test_what_is_there_is_tried(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder for fixtures that holds none yet does not keep the solution from being tried."""
    lab = tmp_path / "lab"
    assert main(["lab", "new", str(lab)]) == 0
    shutil.rmtree(lab / "fixtures/too_slow")
    (lab / "fixtures").mkdir(exist_ok=True)
    status, output, errors = run(capsys, "--lab", lab, "solutoin")
    assert (status, "did you mean 'solution'?" in errors) == (2, True)
    assert "Lab lab has no fixtures here" in output


def test_two_into_one_folder(
    fixtures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second run into the same folder is refused, and the first one's files stay."""
    pytest.importorskip("rclpy")
    laid_out = tmp_path / "kept/submissions/good/joint_publisher.py"
    laid_out.parent.mkdir(parents=True)
    laid_out.touch()
    with Journal.open(tmp_path / "kept"):
        status, _, errors = run(capsys, "--fixtures", fixtures, "good", "-o", tmp_path / "kept")
    assert (status, "another run of grade is writing to this results folder" in errors) == (
        70,
        True,
    )
    assert laid_out.exists()


@pytest.mark.live
def test_earlier_submissions_are_replaced(
    fixtures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file that a fixture no longer has is not laid out."""
    pytest.importorskip("rclpy")
    gone = tmp_path / "kept/submissions/good/robot_launch.py"
    gone.parent.mkdir(parents=True)
    gone.touch()
    status, _, _ = run(capsys, "--fixtures", fixtures, "good", "-o", tmp_path / "kept")
    assert (status, gone.exists(), (gone.parent / "joint_publisher.py").exists()) == (
        0,
        False,
        True,
    )


def test_another_lab_is_tried_with_its_own_fixtures(
    fixtures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another lab needs its own fixtures; a lab without any is refused.

    Fixtures of the grader's lab say nothing about it.
    """
    text = (
        (lab_folder() / "rubric.yaml")
        .read_text(encoding="utf-8")
        .replace('id: "09-01"', 'id: "other"')
    )
    shutil.copytree(
        lab_folder() / "reference",
        tmp_path / "reference",
        ignore=shutil.ignore_patterns("solution"),
    )
    (tmp_path / "rubric.yaml").write_text(text, encoding="utf-8")
    status, _, errors = run(capsys, "--rubric", tmp_path / "rubric.yaml", "goood")
    assert (status, "did you mean 'good'?" in errors) == (2, True)
    fixtures.rename(tmp_path / "elsewhere")
    status, output, errors = run(capsys, "--rubric", tmp_path / "rubric.yaml")
    assert (status, "there is nothing to grade" in errors) == (3, True)
    assert "Lab other has no fixtures here; name a folder of fixtures with --fixtures." in output
