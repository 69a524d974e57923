"""A line of the examination, and its first lines: the limits, which everything else needs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from grader.live.sandbox.enough import present_shortages


class Verdict(StrEnum):
    """Verdicts of an examination."""

    PASS = "PASS"
    WARNING = "WARNING"
    FAIL = "FAIL"


@dataclass(frozen=True)
class Status:
    """One line of the examination: the finding with its figures, and the remedy."""

    verdict: Verdict
    subject: str
    found: str
    remedy: str = ""


def status_of_limits() -> Status:
    """Examine the hard limits of this process, and name the lowest ones that are too low."""
    found = present_shortages()
    if not found:
        return Status(Verdict.PASS, "limits", "as high as grading makes use of")
    words = "; ".join(map(str, found))
    verdict = Verdict.WARNING
    if found[0].is_fatal:
        verdict = Verdict.FAIL
    return Status(verdict, "limits", words, found[0].remedy)
