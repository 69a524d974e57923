"""What changes the points after the judgement: people's decisions first, then what lateness costs. Pure.

The judgement itself stays as it is; each adjustment says how many points it adds or takes, so that they add up.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from decimal import Decimal

from grader.cohort.overrides import Override
from grader.policy import Counts, LatePolicy, span_text, time_text
from grader.result import Adjustment, AdjustmentKind, CriterionResult, Result

_WHOLE = "score"


def adjust(
    result: Result, entries: Iterable[Override], late: LatePolicy | None = None, submitted: datetime | None = None
) -> Result:
    """Return a result with its adjustments; those that it had are replaced.

    Parameters
    ----------
    entries : iterable of Override
        Those about this submission, in the order in which they are applied.
    late : LatePolicy or None
        What lateness costs, by the rubric.
    submitted : datetime or None
        When it was handed in, if that is known.

    Notes
    -----
    A check's points stay from 0 to what it has, and so do a criterion's; only a bonus goes beyond. Checks come
    before criteria, then what is of the whole, and lateness last, so that a share is taken of what would stand
    without it. The total is never below 0.
    """
    listed = list(entries)
    points = _Points(result)
    changes = [points.adjust_check(e) for e in listed if e.check is not None]
    changes += [points.adjust_criterion(e) for e in listed if e.criterion is not None]
    changes += [_by_hand(AdjustmentKind.BONUS, _WHOLE, e.bonus, e) for e in listed if e.bonus is not None]
    made = [change for change in changes if change is not None]
    if late is not None:
        standing = result.score.earned + sum((change.points for change in made), Decimal(0))
        made += _lateness(standing, listed, late, submitted)
    return replace(result, adjustments=tuple(made))


@dataclass
class _Points:
    """The points of checks and criteria while they are being adjusted."""

    result: Result
    checks: dict[str, Decimal] = field(default_factory=dict)
    criteria: dict[str, Decimal] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for criterion in self.result.criteria:
            self.criteria[criterion.id] = criterion.earned
            self.checks.update((check.id, check.earned) for check in criterion.checks)

    def adjust_check(self, entry: Override) -> Adjustment | None:
        """Apply an entry about a check; None if the check was not judged."""
        for criterion in self.result.criteria:
            for check in criterion.checks:
                if check.id == entry.check:
                    before = self.checks[check.id]
                    self.checks[check.id] = _changed(before, entry, check.possible)
                    change = self.checks[check.id] - before
                    self.criteria[criterion.id] += change
                    return _by_hand(_kind(entry), check.id, change, entry)
        return None

    def adjust_criterion(self, entry: Override) -> Adjustment | None:
        """Apply an entry about a criterion; None if none of it was judged."""
        found: CriterionResult | None = next((c for c in self.result.criteria if c.id == entry.criterion), None)
        if found is None:
            return None
        before = self.criteria[found.id]
        self.criteria[found.id] = _changed(before, entry, found.possible)
        return _by_hand(_kind(entry), found.id, self.criteria[found.id] - before, entry)


def _changed(points: Decimal, entry: Override, possible: Decimal) -> Decimal:
    if entry.excused:
        return possible
    wanted = entry.set_ if entry.set_ is not None else points + (entry.add or Decimal(0))
    return min(max(wanted, Decimal(0)), possible)


def _kind(entry: Override) -> AdjustmentKind:
    return AdjustmentKind.EXCUSED if entry.excused else AdjustmentKind.POINTS


def _by_hand(kind: AdjustmentKind, what: str, points: Decimal, entry: Override) -> Adjustment:
    return Adjustment(kind, what, points, entry.reason, entry.who, entry.when)


def _lateness(
    standing: Decimal, entries: list[Override], late: LatePolicy, submitted: datetime | None
) -> list[Adjustment]:
    """Return what moved the times, and what lateness takes of the points that stand."""
    due, changes = late.due, []
    for entry in entries:
        if entry.submitted is not None:
            submitted = entry.submitted
            changes.append(_by_hand(AdjustmentKind.SUBMITTED, time_text(submitted), Decimal(0), entry))
        elif entry.due is not None or entry.extension is not None:
            due = entry.due if entry.due is not None else due + (entry.extension or timedelta())
            changes.append(_by_hand(AdjustmentKind.EXTENSION, f"due {time_text(due)}", Decimal(0), entry))
    if submitted is None:
        reason = "It is not known when this was handed in, so it does not count as late."
        return [*changes, Adjustment(AdjustmentKind.LATE, _WHOLE, Decimal(0), reason)]
    if submitted > due:
        behind = submitted - due
        reason = f"Handed in {time_text(submitted)}, {span_text(behind)} after it was due. {_price(late, behind)}"
        changes.append(Adjustment(AdjustmentKind.LATE, _WHOLE, -late.deduction(standing, behind), reason))
    return changes


def _price(late: LatePolicy, behind: timedelta) -> str:
    """Say how lateness is counted."""
    if behind <= late.grace:
        return f"Up to {span_text(late.grace)} costs nothing."
    if late.never_after is not None and behind > late.never_after:
        limit = f"more than {span_text(late.never_after)} " if late.never_after else ""
        return f"Nothing is accepted {limit}after it is due."
    if late.per_day is None:
        return "That costs nothing."
    words = {Counts.STARTED_DAYS: "started", Counts.FULL_DAYS: "full"}
    days = late.days(behind)
    number = f"{days.normalize():f}" if late.counts is not Counts.EXACT_TIME else f"{days:.2f}"
    word = f"{words[late.counts]} " if late.counts in words else ""
    limit = f", at most {late.at_most}" if late.at_most is not None else ""
    of = " of the points" if late.per_day.percent else ""
    return f"{number} {word}day{'s' * (number != '1')} at {late.per_day}{of}{limit}."
