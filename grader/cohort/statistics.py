"""A class in numbers: points by submission and criterion, their spread, statistics of checks, and open tasks.

Pure: equal entries and rubric give an equal summary, in the order of the entries.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from enum import StrEnum

from grader.cohort.entries import ClassEntry
from grader.cohort.mistakes import Mistake, mistakes_of
from grader.evidence.environment_gap import for_teachers
from grader.lab.kept_lab import identity_of
from grader.lab.rubric import CheckSpec, Rubric
from grader.result import CheckResult, CriterionResult, Outcome, Result, Violation

#: Number of submissions from which a correlation is meaningful.
LEAST_FOR_DISCRIMINATION = 10
BARS = 20
UNCERTAIN = "This may have another cause than the submission."


@dataclass(frozen=True)
class Row:
    """One student."""

    entry: ClassEntry
    #: Results by criterion of the rubric; None for a criterion that was not judged.
    cells: tuple[CriterionResult | None, ...]

    @property
    def result(self) -> Result | None:
        """Result of the submission; None if it was not graded."""
        return self.entry.result


class Need(StrEnum):
    """Reason why a submission needs a person."""

    NOT_GRADED = "not graded"
    VIOLATION = "violation"
    UNDECIDED = "undecided"
    UNMEASURED = "unmeasured"
    LATENESS = "lateness"
    OTHER_RUBRIC = "other rubric"


@dataclass(frozen=True)
class Todo:
    """A task for a person."""

    #: Index of the student in the class, from 0.
    row: int
    need: Need
    #: Points that depend on it.
    points: Decimal
    #: Titles of checks, or kinds of violations.
    titles: tuple[str, ...]
    #: Known facts, each sentence once.
    texts: tuple[str, ...]
    #: Id of the first check concerned; empty if there is none.
    check_id: str = ""


@dataclass(frozen=True)
class Bar:
    """Number of submissions from `low` points to below `high`; the last bar also counts `high` and more."""

    low: Decimal
    high: Decimal
    count: int


@dataclass(frozen=True)
class Spread:
    """Distribution of points over the graded submissions.

    Quartiles equal QUARTILE.INC of spreadsheets. Undecided points are not counted.
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


class Silent(StrEnum):
    """Reason why there is no discrimination."""

    TOO_FEW = "too few"
    ALL_ALIKE = "all alike"


@dataclass(frozen=True)
class CheckStatistics:
    """Statistics of a check over the submissions with a decision on it.

    Notes
    -----
    The discrimination is the corrected item-total correlation: Pearson's correlation between the check's credit and the
    share of points earned in all other decided checks, before adjustments. There is none for fewer than
    `LEAST_FOR_DISCRIMINATION` submissions, or if all have the same credit or the same share.

    References
    ----------
    Henrysson, S. (1963). Correction of item-total correlations in item analysis. Psychometrika 28, 211-218.
    """

    id: str
    title: str
    #: Index of the criterion, from 0.
    column: int
    points: Decimal
    #: Number of submissions with a decision, and with a passed check.
    decided: int
    passed: int
    #: Mean share of its points, from 0 to 1; None if there is no decision.
    mean_credit: float | None
    #: Measure of how well the check separates strong submissions from weak ones: see Notes.
    discrimination: float | Silent


@dataclass(frozen=True)
class Column:
    """A criterion with the mean of its points, after decisions of people and without undecided points."""

    id: str
    title: str
    points: Decimal
    mean: Decimal | None


@dataclass(frozen=True)
class ClassSummary:
    """Summary of a class."""

    lab: str
    #: Rows in the order of the entries.
    rows: tuple[Row, ...]
    columns: tuple[Column, ...]
    #: None if nothing was graded.
    spread: Spread | None
    checks: tuple[CheckStatistics, ...]
    mistakes: tuple[Mistake, ...]
    #: Tasks by kind, in the order of `Need`.
    todos: tuple[Todo, ...]
    #: Size below which correlations are insignificant in a class of this size (two standard errors); None for a class
    #: with fewer than `LEAST_FOR_DISCRIMINATION` results.
    noise: float | None


def summarise(entries: Sequence[ClassEntry], rubric: Rubric) -> ClassSummary:
    """Sum up a class; results of another rubric become tasks."""
    rows = [_row(entry, rubric) for entry in entries]
    results = {}
    for place, row in enumerate(rows):
        if row.result is not None:
            results[place] = row.result
    graded = list(results.values())
    spread = None
    if graded:
        spread = _spread([result.final for result in graded], rubric.lab.points)
    noise = None
    if len(graded) >= LEAST_FOR_DISCRIMINATION:
        noise = 2 / math.sqrt(len(graded))
    return ClassSummary(
        lab=f"Lab {rubric.lab.id}: {rubric.lab.title}",
        rows=tuple(rows),
        columns=tuple(_columns(rows, rubric)),
        spread=spread,
        checks=_check_statistics(graded, rubric),
        mistakes=mistakes_of(results, rubric),
        todos=_todos(rows, rubric),
        noise=noise,
    )


def _row(entry: ClassEntry, rubric: Rubric) -> Row:
    """Return an entry with its results in the order of the rubric."""
    judged: dict[str, CriterionResult] = {}
    if entry.result is not None:
        for result in entry.result.criteria:
            judged[result.id] = result
    cells = [judged.get(criterion.id) for criterion in rubric.criteria]
    return Row(entry, tuple(cells))


def _columns(rows: Sequence[Row], rubric: Rubric) -> Iterator[Column]:
    """Yield the criteria with the means of their points."""
    for place, criterion in enumerate(rubric.criteria):
        earned = []
        for row in rows:
            cell = row.cells[place]
            if row.result is not None and cell is not None:
                earned.append(row.result.final_of(cell))
        mean = statistics.mean(earned) if earned else None
        yield Column(criterion.id, criterion.title, criterion.points, mean)


# -- spread of points --------------------------------------------------------------------------


def _spread(totals: Sequence[Decimal], possible: Decimal) -> Spread:
    """Return the distribution of points; there is at least one total."""
    ordered = sorted(totals)
    # Quartiles need two values.
    values = ordered
    if len(ordered) == 1:
        values = ordered * 2
    first, median, third = statistics.quantiles(values, method="inclusive")
    return Spread(
        count=len(ordered),
        possible=possible,
        mean=statistics.mean(ordered),
        lowest=ordered[0],
        first_quartile=first,
        median=median,
        third_quartile=third,
        highest=ordered[-1],
        bars=_bars(ordered, possible),
    )


def _bars(totals: Sequence[Decimal], possible: Decimal) -> tuple[Bar, ...]:
    """Count totals in bars of equal width; totals beyond the ends are in the outer bars."""
    width = possible / BARS
    counts: Counter[int] = Counter()
    for total in totals:
        place = int(total / width) if width else 0
        place = max(0, min(BARS - 1, place))
        counts[place] += 1
    bars = []
    for place in range(BARS):
        low = width * place
        bars.append(Bar(low, width * (place + 1), counts[place]))
    return tuple(bars)


# -- statistics of checks ----------------------------------------------------------------------


@dataclass
class _Decided:
    """Decisions on a check, one per submission."""

    credits: list[float] = field(default_factory=list)
    #: Shares of points earned in all other decided checks; not a number if there are no other checks.
    rests: list[float] = field(default_factory=list)
    passed: int = 0

    def statistics(self, check: CheckSpec, column: int) -> CheckStatistics:
        """Return the statistics of the check."""
        mean = None
        if self.credits:
            mean = statistics.fmean(self.credits)
        pairs = list(zip(self.credits, self.rests, strict=True))
        return CheckStatistics(
            id=check.id,
            title=check.title,
            column=column,
            points=check.points,
            decided=len(self.credits),
            passed=self.passed,
            mean_credit=mean,
            discrimination=discrimination(pairs),
        )


def _check_statistics(results: Iterable[Result], rubric: Rubric) -> tuple[CheckStatistics, ...]:
    """Return the statistics of each check in the rubric's criteria."""
    decided = {check.id: _Decided() for check in rubric.checks()}
    for result in results:
        _count(result, decided)
    found = []
    for column, criterion in enumerate(rubric.criteria):
        for check in criterion.checks:
            found.append(decided[check.id].statistics(check, column))
    return tuple(found)


def _count(result: Result, decided: dict[str, _Decided]) -> None:
    """Add the decisions of a result to those on each check."""
    earned = Decimal(0)
    possible = Decimal(0)
    for check in result.checks:
        earned += check.earned
        possible += check.possible - check.undecided
    for check in result.checks:
        if check.share is None or check.id not in decided:
            continue
        decisions = decided[check.id]
        decisions.credits.append(check.share)
        decisions.passed += check.outcome is Outcome.PASSED
        rest = math.nan
        others = possible - check.possible
        if others:
            rest = float((earned - check.earned) / others)
        decisions.rests.append(rest)


def discrimination(pairs: Sequence[tuple[float, float]]) -> float | Silent:
    """Return the correlation of a check's credit with the share of all other points; see `CheckStatistics`.

    Parameters
    ----------
    pairs
        Credit and share of each submission. Pairs without a share (NaN) are left out.
    """
    known = [pair for pair in pairs if not math.isnan(pair[1])]
    if len(known) < LEAST_FOR_DISCRIMINATION:
        return Silent.TOO_FEW
    credits, rests = zip(*known, strict=True)
    if len(set(credits)) == 1 or len(set(rests)) == 1:
        return Silent.ALL_ALIKE
    return statistics.correlation(credits, rests)


# -- tasks for a person ------------------------------------------------------------------------


def _todos(rows: Sequence[Row], rubric: Rubric) -> tuple[Todo, ...]:
    """Return the tasks of a class, by kind and then in the order of the rows."""
    lab = identity_of(rubric)
    todos: list[Todo] = []
    for place, row in enumerate(rows):
        if row.result is None:
            points, problem = rubric.lab.points, row.entry.problem
            todos.append(Todo(place, Need.NOT_GRADED, points, (), (problem,)))
        else:
            todos += _todos_of(place, row.result)
            if _of_other_rubric(row.result, rubric, lab):
                todos.append(Todo(place, Need.OTHER_RUBRIC, Decimal(0), (), ()))
    needs = list(Need)
    return tuple(sorted(todos, key=lambda todo: needs.index(todo.need)))


def _of_other_rubric(result: Result, rubric: Rubric, lab: str) -> bool:
    """Return whether a result was judged by another rubric or lab than these; an unknown lab does not count as another."""
    if result.rubric_sha256 != rubric.sha256:
        return True
    return result.lab_sha256 not in ("", lab)


def _todos_of(row: int, result: Result) -> Iterator[Todo]:
    """Yield the tasks that a result leaves to a person."""
    if result.violations:
        yield _violated(row, result.violations, result.score.possible)
    if result.open_checks:
        yield _undecided(row, result.open_checks, result.still_undecided)
    unmeasured = [check for check in result.checks if check.unmeasured]
    if unmeasured:
        yield _unmeasured(row, unmeasured)
    if result.timing is not None and result.timing.may_be_late:
        yield Todo(row, Need.LATENESS, Decimal(0), (), (result.timing.text,))


def _violated(row: int, violations: Sequence[Violation], points: Decimal) -> Todo:
    kinds = []
    texts = []
    for violation in violations:
        kinds.append(violation.kind.value.replace("_", " "))
        if violation.text and violation.certain:
            texts.append(violation.text)
        elif violation.text:
            texts.append(f"{violation.text} {UNCERTAIN}")
    return Todo(row, Need.VIOLATION, points, _once(kinds), _once(texts))


def _undecided(row: int, checks: Sequence[CheckResult], points: Decimal) -> Todo:
    titles = tuple(check.title for check in checks)
    reasons = _once(for_teachers(check.reason) for check in checks if check.reason)
    return Todo(row, Need.UNDECIDED, points, titles, reasons, checks[0].id)


def _unmeasured(row: int, checks: Sequence[CheckResult]) -> Todo:
    titles = []
    reasons = []
    lost = Decimal(0)
    for check in checks:
        titles.append(check.title)
        reasons.append(check.unmeasured or "")
        lost += check.lost
    first = checks[0].id
    return Todo(row, Need.UNMEASURED, lost, tuple(titles), tuple(reasons), first)


def _once(texts: Iterable[str]) -> tuple[str, ...]:
    """Return the different texts in their order."""
    return tuple(dict.fromkeys(texts))
