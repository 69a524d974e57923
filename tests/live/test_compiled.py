"""Programs in C and C++: built by colcon, run as nodes of a session, and judged by the graph alone."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from confine.interpreters import OWN_INTERPRETER
from grader.live.builds import colcon
from grader.live.builds.build import can_build, lacking_compiler
from grader.live.sandbox.probing import probe_isolation
from tests.live.sample import ROOT, grade

pytestmark = pytest.mark.live

LAB = ROOT / "tests/compiled_lab"


class Graded(NamedTuple):
    """The score of a result, and its checks by their ids."""

    score: dict[str, float]
    checks: dict[str, dict[str, Any]]


@cache
def lacking() -> str:
    """Name the missing parts of a build in C; empty if this machine has all."""
    if not can_build(probe_isolation(OWN_INTERPRETER)):
        return colcon.lacking_builder() or "namespaces"
    return lacking_compiler()


def graded(name: str, folder: Path) -> Graded:
    """Grade a submission of the lab."""
    if lacking():
        pytest.skip(f"not here: {lacking()}")
    grade(LAB / "submissions" / name, "--lab", LAB, cwd=folder)
    text = (folder / "results" / name / "result.json").read_text(encoding="utf-8")
    result = json.loads(text)
    checks = {}
    for criterion in result["criteria"]:
        for check in criterion["checks"]:
            checks[check["id"]] = check
    return Graded(result["score"], checks)


def test_a_talker_in_c_earns_all_points(tmp_path: Path) -> None:
    """Topic, rate, QoS, service, package and launch file of a compiled node are judged without the tap."""
    score, checks = graded("correct", tmp_path)
    assert score["earned"] == score["possible"], checks


def test_a_crash_is_explained_by_its_signal(tmp_path: Path) -> None:
    """The signal and the last line of output explain why nothing was published; the launch file is not charged."""
    _, checks = graded("crashes", tmp_path)
    lost = {id_ for id_, check in checks.items() if check["outcome"] == "failed"}
    assert lost == {"talks.published", "talks.enable"}
    reason = checks["talks.published"]["reason"]
    assert "ended by signal 11 (segmentation fault) in main() at talker.c:8" in reason
    assert "'reads the first value'" in reason
    assert checks["launches.node"]["outcome"] == "excused"


def test_a_package_without_its_libraries_here_is_undecided(tmp_path: Path) -> None:
    """A package that needs rclcpp costs nothing, neither for its node nor for its launch file."""
    score, checks = graded("needs_rclcpp", tmp_path)
    assert score["undecided"] == score["possible"]
    for id_ in ("package.builds", "talks.published", "launches.loads"):
        assert checks[id_]["outcome"] == "inconclusive"
        assert "lacks the package rclcpp" in checks[id_]["reason"]
