"""Numbers and texts in fields: right, wrong and borderline values, and delays of the machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.checks.fields import FieldRange, numbers_in
from grader.result import Finding, Outcome
from tests.synthetic import TEXT, Session, evenly, judged

TOPIC, TWIST, POINT = "/cmd_vel", "geometry_msgs/msg/Twist", "geometry_msgs/msg/Point"
LIMITS = {"topic": TOPIC, "field": "linear.x", "low": 0.0, "high": 0.5}
CALLED = {"topic": "/state", "field": "data", "pattern": r"^(?P<state>[A-Z]+),(?P<x>[-0-9.]+)$"}


def driven(folder: Path, speeds: Sequence[float], rate_hz: float = 10.0) -> Session:
    """Make a session with a node that commands speeds."""
    times = [1.0 + n / rate_hz for n in range(len(speeds))]
    return (
        Session(folder).process().typed(TOPIC, TWIST, [{"linear": {"x": v}} for v in speeds], times)
    )


def in_range(folder: Path, speeds: Sequence[float], **more: Any) -> Finding:
    """Judge speeds by the limits."""
    return judged("field_range", {**LIMITS, **more}, driven(folder, speeds))


def test_numbers_within_the_limits_pass_and_the_limits_belong_to_them(tmp_path: Path) -> None:
    """0.5 is not above 0.5."""
    finding = in_range(tmp_path, [0.0, 0.2, 0.5])
    assert finding.outcome is Outcome.PASSED
    assert finding.measured == "3 of 3 messages"


def test_the_worst_message_is_shown_with_its_time(tmp_path: Path) -> None:
    """Credit is the share of messages; the farthest beyond is the reason, and where."""
    finding = in_range(tmp_path, [0.1] * 8 + [0.6, 0.9])
    assert finding.credit == Decimal("0.8")
    assert (
        finding.reason
        == "At 1.90 s linear.x is 0.900, above 0.5. It is outside of the limits in 2 messages."
    )
    assert finding.where[0].start_s == pytest.approx(1.9)


@pytest.mark.parametrize(
    ("wrong", "credit"), [(0, "1"), (1, "0.9"), (10, "0.8"), (30, "0.4"), (50, "0"), (60, "0")]
)
def test_credit_falls_to_the_share_from_which_there_is_none(
    tmp_path: Path, wrong: int, credit: str
) -> None:
    """One wrong message is seen, however many are right."""
    finding = in_range(tmp_path, [0.1] * (100 - wrong) + [0.6] * wrong, none_below="50%")
    assert finding.credit == Decimal(credit)


def test_a_share_may_be_wrong_where_the_rubric_says_so(tmp_path: Path) -> None:
    """With `full_from` a few wrong ones cost nothing."""
    assert in_range(tmp_path, [0.1] * 96 + [0.6] * 4, full_from="95%").outcome is Outcome.PASSED
    assert in_range(tmp_path, [0.1] * 94 + [0.6] * 6, full_from="95%").outcome is Outcome.PARTIAL


def test_what_is_not_finite_is_wrong_unless_it_may_be(tmp_path: Path) -> None:
    """A laser's range is infinite where nothing is; then only numbers count."""
    ranges = [{"ranges": [1.0, math.inf, math.nan]}]
    scan = {"topic": "/scan", "field": "ranges", "low": 0.1}
    for finite, outcome in ((True, Outcome.FAILED), (False, Outcome.PASSED)):
        session = Session(tmp_path / str(finite)).typed(
            "/scan", "sensor_msgs/msg/LaserScan", ranges, [1.0]
        )
        finding = judged("field_range", {**scan, "finite": finite}, session)
        assert finding.outcome is outcome
        assert finite == ("ranges[1] is inf" in finding.reason)


def test_each_element_has_its_limit_and_another_number_of_them_is_wrong(tmp_path: Path) -> None:
    """A list of limits is for as many numbers."""
    points = [{"x": 1.0, "y": 5.0, "z": 0.0}]
    for name, high, words in (
        ("right", (1.0, 5.0, 0.0), ""),
        ("low", (1.0, 4.0, 0.0), "[1] is 5.000, above 4"),
    ):
        session = Session(tmp_path / name).typed(
            "/p", "geometry_msgs/msg/PointStamped", [{"point": points[0]}], [1.0]
        )
        assert (
            words
            in judged(
                "field_range", {"topic": "/p", "field": "point", "high": high}, session
            ).reason
        )
    session = Session(tmp_path / "two").typed(
        "/p", "geometry_msgs/msg/PointStamped", [{"point": points[0]}], [1.0]
    )
    finding = judged("field_range", {"topic": "/p", "field": "point", "high": (1.0, 2.0)}, session)
    assert "holds 3 numbers, not 2" in finding.reason


def test_a_number_that_changes_too_fast_is_shown(tmp_path: Path) -> None:
    """0.1 in 0.1 s is 1 a second; 0.3 is 3."""
    finding = in_range(tmp_path, [0.0, 0.1, 0.2, 0.5, 0.5], change_per_s=1.01)
    assert finding.credit == Decimal("0.8")
    assert "changes by 3 a second, more than 1.01" in finding.reason


def test_a_fast_change_is_in_doubt_where_the_machine_was_late(tmp_path: Path) -> None:
    """A message that the machine delayed may have been computed in time.

    A delay at another moment excuses nothing.
    """
    speeds = [0.0, 0.1, 0.2, 0.5, 0.5]
    late = driven(tmp_path / "late", speeds).disturbed("it", (1.25, 0.04))
    assert (
        judged("field_range", {**LIMITS, "change_per_s": 1.01}, late).outcome
        is Outcome.INCONCLUSIVE
    )
    calm = driven(tmp_path / "calm", speeds).disturbed("it", (3.0, 0.5))
    assert judged("field_range", {**LIMITS, "change_per_s": 1.01}, calm).outcome is Outcome.PARTIAL


def test_a_silent_topic_fails_once(tmp_path: Path) -> None:
    """Without messages there is nothing in range."""
    finding = judged("field_range", LIMITS, Session(tmp_path).process())
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "No message arrived on /cmd_vel."


def test_the_name_that_the_student_used_is_followed(tmp_path: Path) -> None:
    """Another name is charged where the topic is asked for."""
    session = Session(tmp_path).typed("/vel", TWIST, [{}], [1.0]).called(f"{TOPIC}=/vel")
    assert judged("field_range", LIMITS, session).outcome is Outcome.PASSED


def test_numbers_in_a_text_are_like_fields(tmp_path: Path) -> None:
    """A pattern's groups are the numbers; a text without them holds none."""
    parameters = {"topic": "/state", "field": "data", "pattern": "x=([-0-9.]+)", "high": 2.0}
    session = Session(tmp_path).texts("/state", ["x=1.5", "x=2.5", "nothing"], [1.0, 2.0, 3.0])
    finding = judged("field_range", parameters, session)
    assert finding.measured == "1 of 3 messages"
    assert "the message holds no numbers" in finding.reason


@given(st.text(max_size=50))
def test_hostile_texts_hold_no_numbers_and_break_nothing(text: str) -> None:
    """Any text of a student gives numbers or none."""
    row = numbers_in(r"(?P<a>\S+)", text)
    assert row is None or len(row) == 1


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_more_right_messages_never_earn_less(one: float, other: float) -> None:
    """Credit grows with the share."""
    p = FieldRange.model_validate({**LIMITS, "full_from": 0.9, "none_below": 0.2})
    less, more = sorted((one, other))
    assert p.credit(less) <= p.credit(more)


# -- texts -----------------------------------------------------------------------------------------


def said(folder: Path, *texts: str) -> Session:
    """Make a session with a node that publishes texts."""
    return Session(folder).process().texts("/state", texts, evenly(1, len(texts) - 1))


def test_texts_of_the_form_pass(tmp_path: Path) -> None:
    """All texts match, and their numbers are within limits."""
    parameters = {**CALLED, "numbers": {"x": {"low": 0.0, "high": 2.0}}}
    assert (
        judged("field_matches", parameters, said(tmp_path, "FAR,2.0", "NEAR,0.1")).outcome
        is Outcome.PASSED
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("near,0.1", "the message is 'near,0.1'"),
        ("NEAR,2.1", "x is 2.1, not at least 0 and at most 2"),
        ("A,--", "no number"),
    ],
)
def test_the_first_text_of_another_form_is_shown(tmp_path: Path, text: str, words: str) -> None:
    """A text that does not match, or a number out of range, costs its share."""
    finding = judged(
        "field_matches",
        {**CALLED, "numbers": {"x": {"low": 0, "high": 2}}},
        said(tmp_path, "A,1", text),
    )
    assert finding.credit == Decimal("0.5")
    assert finding.reason.startswith("At 2.00 s ")
    assert words in finding.reason


def test_states_come_in_order(tmp_path: Path) -> None:
    """Others may come between; one that is missing costs its share, and so does all after it."""
    parameters = {**CALLED, "in_order": ["^SEARCH", "^DETECTED", "^DONE"]}
    right = judged(
        "field_matches",
        parameters,
        said(tmp_path / "a", "SEARCH,0", "SEARCH,1", "DETECTED,1", "DONE,2"),
    )
    assert right.outcome is Outcome.PASSED
    wrong = judged(
        "field_matches", parameters, said(tmp_path / "b", "SEARCH,0", "DONE,1", "DETECTED,2")
    )
    assert wrong.credit == Decimal("0.833")
    assert wrong.reason == "'^DONE' does not come after '^DETECTED'."


def test_an_enum_is_compared_as_it_is_written(tmp_path: Path) -> None:
    """A number is a text for a pattern."""
    session = Session(tmp_path).typed(
        "/mode", "std_msgs/msg/UInt8", [{"data": 1}, {"data": 3}], [1.0, 2.0]
    )
    finding = judged(
        "field_matches", {"topic": "/mode", "field": "data", "pattern": "^[12]$"}, session
    )
    assert finding.credit == Decimal("0.5")
    session = Session(tmp_path / "long").typed(
        "/mode", "std_msgs/msg/Int64", [{"data": 1234567}], [1.0]
    )
    parameters = {"topic": "/mode", "field": "data", "pattern": "^1234567$"}
    assert judged("field_matches", parameters, session).outcome is Outcome.PASSED


def test_texts_of_another_type_do_not_match(tmp_path: Path) -> None:
    """If the field is missing, no message matches."""
    session = Session(tmp_path).typed("/state", TWIST, [{}], [1.0])
    assert judged("field_matches", CALLED, session).outcome is Outcome.FAILED
    assert TEXT != TWIST


@pytest.mark.parametrize("limit", [0.1, 0.7])
def test_a_limit_as_a_float32_is_that_limit(tmp_path: Path, limit: float) -> None:
    """A speed limited to 0.1 arrives as 0.10000000149."""
    session = Session(tmp_path).typed("/v", "std_msgs/msg/Float32", [{"data": limit}], [1.0])
    assert (
        judged(
            "field_range", {"topic": "/v", "field": "data", "low": limit, "high": limit}, session
        ).credit
        == 1
    )


@pytest.mark.parametrize(("per_s", "credit"), [(1.0, "1"), (1.03, "0")])
def test_who_changes_as_fast_as_allowed_is_not_too_fast(
    tmp_path: Path, per_s: float, credit: str
) -> None:
    """A timer is a tenth of a millisecond off, so that half of the steps seem a little too fast."""
    times = [1.0 + n / 100 + 0.0001 * (n % 3 == 0) for n in range(60)]
    rows = [{"data": per_s * n / 100} for n in range(60)]
    session = Session(tmp_path).process().typed("/v", "std_msgs/msg/Float64", rows, times)
    parameters = {"topic": "/v", "field": "data", "change_per_s": 1.0, "none_below": 0.9}
    assert judged("field_range", parameters, session).credit == Decimal(credit)
