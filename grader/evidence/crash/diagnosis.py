"""Diagnosis of a process that died or went wrong: the cause, the student's line and a remedy, from its output.

Effects of stopping a node are not mistakes: they yield no diagnosis, at most an advisory.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

from grader.evidence.crash.causes import Diagnosis, cause_of, cause_of_line, table
from grader.evidence.crash.tracebacks import (
    Raised,
    chains,
    plain_lines,
    student_file,
    student_frame,
    tracebacks,
)
from grader.recording.session import OutputLine, ProcessRun, StackFrame

_KILLED = (-9, 137)
#: Exit statuses of a sandbox above this one name the signal that ended its program.
_SIGNALLED = 128
#: Characters of a line of output that are quoted.
_LONGEST_QUOTE = 200
#: Callers of a crashed function that are named.
_MOST_CALLERS = 3
#: Characters of a function's name that are quoted.
_LONGEST_FUNCTION = 100
#: Message of pybind11 about a signal's exception while it converts an argument.
HIT_IN_A_CALL = "Unable to convert call argument"
#: Causes of errors in a program that uses rclpy or a node after its shutdown.
_AFTER_SHUTDOWN = ("context-shut-down", "not-initialised")
#: Exceptions by which a program is stopped.
_STOPPING = ("KeyboardInterrupt", "ExternalShutdownException")
#: Exceptions with which a stopped program ends.
_STOPS = (*_STOPPING, "SystemExit")
_SECOND_SHUTDOWN = (
    "rcl_shutdown already called",
    "Context must be initialized before it can be shutdown",
)


def explain(
    output: Sequence[OutputLine], root_files: Collection[str], interrupted_ns: int | None = None
) -> Diagnosis | None:
    """Return the diagnosis of a process; None if there is no sign of a failure.

    The last exception counts, by its first cause; without an exception, other signs count.

    Parameters
    ----------
    output
        Lines of the process.
    root_files
        Files of the submission, relative to its root.
    interrupted_ns
        Time of Ctrl-C; after it, using a context that is shut down is no mistake.
    """
    for chain in reversed(chains(tracebacks(output))):
        raised = _mistake_in(chain, interrupted_ns)
        if raised is not None:
            cause = replace(cause_of(raised, root_files), exception_type=raised.type)
            return _located(cause, [raised, *chain], root_files)
    for line in plain_lines(output):
        found = cause_of_line(line.text)
        if found is not None:
            return replace(found, file=student_file(found.subject, root_files))
    return None


def _located(cause: Diagnosis, chain: Sequence[Raised], root_files: Collection[str]) -> Diagnosis:
    """Return a cause with the student's line of the first exception that has one."""
    for exception in chain:
        frame = student_frame(exception.frames, root_files)
        if frame is not None:
            return replace(cause, file=frame[0], line=frame[1])
    return cause


def advisories(output: Sequence[OutputLine]) -> tuple[str, ...]:
    """Return advice about the output of a process that costs no points."""
    raised = tracebacks(output)
    last = raised[-1].name if raised else ""
    text = "\n".join(line.text for line in plain_lines(output))
    found = []
    for row in table()["advisories"]:
        if _is_due(row, last, text):
            found.append(row["problem"].format(last=last))
    return tuple(found)


def _is_due(row: dict[str, Any], last: str, text: str) -> bool:
    """Return whether an advisory is due, by the type of the last exception and the whole output."""
    if not re.fullmatch(row.get("last", ".*"), last):
        return False
    if "unless" in row and re.search(row["unless"], text):
        return False
    return re.search(row.get("text", ""), text) is not None


def _mistake_in(chain: Sequence[Raised], interrupted_ns: int | None) -> Raised | None:
    """Return the first exception of a chain that is a mistake, if there is one."""
    stopped = any(exception.name in _STOPPING for exception in chain)
    for exception in chain:
        if exception.ignored or _is_stop(exception):
            continue
        is_late = interrupted_ns is not None and exception.t_ns >= interrupted_ns
        if (stopped or is_late) and _can_follow_stop(exception):
            continue
        return exception
    return None


def _is_stop(exception: Raised) -> bool:
    """Return whether an exception ends a stopped program, or a program that shuts down twice."""
    if exception.name in _STOPS:
        return True
    return any(words in exception.message for words in _SECOND_SHUTDOWN)


def _can_follow_stop(exception: Raised) -> bool:
    """Return whether a stop can cause an exception."""
    if HIT_IN_A_CALL in exception.message:
        return True
    return cause_of(exception, ()).kind in _AFTER_SHUTDOWN


def ended_by_signal(run: ProcessRun, root_files: Collection[str]) -> Diagnosis | None:
    """Return the diagnosis of a process that a signal of its own ended; None for another end.

    Such a signal ends compiled programs, and Python in a compiled module. The status of a program in a sandbox is 128
    and the number of the signal. Frames are known only of a compiled program.
    """
    if run.exit_status is None or run.limit is not None:
        return None
    if not run.ended_unasked or run.ended_by != "itself":
        return None
    number = -run.exit_status
    if run.exit_status > _SIGNALLED:
        number = run.exit_status - _SIGNALLED
    if number not in table()["signals"]:
        return None
    name, remedy = table()["signals"][number]
    frames = _own_frames(run, root_files)
    problem = f"The program ended by signal {number} ({name}){_place(frames)}."
    written = [line.text.strip() for line in plain_lines(run.output) if line.text.strip()]
    if written:
        problem += f" The last line of its output is {written[-1][:_LONGEST_QUOTE]!r}."
    found = Diagnosis("signal", problem, remedy, subject=name)
    if frames:
        found = replace(found, file=frames[0].file, line=frames[0].line)
    return found


def _own_frames(run: ProcessRun, root_files: Collection[str]) -> list[StackFrame]:
    """Return the frames of a crash in files of the submission."""
    found = []
    for frame in run.crash:
        if frame.file in root_files:
            found.append(frame)
    return found


def _place(frames: Sequence[StackFrame]) -> str:
    """Return the frame of a crash and its callers in words, such as " in first() at talker.c:8, called by main() ..."."""
    named = []
    for frame in frames[: 1 + _MOST_CALLERS]:
        function = frame.function[:_LONGEST_FUNCTION]
        if "(" not in function:
            function += "()"
        named.append(f"{function} at {PurePosixPath(frame.file).name}:{frame.line}")
    if not named:
        return ""
    return " in " + ", called by ".join(named)


def ended_by_limit(run: ProcessRun) -> bool:
    """Return whether a process was ended because of a limit."""
    if run.limit is None:
        return False
    return run.ended_by == "limit" or run.exit_status in _KILLED


def hit_limit(run: ProcessRun) -> tuple[str, str] | None:
    """Return the problem and the remedy of a process that hit a limit; None for another process."""
    if run.limit is None:
        return None
    unknown = (f"exceeded the limit '{run.limit}'", "Use less of it.")
    problem, remedy = table()["limits"].get(run.limit, unknown)
    how = "was ended" if ended_by_limit(run) else "went on"
    return f"The program {problem} (limit: {run.limit}), and {how}.", remedy
