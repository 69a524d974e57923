"""Steps of a session and calls of services in the timeline."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from grader.evidence.recorded import Recorded
from grader.lab.steps import STEPS, CallStep, ObserveStep
from grader.lab.steps.base import Step, StepResult
from grader.lab.steps.call import CallResult
from grader.lab.steps.observe import ObserveResult
from grader.lab.steps.wait_for import WaitForResult
from grader.lab.steps.words import fields
from grader.recording.session import StepRun
from grader.report.figures.graph import Call
from grader.report.figures.svg import duration
from grader.report.timeline.moments import Lane, Moment


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
    if step.kind == CallStep.kind and CallResult.of(step).calls:
        return list(_calls(recorded, step))
    return [_span(recorded, step)]


def _span(recorded: Recorded, step: StepRun) -> Moment:
    """Return a step from its start to its end, or its window while this was open."""
    window = ObserveResult()
    if step.kind == ObserveStep.kind:
        window = ObserveResult.of(step)
    opened_ns, closed_ns = window.opened_ns, window.closed_ns
    style = "step"
    if opened_ns:
        style = "window"
    elif step.kind.startswith("wait"):
        style = "wait"
    start_s = recorded.since_start_s(opened_ns or step.started_ns)
    end_ns = closed_ns or step.ended_ns or recorded.record.ended_ns
    end_s = recorded.since_start_s(end_ns)
    text = _described(step) + _label(step)
    failed = step.outcome != "done"
    return Moment(style, start_s, text, _note(step), end_s, failed)


def _label(step: StepRun) -> str:
    """Return a step's own label in parentheses, if it has one."""
    if not step.label:
        return ""
    words = step.label.replace("_", " ")
    return f" ({words})"


def _described(step: StepRun) -> str:
    """Describe a step in a few words."""
    model = STEPS.get(step.kind)
    if model is None:
        return step.kind
    try:
        return model.given(step).describe()
    except (KeyError, ValueError, TypeError):
        # At the time of the recording the step had other parameters.
        return step.kind


# -- outcomes ----------------------------------------------------------------------------------


def _note(step: StepRun) -> str:
    """Describe the outcome of a step."""
    outcomes = {"done": "", "timeout": "gave up waiting"}
    model = STEPS.get(step.kind, Step)
    result = model.result.of(step)
    outcome = outcomes.get(step.outcome, step.outcome)
    notes = [outcome, result.problem, _alias(step, result), result.note()]
    return "; ".join(filter(None, notes))


def _alias(step: StepRun, result: StepResult) -> str:
    """Describe another name under which a step found its object."""
    if not isinstance(result, WaitForResult):
        return ""
    if result.name is None or result.name in step.parameters.values():
        return ""
    return f"found as {result.name}"


# -- calls -------------------------------------------------------------------------------------


def _calls(recorded: Recorded, step: StepRun) -> Iterator[Moment]:
    """Yield the calls of a step; consecutive calls with the same answer are one moment."""
    result = CallResult.of(step)
    calls = [Call.of(recorded, call) for call in result.calls]
    request = fields(CallStep.given(step).request) or "an empty request"
    text = f"calling {result.service} with {request}{_label(step)}"
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
