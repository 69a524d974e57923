"""Findings × rubric → score. Points are decimal and rounded once, for each check, to tenths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal

from grader.lab.rubric import CheckSpec, CriterionSpec
from grader.result import CheckResult, CriterionResult, Finding, Score

TENTH = Decimal("0.1")


def score_check(spec: CheckSpec, finding: Finding, commands: tuple[str, ...] = ()) -> CheckResult:
    """Give a finding its points, and commands that show it; what is undecided is neither earned nor lost."""
    undecided = Decimal(0) if finding.outcome.decided else spec.points
    earned = (
        (spec.points * finding.credit).quantize(TENTH, ROUND_HALF_UP)
        if finding.outcome.decided
        else Decimal(0)
    )
    points = {"earned": earned, "possible": spec.points, "undecided": undecided}
    return CheckResult.of(
        finding, id=spec.id, title=spec.title, session=spec.session, commands=commands, **points
    )


def score_criteria(
    specs: Sequence[CriterionSpec],
    findings: Mapping[str, Finding],
    commands: Mapping[str, tuple[str, ...]],
) -> tuple[CriterionResult, ...]:
    """Add up each criterion over the checks that were judged; criteria without any are left out."""
    criteria = []
    for criterion in specs:
        judged = [spec for spec in criterion.checks if spec.id in findings]
        checks = tuple(
            score_check(spec, findings[spec.id], commands.get(spec.id, ())) for spec in judged
        )
        if checks:
            sums = vars(total(checks))
            found = CriterionResult(
                criterion.id,
                criterion.title,
                checks=checks,
                description=criterion.description,
                **sums,
            )
            criteria.append(found)
    return tuple(criteria)


def total(parts: Sequence[CheckResult | CriterionResult]) -> Score:
    """Add up checks or criteria."""
    keys = ("earned", "possible", "undecided")
    return Score(*(sum((getattr(part, key) for part in parts), Decimal(0)) for key in keys))
