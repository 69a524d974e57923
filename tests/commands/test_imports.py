"""Modules that commands load: a start costs CPU time, and a class or a page starts many."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from grader.commands import COMMANDS
from grader.judging.rubrics import read_rubric
from tests.regraded import judge_results

ROOT = Path(__file__).resolve().parents[2]
#: Modules of the live half, of the review desk, of a class, and parts of libraries.
NOT_FOR_REGRADING = {
    "rclpy", "asyncio", "subprocess", "scipy", "mujoco", "colcon_core", "grader.live", "confine.running",
    "starlette", "uvicorn", "grader.desk",
    "dateparser", "dulwich", "distributed", "rich.progress", "grader.cohort.statistics", "statistics",
    "rosbags.typesys.stores.ros2_jazzy", "rosbags.highlevel", "lz4", "jsonschema",
}  # fmt: skip
#: Modules of the judging half. Each grading starts a process that imports a session.
NOT_FOR_SESSIONS = {
    "grader.lab.rubric", "grader.result", "grader.evidence.recorded", "grader.submission.artifacts", "grader.checks",
    "rclpy",
}  # fmt: skip
#: Modules for rubrics and results.
NOT_FOR_HELP = {"pydantic", "yaml", "numpy", "grader.result", "grader.lab.rubric"}
#: Commands with results, or with the names of all checks, in their help.
KNOWING_MORE = {"export", "checks", "steps", "figures"}
#: Forms for other systems; few gradings write one.
FORMS = {f"grader.report.exports.{name}" for name in ("junit", "gradebooks", "feedback", "mail")}


def loaded_by(*arguments: str) -> set[str]:
    """Return the modules that a command and its forks load."""
    return loaded("-m", "grader.cli", *arguments)


def loaded(*arguments: str) -> set[str]:
    """Return the modules that Python loads with some arguments."""
    command = [sys.executable, "-X", "importtime", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 0, ended.stderr
    lines = [line for line in ended.stderr.splitlines() if line.startswith("import time:")]
    return {line.rpartition("|")[2].strip() for line in lines}


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Return the results of a solution."""
    folder = tmp_path / "solution"
    shutil.copytree(ROOT / "tests/recordings/solution", folder / "recordings")
    judge_results(folder, read_rubric(None))
    return folder


def test_regrading_loads_only_modules_that_it_needs(results: Path) -> None:
    """Judging a submission again needs neither the live half nor a class."""
    assert not loaded_by("regrade", str(results)) & NOT_FOR_REGRADING


def test_a_session_loads_nothing_of_judging() -> None:
    """One constant from a module of the judging half would load all imports of the module."""
    assert not loaded("-c", "import grader.live.session.session") & NOT_FOR_SESSIONS


@pytest.mark.parametrize("command", ["", *sorted(set(COMMANDS) - KNOWING_MORE)])
def test_help_loads_nothing_of_rubrics_and_results(command: str) -> None:
    """Models of pydantic would take most of the time."""
    assert not loaded_by(*command.split(), "--help") & NOT_FOR_HELP


def test_grading_loads_forms_when_it_writes_them() -> None:
    """The names of forms are known without their modules."""
    assert not loaded("-m", "grader.cli", "--help") & FORMS
