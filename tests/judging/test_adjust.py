"""Adjustments of points after the judgement: bounds, order, and stable regrading."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.judging.adjust import adjust
from grader.lab.overrides import Override
from grader.lab.policy import LatePolicy, Policy, SubmissionTime
from grader.result import AdjustmentKind, CheckResult, CriterionResult, Outcome, Result, Score

DUE = datetime.fromisoformat("2026-11-20T23:59:00+01:00")
LATE = LatePolicy.model_validate(
    {"due": DUE, "per_day": "10 %", "grace": "10 min", "never_after": "7 days"}
)


def result(*criteria: list[tuple[str, str]], undecided: bool = False) -> Result:
    """Give a result by the points earned and possible of each criterion's checks; the first may be undecided."""
    built = []
    for number, row in enumerate(criteria):
        checks = []
        for place, (earned, possible) in enumerate(row):
            is_open = undecided and number == place == 0
            outcome = Outcome.INCONCLUSIVE if is_open else Outcome.PARTIAL
            points = Decimal(0) if is_open else Decimal(earned)
            missing = Decimal(possible) if is_open else Decimal(0)
            identity = f"{'abcdefgh'[number]}.{place}"
            checks.append(CheckResult(identity, "", outcome, points, Decimal(possible), missing))
        sums = [
            sum((getattr(c, key) for c in checks), Decimal(0))
            for key in ("earned", "possible", "undecided")
        ]
        built.append(
            CriterionResult("abcdefgh"[number], "", sums[0], sums[1], sums[2], tuple(checks))
        )
    whole = []
    for key in ("earned", "possible", "undecided"):
        whole.append(sum((getattr(c, key) for c in built), Decimal(0)))
    return Result("alice", "Lab", Score(*whole), tuple(built))


def entry(**change: Any) -> Override:
    """Give a decision about alice."""
    return Override.model_validate(
        {"submission": "alice", "reason": "so", "who": "J. Smith", "when": "2026-11-21", **change}
    )


JUDGED = result([("4", "6"), ("0", "5")], [("8.5", "9")])


def points(*entries: Override, judged: Result = JUDGED) -> list[str]:
    """Return the points that each adjustment adds or takes."""
    return [str(a.points) for a in adjust(judged, entries).adjustments]


# -- decisions of people ---------------------------------------------------------------------------


def test_without_decisions_the_points_are_as_judged() -> None:
    """Without decisions there are no adjustments, and the final points are the earned ones."""
    assert adjust(JUDGED, []) == JUDGED
    assert JUDGED.final == JUDGED.score.earned == Decimal("12.5")


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"check": "a.0", "set": 6}, "2"),
        ({"check": "a.0", "set": 0}, "-4"),
        ({"check": "a.0", "add": 1.5}, "1.5"),
        ({"check": "a.0", "add": 10}, "2"),
        ({"check": "a.0", "add": -10}, "-4"),
        ({"check": "a.1", "excused": True}, "5"),
        ({"criterion": "a", "set": 3}, "-1"),
        ({"criterion": "a", "add": 20}, "7"),
        ({"criterion": "b", "excused": True}, "0.5"),
        ({"bonus": 2.5}, "2.5"),
    ],
)
def test_what_a_decision_changes(change: dict[str, object], difference: str) -> None:
    """Points are set, added or taken within a check or criterion; only a bonus goes beyond."""
    assert [Decimal(p) for p in points(entry(**change))] == [Decimal(difference)]


def test_a_decision_says_who_made_it_and_why() -> None:
    """A decision keeps its subject, reason, name and date."""
    (made,) = adjust(JUDGED, [entry(check="a.0", excused=True)]).adjustments
    assert (made.kind, made.what) == (AdjustmentKind.EXCUSED, "a.0")
    assert (made.reason, made.who, made.when) == ("so", "J. Smith", "2026-11-21")


def test_a_criterion_comes_after_its_checks() -> None:
    """A criterion's points are those with its checks' adjustments, wherever the entries stand."""
    change = points(entry(criterion="a", set=7), entry(check="a.0", set=6))
    assert change == ["2", "1"]


def test_later_decisions_build_on_earlier_ones() -> None:
    """Entries about the same check apply in their order, and each counts its own change."""
    assert points(entry(check="a.0", set=1), entry(check="a.0", add=2)) == ["-3", "2"]
    assert points(entry(check="a.0", add=2), entry(check="a.0", set=1)) == ["2", "-5"]


def test_what_was_not_judged_is_passed_over() -> None:
    """If only some sessions ran, decisions about the others wait."""
    assert points(entry(check="z.0", set=1), entry(criterion="z", excused=True)) == []


def test_an_undecided_check_can_be_decided_by_hand() -> None:
    """The points of an undecided check are given, and no longer counted as undecided."""
    judged = result([("0", "6"), ("1", "5")], undecided=True)
    assert judged.still_undecided == judged.score.undecided == 6
    for change in ({"check": "a.0", "set": 6}, {"criterion": "a", "excused": True}):
        adjusted = adjust(judged, [entry(**change)])
        assert adjusted.still_undecided == 0
        assert adjusted.score.undecided == 6
    assert adjust(judged, [entry(check="a.1", set=5), entry(bonus=1)]).still_undecided == 6


# -- lateness --------------------------------------------------------------------------------------


def late(hours: float, *entries: Override, judged: Result = JUDGED) -> Result:
    """Give the result of a submission so many hours after it was due."""
    return adjust(
        judged, entries, LATE, SubmissionTime(DUE + timedelta(hours=hours), "the class list")
    )


def test_in_time_nothing_is_said() -> None:
    """A submission in time, or a lab without a due date, has no adjustment."""
    assert late(-1).adjustments == ()
    assert late(0).adjustments == ()
    assert adjust(JUDGED, [], None, SubmissionTime(DUE + timedelta(days=9))).adjustments == ()


@pytest.mark.parametrize(
    ("hours", "taken", "words"),
    [
        (0.1, "0", "Up to 10 min costs nothing."),
        (1, "-1.2", "1 started day at 10 % of the points."),
        (25, "-2.5", "1 day 1 h after it was due. 2 started days at 10 % of the points."),
        (169, "-12.5", "Nothing is accepted more than 7 days after it is due."),
    ],
)
def test_lateness_says_what_it_costs(hours: float, taken: str, words: str) -> None:
    """The student reads when it was handed in, how late that is, and how it is counted."""
    (made,) = late(hours).adjustments
    assert (made.kind, made.points) == (AdjustmentKind.LATE, Decimal(taken))
    assert words in made.reason
    assert "Handed in 2026-11-" in made.reason
    assert (made.who, made.when) == ("", "")


@pytest.mark.parametrize(
    ("parts", "hours", "words"),
    [
        (
            {"per_day": "2 points", "at_most": "50 %"},
            25,
            "2 started days at 2 points, at most 50 %.",
        ),
        ({"per_day": "10 %", "counts": "exact time"}, 36, "1.50 days at 10 % of the points."),
        ({"per_day": "10 %", "counts": "full days"}, 25, "1 full day at 10 % of the points."),
        ({"never_after": "0 min"}, 1, "Nothing is accepted after it is due."),
        ({"never_after": "1 day"}, 1, "That costs nothing."),
    ],
)
def test_each_way_of_counting_has_its_words(parts: dict[str, str], hours: int, words: str) -> None:
    """The reason follows the lab's policy."""
    policy = LatePolicy.model_validate({"due": DUE, **parts})
    (made,) = adjust(JUDGED, [], policy, SubmissionTime(DUE + timedelta(hours=hours))).adjustments
    assert made.reason.endswith(words)


def test_a_time_that_nobody_knows_costs_nothing() -> None:
    """Without a time of submission nothing is taken, and the report says so."""
    (made,) = adjust(JUDGED, [], LATE).adjustments
    assert (made.kind, made.points) == (AdjustmentKind.LATE, Decimal(0))
    assert "not known" in made.reason


NAIVE = datetime.fromisoformat("2026-11-20T23:40:00")


def claim(known_by: str, time: datetime) -> SubmissionTime:
    """Give a time that a clock of the student's wrote."""
    known: dict[str, Any] = {known_by: time}
    return SubmissionTime(**known)


@pytest.mark.parametrize(
    ("known_by", "words"),
    [
        ("newest_file", "The newest file in it says"),
        ("last_commit", "The last commit says"),
    ],
)
def test_a_students_own_clock_never_costs_points(known_by: str, words: str) -> None:
    """Even years after it was due, the time of a file or a commit is told for a person, and takes nothing."""
    for claimed in (NAIVE, NAIVE + timedelta(days=900), DUE + timedelta(days=3)):
        adjusted = adjust(JUDGED, [], LATE, claim(known_by, claimed))
        (made,) = adjusted.adjustments
        assert made.points == 0
        assert f"{words} {claimed:%Y-%m-%d %H:%M}" in made.reason
        assert "a person decides" in made.reason
        assert adjusted.timing is not None
        assert (adjusted.timing.late, adjusted.timing.may_be_late) == (None, True)
    berlin = Policy.model_validate({"timezone": "Europe/Berlin"})
    for claimed in (NAIVE - timedelta(days=2), NAIVE):
        known = berlin.zoned(claim(known_by, claimed))
        early = adjust(JUDGED, [], LATE, known).timing
        assert early is not None
        assert (early.late, early.may_be_late) == (None, False)
        assert words.lower() in early.text.lower()


def test_a_mark_without_a_time_is_for_a_person() -> None:
    """A system's mark tells that, not by how much: nothing is taken, and it is shown beside a better time."""
    marked = SubmissionTime(marked_late_by="Canvas")
    adjusted = adjust(JUDGED, [], LATE, marked)
    assert adjusted.final == JUDGED.final
    assert "Canvas marks it as late." in adjusted.adjustments[0].reason
    assert "a person decides" in adjusted.adjustments[0].reason
    assert adjusted.timing is not None
    assert (adjusted.timing.late, adjusted.timing.may_be_late) == (None, True)
    assert "Canvas marks it as late" in adjusted.timing.text
    decided = entry(submitted=DUE + timedelta(hours=30))
    late = adjust(JUDGED, [decided], LATE, marked)
    assert late.final < JUDGED.final
    in_time = replace(marked, at=DUE - timedelta(hours=1), source="the class list")
    known = adjust(JUDGED, [], LATE, in_time).timing
    assert known is not None
    assert (known.late, known.may_be_late) == (False, False)
    assert known.text.endswith("in time. Canvas marks it as late.")


def test_a_time_without_a_zone_costs_points_nowhere() -> None:
    """A download's time without a zone is in time if it is so on every clock; else the policy's zone decides."""
    made = adjust(JUDGED, [], LATE, SubmissionTime(NAIVE, "Blackboard"))
    assert made.final == JUDGED.final
    assert "by the key timezone" in made.adjustments[0].reason
    early = adjust(JUDGED, [], LATE, SubmissionTime(NAIVE - timedelta(days=1), "Blackboard"))
    assert early.adjustments == ()
    assert early.timing is not None
    assert early.timing.late is False
    for zone, late in (("Europe/Berlin", False), ("UTC", True), ("America/Los_Angeles", True)):
        policy = Policy.model_validate({"timezone": zone})
        known = adjust(JUDGED, [], LATE, policy.zoned(SubmissionTime(NAIVE, "Blackboard")))
        assert known.timing is not None
        assert known.timing.late is late
        assert (known.final < JUDGED.final) is late


def test_what_decided_about_lateness_is_said() -> None:
    """Due time, extension, time and its source are told, also for a submission in time."""
    timing = late(-1).timing
    assert timing is not None
    assert timing.text == (
        "Handed in 2026-11-20 22:59 +01:00 (by the class list), due 2026-11-20 23:59 +01:00: in time."
    )
    extended = late(30, entry(extension="2 days")).timing
    assert extended is not None
    assert extended.text == (
        "Handed in 2026-11-22 05:59 +01:00 (by the class list), due 2026-11-22 23:59 +01:00 "
        "(extended from 2026-11-20 23:59 +01:00): in time."
    )
    by_hand = late(30, entry(submitted=DUE)).timing
    assert by_hand is not None
    assert (by_hand.source, by_hand.late) == ("J. Smith", False)


@pytest.mark.parametrize(
    ("changes", "hours", "final"),
    [
        ([{"extension": "2 days"}], 47, "12.5"),
        ([{"extension": "1 day"}, {"extension": "1 day"}], 47, "12.5"),
        ([{"extension": "1 day"}], 47, "11.3"),
        ([{"due": DUE + timedelta(days=2)}], 47, "12.5"),
        ([{"extension": "1 day"}], 24 * 8 - 1, "3.8"),
        ([{"submitted": DUE}], 500, "12.5"),
    ],
)
def test_times_can_be_moved(changes: list[dict[str, object]], hours: float, final: str) -> None:
    """An extension moves the due date and the end; a time of submission by hand goes before the recorded one."""
    adjusted = late(hours, *(entry(**change) for change in changes))
    assert adjusted.final == Decimal(final)
    assert {a.kind for a in adjusted.adjustments[: len(changes)]} <= {
        AdjustmentKind.EXTENSION,
        AdjustmentKind.SUBMITTED,
    }


def test_lateness_comes_last() -> None:
    """A share is taken of the points with all decisions, whatever the order of the entries."""
    adjusted = late(1, entry(extension="1 min"), entry(bonus=2.5), entry(check="a.1", excused=True))
    assert [a.kind.value for a in adjusted.adjustments] == ["excused", "bonus", "extension", "late"]
    assert adjusted.adjustments[-1].points == Decimal("-2.0")


# -- whatever is decided ---------------------------------------------------------------------------

tenths = st.decimals(0, 20, places=1)
rows = st.lists(
    st.tuples(tenths, tenths).map(lambda pair: (str(min(pair)), str(max(pair)))),
    min_size=1,
    max_size=4,
)
results = st.builds(
    lambda table, flag: result(*table, undecided=flag),
    st.lists(rows, min_size=1, max_size=4),
    st.booleans(),
)
parts = st.sampled_from(["check", "criterion"]).flatmap(
    lambda kind: st.fixed_dictionaries(
        {
            kind: st.sampled_from(
                ["a.0", "a.1", "b.0", "c.3", "x"] if kind == "check" else list("abcx")
            )
        }
    )
)
of_parts = st.builds(
    lambda part, change: entry(**part, **change),
    parts,
    st.one_of(
        st.fixed_dictionaries({"set": st.decimals(-5, 30, places=2)}),
        st.fixed_dictionaries({"add": st.decimals(-30, 30, places=2)}),
        st.just({"excused": True}),
    ),
)
MOVES: list[dict[str, object]] = [
    {"extension": "2 days"},
    {"due": DUE + timedelta(days=1)},
    {"submitted": DUE + timedelta(days=3)},
]
bonuses = st.decimals("0.1", 10, places=1).map(lambda points: entry(bonus=points))
decisions = st.lists(
    st.one_of(of_parts, st.sampled_from(MOVES).map(lambda change: entry(**change))), max_size=6
)
moments = st.none() | st.integers(-300, 900).map(lambda hours: DUE + timedelta(hours=hours))
moments |= st.just(DUE.replace(tzinfo=None))
policies = st.none() | st.just(LATE)


@given(results, decisions, policies, moments)
def test_the_total_stays_within_what_is_possible(
    judged: Result, entries: list[Override], policy: LatePolicy | None, submitted: datetime | None
) -> None:
    """Without a bonus the final points lie between nothing and all, and the judgement is as it was."""
    adjusted = adjust(judged, entries, policy, SubmissionTime(submitted))
    assert 0 <= adjusted.final <= adjusted.score.possible
    assert (adjusted.score, adjusted.criteria) == (judged.score, judged.criteria)


@given(results, decisions, st.lists(bonuses, max_size=3), policies, moments)
def test_only_a_bonus_goes_beyond(
    judged: Result,
    entries: list[Override],
    extra: list[Override],
    policy: LatePolicy | None,
    submitted: datetime | None,
) -> None:
    """The final points are never below nothing, and above all that is possible by at most the bonuses."""
    adjusted = adjust(judged, [*entries, *extra], policy, SubmissionTime(submitted))
    beyond = sum((e.bonus or Decimal(0) for e in extra), Decimal(0))
    assert 0 <= adjusted.final <= adjusted.score.possible + beyond


@given(results, decisions, st.lists(bonuses, max_size=2), policies, moments)
def test_adjusting_again_changes_nothing(
    judged: Result,
    entries: list[Override],
    extra: list[Override],
    policy: LatePolicy | None,
    submitted: datetime | None,
) -> None:
    """However often a result is adjusted by the same decisions, it is the same; without them it is as judged."""
    once = adjust(judged, [*entries, *extra], policy, SubmissionTime(submitted))
    assert adjust(once, [*entries, *extra], policy, SubmissionTime(submitted)) == once
    assert adjust(once, []) == judged


@given(results, decisions)
def test_adjustments_add_up(judged: Result, entries: list[Override]) -> None:
    """The final points are the earned points plus the points of all adjustments."""
    adjusted = adjust(judged, entries)
    assert adjusted.final == judged.score.earned + sum(
        (a.points for a in adjusted.adjustments), Decimal(0)
    )


@given(results, st.lists(of_parts, max_size=4))
def test_who_is_excused_of_all_loses_nothing(judged: Result, entries: list[Override]) -> None:
    """With every criterion excused at last, the final points are all that are possible."""
    excuses = [entry(criterion=criterion.id, excused=True) for criterion in judged.criteria]
    assert adjust(judged, [*entries, *excuses]).final == judged.score.possible
