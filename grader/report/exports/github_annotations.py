"""Workflow commands that mark lines of the student's files on GitHub.

GitHub shows the first ten of a kind for each step; the costliest checks therefore come first. A title has at most
255 characters, a message 64 KB.
"""

from __future__ import annotations

from collections.abc import Mapping

from grader.report.escape import command_data, command_property, line
from grader.report.exports.graded import Graded, GradedCheck, full_text
from grader.report.views import badge_of, points
from grader.result import Outcome

MOST_OF_A_KIND = 10
_LONGEST_TITLE = 200
_KINDS = {Outcome.FAILED: "error", Outcome.PARTIAL: "warning"}


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the workflow commands, a line each, and a line for each kind with further checks."""
    by_kind: dict[str, list[GradedCheck]] = {"error": [], "warning": [], "notice": []}
    for check in (*graded.lossy, *graded.open_without_loss):
        by_kind[_KINDS.get(check.outcome, "notice")].append(check)
    lines = []
    for kind, checks in by_kind.items():
        lines += [_command(kind, check) for check in checks[:MOST_OF_A_KIND]]
        further = len(checks) - MOST_OF_A_KIND
        if further > 0:
            lines.append(f"({further} more of the kind {kind} are in the report.)")
    return "".join(f"{text}\n" for text in lines)


def _command(kind: str, check: GradedCheck) -> str:
    """Write a workflow command: `::error file=a.py,line=3,title=…::…`."""
    word = badge_of(check.outcome).word
    cost = "costs nothing"
    if check.lost:
        cost = f"−{points(check.lost)} points"
    properties = {}
    if check.location is not None:
        properties["file"] = str(check.location.file)
        properties["line"] = str(check.location.line)
    properties["title"] = f"{line(check.title, _LONGEST_TITLE)} ({word}, {cost})"
    written = [f"{key}={command_property(value, 1000)}" for key, value in properties.items()]
    message = command_data(full_text(check) or word)
    return f"::{kind} {','.join(written)}::{message}"
