"""Untrusted text made fit for a terminal and for the log of a CI job."""

from __future__ import annotations

from grader.report.untrusted import line
from grader.report.workflow_commands import uncommanded


def terminal_text(text: str, limit: int = 400) -> str:
    """Return a text as one line that neither a terminal nor a CI job's log obeys, cut to a length.

    Notes
    -----
    The same command prints to both, and a table breaks lines where it must; so nothing in the text may look
    like a workflow command, even if a line began there.
    """
    whole = uncommanded(line(text, limit))
    return whole if len(whole) <= limit else whole[: limit - 1] + "…"
