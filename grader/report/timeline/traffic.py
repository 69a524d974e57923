"""Actions, lifecycle states and topics in the timeline."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from grader.evidence.recorded import Floats, Recorded
from grader.lab.steps.change_state import ChangeStateResult, ChangeStateStep
from grader.lab.steps.send_goal import GoalRecord, SendGoalResult, SendGoalStep
from grader.lab.steps.words import fields
from grader.recording.session import StepRun
from grader.report.figures.svg import short
from grader.report.timeline.moments import MOST_LANES, Lane, Moment, stacked

#: Least silence of a topic, as a multiple of its usual interval, and in s.
_SILENT_INTERVALS, _SILENT_S = 8, 0.25
#: Topics of every node.
_STANDARD_TOPICS = ("/rosout", "/parameter_events")


# -- actions -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Goal:
    """A goal that a step sent."""

    step: StepRun
    record: GoalRecord

    def moment(self, recorded: Recorded) -> Moment:
        """Return the time from sending to the result."""
        start_s = recorded.since_start_s(self.record.sent_ns)
        end_s = recorded.since_start_s(self._end_ns())
        text = f"{self.step.label or 'goal'}: {fields(self.record.goal)}"
        style = "goal-silent" if self.silent else "goal"
        return Moment(style, start_s, text, self._note(), end_s, self.silent)

    @property
    def silent(self) -> bool:
        """True for a goal without a result that was not rejected."""
        return self.record.accepted is not False and not self.record.ended_ns

    def _end_ns(self) -> int:
        """Return the time of the result, of the end of waiting, or of the rejection."""
        if self.record.ended_ns:
            return self.record.ended_ns
        if self.silent:
            return self.step.ended_ns
        return self.record.answer_ns

    def _note(self) -> str:
        """Describe answer, status and result."""
        accepted = self.record.accepted
        status = self.record.status if self.record.ended_ns else "no result"
        note = "rejected"
        if accepted:
            note = f"accepted, {status}"
        elif accepted is None:
            note = "not answered"
        if self.record.result is not None:
            result = fields(self.record.result)
            if result:
                note += f": {result}"
        return note

    def beside(self, recorded: Recorded) -> Iterator[Moment]:
        """Yield feedback and cancelling."""
        goal = self.step.label or "the goal"
        count = self.record.feedback_count
        if count:
            first_ns, last_ns = self.record.feedback_span_ns
            first_s, last_s = recorded.since_start_s(first_ns), recorded.since_start_s(last_ns)
            yield Moment("feedback", first_s, f"feedback on {goal}", f"{count} messages", last_s)
        cancel = self.record.cancel
        if cancel:
            answers = {True: "accepted", False: "refused"}
            answer = "no answer"
            if cancel.accepted is not None:
                answer = answers[cancel.accepted]
            at_s = recorded.since_start_s(cancel.sent_ns)
            yield Moment("cancel", at_s, f"{goal} is to be cancelled", answer)


def lanes_of_actions(recorded: Recorded) -> Iterator[Lane]:
    """Yield lanes for each action: its goals, and below them feedback and cancelling."""
    sent: dict[str, list[_Goal]] = {}
    for step in recorded.record.steps:
        if step.kind == SendGoalStep.kind:
            action = SendGoalStep.given(step).action
            for record in SendGoalResult.of(step).goals:
                sent.setdefault(action, []).append(_Goal(step, record))
    for action, goals in itertools.islice(sent.items(), MOST_LANES):
        yield from stacked(action, "goals", [goal.moment(recorded) for goal in goals])
        beside: list[Moment] = []
        for goal in goals:
            beside += goal.beside(recorded)
        yield Lane(action, "feedback", beside)


# -- states ------------------------------------------------------------------------------------


def lanes_of_states(recorded: Recorded) -> Iterator[Lane]:
    """Yield a lane for each lifecycle node: its states before and after each transition."""
    changes: dict[str, list[_Change]] = {}
    for step in recorded.record.steps:
        if step.kind == ChangeStateStep.kind:
            result = ChangeStateResult.of(step)
            if result.called_ns:
                changes.setdefault(result.node or "", []).append((step, result))
    for node, steps in itertools.islice(changes.items(), MOST_LANES):
        yield Lane(node, "state", list(_states(recorded, node, steps)))


#: A step that asked for a transition, and its result.
_Change = tuple[StepRun, ChangeStateResult]


def _states(recorded: Recorded, node: str, changes: Sequence[_Change]) -> Iterator[Moment]:
    """Yield the states of a node, each up to the answer to the next transition."""
    first, result = changes[0]
    state = result.before
    begin_s = recorded.since_start_s(first.started_ns)
    for _, result in changes:
        end_s = recorded.since_start_s(result.answered_ns)
        yield Moment("state", begin_s, f"{node} is {state}", end_s=end_s)
        state = result.after
        begin_s = end_s
    end_s = recorded.since_start_s(recorded.record.ended_ns)
    yield Moment("state", begin_s, f"{node} is {state}", end_s=end_s)


# -- topics ------------------------------------------------------------------------------------


def lanes_of_topics(recorded: Recorded) -> list[Lane]:
    """Return a lane for each topic that is neither hidden nor standard, first those awaited by steps."""
    types = {}
    for info in sorted(recorded.bag.topics, key=lambda info: info.count):
        types[info.topic] = info.topic_type
    seen = [sighting.endpoint.topic for sighting in recorded.sightings]
    lanes = []
    for name in dict.fromkeys([*types, *seen]):
        if name not in _STANDARD_TOPICS and "/_" not in name:
            moments = list(_of_topic(recorded, name, types.get(name, "")))
            lanes.append(Lane(name, "", moments))

    def rank(lane: Lane) -> tuple[bool, float, str]:
        return lane.name not in recorded.awaited, lane.moments[0].start_s, lane.name

    lanes = [lane for lane in lanes if lane.moments]
    return sorted(lanes, key=rank)[:MOST_LANES]


def _of_topic(recorded: Recorded, topic: str, topic_type: str) -> Iterator[Moment]:
    """Yield the endpoints of a topic, its first message, and the times of traffic between silences."""
    for kind in ("publisher", "subscription"):
        yield from _endpoints(recorded, topic, kind)
    times_s = recorded.seconds(recorded.bag.received_ns(topic, topic_type))
    if len(times_s):
        yield Moment("first", float(times_s[0]), f"first message on {topic}")
        for part_s in _between_silences(times_s):
            text = f"{topic}: {_counted(part_s)}"
            yield Moment("traffic", float(part_s[0]), text, end_s=float(part_s[-1]))


def _endpoints(recorded: Recorded, topic: str, kind: str) -> Iterator[Moment]:
    """Yield the first time that publishers or subscriptions of a topic are in the graph."""
    nodes = []
    seen_ns = []
    for sighting in recorded.sightings:
        endpoint = sighting.endpoint
        if endpoint.topic == topic and endpoint.kind == kind:
            nodes.append(endpoint.node)
            seen_ns.append(sighting.start_ns)
    if seen_ns:
        start_s = recorded.since_start_s(min(seen_ns))
        note = ", ".join(dict.fromkeys(nodes))
        yield Moment("found", start_s, f"{kind} of {topic} is in the graph", note)


def _between_silences(times_s: Floats) -> list[Floats]:
    """Split the times of messages at long gaps."""
    gaps_s = np.diff(times_s)
    limit_s = _SILENT_S
    if len(gaps_s):
        usual_s = float(np.median(gaps_s))
        limit_s = max(_SILENT_S, _SILENT_INTERVALS * usual_s)
    return np.split(times_s, np.flatnonzero(gaps_s > limit_s) + 1)


def _counted(times_s: Floats) -> str:
    """Write the number and rate of messages: `1 message`, `500 messages, 100 Hz`."""
    count = len(times_s)
    if count < 2:
        return f"{count} message"
    words = f"{count} messages"
    length_s = float(times_s[-1] - times_s[0])
    if count > 2 and length_s > 0:
        words += f", {short((count - 1) / length_s)} Hz"
    return words
