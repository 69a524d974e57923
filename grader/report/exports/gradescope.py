"""Gradescope's `results.json`.

Every test is visible, because Gradescope hides the total if one test is hidden. An undecided check has neither score
nor status, and is shown neither as passed nor as failed. The total is the score with all adjustments.

References
----------
Gradescope autograder documentation: autograder specifications, output format.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

from grader.json_text import json_text
from grader.report.escape import line
from grader.report.exports.graded import (
    MOST_REMARKS,
    Graded,
    GradedCheck,
    GradedCriterion,
    full_text,
    violation_texts,
)
from grader.report.views import BONUS, HEADING, adjustments_of, bonus_lines, points
from grader.result import number


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the file's text."""
    tests = []
    for n, criterion in enumerate(graded.criteria, 1):
        for m, check in enumerate(criterion.checks, 1):
            tests.append(_test(check, criterion, f"{n}.{m}"))
    plain: dict[str, Any] = {
        "score": number(max(Decimal(0), graded.final)),
        "output": "\n".join(_overall(graded)),
        "output_format": "text",
        "test_output_format": "text",
        "test_name_format": "text",
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "tests": tests,
        "extra_data": {
            "earned": number(graded.score.earned),
            "possible": number(graded.score.possible),
            "undecided": number(graded.still_undecided),
        },
    }
    if graded.sessions:
        plain["execution_time"] = _duration_s(graded)
    return json_text(plain)


def _overall(graded: Graded) -> list[str]:
    total = f"{points(graded.final)} of {points(graded.score.possible)} points"
    lines = [f"{line(graded.lab)}: {total}"]
    if graded.still_undecided:
        lines.append(
            f"{points(graded.still_undecided)} points are undecided, and not earned before they are: "
            "the instructor can run the autograder again, or decide."
        )
    remarks: dict[str, Sequence[str]] = {
        BONUS: bonus_lines(graded),
        "Adjustments": [view.text for view in adjustments_of(graded)],
        HEADING: violation_texts(graded),
        "On the grader's side": graded.problems[:MOST_REMARKS],
        "Costs nothing, but worth knowing": graded.advisories[:MOST_REMARKS],
    }
    for title, texts in remarks.items():
        if texts:
            lines += ["", f"{title}:"]
            lines += [f"- {line(text, 600)}" for text in texts]
    return lines


def _test(check: GradedCheck, criterion: GradedCriterion, place: str) -> dict[str, Any]:
    name = line(f"{criterion.title}: {check.title}")
    plain: dict[str, Any] = {
        "name": name,
        "number": place,
        "output": full_text(check) or "Passed.",
        "output_format": "text",
        "visibility": "visible",
        "tags": [line(criterion.id)],
    }
    if check.open:
        plain["name"] = f"{name} (undecided)"
    else:
        plain["score"] = number(max(Decimal(0), check.earned + check.given))
        plain["max_score"] = number(check.possible)
        plain["status"] = "failed" if check.lost else "passed"
    return plain


def _duration_s(graded: Graded) -> float:
    """Return the time from the first session's start to the last one's end, of at least one session."""
    sessions = graded.sessions.values()
    first_ns = min(session["started_ns"] for session in sessions)
    ended_s = []
    for session in sessions:
        ended_s.append((session["started_ns"] - first_ns) / 1e9 + session["duration_s"])
    return round(max(ended_s), 1)
