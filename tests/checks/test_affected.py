"""Checks whose measurement was touched, in the recordings of the solution with a second clock put in."""

from __future__ import annotations

import dataclasses
import shutil
from decimal import Decimal
from pathlib import Path

import pytest

from grader.judging import judge, open_recordings
from grader.pipeline import read_rubric
from grader.recording.session import Endpoint, SessionRecord, read_session, write_session
from grader.recording.told import DIGEST_DIGITS
from grader.result import CheckResult, Outcome, Result, ViolationKind
from grader.rubric import Rubric
from tests.synthetic import ROOT

#: Messages of the arm that the tests make another's, by their place.
SOME = slice(150 * DIGEST_DIGITS, 250 * DIGEST_DIGITS)


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """Give a copy of the solution's recordings."""
    shutil.copytree(ROOT / "tests/recordings/solution", tmp_path / "recordings")
    return tmp_path / "recordings"


def disown(folder: Path, topic: str, publisher: bool = True, **changes: object) -> None:
    """Let the arm not have sent some of the messages on a topic, and a node of the student's publish there."""
    record: SessionRecord = read_session(folder / "launch")
    for entry in record.published:
        if entry.topic == topic:
            wrong = "0" * len(entry.digests[SOME])
            entry.digests = entry.digests[: SOME.start] + wrong + entry.digests[SOME.stop :]
    if publisher:
        record.graph[-2].endpoints.append(Endpoint("publisher", topic, "", "", "/clockwork", "0b" * 16))
    write_session(folder / "launch", dataclasses.replace(record, **changes))  # type: ignore[arg-type]


def judged(folder: Path, rubric: Rubric) -> tuple[Result, dict[str, CheckResult]]:
    """Judge recordings, and give the results of checks by their ids."""
    result = judge(open_recordings(folder, rubric), rubric)
    return result, {check.id: check for criterion in result.criteria for check in criterion.checks}


def test_what_rests_on_a_second_clock_fails(recordings: Path, rubric: Rubric) -> None:
    """Only the check that measures traffic in that session does, and it says why and where."""
    disown(recordings, "/clock")
    result, checks = judged(recordings, rubric)
    (violation,) = result.violations
    assert (violation.kind, violation.checks) == (ViolationKind.SPOOFS_CLOCK, ("launch.together",))
    finding = checks.pop("launch.together").finding
    assert (finding.outcome, finding.credit, finding.measured) == (Outcome.FAILED, Decimal(0), "not measured")
    assert finding.reason == f"{violation.text} So this cannot be measured."
    assert finding.where == (violation.where,)
    assert finding.expected
    assert finding.hint
    assert {check.finding.outcome for check in checks.values()} == {Outcome.PASSED}
    assert result.score.earned == 98


def test_what_can_be_measured_all_the_same_is_judged(recordings: Path, rubric: Rubric) -> None:
    """Messages of others on the arm's topic are stated, left out, and cost nothing by themselves."""
    disown(recordings, "/joint_states")
    result, _ = judged(recordings, rubric)
    (violation,) = result.violations
    assert (violation.kind, violation.checks) == (ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC, ())
    assert violation.evidence[0].startswith("100 messages")
    assert result.score.earned == 100


def test_what_is_not_certain_fails_nothing(recordings: Path, rubric: Rubric) -> None:
    """Without a publisher that was seen, nobody is charged."""
    disown(recordings, "/clock", publisher=False)
    result, _ = judged(recordings, rubric)
    assert [(v.certain, v.checks) for v in result.violations] == [(False, ())]
    assert result.score.earned == 100


def test_a_session_with_a_problem_stays_undecided(recordings: Path, rubric: Rubric) -> None:
    """Whatever was touched in it: an experiment that the grader could not carry out decides nothing."""
    disown(recordings, "/clock", problems=["the reference node arm ended with status -11"])
    result, checks = judged(recordings, rubric)
    assert result.violations
    assert checks["launch.together"].finding.outcome is Outcome.INCONCLUSIVE
    assert result.score.earned + result.score.undecided == 100
