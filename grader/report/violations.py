"""What the report and the terminal say of what interfered with the grader's own nodes and topics."""

from __future__ import annotations

from grader.result import Result, Violation

HEADING = "For the instructor: something interfered with the grader's nodes or topics"
EXPLANATION = (
    "Seen in the recordings. Each can have an honest cause, such as a wrong topic name or a simulator of one's own. "
    "It costs no points by itself: only checks that could not be measured because of it fail, and these are named here."
)


def titles_of(violation: Violation, result: Result) -> list[tuple[str, str]]:
    """Return ids and titles of the checks that fail because of a violation."""
    checks = (check for criterion in result.criteria for check in criterion.checks)
    return [(check.id, check.title) for check in checks if check.id in violation.checks]


def note_of(violation: Violation) -> str:
    """Say how sure it is, where it is not."""
    return "" if violation.certain else "What caused it is not certain."
