"""The few words and numbers that all exports write alike."""

from __future__ import annotations

from grader.report.escape import line
from grader.report.exports.graded import Graded, GradedCheck
from grader.report.views import adjustment_text, note_of, points

#: Most places that an export names for a check.
MOST_LOCATIONS = 4
#: Most remarks of a kind on the submission as a whole, since a student can cause any number.
MOST_REMARKS = 50


def points_of(check: GradedCheck) -> str:
    """Return what a check earned of its points; a question mark where that is open."""
    if check.open:
        return f"? / {points(check.possible)}"
    return f"{points(check.earned + check.given)} / {points(check.possible)}"


def adjustment_texts(graded: Graded) -> list[str]:
    """Return the adjustments, each as a line of text that is still untrusted."""
    titles = {check.id: check.title for check in graded.checks} | {part.id: part.title for part in graded.criteria}
    return [adjustment_text(each, titles) for each in graded.adjustments]


def violation_texts(graded: Graded) -> list[str]:
    """Return what of the grader's own was tampered with, each as a line of text that is still untrusted."""
    return [
        " ".join([violation.text, note_of(violation), *violation.evidence[:MOST_LOCATIONS]])
        for violation in graded.violations[:MOST_REMARKS]
    ]


def undecided_text(check: GradedCheck) -> str:
    """Say that a check is open, and what that means for its points."""
    open_points = f"{points(check.undecided)} points are not earned before somebody has decided"
    return f"Undecided, {open_points}. {line(check.reason, 600)}".strip()


def proof_lines(check: GradedCheck) -> list[tuple[str, str]]:
    """Return what was expected, what was measured, where, and what to do; names with texts of a line each."""
    named = [
        ("Expected", check.expected),
        ("Measured", check.measured),
        ("Where", "; ".join(check.locations[:MOST_LOCATIONS])),
        ("Hint", check.hint),
    ]
    return [(name, line(text, 600)) for name, text in named if text]


def full_text(check: GradedCheck) -> str:
    """Return all that is to be said of a check that did not pass, as plain lines that can be shown."""
    why = undecided_text(check) if check.open else line(check.reason, 600)
    return "\n".join([*([why] if why else []), *(f"{name}: {text}" for name, text in proof_lines(check))])
