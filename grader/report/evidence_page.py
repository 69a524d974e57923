"""The page with all evidence about one check, one criterion, or a whole submission, for a deciding person.

The page works without scripts, and is shown where none may run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from grader.evidence.recorded import Recorded
from grader.recording.submission import SubmissionRecord
from grader.report import views
from grader.report.figures.posture import Motion
from grader.report.figures.svg import Figure, FiguresOf
from grader.report.page import render_page
from grader.report.timeline import timeline_of
from grader.result import WHOLE, CheckResult, Location, Result, Violation

#: Characters of a file that is shown whole.
_MOST_CHARACTERS = 20_000


def render(
    result: Result,
    what: str,
    figures: FiguresOf,
    recordings: Mapping[str, Recorded],
    submission: SubmissionRecord,
) -> str:
    """Return the page about a check's or criterion's id, or about the whole (`score`).

    Equal arguments give equal bytes. The page has the figures of its checks, or else those of their sessions.
    """
    records = {name: recorded.record for name, recorded in recordings.items()}
    anchors = views.anchors_of(records)
    checks = list(_checks(result, what))
    violations = list(_violations(result, what, checks))
    named = {check.session for check in checks}
    named.update(violation.session for violation in violations)
    sessions = {}
    timelines = {}
    for name, recorded in recordings.items():
        if name in named:
            sessions[name] = recorded.record
            timelines[name] = timeline_of(recorded, result)
    places: list[Location] = []
    locations = {}
    for check in checks:
        places += check.where
        locations[check.id] = views.locations_of(check, submission.texts, anchors)
    return render_page(
        "evidence.html.j2",
        ("report.css", "timeline.css", "evidence.css"),
        (),
        result=result,
        what=what,
        checks=checks,
        said=views.said_of(result),
        violations=violations,
        figures=_shown(figures, checks, named),
        sessions=sessions,
        timelines=timelines,
        files=_files(places, submission.texts),
        locations=locations,
        beside={},
        questions_to=None,
        views=views,
    )


def _checks(result: Result, what: str) -> Iterator[CheckResult]:
    """Yield the check with an id, or the checks of the criterion with it."""
    for criterion in result.criteria:
        for check in criterion.checks:
            if what in (check.id, criterion.id):
                yield check


def _violations(result: Result, what: str, checks: Iterable[CheckResult]) -> Iterator[Violation]:
    """Yield the violations that concern some checks; all of them for the whole."""
    ids = {check.id for check in checks}
    for violation in result.violations:
        if what == WHOLE or ids.intersection(violation.checks):
            yield violation


def _shown(
    figures: FiguresOf,
    checks: Iterable[CheckResult],
    sessions: set[str | None],
) -> list[Figure]:
    """Return the figures that show one of some checks, or else those of some sessions."""
    ids = {check.id for check in checks}
    of_checks = []
    of_sessions = []
    for figure in _still(figures):
        if ids.intersection(figure.shows):
            of_checks.append(figure)
        if figure.session in sessions:
            of_sessions.append(figure)
    return of_checks or of_sessions


def _still(figures: FiguresOf) -> Iterator[Figure]:
    """Yield the figures without players, which need the scripts of the report."""
    for drawn in figures.values():
        for figure in drawn:
            if not isinstance(figure.content, Motion):
                yield figure


def _files(places: Iterable[Location], texts: Mapping[str, str]) -> dict[str, str]:
    """Return the texts of the files in some locations."""
    files = {}
    for place in places:
        if place.file is not None and place.file in texts:
            files[place.file] = texts[place.file][:_MOST_CHARACTERS]
    return files
