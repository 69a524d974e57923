"""`result.json`: the contract that others script against."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

from grader.report.json_text import json_text
from grader.result import RESULT_SCHEMA, Adjustment, CheckResult, CriterionResult, Result, Violation, Where


def points(value: Decimal) -> int | float:
    """Return points as a JSON number: whole where they are whole."""
    return int(value) if value == value.to_integral_value() else float(value)


def _where(where: Where) -> dict[str, Any]:
    parts = {
        "file": where.file,
        "line": where.line,
        "session": where.session,
        "topic": where.topic,
        "process": where.process,
        "start_s": where.start_s,
        "end_s": where.end_s,
    }
    return {k: (round(v, 3) if isinstance(v, float) else v) for k, v in parts.items() if v is not None}


def _check(check: CheckResult) -> dict[str, Any]:
    finding = check.finding
    return {
        "id": check.id,
        "title": check.title,
        "outcome": finding.outcome.value,
        "earned": points(check.earned),
        "possible": points(check.possible),
        "undecided": points(check.undecided),
        "expected": finding.expected,
        "measured": finding.measured,
        "reason": finding.reason,
        "hint": finding.hint,
        "where": [_where(w) for w in finding.where],
        "notes": list(finding.notes),
    }


def _criterion(criterion: CriterionResult) -> dict[str, Any]:
    return {
        "id": criterion.id,
        "title": criterion.title,
        "earned": points(criterion.earned),
        "possible": points(criterion.possible),
        "undecided": points(criterion.undecided),
        "checks": [_check(check) for check in criterion.checks],
    }


def _adjustment(adjustment: Adjustment) -> dict[str, Any]:
    return {
        "kind": adjustment.kind.value,
        "what": adjustment.what,
        "points": points(adjustment.points),
        "reason": adjustment.reason,
        "who": adjustment.who,
        "when": adjustment.when,
    }


def _violation(violation: Violation) -> dict[str, Any]:
    return {
        "kind": violation.kind.value,
        "session": violation.session,
        "text": violation.text,
        "evidence": list(violation.evidence),
        "where": _where(violation.where),
        "certain": violation.certain,
        "checks": list(violation.checks),
    }


def to_plain(result: Result) -> dict[str, Any]:
    """Return a result as plain data of the schema `ros-lab-grader/result/v1`."""
    return {
        "schema": RESULT_SCHEMA,
        "submission": result.submission,
        "lab": result.lab,
        "score": {
            "earned": points(result.score.earned),
            "possible": points(result.score.possible),
            "undecided": points(result.score.undecided),
            "final": points(result.final),
        },
        "criteria": [_criterion(criterion) for criterion in result.criteria],
        "adjustments": [_adjustment(adjustment) for adjustment in result.adjustments],
        "violations": [_violation(violation) for violation in result.violations],
        "advisories": list(result.advisories),
        "problems": list(result.problems),
        "provenance": result.provenance,
    }


def render(result: Result) -> str:
    """Return `result.json`'s text; equal results give equal bytes."""
    return json_text(to_plain(result))
