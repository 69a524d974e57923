"""`grade checks`: list the checks that a rubric can use."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from grader.commands.listing import Entry, entries_of, run_listing


def entries() -> list[Entry]:
    """Describe the checks."""
    from grader.checks.registry import REGISTRY

    models = {name: check.parameters for name, check in REGISTRY.items()}
    return entries_of(
        models, {"id": "talker.right", "title": "It is right", "points": 5, "session": "talking"}, "check"
    )


def run(arguments: Sequence[str], console: Console) -> int:
    """List the checks; returns the exit status."""
    return run_listing("grade checks", "List the checks that a rubric can use.", entries(), arguments, console)
