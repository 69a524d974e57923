"""A result as the exports show it: with people's decisions about each check, in the words that all exports share."""

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

#: Longest path, and longest name that is shown.
_LONGEST_NAME = 4096
#: Most locations that an export names for a check.
MOST_LOCATIONS = 4
#: Most remarks of a kind on the submission as a whole, because a student can cause any number.
MOST_REMARKS = 50


@dataclass(frozen=True)
class GradedCheck(CheckResult):
    """A check with people's decisions.

    `undecided` are the points without a decision, and `given` those that a person's decision added. `location` is the
    first location of its proof in a file of the student's repository; its line is 1 if the line is not known.
    """

    given: Decimal = Decimal(0)
    open: bool = False
    location: Location | None = None

    @property
    def lost(self) -> Decimal:
        """Points that the submission lost here; undecided points are not lost."""
        return max(Decimal(0), self.possible - self.earned - self.undecided - self.given)

    @property
    def locations(self) -> tuple[str, ...]:
        """Locations of the proof, in words."""
        texts = [str(where)[:_LONGEST_NAME] for where in self.where]
        return tuple(dict.fromkeys(texts))

    @property
    def sessions(self) -> tuple[str, ...]:
        """Sessions with recordings of the proof."""
        names = [where.session for where in self.where if where.session]
        return tuple(dict.fromkeys(names))


@dataclass(frozen=True)
class GradedCriterion(CriterionResult):
    """A criterion with people's decisions about its checks."""

    checks: tuple[GradedCheck, ...]


@dataclass(frozen=True)
class Graded(Result):
    """A submission's result as the exports show it."""

    criteria: tuple[GradedCriterion, ...]

    @property
    def checks(self) -> tuple[GradedCheck, ...]:
        """All checks, in the rubric's order."""
        found: list[GradedCheck] = []
        for criterion in self.criteria:
            found += criterion.checks
        return tuple(found)

    @property
    def lossy(self) -> tuple[GradedCheck, ...]:
        """The checks that cost points, the costliest first."""
        lossy = [check for check in self.checks if check.lost]
        return tuple(sorted(lossy, key=lambda check: -check.lost))

    @property
    def open_without_loss(self) -> tuple[GradedCheck, ...]:
        """The undecided checks that have not lost points so far."""
        return tuple(check for check in self.checks if check.open and not check.lost)

    @property
    def sessions(self) -> Mapping[str, SessionProvenance]:
        """When each session was recorded, and how it was confined."""
        return self.provenance.get("sessions", {})

    @property
    def isolations(self) -> tuple[str, ...]:
        """The levels of isolation of the sessions, each once."""
        levels = [session["isolation"] for session in self.sessions.values()]
        return tuple(dict.fromkeys(levels))


def graded(result: Result, path_prefix: str = "") -> Graded:
    """Return a result as the exports show it; `path_prefix` is the submission's folder in its repository, if any."""
    excused = set()
    given: defaultdict[str, Decimal] = defaultdict(Decimal)
    for each in result.adjustments:
        if each.kind in BY_HAND:
            given[each.what] += each.points
        if each.kind is AdjustmentKind.EXCUSED:
            excused.add(each.what)
    open_ids = {check.id for check in result.open_checks}

    def graded_check(check: CheckResult, criterion: str) -> GradedCheck:
        undecided = check.undecided
        if check.id in given:
            undecided = Decimal(0)
        added = given.get(check.id, Decimal(0))
        if criterion in excused:
            # A decision about a whole criterion says nothing about each check, unless all of it is excused.
            added = check.possible - check.earned - undecided
        judged = vars(check) | {"undecided": undecided}
        is_open = check.id in open_ids
        location = _first_in_repository(check, path_prefix)
        return GradedCheck(**judged, given=added, open=is_open, location=location)

    criteria = []
    for criterion in result.criteria:
        checks = tuple(graded_check(check, criterion.id) for check in criterion.checks)
        criteria.append(GradedCriterion(**{**vars(criterion), "checks": checks}))
    return Graded(**{**vars(result), "criteria": tuple(criteria)})


def _first_in_repository(check: CheckResult, path_prefix: str) -> Location | None:
    """Return the first location of a check's proof that is in the repository."""
    for where in check.where:
        location = _in_repository(where, path_prefix)
        if location is not None:
            return location
    return None


def _in_repository(where: Location, path_prefix: str) -> Location | None:
    """Return a location in the repository; None if its path leads elsewhere, or cannot be shown unchanged."""
    if not where.file or len(where.file) > _LONGEST_NAME:
        return None
    path = PurePosixPath(path_prefix, where.file)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        return None
    text = str(path)
    if "\n" in text or shown(text, len(text)) != text:
        return None
    return Location(text, max(1, where.line or 1))


def points_of(check: GradedCheck) -> str:
    """Write the earned points of a check: `3 / 5`; `? / 5` if the check is undecided."""
    if check.open:
        earned = "?"
    else:
        earned = points(check.earned + check.given)
    return f"{earned} / {points(check.possible)}"


def violation_texts(graded: Graded) -> list[str]:
    """Describe the tampering with the grader's own nodes, topics and records, in untrusted lines."""
    texts = []
    for violation in graded.violations[:MOST_REMARKS]:
        evidence = violation.evidence[:MOST_LOCATIONS]
        texts.append(" ".join([violation.text, note_of(violation), *evidence]))
    return texts


def proof_lines(check: GradedCheck) -> list[tuple[str, str]]:
    """Return expectation, measurement, locations and hint, each a name with a line of text, as far as there are any."""
    named = [
        ("Expected", check.expected),
        ("Measured", check.measured),
        ("Where", "; ".join(check.locations[:MOST_LOCATIONS])),
        ("Hint", check.hint),
    ]
    return [(name, line(text, 600)) for name, text in named if text]


def full_text(check: GradedCheck) -> str:
    """Return the whole explanation of a check that did not pass, as plain lines that can be shown."""
    reason = line(check.reason, 600)
    lines = [reason]
    if check.open:
        note = f"Undecided, {points(check.undecided)} points are not earned before somebody has decided."
        lines = [f"{note} {reason}".strip()]
    lines += [f"{name}: {text}" for name, text in proof_lines(check)]
    return "\n".join(filter(None, lines))
