"""Messages between the process that grades many submissions and the processes that grade one each."""

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

#: Characters of a problem's description that are kept.
_MOST_TEXT = 2_000


@dataclass(frozen=True)
class Job:
    """A submission to grade, with the rubric and the place of its results."""

    #: The submission; already extracted if another machine did that.
    source: SubmissionSource | Intake
    results: Path
    rubric: Rubric
    options: Options
    #: Confinement of students' code on the machine that grades it, and the slots there; filled in there.
    isolation: Isolation | None = None
    machine: Machine | None = None
    #: Timeout of a silent process beyond the time of a session, in s; all its own work has a tighter bound.
    silence_s: float = 120.0
    #: Time for which a submission can have the machine for itself, in s; afterwards its sessions run beside few
    #: others.
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


#: The ending of a grading: a result, or the reason why there is none.
Ending = Result | GraderError


def problem_of(error: Exception) -> GraderError:
    """Return the text of an exception, on one line and short enough for a table."""
    found = described(error)
    if isinstance(found, RubricError):
        problem = "; ".join([found.problem, *found.mistakes])
    else:
        problem = found.problem
    kind = ProcessLostError if isinstance(found, ProcessLostError) else GraderError
    location = found.location[:_MOST_TEXT]
    remedy = found.remedy[:_MOST_TEXT]
    shown = kind(problem[:_MOST_TEXT], location=location, remedy=remedy)
    shown.exit_status = found.exit_status
    return shown


@dataclass(frozen=True)
class Row:
    """The ending of a submission's grading."""

    source: SubmissionSource
    ending: Ending
    #: True if an earlier result is reused, because nothing has changed.
    reused: bool = False
    #: Time since the first phase.
    took_s: float = 0.0
