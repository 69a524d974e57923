"""The scripts for CI systems, run as the systems run them, on a submission that would steer them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from grader.judging.rubrics import read_rubric
from tests.report.exports.sample_results import VARIABLES
from tests.report.exports.test_gradescope import SCHEMA
from tests.report.runner_commands import Command, bracket_command, colon_command

ROOT = Path(__file__).resolve().parents[2]
GRADE = Path(sys.executable).with_name("grade")
#: Message of the student's service; printed, and shown in the proof of lost points.
EVIL = "::error file=x::pwned ##[error]pwned <b>`@pwned|"
LIMIT_S = 180
#: Checks that are judged if only this session is run.
CHECKS = [check for check in read_rubric(None).checks() if check.session in (None, "service")]
POSSIBLE = sum(check.points for check in CHECKS)

pytestmark = pytest.mark.live
by_root = pytest.mark.skipif(os.geteuid() != 0, reason="others ask sudo for a password")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Give a student's checkout, with links where the scripts write, and a module that must not be imported."""
    folder = tmp_path / "ann"
    shutil.copytree(
        ROOT / "submissions/alice", folder, ignore=shutil.ignore_patterns("__pycache__")
    )
    service = folder / "robot_service.py"
    text = service.read_text(encoding="utf-8")
    assert "Robot enabled" in text
    service.write_text(text.replace("Robot enabled", EVIL), encoding="utf-8")
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim/file").write_text("mine", encoding="utf-8")
    (folder / "grade").symlink_to(tmp_path / "victim")
    for name in ("result.json", "report.html", "release-body.md"):
        (folder / name).symlink_to(tmp_path / "victim/file")
    (folder / "json.py").write_text(
        "raise SystemExit('imported from the submission')\n", encoding="utf-8"
    )
    return folder


def run(
    checkout: Path, command: list[str | Path], **variables: str | Path
) -> subprocess.CompletedProcess[str]:
    """Run a script in the checkout; the victim must be as it was."""
    environment = {
        **os.environ,
        "GRADE": str(GRADE),
        **{name: str(value) for name, value in variables.items()},
    }
    done = subprocess.run(
        command,
        cwd=checkout,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    victim = checkout.parent / "victim"
    assert [path.name for path in victim.iterdir()] == ["file"]
    assert (victim / "file").read_text(encoding="utf-8") == "mine"
    return done


GITHUB_SCRIPT: list[str | Path] = ["bash", ROOT / "ci/github/grade.sh"]


def variables_of_github(summary: Path, outputs: Path, results: Path) -> dict[str, str | Path]:
    """Return the action's variables, except the submission and the least score."""
    told = {"GITHUB_STEP_SUMMARY": summary, "GITHUB_OUTPUT": outputs, "RESULTS": results}
    return {"RUBRIC": "", "SESSIONS": "service", "REQUIRE_ISOLATION": "reduced", **told}


def leave_results_of_another_lab(results: Path) -> None:
    """Leave the files of an earlier step of the same job that graded another lab."""
    score = {"final": 1, "possible": 2, "undecided": 0}
    (results / "aaa").mkdir(parents=True)
    (results / "aaa/result.json").write_text(json.dumps({"score": score}), encoding="utf-8")


@by_root
def test_github_has_no_score_of_another_lab(checkout: Path, tmp_path: Path) -> None:
    """A step that can grade nothing does not repeat the outputs of the previous step."""
    summary, outputs, results = tmp_path / "summary.md", tmp_path / "outputs", tmp_path / "results"
    leave_results_of_another_lab(results)
    variables = variables_of_github(summary, outputs, results)
    done = run(checkout, GITHUB_SCRIPT, SUBMISSION="absent", FAIL_UNDER="", **variables)
    assert done.returncode == 3, done.stdout + done.stderr
    assert "::error::The submission could not be graded" in done.stdout
    assert not outputs.exists()


def own_commands(log: str) -> list[Command]:
    """Return the commands in a log after the student's output; fails if that output holds any."""
    lines = log.splitlines()
    assert not [line for line in lines if bracket_command(line)]
    stop, resume, *ours = [command for line in lines if (command := colon_command(line))]
    assert (stop.name, stop.data) == ("stop-commands", resume.name)
    assert {command.name for command in ours} <= {"warning", "error", "notice"}
    return ours


@by_root
@pytest.mark.parametrize(("least", "status"), [("", 0), ("50", 1)])
def test_github(checkout: Path, tmp_path: Path, least: str, status: int) -> None:
    """Summary, annotations and outputs are written; the log obeys no one but us; only --fail-under fails the job."""
    summary, outputs, results = tmp_path / "summary.md", tmp_path / "outputs", tmp_path / "results"
    leave_results_of_another_lab(results)
    variables = variables_of_github(summary, outputs, results)
    done = run(checkout, GITHUB_SCRIPT, SUBMISSION=".", FAIL_UNDER=least, **variables)
    assert done.returncode == status, done.stdout + done.stderr
    assert "# Lab 09-01" in summary.read_text(encoding="utf-8")
    score = json.loads((results / "ann/result.json").read_text(encoding="utf-8"))["score"]
    told = f"score={score['final']:g}\npossible={float(POSSIBLE):g}\nundecided={score['undecided']:g}\n"
    assert outputs.read_text(encoding="utf-8") == told
    assert (results / "ann/report.html").exists()
    assert (results / "ann/recordings/service").is_dir()
    assert "pwned" in done.stdout
    ours = own_commands(done.stdout)
    titles = [command.properties.get("title", "") for command in ours]
    assert any(title.startswith("Refuses while safety is off") for title in titles)
    assert (ours[-1].data == "The score is below 50 points.") == (status == 1)


def test_gitlab(checkout: Path) -> None:
    """Report, recordings and both report files are in the checkout, in a folder that replaced the student's link."""
    done = run(
        checkout,
        ["bash", ROOT / "ci/gitlab/grade.sh"],
        SUBMISSION=".",
        SESSIONS="service",
        REQUIRE_ISOLATION="reduced",
        CI_PROJECT_DIR=checkout,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    kept = checkout / "grade"
    assert not kept.is_symlink()
    assert {"junit.xml", "codequality.json", "report.html", "result.json", "recordings"} == {
        path.name for path in kept.iterdir()
    }


def test_gradescope(checkout: Path, tmp_path: Path) -> None:
    """Results are where Gradescope reads them."""
    autograder = tmp_path / "autograder"
    (autograder / "results").mkdir(parents=True)
    shutil.copytree(checkout, autograder / "submission", symlinks=True)
    done = run(
        checkout,
        [ROOT / "ci/gradescope/run_autograder"],
        AUTOGRADER=autograder,
        GRADE_OPTIONS="--sessions service",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    data = json.loads((autograder / "results/results.json").read_text(encoding="utf-8"))
    assert len(data["tests"]) == len(CHECKS)
    for test in data["tests"]:
        assert "score" in test
    assert 0 < data["score"] < POSSIBLE


def test_gradescope_without_a_score(tmp_path: Path) -> None:
    """The reason is said in a file that Gradescope takes: each test has a score, of 0 of 0 points."""
    autograder = tmp_path / "autograder"
    (autograder / "results").mkdir(parents=True)
    (autograder / "submission").mkdir()
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim/file").write_text("mine", encoding="utf-8")
    done = run(autograder, [ROOT / "ci/gradescope/run_autograder"], AUTOGRADER=autograder)
    assert done.returncode == 0, done.stdout + done.stderr
    data = json.loads((autograder / "results/results.json").read_text(encoding="utf-8"))
    jsonschema.validate(data, SCHEMA)
    (test,) = data["tests"]
    assert (test["score"], test["max_score"], test["status"]) == (0, 0, "failed")
    assert "submission is empty" in test["output"]
    assert "Not graded: this is not a score of 0." in data["output"]
    assert data["extra_data"] == {"graded": False}


@by_root
def test_classroom50(checkout: Path) -> None:
    """The result and the texts of the release are in the checkout, as files of their own."""
    done = run(
        checkout,
        [sys.executable, ROOT / "ci/classroom50/autograder.py"],
        GRADE_OPTIONS="--sessions service --require-isolation reduced",
        **VARIABLES,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    data = json.loads((checkout / "result.json").read_text(encoding="utf-8"))
    assert data["schema"] == "classroom50/result/v1"
    assert (len(data["tests"]), data["max-score"]) == (len(CHECKS), POSSIBLE)
    for name in ("result.json", "report.html", "release-body.md"):
        assert not (checkout / name).is_symlink()
    assert "# Lab 09-01" in (checkout / "release-body.md").read_text(encoding="utf-8")
