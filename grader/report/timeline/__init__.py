"""The timeline of a session: everything that happened in it, by its recording. The template draws it; nothing is judged."""

from __future__ import annotations

from collections.abc import Iterator

from grader.evidence.recorded import Recorded
from grader.report.timeline.moments import (
    MOST_LANES,
    Lane,
    Moment,
    Timeline,
    delay_moments,
    stacked,
)
from grader.report.timeline.processes import lane_of_process
from grader.report.timeline.steps import lanes_of_steps
from grader.report.timeline.traffic import lanes_of_actions, lanes_of_states, lanes_of_topics
from grader.report.views import anchor, points
from grader.result import CheckResult, Location, Result

__all__ = ["Lane", "Moment", "Timeline", "timeline_of"]


def timeline_of(recorded: Recorded, result: Result) -> Timeline:
    """Return the timeline of a recorded session, with the points lost in it."""
    losses = stacked("points", "lost or open", _losses(recorded.record.session, result))
    stalls = delay_moments(recorded, "everything stalled for about", recorded.stalls, "stall")
    lanes = [
        *losses,
        *lanes_of_steps(recorded),
        *_lanes_of_processes(recorded),
        *lanes_of_actions(recorded),
        *lanes_of_states(recorded),
        *lanes_of_topics(recorded),
        Lane("grading computer", "", list(stalls)),
    ]
    return Timeline(recorded, lanes)


def _lanes_of_processes(recorded: Recorded) -> Iterator[Lane]:
    """Yield a lane for each process of the student, and then for each reference process."""
    places = []
    for role in ("student", "reference"):
        for place, run in enumerate(recorded.record.processes):
            if run.role == role:
                places.append(place)
    for place in places[:MOST_LANES]:
        yield lane_of_process(recorded, place)


def _losses(session: str, result: Result) -> Iterator[Moment]:
    """Yield the places in a session that prove lost or undecided points."""
    for check in result.checks:
        if check.lost or check.undecided:
            place = _place_in(session, check)
            if place is not None:
                yield _loss(check, place)


def _place_in(session: str, check: CheckResult) -> Location | None:
    """Return the first location of a check in a session with a time."""
    for location in check.where:
        if location.session == session and location.start_s is not None:
            return location
    return None


def _loss(check: CheckResult, place: Location) -> Moment:
    assert place.start_s is not None
    style = "lost"
    lost = f"−{points(check.lost)}"
    if not check.lost:
        style = "open"
        lost = f"{points(check.undecided)} open"
    end_s = place.end_s
    if end_s is None:
        end_s = place.start_s
    text = f"{lost}: {check.title}"
    href = "#" + anchor("check", check.id)
    return Moment(style, place.start_s, text, check.reason, end_s, trouble=True, href=href)
