"""Times and amounts in people's writing, and the cost of lateness."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from grader.lab.policy import LatePolicy, parse_time, span_text, time_text

DUE = "2026-11-20T23:59:00+01:00"
POINTS = st.decimals(0, 120, places=1)
LATENESS = st.timedeltas(timedelta(days=-3), timedelta(days=30))


def policy(**parts: Any) -> LatePolicy:
    """Give a policy with a due date."""
    return LatePolicy.model_validate({"due": DUE, **parts})


def hours(number: float) -> timedelta:
    """Give a length of time."""
    return timedelta(hours=number)


# -- what people write -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "span"),
    [
        ("10 min", timedelta(minutes=10)),
        ("36h", timedelta(hours=36)),
        ("2 days", timedelta(days=2)),
        ("1 Day 12 h", timedelta(hours=36)),
        ("1.5 d", timedelta(hours=36)),
        ("0 min", timedelta()),
    ],
)
def test_times_with_their_units(text: str, span: timedelta) -> None:
    """A length of time is a number with a unit, or several."""
    assert policy(per_day="10 %", grace=text).grace == span


@pytest.mark.parametrize(
    "value", ["10", 10, "10 s", "two days", "", None, "-1 h", "1 h,", True, ["1 h"]]
)
def test_times_without_a_unit_are_mistakes(value: object) -> None:
    """A time that could be minutes as well as days is refused."""
    with pytest.raises(ValidationError, match="a time with its unit is expected"):
        policy(per_day="10 %", grace=value)


@pytest.mark.parametrize("value", ["10", 10, "10 percent", "101 %", "-5 points", "", None])
def test_amounts_without_a_unit_are_mistakes(value: object) -> None:
    """An amount that could be points as well as per cent is refused, and so is more than all."""
    with pytest.raises(ValidationError):
        policy(per_day=value)


@pytest.mark.parametrize(
    "value", ["2026-11-20", "2026-11-20T23:59:00", "tomorrow", 5, datetime(2026, 11, 20)]
)
def test_a_due_date_needs_its_time_and_offset(value: object) -> None:
    """A date alone, or one that means another moment in each country, is refused."""
    with pytest.raises(ValidationError, match=r"expected|offset"):
        LatePolicy.model_validate({"due": value, "per_day": "10 %"})


def test_a_time_may_end_in_z() -> None:
    """Z stands for UTC, on every version of Python, and so does UTC itself."""
    assert parse_time("2026-11-20T22:59:00Z") == datetime(2026, 11, 20, 22, 59, tzinfo=UTC)
    assert parse_time("2026-11-20 22:59:00 UTC") == datetime(2026, 11, 20, 22, 59, tzinfo=UTC)
    assert parse_time("nonsense") is None


def test_a_policy_that_costs_nothing_is_a_mistake() -> None:
    """Neither a price a day nor an end: that is no policy; nor is a limit of nothing."""
    with pytest.raises(ValidationError, match="one of per_day and never_after"):
        policy()
    with pytest.raises(ValidationError, match="at_most limits per_day"):
        policy(never_after="1 day", at_most="50 %")


# -- what lateness costs ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parts", "late_h", "points", "taken"),
    [
        ({"per_day": "10 %"}, -1, "80", "0"),
        ({"per_day": "10 %"}, 0, "80", "0"),
        ({"per_day": "10 %"}, 1, "80", "8"),
        ({"per_day": "10 %"}, 24, "80", "8"),
        ({"per_day": "10 %"}, 25, "80", "16"),
        ({"per_day": "10 %", "counts": "full days"}, 47, "80", "8"),
        ({"per_day": "10 %", "counts": "full days"}, 23, "80", "0"),
        ({"per_day": "10 %", "counts": "exact time"}, 36, "80", "12"),
        ({"per_day": "5 points"}, 25, "80", "10"),
        ({"per_day": "5 points"}, 25, "7", "7"),
        ({"per_day": "1 point"}, 1, "80", "1"),
        ({"per_day": "10 %", "at_most": "15 %"}, 100, "80", "12"),
        ({"per_day": "10 %", "at_most": "3 points"}, 100, "80", "3"),
        ({"per_day": "10 %", "grace": "10 min"}, 10 / 60, "80", "0"),
        ({"per_day": "10 %", "grace": "10 min"}, 11 / 60, "80", "8"),
        ({"per_day": "10 %", "at_most": "20 %", "never_after": "7 days"}, 168, "80", "16"),
        ({"per_day": "10 %", "at_most": "20 %", "never_after": "7 days"}, 169, "80", "80"),
        ({"never_after": "0 min"}, 1, "80", "80"),
        ({"never_after": "2 days"}, 47, "80", "0"),
        ({"per_day": "10 %"}, 1, "101.5", "10.1"),
        ({"per_day": "10 %"}, 1, "0.5", "0.0"),
    ],
)
def test_the_price_of_lateness(
    parts: dict[str, str], late_h: float, points: str, taken: str
) -> None:
    """Grace, started days, limits and an end count as the lab says; halves of a tenth go to the student."""
    assert policy(**parts).deduction(Decimal(points), hours(late_h)) == Decimal(taken)


policies = st.builds(
    policy,
    per_day=st.sampled_from(["10 %", "100 %", "0.5 %", "3 points", "200 points"]),
    grace=st.sampled_from(["0 min", "10 min", "2 days"]),
    counts=st.sampled_from(["started days", "full days", "exact time"]),
) | st.builds(
    policy,
    per_day=st.sampled_from(["10 %", "3 points"]),
    at_most=st.sampled_from(["50 %", "1 point", "100 %"]),
    never_after=st.sampled_from(["0 min", "36 h", "7 days"]),
)


@given(policies, POINTS, LATENESS)
def test_a_deduction_never_takes_more_than_there_is(
    late: LatePolicy, points: Decimal, lateness: timedelta
) -> None:
    """A deduction lies between nothing and all, in tenths, and is nothing in time."""
    taken = late.deduction(points, lateness)
    assert 0 <= taken <= points
    assert taken == taken.quantize(Decimal("0.1"))
    assert lateness > timedelta() or taken == 0


@given(policies, POINTS, LATENESS, LATENESS)
def test_later_is_never_cheaper(
    late: LatePolicy, points: Decimal, one: timedelta, other: timedelta
) -> None:
    """The deduction rises with the lateness."""
    assert late.deduction(points, min(one, other)) <= late.deduction(points, max(one, other))


@given(policies, POINTS, POINTS, LATENESS)
def test_who_earned_more_keeps_more(
    late: LatePolicy, one: Decimal, other: Decimal, lateness: timedelta
) -> None:
    """The better of two equally late submissions stays the better one, to a tenth of rounding."""
    low, high = sorted((one, other))
    kept = [points - late.deduction(points, lateness) for points in (low, high)]
    assert kept[0] <= kept[1] + Decimal("0.1")


# -- in words --------------------------------------------------------------------------------------


def test_times_in_words() -> None:
    """Moments keep their offset; lengths have their two largest units."""
    moment = parse_time(DUE)
    assert moment is not None
    assert time_text(moment) == "2026-11-20 23:59 +01:00"
    assert time_text(moment.date()) == "2026-11-20"
    assert span_text(hours(25) + timedelta(minutes=3)) == "1 day 1 h"
    assert span_text(hours(49)) == "2 days 1 h"
    assert span_text(timedelta(minutes=3)) == "3 min"
    assert span_text(timedelta(seconds=59)) == "less than a minute"
