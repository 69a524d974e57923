"""A line of the examination, and the first lines: the limits, without which nothing else can be examined."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from grader.live.sandbox.enough import present_shortages


class Verdict(str, Enum):
    """What an examination says of one thing."""

    PASS = "PASS"
    WARNING = "WARNING"
    FAIL = "FAIL"


@dataclass(frozen=True)
class Status:
    """One line of the examination: what was seen, with its figures, and the one thing that would fix it."""

    verdict: Verdict
    subject: str
    found: str
    remedy: str = ""


def status_of_limits() -> Status:
    """Return whether the hard limits of this process suffice, and if not, the lowest of them."""
    found = present_shortages()
    if not found:
        return Status(Verdict.PASS, "limits", "as high as grading makes use of")
    words = "; ".join(map(str, found))
    verdict = Verdict.WARNING
    if found[0].is_fatal:
        verdict = Verdict.FAIL
    return Status(verdict, "limits", words, found[0].remedy)
