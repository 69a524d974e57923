"""What is said between the process that grades many submissions and those that grade one each."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path

from grader.errors import GraderError, RubricError, described
from grader.intake import Handed, Intake
from grader.live.isolation import Isolation
from grader.pipeline import Options
from grader.result import Result
from grader.rubric import Rubric

#: What is kept of a text that says what went wrong.
_MOST_TEXT = 2_000


@dataclass(frozen=True)
class Order:
    """What to grade, by what, and where its results go.

    Attributes
    ----------
    handed : Handed or Intake
        The submission; already taken in if another machine did that.
    isolation : Isolation or None
        How students' code is confined on this machine; not needed to judge.
    submitted_at : str or None
        When it was handed in, where the recordings are there already.
    judge_only : bool
        Whether its recordings are there already.
    """

    handed: Handed | Intake
    results: Path
    rubric: Rubric
    options: Options
    isolation: Isolation | None = None
    submitted_at: str | None = None
    judge_only: bool = False

    def write(self, file: Path) -> None:
        """Write this for the process that is to carry it out."""
        file.write_bytes(pickle.dumps(self))

    @classmethod
    def read(cls, file: Path) -> Order:
        """Read what `write` wrote. Only ever the grader's own file."""
        order = pickle.loads(file.read_bytes())
        assert isinstance(order, cls)
        return order


#: How a grading ended: with a result, or with the reason why there is none.
Ending = Result | GraderError


def problem_of(error: Exception) -> GraderError:
    """Return what an exception says, on one line and of a length that can be shown in a table."""
    found = described(error)
    problem = "; ".join([found.problem, *found.mistakes]) if isinstance(found, RubricError) else found.problem
    told = GraderError(problem[:_MOST_TEXT], where=found.where[:_MOST_TEXT], remedy=found.remedy[:_MOST_TEXT])
    told.exit_status = found.exit_status
    return told


@dataclass(frozen=True)
class Row:
    """What became of a submission.

    Attributes
    ----------
    reused : bool
        Whether it was graded before, and nothing has changed.
    took_s : float
        From its first turn on.
    """

    handed: Handed
    ending: Ending
    reused: bool = False
    took_s: float = 0.0


@dataclass(frozen=True)
class Phase:
    """What a submission is doing now.

    Attributes
    ----------
    session : str
        The session concerned; empty for the grader's own work.
    ended : bool
        Whether that has been done.
    """

    session: str
    text: str
    ended: bool = False
