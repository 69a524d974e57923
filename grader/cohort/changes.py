"""What another judgement of the same submission changes: points and outcomes, old against new. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any, Literal, TypeVar

from grader.result import CheckResult, CriterionResult, Outcome, Result, number

Part = TypeVar("Part", CriterionResult, CheckResult)


@dataclass(frozen=True)
class Change:
    """A criterion, a check, or all adjustments of one kind that concern the same, where points or outcome differ."""

    level: Literal["criterion", "check", "adjustment"]
    id: str
    #: The kind, for an adjustment.
    title: str
    #: Points; None on the side where there is no such criterion or check.
    before: Decimal | None
    after: Decimal | None
    #: Those of a check.
    outcome_before: Outcome | None = None
    outcome_after: Outcome | None = None

    @property
    def difference(self) -> Decimal:
        """Points that there are more, or fewer."""
        return (self.after or Decimal(0)) - (self.before or Decimal(0))


@dataclass(frozen=True)
class Changes:
    """What differs between two judgements of one submission."""

    submission: str
    #: Final points; None if there was no result.
    before: Decimal | None
    #: Final points.
    after: Decimal
    #: Points that are undecided.
    undecided_before: Decimal
    undecided_after: Decimal
    #: Each criterion before its checks, and adjustments last.
    parts: tuple[Change, ...] = ()
    #: Whether the result differs in anything, such as a reason, beside its provenance.
    words: bool = False
    #: Points that could be had; equal where there was no result.
    possible_before: Decimal = Decimal(0)
    possible_after: Decimal = Decimal(0)

    @property
    def difference(self) -> Decimal:
        """Final points that there are more, or fewer."""
        return self.after - (self.before or Decimal(0))

    @property
    def matters(self) -> bool:
        """Whether there was no result before, or points or an outcome differ."""
        undecided, possible = self.undecided_after - self.undecided_before, self.possible_after - self.possible_before
        return self.before is None or bool(self.difference or self.parts or undecided or possible)

    def at(self, level: str) -> list[Change]:
        """Return the changes of criteria, of checks, or of adjustments."""
        return [part for part in self.parts if part.level == level]


def changes_between(before: Result | None, after: Result) -> Changes:
    """Compare two results of one submission; there may have been none before."""
    return Changes(
        after.submission,
        before.final if before is not None else None,
        after.final,
        before.score.undecided if before is not None else Decimal(0),
        after.score.undecided,
        (*(_parts(before, after) if before is not None else ()), *_adjustments(before, after)),
        # Provenance says by what it was judged, and not how it is.
        before is not None and replace(before, provenance={}) != replace(after, provenance={}),
        (before or after).score.possible,
        after.score.possible,
    )


def _parts(before: Result, after: Result) -> Iterator[Change]:
    for was, now in _pairs(before.criteria, after.criteria):
        pairs = _pairs(was.checks if was else (), now.checks if now else ())
        checks = [check for pair in pairs if _differs(check := _change("check", *pair))]
        criterion = _change("criterion", was, now)
        if checks or _differs(criterion):
            yield from (criterion, *checks)


def _pairs(before: Sequence[Part], after: Sequence[Part]) -> list[tuple[Part | None, Part | None]]:
    old: dict[str, Part] = {part.id: part for part in before}
    new: dict[str, Part] = {part.id: part for part in after}
    return [(old.get(identity), new.get(identity)) for identity in dict.fromkeys([*new, *old])]


def _change(level: Literal["criterion", "check"], was: Part | None, now: Part | None) -> Change:
    named = now or was
    assert named is not None
    outcomes = [part.outcome if isinstance(part, CheckResult) else None for part in (was, now)]
    return Change(level, named.id, named.title, was.earned if was else None, now.earned if now else None, *outcomes)


def _differs(change: Change) -> bool:
    return (change.outcome_before, change.before) != (change.outcome_after, change.after)


def _adjustments(before: Result | None, after: Result) -> Iterator[Change]:
    """Compare adjustments, added up by kind and what they concern."""
    old: dict[tuple[str, str], Decimal] = {}
    new: dict[tuple[str, str], Decimal] = {}
    for sums, result in ((old, before), (new, after)):
        for each in result.adjustments if result is not None else ():
            key = (each.kind.value, each.what)
            sums[key] = sums.get(key, Decimal(0)) + each.points
    for kind, what in dict.fromkeys([*new, *old]):
        change = Change("adjustment", what, kind, old.get((kind, what), Decimal(0)), new.get((kind, what), Decimal(0)))
        if change.difference:
            yield change


def plain_changes(changes: Changes) -> dict[str, Any]:
    """Return changes as plain data, for the audit trail: what each was and is."""
    possible = _numbers(changes.possible_before, changes.possible_after)
    return {
        "final": _numbers(changes.before, changes.after),
        "undecided": _numbers(changes.undecided_before, changes.undecided_after),
        **({"possible": possible} if possible[0] != possible[1] else {}),
        "criteria": {c.id: _numbers(c.before, c.after) for c in changes.at("criterion") if c.difference},
        "checks": {
            c.id: {
                "outcome": [o.value if o is not None else None for o in (c.outcome_before, c.outcome_after)],
                "points": _numbers(c.before, c.after),
            }
            for c in changes.at("check")
        },
        "adjustments": [
            {"kind": a.title, "what": a.id, "points": _numbers(a.before, a.after)} for a in changes.at("adjustment")
        ],
    }


def _numbers(*points: Decimal | None) -> list[int | float | None]:
    return [None if value is None else number(value) for value in points]
