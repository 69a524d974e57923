"""Why a process died or went wrong, told from what it wrote, with the student's own line and a remedy.

What only happens because a node was stopped is no mistake: it yields no diagnosis, at most an advisory.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

from grader.evidence.crash.causes import Diagnosis, cause_of, cause_of_line, table
from grader.evidence.crash.tracebacks import (
    Raised,
    chains,
    plain_lines,
    student_file,
    student_frame,
    tracebacks,
)
from grader.recording.session import OutputLine, ProcessRun

_KILLED = (-9, 137)


def explain(
    output: Sequence[OutputLine], root_files: Collection[str], interrupted_ns: int | None = None
) -> Diagnosis | None:
    """What went wrong in a process that wrote `output`, None if nothing can be seen to have.

    The last exception is told, by its first cause; without one, other signs of trouble. Once the process has been
    interrupted, using a context that is already shut down is no mistake. `root_files` are as in `cause_of`.
    """
    for chain in reversed(chains(tracebacks(output))):
        if (raised := _mistake_in(chain, interrupted_ns)) is not None:
            frames = (student_frame(each.frames, root_files) for each in (raised, *chain))
            file, line = next(filter(None, frames), (None, None))
            return replace(
                cause_of(raised, root_files), file=file, line=line, exception_type=raised.type
            )
    found = next(filter(None, (cause_of_line(line.text) for line in plain_lines(output))), None)
    return (
        replace(found, file=student_file(found.subject, root_files)) if found is not None else None
    )


def advisories(output: Sequence[OutputLine]) -> tuple[str, ...]:
    """What the process wrote that costs nothing, but can be done better."""
    raised = tracebacks(output)
    last = raised[-1].name if raised else ""
    text = "\n".join(line.text for line in plain_lines(output))
    return tuple(
        row["problem"].format(last=last)
        for row in table()["advisories"]
        if re.fullmatch(row.get("last", ".*"), last)
        and re.search(row.get("text", ""), text)
        and not ("unless" in row and re.search(row["unless"], text))
    )


def _mistake_in(chain: Sequence[Raised], interrupted_ns: int | None) -> Raised | None:
    """The first exception of a chain that is a mistake."""
    stopped = any(
        exception.name in ("KeyboardInterrupt", "ExternalShutdownException") for exception in chain
    )
    for exception in chain:
        after = stopped or (interrupted_ns is not None and exception.t_ns >= interrupted_ns)
        # A program that is stopped ends with these; so it does where it shuts down what is shut down already.
        is_stop = exception.name in _STOPS or any(
            words in exception.message for words in _SECOND_SHUTDOWN
        )
        by_stop = (
            HIT_IN_A_CALL in exception.message or cause_of(exception, ()).kind in _AFTER_SHUTDOWN
        )
        if not (exception.ignored or is_stop or (after and by_stop)):
            return exception
    return None


#: What pybind11 says when a signal's exception strikes while it converts an argument.
HIT_IN_A_CALL = "Unable to convert call argument"
#: What comes of using rclpy or a node after it has been shut down.
_AFTER_SHUTDOWN = ("context-shut-down", "not-initialised")
_STOPS = ("KeyboardInterrupt", "ExternalShutdownException", "SystemExit")
_SECOND_SHUTDOWN = (
    "rcl_shutdown already called",
    "Context must be initialized before it can be shutdown",
)


def ended_by_limit(run: ProcessRun) -> bool:
    """Whether a process was ended because of a limit."""
    return run.limit is not None and (run.ended_by == "limit" or run.exit_status in _KILLED)


def hit_limit(run: ProcessRun) -> tuple[str, str] | None:
    """Return (what happened, how to fix it) of a process that hit a limit; None of one that did not."""
    if run.limit is None:
        return None
    what, remedy = table()["limits"].get(
        run.limit, (f"exceeded the limit '{run.limit}'", "Use less of it.")
    )
    how = "was ended" if ended_by_limit(run) else "went on"
    return f"The program {what} (limit: {run.limit}), and {how}.", remedy
