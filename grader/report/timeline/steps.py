"""Steps of a session and calls of services in the timeline."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from grader.evidence.recorded import Recorded
from grader.lab.steps import STEPS
from grader.recording.session import StepRun
from grader.report.figures.graph import Call
from grader.report.figures.svg import duration
from grader.report.timeline.moments import Lane, Moment
from grader.report.views import fields


def lanes_of_steps(recorded: Recorded) -> Iterator[Lane]:
    """Yield a lane of the steps, and one of those beside them, which are measurements on a bad link."""
    steps: list[Moment] = []
    links: list[Moment] = []
    for step in recorded.record.steps:
        lane = links if step.kind == "link" else steps
        lane += _moments_of(recorded, step)
    yield Lane("steps", "the lab", steps)
    yield Lane("bad link", "the lab", links)


def _moments_of(recorded: Recorded, step: StepRun) -> list[Moment]:
    """Return the calls of a step, or else the step as one moment."""
    if step.result.get("calls"):
        return list(_calls(recorded, step))
    return [_span(recorded, step)]


def _span(recorded: Recorded, step: StepRun) -> Moment:
    """Return a step from its start to its end, or its window while this was open."""
    opened_ns = step.result.get("opened_ns")
    closed_ns = step.result.get("closed_ns")
    style = "step"
    if opened_ns:
        style = "window"
    elif step.kind.startswith("wait"):
        style = "wait"
    start_s = recorded.since_start_s(opened_ns or step.started_ns)
    end_s = recorded.since_start_s(closed_ns or step.ended_ns or recorded.record.ended_ns)
    text = _described(step) + _label(step)
    return Moment(style, start_s, text, _note(step), end_s, step.outcome != "done")


def _label(step: StepRun) -> str:
    """Return a step's own label in parentheses, if it has one."""
    if not step.label:
        return ""
    return f" ({step.label})"


def _described(step: StepRun) -> str:
    """Describe a step in a few words."""
    model = STEPS.get(step.kind)
    if model is None:
        return step.kind
    try:
        return model.model_construct(**step.parameters).describe()
    except (KeyError, ValueError, TypeError):
        # At the time of the recording the step had other parameters.
        return step.kind


# -- outcomes ----------------------------------------------------------------------------------


def _note(step: StepRun) -> str:
    """Describe the outcome of a step."""
    outcomes = {"done": "", "timeout": "not in time"}
    notes = [
        outcomes.get(step.outcome, step.outcome),
        str(step.result.get("problem", "")),
        _alias(step),
    ]
    result_of = _RESULTS.get(step.kind)
    if result_of is not None:
        notes.append(result_of(step.result))
    return "; ".join(filter(None, notes))


def _alias(step: StepRun) -> str:
    """Describe another name under which a step found its object."""
    name = step.result.get("name")
    if not isinstance(name, str) or name in step.parameters.values():
        return ""
    return f"found as {name}"


def _started(result: Mapping[str, Any]) -> str:
    if result.get("started") is False:
        return "it was running"
    return ", ".join(result.get("processes", ()))


def _published(result: Mapping[str, Any]) -> str:
    if result.get("matched", True):
        return ""
    return "no subscription was matched"


def _parameters_read(result: Mapping[str, Any]) -> str:
    values = {}
    for name, held in result.get("values", {}).items():
        if held:
            values[name] = held.get("value")
    return fields(values)


def _parameters_set(result: Mapping[str, Any]) -> str:
    if not result.get("refused"):
        return ""
    return f"refused: {fields(result['refused'])}"


def _state_changed(result: Mapping[str, Any]) -> str:
    return " → ".join(str(result[key]) for key in ("before", "after") if key in result)


def _planned(result: Mapping[str, Any]) -> str:
    return str(result.get("plan", {}).get("problem") or "")


#: Description of a step's result, by its kind.
_RESULTS: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "start": _started,
    "publish": _published,
    "get_parameters": _parameters_read,
    "set_parameters": _parameters_set,
    "change_state": _state_changed,
    "plan": _planned,
}


# -- calls -------------------------------------------------------------------------------------


def _calls(recorded: Recorded, step: StepRun) -> Iterator[Moment]:
    """Yield the calls of a step; consecutive calls with the same answer are one moment."""
    calls = [Call.of(recorded, call) for call in step.result["calls"]]
    request = fields(step.parameters.get("request", {})) or "an empty request"
    text = f"calling {step.result.get('service', '')} with {request}{_label(step)}"
    for (style, _), alike in itertools.groupby(calls, key=_likeness):
        group = list(alike)
        end_s = max(call.end_s for call in group)
        silent = style == "call-silent"
        yield Moment(style, group[0].start_s, text, _answers(group), end_s, silent)


def _likeness(call: Call) -> tuple[str, str]:
    """Return the common facts of calls with the same answer."""
    style, _ = call.key
    return style, str(call.response)


def _answers(calls: Sequence[Call]) -> str:
    """Describe equal answers: `success: true, after 2 ms`, `3 times: no answer, after at most 5 s`."""
    answer = "no answer"
    if calls[0].response is not None:
        answer = fields(calls[0].response) or "an empty answer"
    slowest = duration(max(call.latency_s for call in calls))
    if len(calls) == 1:
        return f"{answer}, after {slowest}"
    return f"{len(calls)} times: {answer}, after at most {slowest}"
