"""Jobs of CI systems as they are there: an account with a password-less sudo, which lowers limits for its commands."""

from __future__ import annotations

import json
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.live.accounts import ROOT, run_with_sudo
from tests.live.surroundings import Remains
from tests.report.exports.sample_results import VARIABLES

GRADE = Path(sys.executable).with_name("grade")

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(
        None in (shutil.which("sudo"), shutil.which("useradd")),
        reason="needs the packages sudo and passwd",
    ),
    pytest.mark.skipif(
        os.geteuid() != 0,
        reason="only root can make an account",
    ),
]


@dataclass(frozen=True)
class Job:
    """A job's working folder, with one submission in it."""

    folder: Path

    @property
    def results(self) -> Path:
        """The folder for results, which is outside of the checkout."""
        return self.folder / "temp/grade-results"

    def submission(self, name: str, kind: str) -> Path:
        """Lay out a good, a broken or an empty submission."""
        place = self.folder / name
        if kind == "empty":
            place.mkdir()
            return place
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "submissions/alice", place, ignore=ignored)
        if kind == "broken":
            for program in place.glob("*.py"):
                program.write_text("def main(:\n", encoding="utf-8")
        return place

    def run_github(self, submission: str) -> Remains:
        """Run the commands of action.yml after the installation."""
        (self.folder / "temp").mkdir()
        variables: dict[str, str | Path] = {
            "GRADE": GRADE,
            "SUBMISSION": submission,
            "RUBRIC": "",
            "SESSIONS": "service",
            "FAIL_UNDER": "",
            "REQUIRE_ISOLATION": "no-cgroup",
            "RESULTS": self.results,
            "GITHUB_STEP_SUMMARY": self.folder / "temp/summary.md",
            "GITHUB_OUTPUT": self.folder / "temp/outputs",
        }
        return run_with_sudo(self.folder, ["bash", ROOT / "ci/github/grade.sh"], variables)


@pytest.fixture
def job(tmp_path: Path) -> Job:
    """Give a folder for a job."""
    (tmp_path / "job").mkdir()
    return Job(tmp_path / "job")


def test_doctor(job: Job) -> None:
    """Under sudo, where no core file may be written, namespaces are available."""
    tried = f"ulimit -Hc; exec {GRADE} doctor"
    remains = run_with_sudo(job.folder, ["sudo", "--", "bash", "-c", tried], {})
    limit, *lines = remains.output.splitlines()
    assert limit == "0", "this sudo does not do what the test is about"
    assert "PASS    namespaces: network, processes, mounts: as root" in "\n".join(lines)
    assert not [line for line in lines if line.startswith("FAIL")]
    assert remains.exit_status == 0


@pytest.mark.parametrize(("name", "kind"), [("lab", "good"), ("report", "broken")])
def test_github(name: str, kind: str, job: Job) -> None:
    """A submission is graded, whatever its folder is called, and the files belong to the account."""
    job.submission(name, kind)
    remains = job.run_github(name)
    assert remains.exit_status == 0, remains.output + remains.errors
    result = json.loads((job.results / name / "result.json").read_text(encoding="utf-8"))
    assert (result["score"]["final"] > 20) == (kind == "good")
    outputs = (job.folder / "temp/outputs").read_text(encoding="utf-8")
    assert outputs.startswith(f"score={result['score']['final']:g}\n")
    assert "# Lab 09-01" in (job.folder / "temp/summary.md").read_text(encoding="utf-8")
    owners = {path.stat().st_uid for path in job.results.rglob("*")}
    assert owners == {job.folder.stat().st_uid}


def test_github_with_an_empty_submission(job: Job) -> None:
    """An empty submission has no score, and the job fails with the right status and message."""
    job.submission("review", "empty")
    remains = job.run_github("review")
    assert remains.exit_status == 3, remains.output + remains.errors
    assert "the submission is empty" in remains.errors
    assert "::error::The submission could not be graded" in remains.output
    assert not (job.folder / "temp/outputs").exists()


@pytest.mark.parametrize("kind", ["good", "empty"])
def test_classroom50(kind: str, job: Job) -> None:
    """Its autograder hands over a result, or ends with the status of a submission that is none."""
    checkout = job.submission("play", kind)
    variables: dict[str, str | Path] = {"GRADE": GRADE, **VARIABLES}
    variables["GRADE_OPTIONS"] = "--sessions service"
    script: list[str | Path] = [sys.executable, ROOT / "ci/classroom50/autograder.py"]
    remains = run_with_sudo(checkout, script, variables)
    if kind == "empty":
        assert remains.exit_status == 3, remains.output + remains.errors
        assert not (checkout / "result.json").exists()
        return
    assert remains.exit_status == 0, remains.output + remains.errors
    result = json.loads((checkout / "result.json").read_text(encoding="utf-8"))
    assert result["schema"] == "classroom50/result/v1"
