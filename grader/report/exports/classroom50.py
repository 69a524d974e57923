"""Classroom 50's `result.json` (schema `classroom50/result/v1`).

Scores there are whole numbers that add up to the total. The total is rounded, half a point up, and the tests' scores
such that they add up to it. An undecided check has the score 0, and its name says that it is undecided; adjustments
are spread over the other tests. Keys that the system's runner writes are left out. It prints a test's name as Markdown.

References
----------
Classroom 50 wiki, Advanced Autograding: "The result.json contract".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from decimal import ROUND_HALF_UP, Decimal
from itertools import accumulate, pairwise
from typing import Any

from grader.json_text import json_text
from grader.report.escape import line, markdown_text
from grader.report.exports.graded import Graded, GradedCheck, full_text
from grader.report.exports.variables import CLASSROOM50
from grader.report.views import badge_of

SCHEMA = "classroom50/result/v1"
_ZERO = Decimal(0)
#: Finest share of points; a rounding error of a division must not make a score exceed its maximum.
_FINE = Decimal("1e-9")


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the file's text."""
    given = {key: line(environment[variable], 1000) for key, variable in CLASSROOM50.items()}
    review = environment.get("REVIEW_URL") or environment["COMMIT_URL"]
    tests = []
    for check, (score, most) in zip(graded.checks, _scores(graded), strict=True):
        tests.append(_test(check, score, most))
    plain = {
        "schema": SCHEMA,
        **given,
        "review": line(review, 1000),
        "datetime": _ended(graded).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "score": sum(test["score"] for test in tests),
        "max-score": sum(test["max-score"] for test in tests),
        "tests": tests,
    }
    return json_text(plain)


def _ended(graded: Graded) -> datetime:
    """Return the end of the last session; the runner replaces it by the time of submission."""
    ended_s = 0.0
    for session in graded.sessions.values():
        ended_s = max(ended_s, session["started_ns"] / 1e9 + session["duration_s"])
    return datetime.fromtimestamp(ended_s, tz=UTC)


def _scores(graded: Graded) -> list[tuple[int, int]]:
    """Return the score and the maximum of each check; an undecided check has the points that are certain."""
    most = whole_scores([check.possible for check in graded.checks])
    limits = []
    exact = []
    for check, maximum in zip(graded.checks, most, strict=True):
        limit = int(check.earned) if check.open else maximum
        score = min(Decimal(limit), check.possible, check.earned + check.given)
        limits.append(limit)
        exact.append(max(_ZERO, score))
    wanted = max(0, min(_rounded(graded.final), sum(limits)))
    scores = whole_scores(_adding_up_to(wanted, exact, limits))
    return list(zip(scores, most, strict=True))


def _adding_up_to(wanted: int, exact: Sequence[Decimal], limits: Sequence[int]) -> list[Decimal]:
    """Return scores that add up to the wanted total; the difference is spread in proportion, within the limits."""
    earned = sum(exact, _ZERO)
    room = sum(limits) - earned
    spread = list(exact)
    if wanted < earned:
        spread = [score * wanted / earned for score in exact]
    elif room > 0:
        spread = []
        for score, limit in zip(exact, limits, strict=True):
            more = (limit - score) * (wanted - earned) / room
            spread.append(score + more)
    return [score.quantize(_FINE) for score in spread]


def whole_scores(exact: Sequence[Decimal]) -> list[int]:
    """Round points, none of them negative, to whole numbers that add up to the rounded total.

    Each number is the growth of the rounded sum, and therefore differs from the exact points by less than 1.
    """
    sums = [_rounded(total) for total in accumulate(exact, initial=_ZERO)]
    return [after - before for before, after in pairwise(sums)]


def _rounded(value: Decimal) -> int:
    return int(value.quantize(Decimal(1), ROUND_HALF_UP))


def _test(check: GradedCheck, score: int, most: int) -> dict[str, Any]:
    name = markdown_text(check.title, 200) or markdown_text(check.id)
    if check.open:
        name += " (undecided, not earned)"
    passed = not check.open and not check.lost
    outcome = badge_of(check.outcome).word
    return {
        "test-name": name,
        "passed": passed,
        "score": score,
        "max-score": most,
        "outcome": outcome,
        "output": full_text(check),
    }
