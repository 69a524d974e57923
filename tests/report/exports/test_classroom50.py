"""Classroom 50's result.json: requirements of its runner, and whole scores that add up."""

from __future__ import annotations

import json
from decimal import ROUND_HALF_UP, Decimal
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.report.exports.classroom50 import whole_scores
from tests.report.exports.sample_results import (
    VARIABLES,
    adjusted_and_tampered,
    check,
    criterion,
    every_outcome,
    exported,
    hostile_results,
    of_recording,
    result,
)
from tests.report.rendered_markdown import MADE_ACTIVE, Page


def is_score(value: Any) -> bool:
    """Say if a value is a whole number from 0 on; a truth value is none."""
    if not isinstance(value, int):
        return False
    if isinstance(value, bool):
        return False
    return value >= 0


def require_origin(data: dict[str, Any]) -> None:
    """Fail unless a result names its schema, its assignment, and the submission's commit."""
    assert data["schema"] == "classroom50/result/v1"
    assert (data["classroom"], data["assignment"]) == ("robotics", "lab")
    assert data["submission"].startswith("submit/")
    for key in ("commit", "release", "review", "datetime"):
        assert isinstance(data[key], str)
        assert data[key]


def require_scores(part: dict[str, Any]) -> None:
    """Fail unless the score of a result or a test is a whole number up to its maximum."""
    assert is_score(part["score"])
    assert is_score(part["max-score"])
    assert part["score"] <= part["max-score"]


def valid(plain: dict[str, Any]) -> dict[str, Any]:
    """Export, and return the data if the runner and the collector take them; the runner adds owner and type."""
    text = exported("classroom50", plain, environment=VARIABLES)
    data: dict[str, Any] = json.loads(text)
    assert len(text) < 10 * 1024 * 1024
    require_origin(data)
    require_scores(data)
    for test in data["tests"]:
        assert isinstance(test["test-name"], str)
        assert test["test-name"]
        assert isinstance(test["passed"], bool)
        require_scores(test)
    for key in ("score", "max-score"):
        assert sum(test[key] for test in data["tests"]) == data[key]
    return data


def test_scores_are_whole_and_what_is_undecided_is_not_earned() -> None:
    """The total is rounded; undecided checks are in the maximum with all their points, so that they raise no share."""
    data = valid(every_outcome())
    assert (data["score"], data["max-score"]) == (8, 20)
    assert [(t["score"], t["max-score"], t["passed"]) for t in data["tests"]] == [
        (4, 4, True),
        (3, 5, False),
        (0, 3, False),
        (0, 2, False),
        (1, 4, False),
        (0, 2, False),
    ]
    assert data["tests"][4]["test-name"] == "Title of `b.open` (undecided, not earned)"
    assert data["tests"][1]["output"].startswith("Reason of a.partial.")
    assert data["datetime"] == "2023-11-14T22:13:30Z"


def test_the_review_is_the_commit_where_there_is_none() -> None:
    """The runner requires one."""
    data = json.loads(
        exported("classroom50", every_outcome(), environment={**VARIABLES, "REVIEW_URL": "r"})
    )
    assert (data["review"], valid(every_outcome())["review"]) == ("r", VARIABLES["COMMIT_URL"])


def test_a_full_score_is_full() -> None:
    """The solution passes all tests with all points."""
    data = valid(of_recording("solution"))
    assert data["score"] == data["max-score"] == 100
    for test in data["tests"]:
        assert test["passed"]
        assert test["score"] == test["max-score"]


@pytest.mark.parametrize(
    ("points", "score"), [(3.5, 11), (-2.0, 6), (-50.0, 0), (900.0, 15), (0.0, 8)]
)
def test_adjustments_are_spread_over_the_tests(points: float, score: int) -> None:
    """The total is the final score, from nothing to the maximum, and the tests add up to it."""
    plain = every_outcome()
    plain["adjustments"] = [{"kind": "late", "what": "score", "points": points, "reason": "late"}]
    plain["score"]["final"] = max(0.0, plain["score"]["earned"] + points)
    assert valid(plain)["score"] == score


def test_decisions_about_single_checks_count_there() -> None:
    """An excused check passes with all its points."""
    data = valid(adjusted_and_tampered())
    assert data["tests"][1]["passed"]
    assert (data["score"], data["max-score"]) == (11, 20)


_POINTS = st.integers(0, 400).map(lambda n: Decimal(n) / 20)


@given(st.lists(_POINTS, max_size=40))
def test_whole_scores_add_up(exact: list[Decimal]) -> None:
    """Whole scores add up to the rounded total, and each is less than a point off."""
    whole = whole_scores(exact)
    assert sum(whole) == int(sum(exact, Decimal(0)).quantize(Decimal(1), ROUND_HALF_UP))
    for value, each in zip(whole, exact, strict=True):
        assert abs(value - each) < 1


@given(st.lists(st.tuples(_POINTS, _POINTS, st.booleans()), min_size=1, max_size=40))
def test_any_points_make_a_valid_file(parts: list[tuple[Decimal, Decimal, bool]]) -> None:
    """Whatever the points, decided or not, fractions or not, the file is valid."""
    checks = []
    for n, (one, other, decided) in enumerate(parts):
        earned, possible = float(min(one, other)), float(max(one, other))
        if not decided:
            outcome = "inconclusive"
        elif earned == possible:
            outcome = "passed"
        else:
            outcome = "partial"
        checks.append(check(f"a.{n}", outcome, earned if decided else 0.0, possible))
    plain = result(criterion("a", *checks))
    for key in ("earned", "possible", "undecided"):
        plain["score"][key] = float(sum((Decimal(str(c[key])) for c in checks), Decimal(0)))
    plain["score"]["final"] = plain["score"]["earned"]
    valid(plain)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(hostile_results())
def test_hostile_texts_stay_in_their_cells(plain: dict[str, Any]) -> None:
    """The runner prints names into a table of Markdown; none leaves its cell or does anything."""
    data = valid(plain)
    rows = "".join(
        f"| {test['test-name'].replace('|', chr(92) + '|')} | PASS |\n" for test in data["tests"]
    )
    page = Page(f"| Test | Result |\n|---|---|\n{rows}")
    assert [tag for tag, _ in page.elements].count("td") == 2 * len(data["tests"])
    assert {tag for tag, _ in page.elements} <= {
        "table",
        "thead",
        "tbody",
        "tr",
        "th",
        "td",
        "code",
    }
    assert MADE_ACTIVE.search(page.prose) is None
