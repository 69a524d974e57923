"""The checks of Lab 09-01's extensions that no built-in one says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grader.own_checks import AnyStep, Context, Finding, Process, Topic, failed, graded, passed

#: The first half of a participant's prefix in a gid: host and process.
PROCESS_DIGITS = 16


@dataclass
class Parameters:
    """Nodes that are to run in one process."""

    nodes: list[str]


def one_process(context: Context, p: Parameters) -> Finding:
    """All nodes run, and in one process: each has an endpoint of its own, whose gid begins with the process."""
    expected = f"{', '.join(p.nodes)} in one process"
    # Every node publishes on one of these.
    own = [each for topic in ("/rosout", "/parameter_events") for each in context.endpoints(topic)]
    processes = {node: {each.gid[:PROCESS_DIGITS] for each in own if each.node == node} for node in p.nodes}
    up = [node for node, found in processes.items() if found]
    if not up:
        return failed(expected, "none of the nodes", "None of the nodes came up under its name.")
    together = max(
        (sum(process in processes[node] for node in up) for node in up for process in processes[node]), default=0
    )
    measured = f"{len(up)} of {len(p.nodes)} nodes, at most {together} in one process"
    missing = [node for node in p.nodes if node not in up]
    reason = f"{', '.join(missing)} did not come up. " if missing else ""
    if together < len(up):
        reason += "They run in several processes."
    # One alone in its process is no composition.
    return graded((together - 1) / (len(p.nodes) - 1), expected, measured, reason.strip())


@dataclass
class Motion:
    """Commands while a goal is executed."""

    step: AnyStep
    topic: Topic
    process: Process
    tolerance_rad: float = 0.02
    #: How much earlier or later a position may come.
    tolerance_s: float = 0.1
    least_hz: float = 50.0


def on_the_line(context: Context, p: Motion) -> Finding:
    """Judge for how much of the goal's time the last command is where the straight lines between its points are.

    The time begins with the first command. So one that comes late, that jumps, or that never comes counts for as long
    as the arm is kept in a wrong place.
    """
    points = _points(context, p)
    expected = f"straight from point to point at {_listed(points)} s"
    sent_s, places = _commands(context, p)
    if not len(sent_s):
        return failed(expected, "no commands", "No command came while the goal was executed.")
    delay_s = context.delay_s(p.process, p.step)
    right = _share_right(p, points, sent_s, places, p.tolerance_s)
    at_best = _share_right(p, points, sent_s, places, p.tolerance_s + delay_s)
    share, best = (_between(each, _NONE_BELOW, _FULL_FROM) for each in (right, at_best))
    measured = f"{100 * right:.0f} % of the time on the line"
    reason = f"The commands are on the lines for {100 * right:.0f} % of the time."
    ends = np.cumsum([end_s for end_s, _ in points])
    lengths = [(float(end_s), place) for end_s, (_, place) in zip(ends, points, strict=True)]
    if len(points) > 1 and _share_right(p, lengths, sent_s, places, p.tolerance_s) >= _FULL_FROM:
        reason += (
            f" They fit if the times are added up, to {_listed(lengths)} s: time_from_start counts from the start."
        )
    where = (context.location(p.topic),)
    return graded(share, expected, measured, reason, where=where, best=best, doubt=_BUSY, levels=10)


#: Share of the time from which credit is full, and below which there is none: of a line that is followed too slowly
#: the first part is right.
_FULL_FROM, _NONE_BELOW = 0.95, 0.7
_BUSY = "Not your fault: the grading computer was too busy to measure this."


def _between(value: float, none: float, full: float) -> float:
    """Return the credit of a value by those for none and for all of it, of which either may be the greater."""
    return min(1.0, max(0.0, (value - none) / (full - none)))


def _points(context: Context, p: Motion) -> list[tuple[float, list[float]]]:
    """Return the points of a step's goal: when, in s from its start, and where."""
    step = context.step(p.step)
    given = step.parameters["goal"]["trajectory"]["points"] if step is not None else []
    times = [point["time_from_start"] for point in given]
    ends_s = [time["sec"] + time.get("nanosec", 0) / 1e9 for time in times]
    return [(end_s, list(point["positions"])) for end_s, point in zip(ends_s, given, strict=True)]


def _listed(points: list[tuple[float, list[float]]]) -> str:
    return " and ".join(f"{end_s:g}" for end_s, _ in points)


def _commands(context: Context, p: Motion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return when commands were sent from the goal on, and their positions; not-a-numbers where these do not fit."""
    messages, step, points = context.messages(p.topic), context.step(p.step), _points(context, p)
    width = len(points[0][1]) if points else 0
    rows = [
        row if row is not None and len(row) == width else np.full(width, np.nan) for row in messages.numbers("data")
    ]
    since = messages.sent_s >= (step.started_s if step is not None else 0.0)
    order = np.argsort(messages.sent_s[since], kind="stable")
    return messages.sent_s[since][order], np.array(rows).reshape(-1, width)[since][order]


def _share_right(
    p: Motion,
    points: list[tuple[float, list[float]]],
    sent_s: NDArray[np.float64],
    places: NDArray[np.float64],
    early_or_late_s: float,
) -> float:
    """Return for which share of the time the last command is as near as allowed to a place of about that time."""
    ends_s = np.array([0.0, *(end_s for end_s, _ in points)])
    corners = np.array([np.zeros(places.shape[1]), *(place for _, place in points)])
    # A little longer: at the end it is to be at the last point.
    times_s = np.arange(0.0, ends_s[-1] + p.tolerance_s, 0.01)
    last = places[np.searchsorted(sent_s, sent_s[0] + times_s, side="right") - 1]
    near = np.zeros(len(times_s), dtype=bool)
    for shift_s in np.linspace(-early_or_late_s, early_or_late_s, 21):
        line = np.stack([np.interp(times_s + shift_s, ends_s, column) for column in corners.T], axis=1)
        near |= np.abs(last - line).max(axis=1) <= p.tolerance_rad
    return float(near.mean())


def often_enough(context: Context, p: Motion) -> Finding:
    """Judge the rate of commands in the time that a goal's points give, from the first one on."""
    points, (sent_s, _) = _points(context, p), _commands(context, p)
    expected = f"{p.least_hz:g} commands a second or more"
    if not len(sent_s):
        return failed(expected, "no commands", "No command came while the goal was executed.")
    length_s = points[-1][0]
    rate_hz = float((sent_s < sent_s[0] + length_s).sum()) / length_s
    delay_s = min(context.delay_s(p.process, p.step), length_s / 2)
    # A loop that sleeps for its whole period is slower: a fifth is not missed.
    share, best = (_between(hz / p.least_hz, 0.5, 0.8) for hz in (rate_hz, rate_hz / (1 - delay_s / length_s)))
    reason = f"The commands of the goal come at {rate_hz:.1f} Hz."
    where = (context.location(p.topic),)
    return graded(share, expected, f"{rate_hz:.1f} Hz", reason, where=where, best=best, doubt=_BUSY, levels=10)


@dataclass
class Awaited:
    """A step that waits for a publisher."""

    step: AnyStep


def came(context: Context, p: Awaited) -> Finding:
    """Judge whether the publisher that a step waited for was there in time."""
    step = context.step(p.step)
    expected = f"a publisher on {step.parameters['publisher']}" if step is not None else "a publisher"
    if step is None or step.outcome != "done":
        return failed(expected, "none", "The publisher was not there by then.")
    return passed(expected, "it was there")


@dataclass
class Printed:
    """A text that a process prints."""

    process: Process
    text: str


def prints(context: Context, p: Printed) -> Finding:
    """Judge whether a process prints lines with a text, in capitals or not, and a number behind it."""
    run = context.process(p.process)
    lines = [line.text.lower().partition(p.text)[2] for line in run.lines] if run is not None else []
    count = sum(any(character.isdigit() for character in rest) for rest in lines)
    expected = f"lines with {p.text.upper()} and a number"
    if not count:
        return failed(expected, "none", f"No line with {p.text.upper()} and a number is printed, though states come.")
    return passed(expected, f"{count} lines")


@dataclass
class During:
    """Messages that go on while a step is carried out."""

    topic: Topic
    step: AnyStep
    process: Process
    full_s: float = 0.2
    none_s: float = 0.6


def goes_on(context: Context, p: During) -> Finding:
    """Judge the longest time without a message that touches a step."""
    expected = f"messages on {p.topic} all the time, without a pause of more than {p.full_s:g} s"
    step, run = context.step(p.step), context.process(p.process)
    messages = context.messages(p.topic)
    if step is None or run is None or not len(messages):
        return failed(expected, "no messages", f"Nothing came on {p.topic}.")
    order = np.argsort(messages.sent_s, kind="stable")
    before, end_s = messages.sent_s[order], context.duration_s if run.exited_s is None else run.exited_s
    after = np.append(before[1:], max(end_s, step.ended_s))
    # Where a number is missing, a message was published and not recorded.
    follows = np.append(np.diff(messages.sequence[order]) <= 1, True)
    touching = (before < step.ended_s) & (after > step.started_s) & follows
    pause_s = float((after - before)[touching].max(initial=0.0))
    delay_s = context.delay_s(p.process, p.step)
    share, best = (_between(pause, p.none_s, p.full_s) for pause in (pause_s, pause_s - delay_s))
    answered_s = step.ended_s - step.started_s
    reason = f"Nothing comes for {pause_s:.2f} s while the service answers, which takes {answered_s:.2f} s."
    where = (context.location(p.topic),)
    measured = f"the longest pause is {pause_s:.2f} s"
    return graded(share, expected, measured, reason, where=where, best=best, doubt=_BUSY, levels=10)
