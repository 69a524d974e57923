"""Workflow commands that mark lines of the student's files on GitHub.

GitHub shows ten of a kind for each step, in the order in which they come: these are the costliest. A title has at most
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
    """Return the workflow commands, a line each, and a line for each kind of which there were more."""
    shown = [*graded.lossy, *(check for check in graded.checks if check.open and not check.lost)]
    commands = []
    for kind in ("error", "warning", "notice"):
        checks = [check for check in shown if _KINDS.get(check.outcome, "notice") == kind]
        commands += [_command(kind, check) for check in checks[:MOST_OF_A_KIND]]
        if len(checks) > MOST_OF_A_KIND:
            commands.append(
                f"({len(checks) - MOST_OF_A_KIND} more of the kind {kind} are in the report.)"
            )
    return "".join(f"{command}\n" for command in commands)


def _command(kind: str, check: GradedCheck) -> str:
    cost = f"−{points(check.lost)} points" if check.lost else "costs nothing"
    properties = {
        "title": f"{line(check.title, _LONGEST_TITLE)} ({badge_of(check.outcome).word}, {cost})"
    }
    if check.location is not None:
        properties = {
            "file": str(check.location.file),
            "line": str(check.location.line),
            **properties,
        }
    written = ",".join(
        f"{key}={command_property(value, 1000)}" for key, value in properties.items()
    )
    return f"::{kind} {written}::{command_data(full_text(check) or badge_of(check.outcome).word)}"
