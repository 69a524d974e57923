"""Findings × rubric → score. Points are decimal and rounded once, for each check, to tenths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal

from grader.lab.rubric import CheckSpec, CriterionSpec
from grader.result import CheckResult, CriterionResult, Finding, Score

TENTH = Decimal("0.1")
_NONE = Decimal(0)


def score_check(spec: CheckSpec, finding: Finding, commands: tuple[str, ...] = ()) -> CheckResult:
    """Give a finding its points, and commands that show it; undecided points are neither earned nor lost."""
    earned = _NONE
    undecided = spec.points
    if finding.outcome.decided:
        earned = (spec.points * finding.credit).quantize(TENTH, ROUND_HALF_UP)
        undecided = _NONE
    endangers = None
    if spec.endangers:
        endangers = True
    return CheckResult.of(
        finding,
        id=spec.id,
        title=spec.title,
        session=spec.session,
        commands=commands,
        charged_by=finding.charged_by or None,
        endangers=endangers,
        earned=earned,
        possible=spec.points,
        undecided=undecided,
    )


def score_criteria(
    specs: Sequence[CriterionSpec],
    findings: Mapping[str, Finding],
    commands: Mapping[str, tuple[str, ...]],
) -> tuple[CriterionResult, ...]:
    """Add up each criterion over its judged checks; a criterion without any is left out."""
    criteria = []
    for criterion in specs:
        checks = []
        for spec in criterion.checks:
            if spec.id in findings:
                checks.append(score_check(spec, findings[spec.id], commands.get(spec.id, ())))
        if checks:
            criteria.append(_score_criterion(criterion, tuple(checks)))
    return tuple(criteria)


def _score_criterion(spec: CriterionSpec, checks: tuple[CheckResult, ...]) -> CriterionResult:
    """Add up a criterion over its checks."""
    score = total(checks)
    return CriterionResult(
        spec.id,
        spec.title,
        score.earned,
        score.possible,
        score.undecided,
        checks,
        spec.description,
    )


def total(parts: Sequence[CheckResult | CriterionResult]) -> Score:
    """Add up checks or criteria."""
    return Score(
        earned=sum((part.earned for part in parts), _NONE),
        possible=sum((part.possible for part in parts), _NONE),
        undecided=sum((part.undecided for part in parts), _NONE),
    )
