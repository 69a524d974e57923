"""The action of the step `send_goal`: a goal, perhaps cancelled or followed by a newer one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grader.lab.steps.base import Answer
from grader.lab.steps.send_goal import SendGoalResult, SendGoalStep
from grader.live.ros_node.filling import fields_in, filled
from grader.live.ros_node.goals import GoalSeries
from grader.live.ros_node.probe import BRIEFLY_S, MATCH_S, Cancelled, Probe, offered_type

#: Time in s until the other side knows a subscription that is matched on this side, which no one reports.
_KNOWN_S = 0.1


def send_goal(probe: Probe, step: SendGoalStep) -> Answer:
    """Send the goals, and wait until everything has been answered."""
    name = probe.name(step.action)
    kind = offered_type(probe.watch.last.actions, name, step.type)
    action = probe.action(name, kind)
    if not probe.until_up(name, lambda: action.ready, min(step.timeout_s, BRIEFLY_S)):
        return Answer("timeout", SendGoalResult("the action server is not up", name, kind))
    feedback, feedback_type = f"{name}/_action/feedback", f"{kind}_FeedbackMessage"
    probe.until(lambda: probe.recorder.matched(feedback, feedback_type), MATCH_S)
    probe.wait(_KNOWN_S)
    timeout_s = step.timeout_s
    if name in probe.silent:
        timeout_s = min(timeout_s, BRIEFLY_S)
    goals = [_goal(action.type.Goal, step.goal)]
    if step.newer_goal is not None:
        goals.append(_goal(action.type.Goal, step.newer_goal))
    series = GoalSeries(action, step, timeout_s, *goals)
    try:
        # The series has a deadline of its own.
        probe.until(series.advance, 2 * timeout_s, wait=probe.spin)
    except Cancelled:
        series.outcome = "cancelled"
    records = series.finish()
    if records[0].accepted is None:
        probe.silent.add(name)
    result = SendGoalResult(action=name, type=kind, goals=records, held_up_ns=series.held_up_ns)
    return Answer(series.outcome, result)


def _goal(goal_type: Any, values: Mapping[str, Any]) -> Any:
    """Return a goal; raises DoesNotFit if the type has none of the fields, since another goal would be sent."""
    known = fields_in(goal_type, values)
    return filled(goal_type, known or values)
