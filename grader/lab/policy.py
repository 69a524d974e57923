"""The lab's rules about lateness, and times as people write them: "10 min", "2 days", "10 %", a date with its zone."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import date, datetime, timedelta, timezone
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_DOWN, Decimal
from typing import Annotated, Any, Literal
from zoneinfo import ZoneInfo, available_timezones

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from grader.lab.similar_words import meant
from grader.lab.yaml_with_lines import Strict

_TENTH = Decimal("0.1")
_DAY = timedelta(days=1)
_UNITS = {
    **dict.fromkeys(("min", "minute", "minutes"), timedelta(minutes=1)),
    **dict.fromkeys(("h", "hour", "hours"), timedelta(hours=1)),
    **dict.fromkeys(("d", "day", "days"), _DAY),
    **dict.fromkeys(("w", "week", "weeks"), timedelta(weeks=1)),
}
_SPAN = re.compile(r"(\d{1,6}(?:\.\d{1,3})?)\s*([a-z]+)")
_SPANS = re.compile(rf"(?:{_SPAN.pattern}\s*)+")
_AMOUNT = re.compile(r"(\d{1,6}(?:\.\d{1,3})?)\s*(%|points?)")


def _time_span(value: Any) -> Any:
    if isinstance(value, timedelta):
        return value
    text = ""
    if isinstance(value, str):
        text = value.strip().lower()
    parts = _SPAN.findall(text)
    units = {unit for _, unit in parts}
    if not (_SPANS.fullmatch(text) and units <= _UNITS.keys()):
        raise ValueError("a time with its unit is expected, such as 10 min, 36 h or 2 days")
    total = timedelta()
    for number, unit in parts:
        total += float(number) * _UNITS[unit]
    return total


def _moment(value: Any) -> Any:
    moment = parse_time(value) if isinstance(value, str) else value
    if not isinstance(moment, datetime):
        raise ValueError("a date with its time is expected, such as 2026-11-20T23:59:00+01:00")
    if moment.utcoffset() is None:
        raise ValueError("the time needs its offset from UTC, such as +01:00, or Z")
    return moment


def parse_time(text: str) -> datetime | None:
    """Read a date with its time from ISO 8601, also with "UTC" at its end, as GitHub and Canvas write it."""
    try:
        joined = re.sub(r"(?<!\s)\s+(?=[+-]|([Zz]|UTC)$)", "", text.strip())
        return datetime.fromisoformat(re.sub(r"([Zz]|UTC)$", "+00:00", joined))
    except ValueError:
        return None


#: A length of time, written as "10 min", "36 h", "2 days" or "1 day 12 h".
TimeSpan = Annotated[
    timedelta,
    BeforeValidator(_time_span),
    WithJsonSchema(
        {
            "type": "string",
            "pattern": _SPANS.pattern,
            "description": "A time, such as 10 min or 2 days.",
        }
    ),
]
#: A date and time with its offset from UTC.
Moment = Annotated[
    datetime,
    BeforeValidator(_moment),
    WithJsonSchema(
        {
            "type": "string",
            "description": "A date with its time, such as 2026-11-20T23:59:00+01:00.",
        }
    ),
]


@dataclass(frozen=True)
class Amount:
    """Points, or a share of points in per cent."""

    value: Decimal
    percent: bool

    def of(self, points: Decimal) -> Decimal:
        """Return the points that this is of some points; not rounded."""
        if self.percent:
            return points * self.value / 100
        return self.value

    def __str__(self) -> str:
        if self.percent:
            return f"{self.value:f} %"
        if self.value == 1:
            return f"{self.value:f} point"
        return f"{self.value:f} points"


def _amount(value: Any) -> Any:
    if isinstance(value, Amount):
        return value
    found = None
    if isinstance(value, str):
        found = _AMOUNT.fullmatch(value.strip().lower())
    if found is None:
        raise ValueError("an amount with its unit is expected, such as 10 % or 5 points")
    number, unit = Decimal(found[1]), found[2]
    if unit == "%" and number > 100:
        raise ValueError("more than 100 % cannot be taken")
    return Amount(number, unit == "%")


#: Points, or a share of them, written as "10 %" or "5 points".
MaybeAmount = Annotated[
    Amount | None,
    BeforeValidator(lambda value: None if value is None else _amount(value)),
    WithJsonSchema({"type": "string", "description": "An amount, such as 10 % or 5 points."}),
]


class LatePolicy(Strict):
    """The penalty for lateness."""

    due: Moment
    grace: TimeSpan = Field(
        timedelta(),
        description="Lateness up to this costs nothing; beyond it, time counts from the due date.",
    )
    per_day: MaybeAmount = Field(
        None,
        description="Points, or a share of the points that the submission would have without it.",
    )
    at_most: MaybeAmount = Field(
        None, description="What lateness costs at most, short of `never_after`."
    )
    counts: Literal["started days", "full days", "exact time"] = Field(
        "started days", description="How time after the due date becomes days."
    )
    never_after: TimeSpan | None = Field(
        None,
        description="Time after the due date from when nothing is accepted: all points are lost.",
    )

    @model_validator(mode="after")
    def _costs_something(self) -> LatePolicy:
        if self.per_day is None and self.never_after is None:
            raise ValueError("one of per_day and never_after is needed, or lateness costs nothing")
        if self.at_most is not None and self.per_day is None:
            raise ValueError("at_most limits per_day, which is missing")
        return self

    def deduction(self, points: Decimal, late: timedelta) -> Decimal:
        """Return the penalty for a lateness (negative: in time), from 0 to all of the points, in tenths."""
        if late <= max(self.grace, timedelta()):
            return Decimal(0)
        if self.never_after is not None and late > self.never_after:
            return points
        if self.per_day is None:
            return Decimal(0)
        taken = self.per_day.of(points) * self.days(late)
        if self.at_most is not None:
            taken = min(taken, self.at_most.of(points))
        return min(taken.quantize(_TENTH, ROUND_HALF_DOWN), points)

    def days(self, late: timedelta) -> Decimal:
        """Return how many days a lateness counts as."""
        unit = timedelta(microseconds=1)
        exact = Decimal(late // unit) / Decimal(_DAY // unit)
        if self.counts == "exact time":
            return exact
        if self.counts == "started days":
            return exact.to_integral_value(ROUND_CEILING)
        return exact.to_integral_value(ROUND_FLOOR)


def _zone_name(value: Any) -> Any:
    if value is None:
        return value
    if isinstance(value, str) and value in available_timezones():
        return value
    near = meant(str(value), sorted(available_timezones()))
    raise ValueError(f"a time zone is expected, such as Europe/Berlin{near}")


#: The name of a time zone in the IANA database.
MaybeZone = Annotated[
    str | None,
    BeforeValidator(_zone_name),
    WithJsonSchema({"type": "string", "description": "A time zone, such as Europe/Berlin."}),
]


_ADDRESS = re.compile(r"[A-Za-z0-9._+-]{1,64}@[A-Za-z0-9-]{1,63}(?:\.[A-Za-z0-9-]{1,63}){1,8}")


def _address(value: Any) -> Any:
    if value is None:
        return value
    if isinstance(value, str) and _ADDRESS.fullmatch(value):
        return value
    raise ValueError("a mail address is expected, such as ros-lab@example.edu")


#: A mail address.
MaybeAddress = Annotated[
    str | None,
    BeforeValidator(_address),
    WithJsonSchema(
        {
            "type": "string",
            "pattern": f"^{_ADDRESS.pattern}$",
            "description": "A mail address, such as ros-lab@example.edu.",
        }
    ),
]


@dataclass(frozen=True)
class SubmissionTime:
    """When a submission was handed in, and how that is known."""

    #: As the source says it: without offset from UTC if the source has none. None if nothing tells.
    at: datetime | None = None
    #: The source, in words, e.g. "the class list".
    source: str = ""
    #: The time of the newest file in the student's archive, which proves nothing.
    newest_file: datetime | None = None
    #: The time of the last commit in the student's repository, which proves nothing.
    last_commit: datetime | None = None
    #: The learning-management system that marks the submission as late, e.g. "Canvas"; empty for none.
    marked_late_by: str = ""


#: Nothing tells the time of submission.
NOT_KNOWN = SubmissionTime()


class Policy(Strict):
    """Rules of a rubric beside points: the penalty for lateness, if there is one."""

    late: LatePolicy | None = None
    timezone: MaybeZone = Field(
        None,
        description="Time zone of the times in downloads and class lists that name none.",
    )
    questions_to: MaybeAddress = Field(
        None,
        description="Mail address for students' questions about a check; each check of a report links to it.",
    )

    def zoned(self, submission_time: SubmissionTime) -> SubmissionTime:
        """Return times of submission with their offset from UTC, as far as the policy names the zone of all others."""
        at = self._zoned(submission_time.at)
        newest_file = self._zoned(submission_time.newest_file)
        last_commit = self._zoned(submission_time.last_commit)
        return replace(submission_time, at=at, newest_file=newest_file, last_commit=last_commit)

    def _zoned(self, time: datetime | None) -> datetime | None:
        if time is None or self.timezone is None:
            return time
        if time.utcoffset() is not None:
            return time
        # An hour that the clocks repeat counts as the first, in the student's favour.
        return time.replace(tzinfo=ZoneInfo(self.timezone), fold=0)


#: Offsets from UTC of the clocks that are first and last to show a time.
_FIRST_CLOCK, _LAST_CLOCK = timedelta(hours=14), timedelta(hours=-12)


def earliest(moment: datetime) -> datetime:
    """Return the first instant at which a clock somewhere shows a time; the time itself if it has its offset."""
    if moment.utcoffset() is not None:
        return moment
    return moment.replace(tzinfo=timezone(_FIRST_CLOCK))


def latest(moment: datetime) -> datetime:
    """Return the last instant at which a clock somewhere shows a time; the time itself if it has its offset."""
    if moment.utcoffset() is not None:
        return moment
    return moment.replace(tzinfo=timezone(_LAST_CLOCK))


def time_text(moment: datetime | date) -> str:
    """Write a date, with time and offset where it has them, e.g. "2026-11-20 23:59 +01:00"."""
    if not isinstance(moment, datetime):
        return moment.isoformat()
    written, offset = moment.strftime("%Y-%m-%d %H:%M"), moment.strftime("%z")
    if offset:
        return f"{written} {offset[:3]}:{offset[3:5]}"
    return written


def span_text(span: timedelta) -> str:
    """Write a length of time with its two largest units, rounded down; "less than a minute" below one."""
    minutes = int(span.total_seconds() // 60)
    parts = ((minutes // 1440, "day"), (minutes // 60 % 24, "h"), (minutes % 60, "min"))
    words = [_counted(n, unit) for n, unit in parts if n]
    if not words:
        return "less than a minute"
    return " ".join(words[:2])


def _counted(number: int, unit: str) -> str:
    """Write a number with its unit, e.g. "1 day", "2 days" and "2 h"."""
    if number == 1 or unit != "day":
        return f"{number} {unit}"
    return f"{number} {unit}s"
