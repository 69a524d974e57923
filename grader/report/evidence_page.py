"""The page of all evidence about one check, one criterion, or the whole of a submission: for the person who decides.

It needs no script, and is shown where none may run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from grader.evidence.recorded import Recorded
from grader.recording.submission import SubmissionRecord
from grader.report import views
from grader.report.figures.posture import Motion
from grader.report.figures.svg import Figure
from grader.report.page import render_page
from grader.report.timeline import timeline_of
from grader.result import WHOLE, Location, Result

#: Of a file that is shown whole.
_MOST_CHARACTERS = 20_000


def render(
    result: Result,
    what: str,
    figures: Mapping[str, Sequence[Figure]],
    recordings: Mapping[str, Recorded],
    submission: SubmissionRecord,
) -> str:
    """Return the page about a check's or a criterion's id, or `score` for the whole; equal arguments give equal bytes.

    The figures are those that show one of the checks, or else those of their sessions.
    """
    anchors = views.anchors_of({name: recorded.record for name, recorded in recordings.items()})
    checks = [c for part in result.criteria for c in part.checks if what in (c.id, part.id)]
    violations = [
        v
        for v in result.violations
        if what == WHOLE or {c.id for c in checks}.intersection(v.checks)
    ]
    named = {check.session for check in checks} | {violation.session for violation in violations}
    # A robot that moves needs a script; the report has it.
    drawn = [
        figure for of in figures.values() for figure in of if not isinstance(figure.content, Motion)
    ]
    shown = [f for f in drawn if {c.id for c in checks}.intersection(f.shows)]
    places = [place for check in checks for place in check.where]
    return render_page(
        "evidence.html.j2",
        ("report.css", "timeline.css", "evidence.css"),
        (),
        result=result,
        what=what,
        checks=checks,
        said=views.said_of(result),
        violations=violations,
        figures=shown or [figure for figure in drawn if figure.session in named],
        sessions={name: recorded.record for name, recorded in recordings.items() if name in named},
        timelines={
            name: timeline_of(recorded, result)
            for name, recorded in recordings.items()
            if name in named
        },
        files=_files(places, submission.texts),
        locations={
            check.id: views.locations_of(check, submission.texts, anchors) for check in checks
        },
        beside={},
        views=views,
    )


def _files(places: Sequence[Location], texts: Mapping[str, str]) -> dict[str, str]:
    """Return the files that are named as a whole, or in which a line is, with their texts."""
    names = dict.fromkeys(place.file for place in places if place.file in texts)
    return {name: texts[name][:_MOST_CHARACTERS] for name in names if name is not None}
