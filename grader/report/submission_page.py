"""The HTML report of one submission: one page that needs nothing else, neither a network nor scripts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from grader.cohort.changes import changes_between
from grader.evidence.recorded import Recorded
from grader.recording.submission import SubmissionRecord
from grader.report import views
from grader.report.figures.posture import Motion
from grader.report.figures.svg import Figure
from grader.report.page import render_page
from grader.report.timeline import timeline_of
from grader.result import Outcome, Result


def render(
    result: Result,
    figures: Mapping[str, Sequence[Figure]],
    recordings: Mapping[str, Recorded],
    submission: SubmissionRecord,
    before: Result | None = None,
) -> str:
    """Return the report as a page of HTML, with figures by the criterion's id; equal arguments give equal bytes.

    `before` is the result of what the student handed in before.
    """
    sessions = {name: recorded.record for name, recorded in recordings.items()}
    anchors = views.anchors_of(sessions)
    losses = views.losses_of(result)
    every = [figure for drawn in figures.values() for figure in drawn]
    players = [figure for figure in every if isinstance(figure.content, Motion)]
    beside = views.figures_by_loss(losses, [figure for figure in every if figure not in players])
    placed = [id(figure) for drawn in (players, *beside.values()) for figure in drawn]
    return render_page(
        "report.html.j2",
        ("report.css", "player.css", "timeline.css"),
        ("report.js", "player.js", "timeline.js"),
        result=result,
        changes=changes_between(before, result) if before is not None else None,
        other_rubric=before is not None and before.rubric_sha256 != result.rubric_sha256,
        score=views.final_share(result),
        most=views.points(result.final + result.still_undecided),
        judged=views.points(result.score.earned),
        adjustments=views.adjustments_of(result),
        said=views.said_of(result),
        recorded=views.utc(min((record.started_ns for record in sessions.values()), default=0)),
        lost=losses,
        unreached=[c for c in result.checks if c.outcome is Outcome.NOT_REACHED and c.lost > 0],
        undecided=[c for c in result.checks if not c.outcome.decided],
        beside=beside,
        players=[(figure, views.moments_of(result, figure)) for figure in players],
        figures={
            of: [figure for figure in drawn if id(figure) not in placed]
            for of, drawn in figures.items()
        },
        sessions=sessions,
        timelines={name: timeline_of(recorded, result) for name, recorded in recordings.items()},
        isolations=views.isolations_of(sessions),
        versions=views.versions_of(result),
        submission=submission,
        views=views,
        locations={
            c.id: views.locations_of(c, submission.texts, anchors) for c in result.every_check
        },
        violations=[
            (v, views.location_of(v.where, {}, anchors), views.titles_of(v, result))
            for v in result.violations
        ],
    )
