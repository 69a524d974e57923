"""Check of a lifecycle node: the states that it reaches, and its messages in each state."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydantic import Field

from grader.checks.answers import unanswered
from grader.checks.base import Context, Part, of_parts, unexplained, weighed
from grader.evidence import bounds
from grader.evidence.cpu_delay import Span
from grader.lab import references as ref
from grader.lab.references import LifecycleState, Parameters, Share
from grader.lab.steps.change_state import ChangeStateResult, ChangeStateStep
from grader.recording.session import StepRun
from grader.result import Finding


class WantedTransition(Parameters):
    """The wanted result of a transition that a step asks for."""

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
    """A time in one state, from the answer to a transition to the next request."""

    state: str
    span: Span


def lifecycle(context: Context, p: Lifecycle) -> Finding:
    """Judge the transitions by the node's answers, and its messages by their times."""
    expected = ", ".join(map(_wanted_words, p.transitions))
    steps = [context.session.step(wanted.step) for wanted in p.transitions]
    silent = [unanswered(context, step, expected) for step in steps]
    if None not in silent and silent[0] is not None:
        return silent[0]
    nodes = {ChangeStateResult.of(step).node for step in steps if step is not None}
    stays = _stays(context, nodes)
    published = [_published(context, p, of, stays) for of in p.published]
    parts = weighed(_transitions(context, p, steps), p.transitions_share if published else 1.0)
    if published:
        parts += weighed(published, 1 - p.transitions_share)
    finding = of_parts(expected, parts, where=(context.location(),))
    return unexplained(finding) if any(silent) else finding


def _wanted_words(wanted: WantedTransition) -> str:
    refused = "" if wanted.succeeds else " (refused)"
    return f"{wanted.step} → {wanted.state}{refused}"


def _transitions(context: Context, p: Lifecycle, steps: Sequence[StepRun | None]) -> list[Part]:
    """Judge all transitions.

    A failed transition proves nothing if it began in another state than the previous one should
    have reached. The previous one has cost the points.
    """
    parts = []
    previous = None
    for wanted, step in zip(p.transitions, steps, strict=True):
        part = _transition(context, wanted, step)
        if previous is not None and step is not None and part.share < 1:
            if ChangeStateResult.of(step).before != previous.state:
                part = Part(0.0, f"{wanted.step}: not tested")
        parts.append(part)
        previous = wanted
    return parts


def _transition(context: Context, wanted: WantedTransition, step: StepRun | None) -> Part:
    """Judge the state after a transition, and whether the node reported success."""
    if step is None or step.outcome != "done":
        return Part(0.0, f"{wanted.step}: no answer", f"The node did not answer '{wanted.step}'.")
    result = ChangeStateResult.of(step)
    after, succeeded = str(result.after), result.success
    refused = "" if succeeded else " (refused)"
    text = f"{wanted.step} → {after}{refused}"
    if after == wanted.state and succeeded == wanted.succeeds:
        return Part(1.0, text)
    reason = f"After '{wanted.step}' the node is {after}, not {wanted.state}."
    if after == wanted.state:
        reported = "success" if succeeded else "failure"
        reason = f"The node is {after} after '{wanted.step}', but reports {reported}."
    if not wanted.succeeds:
        return Part(0.0, text, reason)
    if _raised(context, step):
        return Part(0.0, text, f"{reason} {_RAISED}", hint=_RAISED_HINT)
    return Part(0.0, text, reason, hint="" if succeeded else _FAILURE_HINT)


_RAISED = "Its callback raised an exception or returned ERROR."
_RAISED_HINT = "rclpy hides an exception in a transition callback: wrap the callback's body in try, and log the error."
_FAILURE_HINT = (
    "End the callback with `return TransitionCallbackReturn.SUCCESS`, or that of super()."
)


def _raised(context: Context, step: StepRun) -> bool:
    """Tell whether the node reported that it processed an error during a transition."""
    topic = f"{ChangeStateResult.of(step).node}/transition_event"
    source_ns = context.session.stream(topic).source_ns.tolist()
    goals = context.session.texts(topic, "goal_state.label")
    for t_ns, goal in zip(source_ns, goals, strict=True):
        if goal == "errorprocessing" and step.started_ns <= t_ns <= step.ended_ns:
            return True
    return False


def _stays(context: Context, nodes: set[Any]) -> list[_Stay]:
    """Return a node's times in each state, by its answers to all transitions.

    The state is not known between two answers that disagree.
    """
    record = context.session.record
    changes = []
    for step in record.steps:
        if step.kind == ChangeStateStep.kind and step.outcome == "done":
            change = ChangeStateResult.of(step)
            if change.node in nodes:
                changes.append(change)
    if not changes:
        return []
    stays = []
    state = str(changes[0].before)
    start_ns = record.started_ns
    for change in changes:
        if change.before == state:
            stays.append(_Stay(state, Span(start_ns, change.called_ns)))
        state = str(change.after)
        start_ns = change.answered_ns
    stays.append(_Stay(state, Span(start_ns, record.ended_ns)))
    return stays


#: Latest stamp of a message of the old state, after a change of state, in ns.
_UNDER_WAY_NS = 50_000_000


@dataclass
class _Counted:
    """Messages of a topic in each state."""

    #: Number of messages by state.
    messages: dict[str, int] = field(default_factory=dict)
    #: Number of messages in each stay with too few.
    few: dict[Span, int] = field(default_factory=dict)
    #: State of each stay with messages that should not be there, up to the last of these.
    stray: dict[Span, str] = field(default_factory=dict)

    def text(self, topic: str) -> str:
        """State the numbers of messages."""
        numbers = [f"{number} messages while {state}" for state, number in self.messages.items()]
        return f"{topic}: {', '.join(numbers)}"


def _count(context: Context, of: PublishedIn, stays: Sequence[_Stay]) -> _Counted:
    """Count the messages of a topic in each state."""
    source_ns = np.sort(context.session.stream(of.topic).source_ns)
    counted = _Counted()
    for stay in stays:
        is_wanted = stay.state in of.states
        begin_ns = stay.span.start_ns
        if not is_wanted:
            begin_ns += _UNDER_WAY_NS
        inside = source_ns[(source_ns > begin_ns) & (source_ns <= stay.span.end_ns)]
        number = len(inside)
        counted.messages[stay.state] = counted.messages.get(stay.state, 0) + number
        if is_wanted and number < of.at_least:
            counted.few[stay.span] = number
        elif not is_wanted and number:
            counted.stray[Span(stay.span.start_ns, int(inside[-1]))] = stay.state
    return counted


def _published(context: Context, p: Lifecycle, of: PublishedIn, stays: Sequence[_Stay]) -> Part:
    """Judge the number of messages in each state."""
    counted = _count(context, of, stays)
    text = counted.text(of.topic)
    if not counted.messages.keys() & set(of.states):
        return Part(0.0, text)
    if counted.few:
        fewest = min(counted.few.values())
        states = " or ".join(of.states)
        reason = f"On {of.topic} {fewest} messages came while the node was {states}."
        part = Part(0.0, text, reason, hint=_SILENT_HINT)
        return _doubted(context, p, part, counted.few)
    if counted.stray:
        others = ", ".join(dict.fromkeys(counted.stray.values()))
        reason = f"{of.topic} carries messages while the node is {others} too: {_EVERYWHERE}"
        part = Part(p.everywhere_credit, text, reason, hint=_EVERYWHERE_HINT)
        return _doubted(context, p, part, counted.stray)
    return Part(1.0, text)


def _doubted(context: Context, p: Lifecycle, part: Part, spans: Collection[Span]) -> Part:
    """Return a part that may earn all if the machine delayed the program for most of each span."""
    run = context.session.process(p.process)
    delays = []
    for span in spans:
        delays.append(bounds.delay_of(context.session, run, span))
    possible = bounds.absence(_MOST, *delays)
    return replace(part, best=max(part.share, possible.high), doubt=possible.why)


#: Share of a span that is most of it.
_MOST = 0.5

_EVERYWHERE = "an ordinary publisher publishes in every state."
_EVERYWHERE_HINT = (
    "Make it with create_lifecycle_publisher(), or publish only while the node is active."
)
_SILENT_HINT = (
    "A lifecycle publisher publishes once on_activate() has returned super().on_activate(state); until then, and "
    "without that, publish() does nothing."
)
