"""The check of a ROS package, by recorded builds."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import pytest

from grader.checks.package import build_cause
from grader.recording.submission import BuildFact, PackageFact, SubmissionRecord
from grader.result import Finding, Outcome
from grader.submission.packages.colcon import find_packages
from tests.ros_packages import PACKAGE
from tests.synthetic import judged, submission

INSTALLED = [
    "lib/lab/talker",
    "lib/python3.11/site-packages/lab/talker.py",
    "share/ament_index/resource_index/packages/lab",
    "share/lab/hook/ament_prefix_path.dsv",
    "share/lab/launch/lab.launch.py",
    "share/lab/package.xml",
]
ALL: dict[str, Any] = {"executables": ["talker"], "files": ["launch/*.py"]}


def handed_in(files: dict[str, str] | None = None, **build: Any) -> SubmissionRecord:
    """Give a submission with a package and its build."""
    record = submission({**PACKAGE, **(files or {})})
    record.packages = find_packages(record.texts, list(record.texts))
    build = {"outcome": "built", "installed": INSTALLED, **build}
    record.builds = [BuildFact("lab", "", **build)]
    return record


def found(record: SubmissionRecord, **parameters: Any) -> Finding:
    """Judge a submission."""
    return judged("package_builds", {**ALL, **parameters}, None, record)


def test_a_correct_package_earns_all() -> None:
    """All parts are there."""
    assert found(handed_in()).outcome is Outcome.PASSED


@pytest.mark.parametrize(
    ("build", "credit", "words"),
    [
        (
            {"outcome": "failed", "output": "error: package directory 'x' does not exist"},
            "0.2",
            "'x'",
        ),
        ({"outcome": "ignored"}, "0.2", "does not find"),
        ({"installed": ["bin/talker", *INSTALLED[1:]]}, "0.8", "in bin"),
        ({"installed": INSTALLED[1:]}, "0.8", "installs no executable talker"),
        ({"installed": [*INSTALLED[:4], INSTALLED[5]]}, "0.9", "does not install launch/*.py"),
        ({"output": "doesn't explicitly install a marker"}, "0.9", "marker"),
        ({"without_interpreter": ["lib/lab/talker"]}, "0.8", "Exec format error"),
    ],
)
def test_each_part_costs_its_weight(build: dict[str, Any], credit: str, words: str) -> None:
    """A build that fails costs all parts that depend on it; each other part costs its own."""
    finding = found(handed_in(**build))
    assert finding.credit == Decimal(credit)
    assert words in finding.reason
    assert finding.hint


def test_a_package_that_was_put_aside_does_not_count() -> None:
    """A package beside COLCON_IGNORE is judged only by its name."""
    record = handed_in({"old/COLCON_IGNORE": ""})
    record.packages.append(PackageFact("old", "old", "ament_python"))
    assert record.builds is not None
    record.builds.append(BuildFact("old", "old", "ignored"))
    assert found(record).outcome is Outcome.PASSED
    assert found(record, package="old").outcome is not Outcome.PASSED


def test_undeclared_dependencies_and_made_folders_cost_a_part() -> None:
    """package.xml declares the imports, and nothing is handed in that colcon makes."""
    record = handed_in({"lab/talker.py": "import rclpy\nfrom std_msgs.msg import String as main\n"})
    record.left_out = ["build/: made by a tool"]
    finding = found(record)
    assert finding.credit == Decimal("0.8")
    assert "imports std_msgs" in finding.reason
    assert "holds build" in finding.reason
    assert found(record, declares=0, clean=0).outcome is Outcome.PASSED


def test_no_package_and_another_package_fail() -> None:
    """The package that the lab asks for must be there."""
    bare = found(submission({"talker.py": ""}))
    assert (bare.outcome, "There is no package" in bare.reason) == (Outcome.FAILED, True)
    other = found(handed_in(), package="other")
    assert "There is no package other" in other.reason


@pytest.mark.parametrize("reason", ["", "the grading computer lacks ament_cmake"])
def test_what_cannot_be_built_here_is_undecided(reason: str) -> None:
    """A machine without colcon, or without a tool of the package, costs nothing; no retry helps."""
    record = handed_in(outcome="not built", reason=reason)
    if not reason:
        record.builds = None
    finding = found(record)
    assert (finding.outcome, finding.retry) == (Outcome.INCONCLUSIVE, False)
    assert "Your instructor decides" in finding.reason


def test_a_failed_build_has_a_cause_for_other_checks() -> None:
    """A launch file that needs the package is not charged again."""
    record = handed_in(outcome="failed", output="error: x")
    assert build_cause(record.packages[0]) in found(record).causes
