"""Remarks about packages by their builds."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import pytest

from grader.judging.remarks import advisories_of
from grader.recording.submission import BuildFact, PackageFact, SubmissionRecord
from grader.result import CheckResult, CriterionResult, Outcome
from tests.synthetic import submission


def handed_in(**build: Any) -> SubmissionRecord:
    """Give a submission with a package and its build."""
    record = submission()
    record.packages = [PackageFact("arm", "arm", "ament_python")]
    record.builds = [BuildFact("arm", "arm", **build)]
    return record


@pytest.mark.parametrize(
    ("build", "words"),
    [
        ({"outcome": "failed", "output": "error: package directory 'x' does not exist"}, "'x'"),
        ({"outcome": "built", "installed": ["bin/talker"]}, "setup.cfg"),
        ({"outcome": "built", "installed": ["lib/arm/talker"]}, ""),
        ({"outcome": "not built", "reason": "no tool"}, ""),
    ],
)
def test_a_package_that_ros_cannot_use_is_a_remark(build: dict[str, Any], words: str) -> None:
    """A lab without a check of packages shows the fault, with its remedy."""
    found = advisories_of((), handed_in(**build), ())
    assert bool(found) == bool(words)
    assert all(words in remark for remark in found)


def test_a_fault_that_a_check_names_is_no_remark() -> None:
    """A fault stands once in a report."""
    record = handed_in(outcome="built", installed=["bin/talker"])
    (remark,) = advisories_of((), record, ())
    fault = remark.partition(" Write in")[0]
    none = Decimal(0)
    check = CheckResult(
        "a",
        "A",
        Outcome.FAILED,
        earned=none,
        possible=none,
        undecided=none,
        reason=f"{fault} More.",
    )
    criterion = CriterionResult("c", "C", none, none, none, (check,))
    assert advisories_of((), record, [criterion]) == ()
