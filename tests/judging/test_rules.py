"""The rules of judging: each has a name and a sentence, and a finding names the rule that decided it."""

from __future__ import annotations

import dataclasses
import re
from decimal import Decimal
from pathlib import Path

import pytest

from grader.judging.judge import Recordings, judge_checks
from grader.judging.rubrics import rubric_kinds
from grader.judging.rules import RULES, sentence_of
from grader.lab.rubric import load_rubric
from grader.recording.session import SESSION_VARIABLE, Claim
from grader.recording.submission import SubmissionRecord
from grader.result import MEASURED, Finding, Outcome
from tests.synthetic import ROOT, Session, evenly, submission

RUBRIC = """\
lab: {id: "1", title: One, points: 3}
artifacts: {it: {file: it.py}}
sessions: {experiment: {steps: [{start: {student: it}}]}}
criteria:
  - id: all
    title: All
    points: 3
    checks:
      - id: publishes
        points: 1
        session: experiment
        check: topic_published
        with: {artifact: it, topic: /x, type: std_msgs/msg/Float64}
      - id: scale
        points: 1
        session: experiment
        check: field_range
        requires: [publishes]
        with: {topic: /x, field: data, high: 1}
      - id: size
        points: 1
        session: experiment
        check: field_range
        requires: [publishes]
        excused_by: [scale]
        with: {topic: /x, field: data, high: 1}
"""


def session(folder: Path, values: list[float]) -> Session:
    """Return a session with a program that publishes numbers on /x."""
    kind = "std_msgs/msg/Float64"
    made = Session(folder).process().endpoint("publisher", "/x", topic_type=kind)
    made.typed("/x", kind, [{"data": v} for v in values], evenly(1, len(values) - 1))
    return made


def judged(
    folder: Path,
    made: Session | None,
    record: SubmissionRecord | None = None,
    **how: frozenset[str],
) -> dict[str, Finding]:
    """Judge a session by three checks."""
    (folder / "lab.yaml").write_text(RUBRIC, encoding="utf-8")
    sessions = {"experiment": made.recorded()} if made is not None else {}
    recordings = Recordings(record or submission(), sessions, **how)  # type: ignore[arg-type]
    return judge_checks(recordings, load_rubric(folder / "lab.yaml", rubric_kinds()), [])


def rules_of(findings: dict[str, Finding]) -> list[str | None]:
    """Give the rule that decided each finding."""
    return [finding.decided_by for finding in findings.values()]


def test_each_rule_has_a_name_and_a_sentence() -> None:
    """Names differ, and a sentence fits a line of the page."""
    names = [rule.__name__ for rule in RULES]
    assert len(set(names)) == len(names)
    for name in names:
        assert re.fullmatch(r"[A-Z][^.]*\.", sentence_of(name)), name
    assert MEASURED in names
    assert sentence_of("of_a_later_version") == sentence_of(None) == ""


def test_the_page_lists_the_rules_in_their_order() -> None:
    """docs/judging.md describes each rule by its docstring."""
    page = (ROOT / "docs/judging.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \d+ \| `(\w+)` \| (.+) \|$", page, re.MULTILINE)
    assert rows == [(rule.__name__, sentence_of(rule.__name__)) for rule in RULES]


def test_a_measurement_decides_where_no_rule_doubts_it(tmp_path: Path) -> None:
    """The finding is of the check itself."""
    findings = judged(tmp_path, session(tmp_path, [0.5, 0.6]))
    assert rules_of(findings) == ["measured"] * 3


def test_an_excused_check_names_the_rule(tmp_path: Path) -> None:
    """The check that lost the points was measured; the other one is excused."""
    findings = judged(tmp_path, session(tmp_path, [5.0, 6.0]))
    assert rules_of(findings) == ["measured", "measured", "excused"]


def test_a_missing_file_decides_before_a_measurement(tmp_path: Path) -> None:
    """Checks that require the check of the file are not tested."""
    record = submission(it=None)
    findings = judged(tmp_path, session(tmp_path, [0.5, 0.6]), record)
    assert rules_of(findings) == ["missing_file", "required", "required"]
    findings = judged(tmp_path, None, record)
    assert rules_of(findings) == ["not_recorded", "required", "required"]
    assert findings["publishes"].outcome is Outcome.FAILED


@pytest.mark.parametrize("rule", ["not_recorded", "too_large", "unsound"])
def test_what_the_grader_could_not_record_is_decided_by_no_measurement(
    tmp_path: Path, rule: str
) -> None:
    """The first check names the fault, the others that it is undecided."""
    made = session(tmp_path, [0.5, 0.6])
    if rule == "not_recorded":
        findings = judged(tmp_path, None)
    elif rule == "too_large":
        findings = judged(tmp_path, None, too_much=frozenset({"experiment"}))
    else:
        made.record = dataclasses.replace(made.record, problems=["the director died"])
        findings = judged(tmp_path, made)
    assert rules_of(findings) == [rule, "required", "required"]
    assert {finding.outcome for finding in findings.values()} == {Outcome.INCONCLUSIVE}


def _in_domain(made: Session, value: str) -> Session:
    claim = Claim("it", SESSION_VARIABLE, "ROS_DOMAIN_ID", file="it.py", line=3, value=value)
    made.record.claims.append(claim)
    return made


def test_a_domain_of_its_own_is_charged_as_another_name(tmp_path: Path) -> None:
    """The endpoint's check names the line, and the others are judged as if the domain were the session's."""
    findings = judged(tmp_path, _in_domain(session(tmp_path, [0.5, 0.6]), "30"))
    assert rules_of(findings) == ["other_domain", "measured", "measured"]
    found = findings["publishes"]
    assert (found.outcome, found.credit) == (Outcome.PARTIAL, Decimal("0.4"))
    assert "ROS domain 30" in found.reason
    assert (found.where[0].file, found.where[0].line) == ("it.py", 3)
    assert found.causes == ("domain of it.py",)
    assert found.measured.startswith("nothing in the domain of the lab; ")
    assert found.hint.startswith("Take the domain out of it.py, line 3: ")


def test_the_default_domain_costs_nothing(tmp_path: Path) -> None:
    """A program that asks for domain 0 asks for the domain of the lab."""
    findings = judged(tmp_path, _in_domain(session(tmp_path, [0.5, 0.6]), "0"))
    assert rules_of(findings) == ["measured"] * 3
