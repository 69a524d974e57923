"""A class in numbers: who has what, how the points spread, what each check tells, and what needs a person.

Pure: equal entries and rubric give an equal summary, in the order of the entries.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from enum import Enum

from grader.cohort.entries import ClassEntry
from grader.cohort.mistakes import Mistake, mistakes_of
from grader.lab.kept_lab import identity_of
from grader.lab.rubric import Rubric
from grader.result import CriterionResult, Outcome, Result

#: Submissions below which a correlation says next to nothing.
LEAST_FOR_DISCRIMINATION = 10
BARS = 20
UNCERTAIN = "This may have another cause than the submission."


@dataclass(frozen=True)
class Row:
    """One student."""

    entry: ClassEntry
    #: By criterion of the rubric; None for one that was not judged.
    cells: tuple[CriterionResult | None, ...]

    @property
    def result(self) -> Result | None:
        """None if the submission was not graded."""
        return self.entry.result


class Need(str, Enum):
    """Why a submission needs a person."""

    NOT_GRADED = "not graded"
    VIOLATION = "violation"
    UNDECIDED = "undecided"
    UNMEASURED = "unmeasured"
    LATENESS = "lateness"
    OTHER_RUBRIC = "other rubric"


@dataclass(frozen=True)
class Todo:
    """Something that a person has to look at."""

    #: Place of the student in the class, from 0.
    row: int
    need: Need
    #: Points that depend on it.
    points: Decimal
    #: Titles of checks, or kinds of violations.
    titles: tuple[str, ...]
    #: What is known of it, each sentence once.
    texts: tuple[str, ...]
    #: The first check concerned; empty if it is about no check.
    check_id: str = ""


@dataclass(frozen=True)
class Bar:
    """How many have from `low` points up to, but without, `high`; the last bar is with it and beyond."""

    low: Decimal
    high: Decimal
    count: int


@dataclass(frozen=True)
class Spread:
    """How points are spread over those that were graded.

    Quartiles are those of spreadsheets' QUARTILE.INC. What is undecided is not counted.
    """

    count: int
    possible: Decimal
    mean: Decimal
    lowest: Decimal
    first_quartile: Decimal
    median: Decimal
    third_quartile: Decimal
    highest: Decimal
    bars: tuple[Bar, ...]


class Silent(str, Enum):
    """Why there is no discrimination."""

    TOO_FEW = "too few"
    ALL_ALIKE = "all alike"


@dataclass(frozen=True)
class CheckStatistics:
    """What a check tells about a class, over the submissions for which it is decided.

    Notes
    -----
    The discrimination is the corrected item-total correlation: Pearson's, between the check's credit and the share of
    points earned in all other decided checks, before adjustments. There is none for fewer than
    `LEAST_FOR_DISCRIMINATION` submissions, nor where all have the same credit or the same rest.

    References
    ----------
    Henrysson, S. (1963). Correction of item-total correlations in item analysis. Psychometrika 28, 211-218.
    """

    id: str
    title: str
    #: Place of its criterion, from 0.
    column: int
    points: Decimal
    #: Number of those submissions, and of those that passed it.
    decided: int
    passed: int
    #: Mean share of its points, from 0 to 1; None if it is decided for nobody.
    mean_credit: float | None
    #: Whether it tells strong submissions from weak ones: see Notes.
    discrimination: float | Silent


@dataclass(frozen=True)
class Column:
    """A criterion, and the mean of the points in it, as people decided; what is undecided is not counted."""

    id: str
    title: str
    points: Decimal
    mean: Decimal | None


@dataclass(frozen=True)
class ClassSummary:
    """A class."""

    lab: str
    #: In the order of the entries.
    rows: tuple[Row, ...]
    columns: tuple[Column, ...]
    #: None if nothing was graded.
    spread: Spread | None
    checks: tuple[CheckStatistics, ...]
    mistakes: tuple[Mistake, ...]
    #: By kind, in the order of `Need`.
    todos: tuple[Todo, ...]
    #: Correlations nearer to 0 than this are insignificant in a class of this size (two standard
    #: errors).
    noise: float | None


def summarise(entries: Sequence[ClassEntry], rubric: Rubric) -> ClassSummary:
    """Sum up a class; what was judged by another rubric than this is told among the things to do."""
    judged = [{c.id: c for c in entry.result.criteria} if entry.result else {} for entry in entries]
    rows = tuple(
        Row(entry, tuple(cells.get(criterion.id) for criterion in rubric.criteria))
        for entry, cells in zip(entries, judged, strict=True)
    )
    results = {n: row.result for n, row in enumerate(rows) if row.result is not None}
    return ClassSummary(
        f"Lab {rubric.lab.id}: {rubric.lab.title}",
        rows,
        tuple(_column(n, rubric, rows) for n in range(len(rubric.criteria))),
        _spread([result.final for result in results.values()], rubric.lab.points)
        if results
        else None,
        _check_statistics(list(results.values()), rubric),
        mistakes_of(results, rubric),
        tuple(sorted(_todos(rows, rubric), key=lambda todo: list(Need).index(todo.need))),
        2 / math.sqrt(len(results)) if len(results) >= LEAST_FOR_DISCRIMINATION else None,
    )


def _column(index: int, rubric: Rubric, rows: Sequence[Row]) -> Column:
    spec = rubric.criteria[index]
    cells = [(row.result, row.cells[index]) for row in rows]
    earned = [
        result.final_of(cell) for result, cell in cells if result is not None and cell is not None
    ]
    return Column(spec.id, spec.title, spec.points, statistics.mean(earned) if earned else None)


# -- how points spread -------------------------------------------------------------------------


def _spread(totals: Sequence[Decimal], possible: Decimal) -> Spread:
    ordered = sorted(totals)
    first, median, third = statistics.quantiles(
        ordered * 2 if len(ordered) == 1 else ordered, method="inclusive"
    )
    width = possible / BARS
    places = Counter(max(0, min(BARS - 1, int(total / width) if width else 0)) for total in ordered)
    bars = tuple(Bar(width * n, width * (n + 1), places[n]) for n in range(BARS))
    return Spread(
        len(ordered),
        possible,
        statistics.mean(ordered),
        ordered[0],
        first,
        median,
        third,
        ordered[-1],
        bars,
    )


# -- what each check tells ---------------------------------------------------------------------


def _check_statistics(results: Sequence[Result], rubric: Rubric) -> tuple[CheckStatistics, ...]:
    pairs: dict[str, list[tuple[float, float]]] = {check.id: [] for check in rubric.checks()}
    passed = dict.fromkeys(pairs, 0)
    for result in results:
        earned = sum((c.earned for c in result.checks), Decimal(0))
        decided = sum((c.possible - c.undecided for c in result.checks), Decimal(0))
        for check in result.checks:
            if check.share is not None and check.id in pairs:
                rest = decided - check.possible
                pairs[check.id].append(
                    (check.share, float((earned - check.earned) / rest) if rest else math.nan)
                )
                passed[check.id] += check.outcome is Outcome.PASSED
    return tuple(
        CheckStatistics(
            check.id,
            check.title,
            column,
            check.points,
            len(pairs[check.id]),
            passed[check.id],
            statistics.fmean(credit for credit, _ in pairs[check.id]) if pairs[check.id] else None,
            discrimination(pairs[check.id]),
        )
        for column, criterion in enumerate(rubric.criteria)
        for check in criterion.checks
    )


def discrimination(pairs: Sequence[tuple[float, float]]) -> float | Silent:
    """Return the correlation of a check's credit with the share of all other points; see `CheckStatistics`.

    Given are both for each submission; where there are no other checks the share is NaN, and left out.
    """
    known = [pair for pair in pairs if not math.isnan(pair[1])]
    if len(known) < LEAST_FOR_DISCRIMINATION:
        return Silent.TOO_FEW
    credits, rests = zip(*known, strict=True)
    if len(set(credits)) == 1 or len(set(rests)) == 1:
        return Silent.ALL_ALIKE
    return statistics.correlation(credits, rests)


# -- what needs a person -----------------------------------------------------------------------


def _todos(rows: Sequence[Row], rubric: Rubric) -> list[Todo]:
    found = []
    identity = identity_of(rubric)
    for n, row in enumerate(rows):
        if row.result is None:
            found.append(Todo(n, Need.NOT_GRADED, rubric.lab.points, (), (row.entry.problem,)))
            continue
        if violations := row.result.violations:
            kinds = tuple(dict.fromkeys(v.kind.value.replace("_", " ") for v in violations))
            described = (
                v.text if v.certain else f"{v.text} {UNCERTAIN}" for v in violations if v.text
            )
            texts = tuple(dict.fromkeys(described))
            found.append(Todo(n, Need.VIOLATION, row.result.score.possible, kinds, texts))
        if undecided := row.result.open_checks:
            texts = tuple(dict.fromkeys(c.reason for c in undecided if c.reason))
            titles = tuple(c.title for c in undecided)
            found.append(
                Todo(n, Need.UNDECIDED, row.result.still_undecided, titles, texts, undecided[0].id)
            )
        if unmeasured := [check for check in row.result.checks if check.unmeasured]:
            titles, texts = zip(
                *((check.title, check.unmeasured or "") for check in unmeasured), strict=True
            )
            lost = sum((check.lost for check in unmeasured), Decimal(0))
            found.append(Todo(n, Need.UNMEASURED, lost, titles, texts, unmeasured[0].id))
        if row.result.timing is not None and row.result.timing.may_be_late:
            texts = (row.result.timing.text,)
            found.append(Todo(n, Need.LATENESS, Decimal(0), (), texts))
        if row.result.rubric_sha256 != rubric.sha256 or row.result.lab_sha256 not in ("", identity):
            found.append(Todo(n, Need.OTHER_RUBRIC, Decimal(0), (), ()))
    return found
