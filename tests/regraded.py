"""Recordings judged again as the command does it, for tests of what comes of it."""

from __future__ import annotations

from pathlib import Path

from grader.classroom.regrade import regrade
from grader.result import Result


def regraded(results: Path, rubric: Path | None = None) -> Result:
    """Judge one submission again, and write its result."""
    found = regrade([results], rubric, pages=True)
    for error in found.failed.values():
        raise error
    found.apply()
    (judged,) = found.judged.values()
    return judged.result
