"""Every fixture gets the verdict that its expected.yaml states, graded live on a real ROS graph."""

from __future__ import annotations

import fcntl
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from grader import pipeline
from grader.judging import judge, open_recordings
from grader.result import CheckResult, Outcome, Result
from grader.rubric import Rubric
from grader.submission import read_submission_folder

ROOT = Path(__file__).parents[2]
FIXTURES = sorted(path.parent for path in (ROOT / "fixtures").glob("*/expected.yaml"))


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return pipeline.read_rubric(None)


def lay_out(fixture: Path, expected: dict[str, Any], target: Path) -> Path:
    """Make the submission of a fixture: its own files over those that it builds on."""
    submission = target / fixture.name
    if "with_files_of" in expected:
        shutil.copytree(ROOT / expected["with_files_of"], submission, ignore=shutil.ignore_patterns("__pycache__"))
        for name in expected.get("without", []):
            (submission / name).unlink()
    if (fixture / "submission").is_dir():
        shutil.copytree(fixture / "submission", submission, dirs_exist_ok=True)
    return submission


def grade(submission: Path, results: Path, rubric: Rubric, sessions: list[str]) -> Result:
    """Record the sessions one after another, and judge them."""
    record = read_submission_folder(submission, rubric)
    record.sessions = sessions
    options = pipeline.Options(Path(sys.executable), sessions, jobs=1)
    pipeline.record(submission, record, rubric, results, options, lambda progress: None)
    return judge(open_recordings(results / pipeline.RECORDINGS, rubric), rubric)


def asserted(expected: dict[str, Any], result: Result, rubric: Rubric) -> list[tuple[CheckResult, dict[str, Any]]]:
    """Pair each check that the fixture speaks of with what it expects."""
    static = {check.id for check in rubric.checks() if check.session is None}
    pairs = []
    for criterion in result.criteria:
        if criterion.id not in expected["criteria"]:
            continue
        named = expected["criteria"][criterion.id].get("checks") or {}
        unknown = set(named) - {check.id for check in criterion.checks}
        assert not unknown, f"expected.yaml names checks that were not judged: {unknown}"
        for check in criterion.checks:
            if check.id in static and criterion.id != "documentation" and check.id not in named:
                continue
            pairs.append((check, named.get(check.id, {"outcome": "passed"})))
    return pairs


def differences(check: CheckResult, wanted: dict[str, Any]) -> list[str]:
    """Say in which points a check's result differs from what is expected."""
    found = []
    finding = check.finding
    if finding.outcome.value != wanted["outcome"]:
        found.append(
            f"{check.id}: {finding.outcome.value}, not {wanted['outcome']}: {finding.measured} | {finding.reason}"
        )
    bounds = wanted.get("earned")
    if bounds is None and finding.outcome in (Outcome.FAILED, Outcome.NOT_REACHED):
        bounds = [0, 0]
    if bounds is not None and not bounds[0] <= check.earned <= bounds[1]:
        found.append(f"{check.id}: earns {check.earned}, not from {bounds[0]} to {bounds[1]}: {finding.reason}")
    text = f"{finding.reason} {finding.hint}".lower()
    if str(wanted.get("reason_has", "")).lower() not in text:
        found.append(f"{check.id}: the reason does not mention {wanted['reason_has']!r}: {text}")
    return found


@contextmanager
def machine(*, alone: bool) -> Iterator[None]:
    """Hold this machine together with the other tests of this module, or alone."""
    with (Path(tempfile.gettempdir()) / "grade-fixtures-lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield


@pytest.mark.live
@pytest.mark.parametrize("fixture", FIXTURES, ids=lambda path: path.name)
def test_fixture_gets_its_verdict(fixture: Path, tmp_path: Path, rubric: Rubric) -> None:
    """A fixture loses points where its expected.yaml says, and nowhere else."""
    expected = yaml.safe_load((fixture / "expected.yaml").read_text(encoding="utf-8"))
    submission = lay_out(fixture, expected, tmp_path)
    with machine(alone=False):
        result = grade(submission, tmp_path / "results", rubric, expected["sessions"])
    if any(not check.finding.outcome.decided for check, _ in asserted(expected, result, rubric)):
        # Several fixtures at a time can be more than the machine takes; undecided is then the right answer.
        with machine(alone=True):
            result = grade(submission, tmp_path / "results", rubric, expected["sessions"])
    pairs = asserted(expected, result, rubric)
    assert pairs, "the fixture asserts nothing"
    wrong = [difference for check, wanted in pairs for difference in differences(check, wanted)]
    assert not wrong, "\n".join([*wrong, *result.problems])
