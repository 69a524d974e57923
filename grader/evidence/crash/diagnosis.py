"""Why a process died or went wrong, told from what it wrote, with the student's own line and a remedy.

What only happens because a node was stopped is no mistake: it yields no diagnosis, at most an advisory.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from grader.evidence.crash.causes import cause_of, cause_of_line, table, uses_dead_context
from grader.evidence.crash.tracebacks import Raised, chains, plain_lines, student_file, student_frame, tracebacks
from grader.recording.session import OutputLine

#: Characters of an exception's message that are kept.
_MESSAGE_LENGTH = 300


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
        cause = _cause(chain, interrupted_ns)
        if cause is not None:
            return _diagnosis(cause, chain, root_files)
    return _without_exception(output, root_files)


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


def _cause(chain: Sequence[Raised], interrupted_ns: int | None) -> Raised | None:
    """The first exception of a chain that is a mistake."""
    stopped = any(exception.name in ("KeyboardInterrupt", "ExternalShutdownException") for exception in chain)
    for exception in chain:
        after = stopped or (interrupted_ns is not None and exception.t_ns >= interrupted_ns)
        if exception.ignored or _is_stop(exception) or (after and uses_dead_context(exception)):
            continue
        return exception
    return None


def _is_stop(exception: Raised) -> bool:
    return exception.name in (
        "KeyboardInterrupt",
        "ExternalShutdownException",
        "SystemExit",
    ) or _is_second_shutdown(exception)


def _is_second_shutdown(exception: Raised) -> bool:
    return (
        "rcl_shutdown already called" in exception.message
        or "Context must be initialized before it can be shutdown" in exception.message
    )


def _diagnosis(cause: Raised, chain: Sequence[Raised], root_files: Collection[str]) -> Diagnosis:
    location = student_frame(cause.frames, root_files)
    for other in chain:
        location = location or student_frame(other.frames, root_files)
    kind, problem, remedy, subject = cause_of(cause, root_files)
    file, line = location or (None, None)
    message = cause.message[:_MESSAGE_LENGTH]
    return Diagnosis(kind, problem, remedy, file, line, cause.type, message, subject[:200], cause.t_ns)


def _without_exception(output: Sequence[OutputLine], root_files: Collection[str]) -> Diagnosis | None:
    for t_ns, line in plain_lines(output):
        if (cause := cause_of_line(line)) is not None:
            file = student_file(cause.subject, root_files)
            return Diagnosis(*cause[:3], file, message=line[:_MESSAGE_LENGTH], subject=cause.subject, t_ns=t_ns)
    return None
