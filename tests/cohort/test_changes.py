"""Differences between two judgements: totals, criteria, checks, outcomes, adjustments, words."""

from __future__ import annotations

import copy
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.cohort.changes import Changes, changes_between, plain_changes
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.result import Outcome, read_result, to_plain

SOLUTION = Path(__file__).resolve().parents[1] / "recordings/solution"


@pytest.fixture(scope="module")
def judged() -> dict[str, Any]:
    """Give the solution's result as plain data."""
    rubric = read_rubric(None)
    return to_plain(judge(open_recordings(SOLUTION, rubric), rubric))


def compared(before: dict[str, Any] | None, after: dict[str, Any]) -> Changes:
    """Compare two results, each as plain data."""
    return changes_between(read_result(before) if before is not None else None, read_result(after))


def with_check(
    result: dict[str, Any], identity: str, earned: float, outcome: str, **more: Any
) -> dict[str, Any]:
    """Return a result with other points of a check, its criterion and the score."""
    changed = copy.deepcopy(result)
    for criterion in changed["criteria"]:
        for check in criterion["checks"]:
            if check["id"] == identity:
                difference = earned - check["earned"]
                check |= {"earned": earned, "outcome": outcome, **more}
                criterion["earned"] += difference
                changed["score"]["earned"] += difference
                changed["score"]["final"] += difference
    return changed


def test_equal_results_change_nothing(judged: dict[str, Any]) -> None:
    """A result against itself has no changes, in points or in words."""
    changes = compared(judged, copy.deepcopy(judged))
    assert not changes.matters
    assert not changes.words
    assert changes.difference == 0


def test_a_check_with_other_points(judged: dict[str, Any]) -> None:
    """The check, its criterion and the total change by as much."""
    after = with_check(judged, "publisher.rate", 4.5, "partial")
    changes = compared(judged, after)
    assert (changes.submission, changes.before, changes.after) == (
        judged["submission"],
        Decimal(100),
        Decimal("98.0"),
    )
    criterion, check = changes.parts
    assert (criterion.id, criterion.before, criterion.after) == (
        "publisher",
        Decimal(20),
        Decimal("18.0"),
    )
    assert (check.id, check.before, check.after) == (
        "publisher.rate",
        Decimal("6.5"),
        Decimal("4.5"),
    )
    assert check.outcomes == (Outcome.PASSED, Outcome.PARTIAL)
    assert changes.difference == criterion.difference == check.difference == Decimal("-2.0")
    assert changes.words


def test_another_outcome_matters_even_without_points(judged: dict[str, Any]) -> None:
    """A check that fails and one that is not reached cost the same, and are not the same."""
    before = with_check(judged, "publisher.rate", 0, "failed")
    changes = compared(before, with_check(judged, "publisher.rate", 0, "not_reached"))
    assert changes.matters
    assert changes.difference == 0
    assert changes.parts[0].difference == 0


def test_undecided_points_matter(judged: dict[str, Any]) -> None:
    """Points that are no longer undecided are a change."""
    before = copy.deepcopy(judged)
    before["score"]["undecided"] = 6
    changes = compared(before, judged)
    assert changes.matters
    assert changes.undecided == (Decimal(6), Decimal(0))


def test_words_alone_do_not_matter(judged: dict[str, Any]) -> None:
    """Another reason is told apart from other points, and another rubric's hash is no difference at all."""
    reworded = with_check(judged, "publisher.rate", 6.5, "passed", reason="other words")
    changes = compared(judged, reworded)
    assert (changes.matters, changes.words) == (False, True)
    elsewhere = copy.deepcopy(judged) | {
        "provenance": {**judged["provenance"], "rubric_sha256": "other"}
    }
    assert not compared(judged, elsewhere).words


def test_without_an_old_result_all_is_new(judged: dict[str, Any]) -> None:
    """Where there was no result, there is nothing to compare with."""
    changes = compared(None, judged)
    assert changes.matters
    assert changes.before is None
    assert changes.after == 100
    assert changes.parts == ()


def test_an_old_result_without_final_points(judged: dict[str, Any]) -> None:
    """A result of an earlier version, without adjustments, is compared by the points earned."""
    before = {key: value for key, value in copy.deepcopy(judged).items() if key != "adjustments"}
    del before["score"]["final"]
    assert not compared(before, judged).matters


def test_checks_that_came_and_went(judged: dict[str, Any]) -> None:
    """A check that another rubric has not, or has anew, stands on one side alone."""
    before = copy.deepcopy(judged)
    del before["criteria"][0]["checks"][1]
    before["criteria"][0]["earned"] -= 6
    before["criteria"][1]["id"] = "gone"
    changes = compared(before, judged)
    assert [(c.id, c.before is None, c.after is None) for c in changes.at("criterion")] == [
        ("publisher", False, False),
        ("subscriber", True, False),
        ("gone", False, True),
    ]
    check, *others = changes.at("check")
    assert (check.id, check.before, check.after, check.outcomes[0]) == (
        "publisher.rate",
        None,
        Decimal("6.5"),
        None,
    )
    assert {(c.before is None, c.after is None) for c in others} == {(True, False), (False, True)}


def adjustment(points: float, kind: str = "points", what: str = "publisher.rate") -> dict[str, Any]:
    """Give an adjustment as plain data."""
    return {
        "kind": kind,
        "what": what,
        "points": points,
        "reason": "so",
        "who": "J. Smith",
        "when": "2026-11-21",
    }


def test_adjustments_are_compared_by_what_they_concern(judged: dict[str, Any]) -> None:
    """Adjustments of one kind to one check count together; others are told apart."""
    before = copy.deepcopy(judged) | {
        "adjustments": [adjustment(-2), adjustment(3, "bonus", "score")]
    }
    after = copy.deepcopy(judged) | {
        "adjustments": [adjustment(-2), adjustment(-1), adjustment(3, "bonus", "score")]
    }
    changes = compared(before, after)
    assert [(a.title, a.id, a.difference) for a in changes.parts] == [
        ("points", "publisher.rate", Decimal(-1))
    ]
    assert changes.difference == -1


def test_points_that_can_be_had_are_compared(judged: dict[str, Any]) -> None:
    """A rubric with another total matters, even for submissions with the same points; the trail has both totals."""
    after = copy.deepcopy(judged)
    after["score"]["possible"] = 90
    changes = compared(judged, after)
    assert changes.matters
    assert plain_changes(changes)["possible"] == [100, 90]


def test_the_trail_says_what_was_and_is(judged: dict[str, Any]) -> None:
    """Each change is a pair of old and new, in plain numbers."""
    plain = plain_changes(compared(judged, with_check(judged, "publisher.rate", 4.5, "partial")))
    assert plain == {
        "final": [100, 98],
        "undecided": [0, 0],
        "criteria": {"publisher": [20, 18]},
        "checks": {"publisher.rate": {"outcome": ["passed", "partial"], "points": [6.5, 4.5]}},
        "adjustments": [],
    }
