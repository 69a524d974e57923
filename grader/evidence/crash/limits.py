"""What the limits on students' processes did to them, in words."""

from __future__ import annotations

from grader.evidence.crash.causes import table
from grader.recording.session import ProcessRun

_KILLED = (-9, 137)


def ended_by_limit(run: ProcessRun) -> bool:
    """Whether a process was ended because of a limit."""
    return run.limit is not None and (run.ended_by == "limit" or run.exit_status in _KILLED)


def hit_limit(run: ProcessRun) -> tuple[str, str] | None:
    """Return (what happened, how to fix it) of a process that hit a limit; None of one that did not."""
    if run.limit is None:
        return None
    what, remedy = table()["limits"].get(run.limit, (f"exceeded the limit '{run.limit}'", "Use less of it."))
    how = "was ended" if ended_by_limit(run) else "went on"
    return f"The program {what} (limit: {run.limit}), and {how}.", remedy
