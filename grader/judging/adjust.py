"""Adjusts the points after the judgement: by people's decisions first, then by lateness. Pure.

The judgement itself stays as it is; each adjustment says how many points it adds or takes, so that they add up.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from decimal import Decimal

from grader.lab.overrides import Override
from grader.lab.policy import (
    NOT_KNOWN,
    LatePolicy,
    SubmissionTime,
    earliest,
    latest,
    span_text,
    time_text,
)
from grader.result import (
    WHOLE,
    Adjustment,
    AdjustmentKind,
    CheckResult,
    CriterionResult,
    Result,
    Timing,
)

_KINDS = {
    "excused": AdjustmentKind.EXCUSED,
    "reviewed": AdjustmentKind.REVIEWED,
    "appeal": AdjustmentKind.APPEAL,
}


def adjust(
    result: Result,
    entries: Iterable[Override],
    late: LatePolicy | None = None,
    submission_time: SubmissionTime = NOT_KNOWN,
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
    adjusted = replace(result, adjustments=tuple(made), timing=None)
    return adjusted if late is None else _with_lateness(adjusted, listed, late, submission_time)


def _changed(points: Decimal, entry: Override, possible: Decimal) -> Decimal:
    if entry.excused:
        return possible
    wanted = entry.set_ if entry.set_ is not None else points + (entry.add or Decimal(0))
    return min(max(wanted, Decimal(0)), possible)


def _by_hand(kind: AdjustmentKind, what: str, points: Decimal, entry: Override) -> Adjustment:
    reason = entry.reason or entry.appeal or ""
    return Adjustment(kind, what, points, reason, entry.who, entry.when, entry.comment or "")


def _with_lateness(
    result: Result, entries: Sequence[Override], late: LatePolicy, submission_time: SubmissionTime
) -> Result:
    """Return a result with what moved its times, and with what lateness takes of the points that stand."""
    moved, due, submission_time = _times(entries, late, submission_time)
    timing = _timing(late, due, submission_time)
    costs = _lateness(result.final, late, due, submission_time, timing)
    return replace(result, adjustments=(*result.adjustments, *moved, *costs), timing=timing)


def _times(
    entries: Iterable[Override], late: LatePolicy, submission_time: SubmissionTime
) -> tuple[list[Adjustment], datetime, SubmissionTime]:
    """Return the decisions that move times, when it is due with these, and when it was handed in."""
    due, moved = late.due, []
    for entry in entries:
        if entry.submitted is not None:
            submission_time = replace(submission_time, at=entry.submitted, source=entry.who)
            kind, what = AdjustmentKind.SUBMITTED, time_text(entry.submitted)
        elif entry.due is not None or entry.extension is not None:
            due = entry.due if entry.due is not None else due + (entry.extension or timedelta())
            kind, what = AdjustmentKind.EXTENSION, f"due {time_text(due)}"
        else:
            continue
        moved.append(_by_hand(kind, what, Decimal(0), entry))
    return moved, due, submission_time


def _timing(late: LatePolicy, due: datetime, submission_time: SubmissionTime) -> Timing:
    """Compare when it was due and handed in.

    A time without offset from UTC counts as early or late only if it is so wherever its clock stands.
    """
    at, is_late, may_be_late = submission_time.at, None, False
    if at is not None:
        if latest(at) <= due:
            is_late = False
        elif earliest(at) > due and at.utcoffset() is not None:
            is_late = True
        else:
            may_be_late = True
    elif submission_time.newest_file is not None:
        may_be_late = latest(submission_time.newest_file) > due
    return Timing(
        due=time_text(due),
        due_for_all=time_text(late.due) if due != late.due else "",
        submission_time=_known(at),
        source=submission_time.source,
        newest_file=_known(submission_time.newest_file),
        late=is_late,
        may_be_late=may_be_late,
    )


def _known(time: datetime | None) -> str:
    """Write a time, and say so if its zone is not known; empty for none."""
    if time is None:
        return ""
    return time_text(time) + ("" if time.utcoffset() is not None else ", time zone not known")


def _lateness(
    standing: Decimal,
    late: LatePolicy,
    due: datetime,
    submission_time: SubmissionTime,
    timing: Timing,
) -> list[Adjustment]:
    """Return what lateness takes of the points that stand, if it is certain."""
    if timing.late is False:
        return []
    if timing.late is None or submission_time.at is None:
        return [Adjustment(AdjustmentKind.LATE, WHOLE, Decimal(0), _unknown(timing))]
    behind = submission_time.at - due
    reason = (
        f"Handed in {timing.submission_time}, {span_text(behind)} after it was due. "
        f"{_price(late, behind)}"
    )
    return [Adjustment(AdjustmentKind.LATE, WHOLE, -late.deduction(standing, behind), reason)]


def _unknown(timing: Timing) -> str:
    """Say why nothing is taken although it is not known to be in time."""
    if timing.submission_time:
        return (
            f"Handed in {timing.submission_time} (by {timing.source}). It does not count as late until "
            "the time zone is known: the rubric's policy can name it by the key timezone."
        )
    reason = "It is not known when this was handed in, so it does not count as late."
    if timing.newest_file:
        reason += (
            f" The newest file in it says {timing.newest_file}. A clock of the student's machine "
            "proves nothing, so a person decides."
        )
    return reason


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
