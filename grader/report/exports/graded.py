"""What the exports read of `result.json`: plain data → frozen values, all text still untrusted.

Keys that this version does not know are passed over, so that a later `result.json` can be exported too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from decimal import Decimal
from pathlib import PurePosixPath
from typing import Any

from grader.errors import RecordingError
from grader.report.untrusted import shown
from grader.result import (
    RESULT_SCHEMA,
    Adjustment,
    AdjustmentKind,
    Outcome,
    Violation,
    ViolationKind,
    Where,
)

#: No path is longer, and no name that matters.
_LONGEST_NAME = 4096
_WHERE_KEYS = tuple(field.name for field in fields(Where))


@dataclass(frozen=True)
class Spot:
    """A line of a file of the student's repository.

    Attributes
    ----------
    path : str
        Relative to the repository, with `/`, never out of it; without characters that cannot be shown.
    line : int
        Counted from 1; 1 where only the file is known.
    """

    path: str
    line: int


@dataclass(frozen=True)
class GradedCheck:
    """A check with its points and its proof.

    Attributes
    ----------
    undecided : Decimal
        Points that nobody has decided, neither the recording nor a person.
    given : Decimal
        What a person's decision added to this check's points.
    open : bool
        Whether something of it is undecided.
    places : tuple of str
        Where the proof lies, in words.
    spot : Spot or None
        The first of these that is a file.
    sessions : tuple of str
        The sessions in whose recordings the proof lies.
    """

    id: str
    title: str
    outcome: Outcome
    earned: Decimal
    possible: Decimal
    undecided: Decimal
    given: Decimal
    open: bool
    expected: str
    measured: str
    reason: str
    hint: str
    places: tuple[str, ...]
    spot: Spot | None
    sessions: tuple[str, ...]

    @property
    def lost(self) -> Decimal:
        """Points that the submission lost here; what is undecided is not lost."""
        return max(Decimal(0), self.possible - self.earned - self.undecided - self.given)


@dataclass(frozen=True)
class GradedCriterion:
    """A criterion with its checks."""

    id: str
    title: str
    earned: Decimal
    possible: Decimal
    undecided: Decimal
    checks: tuple[GradedCheck, ...]


@dataclass(frozen=True)
class SessionFacts:
    """When a session was recorded, and how it was confined."""

    started_ns: int
    duration_s: float
    isolation: str


@dataclass(frozen=True)
class Graded:
    """A submission's result as the exports read it.

    Attributes
    ----------
    earned, possible : Decimal
        As judged.
    undecided : Decimal
        Sum over the checks that are open.
    final : Decimal
        The points earned with all adjustments.
    """

    submission: str
    lab: str
    earned: Decimal
    possible: Decimal
    undecided: Decimal
    final: Decimal
    criteria: tuple[GradedCriterion, ...]
    adjustments: tuple[Adjustment, ...]
    violations: tuple[Violation, ...]
    advisories: tuple[str, ...]
    problems: tuple[str, ...]
    sessions: Mapping[str, SessionFacts]
    rubric_sha256: str

    @property
    def checks(self) -> tuple[GradedCheck, ...]:
        """All checks, in the rubric's order."""
        return tuple(check for criterion in self.criteria for check in criterion.checks)

    @property
    def lossy(self) -> tuple[GradedCheck, ...]:
        """The checks that cost points, the costliest first."""
        return tuple(sorted((check for check in self.checks if check.lost), key=lambda check: -check.lost))


def read_graded(plain: Mapping[str, Any], path_prefix: str = "") -> Graded:
    """Read the plain data of `result.json`.

    Parameters
    ----------
    path_prefix : str
        Folder of the submission in its repository; empty if it is the repository itself.

    Raises
    ------
    RecordingError
        If the data is no result of this version.
    """
    try:
        if plain["schema"] != RESULT_SCHEMA:
            raise ValueError(f"its schema is not {RESULT_SCHEMA}")
        return _graded(plain, path_prefix)
    except (KeyError, TypeError, ValueError, ArithmeticError, AttributeError) as problem:
        raise RecordingError(
            "this is no result of this version of grade",
            remedy=f"Run `grade regrade` on the results folder. ({type(problem).__name__}: {problem})",
        ) from problem


def _graded(plain: Mapping[str, Any], path_prefix: str) -> Graded:
    adjustments = tuple(_adjustment(each) for each in plain.get("adjustments", ()))
    criteria = tuple(_criterion(each, adjustments, path_prefix) for each in plain["criteria"])
    score, provenance = plain["score"], plain.get("provenance", {})
    return Graded(
        submission=str(plain["submission"]),
        lab=str(plain["lab"]),
        earned=_points(score["earned"]),
        possible=_points(score["possible"]),
        undecided=sum((check.undecided for each in criteria for check in each.checks if check.open), Decimal(0)),
        final=_points(score.get("final", score["earned"])),
        criteria=criteria,
        adjustments=adjustments,
        violations=tuple(_violation(each) for each in plain.get("violations", ())),
        advisories=_texts(plain.get("advisories", ())),
        problems=_texts(plain.get("problems", ())),
        sessions={str(name): _session(facts) for name, facts in provenance.get("sessions", {}).items()},
        rubric_sha256=str(provenance.get("rubric_sha256", "")),
    )


def _criterion(plain: Mapping[str, Any], adjustments: Sequence[Adjustment], path_prefix: str) -> GradedCriterion:
    here = _by_hand(adjustments, plain["id"])
    checks = [_check(each, adjustments, path_prefix) for each in plain["checks"]]
    if here:  # A person has looked at all of it; what it got for each check is not known, unless it is excused.
        checks = [replace(check, open=False) for check in checks]
    if any(each.kind is AdjustmentKind.EXCUSED for each in here):
        checks = [replace(check, given=check.given + check.lost) for check in checks]
    return GradedCriterion(
        id=str(plain["id"]),
        title=str(plain["title"]),
        earned=_points(plain["earned"]),
        possible=_points(plain["possible"]),
        undecided=_points(plain["undecided"]),
        checks=tuple(checks),
    )


def _by_hand(adjustments: Sequence[Adjustment], what: Any) -> list[Adjustment]:
    kinds = (AdjustmentKind.POINTS, AdjustmentKind.EXCUSED)
    return [each for each in adjustments if each.what == what and each.kind in kinds]


def _check(plain: Mapping[str, Any], adjustments: Sequence[Adjustment], path_prefix: str) -> GradedCheck:
    wheres = [_where(where) for where in plain["where"]]
    spots = [spot for where in wheres if (spot := _spot(where, path_prefix)) is not None]
    here = _by_hand(adjustments, plain["id"])
    undecided = Decimal(0) if here else _points(plain["undecided"])
    return GradedCheck(
        id=str(plain["id"]),
        title=str(plain["title"]),
        outcome=Outcome(plain["outcome"]),
        earned=_points(plain["earned"]),
        possible=_points(plain["possible"]),
        undecided=undecided,
        given=sum((each.points for each in here), Decimal(0)),
        open=undecided > 0,
        expected=str(plain["expected"]),
        measured=str(plain["measured"]),
        reason=str(plain["reason"]),
        hint=str(plain["hint"]),
        places=tuple(dict.fromkeys(str(where) for where in wheres)),
        spot=spots[0] if spots else None,
        sessions=tuple(dict.fromkeys(where.session for where in wheres if where.session)),
    )


def _where(plain: Mapping[str, Any]) -> Where:
    parts: dict[str, Any] = {key: _cut(plain.get(key)) for key in _WHERE_KEYS}
    return Where(**parts)


def _cut(value: Any) -> Any:
    return value[:_LONGEST_NAME] if isinstance(value, str) else value


def _spot(where: Where, path_prefix: str) -> Spot | None:
    """Return the file in the repository; none if the path leads out of it, or cannot be shown as it is."""
    if not where.file:
        return None
    path = PurePosixPath(path_prefix, where.file)
    told = str(path)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        return None
    return Spot(told, max(1, where.line or 1)) if shown(told, len(told)) == told and "\n" not in told else None


def _adjustment(plain: Mapping[str, Any]) -> Adjustment:
    return Adjustment(
        kind=AdjustmentKind(plain["kind"]),
        what=str(plain["what"]),
        points=_points(plain["points"]),
        reason=str(plain.get("reason", "")),
        who=str(plain.get("who", "")),
        when=str(plain.get("when", "")),
    )


def _violation(plain: Mapping[str, Any]) -> Violation:
    return Violation(
        kind=ViolationKind(plain["kind"]),
        session=str(plain["session"]),
        text=str(plain["text"]),
        evidence=_texts(plain.get("evidence", ())),
        certain=bool(plain.get("certain", True)),
        checks=_texts(plain.get("checks", ())),
    )


def _session(plain: Mapping[str, Any]) -> SessionFacts:
    return SessionFacts(int(plain["started_ns"]), float(plain["duration_s"]), str(plain["isolation"]))


def _texts(plain: Sequence[Any]) -> tuple[str, ...]:
    return tuple(str(text) for text in plain)


def _points(plain: Any) -> Decimal:
    """Read points; a number of JSON is turned over as it is written, not as its nearest binary fraction."""
    value = Decimal(str(plain))
    if not value.is_finite():
        raise ValueError(f"{plain} is no number of points")
    return value
