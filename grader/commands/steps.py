"""`grade steps`: list the steps that a session can have."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from grader.commands.listing import Entry, entries_of, run_listing


def entries() -> list[Entry]:
    """Describe the steps."""
    from grader.lab.steps import STEPS

    return entries_of(STEPS, {}, "")


def run(arguments: Sequence[str], console: Console) -> int:
    """List the steps; returns the exit status."""
    return run_listing("grade steps", "List the steps that a session can have.", entries(), arguments, console)
