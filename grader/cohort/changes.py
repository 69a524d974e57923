"""What another judgement of the same submission changes: points and outcomes, old against new. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any

from grader.result import Adjustment, CheckResult, CriterionResult, Outcome, Result, number


@dataclass(frozen=True)
class CheckChange:
    """A check whose outcome or points differ; None on the side where there is no such check.

    Attributes
    ----------
    before, after : Decimal or None
        Points earned.
    """

    id: str
    title: str
    criterion: str
    outcome_before: Outcome | None
    outcome_after: Outcome | None
    before: Decimal | None
    after: Decimal | None

    @property
    def difference(self) -> Decimal:
        """Points that it gives more, or fewer."""
        return (self.after or Decimal(0)) - (self.before or Decimal(0))


@dataclass(frozen=True)
class CriterionChange:
    """A criterion of which something differs.

    Attributes
    ----------
    before, after : Decimal or None
        Points earned; None on the side where there is no such criterion.
    """

    id: str
    title: str
    before: Decimal | None
    after: Decimal | None
    checks: tuple[CheckChange, ...]

    @property
    def difference(self) -> Decimal:
        """Points that it gives more, or fewer."""
        return (self.after or Decimal(0)) - (self.before or Decimal(0))


@dataclass(frozen=True)
class AdjustmentChange:
    """What adjustments of one kind add to the score, or take from it, where that differs."""

    kind: str
    what: str
    before: Decimal
    after: Decimal

    @property
    def difference(self) -> Decimal:
        """Points that they give more, or fewer."""
        return self.after - self.before


@dataclass(frozen=True)
class Changes:
    """What differs between two judgements of one submission.

    Attributes
    ----------
    before : Decimal or None
        Final points; None if there was no result.
    after : Decimal
        Final points.
    undecided_before, undecided_after : Decimal
        Points that are undecided.
    words : bool
        Whether the result differs in anything, such as a reason, beside its provenance.
    possible_before, possible_after : Decimal
        Points that could be had; equal where there was no result.
    """

    submission: str
    before: Decimal | None
    after: Decimal
    undecided_before: Decimal
    undecided_after: Decimal
    criteria: tuple[CriterionChange, ...] = ()
    adjustments: tuple[AdjustmentChange, ...] = ()
    words: bool = False
    possible_before: Decimal = Decimal(0)
    possible_after: Decimal = Decimal(0)

    @property
    def difference(self) -> Decimal:
        """Final points that there are more, or fewer."""
        return self.after - (self.before or Decimal(0))

    @property
    def matters(self) -> bool:
        """Whether there was no result before, or points or an outcome differ."""
        return bool(
            self.before is None
            or self.difference
            or self.undecided_before != self.undecided_after
            or self.criteria
            or self.adjustments
            or self.possible_before != self.possible_after
        )


def changes_between(before: Result | None, after: Result) -> Changes:
    """Compare two results of one submission; there may have been none before."""
    return Changes(
        after.submission,
        before.final if before is not None else None,
        after.final,
        before.score.undecided if before is not None else Decimal(0),
        after.score.undecided,
        tuple(_criteria(before.criteria, after.criteria)) if before is not None else (),
        tuple(_adjustments(before, after)),
        before is not None and _of_substance(before) != _of_substance(after),
        (before or after).score.possible,
        after.score.possible,
    )


def _of_substance(result: Result) -> Result:
    """Return a result without its provenance, which says by what it was judged and not how it is."""
    return replace(result, provenance={})


def _criteria(before: Sequence[CriterionResult], after: Sequence[CriterionResult]) -> Iterable[CriterionChange]:
    old, new = {c.id: c for c in before}, {c.id: c for c in after}
    for identity in dict.fromkeys([*new, *old]):
        was, is_ = old.get(identity), new.get(identity)
        named = is_ or was
        assert named is not None
        checks = tuple(_checks(identity, was.checks if was else (), is_.checks if is_ else ()))
        change = CriterionChange(
            identity, named.title, was.earned if was else None, is_.earned if is_ else None, checks
        )
        if checks or change.before != change.after:
            yield change


def _checks(criterion: str, before: Sequence[CheckResult], after: Sequence[CheckResult]) -> Iterable[CheckChange]:
    old, new = {c.id: c for c in before}, {c.id: c for c in after}
    for identity in dict.fromkeys([*new, *old]):
        was, is_ = old.get(identity), new.get(identity)
        named = is_ or was
        assert named is not None
        change = CheckChange(
            identity,
            named.title,
            criterion,
            was.outcome if was else None,
            is_.outcome if is_ else None,
            was.earned if was else None,
            is_.earned if is_ else None,
        )
        if (change.outcome_before, change.before) != (change.outcome_after, change.after):
            yield change


def _adjustments(before: Result | None, after: Result) -> Iterable[AdjustmentChange]:
    old, new = _adjusted(before.adjustments if before is not None else ()), _adjusted(after.adjustments)
    for kind, what in dict.fromkeys([*new, *old]):
        was, is_ = old.get((kind, what), Decimal(0)), new.get((kind, what), Decimal(0))
        if was != is_:
            yield AdjustmentChange(kind, what, was, is_)


def _adjusted(adjustments: Iterable[Adjustment]) -> dict[tuple[str, str], Decimal]:
    """Return the points of adjustments, added up by kind and what they concern."""
    sums: dict[tuple[str, str], Decimal] = {}
    for each in adjustments:
        key = (each.kind.value, each.what)
        sums[key] = sums.get(key, Decimal(0)) + each.points
    return sums


def plain_changes(changes: Changes) -> dict[str, Any]:
    """Return changes as plain data, for the audit trail: what each was and is."""
    checks = [check for criterion in changes.criteria for check in criterion.checks]
    possible = [_number(changes.possible_before), _number(changes.possible_after)]
    return {
        "final": [_number(changes.before), _number(changes.after)],
        "undecided": [_number(changes.undecided_before), _number(changes.undecided_after)],
        **({"possible": possible} if possible[0] != possible[1] else {}),
        "criteria": {c.id: [_number(c.before), _number(c.after)] for c in changes.criteria if c.difference},
        "checks": {
            c.id: {
                "outcome": [o.value if o is not None else None for o in (c.outcome_before, c.outcome_after)],
                "points": [_number(c.before), _number(c.after)],
            }
            for c in checks
        },
        "adjustments": [
            {"kind": a.kind, "what": a.what, "points": [_number(a.before), _number(a.after)]}
            for a in changes.adjustments
        ],
    }


def _number(points: Decimal | None) -> int | float | None:
    return None if points is None else number(points)


@dataclass(frozen=True)
class CheckSummary:
    """How a check changes over a class: how many gain and lose, and all their points together."""

    id: str
    title: str
    gain: int
    lose: int
    points: Decimal


def summary_of(changes: Iterable[Changes]) -> list[CheckSummary]:
    """Return each check that changes for somebody, in the order in which they are met."""
    met: dict[str, list[CheckChange]] = {}
    for each in changes:
        for criterion in each.criteria:
            for check in criterion.checks:
                met.setdefault(check.id, []).append(check)
    return [
        CheckSummary(
            identity,
            found[0].title,
            sum(c.difference > 0 for c in found),
            sum(c.difference < 0 for c in found),
            sum((c.difference for c in found), Decimal(0)),
        )
        for identity, found in met.items()
    ]
