"""The timeline of a session: what happened when, by its recording. The template draws it; nothing is judged."""

from __future__ import annotations

import bisect
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grader.evidence.cpu_delay import Delay
from grader.evidence.crash.tracebacks import tracebacks
from grader.evidence.recorded import Recorded
from grader.lab.steps import STEPS
from grader.recording.session import ProcessRun, StepRun
from grader.report.figures.graph import Call
from grader.report.figures.svg import duration, short, ticks
from grader.report.views import anchor, end_of, fields, heading_of, points
from grader.result import Result

#: Of a lane so many moments are shown, and so many lanes of a kind.
_MOST_MOMENTS, _MOST_LANES = 60, 12
_MOST_TICKS = 8
#: A process that the machine delayed for less was not delayed.
_SHOWN_DELAY_NS = 50_000_000
#: A topic is silent where no message comes for so many usual intervals, and for so long.
_SILENT_INTERVALS, _SILENT_S = 8, 0.25
#: What a process wrote so soon after something else is shown beside it.
_SOON_S = 1.0
_STANDARD_TOPICS = ("/rosout", "/parameter_events")
#: How a line begins that is a warning, of rclpy's log or Python's, or an error, behind the prefix of a launch.
_WARNS = re.compile(
    r"(?:\[[\w.-]{1,100}-\d{1,4}\] ?)?(?:\[(?:WARN|(ERROR|FATAL))\]|\S{1,300}:\d{1,9}: [A-Za-z]{0,60}Warning: )"
)


@dataclass(frozen=True)
class Moment:
    """What happened at a time, or went on from it, in seconds since the session's start."""

    #: Of its mark or bar in the picture.
    style: str
    start_s: float
    text: str
    #: What came of it.
    note: str = ""
    end_s: float | None = None
    #: Whether something went wrong.
    trouble: bool = False
    #: Place of a process in the record, and of a line in its output, counted from 0.
    line: tuple[int, int] | None = None
    #: Part of the report that says more.
    href: str = ""


@dataclass(frozen=True)
class Lane:
    """Moments that belong to one thing, such as a process or a topic, and what that is."""

    name: str
    kind: str
    moments: Sequence[Moment]


class Timeline:
    """All lanes of a session that have moments, and `rows`: these by time, each with its id and its lane's place."""

    def __init__(self, recorded: Recorded, lanes: Iterable[Lane]) -> None:
        record = recorded.record
        self.session, self.started_ns = record.session, record.started_ns
        #: What each process is called, by its place in the record.
        self.processes = [heading_of(record, place) for place in range(len(record.processes))]
        ends_ns = [
            record.ended_ns,
            *(s.ended_ns for s in record.steps),
            *(p.exited_ns or 0 for p in record.processes),
        ]
        self.length_s = max(1e-3, *(recorded.since_start_s(t_ns) for t_ns in ends_ns))
        self.ticks = [(time_s, short(time_s)) for time_s in ticks(0.0, self.length_s, _MOST_TICKS)]
        log = sorted(
            (recorded.since_start_s(line.t_ns), place, number)
            for place, run in enumerate(record.processes)
            if run.role == "student"
            for number, line in enumerate(run.output)
        )
        self.lanes = [self._shown(lane, log) for lane in lanes if lane.moments]
        ordered = sorted(
            ((place, moment) for place, lane in enumerate(self.lanes) for moment in lane.moments),
            key=lambda row: row[1].start_s,
        )
        self.rows = [
            (f"{anchor('moment', self.session)}-{n}", *row) for n, row in enumerate(ordered)
        ]

    def _shown(self, lane: Lane, log: Sequence[tuple[float, int, int]]) -> Lane:
        """Return it within the session, of equal moments with the first, each with what was written soon after."""
        shown = []
        for _, alike in itertools.groupby(
            lane.moments, key=lambda m: (m.style, m.text, m.note, m.end_s)
        ):
            first, *others = alike
            often = f"{len(others) + 1} times" if others else ""
            start_s, end_s = (
                None if t is None else min(max(t, 0.0), self.length_s)
                for t in (first.start_s, first.end_s)
            )
            after = bisect.bisect_left(log, (first.start_s,))
            soon = after < len(log) and log[after][0] - first.start_s <= _SOON_S
            line = first.line or (log[after][1:] if soon else None)
            note = f"{first.note} {often}".strip()
            shown.append(replace(first, start_s=start_s or 0.0, end_s=end_s, note=note, line=line))
        kind = (
            lane.kind if len(shown) <= _MOST_MOMENTS else f"{_MOST_MOMENTS} of {len(shown)} moments"
        )
        return Lane(lane.name, kind, shown[:_MOST_MOMENTS])

    def at(self, time_s: float) -> str:
        """Return where a time, or how wide a span of it, lies in the picture: so many percent of its width."""
        return f"{100 * time_s / self.length_s:.2f}".rstrip("0").rstrip(".") + "%"

    def lines_of(self, place: int) -> set[int]:
        """Return the lines of a process's output that moments lead to."""
        return {
            row[-1].line[1]
            for row in self.rows
            if row[-1].line is not None and row[-1].line[0] == place
        }

    @property
    def styles(self) -> set[str]:
        """Those of all moments."""
        return {row[-1].style for row in self.rows}


def timeline_of(recorded: Recorded, result: Result) -> Timeline:
    """Return the timeline of a recorded session, with what points were lost for in it."""
    runs = recorded.record.processes
    places = [
        n for role in ("student", "reference") for n, run in enumerate(runs) if run.role == role
    ]
    lanes = (
        *_stacked("points", "lost or open", _losses(recorded.record.session, result)),
        *(
            Lane(name, "the lab", [m for step in steps for m in _of_step(recorded, step)])
            for name, steps in _steps(recorded)
        ),
        *(_of_process(recorded, place) for place in places[:_MOST_LANES]),
        *_of_actions(recorded),
        *_of_states(recorded),
        *_of_topics(recorded),
        Lane(
            "grading computer",
            "",
            [*_delays(recorded, "everything stalled for about", recorded.stalls, "stall")],
        ),
    )
    return Timeline(recorded, lanes)


def _stacked(name: str, kind: str, moments: Iterable[Moment]) -> Iterator[Lane]:
    """Return lanes of one name, as many as it takes that no bar lies on another."""
    lanes: list[list[Moment]] = []
    for moment in sorted(moments, key=lambda moment: moment.start_s):
        free = (lane for lane in lanes if (lane[-1].end_s or lane[-1].start_s) <= moment.start_s)
        lane = next(free, None)
        if lane is None:
            lanes.append(lane := [])
        lane.append(moment)
    yield from (Lane(name, kind, lane) for lane in lanes[:_MOST_LANES])


def _losses(session: str, result: Result) -> Iterator[Moment]:
    """Return where in the recording the proof of lost or undecided points lies."""
    for check in result.checks:
        place = next(
            (w for w in check.where if w.session == session and w.start_s is not None), None
        )
        if place is not None and place.start_s is not None and (check.lost or check.undecided):
            what = f"−{points(check.lost)}" if check.lost else f"{points(check.undecided)} open"
            text, href = f"{what}: {check.title}", "#" + anchor("check", check.id)
            end_s = place.start_s if place.end_s is None else place.end_s
            yield Moment(
                "lost" if check.lost else "open",
                place.start_s,
                text,
                check.reason,
                end_s,
                True,
                href=href,
            )


# -- steps -------------------------------------------------------------------------------------


def _steps(recorded: Recorded) -> Iterator[tuple[str, list[StepRun]]]:
    """Return the steps, and apart from them those that went on beside others."""
    steps = recorded.record.steps
    yield "steps", [step for step in steps if step.kind != "link"]
    yield "bad link", [step for step in steps if step.kind == "link"]


def _of_step(recorded: Recorded, step: StepRun) -> Iterator[Moment]:
    """Return a step: its calls, or a span of time, that of a window from when it opened."""
    label = f" ({step.label})" if step.label else ""
    if step.result.get("calls"):
        yield from _of_calls(recorded, step, label)
        return
    opened_ns, closed_ns = step.result.get("opened_ns"), step.result.get("closed_ns")
    style = "window" if opened_ns else "wait" if step.kind.startswith("wait") else "step"
    outcome = {"done": "", "timeout": "not in time"}.get(step.outcome, step.outcome)
    name = step.result.get("name")
    alias = (
        f"found as {name}" if isinstance(name, str) and name not in step.parameters.values() else ""
    )
    made = _MADE_OF[step.kind](step.result) if step.kind in _MADE_OF else ""
    note = "; ".join(filter(None, (outcome, str(step.result.get("problem", "")), alias, made)))
    start_s = recorded.since_start_s(opened_ns or step.started_ns)
    end_s = recorded.since_start_s(closed_ns or step.ended_ns or recorded.record.ended_ns)
    yield Moment(style, start_s, _described(step) + label, note, end_s, step.outcome != "done")


def _described(step: StepRun) -> str:
    model = STEPS.get(step.kind)
    try:
        return (
            model.model_construct(**step.parameters).describe() if model is not None else step.kind
        )
    except (KeyError, ValueError, TypeError):  # recorded when the step had other parameters
        return step.kind


#: Kind of a step -> what came of it, by its result.
_MADE_OF: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "start": lambda r: (
        "it was running" if r.get("started") is False else ", ".join(r.get("processes", ()))
    ),
    "publish": lambda r: "" if r.get("matched", True) else "no subscription was matched",
    "get_parameters": lambda r: fields(
        {n: held.get("value") for n, held in r.get("values", {}).items() if held}
    ),
    "set_parameters": lambda r: f"refused: {fields(r['refused'])}" if r.get("refused") else "",
    "change_state": lambda r: " → ".join(str(r[key]) for key in ("before", "after") if key in r),
    "plan": lambda r: str(r.get("plan", {}).get("problem") or ""),
}


def _of_calls(recorded: Recorded, step: StepRun, label: str) -> Iterator[Moment]:
    """Return calls with their answers, those together that were answered alike one after the other."""
    calls = (Call.of(recorded, call) for call in step.result["calls"])
    request = fields(step.parameters.get("request", {})) or "an empty request"
    for (style, _), alike in itertools.groupby(
        calls, key=lambda call: (call.key[0], str(call.response))
    ):
        group = list(alike)
        answer = (
            "no answer"
            if group[0].response is None
            else fields(group[0].response) or "an empty answer"
        )
        often, slowest = (
            f"{len(group)} times: " if len(group) > 1 else "",
            max(call.latency_s for call in group),
        )
        text = f"calling {step.result.get('service', '')} with {request}{label}"
        end_s = max(call.start_s + call.latency_s for call in group)
        note = (
            f"{often}{answer}, after at most {duration(slowest)}"
            if often
            else f"{answer}, after {duration(slowest)}"
        )
        yield Moment(style, group[0].start_s, text, note, end_s, style == "call-silent")


# -- processes ---------------------------------------------------------------------------------


def _of_process(recorded: Recorded, place: int) -> Lane:
    """Return a process with its node in the graph, what it logged, its end, and when the machine delayed it."""
    run, at = recorded.record.processes[place], recorded.since_start_s
    end_ns, end = run.exited_ns or recorded.record.ended_ns, end_of(run)
    odd = run.role == "student" and (
        run.ended_by in ("kill", "terminate", "limit") or bool(run.exit_status)
    )
    moments = [
        Moment("run", at(run.started_ns), f"{run.name} runs", end, at(end_ns)),
        *_found(recorded, run, end_ns),
    ]
    if run.interrupted_ns is not None:
        moments.append(Moment("interrupt", at(run.interrupted_ns), "Ctrl-C (SIGINT)"))
    if run.exited_ns is not None:
        moments.append(Moment("bad-exit" if odd else "exit", at(run.exited_ns), end, trouble=odd))
    moments += _logged(recorded, place)
    delays = [delay for delay in recorded.delays(run) if delay.delay_ns >= _SHOWN_DELAY_NS]
    moments += _delays(
        recorded, f"the grading computer was busy: {run.name} waited for a core,", delays, "delay"
    )
    return Lane(
        heading_of(recorded.record, place), "the lab's" if run.role == "reference" else "", moments
    )


def _found(recorded: Recorded, run: ProcessRun, end_ns: int) -> Iterator[Moment]:
    """Return when the nodes of a process were first in the graph, as far as is known which these are."""
    prefixes = tuple(t.gid_prefix for t in recorded.record.trusted if t.process == run.name)
    nodes = {claim.node for claim in recorded.record.claims if claim.process == run.name}
    first: dict[str, int] = {}
    for sighting in recorded.sightings:
        own = sighting.endpoint.node in nodes or sighting.endpoint.gid.startswith(prefixes)
        if own and run.started_ns <= sighting.start_ns <= end_ns:
            first.setdefault(sighting.endpoint.node, sighting.start_ns)
    for node, seen_ns in first.items():
        note = f"{duration((seen_ns - run.started_ns) / 1e9)} after the start"
        yield Moment("found", recorded.since_start_s(seen_ns), f"node {node} is in the graph", note)


def _logged(recorded: Recorded, place: int) -> Iterator[Moment]:
    """Return a process's exceptions, where their tracebacks end, and the warnings and errors that it logged."""
    run = recorded.record.processes[place]
    lines = recorded.lines_of(run)
    numbers = {
        (line.t_ns, line.text.partition(":")[0].strip()): number
        for number, line in enumerate(lines)
    }
    for raised in tracebacks(run.output):
        number = numbers.get((raised.t_ns, raised.type), len(lines) - 1)
        text = f"{raised.name}: {raised.message}".partition("\n")[0]
        yield Moment(
            "raised", recorded.since_start_s(raised.t_ns), text, trouble=True, line=(place, number)
        )
    for number, line in enumerate(lines):
        if (warns := _WARNS.match(line.text)) is not None:
            style, said = (
                "logged-error" if warns[1] else "warning",
                line.text.partition("]: ")[2] or line.text,
            )
            yield Moment(
                style, recorded.since_start_s(line.t_ns), said, trouble=True, line=(place, number)
            )


def _delays(recorded: Recorded, what: str, delays: Iterable[Delay], style: str) -> Iterator[Moment]:
    for delay in delays:
        start_s, end_s = (
            recorded.since_start_s(delay.start_ns),
            recorded.since_start_s(delay.end_ns),
        )
        yield Moment(style, start_s, f"{what} {duration(delay.delay_ns / 1e9)}", end_s=end_s)


# -- actions, states and topics ----------------------------------------------------------------


def _of_actions(recorded: Recorded) -> Iterator[Lane]:
    """Return lanes for each action: how each goal went, and below, its feedback and when it was to be cancelled."""
    sent: dict[str, list[tuple[StepRun, Mapping[str, Any]]]] = {}
    for step in recorded.record.steps:
        for goal in step.result.get("goals", ()):
            sent.setdefault(str(step.parameters.get("action", "")), []).append((step, goal))
    for action, goals in list(sent.items())[:_MOST_LANES]:
        yield from _stacked(action, "goals", [_goal(recorded, step, goal) for step, goal in goals])
        yield Lane(
            action,
            "feedback",
            [m for step, goal in goals for m in _beside_goal(recorded, step, goal)],
        )


def _goal(recorded: Recorded, step: StepRun, goal: Mapping[str, Any]) -> Moment:
    """Return how a goal went, from when it was sent to its result."""
    accepted, ended_ns = goal.get("accepted"), goal.get("ended_ns")
    status = goal.get("status") if ended_ns else "no result"
    said = f"accepted, {status}" if accepted else "not answered" if accepted is None else "rejected"
    made = fields(goal["result"]) if goal.get("result") is not None else ""
    silent = accepted is not False and not ended_ns
    end_s = recorded.since_start_s(ended_ns or (step.ended_ns if silent else goal["answered_ns"]))
    text, style = (
        f"{step.label or 'goal'}: {fields(goal.get('goal', {}))}",
        "goal-silent" if silent else "goal",
    )
    return Moment(
        style,
        recorded.since_start_s(goal["sent_ns"]),
        text,
        f"{said}: {made}" if made else said,
        end_s,
        silent,
    )


def _beside_goal(recorded: Recorded, step: StepRun, goal: Mapping[str, Any]) -> Iterator[Moment]:
    at, cancel, which = recorded.since_start_s, goal.get("cancel"), step.label or "the goal"
    if count := goal.get("feedback_count", 0):
        first_s, last_s = at(goal["first_feedback_ns"]), at(goal["last_feedback_ns"])
        yield Moment("feedback", first_s, f"feedback on {which}", f"{count} messages", last_s)
    if cancel:
        agreed = {True: "accepted", False: "refused"}.get(cancel["accepted"], "no answer")
        yield Moment("cancel", at(cancel["sent_ns"]), f"{which} is to be cancelled", agreed)


def _of_states(recorded: Recorded) -> Iterator[Lane]:
    """Return a lane for each lifecycle node: the states that it reported before and after each transition."""
    changes: dict[str, list[StepRun]] = {}
    for step in recorded.record.steps:
        if step.kind == "change_state" and "called_ns" in step.result:
            changes.setdefault(str(step.result.get("node", "")), []).append(step)
    for node, steps in list(changes.items())[:_MOST_LANES]:
        states = [steps[0].result["before"], *(step.result["after"] for step in steps)]
        edges_ns = [
            steps[0].started_ns,
            *(step.result["answered_ns"] for step in steps),
            recorded.record.ended_ns,
        ]
        spans = zip(states, itertools.pairwise(map(recorded.since_start_s, edges_ns)), strict=True)
        yield Lane(
            node,
            "state",
            [Moment("state", a, f"{node} is {state}", "", b) for state, (a, b) in spans],
        )


def _of_topics(recorded: Recorded) -> Iterator[Lane]:
    """Return a lane for each topic that is not hidden or every node's, those first that the steps wait for."""
    types = {
        info.topic: info.topic_type
        for info in sorted(recorded.bag.topics, key=lambda info: info.count)
    }
    names = dict.fromkeys([*types, *(s.endpoint.topic for s in recorded.sightings)])
    plain = [name for name in names if name not in _STANDARD_TOPICS and "/_" not in name]
    lanes = [Lane(name, "", [*_of_topic(recorded, name, types.get(name, ""))]) for name in plain]
    shown = (lane for lane in lanes if lane.moments)
    by_time = sorted(
        shown,
        key=lambda lane: (lane.name not in recorded.awaited, lane.moments[0].start_s, lane.name),
    )
    yield from by_time[:_MOST_LANES]


def _of_topic(recorded: Recorded, topic: str, topic_type: str) -> Iterator[Moment]:
    """Return when its endpoints were in the graph, its first message, and the spans between silences."""
    for kind in ("publisher", "subscription"):
        seen = [
            s for s in recorded.sightings if (s.endpoint.topic, s.endpoint.kind) == (topic, kind)
        ]
        if seen:
            start_s = recorded.since_start_s(min(s.start_ns for s in seen))
            nodes = ", ".join(dict.fromkeys(s.endpoint.node for s in seen))
            yield Moment("found", start_s, f"{kind} of {topic} is in the graph", nodes)
    times_s = recorded.seconds(recorded.bag.received_ns(topic, topic_type))
    if not len(times_s):
        return
    yield Moment("first", float(times_s[0]), f"first message on {topic}")
    gaps_s = np.diff(times_s)
    limit_s = (
        max(_SILENT_S, _SILENT_INTERVALS * float(np.median(gaps_s))) if len(gaps_s) else _SILENT_S
    )
    for part in np.split(times_s, np.flatnonzero(gaps_s > limit_s) + 1):
        length_s = float(part[-1] - part[0])
        rate = f", {short((len(part) - 1) / length_s)} Hz" if length_s > 0 and len(part) > 2 else ""
        count = f"{len(part)} message{'s' if len(part) > 1 else ''}"
        yield Moment("traffic", float(part[0]), f"{topic}: {count}{rate}", end_s=float(part[-1]))
