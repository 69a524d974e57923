"""The instructor's page over a class: one file that needs nothing else, neither a network nor scripts.

With scripts its tables can be sorted and filtered; without them it shows the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timezone

from grader.cohort.changes import Changes, by_check, changes_between
from grader.cohort.similarity import Similarity
from grader.cohort.statistics import CheckStatistics, ClassSummary, Need, Row
from grader.lab.policy import time_text
from grader.report import views
from grader.report.figures.scores import scores_figure
from grader.report.page import render_page
from grader.report.views import Badge

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
    """Return the class page as HTML, which says whether names were replaced; equal arguments give equal bytes.

    What the submissions have in common is shown where it was compared; it names students and quotes them.
    """
    needs = {todo.need: _TASKS[todo.need] for todo in summary.todos}
    rows = range(len(summary.rows))
    compared = {n: changes for n in rows if (changes := _changes(summary.rows[n])) is not None}
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
        tasks=[
            (*words, [todo for todo in summary.todos if todo.need is need])
            for need, words in needs.items()
        ],
        badges=[[needs[todo.need][2] for todo in summary.todos if todo.row == n] for n in rows],
        shared=[
            (n, mistake) for n, mistake in enumerate(summary.mistakes) if len(mistake.made_by) > 1
        ],
        single=[
            (n, mistake) for n, mistake in enumerate(summary.mistakes) if len(mistake.made_by) == 1
        ],
        mistakes=[
            [k for k, m in enumerate(summary.mistakes) if any(one.row == n for one in m.made_by)]
            for n in rows
        ],
        codes=[_codes(row, summary) for row in summary.rows],
        final_share=views.final_share,
        titles={check.id: check.title for check in summary.checks},
        criteria={check.id: summary.columns[check.column].title for check in summary.checks},
        remarks=[_remark(check, summary.noise) for check in summary.checks],
        adjustments_of=views.adjustments_of,
        cell_badge=views.cell_badge,
        beside=any(row.result.beside_criteria for row in summary.rows if row.result),
        zone=zone,
        dated=any(when != ("–", "") for when in times),
        times=times,
        due=_due(summary),
    )


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
    """Return when a submission was handed in, in a zone, and how that is known, with an extension of the due date."""
    entry, timing = row.entry, row.result.timing if row.result is not None else None
    notes = [entry.time_source] if entry.submitted_at is not None else []
    shown = "–"
    if timing is not None and timing.source and entry.submitted_at is None:
        shown, notes = timing.handed_in, [timing.source]
    elif entry.submitted_at is not None:
        shown = entry.submitted_at.strftime("%Y-%m-%d %H:%M")
        if entry.submitted_at.utcoffset() is None:
            notes.append("time zone not known")
        elif zone is not None:
            shown = entry.submitted_at.astimezone(zone).strftime("%Y-%m-%d %H:%M")
    elif entry.newest_file is not None:
        notes.append(f"newest file {time_text(entry.newest_file)}")
    if timing is not None and timing.due_for_all:
        notes.append(f"due {timing.due}, extended")
    return shown, "; ".join(note for note in notes if note)


def _remark(check: CheckStatistics, noise: float | None) -> str:
    """Say where a check itself deserves a look."""
    discrimination = check.discrimination
    if isinstance(discrimination, float) and noise is not None and discrimination < -noise:
        return "Strong submissions fail it more often than weak ones: look at the check."
    if check.decided >= 2 and check.passed == 0:
        return "Nobody passes it: look at the check, or at what was taught."
    return ""
