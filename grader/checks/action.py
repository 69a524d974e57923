"""The check of a node that serves an action: its offer, the goals accepted and rejected, and their ends.

The evidence comes from the grader's own goals.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from grader.checks.base import (
    Context,
    Part,
    apart,
    not_reached,
    of_parts,
    quantise,
    unexplained,
)
from grader.checks.endpoints import OfEndpoint, claim_of, claimed_at
from grader.checks.service import THEN_THESE, not_asked, shown
from grader.evidence import bounds
from grader.evidence.bounds import Delayed, Interval
from grader.evidence.cpu_delay import Span
from grader.evidence.fields import equal_within, value_at
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.lab.steps.send_goal import GoalRecord, SendGoalResult, SendGoalStep
from grader.recording.session import ServiceEndpoint, StepRun
from grader.result import Finding, Location

Status = Literal["succeeded", "aborted", "canceled"]
_FeedbackField = Annotated[str, ref.fields_of_type("_Feedback", "step")]


class ActionPart(Parameters):
    """A part of the demands on an action's server."""

    weight: float = Field(1.0, gt=0, description="How much it counts beside the other parts.")


class OfGoal(ActionPart):
    """A part that one goal shows."""

    step: ref.GoalLabel = Field(description="The step that sends the goal.")


class FeedbackWanted(OfGoal):
    """What is asked of the feedback."""

    at_least: int = Field(1, ge=1, description="Messages.")
    at_least_hz: float | None = Field(None, gt=0)
    hz_tolerance: Share = Field(0.05, description="By how much the rate may be lower.")
    rising: _FeedbackField | None = Field(
        None,
        description="Field with a number that never falls, or an array that never gets shorter.",
    )
    falling: _FeedbackField | None = Field(
        None,
        description="Field with a number that never rises, or an array that never gets longer.",
    )
    other_order_credit: Share = Field(0.5, description="Credit where that field goes another way.")


class ResultWanted(OfGoal):
    """Values in the result, all with the same weight."""

    values: Annotated[Mapping[str, Any], ref.fields_of_type("_Result", "step")] = Field(
        min_length=1
    )
    tolerance: float = Field(0.0, ge=0, description="By how much a number may differ.")


class StatusWanted(OfGoal):
    """The status of a goal at its end."""

    status: Status = "succeeded"


class CancelledWanted(OfGoal):
    """A goal ends soon after it was cancelled, as canceled."""

    within_s: float = Field(1.0, gt=0, description="How soon after it was asked for.")
    other_status_credit: Share = Field(
        0.5, description="Credit where it ends in time, but in another status."
    )
    late_credit: Share = Field(0.5, description="Credit where it ends in that status, but later.")


class PreemptedWanted(CancelledWanted):
    """A goal ends soon after a newer one was sent, which is carried out in its place, and succeeds."""

    status: tuple[Status, ...] = Field(("aborted", "canceled"), min_length=1)


class ActionServer(OfEndpoint):
    """A node serves an action; the parts that are given count by their weights."""

    example: ClassVar = {"accepted": {"step": "send_goal"}}

    artifact: ref.Artifact
    action: ref.RosName
    type: ref.ActionType
    offered: ActionPart | None = Field(None, description="Name, type and node.")
    accepted: OfGoal | None = Field(None, description="A goal that must be accepted.")
    rejected: OfGoal | None = Field(None, description="A goal that must be rejected.")
    feedback: FeedbackWanted | None = None
    result: ResultWanted | None = None
    final_status: StatusWanted | None = None
    cancelled: CancelledWanted | None = None
    preempted: PreemptedWanted | None = None

    @model_validator(mode="after")
    def _has_a_part(self) -> ActionServer:
        if not self.parts():
            raise ValueError(f"at least one of {', '.join(_PARTS)} is needed")
        return self

    def sought(self) -> Sequence[ref.Sought]:
        """Return the action."""
        return (ref.Sought("action", self.action, self.type),)

    def parts(self) -> dict[str, Any]:
        """Return the parts that are asked for, by their keys."""
        return {key: getattr(self, key) for key in _PARTS if getattr(self, key) is not None}


class _NotTested(Exception):
    """An earlier mistake, as a clause, keeps a part from being tested; the hint says how to fix it."""

    def __init__(self, why: str, hint: str = "") -> None:
        super().__init__(why)
        self.hint = hint


class _Nothing(Part):
    """A part without an answer; a crash, if there was one, explains it better."""


@dataclass(frozen=True)
class _Sent:
    """A goal of a step, and its course."""

    context: Context
    artifact: str
    step: StepRun
    record: GoalRecord

    @property
    def words(self) -> str:
        return f"goal {_shown(self.record.goal)}"

    @property
    def status(self) -> str:
        """The last that is known, as ROS spells it."""
        return str(self.record.status or "unknown").upper()

    @property
    def has_ended(self) -> bool:
        """True if the goal ended, by its published status if the result never came."""
        return self.record.ended_ns is not None or self.record.status in get_args(Status)

    @property
    def waited_s(self) -> float:
        """Time from sending the goal to the end of the step, in s."""
        return float(self.step.ended_ns - self.record.sent_ns) / 1e9

    def printed(self, text: str) -> bool:
        """Return whether the program's output has a text, which identifies a known mistake."""
        lines = self.context.session.output_of(self.artifact)
        return any(text in line.text for line in lines)

    def delayed(self, start_ns: int, end_ns: int) -> Delayed:
        """Return the machine's longest delay of a process in a span, including the sender of goals."""
        held_up_ns = SendGoalResult.of(self.step).held_up_ns
        return bounds.asking_delay(self.context.session, Span(start_ns, end_ns), held_up_ns)


def action_server(context: Context, p: ActionServer) -> Finding:
    """Judge an action's server by the graph, and by the course of the grader's goals."""
    asked: list[str] = []
    parts: list[Part] = []
    untested: dict[str, Part] = {}
    for key, wanted in p.parts().items():
        step = context.session.step(getattr(wanted, "step", ""))
        asked.append(_asked(p, key, wanted, step))
        try:
            found = _judged(context, p, key, wanted, step)
        except _NotTested as why:
            _add_untested(untested, why, wanted.weight)
        else:
            where = _where(context, p, key, step, found)
            parts.append(replace(found, weight=wanted.weight, where=where))
    expected = "; ".join(asked)
    if not parts and _is_charged(context):
        return not_reached(next(iter(untested)), expected=expected)
    parts += untested.values()
    finding = of_parts(expected, parts)
    if any(isinstance(part, _Nothing) for part in parts):
        return unexplained(finding)
    return finding


def _asked(p: ActionServer, key: str, wanted: ActionPart, step: StepRun | None) -> str:
    """Say what is expected of a part, with the goal of its step."""
    words, _ = _PARTS[key]
    text = words(p, wanted)
    if step is None:
        return text
    goal = SendGoalStep.given(step).goal
    return f"{text} (goal {_shown(goal)})"


def _judged(
    context: Context, p: ActionServer, key: str, wanted: ActionPart, step: StepRun | None
) -> Part:
    if key == "offered":
        return _offered(context, p)
    _, judge = _PARTS[key]
    sent = _sent(context, p, step)
    return judge(sent, wanted)


def _add_untested(untested: dict[str, Part], why: _NotTested, weight: float) -> None:
    """Add a part to the untested ones by reason; parts with one reason share an entry."""
    reason = f"Not tested, because {why}. {THEN_THESE}"
    if reason in untested:
        weight += untested[reason].weight
    untested[reason] = _Nothing(0.0, reason=reason, hint=why.hint, weight=weight)


def _is_charged(context: Context) -> bool:
    """Return whether a check of the same session took points; its own finding covers flakiness."""
    session = context.location().session
    for name, found in context.findings.items():
        is_here = any(place.session == session for place in found.where)
        if is_here and context.charged(name):
            return True
    return False


def _where(
    context: Context, p: ActionServer, key: str, step: StepRun | None, found: Part
) -> tuple[Location, ...]:
    """Point at the goal, and where something is lost that stands where the server is made, at that line."""
    span = None
    if step is not None:
        span = Span(step.started_ns, step.ended_ns)
    there = context.location(p.action, span)
    is_made_wrongly = found.share < 1 and key in ("offered", "accepted", "rejected")
    if not is_made_wrongly:
        return (there,)
    claim = claim_of(context, "action", p.action)
    return (*claimed_at(claim), there)


#: Characters that are shown of a value.
_MOST_SHOWN = 80


def _cut(text: str) -> str:
    if len(text) <= _MOST_SHOWN:
        return text
    return f"{text[:_MOST_SHOWN]}..."


def _short(value: Any) -> str:
    if isinstance(value, tuple):
        value = list(value)
    return _cut(repr(value))


def _shown(values: Mapping[str, Any]) -> str:
    return _cut(shown(values)) or "without fields"


def _offered(context: Context, p: ActionServer) -> Part:
    used = context.session.used(p.action)
    offers: list[ServiceEndpoint] = []
    for graph in context.session.record.graph:
        offers += [offer for offer in graph.actions if offer.name == used]
    offers = [offer for offer in offers if offer.node not in context.reference_nodes]
    if not offers:
        reason = f"The action {p.action} did not appear, nor one of a similar name. A client would wait forever."
        return _Nothing(0.0, "no action in the graph", reason)
    of_type = [offer for offer in offers if offer.type == p.type]
    offer = (of_type or offers)[0]
    faults = p.faults("action", (p.action, p.type), (used, offer.type), [offer.node])
    faults += p.node_faults([offer.node])
    measured = f"{used} of type {offer.type}, from {offer.node}"
    lost = sum(cost for cost, _ in faults)
    reason = " ".join(reason for _, reason in faults)
    return Part(max(0.0, 1 - lost), measured, reason)


def _sent(context: Context, p: ActionServer, step: StepRun | None) -> _Sent:
    """Return the goal that a step sent; raises where there is none, or an earlier one had no answer."""
    if step is None:
        raise _NotTested("the session had ended before")
    if why := not_asked(context, step, "action"):
        raise _NotTested(why)
    goals = _goals(step)
    is_answered = any(goal.accepted is not None for goal in goals)
    silent = _earlier_silent(context, step)
    if silent is not None and not is_answered:
        raise _NotTested(f"an earlier goal ({_shown(silent.goal)}) got no answer")
    if not goals:
        problem = SendGoalResult.of(step).problem or "the node could not be asked"
        raise _NotTested(f"no goal could be sent: {problem}")
    return _Sent(context, p.artifact, step, goals[0])


def _earlier_silent(context: Context, step: StepRun) -> GoalRecord | None:
    """Return the first goal without an answer in the steps before one, if there is any."""
    steps = _steps(context, step)
    position = steps.index(step)
    for before in steps[:position]:
        for goal in _goals(before):
            if goal.accepted is None:
                return goal
    return None


def _steps(context: Context, step: StepRun) -> list[StepRun]:
    """Return the steps that send goals to the same action."""
    action = SendGoalStep.given(step).action
    found = []
    for each in context.session.record.steps:
        if each.kind == SendGoalStep.kind and SendGoalStep.given(each).action == action:
            found.append(each)
    return found


def _goals(step: StepRun) -> list[GoalRecord]:
    return SendGoalResult.of(step).goals


# -- whether a goal is accepted --------------------------------------------------------------------

_ACCEPT_HINT = (
    "goal_callback must return GoalResponse.ACCEPT for such a goal; without one, rclpy accepts all."
)


def _accepted(sent: _Sent, wanted: OfGoal) -> Part:
    if sent.record.accepted:
        answered_ms = (sent.record.answer_ns - sent.record.sent_ns) / 1e6
        return Part(1.0, f"{sent.words} accepted after {answered_ms:.1f} ms")
    if sent.record.accepted is None:
        return _silent(sent)
    every = "Every goal"
    if _any_goal(sent, accepted=True):
        every = f"The {sent.words}"
    hint = _ACCEPT_HINT
    if sent.printed("did not return a GoalResponse"):
        hint = "goal_callback returns no GoalResponse, which rclpy takes for a rejection: return GoalResponse.ACCEPT."
    return Part(0.0, f"{sent.words} rejected", f"{every} is rejected.", hint=hint)


def _rejected(sent: _Sent, wanted: OfGoal) -> Part:
    if sent.record.accepted is None:
        return _silent(sent)
    if sent.record.accepted is False:
        if not _any_goal(sent, accepted=True):
            raise _NotTested("no goal is accepted at all, so that a rejection proves nothing")
        return Part(1.0, f"{sent.words} rejected")
    every = "Every goal"
    if _any_goal(sent, accepted=False):
        every = f"The {sent.words}"
    hint = "Give ActionServer a goal_callback that returns GoalResponse.REJECT for such a goal."
    return Part(0.0, f"{sent.words} accepted", f"{every} is accepted.", hint=hint)


def _any_goal(sent: _Sent, **known: bool | str) -> bool:
    """Return whether some goal to the same action has the given values in its record."""
    for step in _steps(sent.context, sent.step):
        for goal in _goals(step):
            for key, value in known.items():
                if getattr(goal, key) == value:
                    return True
    return False


_SILENT_HINT = "rclpy.spin(node) must be reached, and no callback may wait: meanwhile, the node answers nothing."


def _silent(sent: _Sent) -> Part:
    reason = f"The {sent.words} was neither accepted nor rejected within {sent.waited_s:.1f} s."
    return _Nothing(0.0, "no answer", reason, hint=_SILENT_HINT)


# -- what an accepted goal gives -------------------------------------------------------------------

_END_HINT = "The execute callback must end, with goal_handle.succeed() and `return result`."


def _require_accepted(sent: _Sent) -> None:
    """Raise where a goal was not accepted, so that nothing can come of it."""
    if sent.record.accepted is None:
        raise _NotTested(f"the {sent.words} got no answer", _SILENT_HINT)
    if sent.record.accepted is False:
        raise _NotTested(f"the {sent.words} was rejected", _ACCEPT_HINT)


def _require_end(sent: _Sent) -> None:
    _require_accepted(sent)
    if not sent.has_ended:
        why = f"the {sent.words} did not end within {sent.waited_s:.1f} s (its status was {sent.status})"
        raise _NotTested(why, _END_HINT)


def _feedback(sent: _Sent, wanted: FeedbackWanted) -> Part:
    _require_accepted(sent)
    count = int(sent.record.feedback_count)
    if not count:
        hint = "Call goal_handle.publish_feedback(feedback) in the execute callback, again and again while it works."
        return Part(0.0, "no feedback", f"No feedback came for {sent.words}.", hint=hint)
    parts = [_feedback_count(sent, count, wanted.at_least)]
    if wanted.at_least_hz is not None:
        parts.append(_feedback_rate(sent, wanted.at_least_hz, wanted.hz_tolerance))
    for field, sign, way in ((wanted.rising, 1, "falls"), (wanted.falling, -1, "rises")):
        if field is not None and _reverses(sent, field, sign):
            reason = f"From one message to the next, {field} {way}."
            parts.append(Part(wanted.other_order_credit, reason=reason))
    return _product(parts)


def _feedback_count(sent: _Sent, count: int, least: int) -> Part:
    text = f"{count} message{'s' * (count > 1)} of feedback"
    if count >= least:
        return Part(1.0, text)
    few = f"For {sent.words}, {count} of {least} messages of feedback came."
    return Part(count / least, text, few)


def _product(parts: Sequence[Part]) -> Part:
    """Return one part with the product of the shares, and the texts of all."""
    share = math.prod(part.share for part in parts)
    best = math.prod(part.most for part in parts)
    text = " ".join(part.text for part in parts if part.text)
    reason = " ".join(part.reason for part in parts if part.reason)
    doubt = " ".join(part.doubt for part in parts if part.doubt)
    return Part(share, text, reason, best=best, doubt=doubt)


def _feedback_rate(sent: _Sent, wanted_hz: float, tolerance: float) -> Part:
    first_ns, last_ns = sent.record.feedback_span_ns
    length_s = max(0.0, (last_ns - first_ns) / 1e9)
    rate = Interval(0.0, 0.0)
    if length_s:
        rate_hz = (sent.record.feedback_count - 1) / length_s
        rate = bounds.count(rate_hz, sent.delayed(first_ns, last_ns))
    full_hz = wanted_hz * (1 - tolerance)
    share = rate.credit(lambda rate_hz: quantise(rate_hz / full_hz))
    shown = f"{apart(rate.low, full_hz, places=1)} Hz"
    reason = ""
    if share.low < 1:
        reason = f"The feedback comes at {shown}; {full_hz:g} Hz give full credit."
    return Part.between(share, f"at {shown}", reason)


def _reverses(sent: _Sent, field: str, sign: int) -> bool:
    """Return whether a number, or an array's length, goes the other way from one message to the next."""
    values = [value_at(message.values, field) for message in sent.record.feedback]
    sizes = [len(value) if isinstance(value, list) else value for value in values]
    numbers = [size for size in sizes if isinstance(size, (int, float))]
    # Values other than numbers neither rise nor fall.
    for earlier, later in itertools.pairwise(numbers):
        goes_on = sign * later >= sign * earlier
        if not goes_on:  # Not-a-numbers included.
            return True
    return False


def _result(sent: _Sent, wanted: ResultWanted) -> Part:
    _require_end(sent)
    result = sent.record.result
    if sent.record.ended_ns is None:
        reason = f"The {sent.words} ended as {sent.status}, but its result never came."
        hint = "End the execute callback with `return result`."
        return _Nothing(0.0, "no result", reason, hint=hint)
    got = {path: value_at(result, path) for path in wanted.values}
    wrong: list[str] = []
    for path, value in wanted.values.items():
        if not equal_within(got[path], value, wanted.tolerance):
            wrong.append(f"{path} is {_short(got[path])}, not {_short(value)}")
    measured = _result_words(got)
    if not wrong:
        return Part(1.0, measured)
    hint = ""
    all_wrong = len(wrong) == len(got)
    if all_wrong and not any(got.values()):
        hint = "Fill in the fields of the result that the execute callback returns."
    share = 1 - len(wrong) / len(got)
    reason = f"In the result, {' and '.join(wrong)}."
    return Part(share, measured, reason, hint=hint)


def _result_words(values: Mapping[str, Any]) -> str:
    fields = [f"{path}={_short(value)}" for path, value in values.items()]
    return "result " + ", ".join(fields)


# -- how a goal ends -------------------------------------------------------------------------------

#: Output of rclpy if the execute callback leaves the goal without a status, or raises an exception.
_NOT_SET, _RAISED = "Goal state not set, assuming aborted", "Error raised in execute callback"
_WITHOUT_STATUS = (
    "The execute callback ended without setting a status, which rclpy takes for ABORTED."
)
#: As `action_msgs/srv/CancelGoal` numbers its answers; rclpy gives it where the request was seen too late.
_GOAL_TERMINATED = 3
#: Methods of a goal handle that set a status.
_SETTER = {"succeeded": "succeed", "aborted": "abort", "canceled": "canceled"}
_CANCELED_HINT = (
    "In its loop the execute callback must look at goal_handle.is_cancel_requested, and then call "
    "goal_handle.canceled() and return a result."
)
_PREEMPTED_HINT = (
    "When a newer goal is accepted, let the execute callback of the one before notice it, call goal_handle.abort() and "
    "return a result."
)
_BLOCKED_HINT = (
    "While the execute callback runs, the node answers nothing else: give ActionServer a "
    "callback_group=ReentrantCallbackGroup() and spin with a MultiThreadedExecutor."
)


def _final_status(sent: _Sent, wanted: StatusWanted) -> Part:
    _require_end(sent)
    measured = f"{sent.words} ended as {sent.status}"
    if sent.record.status == wanted.status:
        return Part(1.0, measured)
    reason = f"The {sent.words} ended as {sent.status}, not as {wanted.status.upper()}."
    is_aborted = sent.record.status == "aborted"
    if is_aborted and sent.printed(_RAISED):
        return _Nothing(0.0, measured, f"{reason} The execute callback raised an exception.")
    if is_aborted and sent.printed(_NOT_SET):
        reason += f" {_WITHOUT_STATUS}"
    return Part(0.0, measured, reason, hint=_setter_hint(wanted.status))


def _setter_hint(status: str) -> str:
    return f"Call goal_handle.{_SETTER[status]}() before `return result`."


def _cancelled(sent: _Sent, wanted: CancelledWanted) -> Part:
    _require_accepted(sent)
    cancel = sent.record.cancel
    if cancel is None:
        return _too_early(sent, "cancelled", SendGoalStep.given(sent.step).cancel_after_s)
    if cancel.accepted:
        asked = _Request(cancel.sent_ns, "it was cancelled", ("canceled",), _CANCELED_HINT)
        return _ends_early(sent, wanted, asked)
    if cancel.answered_ns is not None and cancel.code != _GOAL_TERMINATED:
        hint = "Give ActionServer a cancel_callback that returns CancelResponse.ACCEPT; without one, rclpy refuses."
        refused = f"Cancelling the {sent.words} was refused."
        return Part(0.0, "cancelling refused", refused, hint=hint)
    reason = f"The request to cancel the {sent.words} was not answered while it was under way."
    return Part(0.0, "cancelling not answered in time", reason, hint=_BLOCKED_HINT)


def _preempted(sent: _Sent, wanted: PreemptedWanted) -> Part:
    _require_accepted(sent)
    goals = _goals(sent.step)
    if len(goals) < 2:
        return _too_early(sent, "preempted", SendGoalStep.given(sent.step).newer_after_s)
    newer = replace(sent, record=goals[1])
    if newer.record.accepted is False:
        hint = "Accept it, and abort the goal that is under way."
        reason = "A newer goal is rejected while one is under way."
        return Part(0.0, "newer goal rejected", reason, hint=hint)
    if newer.record.accepted is None:
        reason = "A newer goal was not answered."
        return Part(0.0, "newer goal not answered", reason, hint=_BLOCKED_HINT)
    sent_ns = newer.record.sent_ns
    asked = _Request(sent_ns, "a newer one was sent", wanted.status, _PREEMPTED_HINT)
    found = _ends_early(sent, wanted, asked)
    answered_s = (newer.record.answer_ns - newer.record.sent_ns) / 1e9
    if not found.share and answered_s > wanted.within_s:
        reason = f"A newer goal was answered only after {apart(answered_s, wanted.within_s, places=2)} s."
        return replace(found, reason=reason, hint=_BLOCKED_HINT)
    # A server that never succeeds loses points for that elsewhere.
    is_excused = newer.has_ended and not _any_goal(sent, status="succeeded")
    if is_excused or newer.record.status == "succeeded":
        return found
    became = f"ended as {newer.status}" if newer.has_ended else "did not end"
    reason = f"{found.reason} The newer goal {became}.".strip()
    kept = wanted.other_status_credit
    hint = found.hint or _END_HINT
    share = kept * found.share
    return replace(found, share=share, best=kept * found.most, reason=reason, hint=hint)


def _too_early(sent: _Sent, what: str, after_s: float | None) -> Part:
    """Judge a goal that ended before it could be cancelled or preempted, some time after it was accepted."""
    if not sent.has_ended:
        raise _NotTested(f"the moment at which the {sent.words} was to be {what} never came")
    ended = f"The {sent.words} had ended as {sent.status} before it could be {what}."
    hint = "Let the execute callback work until it is asked to end."
    found = Part(0.0, "ended before", ended, hint=hint)
    end_ns = sent.record.ended_ns
    if after_s is None or end_ns is None:
        return found
    late_s = (end_ns - sent.record.answer_ns) / 1e9 - after_s
    if late_s <= 0:
        return found
    possible = bounds.arrival(late_s, sent.delayed(sent.record.answer_ns, end_ns))
    return replace(found, best=possible.high, doubt=possible.why)


@dataclass(frozen=True)
class _Request:
    """A request to end a goal: its time, its words, the statuses that fit, and the hint for a goal that goes on."""

    sent_ns: int
    since: str
    statuses: Sequence[str]
    hint: str


def _ends_early(sent: _Sent, wanted: CancelledWanted, asked: _Request) -> Part:
    """Judge delay and status of a goal's end after the request to end it."""
    ended_ns = sent.record.ended_ns
    if ended_ns is None:
        reason = f"The {sent.words} did not end after {asked.since}."
        return Part(0.0, "goes on", reason, hint=asked.hint)
    took_s = (ended_ns - asked.sent_ns) / 1e9
    took = bounds.latency(took_s, sent.delayed(asked.sent_ns, ended_ns))
    fits = sent.record.status in asked.statuses
    share = took.credit(lambda took_s: _end_credit(wanted, fits, took_s))
    shown = f"{apart(took_s, wanted.within_s, places=2)} s after {asked.since}"
    reasons: list[str] = []
    hint = asked.hint
    if not fits:
        reasons, hint = _other_status(sent, asked)
    if took_s > wanted.within_s:
        reasons.append(f"It ended {shown}; within {wanted.within_s:g} s gives full credit.")
        if fits:
            hint = "Look for it more often, in each round of the execute callback's loop."
    hint = hint if share.low < 1 else ""
    return Part.between(share, f"{sent.status} {shown}", " ".join(reasons), hint)


def _end_credit(wanted: CancelledWanted, fits: bool, took_s: float) -> float:
    """Return the credit of a goal's end by its status and its delay."""
    if took_s <= wanted.within_s:
        return 1.0 if fits else wanted.other_status_credit
    return wanted.late_credit if fits else 0.0


def _other_status(sent: _Sent, asked: _Request) -> tuple[list[str], str]:
    """Return reasons and hint for an end in a status that does not fit."""
    named = " or ".join(status.upper() for status in asked.statuses)
    reasons = [f"The {sent.words} ended as {sent.status}, not as {named}."]
    if sent.record.status == "aborted" and sent.printed(_NOT_SET):
        reasons.append(_WITHOUT_STATUS)
        return reasons, _setter_hint(asked.statuses[0])
    return reasons, asked.hint


# -- the parts, in words --------------------------------------------------------------------------


def _offered_words(p: ActionServer, _: ActionPart) -> str:
    text = f"{p.action} of type {p.type}"
    if p.node:
        text += f", from node {p.node}"
    return text


def _accepted_words(_: ActionServer, wanted: OfGoal) -> str:
    return "accepted"


def _rejected_words(_: ActionServer, wanted: OfGoal) -> str:
    return "rejected"


def _expected_result_words(_: ActionServer, wanted: ResultWanted) -> str:
    return _result_words(wanted.values)


def _final_status_words(_: ActionServer, wanted: StatusWanted) -> str:
    return f"ends as {wanted.status.upper()}"


def _cancelled_words(_: ActionServer, wanted: CancelledWanted) -> str:
    return f"CANCELED within {wanted.within_s:g} s of cancelling"


def _preempted_words(_: ActionServer, wanted: PreemptedWanted) -> str:
    statuses = " or ".join(wanted.status).upper()
    return f"{statuses} within {wanted.within_s:g} s of a newer goal, which is carried out"


def _feedback_words(_: ActionServer, wanted: FeedbackWanted) -> str:
    rate = ""
    if wanted.at_least_hz is not None:
        rate = f" at {wanted.at_least_hz:g} Hz or more"
    order = ""
    if wanted.rising is not None:
        order += f", {wanted.rising} never falls"
    if wanted.falling is not None:
        order += f", {wanted.falling} never rises"
    return f"{wanted.at_least} or more messages of feedback{rate}{order}"


_Words = Callable[[ActionServer, Any], str]
_Judge = Callable[..., Part]
#: Key of a part -> function for its expectation in words, and function that judges it.
_PARTS: dict[str, tuple[_Words, _Judge]] = {
    "offered": (_offered_words, _offered),
    "accepted": (_accepted_words, _accepted),
    "rejected": (_rejected_words, _rejected),
    "feedback": (_feedback_words, _feedback),
    "result": (_expected_result_words, _result),
    "final_status": (_final_status_words, _final_status),
    "cancelled": (_cancelled_words, _cancelled),
    "preempted": (_preempted_words, _preempted),
}
