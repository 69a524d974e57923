"""Findings × rubric → score. Points are decimal and rounded once, for each check, to tenths."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from decimal import ROUND_HALF_UP, Decimal

from grader.result import CheckResult, CriterionResult, Finding, Score
from grader.rubric import CheckSpec, Rubric

TENTH = Decimal("0.1")


def score_check(spec: CheckSpec, finding: Finding) -> CheckResult:
    """Give a finding its points; what is undecided is neither earned nor lost."""
    undecided = Decimal(0) if finding.outcome.decided else spec.points
    earned = (spec.points * finding.credit).quantize(TENTH, ROUND_HALF_UP) if finding.outcome.decided else Decimal(0)
    points = {"earned": earned, "possible": spec.points, "undecided": undecided}
    return CheckResult.of(finding, id=spec.id, title=spec.title, session=spec.session, **points)


def score_criteria(rubric: Rubric, findings: Mapping[str, Finding]) -> tuple[CriterionResult, ...]:
    """Add up each criterion over the checks that were judged; criteria without any are left out."""
    criteria = []
    for criterion in rubric.criteria:
        checks = tuple(score_check(spec, findings[spec.id]) for spec in criterion.checks if spec.id in findings)
        if checks:
            earned, possible, undecided = _sums(checks)
            criteria.append(
                CriterionResult(
                    criterion.id, criterion.title, earned, possible, undecided, checks, criterion.description
                )
            )
    return tuple(criteria)


def total(criteria: Iterable[CriterionResult]) -> Score:
    """Add up the criteria."""
    return Score(*_sums(criteria))


def _sums(parts: Iterable[CheckResult | CriterionResult]) -> tuple[Decimal, Decimal, Decimal]:
    listed = list(parts)
    return (
        sum((p.earned for p in listed), Decimal(0)),
        sum((p.possible for p in listed), Decimal(0)),
        sum((p.undecided for p in listed), Decimal(0)),
    )
