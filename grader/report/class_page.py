"""The instructor's page over a class: one file that needs nothing else, neither a network nor scripts.

With scripts its tables can be sorted and filtered; without them it shows the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta, timezone
from decimal import Decimal

from grader.cohort.mistakes import Mistake
from grader.cohort.summary import CheckStatistics, ClassSummary, Column, Need, Row, Silent, Todo
from grader.report import charts, views
from grader.report.page import render_page
from grader.report.untrusted import line
from grader.report.views import Badge, Share, tenths
from grader.result import Adjustment, Outcome

#: Letters by which the page's script knows outcomes.
CODES: Mapping[Outcome, str] = {
    Outcome.PASSED: "p",
    Outcome.PARTIAL: "a",
    Outcome.FAILED: "f",
    Outcome.NOT_REACHED: "n",
    Outcome.INCONCLUSIVE: "u",
    Outcome.ERROR: "u",
}
NOT_JUDGED = "-"
MOST_TITLES = 6


def render(summary: ClassSummary, *, anonymous: bool = False) -> str:
    """Return the class page as HTML; equal arguments give equal bytes.

    Parameters
    ----------
    anonymous : bool
        Whether names were replaced by pseudonyms, which the page then says.
    """
    spread = summary.spread
    zone = _zone(summary)
    return render_page(
        "class.html.j2",
        ("report.css", "class.css"),
        "class.js",
        lab=summary.lab,
        anonymous=anonymous,
        handed_in=len(summary.rows),
        graded=spread.count if spread else 0,
        spread=_spread_view(summary),
        chart=charts.scores_chart(spread, "scores") if spread else None,
        columns=[_column_view(column) for column in summary.columns],
        tasks=_tasks(summary),
        rows=_rows(summary, zone),
        adjusted=_adjusted(summary),
        dated=any(row.entry.submitted_at for row in summary.rows),
        zone=zone.tzname(None) if zone is not None else "",
        choices=_choices(summary),
        shared=[_mistake_view(n, m, summary) for n, m in enumerate(summary.mistakes) if len(m.made_by) > 1],
        single=[_mistake_view(n, m, summary) for n, m in enumerate(summary.mistakes) if len(m.made_by) == 1],
        checks=[_check_row(check, summary) for check in summary.checks],
        chance=f"{summary.chance:.2f}" if summary.chance is not None else "",
    )


# -- points ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SpreadView:
    """Mean, median and quartiles in words."""

    possible: str
    mean: str
    median: str
    first_quartile: str
    third_quartile: str
    lowest: str
    highest: str
    open: int


def _spread_view(summary: ClassSummary) -> SpreadView | None:
    s = summary.spread
    if s is None:
        return None
    return SpreadView(
        tenths(s.possible),
        tenths(s.mean),
        tenths(s.median),
        tenths(s.first_quartile),
        tenths(s.third_quartile),
        tenths(s.lowest),
        tenths(s.highest),
        sum(bool(row.undecided) for row in summary.rows),
    )


@dataclass(frozen=True)
class ColumnView:
    """A criterion with the mean of the class."""

    title: str
    points: str
    mean: str
    share: Share | None


def _column_view(column: Column) -> ColumnView:
    mean = column.mean
    share = views.share_of(mean, column.points, Decimal(0)) if mean is not None else None
    return ColumnView(column.title, views.points(column.points), tenths(mean) if mean is not None else "–", share)


# -- what needs a person -----------------------------------------------------------------------


@dataclass(frozen=True)
class TaskView:
    """One thing to do."""

    name: str
    href: str
    points: str
    what: str
    why: str


@dataclass(frozen=True)
class Tasks:
    """Things to do of one kind."""

    title: str
    advice: str
    badge: Badge
    tasks: tuple[TaskView, ...]


_TASKS: Mapping[Need, tuple[str, str, Badge]] = {
    Need.NOT_GRADED: (
        "Not graded",
        "There is no result, so there are no points. Look at why, and grade again.",
        Badge("failed", "✕", "not graded"),
    ),
    Need.VIOLATION: (
        "Touched the grader’s own",
        "The recording shows that something of the grader’s own was touched, such as its nodes, topics or records. "
        "That can have an honest cause: a person judges.",
        Badge("failed", "!", "touched the grader’s own"),
    ),
    Need.UNDECIDED: (
        "Undecided",
        "The recording cannot answer. These points are not earned before somebody has decided: "
        "grade again, or decide by hand.",
        Badge("undecided", "?", "undecided"),
    ),
    Need.OTHER_RUBRIC: (
        "Judged by another rubric",
        "These results come from another version of the rubric than the others, and cannot be compared with them. "
        "“grade regrade” judges their recordings again.",
        Badge("not-reached", "≠", "other rubric"),
    ),
}


def _tasks(summary: ClassSummary) -> list[Tasks]:
    groups: dict[Need, list[Todo]] = {}
    for todo in summary.todos:
        groups.setdefault(todo.need, []).append(todo)
    return [Tasks(*_TASKS[need], tuple(_task_view(todo, summary) for todo in todos)) for need, todos in groups.items()]


def _task_view(todo: Todo, summary: ClassSummary) -> TaskView:
    entry = summary.rows[todo.row].entry
    target = "touched" if todo.need is Need.VIOLATION else todo.check_id and views.anchor("check", todo.check_id)
    fragment = f"#{target}" if entry.report and target else ""
    shown = ", ".join(todo.titles[:MOST_TITLES])
    more = len(todo.titles) - MOST_TITLES
    return TaskView(
        line(entry.name, 120),
        entry.report + fragment,
        views.points(todo.points) if todo.need is Need.UNDECIDED else "",
        shown + (f" and {more} more" if more > 0 else ""),
        line(" ".join(todo.texts), 400),
    )


# -- the table ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class CellView:
    """A student's points in a criterion; `value` is what the column is sorted by."""

    value: str
    share: Share


@dataclass(frozen=True)
class RowView:
    """A student.

    Attributes
    ----------
    codes : str
        A letter for each criterion, then for each check: see `CODES`.
    mistakes : str
        Numbers of the mistakes that were made, with blanks between.
    flags : tuple of Badge
        What needs a person.
    adjusted : str
        What adjustments add or take; empty where there is none.
    """

    number: int
    name: str
    href: str
    problem: str
    total: str
    share: Share | None
    cells: tuple[CellView | None, ...]
    codes: str
    mistakes: str
    flags: tuple[Badge, ...]
    adjusted: str
    submitted: str


def _zone(summary: ClassSummary) -> timezone | None:
    """Return the zone that times are shown in: the one that all were given in, or else UTC; None without times."""
    times = [row.entry.submitted_at for row in summary.rows if row.entry.submitted_at is not None]
    offsets = {time.utcoffset() or timedelta() for time in times}
    return (timezone(offsets.pop()) if len(offsets) == 1 else timezone.utc) if offsets else None


def _rows(summary: ClassSummary, zone: timezone | None) -> list[RowView]:
    flags: dict[int, list[Badge]] = {}
    for todo in summary.todos:
        flags.setdefault(todo.row, []).append(_TASKS[todo.need][2])
    made: dict[int, list[str]] = {}
    for number, mistake in enumerate(summary.mistakes):
        for one in mistake.made_by:
            made.setdefault(one.row, []).append(str(number))
    ids = [check.id for check in summary.checks]
    return [
        _row_view(n, row, ids, flags.get(n, ()), " ".join(made.get(n, ())), zone) for n, row in enumerate(summary.rows)
    ]


def _row_view(
    number: int, row: Row, ids: Sequence[str], flags: Sequence[Badge], mistakes: str, zone: timezone | None
) -> RowView:
    outcomes = [cell.outcome if cell else None for cell in row.cells] + [row.outcomes.get(name) for name in ids]
    submitted = row.entry.submitted_at
    graded = row.result is not None
    return RowView(
        number,
        line(row.entry.name, 120),
        row.entry.report,
        line(row.problem, 300),
        views.points(row.total) if graded else "",
        _whole(row) if graded else None,
        tuple(
            CellView(str(cell.earned), views.share_of(cell.earned, cell.possible, cell.undecided)) if cell else None
            for cell in row.cells
        ),
        "".join(CODES[outcome] if outcome else NOT_JUDGED for outcome in outcomes),
        mistakes,
        tuple(flags),
        views.signed(row.total - row.result.score.earned) if row.result and row.adjustments else "",
        submitted.astimezone(zone).strftime("%Y-%m-%d %H:%M") if submitted else "",
    )


def _whole(row: Row) -> Share:
    """Describe the points with all adjustments, which may make them more than are possible."""
    total = max(Decimal(0), min(row.total, row.possible))
    return views.share_of(total, row.possible, min(row.undecided, row.possible - total))


@dataclass(frozen=True)
class Adjusted:
    """A student's adjustments in words."""

    number: int
    name: str
    total: str
    texts: tuple[str, ...]


def _adjusted(summary: ClassSummary) -> list[Adjusted]:
    titles = {check.id: check.title for check in summary.checks} | {c.id: c.title for c in summary.columns}
    return [
        Adjusted(
            n,
            line(row.entry.name, 120),
            views.signed(row.total - row.result.score.earned),
            tuple(_adjustment_text(a, titles) for a in row.adjustments),
        )
        for n, row in enumerate(summary.rows)
        if row.result and row.adjustments
    ]


def _adjustment_text(adjustment: Adjustment, titles: Mapping[str, str]) -> str:
    title = views.adjustment_title(adjustment, titles.get(adjustment.what, "")).rstrip(": ")
    by = ", ".join(part for part in (adjustment.who, adjustment.when) if part)
    head = f"{views.signed(adjustment.points)} {title}".rstrip()
    return line(head + (f": {adjustment.reason}" if adjustment.reason else "") + (f" ({by})" if by else ""), 400)


@dataclass(frozen=True)
class Choice:
    """A criterion that the table can be filtered by, with its checks; numbers are places in `RowView.codes`."""

    place: int
    title: str
    checks: tuple[tuple[int, str], ...]


def _choices(summary: ClassSummary) -> list[Choice]:
    first = len(summary.columns)
    return [
        Choice(
            n,
            column.title,
            tuple((first + k, c.title) for k, c in enumerate(summary.checks) if c.column == n),
        )
        for n, column in enumerate(summary.columns)
    ]


# -- the same mistakes -------------------------------------------------------------------------


@dataclass(frozen=True)
class MadeView:
    """A student who made a mistake, and what it cost."""

    name: str
    href: str
    cost: str


@dataclass(frozen=True)
class MistakeView:
    """A mistake with those who made it."""

    number: int
    cost: str
    following: str
    title: str
    criterion: str
    pattern: str
    hint: str
    made_by: tuple[MadeView, ...]


def _mistake_view(number: int, mistake: Mistake, summary: ClassSummary) -> MistakeView:
    check = next((c for c in summary.checks if c.id == mistake.check_id), None)
    made = []
    for one in mistake.made_by:
        entry = summary.rows[one.row].entry
        href = f"{entry.report}#{views.anchor('check', mistake.check_id)}" if entry.report else ""
        made.append(MadeView(line(entry.name, 120), href, views.points(one.lost + one.following)))
    return MistakeView(
        number,
        views.points(mistake.cost),
        views.points(mistake.following) if mistake.following else "",
        check.title if check else mistake.check_id,
        summary.columns[check.column].title if check else "",
        line(mistake.pattern, 400),
        line(mistake.hint, 400),
        tuple(made),
    )


# -- checks ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CheckRow:
    """What a check tells, in words; `*_value` is what its column is sorted by."""

    title: str
    criterion: str
    points: str
    decided: int
    passed: int
    passed_value: str
    share: Share | None
    credit: str
    credit_value: str
    discrimination: str
    discrimination_value: str
    remark: str


_SILENT = {Silent.TOO_FEW: "too few", Silent.ALL_ALIKE: "all alike"}


def _check_row(check: CheckStatistics, summary: ClassSummary) -> CheckRow:
    share = Decimal(check.passed) / check.decided if check.decided else None
    told = check.discrimination
    number = None if isinstance(told, Silent) else told
    return CheckRow(
        check.title,
        summary.columns[check.column].title,
        views.points(check.points),
        check.decided,
        check.passed,
        f"{share:.4f}" if share is not None else "",
        views.share_of(Decimal(check.passed), Decimal(check.decided), Decimal(0)) if check.decided else None,
        f"{100 * check.mean_credit:.0f} %" if check.mean_credit is not None else "–",
        f"{check.mean_credit:.4f}" if check.mean_credit is not None else "",
        f"{number:.2f}".replace("-", "−") if number is not None else _SILENT[Silent(told)],
        f"{number:.4f}" if number is not None else "",
        _remark(check, number, summary),
    )


def _remark(check: CheckStatistics, number: float | None, summary: ClassSummary) -> str:
    """Say where a check itself deserves a look."""
    if number is not None and summary.chance is not None and number < -summary.chance:
        return "Strong submissions fail it more often than weak ones: look at the check."
    if check.decided >= 2 and check.passed == 0:
        return "Nobody passes it: look at the check, or at what was taught."
    return ""
