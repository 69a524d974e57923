"""What is said between the process that grades many submissions and those that grade one each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from confine.isolation import Isolation
from grader.classroom.scheduler import Machine
from grader.errors import GraderError, ProcessLostError, RubricError, described
from grader.lab.rubric import Rubric
from grader.pipeline import Options
from grader.report.exports.writing import ExportTarget
from grader.result import Result
from grader.submission.extraction import Intake, SubmissionSource

#: What is kept of a text that says what went wrong.
_MOST_TEXT = 2_000


@dataclass(frozen=True)
class Job:
    """What to grade, by what, and where its results go."""

    #: The submission; already extracted if another machine did that.
    source: SubmissionSource | Intake
    results: Path
    rubric: Rubric
    options: Options
    #: How students' code is confined on the machine that grades it, and the slots there; filled in there.
    isolation: Isolation | None = None
    machine: Machine | None = None
    #: How long its process may say nothing, in seconds, beyond what a session may take; all that it does by itself has
    #: a tighter bound.
    silence_s: float = 120.0
    #: How long it may have the machine for itself; after that its sessions are recorded beside few others.
    alone_s: float = 60.0

    def absolute(self) -> Job:
        """Return the same job for a process with another working folder."""
        source = self.source
        if isinstance(source, SubmissionSource):
            pieces = []
            for piece in source.pieces:
                pieces.append(replace(piece, path=piece.path.absolute()))
            source = replace(source, pieces=tuple(pieces))
        exports = map(ExportTarget.absolute, self.options.exports)
        options = replace(self.options, exports=tuple(exports))
        return replace(self, source=source, results=self.results.absolute(), options=options)


#: How a grading ended: with a result, or with the reason why there is none.
Ending = Result | GraderError


def problem_of(error: Exception) -> GraderError:
    """Return what an exception says, on one line and of a length that can be shown in a table."""
    found = described(error)
    problem = (
        "; ".join([found.problem, *found.mistakes])
        if isinstance(found, RubricError)
        else found.problem
    )
    kind = ProcessLostError if isinstance(found, ProcessLostError) else GraderError
    shown = kind(
        problem[:_MOST_TEXT], location=found.location[:_MOST_TEXT], remedy=found.remedy[:_MOST_TEXT]
    )
    shown.exit_status = found.exit_status
    return shown


@dataclass(frozen=True)
class Row:
    """What became of a submission."""

    source: SubmissionSource
    ending: Ending
    #: Whether it was graded before, and nothing has changed.
    reused: bool = False
    #: From its first phase on.
    took_s: float = 0.0
