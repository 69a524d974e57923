"""What the report and the terminal say of the grader's own nodes and topics that were touched."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from grader.report import views
from grader.result import Result, Violation

HEADING = "For the instructor: the grader's own nodes or topics were touched"
EXPLANATION = (
    "Seen in the recordings. Each can have an honest cause, such as a wrong topic name or a simulator of one's own. "
    "It costs no points by itself: only checks that could not be measured because of it fail, and these are named here."
)


@dataclass(frozen=True)
class ViolationView:
    """A violation as the report shows it; `checks` are titles and links."""

    text: str
    note: str
    place: views.Place
    evidence: tuple[str, ...]
    checks: tuple[tuple[str, str], ...]


def titles_of(violation: Violation, result: Result) -> list[tuple[str, str]]:
    """Return ids and titles of the checks that fail because of a violation."""
    checks = (check for criterion in result.criteria for check in criterion.checks)
    return [(check.id, check.title) for check in checks if check.id in violation.checks]


def note_of(violation: Violation) -> str:
    """Say how sure it is, where it is not."""
    return "" if violation.certain else "What caused it is not certain."


def violation_views(result: Result, anchors: Mapping[tuple[str, str], str]) -> list[ViolationView]:
    """Describe all violations of a result."""
    return [
        ViolationView(
            violation.text,
            note_of(violation),
            views.place_of(violation.where, {}, anchors),
            violation.evidence,
            tuple((title, "#" + views.anchor("check", check)) for check, title in titles_of(violation, result)),
        )
        for violation in result.violations
    ]
