"""One live grading with a known score: the reference solution of Lab 09-01."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from tests.live.sample import ROOT, grade

pytestmark = [pytest.mark.live, pytest.mark.smoke]


def test_the_solution_loses_nothing(tmp_path: Path) -> None:
    """The reference solution earns every point that a busy machine does not leave undecided."""
    submission = tmp_path / "submission"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "reference/solution", submission, ignore=ignored)
    run = grade(submission, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    result = json.loads((tmp_path / "results/submission/result.json").read_text(encoding="utf-8"))
    score = result["score"]
    assert score["earned"] + score["undecided"] == 100
    assert score["earned"] > 80
