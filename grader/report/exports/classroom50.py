"""Classroom 50's `result.json` (schema `classroom50/result/v1`).

Scores there are whole numbers that add up to the total. So the total is rounded, half a point up, and the tests'
scores such that they add up to it. An undecided check has the score 0, and its name says so; adjustments are spread
over the other tests. What the system's runner writes itself is left out. It prints a test's name as Markdown.

References
----------
Classroom 50 wiki, Advanced Autograding: "The result.json contract".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from decimal import ROUND_HALF_UP, Decimal
from itertools import accumulate, pairwise
from typing import Any

from grader.json_text import json_text
from grader.report.escape import line, markdown_text
from grader.report.exports.graded import Graded, GradedCheck, full_text
from grader.report.views import badge_of

SCHEMA = "classroom50/result/v1"
#: What the runner tells the autograder of the submission: keys of the result, and the variables that hold them.
_GIVEN = {
    "classroom": "CLASSROOM",
    "assignment": "ASSIGNMENT",
    "submission": "SUBMISSION_TAG",
    "commit": "COMMIT_URL",
    "release": "RELEASE_URL",
}
VARIABLES = tuple(_GIVEN.values())
_ZERO = Decimal(0)
#: No share of points is finer; what a division leaves beyond it must not make a score exceed its maximum.
_FINE = Decimal("1e-9")


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the file's text."""
    given = {key: line(environment[variable], 1000) for key, variable in _GIVEN.items()}
    tests = [
        _test(check, *scores) for check, scores in zip(graded.checks, _scores(graded), strict=True)
    ]
    # When the last session ended; the runner puts the time of submission in its place.
    ended_s = max(
        (s["started_ns"] / 1e9 + s["duration_s"] for s in graded.sessions.values()), default=0.0
    )
    plain = {
        "schema": SCHEMA,
        **given,
        "review": line(environment.get("REVIEW_URL") or environment["COMMIT_URL"], 1000),
        "datetime": datetime.fromtimestamp(ended_s, tz=timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "score": sum(test["score"] for test in tests),
        "max-score": sum(test["max-score"] for test in tests),
        "tests": tests,
    }
    return json_text(plain)


def _scores(graded: Graded) -> list[tuple[int, int]]:
    """Return each check's score and maximum; what is open has earned no more than is known."""
    most = whole_scores([check.possible for check in graded.checks])
    within = [
        int(check.earned) if check.open else limit
        for check, limit in zip(graded.checks, most, strict=True)
    ]
    exact = [
        max(_ZERO, min(Decimal(limit), check.possible, check.earned + check.given))
        for check, limit in zip(graded.checks, within, strict=True)
    ]
    earned, room = sum(exact, _ZERO), sum(within) - sum(exact, _ZERO)
    wanted = max(0, min(_rounded(graded.final), sum(within)))
    # What the tests do not add up to is spread over them in proportion.
    if wanted < earned:
        exact = [value * wanted / earned for value in exact]
    elif room > 0:
        exact = [
            value + (m - value) * (wanted - earned) / room
            for value, m in zip(exact, within, strict=True)
        ]
    return list(zip(whole_scores([value.quantize(_FINE) for value in exact]), most, strict=True))


def whole_scores(exact: Sequence[Decimal]) -> list[int]:
    """Round points, which are not negative, to whole numbers that add up to the rounded total.

    Each is what the rounded sum grows by, and so differs from its exact value by less than 1.
    """
    sums = [_rounded(total) for total in accumulate(exact, initial=_ZERO)]
    return [after - before for before, after in pairwise(sums)]


def _rounded(value: Decimal) -> int:
    return int(value.quantize(Decimal(1), ROUND_HALF_UP))


def _test(check: GradedCheck, score: int, most: int) -> dict[str, Any]:
    name = markdown_text(check.title, 200) or markdown_text(check.id)
    if check.open:
        name += " (undecided, not earned)"
    return {
        "test-name": name,
        "passed": not check.open and not check.lost,
        "score": score,
        "max-score": most,
        "outcome": badge_of(check.outcome).word,
        "output": full_text(check),
    }
