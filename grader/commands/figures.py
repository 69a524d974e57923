"""`grade figures`: list the pictures that a report can show."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from grader.commands.listing import Entry, entries_of, run_listing


def entries() -> list[Entry]:
    """Describe the figures."""
    from grader.report.figures import FIGURES

    return entries_of(FIGURES, {"title": "What was published", "session": "talking"}, "kind")


def run(arguments: Sequence[str], console: Console) -> int:
    """List the figures; returns the exit status."""
    return run_listing("grade figures", "List the pictures that a report can show.", entries(), arguments, console)
