"""A finished `result.json` as the class's statistics read it: what they need of it, checked."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from grader.result import Adjustment, AdjustmentKind, Outcome

NOT_READABLE = "Its result.json is not of the form that this grader reads; judge or grade it again."


class _Read(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class FinishedCheck(_Read):
    """A check's outcome, points and words."""

    id: str
    title: str
    outcome: Outcome
    earned: Decimal = Field(ge=0)
    possible: Decimal = Field(ge=0)
    undecided: Decimal = Field(ge=0)
    measured: str = ""
    reason: str = ""
    hint: str = ""

    @property
    def lost(self) -> Decimal:
        """Points that are neither earned nor undecided."""
        return self.possible - self.earned - self.undecided

    @property
    def credit(self) -> float | None:
        """Share of its points, from 0 to 1; None if it is undecided or has none."""
        return float(self.earned / self.possible) if self.outcome.decided and self.possible else None


class FinishedCriterion(_Read):
    """A criterion's points and checks."""

    id: str
    title: str
    earned: Decimal = Field(ge=0)
    possible: Decimal = Field(ge=0)
    undecided: Decimal = Field(ge=0)
    checks: tuple[FinishedCheck, ...]


class FinishedScore(_Read):
    """Points over all criteria; `final` is after adjustments, where there are any."""

    earned: Decimal
    possible: Decimal
    undecided: Decimal
    final: Decimal | None = None


class FinishedViolation(_Read):
    """Something of the grader's own that was touched; `certain` if only the submission can have done it."""

    kind: str = ""
    text: str = ""
    certain: bool = True


class FinishedResult(_Read):
    """The judgement of one submission."""

    score: FinishedScore
    criteria: tuple[FinishedCriterion, ...]
    problems: tuple[str, ...] = ()
    violations: tuple[FinishedViolation, ...] = ()
    adjustments: tuple[Adjustment, ...] = ()
    provenance: dict[str, Any] = Field(default_factory=dict)

    @property
    def final(self) -> Decimal:
        """Points with all adjustments."""
        return self.score.earned if self.score.final is None else self.score.final

    @property
    def checks(self) -> tuple[FinishedCheck, ...]:
        """All checks, in the rubric's order."""
        return tuple(check for criterion in self.criteria for check in criterion.checks)

    @property
    def open_checks(self) -> tuple[FinishedCheck, ...]:
        """Undecided checks that no person has decided since, by themselves or by their criterion."""
        by_hand = (AdjustmentKind.POINTS, AdjustmentKind.EXCUSED)
        decided = {a.what for a in self.adjustments if a.kind in by_hand}
        checks = (check for criterion in self.criteria if criterion.id not in decided for check in criterion.checks)
        return tuple(check for check in checks if not check.outcome.decided and check.id not in decided)

    @property
    def rubric_sha256(self) -> str:
        """Hash of the rubric that it was judged by."""
        return str(self.provenance.get("rubric_sha256", ""))


def finished(plain: Mapping[str, Any]) -> FinishedResult | None:
    """Return a result from its plain data, or None if it is not of the form that this grader writes."""
    try:
        return FinishedResult.model_validate(plain)
    except ValidationError:
        return None
