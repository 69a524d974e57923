"""Checks without evidence in their own session: judged by the graph, or by another session."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest

from grader.evidence.recorded import Recorded
from grader.judging.judge import Recordings, judge_checks
from grader.judging.rubrics import rubric_kinds
from grader.lab.rubric import load_rubric
from grader.result import Finding, Outcome, Violation, ViolationKind
from tests.synthetic import Session, evenly, submission

RUBRIC = """\
lab: {id: "1", title: One, points: 4}
artifacts: {it: {file: it.py}}
sessions:
  alone:
    steps:
      - start: {student: it}
      - observe: {duration_s: 2}
        label: window
  together:
    steps:
      - start: {student: it}
      - observe: {duration_s: 2}
        label: window
criteria:
  - id: all
    title: All
    points: 4
    checks:
      - id: publishes
        points: 1
        session: alone
        check: topic_published
        also_in: [together]
        with: {artifact: it, topic: /x, type: std_msgs/msg/Float64MultiArray, silent_credit: 0.2}
      - id: rate
        points: 1
        session: alone
        check: topic_rate
        requires: [publishes]
        with: {topic: /x, process: it, window: window, rate_hz: 10, full_within: 5%, zero_beyond: 50%}
      - id: small
        points: 1
        session: alone
        check: field_range
        requires: [rate]
        with: {topic: /x, field: data, high: 1}
      - id: reliable
        points: 1
        session: alone
        check: offered_qos
        requires: [publishes]
        with: {topic: /x, reliability: reliable}
"""


def session(folder: Path, name: str, rate_hz: float, *, crashes: bool = False) -> Recorded:
    """Return a session with a program that publishes numbers on /x; a rate of 0 is none at all."""
    made = Session(folder, name).window(1.0, 3.0)
    if crashes:
        return made.process(ended_by="itself", exit_status=1, interrupted_ns=None).recorded()
    made.process().endpoint("publisher", "/x")
    if rate_hz:
        times_s = evenly(rate_hz, 2.0)
        made.messages("/x", [[0.5]] * len(times_s), times_s)
    return made.recorded()


def judged(folder: Path, *sessions: Recorded, tampering: bool = False) -> dict[str, Finding]:
    """Judge sessions by four checks."""
    (folder / "lab.yaml").write_text(RUBRIC, encoding="utf-8")
    recordings = Recordings(submission(), {each.record.session: each for each in sessions})
    kind = ViolationKind.FORGES_ROSOUT
    if tampering:
        violations = [Violation(kind, "together", "Forged.")]
    else:
        violations = []
    return judge_checks(recordings, load_rubric(folder / "lab.yaml", rubric_kinds()), violations)


def credits_of(findings: dict[str, Finding]) -> list[str]:
    """Return the credit of each check."""
    return [str(finding.credit.normalize()) for finding in findings.values()]


def test_a_silent_publisher_is_judged_by_its_endpoint(tmp_path: Path) -> None:
    """Its QoS is in the graph; its messages are nowhere, so that nothing is measured of them."""
    findings = judged(tmp_path, session(tmp_path, "alone", 0))
    assert credits_of(findings) == ["0.2", "0", "0", "1"]
    assert findings["rate"].outcome is Outcome.NOT_REACHED
    assert "no messages were recorded, as 'publishes' says" in findings["rate"].reason
    assert findings["reliable"].outcome is Outcome.PASSED


@pytest.mark.parametrize(("crashes", "of_publishing"), [(False, "0.2"), (True, "0")])
def test_another_session_counts_where_it_shows_more(
    tmp_path: Path, *, crashes: bool, of_publishing: str
) -> None:
    """Only the silence is charged. A check that requires one judged elsewhere is judged there too."""
    alone = session(tmp_path, "alone", 0, crashes=crashes)
    findings = judged(tmp_path, alone, session(tmp_path, "together", 10))
    assert credits_of(findings) == [of_publishing, "1", "1", "1"]
    assert findings["rate"].where[0].session == "together"
    assert "session 'together'" in findings["rate"].notes[-1]


def test_a_fault_that_another_session_shows_is_charged(tmp_path: Path) -> None:
    """Messages at half the rate earn nothing there either, and block the checks that require the rate."""
    alone = session(tmp_path, "alone", 0)
    findings = judged(tmp_path, alone, session(tmp_path, "together", 5))
    assert credits_of(findings) == ["0.2", "0", "0", "1"]
    assert findings["small"].blocked_by == "rate"


def test_the_own_session_counts_where_it_shows_messages(tmp_path: Path) -> None:
    """A wrong rate is not made good by another session."""
    alone = session(tmp_path, "alone", 5)
    findings = judged(tmp_path, alone, session(tmp_path, "together", 10))
    assert findings["rate"].credit == Decimal(0)
    assert findings["rate"].notes == ()


def test_a_session_with_tampering_is_no_evidence(tmp_path: Path) -> None:
    """Nothing is judged there instead."""
    alone = session(tmp_path, "alone", 0)
    findings = judged(tmp_path, alone, session(tmp_path, "together", 10), tampering=True)
    assert findings["rate"].outcome is Outcome.NOT_REACHED
