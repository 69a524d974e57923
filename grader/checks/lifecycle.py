"""Check of a lifecycle node: the states that it reaches, and what it publishes in which."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from grader.checks.answers import unanswered
from grader.checks.base import Context, Part, cpu_delay_doubt, of_parts, unexplained, weighed
from grader.evidence.cpu_delay import Span
from grader.lab import references as ref
from grader.lab.references import LifecycleState, Parameters, Share
from grader.recording.session import StepRun
from grader.result import Finding


class WantedTransition(Parameters):
    """What becomes of a transition that a step asks for."""

    step: ref.TransitionLabel
    state: LifecycleState = Field(description="The state afterwards.")
    succeeds: bool = Field(True, description="Whether the node is to report success.")


class PublishedIn(Parameters):
    """A topic on which something is published in some states, and nothing in the others."""

    topic: ref.Topic
    states: tuple[LifecycleState, ...] = Field(("active",), min_length=1)
    at_least: int = Field(1, ge=1, description="So many messages, each time it is in such a state.")


class Lifecycle(Parameters):
    """A lifecycle node reaches the states that it is asked for, and publishes in the right ones only."""

    process: ref.Process
    transitions: tuple[WantedTransition, ...] = Field(min_length=1)
    published: tuple[PublishedIn, ...] = ()
    transitions_share: Share = Field(
        0.5, description="What the transitions count, where publishing is judged too."
    )
    everywhere_credit: Share = Field(
        0.25, description="Credit of a topic on which it publishes in every state."
    )


@dataclass(frozen=True)
class _Stay:
    """A time in which the node was in a state, from the answer to a transition to the next request."""

    state: str
    span: Span


def lifecycle(context: Context, p: Lifecycle) -> Finding:
    """Judge the transitions by the node's answers, and what it published by when it was published."""
    expected = ", ".join(
        f"{w.step} → {w.state}{'' if w.succeeds else ' (refused)'}" for w in p.transitions
    )
    steps = [context.session.step(wanted.step) for wanted in p.transitions]
    silent = [unanswered(context, step, expected) for step in steps]
    if None not in silent and silent[0] is not None:
        return silent[0]
    went = [
        _transition(context, wanted, step)
        for wanted, step in zip(p.transitions, steps, strict=True)
    ]
    for n, step in enumerate(steps[1:], 1):
        # From another state than it was to reach, a transition proves nothing; that has cost points before.
        if (
            step is not None
            and went[n].share < 1
            and step.result.get("before") != p.transitions[n - 1].state
        ):
            went[n] = Part(0.0, f"{p.transitions[n].step}: not tested")
    stays = _stays(context, {step.result.get("node") for step in steps if step is not None})
    published = [_published(context, p, of, stays) for of in p.published]
    parts = weighed(went, p.transitions_share if published else 1.0)
    parts += weighed(published, 1 - p.transitions_share) if published else []
    finding = of_parts(expected, parts, where=(context.location(),))
    return unexplained(finding) if any(silent) else finding


def _transition(context: Context, wanted: WantedTransition, step: StepRun | None) -> Part:
    """Judge the state after a transition, and whether the node reported success."""
    if step is None or step.outcome != "done":
        return Part(0.0, f"{wanted.step}: no answer", f"The node did not answer '{wanted.step}'.")
    after, succeeded = str(step.result.get("after")), step.result.get("success")
    text = f"{wanted.step} → {after}{'' if succeeded else ' (refused)'}"
    if after == wanted.state and succeeded == wanted.succeeds:
        return Part(1.0, text)
    reason = f"After '{wanted.step}' the node is {after}, not {wanted.state}."
    if after == wanted.state:
        reason = f"The node is {after} after '{wanted.step}', but reports {'success' if succeeded else 'failure'}."
    if wanted.succeeds and _raised(context, step):
        return Part(0.0, text, f"{reason} {_RAISED}", hint=_RAISED_HINT)
    return Part(0.0, text, reason, hint=_FAILURE_HINT if wanted.succeeds and not succeeded else "")


_RAISED = "Its callback raised an exception or returned ERROR."
_RAISED_HINT = "rclpy hides an exception in a transition callback: wrap the callback's body in try, and log the error."
_FAILURE_HINT = (
    "End the callback with `return TransitionCallbackReturn.SUCCESS`, or that of super()."
)


def _raised(context: Context, step: StepRun) -> bool:
    """Whether the node told of processing an error while a transition was under way."""
    topic = f"{step.result.get('node')}/transition_event"
    stream, goals = context.session.stream(topic), context.session.texts(topic, "goal_state.label")
    during = (stream.source_ns >= step.started_ns) & (stream.source_ns <= step.ended_ns)
    return any(
        goal == "errorprocessing" for goal, inside in zip(goals, during, strict=True) if inside
    )


def _stays(context: Context, nodes: set[Any]) -> list[_Stay]:
    """Return a node's times in each state by its answers to all transitions; where two disagree, it is not known."""
    record = context.session.record
    answered = [
        step.result
        for step in record.steps
        if step.kind == "change_state" and step.outcome == "done"
    ]
    steps = [result for result in answered if result["node"] in nodes]
    if not steps:
        return []
    begins = [
        (steps[0]["before"], record.started_ns),
        *((step["after"], step["answered_ns"]) for step in steps),
    ]
    ends = [
        *((step["before"], step["called_ns"]) for step in steps),
        (steps[-1]["after"], record.ended_ns),
    ]
    pairs = zip(begins, ends, strict=True)
    return [
        _Stay(state, Span(start_ns, end_ns))
        for (state, start_ns), (same, end_ns) in pairs
        if state == same
    ]


#: A message that was under way to be sent when the state changed may be stamped so much later.
_UNDER_WAY_NS = 50_000_000


def _published(context: Context, p: Lifecycle, of: PublishedIn, stays: list[_Stay]) -> Part:
    """Judge on how much was published in each state."""
    source_ns = np.sort(context.session.stream(of.topic).source_ns)
    counted: dict[str, int] = {}
    few, stray = dict[Span, int](), dict[Span, str]()
    for stay in stays:
        wanted = stay.state in of.states
        begin_ns = stay.span.start_ns + (0 if wanted else _UNDER_WAY_NS)
        inside = source_ns[(source_ns > begin_ns) & (source_ns <= stay.span.end_ns)]
        counted[stay.state] = counted.get(stay.state, 0) + len(inside)
        if wanted and len(inside) < of.at_least:
            few[stay.span] = len(inside)
        elif not wanted and len(inside):
            stray[Span(stay.span.start_ns, int(inside[-1]))] = stay.state
    text = f"{of.topic}: " + ", ".join(
        f"{number} messages while {state}" for state, number in counted.items()
    )
    if not counted.keys() & set(of.states):
        return Part(0.0, text)
    if few:
        reason = f"On {of.topic} {min(few.values())} messages came while the node was {' or '.join(of.states)}."
        doubt = _late(context, p, few)
        return Part(0.0, text, reason, hint=_SILENT_HINT, best=1.0 if doubt else None, doubt=doubt)
    if stray:
        others = ", ".join(dict.fromkeys(stray.values()))
        reason = f"{of.topic} carries messages while the node is {others} too: {_EVERYWHERE}"
        doubt = _late(context, p, stray)
        best = 1.0 if doubt else None
        return Part(
            p.everywhere_credit, text, reason, hint=_EVERYWHERE_HINT, best=best, doubt=doubt
        )
    return Part(1.0, text)


_EVERYWHERE = "an ordinary publisher publishes in every state."
_EVERYWHERE_HINT = (
    "Make it with create_lifecycle_publisher(), or publish only while the node is active."
)
_SILENT_HINT = (
    "A lifecycle publisher publishes once on_activate() has returned super().on_activate(state); until then, and "
    "without that, publish() does nothing."
)


def _late(context: Context, p: Lifecycle, spans: Collection[Span]) -> str:
    """Say that the machine delayed the program for most of each of some times, if it did."""
    run = context.session.process(p.process)
    if run is None:
        return ""
    delays_s = [context.session.machine_delay_s(run, span) for span in spans]
    late = all(delay_s > span.duration_s / 2 for delay_s, span in zip(delays_s, spans, strict=True))
    return cpu_delay_doubt(sum(delays_s), sum(span.duration_s for span in spans)) if late else ""
