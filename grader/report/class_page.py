"""The instructor's page over a class: one file that needs nothing else, neither a network nor scripts.

With scripts its tables can be sorted and filtered; without them it shows the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timezone

from grader.cohort.changes import Changes, by_check, changes_between
from grader.cohort.entries import ClassEntry
from grader.cohort.mistakes import Mistake
from grader.cohort.similarity import Similarity
from grader.cohort.statistics import CheckStatistics, ClassSummary, Need, Row, Todo
from grader.lab.policy import time_text
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
    summary: ClassSummary, similarity: Similarity | None = None, *, anonymous: bool = False
) -> str:
    """Return the class page as HTML; equal arguments give equal bytes.

    `anonymous` adds a note that names were replaced. Similarities of submissions are shown if they were compared; they
    name students and quote them.
    """
    rows = range(len(summary.rows))
    compared = _compared(summary)
    zone = _zone(summary)
    times = [_when(row, zone) for row in summary.rows]
    return render_page(
        "class.html.j2",
        ("report.css", "class.css"),
        ("class.js",),
        summary=summary,
        similarity=similarity,
        reports={row.entry.name: row.entry.report for row in summary.rows},
        compared=sorted(compared.items(), key=lambda item: (-abs(item[1].difference), item[0])),
        by_check=by_check(compared.values()),
        stale=_stale(summary, similarity),
        anonymous=anonymous,
        graded=summary.spread.count if summary.spread else 0,
        chart=scores_figure(summary.spread) if summary.spread else None,
        tasks=_tasks(summary),
        badges=[_badges_of(n, summary) for n in rows],
        shared=_numbered_mistakes(summary, shared=True),
        single=_numbered_mistakes(summary, shared=False),
        mistakes=[_mistakes_of(n, summary) for n in rows],
        codes=[_codes(row, summary) for row in summary.rows],
        final_share=views.final_share,
        titles={check.id: check.title for check in summary.checks},
        criteria={check.id: summary.columns[check.column].title for check in summary.checks},
        remarks=[_remark(check, summary.noise) for check in summary.checks],
        adjustments_of=views.adjustments_of,
        cell_badge=views.cell_badge,
        beside=_has_points_beside(summary),
        zone=zone,
        dated=any(when != ("–", "") for when in times),
        times=times,
        due=_due(summary),
    )


def _tasks(summary: ClassSummary) -> list[tuple[str, str, Badge, list[Todo]]]:
    """Return title, text and badge of each kind of task that a person has, with its submissions."""
    by_need: dict[Need, list[Todo]] = {}
    for todo in summary.todos:
        by_need.setdefault(todo.need, []).append(todo)
    return [(*_TASKS[need], todos) for need, todos in by_need.items()]


def _badges_of(row: int, summary: ClassSummary) -> list[Badge]:
    """Return the badges of the tasks with one submission."""
    return [_TASKS[todo.need][2] for todo in summary.todos if todo.row == row]


def _numbered_mistakes(summary: ClassSummary, *, shared: bool) -> list[tuple[int, Mistake]]:
    """Return the mistakes of several submissions, or else those of a single one, with their numbers."""
    found = []
    for n, mistake in enumerate(summary.mistakes):
        count = len(mistake.made_by)
        if (count > 1) if shared else (count == 1):
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
    """Tell whether a submission has points beside those of the criteria."""
    return any(row.result.beside_criteria for row in summary.rows if row.result)


def _compared(summary: ClassSummary) -> dict[int, Changes]:
    """Return the changes since the previous submission, by row, for the rows that have one."""
    found = {}
    for n, row in enumerate(summary.rows):
        changes = _changes(row)
        if changes is not None:
            found[n] = changes
    return found


def _changes(row: Row) -> Changes | None:
    before, now = row.entry.before, row.result
    return changes_between(before, now) if before is not None and now is not None else None


def _stale(summary: ClassSummary, similarity: Similarity | None) -> list[str]:
    """Return whose submissions were compared and have changed, or come, since then."""
    results = ((row.entry.name, row.result) for row in summary.rows if similarity is not None)
    now = {
        name: result.provenance.get("submission_sha256", "")
        for name, result in results
        if result is not None
    }
    return [
        name
        for name, sha256 in now.items()
        if similarity and similarity.compared.get(name, "") != sha256
    ]


def _codes(row: Row, summary: ClassSummary) -> str:
    """Return a letter for each criterion, then for each check."""
    checks = {check.id: check for check in row.result.checks} if row.result else {}
    badges = [
        views.cell_badge(row.result, cell) if row.result and cell else None for cell in row.cells
    ]
    badges += [
        views.badge_of(checks[check.id].outcome) if check.id in checks else None
        for check in summary.checks
    ]
    return "".join(badge.letter if badge else "-" for badge in badges)


def _zone(summary: ClassSummary) -> timezone | None:
    """Return the zone that times are shown in: the one that all were given in, or else UTC; None without such times."""
    times = [row.entry.submitted_at for row in summary.rows if row.entry.submitted_at is not None]
    offsets = {offset for time in times if (offset := time.utcoffset()) is not None}
    if not offsets:
        return None
    return timezone(offsets.pop()) if len(offsets) == 1 else timezone.utc


def _due(summary: ClassSummary) -> str:
    """Return when the class's submissions were due without extensions; empty if the rubric does not say so."""
    for row in summary.rows:
        if row.result is not None and row.result.timing is not None:
            return row.result.timing.due_for_all or row.result.timing.due
    return ""


def _when(row: Row, zone: timezone | None) -> tuple[str, str]:
    """Return the time of a submission in a zone, and the source of the time with an extension of the due date."""
    timing = row.result.timing if row.result is not None else None
    shown, notes = _time_and_source(row.entry, timing, zone)
    if timing is not None and timing.due_for_all:
        notes.append(f"due {timing.due}, extended")
    return shown, "; ".join(note for note in notes if note)


def _time_and_source(
    entry: ClassEntry, timing: Timing | None, zone: timezone | None
) -> tuple[str, list[str]]:
    """Return the time of a submission in a zone, a dash without one, and notes on its source."""
    time = entry.submitted_at
    if time is not None:
        notes = [entry.time_source]
        if time.utcoffset() is None:
            notes.append("time zone not known")
        elif zone is not None:
            time = time.astimezone(zone)
        return time.strftime("%Y-%m-%d %H:%M"), notes
    if timing is not None and timing.source:
        return timing.submission_time, [timing.source]
    if entry.newest_file is not None:
        return "–", [f"newest file {time_text(entry.newest_file)}"]
    return "–", []


def _remark(check: CheckStatistics, noise: float | None) -> str:
    """Say where a check itself deserves a look."""
    discrimination = check.discrimination
    if isinstance(discrimination, float) and noise is not None and discrimination < -noise:
        return "Strong submissions fail it more often than weak ones: look at the check."
    if check.decided >= 2 and check.passed == 0:
        return "Nobody passes it: look at the check, or at what was taught."
    return ""
