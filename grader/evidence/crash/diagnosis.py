"""Why a process died or went wrong, told from what it wrote, with the student's own line and a remedy.

What only happens because a node was stopped is no mistake: it yields no diagnosis, at most an advisory.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from grader.evidence.crash.causes import cause_of, cause_of_line, table, uses_dead_context
from grader.evidence.crash.tracebacks import Raised, chains, plain_lines, student_file, student_frame, tracebacks
from grader.recording.session import OutputLine, ProcessRun

#: Characters of an exception's message that are kept.
_MESSAGE_LENGTH = 300
_KILLED = (-9, 137)


@dataclass(frozen=True)
class Diagnosis:
    """What went wrong in a process."""

    #: A slug, e.g. "read-only-property", stable for fixtures and statistics.
    kind: str
    #: What happened, for a student.
    problem: str
    #: How to fix it.
    remedy: str
    #: The deepest line of the submission on the way to the exception.
    file: str | None = None
    line: int | None = None
    #: As Python printed them; empty where no exception did it.
    exception_type: str = ""
    message: str = ""
    #: The name that it is about: a module, a topic, a parameter, an attribute.
    subject: str = ""
    #: When it was read from the process.
    t_ns: int | None = None


def explain(
    output: Sequence[OutputLine], root_files: Collection[str], interrupted_ns: int | None = None
) -> Diagnosis | None:
    """What went wrong in a process that wrote `output`, None if nothing can be seen to have.

    The last exception is told, by its first cause; without one, other signs of trouble.

    Parameters
    ----------
    output : sequence of OutputLine
        All that the process wrote.
    root_files : collection of str
        The submission's files, relative to its root.
    interrupted_ns : int, optional
        When the process was interrupted: using a context that is already shut down is no mistake after that.
    """
    for chain in reversed(chains(tracebacks(output))):
        if (raised := _mistake_in(chain, interrupted_ns)) is not None:
            frames = (student_frame(each.frames, root_files) for each in (raised, *chain))
            file, line = next(filter(None, frames), (None, None))
            kind, problem, remedy, subject = cause_of(raised, root_files)
            message = raised.message[:_MESSAGE_LENGTH]
            return Diagnosis(kind, problem, remedy, file, line, raised.type, message, subject[:200], raised.t_ns)
    for t_ns, text in plain_lines(output):
        if (cause := cause_of_line(text)) is not None:
            file = student_file(cause.subject, root_files)
            return Diagnosis(*cause[:3], file, message=text[:_MESSAGE_LENGTH], subject=cause.subject, t_ns=t_ns)
    return None


def advisories(output: Sequence[OutputLine]) -> tuple[str, ...]:
    """What the process wrote that costs nothing, but can be done better."""
    raised = tracebacks(output)
    last = raised[-1].name if raised else ""
    text = "\n".join(line for _, line in plain_lines(output))
    return tuple(
        row["problem"].format(last=last)
        for row in table()["advisories"]
        if re.fullmatch(row.get("last", ".*"), last) and re.search(row.get("text", ""), text)
    )


def _mistake_in(chain: Sequence[Raised], interrupted_ns: int | None) -> Raised | None:
    """The first exception of a chain that is a mistake."""
    stopped = any(exception.name in ("KeyboardInterrupt", "ExternalShutdownException") for exception in chain)
    for exception in chain:
        after = stopped or (interrupted_ns is not None and exception.t_ns >= interrupted_ns)
        if exception.ignored or _is_stop(exception) or (after and uses_dead_context(exception)):
            continue
        return exception
    return None


def _is_stop(exception: Raised) -> bool:
    """Whether a program that is stopped ends with it; so it does where it shuts down what is shut down already."""
    return exception.name in _STOPS or any(words in exception.message for words in _SECOND_SHUTDOWN)


_STOPS = ("KeyboardInterrupt", "ExternalShutdownException", "SystemExit")
_SECOND_SHUTDOWN = ("rcl_shutdown already called", "Context must be initialized before it can be shutdown")


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
