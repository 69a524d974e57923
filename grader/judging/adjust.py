"""What changes the points after the judgement: people's decisions first, then what lateness costs. Pure.

The judgement itself stays as it is; each adjustment says how many points it adds or takes, so that they add up.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from datetime import datetime, timedelta
from decimal import Decimal

from grader.lab.overrides import Override
from grader.lab.policy import LatePolicy, span_text, time_text
from grader.result import WHOLE, Adjustment, AdjustmentKind, CheckResult, CriterionResult, Result

_KINDS = {
    "excused": AdjustmentKind.EXCUSED,
    "reviewed": AdjustmentKind.REVIEWED,
    "appeal": AdjustmentKind.APPEAL,
}


def adjust(
    result: Result,
    entries: Iterable[Override],
    late: LatePolicy | None = None,
    submitted: datetime | None = None,
) -> Result:
    """Return a result with its adjustments; those that it had are replaced.

    A check's points stay from 0 to what it has, and so do a criterion's; only a bonus goes beyond. Checks come before
    criteria, then what is of the whole, and lateness last, so that a share is taken of what would stand without it. The
    total is never below 0.
    """
    listed = list(entries)
    parts: dict[tuple[str, str | None], CheckResult | CriterionResult] = {
        ("check", c.id): c for c in result.checks
    }
    parts |= {("criterion", criterion.id): criterion for criterion in result.criteria}
    earned = {part: judged.earned for part, judged in parts.items()}
    criterion_of = {
        check.id: criterion.id for criterion in result.criteria for check in criterion.checks
    }
    made: list[Adjustment] = []
    for entry in sorted(listed, key=lambda entry: entry.check is None):
        part = ("check", entry.check) if entry.check is not None else ("criterion", entry.criterion)
        if part in earned:  # Else nothing of it was judged.
            change = _changed(earned[part], entry, parts[part].possible) - earned[part]
            earned[part] += change
            if entry.check is not None:
                earned["criterion", criterion_of[entry.check]] += change
            kind = _KINDS.get(entry.change, AdjustmentKind.POINTS)
            made.append(_by_hand(kind, str(part[1]), change, entry))
        elif entry.change == "reviewed" and part[1] is None:
            made.append(_by_hand(AdjustmentKind.REVIEWED, WHOLE, Decimal(0), entry))
    made += [
        _by_hand(AdjustmentKind.BONUS, WHOLE, e.bonus, e) for e in listed if e.bonus is not None
    ]
    if late is not None:
        standing = result.score.earned + sum((change.points for change in made), Decimal(0))
        made += _lateness(standing, listed, late, submitted)
    return replace(result, adjustments=tuple(made))


def _changed(points: Decimal, entry: Override, possible: Decimal) -> Decimal:
    if entry.excused:
        return possible
    wanted = entry.set_ if entry.set_ is not None else points + (entry.add or Decimal(0))
    return min(max(wanted, Decimal(0)), possible)


def _by_hand(kind: AdjustmentKind, what: str, points: Decimal, entry: Override) -> Adjustment:
    reason = entry.reason or entry.appeal or ""
    return Adjustment(kind, what, points, reason, entry.who, entry.when, entry.comment or "")


def _lateness(
    standing: Decimal, entries: list[Override], late: LatePolicy, submitted: datetime | None
) -> list[Adjustment]:
    """Return what moved the times, and what lateness takes of the points that stand."""
    due, changes = late.due, []
    for entry in entries:
        if entry.submitted is not None:
            submitted = entry.submitted
            changes.append(
                _by_hand(AdjustmentKind.SUBMITTED, time_text(submitted), Decimal(0), entry)
            )
        elif entry.due is not None or entry.extension is not None:
            due = entry.due if entry.due is not None else due + (entry.extension or timedelta())
            changes.append(
                _by_hand(AdjustmentKind.EXTENSION, f"due {time_text(due)}", Decimal(0), entry)
            )
    if submitted is None:
        reason = "It is not known when this was handed in, so it does not count as late."
        return [*changes, Adjustment(AdjustmentKind.LATE, WHOLE, Decimal(0), reason)]
    if submitted > due:
        behind = submitted - due
        reason = f"Handed in {time_text(submitted)}, {span_text(behind)} after it was due. {_price(late, behind)}"
        changes.append(
            Adjustment(AdjustmentKind.LATE, WHOLE, -late.deduction(standing, behind), reason)
        )
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
    days, is_exact = late.days(behind), late.counts == "exact time"
    number = f"{days:.2f}" if is_exact else f"{days.normalize():f}"
    word = "" if is_exact else late.counts.removesuffix("days")
    limit = f", at most {late.at_most}" if late.at_most is not None else ""
    of = " of the points" if late.per_day.percent else ""
    return f"{number} {word}day{'s' * (number != '1')} at {late.per_day}{of}{limit}."
