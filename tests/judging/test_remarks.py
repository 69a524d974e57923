"""Remarks that cost nothing, about settings of the session, prefixes of launch files and builds of packages."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.judging.remarks import advisories_of
from grader.recording.session import SESSION_VARIABLE, Claim
from grader.recording.submission import BuildFact, PackageFact, SubmissionRecord
from grader.result import CheckResult, CriterionResult, Outcome
from launch_plan.format import SCHEMA
from tests.synthetic import Session, submission


def _process(id_: str, **facts: object) -> dict[str, object]:
    return {"id": id_, "path": f"/lib/{id_}", "file": "it.launch.py", "line": 4, **facts}


def test_a_prefix_that_was_left_out_is_named_with_its_line(tmp_path: Path) -> None:
    """The step of the start has the prefix, the plan its place."""
    made = Session(tmp_path).process("xterm-1")
    made.record.plan = {"schema": SCHEMA, "outcome": "ok", "processes": [_process("xterm-1")]}
    made.step("start", "start", processes=["xterm-1"], without_prefix={"xterm-1": "xterm -e"})
    (remark,) = advisories_of([made.recorded()], submission(), [])
    assert remark.startswith("it.launch.py, line 4 starts xterm-1 by the prefix `xterm -e`.")
    assert remark.endswith("That costs no points.")


def test_a_setting_of_the_session_is_named_once(tmp_path: Path) -> None:
    """Only a domain can cost points; its remark promises nothing."""
    made = Session(tmp_path).process()
    for name, value in (("RMW_IMPLEMENTATION", "rmw_x"), ("ROS_DOMAIN_ID", "7")) * 2:
        claim = Claim("it", SESSION_VARIABLE, name, file="it.py", line=3, value=value)
        made.record.claims.append(claim)
    rmw, domain = advisories_of([made.recorded()], submission(), [])
    assert rmw.startswith("it.py, line 3 sets RMW_IMPLEMENTATION to rmw_x.")
    assert rmw.endswith("That costs no points.")
    assert domain.startswith("it.py, line 3 sets ROS_DOMAIN_ID to 7.")
    assert "costs no points" not in domain


def charged(reason: str) -> CriterionResult:
    """Return a criterion with one failed check."""
    none = Decimal(0)
    check = CheckResult("a", "A", Outcome.FAILED, none, none, none, reason=reason)
    return CriterionResult("c", "C", none, none, none, (check,))


def test_a_domain_named_by_a_check_is_no_remark(tmp_path: Path) -> None:
    """The check charges it, and remarks stand under the words `None of this costs points`."""
    claim = Claim("it", SESSION_VARIABLE, "ROS_DOMAIN_ID", file="it.py", line=3, value="7")
    made = Session(tmp_path).process()
    made.record.claims.append(claim)
    criterion = charged("it.py, line 3 chooses the ROS domain 7.")
    assert advisories_of([made.recorded()], submission(), [criterion]) == ()
    assert advisories_of([made.recorded()], submission(), [charged("It is slow.")]) != ()


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
    criterion = charged(f"{fault} More.")
    assert advisories_of((), record, [criterion]) == ()
