"""The exceptions of the grader: no fair score exists, so none is written.

A student's fault is a finding, never an exception. Each class has its exit status; the command line catches them once.
"""

from __future__ import annotations

import re

from confine.limits import limit_behind

#: Beginning of the names of the grader's temporary folders.
TEMPORARY = "grade-temporary-"
#: A path within a text.
_PATH = re.compile(r"/[^\s'\":]*")
#: A temporary folder of the grader within a path, with its part that the user does not know.
_SCRATCH = re.compile(
    r"/(?:confine-\d+-\d+-\d+-|grade-intake-|grade-doctor-|grade-temporary-)[^/]+"
    r"(?:/(?:submission|workspace|trial|sources|lab|results)(?![^/]))?/*"
)
#: Names of unfinished results and recordings of sessions.
_IN_THE_MAKING = re.compile(r"/\.unfinished(?=/)|(?<=/)\.([\w-]+)\.partial(?![^/\s'\":])")


def without_temporary_names(text: str) -> str:
    """Return a text without the names of the grader's temporary folders.

    For example `/tmp/confine-1-2-3-intake-x/submission/a/b.py` becomes `a/b.py`, and `results/ann/.unfinished/recordings`
    becomes `results/ann/recordings`.
    """
    text = _IN_THE_MAKING.sub(lambda found: found[1] or "", text)
    return _PATH.sub(lambda found: _known_part(found[0]), text)


def _known_part(path: str) -> str:
    """Return the part of a path that the user knows, below a temporary folder."""
    folders = list(_SCRATCH.finditer(path))
    if not folders:
        return path
    known = path[folders[-1].end() :]
    if not known:
        return "a temporary folder"
    return known


class GraderError(Exception):
    """Base of all errors that end a grading without a score: the problem, its location, and a remedy."""

    exit_status = 70

    def __init__(self, problem: str, *, location: str = "", remedy: str = "") -> None:
        super().__init__(problem)
        self.problem = without_temporary_names(problem)
        self.location = without_temporary_names(location)
        self.remedy = without_temporary_names(remedy)


class UsageError(GraderError):
    """The command line asks for something that does not exist."""

    exit_status = 2


class SubmissionError(GraderError):
    """There is no such submission, or nothing in it looks like one."""

    exit_status = 3


class RubricError(GraderError):
    """The rubric is not usable; all its mistakes are listed at once, a line each, with file and line number."""

    exit_status = 4

    def __init__(
        self, problem: str, mistakes: list[str], *, location: str = "", remedy: str = ""
    ) -> None:
        super().__init__(problem, location=location, remedy=remedy)
        self.mistakes = list(map(without_temporary_names, mistakes))


class PlatformError(GraderError):
    """The machine cannot run ROS 2 nodes, or lacks a part that grading needs."""

    exit_status = 5


class ProcessLostError(PlatformError):
    """A grader process was killed, and its grading with it; a retry may succeed."""


class RecordingError(GraderError):
    """A recording is missing, damaged or of another version."""

    exit_status = 6


class IsolationError(GraderError):
    """The requested confinement is not available here."""

    exit_status = 7


class BoundError(GraderError):
    """Work on a student's file exceeded its limit of time or memory."""


def described(error: Exception) -> GraderError:
    """Return any exception as an error of the grader, with a remedy."""
    if isinstance(error, GraderError):
        return error
    limit = limit_behind(f"{type(error).__name__}: {error}")
    if limit is not None:
        problem = f"the grader failed: {str(error) or type(error).__name__}; {limit.present}"
        return PlatformError(problem, remedy=limit.remedy)
    if isinstance(error, OSError):
        remedy = "Check that the disk is not full and that the folder can be written to."
        return GraderError(
            error.strerror or str(error), location=str(error.filename or ""), remedy=remedy
        )
    return GraderError(
        f"the grader failed: {type(error).__name__}: {error}",
        remedy="This is a defect of grade; please report it.",
    )
