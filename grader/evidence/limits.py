"""What the limits on students' processes did to them, in words."""

from __future__ import annotations

from grader.recording.session import ProcessRun

_HIT = {
    "memory": (
        "took more memory than a session allows",
        "Keep only what you need, e.g. a deque with a maximum length.",
    ),
    "processes": ("started more processes or threads than a session allows", "Start a thread once, not in a callback."),
    "disk": ("wrote more to disk than a session allows", "Write little, and not in a callback."),
    "files": ("made more files than a session allows", "Write to one file instead of many."),
    "recording": (
        "published more than a session's recording holds",
        "Send messages no larger and no more often than is asked for.",
    ),
    "time": (
        "kept what it was asked waiting until the session's time was over",
        "Answer at once, and return from each callback quickly.",
    ),
    "output": ("printed more than a session allows", "Print less, and not in a loop that never waits."),
}
_KILLED = (-9, 137)


def ended_by_limit(run: ProcessRun) -> bool:
    """Whether a process was ended because of a limit."""
    return run.limit is not None and (run.ended_by == "limit" or run.exit_status in _KILLED)


def hit_limit(run: ProcessRun) -> tuple[str, str] | None:
    """Return (what happened, how to mend it) of a process that hit a limit; None of one that did not."""
    if run.limit is None:
        return None
    what, remedy = _HIT.get(run.limit, (f"exceeded the limit '{run.limit}'", "Take less."))
    how = "was ended" if ended_by_limit(run) else "went on"
    return f"The program {what} (limit: {run.limit}), and {how}.", remedy
