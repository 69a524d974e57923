"""Differences between two judgements of the same submission: points and outcomes. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any, Literal, NamedTuple, TypeVar

from grader.result import Adjustment, CheckResult, CriterionResult, Outcome, Result, number

Part = TypeVar("Part", CriterionResult, CheckResult)
_NONE = Decimal(0)


@dataclass(frozen=True)
class Change:
    """A criterion or check with other points or another outcome, or all adjustments of a kind with one subject."""

    level: Literal["criterion", "check", "adjustment"]
    #: Id of the criterion or check, or subject of the adjustments.
    id: str
    #: Title of the criterion or check, or kind of the adjustments.
    title: str
    #: Points; None if the criterion or check is missing in that result.
    before: Decimal | None
    after: Decimal | None
    #: Outcomes of a check, before and after.
    outcomes: tuple[Outcome | None, Outcome | None] = (None, None)

    @property
    def difference(self) -> Decimal:
        """Points gained, or lost if negative."""
        return (self.after or _NONE) - (self.before or _NONE)

    @property
    def differs(self) -> bool:
        """True if points or outcome differ."""
        was, now = self.outcomes
        return was != now or self.before != self.after


@dataclass(frozen=True)
class Changes:
    """Differences between two judgements of one submission."""

    submission: str
    #: Final points; None if there was no result.
    before: Decimal | None
    #: Final points.
    after: Decimal
    #: Undecided and possible points, before and after; possible points are equal if there was no result.
    undecided: tuple[Decimal, Decimal]
    possible: tuple[Decimal, Decimal]
    #: Each criterion before its checks, and adjustments last.
    parts: tuple[Change, ...] = ()
    #: True if the results differ in anything except their provenance, such as a reason.
    words: bool = False

    @property
    def difference(self) -> Decimal:
        """Final points gained, or lost if negative."""
        return self.after - (self.before or _NONE)

    @property
    def matters(self) -> bool:
        """True if there was no previous result, or points or an outcome differ."""
        if self.before is None or self.difference or self.parts:
            return True
        undecided_before, undecided_after = self.undecided
        possible_before, possible_after = self.possible
        return undecided_before != undecided_after or possible_before != possible_after

    def at(self, level: str) -> list[Change]:
        """Return the changes of criteria, of checks, or of adjustments."""
        return [part for part in self.parts if part.level == level]


def changes_between(before: Result | None, after: Result) -> Changes:
    """Compare two results of one submission; the first may be missing."""
    now = after.score
    if before is None:
        return Changes(
            submission=after.submission,
            before=None,
            after=after.final,
            undecided=(_NONE, now.undecided),
            possible=(now.possible, now.possible),
            parts=tuple(_adjustments((), after.adjustments)),
        )
    parts = [*_parts(before, after), *_adjustments(before.adjustments, after.adjustments)]
    # The provenance describes the judging and not the submission.
    judged_before = replace(before, provenance={})
    judged_after = replace(after, provenance={})
    return Changes(
        submission=after.submission,
        before=before.final,
        after=after.final,
        undecided=(before.score.undecided, now.undecided),
        possible=(before.score.possible, now.possible),
        parts=tuple(parts),
        words=judged_before != judged_after,
    )


# -- criteria and checks -----------------------------------------------------------------------


def _parts(before: Result, after: Result) -> Iterator[Change]:
    """Yield each criterion that differs, and after it its checks that differ."""
    old = (*before.criteria, *before.bonus)
    new = (*after.criteria, *after.bonus)
    for was, now in _pairs(old, new):
        checks = _checks(was, now)
        criterion = _change("criterion", was, now)
        if checks or criterion.differs:
            yield criterion
            yield from checks


def _checks(before: CriterionResult | None, after: CriterionResult | None) -> list[Change]:
    """Return the checks of a criterion that differ."""
    old = before.checks if before else ()
    new = after.checks if after else ()
    changes = []
    for was, now in _pairs(old, new):
        change = _change("check", was, now)
        if change.differs:
            changes.append(change)
    return changes


def _pairs(before: Sequence[Part], after: Sequence[Part]) -> list[tuple[Part | None, Part | None]]:
    """Return the parts of both results by their ids: first all new ones, then those missing now."""
    old: dict[str, Part] = {part.id: part for part in before}
    new: dict[str, Part] = {part.id: part for part in after}
    pairs = []
    for part_id in dict.fromkeys([*new, *old]):
        pairs.append((old.get(part_id), new.get(part_id)))
    return pairs


def _change(level: Literal["criterion", "check"], was: Part | None, now: Part | None) -> Change:
    named = now or was
    assert named is not None
    before, after = _earned_in(was), _earned_in(now)
    outcomes = (_outcome_of(was), _outcome_of(now))
    return Change(level, named.id, named.title, before, after, outcomes)


def _earned_in(part: CriterionResult | CheckResult | None) -> Decimal | None:
    """Return the earned points; None if the part is missing."""
    if part is None:
        return None
    return part.earned


def _outcome_of(part: CriterionResult | CheckResult | None) -> Outcome | None:
    """Return the outcome of a check; None for a criterion."""
    if isinstance(part, CheckResult):
        return part.outcome
    return None


# -- adjustments -------------------------------------------------------------------------------


def _adjustments(before: Iterable[Adjustment], after: Iterable[Adjustment]) -> Iterator[Change]:
    """Yield the adjustments that differ, added up by kind and subject."""
    old = _sums(before)
    new = _sums(after)
    for kind, subject in dict.fromkeys([*new, *old]):
        was, now = old[kind, subject], new[kind, subject]
        change = Change("adjustment", subject, kind, was, now)
        if change.difference:
            yield change


def _sums(adjustments: Iterable[Adjustment]) -> defaultdict[tuple[str, str], Decimal]:
    """Return points by kind and subject."""
    sums: defaultdict[tuple[str, str], Decimal] = defaultdict(Decimal)
    for adjustment in adjustments:
        sums[adjustment.kind.value, adjustment.what] += adjustment.points
    return sums


# -- a class, and plain data -------------------------------------------------------------------


class ChangedCheck(NamedTuple):
    """A check that differs for some submissions: how many gain and lose by it, and the sum of points."""

    title: str
    gaining: int
    losing: int
    points: Decimal


def by_check(changes: Iterable[Changes]) -> list[ChangedCheck]:
    """Return the checks that differ, the largest sum of points first."""
    by_id: defaultdict[str, list[Change]] = defaultdict(list)
    for submission in changes:
        for check in submission.at("check"):
            by_id[check.id].append(check)
    found = map(_changed_check, by_id.values())
    return sorted(found, key=lambda check: -abs(check.points))


def _changed_check(changes: Sequence[Change]) -> ChangedCheck:
    """Add up the changes of one check."""
    gaining = 0
    losing = 0
    points = _NONE
    for change in changes:
        gaining += change.difference > 0
        losing += change.difference < 0
        points += change.difference
    return ChangedCheck(changes[0].title, gaining, losing, points)


def plain_changes(changes: Changes) -> dict[str, Any]:
    """Return changes as plain data for the audit trail, each as values before and after."""
    plain: dict[str, Any] = {}
    plain["final"] = _numbers(changes.before, changes.after)
    plain["undecided"] = _numbers(*changes.undecided)
    if len(set(changes.possible)) > 1:
        plain["possible"] = _numbers(*changes.possible)
    plain["criteria"] = {}
    for criterion in changes.at("criterion"):
        if criterion.difference:
            plain["criteria"][criterion.id] = _points(criterion)
    plain["checks"] = {check.id: _plain_check(check) for check in changes.at("check")}
    plain["adjustments"] = list(map(_plain_adjustment, changes.at("adjustment")))
    return plain


def _plain_check(check: Change) -> dict[str, Any]:
    outcomes: list[str | None] = []
    for outcome in check.outcomes:
        outcomes.append(None if outcome is None else outcome.value)
    return {"outcome": outcomes, "points": _points(check)}


def _plain_adjustment(adjustment: Change) -> dict[str, Any]:
    return {"kind": adjustment.title, "what": adjustment.id, "points": _points(adjustment)}


def _points(change: Change) -> list[int | float | None]:
    return _numbers(change.before, change.after)


def _numbers(*points: Decimal | None) -> list[int | float | None]:
    numbers: list[int | float | None] = []
    for value in points:
        numbers.append(None if value is None else number(value))
    return numbers
