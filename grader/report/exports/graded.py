"""A result as the exports show it: with what people decided of each check, in the words that all exports share."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import PurePosixPath

from grader.report.escape import line, shown
from grader.report.views import note_of, points
from grader.result import (
    BY_HAND,
    AdjustmentKind,
    CheckResult,
    CriterionResult,
    Location,
    Result,
    SessionProvenance,
)

#: No path is longer, and no name that matters.
_LONGEST_NAME = 4096
#: Most places that an export names for a check.
MOST_LOCATIONS = 4
#: Most remarks of a kind on the submission as a whole, since a student can cause any number.
MOST_REMARKS = 50


@dataclass(frozen=True)
class GradedCheck(CheckResult):
    """A check with what a person decided of it.

    `undecided` are the points that nobody has decided, `given` those that a person's decision added, and `location` is
    the first place of its proof that is a file of the student's repository, with its line, 1 where that is not known.
    """

    given: Decimal = Decimal(0)
    open: bool = False
    location: Location | None = None

    @property
    def lost(self) -> Decimal:
        """Points that the submission lost here; what is undecided is not lost."""
        return max(Decimal(0), self.possible - self.earned - self.undecided - self.given)

    @property
    def locations(self) -> tuple[str, ...]:
        """Where the proof lies, in words."""
        return tuple(dict.fromkeys(str(where)[:_LONGEST_NAME] for where in self.where))

    @property
    def sessions(self) -> tuple[str, ...]:
        """The sessions in whose recordings the proof lies."""
        return tuple(dict.fromkeys(where.session for where in self.where if where.session))


@dataclass(frozen=True)
class GradedCriterion(CriterionResult):
    """A criterion with such checks."""

    checks: tuple[GradedCheck, ...]


@dataclass(frozen=True)
class Graded(Result):
    """A submission's result as the exports show it."""

    criteria: tuple[GradedCriterion, ...]

    @property
    def checks(self) -> tuple[GradedCheck, ...]:
        """All checks, in the rubric's order."""
        return tuple(check for criterion in self.criteria for check in criterion.checks)

    @property
    def lossy(self) -> tuple[GradedCheck, ...]:
        """The checks that cost points, the costliest first."""
        return tuple(
            sorted((check for check in self.checks if check.lost), key=lambda check: -check.lost)
        )

    @property
    def sessions(self) -> Mapping[str, SessionProvenance]:
        """When each session was recorded, and how it was confined."""
        return self.provenance.get("sessions", {})


def graded(result: Result, path_prefix: str = "") -> Graded:
    """Return what the exports show of a result; `path_prefix` is the submission's folder in its repository, if any."""
    by_hand = [each for each in result.adjustments if each.kind in BY_HAND]
    excused = {each.what for each in by_hand if each.kind is AdjustmentKind.EXCUSED}
    open_ids = {check.id for check in result.open_checks}
    given: defaultdict[str, Decimal] = defaultdict(Decimal)
    for each in by_hand:
        given[each.what] += each.points

    def graded_check(check: CheckResult, criterion: str) -> GradedCheck:
        undecided = Decimal(0) if check.id in given else check.undecided
        # A person has looked at all of the criterion; what it got for each check is not known, unless it is excused.
        rest = check.possible - check.earned - undecided
        added = rest if criterion in excused else given.get(check.id, Decimal(0))
        location = next(
            filter(None, (_in_repository(where, path_prefix) for where in check.where)), None
        )
        is_open = check.id in open_ids
        return GradedCheck(
            **{**vars(check), "undecided": undecided}, given=added, open=is_open, location=location
        )

    criteria = []
    for criterion in result.criteria:
        checks = tuple(graded_check(check, criterion.id) for check in criterion.checks)
        criteria.append(GradedCriterion(**{**vars(criterion), "checks": checks}))
    return Graded(**{**vars(result), "criteria": tuple(criteria)})


def _in_repository(where: Location, path_prefix: str) -> Location | None:
    """Return the file in the repository; none if the path leads out of it, or cannot be shown as it is."""
    if not where.file or len(where.file) > _LONGEST_NAME:
        return None
    path = PurePosixPath(path_prefix, where.file)
    text = str(path)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        return None
    showable = shown(text, len(text)) == text and "\n" not in text
    return Location(text, max(1, where.line or 1)) if showable else None


def points_of(check: GradedCheck) -> str:
    """Return what a check earned of its points; a question mark where that is open."""
    earned = "?" if check.open else points(check.earned + check.given)
    return f"{earned} / {points(check.possible)}"


def violation_texts(graded: Graded) -> list[str]:
    """Return what of the grader's own was tampered with, each as a line of text that is still untrusted."""
    return [
        " ".join([violation.text, note_of(violation), *violation.evidence[:MOST_LOCATIONS]])
        for violation in graded.violations[:MOST_REMARKS]
    ]


def proof_lines(check: GradedCheck) -> list[tuple[str, str]]:
    """Return what was expected, what was measured, where, and what to do; names with texts of a line each."""
    named = [
        ("Expected", check.expected),
        ("Measured", check.measured),
        ("Where", "; ".join(check.locations[:MOST_LOCATIONS])),
        ("Hint", check.hint),
    ]
    return [(name, line(text, 600)) for name, text in named if text]


def full_text(check: GradedCheck) -> str:
    """Return all that is to be said of a check that did not pass, as plain lines that can be shown."""
    why = line(check.reason, 600)
    if check.open:
        why = f"Undecided, {points(check.undecided)} points are not earned before somebody has decided. {why}".strip()
    return "\n".join(
        [*([why] if why else []), *(f"{name}: {text}" for name, text in proof_lines(check))]
    )
