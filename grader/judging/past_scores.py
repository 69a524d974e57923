"""Points of a student's previous submissions."""

from __future__ import annotations

from dataclasses import replace

from grader.result import PastScore, Result, number

#: Most previous submissions that a result names.
MOST = 30


def with_past(result: Result, before: Result | None) -> Result:
    """Return a result that names the points of the previous submissions, oldest first.

    Parameters
    ----------
    before
        Result of the previous submission, which names those before it; None if there is none.
    """
    if before is None:
        return result
    provenance = result.provenance.copy()
    provenance["previous"] = [*before.provenance.get("previous", ()), _score_of(before)][-MOST:]
    return replace(result, provenance=provenance)


def _score_of(result: Result) -> PastScore:
    """Summarise a result; the time is the start of its first session, 0 without a session."""
    started_ns = []
    for session in result.provenance.get("sessions", {}).values():
        started_ns.append(session["started_ns"])
    return PastScore(
        recorded_ns=min(started_ns, default=0),
        earned=number(result.final),
        undecided=number(result.still_undecided),
        possible=number(result.score.possible),
        rubric_sha256=result.rubric_sha256,
    )
