"""Adjusts the points after the judgement: by people's decisions first, then by lateness. Pure.

The judgement itself stays as it is. Each adjustment states the points that it adds or takes; the sum gives the total.
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
    """Return a result with new adjustments in place of the previous ones.

    The points of a check, and of a criterion, stay between 0 and its possible points; only a bonus exceeds them. Checks
    come first, then criteria, then the whole, and lateness last: lateness takes a share of the points that stand by
    then. The total is never below 0.
    """
    listed = list(entries)
    made = _decisions(result, listed)
    for entry in listed:
        if entry.bonus is not None:
            made.append(_by_hand(AdjustmentKind.BONUS, WHOLE, entry.bonus, entry))
    adjusted = replace(result, adjustments=tuple(made), timing=None)
    if late is None:
        return adjusted
    return _with_lateness(adjusted, listed, late, submission_time)


def _decisions(result: Result, entries: Iterable[Override]) -> list[Adjustment]:
    """Return the decisions about checks and criteria, and the reviews of the whole."""
    standing = _Standing(result)
    made = []
    for entry in sorted(entries, key=lambda entry: entry.check is None):
        id_ = entry.check or entry.criterion
        if id_ is None:
            if entry.change == "reviewed":
                made.append(_by_hand(AdjustmentKind.REVIEWED, WHOLE, Decimal(0), entry))
        elif standing.knows(entry):
            kind = _KINDS.get(entry.change, AdjustmentKind.POINTS)
            made.append(_by_hand(kind, id_, standing.change(entry), entry))
    return made


class _Standing:
    """The points of each check and criterion after the decisions so far."""

    def __init__(self, result: Result) -> None:
        self._checks: dict[str, CheckResult] = {}
        self._criteria: dict[str, CriterionResult] = {}
        self._criterion_of: dict[str, str] = {}
        for criterion in result.criteria:
            self._criteria[criterion.id] = criterion
            for check in criterion.checks:
                self._checks[check.id] = check
                self._criterion_of[check.id] = criterion.id
        #: Points by the ids of checks, and of criteria.
        self._of_checks = {id_: check.earned for id_, check in self._checks.items()}
        self._of_criteria = {id_: each.earned for id_, each in self._criteria.items()}

    def knows(self, entry: Override) -> bool:
        """Tell whether the check or criterion of a decision was judged."""
        if entry.check is not None:
            return entry.check in self._checks
        return entry.criterion in self._criteria

    def change(self, entry: Override) -> Decimal:
        """Apply a decision, and return the points that it adds or takes."""
        if entry.check is None:
            assert entry.criterion is not None
            possible = self._criteria[entry.criterion].possible
            return _apply(entry, self._of_criteria, entry.criterion, possible)
        change = _apply(entry, self._of_checks, entry.check, self._checks[entry.check].possible)
        self._of_criteria[self._criterion_of[entry.check]] += change
        return change


def _apply(entry: Override, points: dict[str, Decimal], id_: str, possible: Decimal) -> Decimal:
    """Apply a decision to the points of a part, and return the difference."""
    before = points[id_]
    points[id_] = _changed(before, entry, possible)
    return points[id_] - before


def _changed(points: Decimal, entry: Override, possible: Decimal) -> Decimal:
    """Return points after a decision, between 0 and the possible points."""
    if entry.excused:
        return possible
    wanted = entry.set_
    if wanted is None:
        wanted = points + (entry.add or Decimal(0))
    return min(max(wanted, Decimal(0)), possible)


def _by_hand(kind: AdjustmentKind, what: str, points: Decimal, entry: Override) -> Adjustment:
    reason = entry.reason or entry.appeal or ""
    return Adjustment(kind, what, points, reason, entry.who, entry.when, entry.comment or "")


def _with_lateness(
    result: Result, entries: Sequence[Override], late: LatePolicy, submission_time: SubmissionTime
) -> Result:
    """Return a result with the decisions about its times, and with the cost of lateness."""
    moved, due, submission_time = _times(entries, late, submission_time)
    timing = _timing(late, due, submission_time)
    costs = _lateness(result.final, late, due, submission_time, timing)
    return replace(result, adjustments=(*result.adjustments, *moved, *costs), timing=timing)


def _times(
    entries: Iterable[Override], late: LatePolicy, submission_time: SubmissionTime
) -> tuple[list[Adjustment], datetime, SubmissionTime]:
    """Return the decisions about times, the due time after these, and the submission time."""
    due = late.due
    moved = []
    for entry in entries:
        if entry.submitted is not None:
            submission_time = replace(submission_time, at=entry.submitted, source=entry.who)
            submitted = time_text(entry.submitted)
            moved.append(_by_hand(AdjustmentKind.SUBMITTED, submitted, Decimal(0), entry))
            continue
        if entry.due is not None:
            due = entry.due
        elif entry.extension is not None:
            due += entry.extension
        else:
            continue
        what = f"due {time_text(due)}"
        moved.append(_by_hand(AdjustmentKind.EXTENSION, what, Decimal(0), entry))
    return moved, due, submission_time


def _timing(late: LatePolicy, due: datetime, submission_time: SubmissionTime) -> Timing:
    """Compare the due time with the submission time."""
    return Timing(
        due=time_text(due),
        due_for_all=time_text(late.due) if due != late.due else "",
        submission_time=_known(submission_time.at),
        source=submission_time.source,
        newest_file=_known(submission_time.newest_file),
        last_commit=_known(submission_time.last_commit),
        marked_late_by=submission_time.marked_late_by,
        late=_is_late(due, submission_time.at),
        may_be_late=_may_be_late(due, submission_time),
    )


def _may_be_late(due: datetime, submission_time: SubmissionTime) -> bool:
    """Tell whether a person should look, because the lateness of a submission is not certain."""
    if submission_time.at is not None:
        return _is_late(due, submission_time.at) is None
    if submission_time.marked_late_by:
        return True
    for claimed in (submission_time.newest_file, submission_time.last_commit):
        if claimed is not None and latest(claimed) > due:
            return True
    return False


def _is_late(due: datetime, at: datetime | None) -> bool | None:
    """Tell whether a submission time is after the due time; None if that is not certain.

    A time without offset from UTC counts as early or late only if it is so in every time zone.
    """
    if at is None:
        return None
    if latest(at) <= due:
        return False
    if earliest(at) > due and at.utcoffset() is not None:
        return True
    return None


def _known(time: datetime | None) -> str:
    """Write a time, and whether its zone is unknown; empty for none."""
    if time is None:
        return ""
    if time.utcoffset() is None:
        return f"{time_text(time)}, time zone not known"
    return time_text(time)


def _lateness(
    standing: Decimal,
    late: LatePolicy,
    due: datetime,
    submission_time: SubmissionTime,
    timing: Timing,
) -> list[Adjustment]:
    """Return the cost of lateness in points that stand, if the lateness is certain."""
    if timing.late is False:
        return []
    if timing.late is None or submission_time.at is None:
        return [Adjustment(AdjustmentKind.LATE, WHOLE, Decimal(0), _unknown(timing))]
    behind = submission_time.at - due
    sentence = f"Handed in {timing.submission_time}, {span_text(behind)} after it was due."
    reason = f"{sentence} {_price(late, behind)}"
    return [Adjustment(AdjustmentKind.LATE, WHOLE, -late.deduction(standing, behind), reason)]


def _unknown(timing: Timing) -> str:
    """Say why lateness costs nothing although the submission may be late."""
    if timing.submission_time:
        return (
            f"Handed in {timing.submission_time} (by {timing.source}). It does not count as late until "
            "the time zone is known: the rubric's policy can name it by the key timezone."
        )
    reason = "It is not known when this was handed in, so nothing is deducted."
    for clue in timing.clues:
        reason += f" {clue[0].upper()}{clue[1:]}."
    if timing.clues:
        reason += " That does not prove the time of submission, so a person decides."
    return reason


def _price(late: LatePolicy, behind: timedelta) -> str:
    """Say how lateness is counted, such as `2 days at 10 % of the points, at most 50 %.`."""
    if behind <= late.grace:
        return f"Up to {span_text(late.grace)} costs nothing."
    if late.never_after is not None and behind > late.never_after:
        limit = f"more than {span_text(late.never_after)} " if late.never_after else ""
        return f"Nothing is accepted {limit}after it is due."
    if late.per_day is None:
        return "That costs nothing."
    price = f"{_days(late, behind)} at {late.per_day}"
    if late.per_day.percent:
        price += " of the points"
    if late.at_most is not None:
        price += f", at most {late.at_most}"
    return f"{price}."


def _days(late: LatePolicy, behind: timedelta) -> str:
    """Write the counted days, such as `1 day`, `2 started days` or `1.25 days`."""
    days = late.days(behind)
    if late.counts == "exact time":
        number = f"{days:.2f}"
        word = "day"
    else:
        number = f"{days.normalize():f}"
        word = f"{late.counts.removesuffix('days')}day"
    return f"{number} {word}" if number == "1" else f"{number} {word}s"
