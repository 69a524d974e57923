"""What another judgement of the same submission changes: points and outcomes, old against new. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
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
    #: Those of a check, before and after.
    outcomes: tuple[Outcome | None, Outcome | None] = (None, None)

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
    #: Points that are undecided, and that could be had (equal where there was no result), before and after.
    undecided: tuple[Decimal, Decimal]
    possible: tuple[Decimal, Decimal]
    #: Each criterion before its checks, and adjustments last.
    parts: tuple[Change, ...] = ()
    #: Whether the result differs in anything, such as a reason, beside its provenance.
    words: bool = False

    @property
    def difference(self) -> Decimal:
        """Final points that there are more, or fewer."""
        return self.after - (self.before or Decimal(0))

    @property
    def matters(self) -> bool:
        """Whether there was no result before, or points or an outcome differ."""
        moved = any(was != now for was, now in (self.undecided, self.possible))
        return self.before is None or bool(self.difference or self.parts) or moved

    def at(self, level: str) -> list[Change]:
        """Return the changes of criteria, of checks, or of adjustments."""
        return [part for part in self.parts if part.level == level]


def changes_between(before: Result | None, after: Result) -> Changes:
    """Compare two results of one submission; there may have been none before."""
    return Changes(
        after.submission,
        before.final if before is not None else None,
        after.final,
        (before.score.undecided if before is not None else Decimal(0), after.score.undecided),
        ((before or after).score.possible, after.score.possible),
        (*(_parts(before, after) if before is not None else ()), *_adjustments(before, after)),
        # Provenance says by what it was judged, and not how it is.
        before is not None and replace(before, provenance={}) != replace(after, provenance={}),
    )


def _parts(before: Result, after: Result) -> Iterator[Change]:
    for was, now in _pairs((*before.criteria, *before.bonus), (*after.criteria, *after.bonus)):
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
    before, after = (part.outcome if isinstance(part, CheckResult) else None for part in (was, now))
    earned = [part.earned if part else None for part in (was, now)]
    return Change(level, named.id, named.title, earned[0], earned[1], (before, after))


def _differs(change: Change) -> bool:
    return change.outcomes[0] != change.outcomes[1] or change.before != change.after


def _adjustments(before: Result | None, after: Result) -> Iterator[Change]:
    """Compare adjustments, added up by kind and what they concern."""
    old: defaultdict[tuple[str, str], Decimal] = defaultdict(Decimal)
    new: defaultdict[tuple[str, str], Decimal] = defaultdict(Decimal)
    for sums, result in ((old, before), (new, after)):
        for each in result.adjustments if result is not None else ():
            sums[each.kind.value, each.what] += each.points
    for kind, what in dict.fromkeys([*new, *old]):
        change = Change("adjustment", what, kind, old[kind, what], new[kind, what])
        if change.difference:
            yield change


def by_check(changes: Iterable[Changes]) -> list[tuple[str, int, int, Decimal]]:
    """Return for each check that differs its title, how many gain and lose by it, and their points together."""
    met: defaultdict[str, list[Change]] = defaultdict(list)
    for check in (check for each in changes for check in each.at("check")):
        met[check.id].append(check)
    found = [
        (
            of[0].title,
            sum(c.difference > 0 for c in of),
            sum(c.difference < 0 for c in of),
            sum((c.difference for c in of), Decimal(0)),
        )
        for of in met.values()
    ]
    return sorted(found, key=lambda each: -abs(each[3]))


def plain_changes(changes: Changes) -> dict[str, Any]:
    """Return changes as plain data, for the audit trail: what each was and is."""
    return {
        "final": _numbers(changes.before, changes.after),
        "undecided": _numbers(*changes.undecided),
        **({"possible": _numbers(*changes.possible)} if len(set(changes.possible)) > 1 else {}),
        "criteria": {
            c.id: _numbers(c.before, c.after) for c in changes.at("criterion") if c.difference
        },
        "checks": {
            c.id: {
                "outcome": [o.value if o is not None else None for o in c.outcomes],
                "points": _numbers(c.before, c.after),
            }
            for c in changes.at("check")
        },
        "adjustments": [
            {"kind": a.title, "what": a.id, "points": _numbers(a.before, a.after)}
            for a in changes.at("adjustment")
        ],
    }


def _numbers(*points: Decimal | None) -> list[int | float | None]:
    return [None if value is None else number(value) for value in points]
