"""What happened in a session, moment by moment: its processes, nodes, messages, steps, and the machine's stalls.

All of it is read from the recording: nothing is judged here.
"""

from __future__ import annotations

import bisect
import functools
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grader.evidence.cpu_delay import Delay, Span
from grader.evidence.crash.tracebacks import HEAD_LINES, plain_lines, tracebacks
from grader.evidence.recorded import Recorded
from grader.lab.steps import STEPS
from grader.recording.bag import TopicInfo
from grader.recording.session import ProcessRun, StepRun
from grader.report.figures.graph import Call
from grader.report.figures.svg import duration, short
from grader.report.views import anchor, end_of, fields, heading_of, points
from grader.result import Result

#: Of a lane so many moments are shown, and so many lanes of a kind.
_MOST_MOMENTS, _MOST_LANES = 60, 12
#: The machine's delays of a process are shown from here on.
_SHOWN_DELAY_NS = 50_000_000
#: A topic is silent where no message comes for so many usual intervals, and for so long.
_SILENT_INTERVALS, _SILENT_S = 8, 0.25
#: A line of a process that was written so soon after something else is shown beside it.
_SOON_S = 1.0
#: What every node has, and no lab asks for.
_STANDARD = ("/rosout", "/parameter_events")
_LEVEL = re.compile(r"^\[(WARN|ERROR|FATAL)\]")
_PYTHON_WARNING = re.compile(r"^\S{1,300}:\d{1,9}: [A-Za-z]{0,60}Warning: ")
_LOG_HEAD = re.compile(r"^(?:\[[^\]]{0,200}\][ :]{0,2}){1,3}")
_LEVEL_STYLES = {"WARN": "warning", "ERROR": "logged-error", "FATAL": "logged-error"}


@dataclass(frozen=True)
class Moment:
    """What happened at a time, or went on from it, in seconds since the session's start."""

    #: Of its mark or bar.
    style: str
    start_s: float
    text: str
    #: What came of it.
    note: str = ""
    end_s: float | None = None
    #: Place of a process in the record, and of a line in its output, counted from 0.
    line: tuple[int, int] | None = None
    #: Part of the report that says more.
    href: str = ""
    #: Whether something went wrong.
    trouble: bool = False


@dataclass(frozen=True)
class Lane:
    """Moments that belong to one thing, such as a process or a topic."""

    name: str
    #: What it is.
    kind: str
    moments: tuple[Moment, ...]


@dataclass(frozen=True)
class Timeline:
    """All lanes of a session."""

    session: str
    started_ns: int
    length_s: float
    lanes: tuple[Lane, ...]

    @functools.cached_property
    def rows(self) -> list[tuple[str, Lane, Moment]]:
        """All moments by time, each with its id in the page and its lane."""
        all_of_them = [(lane, moment) for lane in self.lanes for moment in lane.moments]
        ordered = sorted(all_of_them, key=lambda row: row[1].start_s)
        return [(f"{anchor('moment', self.session)}-{n}", *row) for n, row in enumerate(ordered)]

    def lines_of(self, place: int) -> set[int]:
        """Return the lines of a process's output that moments lead to."""
        lines = (moment.line for _, _, moment in self.rows if moment.line is not None)
        return {number for of, number in lines if of == place}

    @property
    def shows_a_loss(self) -> bool:
        """Whether points were lost, or are open, at a moment of it."""
        return any(moment.style in ("lost", "open") for _, _, moment in self.rows)


def timeline_of(recorded: Recorded, result: Result) -> Timeline:
    """Return the timeline of a recorded session; lanes without moments are left out."""
    record = recorded.record
    known_ns = (
        record.ended_ns,
        *(step.ended_ns for step in record.steps),
        *(run.exited_ns or run.started_ns for run in record.processes),
        *(graph.t_ns for graph in record.graph),
    )
    lanes = (
        *_stacked("points", "lost or open", _losses(record.session, result)),
        Lane("steps", "the lab", tuple(_of_steps(recorded))),
        *(_of_process(recorded, n) for n in _shown_processes(recorded)),
        *_of_actions(recorded),
        *_of_states(recorded),
        *_of_topics(recorded),
        Lane("grading computer", "", tuple(_stalls(recorded))),
    )
    length_s = max(recorded.since_start_s(max(known_ns)), 1e-3)
    log = sorted(
        (recorded.since_start_s(line.t_ns), place, number)
        for place, run in enumerate(record.processes)
        if run.role == "student"
        for number, line in enumerate(run.output)
    )
    kept = (replace(lane, moments=_bounded(lane, length_s, log)) for lane in lanes if lane.moments)
    return Timeline(record.session, record.started_ns, length_s, tuple(kept))


#: When a line was written, in s since the session's start, by which process, and its number.
_Written = tuple[float, int, int]


def _bounded(lane: Lane, length_s: float, log: Sequence[_Written]) -> tuple[Moment, ...]:
    """Return moments within the session, each with a line of output; of equal ones the first, of too many some."""
    found: list[Moment] = []
    for _, group in itertools.groupby(lane.moments, key=lambda m: (m.style, m.text, m.note, m.href)):
        first, *others = list(group)
        if others:
            last_s = others[-1].end_s or others[-1].start_s
            first = replace(first, note=f"{first.note} {len(others) + 1} times".strip(), end_s=last_s)
        start_s = min(max(first.start_s, 0.0), length_s)
        end_s = None if first.end_s is None else min(max(first.end_s, start_s), length_s)
        found.append(replace(first, start_s=start_s, end_s=end_s, line=first.line or _line_at(log, start_s)))
    left_out = len(found) - _MOST_MOMENTS
    if left_out <= 0:
        return tuple(found)
    half = _MOST_MOMENTS // 2
    words = f"{left_out} more moments are not shown"
    return (*found[:half], replace(found[half], text=words, note="", style="more"), *found[-half:])


def _line_at(log: Sequence[_Written], at_s: float) -> tuple[int, int] | None:
    """Return the first line that was written soon after a time."""
    after = bisect.bisect_left(log, (at_s,))
    return log[after][1:] if after < len(log) and log[after][0] - at_s <= _SOON_S else None


def _stacked(name: str, kind: str, moments: Iterable[Moment]) -> Iterator[Lane]:
    """Return lanes of one name, as many as it takes that no bar lies on another."""
    lanes: list[list[Moment]] = []
    for moment in sorted(moments, key=lambda moment: moment.start_s):
        free = (lane for lane in lanes if all((m.end_s or m.start_s) <= moment.start_s for m in lane))
        lane = next(free, None)
        if lane is None:
            lanes.append(lane := [])
        lane.append(moment)
    yield from (Lane(name, kind, tuple(lane)) for lane in lanes[:_MOST_LANES])


# -- points ------------------------------------------------------------------------------------


def _losses(session: str, result: Result) -> Iterator[Moment]:
    """Return where in the recording the proof of lost or undecided points lies."""
    for check in result.checks:
        place = next((w for w in check.where if w.session == session and w.start_s is not None), None)
        if place is None or place.start_s is None or not (check.lost > 0 or not check.outcome.decided):
            continue
        style, what = (
            ("lost", f"−{points(check.lost)}") if check.lost > 0 else ("open", f"{points(check.undecided)} open")
        )
        href = "#" + anchor("check", check.id)
        end_s = place.start_s if place.end_s is None else place.end_s
        yield Moment(style, place.start_s, f"{what}: {check.title}", check.reason, end_s, href=href, trouble=True)


# -- steps -------------------------------------------------------------------------------------


def step_text(step: StepRun) -> str:
    """Say what a step does, in the words of its progress."""
    model = STEPS.get(step.kind)
    try:
        return model.model_construct(**step.parameters).describe() if model is not None else step.kind
    except (KeyError, ValueError, TypeError):  # recorded when the step had other parameters
        return step.kind


def _of_steps(recorded: Recorded) -> Iterator[Moment]:
    for step in recorded.record.steps:
        calls = [
            Call(recorded.since_start_s(c["started_ns"]), (c["ended_ns"] - c["started_ns"]) / 1e9, c["response"])
            for c in step.result.get("calls", ())
        ]
        yield from _of_calls(step, calls) if calls else [_of_step(recorded, step)]


def _of_step(recorded: Recorded, step: StepRun) -> Moment:
    """Return a step as a span of time; a window from when it opened."""
    opened_ns, closed_ns = step.result.get("opened_ns"), step.result.get("closed_ns")
    style = "window" if opened_ns else "wait" if step.kind.startswith("wait") else "step"
    outcome = {"done": "", "timeout": "not in time"}.get(step.outcome, step.outcome)
    made = _MADE_OF[step.kind](step.result) if step.kind in _MADE_OF else ""
    note = "; ".join(part for part in (outcome, str(step.result.get("problem", "")), _alias(step), made) if part)
    start_ns, end_ns = opened_ns or step.started_ns, closed_ns or step.ended_ns
    end_s = recorded.since_start_s(end_ns or recorded.record.ended_ns)
    text = f"{step_text(step)} ({step.label})" if step.label else step_text(step)
    return Moment(style, recorded.since_start_s(start_ns), text, note, end_s, trouble=step.outcome != "done")


def _alias(step: StepRun) -> str:
    name = step.result.get("name")
    return f"found as {name}" if isinstance(name, str) and name not in step.parameters.values() else ""


def _values(result: Mapping[str, Any]) -> str:
    return fields({name: held.get("value") for name, held in result.get("values", {}).items() if held})


#: Kind of a step -> what came of it, by its result.
_MADE_OF: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "start": lambda r: "it was running" if r.get("started") is False else ", ".join(r.get("processes", ())),
    "publish": lambda r: "" if r.get("matched", True) else "no subscription was matched",
    "get_parameters": _values,
    "set_parameters": lambda r: f"refused: {fields(r['refused'])}" if r.get("refused") else "",
    "change_state": lambda r: " → ".join(str(r[key]) for key in ("before", "after") if key in r),
    "plan": lambda r: str(r.get("plan", {}).get("problem") or ""),
}


def _of_calls(step: StepRun, calls: Sequence[Call]) -> Iterator[Moment]:
    """Return calls with their answers, those together that were answered alike one after the other."""
    request = fields(step.parameters.get("request", {}))
    label = f" ({step.label})" if step.label else ""
    text = f"calling {step.result.get('service', '')} with {request or 'an empty request'}{label}"
    for (style, _), alike in itertools.groupby(calls, key=lambda call: (call.key[0], str(call.response))):
        group = list(alike)
        slowest = duration(max(call.latency_s for call in group))
        answer = "no answer" if group[0].response is None else fields(group[0].response) or "an empty answer"
        note = f"{answer}, after {slowest}" if len(group) == 1 else f"{len(group)} times: {answer}, within {slowest}"
        end_s = max(call.start_s + call.latency_s for call in group)
        yield Moment(style, group[0].start_s, text, note, end_s, trouble=style == "call-silent")


# -- processes ---------------------------------------------------------------------------------


def _shown_processes(recorded: Recorded) -> list[int]:
    """Return the places in the record of the student's processes and the lab's, in this order."""
    runs = recorded.record.processes
    places = [n for role in ("student", "reference") for n, run in enumerate(runs) if run.role == role]
    return places[:_MOST_LANES]


def _of_process(recorded: Recorded, place: int) -> Lane:
    run = recorded.record.processes[place]
    at, end_ns = recorded.since_start_s, run.exited_ns or recorded.record.ended_ns
    odd = run.role == "student" and (run.ended_by in ("kill", "terminate", "limit") or bool(run.exit_status))
    moments = [Moment("run", at(run.started_ns), f"{run.name} runs", end_of(run), at(end_ns))]
    moments += _found(recorded, run)
    moments += _of_output(recorded, place)
    if run.interrupted_ns is not None:
        moments.append(Moment("interrupt", at(run.interrupted_ns), "Ctrl-C (SIGINT)"))
    if run.exited_ns is not None:
        moments.append(Moment("bad-exit" if odd else "exit", at(run.exited_ns), end_of(run), trouble=odd))
    moments += _delays(recorded, run)
    return Lane(heading_of(recorded.record, place), "the lab's" if run.role == "reference" else "", tuple(moments))


def _found(recorded: Recorded, run: ProcessRun) -> Iterator[Moment]:
    """Return when the nodes of a process were first in the graph, as far as is known which these are."""
    prefixes = tuple(t.gid_prefix for t in recorded.record.trusted if t.process == run.name)
    nodes = {claim.node for claim in recorded.record.claims if claim.process == run.name}
    alive = Span(run.started_ns, run.exited_ns or recorded.record.ended_ns)
    first: dict[str, int] = {}
    for sighting in recorded.sightings:
        endpoint, seen_ns = sighting.endpoint, sighting.start_ns
        own = endpoint.node in nodes or endpoint.gid.startswith(prefixes)
        if own and alive.start_ns <= seen_ns <= alive.end_ns:
            first.setdefault(endpoint.node, seen_ns)
    for node, seen_ns in first.items():
        waited = duration((seen_ns - run.started_ns) / 1e9)
        yield Moment(
            "found", recorded.since_start_s(seen_ns), f"node {node} is in the graph", f"{waited} after the start"
        )


def _of_output(recorded: Recorded, place: int) -> Iterator[Moment]:
    """Return the warnings and errors that a process logged, and its tracebacks where they end."""
    output = recorded.record.processes[place].output
    lines = plain_lines(output)
    #: Where there are too many, those in the middle are not among them.
    numbers = [n if n < HEAD_LINES else n + len(output) - len(lines) for n in range(len(lines))]
    for number, line in zip(numbers, lines, strict=True):
        level = _LEVEL.match(line.text)
        if level is not None or _PYTHON_WARNING.match(line.text):
            style = _LEVEL_STYLES[level[1]] if level is not None else "warning"
            said = _LOG_HEAD.sub("", line.text)
            yield Moment(style, recorded.since_start_s(line.t_ns), said, line=(place, number), trouble=True)
    by_time: dict[int, list[tuple[int, str]]] = {}
    for number, line in zip(numbers, lines, strict=True):
        by_time.setdefault(line.t_ns, []).append((number, line.text))
    for raised in tracebacks(output):
        number = next((n for n, text in by_time.get(raised.t_ns, ()) if raised.type in text), numbers[-1])
        text = f"{raised.name}: {raised.message}"
        yield Moment("raised", recorded.since_start_s(raised.t_ns), text, line=(place, number), trouble=True)


def _delays(recorded: Recorded, run: ProcessRun) -> Iterator[Moment]:
    """Return when the machine may have delayed a process, times that follow each other together."""
    together: list[Delay] = []
    for delay in (delay for delay in recorded.delays(run) if delay.delay_ns >= _SHOWN_DELAY_NS):
        if together and delay.start_ns <= together[-1].end_ns:
            last = together.pop()
            delay = Delay(last.start_ns, delay.end_ns, last.delay_ns + delay.delay_ns)
        together.append(delay)
    for delay in together:
        text = f"the grading computer was busy: {run.name} waited {duration(delay.delay_ns / 1e9)} for a core"
        start_s, end_s = recorded.since_start_s(delay.start_ns), recorded.since_start_s(delay.end_ns)
        yield Moment("delay", start_s, text, end_s=end_s)


def _stalls(recorded: Recorded) -> Iterator[Moment]:
    for stall in recorded.stalls:
        text = f"everything stalled for about {duration(stall.delay_ns / 1e9)}"
        start_s, end_s = recorded.since_start_s(stall.start_ns), recorded.since_start_s(stall.end_ns)
        yield Moment("stall", start_s, text, end_s=end_s, trouble=True)


# -- actions and states ------------------------------------------------------------------------


def _of_actions(recorded: Recorded) -> Iterator[Lane]:
    """Return lanes for each action: how each goal went, and below, its feedback and when it was to be cancelled."""
    sent: dict[str, list[tuple[StepRun, Mapping[str, Any]]]] = {}
    for step in recorded.record.steps:
        for goal in step.result.get("goals", ()):
            sent.setdefault(str(step.parameters.get("action", "")), []).append((step, goal))
    for action, goals in list(sent.items())[:_MOST_LANES]:
        yield from _stacked(action, "goals", [_goal(recorded, step, goal) for step, goal in goals])
        yield Lane(action, "feedback", tuple(m for step, goal in goals for m in _beside_goal(recorded, step, goal)))


def _goal(recorded: Recorded, step: StepRun, goal: Mapping[str, Any]) -> Moment:
    """Return how a goal went, from when it was sent to its result."""
    accepted, ended_ns = goal.get("accepted"), goal.get("ended_ns")
    status = goal.get("status") if ended_ns else "no result"
    said = f"accepted, {status}" if accepted else "not answered" if accepted is None else "rejected"
    made = (said, fields(goal["result"]) if goal.get("result") is not None else "")
    silent = accepted is not False and not ended_ns
    return Moment(
        "goal-silent" if silent else "goal",
        recorded.since_start_s(goal["sent_ns"]),
        f"{step.label or 'goal'}: {fields(goal.get('goal', {}))}",
        ": ".join(filter(None, made)),
        recorded.since_start_s(ended_ns or (step.ended_ns if silent else goal["answered_ns"])),
        trouble=silent,
    )


def _beside_goal(recorded: Recorded, step: StepRun, goal: Mapping[str, Any]) -> Iterator[Moment]:
    at, cancel, count = recorded.since_start_s, goal.get("cancel"), goal.get("feedback_count", 0)
    if count:
        first_s, last_s = at(goal["first_feedback_ns"]), at(goal["last_feedback_ns"])
        yield Moment("feedback", first_s, f"feedback on {step.label or 'the goal'}", f"{count} messages", last_s)
    if cancel:
        agreed = {True: "accepted", False: "refused"}.get(cancel["accepted"], "no answer")
        text = f"{step.label or 'the goal'} is to be cancelled"
        yield Moment("cancel", at(cancel["sent_ns"]), text, agreed)


def _of_states(recorded: Recorded) -> Iterator[Lane]:
    """Return a lane for each lifecycle node: the states that it reported before and after each transition."""
    changes: dict[str, list[StepRun]] = {}
    for step in recorded.record.steps:
        if step.kind == "change_state" and "called_ns" in step.result:
            changes.setdefault(str(step.result.get("node", "")), []).append(step)
    for node, steps in list(changes.items())[:_MOST_LANES]:
        starts_ns = [steps[0].started_ns, *(step.result["answered_ns"] for step in steps)]
        ends_ns = [*(step.result["called_ns"] for step in steps), recorded.record.ended_ns]
        states = [steps[0].result["before"], *(step.result["after"] for step in steps)]
        yield Lane(
            node,
            "state",
            tuple(
                Moment(
                    "state", recorded.since_start_s(start_ns), f"{node} is {state}", "", recorded.since_start_s(end_ns)
                )
                for state, start_ns, end_ns in zip(states, starts_ns, ends_ns, strict=True)
            ),
        )


# -- topics ------------------------------------------------------------------------------------


def _of_topics(recorded: Recorded) -> Iterator[Lane]:
    """Return a lane for each topic that is not hidden or every node's, those first that the steps wait for."""
    infos = {info.topic: info for info in sorted(recorded.bag.topics, key=lambda info: info.count)}
    names = dict.fromkeys([*infos, *(s.endpoint.topic for s in recorded.sightings)])
    plain = [name for name in names if name not in _STANDARD and "/_" not in name]
    lanes = (Lane(name, "", tuple(_of_topic(recorded, name, infos.get(name)))) for name in plain)
    shown = [lane for lane in lanes if lane.moments]
    shown.sort(key=lambda lane: (lane.name not in recorded.awaited, lane.moments[0].start_s, lane.name))
    yield from shown[:_MOST_LANES]


def _of_topic(recorded: Recorded, topic: str, info: TopicInfo | None) -> Iterator[Moment]:
    for kind in ("publisher", "subscription"):
        seen = [s for s in recorded.sightings if s.endpoint.topic == topic and s.endpoint.kind == kind]
        nodes = ", ".join(dict.fromkeys(s.endpoint.node for s in seen))
        if seen:
            start_s = recorded.since_start_s(min(s.start_ns for s in seen))
            yield Moment("found", start_s, f"{kind} of {topic} is in the graph", nodes)
    if info is not None and info.count:
        yield from _traffic(topic, recorded.seconds(recorded.bag.received_ns(topic, info.topic_type)))


def _traffic(topic: str, times_s: Any) -> Iterator[Moment]:
    """Return the first message, and the spans between silences."""
    yield Moment("first", float(times_s[0]), f"first message on {topic}")
    gaps_s = np.diff(times_s)
    limit_s = max(_SILENT_S, _SILENT_INTERVALS * float(np.median(gaps_s))) if len(gaps_s) else _SILENT_S
    for part in np.split(times_s, np.flatnonzero(gaps_s > limit_s) + 1):
        length_s = float(part[-1] - part[0])
        rate = f", {short((len(part) - 1) / length_s)} Hz" if length_s > 0 and len(part) > 2 else ""
        count = f"{len(part)} message{'s' if len(part) > 1 else ''}"
        yield Moment("traffic", float(part[0]), f"{topic}: {count}{rate}", end_s=float(part[-1]))
