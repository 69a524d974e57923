"""The HTML report of one submission, as one self-contained page: readable without a network, and without scripts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from grader.cohort.changes import changes_between
from grader.evidence.recorded import Recorded
from grader.languages.language import ENGLISH_ONLY, Languages
from grader.recording.session import SessionRecord
from grader.recording.submission import SubmissionRecord
from grader.report import views
from grader.report.figures.posture import Motion
from grader.report.figures.svg import Figure, FiguresOf
from grader.report.page import render_page
from grader.report.timeline import timeline_of
from grader.report.whole_files import whole_files_of
from grader.result import Outcome, Result


def render(
    result: Result,
    figures: FiguresOf,
    recordings: Mapping[str, Recorded],
    submission: SubmissionRecord,
    before: Result | None = None,
    questions_to: str | None = None,
    languages: Languages = ENGLISH_ONLY,
) -> str:
    """Return the report as a page of HTML; equal arguments give equal bytes.

    Parameters
    ----------
    figures
        Figures by the criterion's id.
    before
        Result of the previous submission.
    questions_to
        Mail address for questions.
    languages
        Languages of the page.
    """
    sessions = {}
    timelines = {}
    for name, recorded in recordings.items():
        sessions[name] = recorded.record
        timelines[name] = timeline_of(recorded, result)
    started_ns = [record.started_ns for record in sessions.values()]
    recorded_at = views.utc(min(started_ns, default=0))
    losses = views.losses_of(result)
    placed = _Placed.of(figures, losses)
    players = [(figure, views.moments_of(result, figure)) for figure in placed.players]
    most = views.points(result.final + result.still_undecided)
    return render_page(
        "report.html.j2",
        ("report.css", "player.css", "timeline.css", "language.css"),
        ("parts.js", "report.js", "copy.js", "find.js", "player.js", "timeline.js", "language.js"),
        languages,
        result=result,
        score=views.final_share(result),
        most=most,
        judged=views.points(result.score.earned),
        adjustments=views.adjustments_of(result),
        said=views.said_of(result),
        recorded=recorded_at,
        lost=losses,
        titles=views.titles_by_id(result),
        same_fix=views.same_fixes(result),
        beside=placed.beside,
        players=players,
        figures=placed.others,
        sessions=sessions,
        timelines=timelines,
        isolations=views.isolations_of(sessions),
        versions=views.versions_of(result),
        submission=submission,
        questions_to=questions_to,
        views=views,
        **_compared(before, result),
        **_open_checks(result),
        **_places(result, sessions, submission),
    )


def _compared(before: Result | None, result: Result) -> dict[str, Any]:
    """Return the template's values about the previous results."""
    if before is None:
        return {"changes": None, "other_rubric": False, "submissions": []}
    other_rubric = before.rubric_sha256 != result.rubric_sha256
    return {
        "changes": changes_between(before, result),
        "other_rubric": other_rubric,
        "submissions": _submissions(result),
    }


def _submissions(result: Result) -> list[tuple[str, views.Share]]:
    """Return time and points of the previous submissions, oldest first; none for a single one.

    The changes tell a single one already.
    """
    previous = result.provenance.get("previous", [])
    if len(previous) < 2:
        return []
    found = []
    for past in previous:
        earned = Decimal(str(past["earned"]))
        possible = Decimal(str(past["possible"]))
        undecided = Decimal(str(past["undecided"]))
        share = views.share_of(earned, possible, undecided)
        found.append((views.utc(past["recorded_ns"]), share))
    return found


def _open_checks(result: Result) -> dict[str, Any]:
    """Return the template's values about checks without a decision."""
    unreached = []
    undecided = []
    for check in result.checks:
        if check.outcome is Outcome.NOT_REACHED and check.lost > 0:
            unreached.append(check)
        if not check.outcome.decided:
            undecided.append(check)
    return {"unreached": unreached, "undecided": undecided}


def _places(
    result: Result, sessions: Mapping[str, SessionRecord], submission: SubmissionRecord
) -> dict[str, Any]:
    """Return the template's values with locations in files and logs."""
    anchors = views.anchors_of(sessions)
    whole = whole_files_of(result, submission.texts)
    locations = {}
    for check in result.every_check:
        locations[check.id] = views.locations_of(check, submission.texts, anchors, whole)
    violations = []
    for violation in result.violations:
        location = views.location_of(violation.where, {}, anchors)
        violations.append((violation, location, views.titles_of(violation, result)))
    return {"locations": locations, "violations": violations, "whole_files": whole.values()}


@dataclass(frozen=True)
class _Placed:
    """The figures of a page by their places."""

    #: Figures to be played.
    players: Sequence[Figure]
    #: Figures beside lost points.
    beside: FiguresOf
    #: Further figures by the criterion's id.
    others: FiguresOf

    @classmethod
    def of(cls, figures: FiguresOf, losses: Sequence[views.Loss]) -> _Placed:
        """Place each figure once."""
        players = []
        still = []
        for drawn in figures.values():
            for figure in drawn:
                if isinstance(figure.content, Motion):
                    players.append(figure)
                else:
                    still.append(figure)
        beside = views.figures_by_loss(losses, still)
        placed = {id(figure) for figure in players}
        for drawn in beside.values():
            placed.update(id(figure) for figure in drawn)
        others = {}
        for criterion, drawn in figures.items():
            others[criterion] = [figure for figure in drawn if id(figure) not in placed]
        return cls(players, beside, others)
