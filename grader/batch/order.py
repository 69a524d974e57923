"""What is said between the process that grades many submissions and those that grade one each."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from grader.errors import GraderError, RubricError, described
from grader.intake import Handed, Intake
from grader.live.isolation import Isolation
from grader.pipeline import Options
from grader.rubric import Rubric

#: Exit status of troubles that are the grader's own.
TROUBLE = GraderError.exit_status
#: What is kept of a text that says what went wrong.
_MOST_TEXT = 2_000


@dataclass(frozen=True)
class Order:
    """What to grade, by what, and where its results go.

    Attributes
    ----------
    handed : Handed or Intake
        The submission; already taken in if another machine did that.
    results : Path
        Folder of its results.
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


@dataclass(frozen=True)
class Graded:
    """A submission has its points."""

    earned: Decimal
    possible: Decimal
    undecided: Decimal

    def to_plain(self) -> dict[str, Any]:
        """Return this as plain data."""
        return {"earned": str(self.earned), "possible": str(self.possible), "undecided": str(self.undecided)}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Graded:
        """Undo `to_plain`; also reads the score in a `result.json`."""
        earned, possible, undecided = (Decimal(str(plain[key])) for key in ("earned", "possible", "undecided"))
        return cls(earned, possible, undecided)


@dataclass(frozen=True)
class NotGraded:
    """A submission has no points, and why.

    Attributes
    ----------
    exit_status : int
        With which a grading of this submission alone would have ended.
    """

    problem: str
    where: str = ""
    remedy: str = ""
    exit_status: int = TROUBLE

    def to_plain(self) -> dict[str, Any]:
        """Return this as plain data."""
        texts = {"problem": self.problem, "where": self.where, "remedy": self.remedy}
        return {key: text[:_MOST_TEXT] for key, text in texts.items()} | {"exit_status": self.exit_status}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> NotGraded:
        """Undo `to_plain`."""
        return cls(str(plain["problem"]), str(plain["where"]), str(plain["remedy"]), int(plain["exit_status"]))

    @classmethod
    def from_error(cls, error: Exception) -> NotGraded:
        """Say what an exception says."""
        told = described(error)
        problem = "; ".join([told.problem, *told.mistakes]) if isinstance(told, RubricError) else told.problem
        return cls(problem, told.where, told.remedy, told.exit_status)


Ending = Graded | NotGraded
