"""The instructor's page over a class: one file that needs nothing else, neither a network nor scripts.

With scripts its tables can be sorted and filtered; without them it shows the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, timezone
from decimal import Decimal
from typing import Any

from grader.cohort.changes import Changes, by_check, changes_between
from grader.cohort.entries import ClassEntry
from grader.cohort.mistakes import Mistake
from grader.cohort.similarity import Similarity
from grader.cohort.statistics import CheckStatistics, ClassSummary, Need, Row, Todo
from grader.lab.policy import time_text
from grader.languages.language import ENGLISH_ONLY, Languages
from grader.report import views
from grader.report.figures.scores import scores_figure
from grader.report.page import render_page
from grader.report.views import Badge
from grader.result import Timing

_TASKS: Mapping[Need, tuple[str, str, Badge]] = {
    Need.NOT_GRADED: (
        "Not graded",
        "There is no result, so there are no points. Look at why, and grade again.",
        Badge("failed", "✕", "not graded"),
    ),
    Need.VIOLATION: (
        "Interfered with the grader",
        "The recording shows that something interfered with the grader’s nodes, topics or records. "
        "That can have an honest cause: a person judges.",
        Badge("failed", "!", "interfered with the grader"),
    ),
    Need.UNDECIDED: (
        "Undecided",
        "The recording cannot answer. These points are not earned before somebody has decided: "
        "grade again, or decide by hand.",
        Badge("undecided", "?", "undecided"),
    ),
    Need.UNMEASURED: (
        "Numbers that nothing measured",
        "The recording shows no measurement behind numbers that the program prints. That can have an honest cause, "
        "such as an example that was left in: a person judges. The points are lost already.",
        Badge("partial", "#", "numbers not measured"),
    ),
    Need.LATENESS: (
        "Perhaps late",
        "No time of submission is known for certain, and nothing was taken. Give a class list or the grading "
        "worksheet, name the policy’s time zone, or write “submitted:” into overrides.yaml.",
        Badge("undecided", "⏱", "perhaps late"),
    ),
    Need.OTHER_RUBRIC: (
        "Judged by another rubric",
        "These results come from another version of the rubric, or of the files that it names, than the others, and "
        "cannot be compared with them. “grade regrade” judges their recordings again.",
        Badge("not-reached", "≠", "other rubric"),
    ),
}


def render(
    summary: ClassSummary,
    similarity: Similarity | None = None,
    *,
    anonymous: bool = False,
    languages: Languages = ENGLISH_ONLY,
) -> str:
    """Return the class page as HTML; equal arguments give equal bytes.

    `anonymous` adds a note that names were replaced. `similarity` has the similarities of submissions, if they were
    compared; they name and quote students.
    """
    compared = _compared(summary)
    spread = summary.spread
    return render_page(
        "class.html.j2",
        ("report.css", "class.css", "language.css"),
        ("class.js", "language.js"),
        languages,
        summary=summary,
        similarity=similarity,
        compared=_largest_first(compared),
        by_check=by_check(compared.values()),
        stale=_stale(summary, similarity),
        anonymous=anonymous,
        graded=spread.count if spread else 0,
        chart=scores_figure(spread) if spread else None,
        tasks=_tasks(summary),
        shared=_numbered_mistakes(summary, shared=True),
        single=_numbered_mistakes(summary, shared=False),
        final_share=views.final_share,
        adjustments_of=views.adjustments_of,
        cell_badge=views.cell_badge,
        beside=_has_points_beside(summary),
        due=_due(summary),
        **_by_row(summary),
        **_by_check(summary),
        **_times(summary),
    )


def _by_row(summary: ClassSummary) -> dict[str, Any]:
    """Return the template's values about each submission."""
    reports = {}
    badges = []
    mistakes = []
    codes = []
    for number, row in enumerate(summary.rows):
        reports[row.entry.name] = row.entry.report
        badges.append(_badges_of(number, summary))
        mistakes.append(_mistakes_of(number, summary))
        codes.append(_codes(row, summary))
    return {"reports": reports, "badges": badges, "mistakes": mistakes, "codes": codes}


def _by_check(summary: ClassSummary) -> dict[str, Any]:
    """Return the template's values about each check of the rubric."""
    titles = {}
    criteria = {}
    remarks = []
    for check in summary.checks:
        titles[check.id] = check.title
        criteria[check.id] = summary.columns[check.column].title
        remarks.append(_remark(check, summary.noise))
    return {"titles": titles, "criteria": criteria, "remarks": remarks}


def _times(summary: ClassSummary) -> dict[str, Any]:
    """Return the template's values about the times of submission."""
    zone = _zone(summary)
    times = [_when(row, zone) for row in summary.rows]
    dated = any(when != ("–", "") for when in times)
    return {"zone": zone, "times": times, "dated": dated}


def _largest_first(compared: Mapping[int, Changes]) -> list[tuple[int, Changes]]:
    """Return the changes with their rows; the largest differences come first."""

    def rank(item: tuple[int, Changes]) -> tuple[Decimal, int]:
        row, changes = item
        return -abs(changes.difference), row

    return sorted(compared.items(), key=rank)


def _tasks(summary: ClassSummary) -> list[tuple[str, str, Badge, list[Todo]]]:
    """Return title, text and badge of each kind of task for a person, with the submissions."""
    by_need: dict[Need, list[Todo]] = {}
    for todo in summary.todos:
        by_need.setdefault(todo.need, []).append(todo)
    return [(*_TASKS[need], todos) for need, todos in by_need.items()]


def _badges_of(row: int, summary: ClassSummary) -> list[Badge]:
    """Return the badges of the tasks with one submission."""
    return [_TASKS[todo.need][2] for todo in summary.todos if todo.row == row]


def _numbered_mistakes(summary: ClassSummary, *, shared: bool) -> list[tuple[int, Mistake]]:
    """Return the numbered mistakes of several submissions, or else of a single one."""
    found = []
    for n, mistake in enumerate(summary.mistakes):
        count = len(mistake.made_by)
        is_shared = count > 1
        if count and is_shared == shared:
            found.append((n, mistake))
    return found


def _mistakes_of(row: int, summary: ClassSummary) -> list[int]:
    """Return the numbers of the mistakes in one submission."""
    found = []
    for n, mistake in enumerate(summary.mistakes):
        if any(one.row == row for one in mistake.made_by):
            found.append(n)
    return found


def _has_points_beside(summary: ClassSummary) -> bool:
    """Tell whether a submission has points that belong to no criterion."""
    results = [row.result for row in summary.rows if row.result]
    return any(result.beside_criteria for result in results)


def _compared(summary: ClassSummary) -> dict[int, Changes]:
    """Return the changes since the previous submission by row, for rows with a previous one."""
    found = {}
    for n, row in enumerate(summary.rows):
        before = row.entry.before
        now = row.result
        if before is not None and now is not None:
            found[n] = changes_between(before, now)
    return found


def _stale(summary: ClassSummary, similarity: Similarity | None) -> list[str]:
    """Return the names of submissions that are new, or have changed, since submissions were compared."""
    if similarity is None:
        return []
    names = []
    for row in summary.rows:
        if row.result is not None:
            now = row.result.provenance.get("submission_sha256", "")
            if similarity.compared.get(row.entry.name, "") != now:
                names.append(row.entry.name)
    return names


def _codes(row: Row, summary: ClassSummary) -> str:
    """Return a letter for each criterion, then one for each check; `-` if there is none."""
    result = row.result
    if result is None:
        return "-" * (len(row.cells) + len(summary.checks))
    letters = []
    for cell in row.cells:
        letter = "-"
        if cell is not None:
            letter = views.cell_badge(result, cell).letter
        letters.append(letter)
    checks = {check.id: check for check in result.checks}
    for column in summary.checks:
        check = checks.get(column.id)
        letter = "-"
        if check is not None:
            letter = views.badge_of(check.outcome).letter
        letters.append(letter)
    return "".join(letters)


def _zone(summary: ClassSummary) -> timezone | None:
    """Return the zone for all times: their common zone, or else UTC; None if no time has a zone."""
    offsets = set()
    for row in summary.rows:
        time = row.entry.submitted_at
        offset = time.utcoffset() if time is not None else None
        if offset is not None:
            offsets.add(offset)
    if not offsets:
        return None
    if len(offsets) > 1:
        return UTC
    return timezone(offsets.pop())


def _due(summary: ClassSummary) -> str:
    """Return when submissions without an extension were due; empty if the rubric does not say so."""
    for row in summary.rows:
        if row.result is not None and row.result.timing is not None:
            return row.result.timing.due_for_all or row.result.timing.due
    return ""


def _when(row: Row, zone: timezone | None) -> tuple[str, str]:
    """Return the time of a submission in a zone, and notes: the source of the time, and an extension."""
    timing = row.result.timing if row.result is not None else None
    shown, notes = _time_and_source(row.entry, timing, zone)
    if timing is not None and timing.due_for_all:
        notes.append(f"due {timing.due}, extended")
    return shown, "; ".join(filter(None, notes))


def _time_and_source(
    entry: ClassEntry, timing: Timing | None, zone: timezone | None
) -> tuple[str, list[str]]:
    """Return the time of a submission in a zone, a dash if none is known, and notes on its source."""
    marks = []
    if entry.marked_late_by:
        marks.append(f"marked late by {entry.marked_late_by}")
    time = entry.submitted_at
    if time is not None:
        notes = [entry.time_source, *marks]
        if time.utcoffset() is None:
            notes.append("time zone not known")
        elif zone is not None:
            time = time.astimezone(zone)
        return time.strftime("%Y-%m-%d %H:%M"), notes
    if timing is not None and timing.source:
        return timing.submission_time, [timing.source, *marks]
    notes = marks
    if entry.newest_file is not None:
        notes.append(f"newest file {time_text(entry.newest_file)}")
    if entry.last_commit is not None:
        notes.append(f"last commit {time_text(entry.last_commit)}")
    return "–", notes


def _remark(check: CheckStatistics, noise: float | None) -> str:
    """Write a remark if the outcomes suggest a mistake in the check itself; empty if not."""
    discrimination = check.discrimination
    is_backwards = False
    if isinstance(discrimination, float) and noise is not None:
        is_backwards = discrimination < -noise
    if is_backwards:
        return "Strong submissions fail it more often than weak ones: look at the check."
    if check.decided >= 2 and check.passed == 0:
        return "Nobody passes it: look at the check, or at what was taught."
    return ""
