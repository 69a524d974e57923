"""Checks of a service with answers that depend on a parameter, and of its response times."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

from pydantic import BaseModel, Field

from grader.own_checks import (
    Call,
    CallLabel,
    Context,
    EarlierCheckId,
    Finding,
    GetLabel,
    Location,
    Outcome,
    ParameterValue,
    Pattern,
    SetLabel,
    Share,
    Step,
    always_true_parameter,
    answer_cause,
    apart,
    check,
    fields_of_type,
    graded,
    not_reached,
    parameter_cause,
    search,
    unclear,
)

#: Response to a call, by the names of its fields; None if none came.
Answer = Mapping[str, Any] | None


class CallGated(BaseModel):
    """A parameter decides over the answer, and may be changed while the node runs."""

    set_step: SetLabel = Field(description="The step that sets the parameter.")
    read_step: GetLabel | None = Field(
        None,
        description="The step that read the parameter; with it, a parameter of another type forbids nothing.",
    )
    refused_step: CallLabel
    recovered_step: CallLabel
    from_start_step: CallLabel = Field(
        description="The call to a node that had the parameter from its start."
    )
    allowed_step: CallLabel | None = Field(
        None, description="A call that must be answered as ever while the parameter is off."
    )
    enabled_step: CallLabel | None = Field(
        None,
        description="The refused call again, while the parameter is off after the recovered call had its effect.",
    )
    enabled_credit: Share = Field(
        0.5, description="Credit if only the first call is refused."
    )
    stopped_credit: Share = Field(
        0.5, description="Credit of refusing from the start, of a node that stopped answering."
    )
    enables: EarlierCheckId | None = Field(
        None,
        description="Check of the answer in the normal case; if that one fails, this is not tested.",
    )
    allowed_charged_by: EarlierCheckId | None = Field(
        None,
        description="In rubrics of earlier versions: a check that charges another answer to the allowed call.",
    )
    refused: Annotated[Mapping[str, Any], fields_of_type("_Response", "refused_step")]
    recovered: Annotated[Mapping[str, Any], fields_of_type("_Response", "recovered_step")]
    message_field: Annotated[str, fields_of_type("_Response", "refused_step")] = "message"
    allowed: Annotated[Mapping[str, Any], fields_of_type("_Response", "allowed_step")] = Field(
        default_factory=dict
    )
    refusal: Pattern | None = Field(
        None, description="A message that refuses, whatever the other fields say."
    )
    told_on: Pattern | None = Field(
        None, description="A message that tells nothing but success, contrary to a refusal."
    )
    told_off: Pattern | None = Field(
        None, description="A message that tells nothing but the contrary of success."
    )
    misled_credit: Share = Field(
        0.5, description="Credit if message and fields of an answer tell opposite states."
    )
    contrary_cause: str | None = Field(
        None,
        description="Name of the mistake of contrary messages, as in the checks of single answers.",
    )
    half_credit: Share = Field(
        0.5, description="Credit of one half, such as refusing without recovering."
    )
    from_start_credit: Share = Field(
        0.5, description="Credit of refusing only what was given from the start."
    )
    disallowed_credit: Share = Field(
        0.5, description="Credit where what must stay possible is refused too."
    )
    other_name_credit: Share = Field(
        1.0, description="Credit where all is right, but for a parameter of another name."
    )


@dataclass(frozen=True)
class _Gate:
    """Answers of a node while its parameter is off, on again, and off from the start."""

    off: Answer
    on: Answer
    off_from_start: Answer
    where: tuple[Location, ...]
    expected: str

    @property
    def measured(self) -> str:
        """Return the three answers in words."""
        answers = f"off: {_shown(self.off)}; on again: {_shown(self.on)}"
        return f"{answers}; off from the start: {_shown(self.off_from_start)}"

    def graded(
        self, share: float, reason: str, hint: str = "", places: Sequence[Location] = ()
    ) -> Finding:
        """State a share of credit with its reason; the places of the mistake stand before the calls."""
        where = (*places, *self.where)
        return graded(share, self.expected, self.measured, reason, hint=hint, where=where)


@check(commands=("{set_step}", "{refused_step}"))
def call_gated(context: Context, p: CallGated) -> Finding:
    """Judge the refusal while the parameter is off, and the recovery after it.

    Recovery alone earns nothing. A refusal only from the start earns a part.
    """
    gate = _gate(context, p)
    refuses = _fits(gate.off, p.refused)
    recovers = _fits(gate.on, p.recovered)
    if _cannot_be_enabled(context, p):
        if _is_reversed(p, gate):
            return gate.graded(0.0, _REVERSED, "Invert the condition.")
        if not refuses or not recovers:
            reason = "Not tested: the robot cannot be enabled at all, so a refusal proves nothing."
            return not_reached(reason, expected=gate.expected)
    if gate.off is None:
        return _no_refusal(context, p, gate)
    if refuses:
        return _judge_refusal(context, p, gate)
    return _judge_without_refusal(context, p, gate)


def _is_reversed(p: CallGated, gate: _Gate) -> bool:
    """Tell whether the node does the contrary in both cases."""
    if not _fits(gate.off, p.recovered):
        return False
    return _fits(gate.on, p.refused)


def _gate(context: Context, p: CallGated) -> _Gate:
    """Collect the answers of the three calls."""
    answers = []
    where = []
    for step in (p.refused_step, p.recovered_step, p.from_start_step):
        answers.append(_answer_to(context, step))
        where.append(_calls_at(context, step))
    refused = _shown(p.refused)
    recovered = _shown(p.recovered)
    expected = f"{refused} while the parameter is off"
    expected += f", and after such a refusal {recovered} when it is on again"
    expected += "; other checks judge the messages"
    off, on, off_from_start = answers
    return _Gate(off, on, off_from_start, tuple(where), expected)


def _answer_to(context: Context, step: str) -> Answer:
    """Return the response to the first call of a step; None without one."""
    calls = context.calls(step)
    if not calls:
        return None
    return calls[0].response


def _calls_at(context: Context, label: str) -> Location:
    """Point at the calls of a step."""
    step = context.step(label)
    if step is None:
        return context.location()
    service = step.found.service
    if not service:
        service = step.given.service
    return context.location(service, span_s=(step.started_s, step.ended_s))


def _shown(response: Answer) -> str:
    """Return the fields of an answer, such as `success=True, message='on'`."""
    if response is None:
        return "no answer"
    fields = [f"{name}={value!r}" for name, value in response.items()]
    return ", ".join(fields)


def _fits(answer: Answer, wanted: Mapping[str, Any]) -> bool:
    if answer is None:
        return False
    for name, value in wanted.items():
        if answer.get(name) != value:
            return False
    return True


def _cannot_be_enabled(context: Context, p: CallGated) -> bool:
    """Tell whether the check of the normal answer failed."""
    if p.enables is None:
        return False
    finding = context.finding(p.enables)
    if finding is None:
        return False
    return finding.outcome in (Outcome.FAILED, Outcome.NOT_REACHED)


def _no_refusal(context: Context, p: CallGated, gate: _Gate) -> Finding:
    """State that no answer came while the parameter was off."""
    if not context.silent_before(p.refused_step):
        problem = "No answer came while the parameter was false."
        return context.unanswered(p.refused_step, gate.expected, problem)
    share = 0.0
    if _fits(gate.off_from_start, p.refused):
        share = p.stopped_credit
    reason = "Not tested, because the node had already stopped answering."
    return gate.graded(share, reason, "Fix that, and these points can be earned too.")


def _judge_refusal(context: Context, p: CallGated, gate: _Gate) -> Finding:
    """Judge the effects of a refusal on the allowed call and on the call after it."""
    disallowed = _disallowed(context, p)
    if disallowed is not None:
        reason = f"{_DISALLOWS} {_shown(disallowed)}."
        found = gate.graded(p.disallowed_credit, reason, _DISALLOWS_HINT)
        cause = _answer_cause(context, p.allowed_step)
        return context.charge(found, cause)
    mistyped = _mistyped(context, p)
    if mistyped and gate.off_from_start is None:
        last = replace(gate, where=gate.where[-1:])
        found = last.graded(0.0, mistyped, _TYPE_HINT, _declarations(context, p))
        cause = _parameter_cause(context.step(p.set_step))
        return context.charge(found, cause)
    if _fits(gate.on, p.recovered):
        again = _not_refused_again(context, p)
        if p.enabled_step is not None and again is not None:
            where = (*gate.where, _calls_at(context, p.enabled_step))
            reason = f"{_ONCE_ON} {_shown(again)}."
            return replace(gate, where=where).graded(p.enabled_credit, reason, _ONCE_ON_HINT)
        misleading = _misleading(context, p, gate)
        if misleading is not None:
            reason = f"{_MISLEADS} {_shown(misleading)}."
            found = gate.graded(p.misled_credit, reason, _MISLEADS_HINT)
            return context.charge(found, p.contrary_cause)
        return _judge_name(context, p, gate)
    reason = "It refuses, but does not recover when the parameter is true again."
    return gate.graded(p.half_credit, reason)


def _misleading(context: Context, p: CallGated, gate: _Gate) -> Answer:
    """Return the first answer with a message of the opposite state; None if all are right.

    A request granted from the start is a mistake of its own, with the right message.
    """
    refusals = [gate.off]
    if _fits(gate.off_from_start, p.refused):
        refusals.append(gate.off_from_start)
    if p.enabled_step is not None:
        refusals.append(_answer_to(context, p.enabled_step))
    if p.allowed_step is not None:
        refusals.append(_answer_to(context, p.allowed_step))
    for answer in refusals:
        if _tells(p, answer, p.told_on):
            return answer
    if _tells(p, gate.on, p.told_off):
        return gate.on
    return None


def _tells(p: CallGated, answer: Answer, pattern: str | None) -> bool:
    """Tell whether the message of an answer matches a pattern, if there is one."""
    if answer is None or pattern is None:
        return False
    words = str(answer.get(p.message_field, ""))
    return search(pattern, words) is not None


def _not_refused_again(context: Context, p: CallGated) -> Answer:
    """Return the answer to the later call if it is wrongly granted, else None."""
    if p.enabled_step is None:
        return None
    answer = _answer_to(context, p.enabled_step)
    if _fits(answer, p.recovered):
        return answer
    return None


def _answer_cause(context: Context, label: str | None) -> str | None:
    """Name the mistake of a wrong answer to a call, as the check of this answer does."""
    if label is None:
        return None
    step = context.step(label)
    if step is None:
        return None
    return answer_cause(step.given.service, step.given.request)


def _held(context: Context, label: str | None) -> Mapping[str, ParameterValue]:
    """Return type and value of each parameter as a step read it; nothing without the step."""
    if label is None:
        return {}
    step = context.step(label)
    if step is None:
        return {}
    held: Mapping[str, ParameterValue] = step.found.read
    return held


def _mistyped(context: Context, p: CallGated) -> str:
    """Say that the parameter holds a value of another type; empty if it is of the type that is set."""
    setting = context.step(p.set_step)
    if setting is None:
        return ""
    held = _held(context, p.read_step)
    for name, value in setting.given.values.items():
        own = "not set"
        if name in held:
            own = held[name].type
        wanted = _TYPE_NAMES.get(type(value), own)
        if own not in (wanted, "not set"):
            given = json.dumps(value)
            reason = f"{name} is declared as a {own}, so the {wanted} {given} cannot be set"
            return f"{reason}: rclpy refuses it while the node runs, and the node ends if it starts with it."
    return ""


def _declarations(context: Context, p: CallGated) -> tuple[Location, ...]:
    """Return the lines of the programs that declare the parameters of a step."""
    setting = context.step(p.set_step)
    if setting is None:
        return ()
    names = "|".join(map(re.escape, setting.given.values))
    declares = re.compile(rf"declare_parameter\(\s*['\"](?:{names})['\"]")
    found = []
    for path in context.paths:
        text = context.text(path)
        if text is None:
            continue
        if not path.endswith(".py"):
            continue
        for match in declares.finditer(text):
            line = text.count("\n", 0, match.start()) + 1
            found.append(Location(file=path, line=line))
    return tuple(found)


def _judge_name(context: Context, p: CallGated, gate: _Gate) -> Finding:
    """Judge a gate without a fault by the name of its parameter."""
    step = context.step(p.set_step)
    if step is None:
        return gate.graded(1.0, "")
    names: Mapping[str, str] = {}
    if step.found.names is not None:
        names = step.found.names
    for asked, used in names.items():
        reason = f"It refuses by the parameter {used}; with {asked} set to false, it still enables."
        hint = f"Declare the parameter as {asked}."
        found = gate.graded(p.other_name_credit, reason, hint)
        cause = _parameter_cause(step)
        return context.charge(found, cause)
    return gate.graded(1.0, "")


def _parameter_cause(step: Step | None) -> str | None:
    """Name the mistake of the parameter set by a step, as the check of the parameters does."""
    if step is None:
        return None
    for name in step.given.values:
        return parameter_cause(step.given.node, name)
    return None


def _disallowed(context: Context, p: CallGated) -> Answer:
    """Return another answer to the call that must stay possible; None if it is right or charged."""
    if p.allowed_step is None:
        return None
    if context.charged(p.allowed_charged_by):
        return None
    step = context.step(p.allowed_step)
    if not _was_sent(step):
        return None
    answer = _answer_to(context, p.allowed_step)
    if _fits(answer, p.allowed):
        return None
    return answer


def _was_sent(step: Step | None) -> bool:
    """Tell whether a call was made with the rubric's request.

    The student's type may lack some fields of it.
    """
    if step is None:
        return False
    sent = step.found.request
    if sent is None:
        return True
    return bool(sent == step.given.request)


def _judge_without_refusal(context: Context, p: CallGated, gate: _Gate) -> Finding:
    """Judge a node that enables while the parameter is off."""
    recovers = _fits(gate.on, p.recovered)
    if recovers and _says_no(p, gate.off):
        hint = "Set the success field to False too, not only the message."
        return gate.graded(p.misled_credit, _ONLY_MESSAGE, hint)
    step = context.step(p.set_step)
    unset = _not_set(step)
    if unset:
        found = _judge_unset(p, gate, unset)
        cause = _parameter_cause(step)
        return context.charge(found, cause)
    if _fits(gate.off_from_start, p.refused):
        reason = f"{_AT_START} a change while it runs has no effect."
        return gate.graded(p.from_start_credit, reason)
    reason = "It enables although the parameter is false."
    place = _always_true(context)
    if place is None:
        return gate.graded(0.0, reason)
    reason += f" Line {place.line} of {place.file} tests the parameter's object, which is always true, not its value."
    hint = f"Take the value in line {place.line}: get_parameter(...).value."
    return gate.graded(0.0, reason, hint, [place])


def _always_true(context: Context) -> Location | None:
    """Return the first condition on a parameter's object in place of its value; None without one."""
    for path in context.paths:
        text = context.text(path)
        line = None
        if text is not None:
            line = always_true_parameter(text)
        if line is not None:
            return Location(file=path, line=line)
    return None


def _says_no(p: CallGated, answer: Answer) -> bool:
    """Tell whether the message of an answer refuses."""
    return _tells(p, answer, p.refusal)


def _judge_unset(p: CallGated, gate: _Gate, unset: str) -> Finding:
    """Judge a node without a refusal after a failure to set its parameter."""
    if _fits(gate.off_from_start, p.refused):
        return gate.graded(p.half_credit, f"{_AT_START} {unset}", _SET_HINT)
    return gate.graded(0.0, f"It still enables the robot, because {unset}", _SET_HINT)


def _not_set(step: Step | None) -> str:
    """Name the parameters that could not be set while the node ran, and quote the node's answer."""
    if step is None or step.outcome == "done":
        return ""
    problems = []
    for problem in step.found.reasons.values():
        text = str(problem)
        problems.append(text.rstrip("."))
    names = ", ".join(step.given.values)
    unset = f"{names} could not be set while it ran"
    why = "; ".join(problems)
    if why:
        return f"{unset}: {why}."
    return f"{unset}."


#: Name of the ROS parameter type that holds a value of the rubric.
_TYPE_NAMES: Mapping[type, str] = {bool: "bool", int: "integer", float: "double", str: "string"}
_AT_START = "It refuses only when the parameter is false from the start;"
_ONLY_MESSAGE = (
    "Its message refuses, but the other fields report success, and client programs read those."
)
_MISLEADS = "A message tells the opposite of the state that the robot is then in:"
_MISLEADS_HINT = "Decide first, then compose the message from what was decided."
_DISALLOWS = "While the parameter is false it refuses what must always be possible too:"
_DISALLOWS_HINT = (
    "Let the parameter decide over enabling alone; to disable must always be possible."
)
_ONCE_ON = "It refuses at first. Once enabled, it answers the same request while the parameter is false again with"
_ONCE_ON_HINT = "Read the parameter first, whatever the present state is."
_REVERSED = "It follows the parameter, but inverted: it enables while it is false and refuses while it is true."
_SET_HINT = "Declare the parameter with a default of the type that the lab gives it, not read-only; others can then set it."
_TYPE_HINT = "Declare the parameter with a default of the type that the lab gives it, and use this type in the callback."


class CallsInTime(BaseModel):
    """Calls back to back are each answered in time."""

    step: CallLabel
    within_s: float = Field(gt=0)
    enough: int = Field(
        10,
        description="If all answers were in time, this many calls are enough where there was no time for more.",
    )


@check(commands=("{step}",))
def calls_in_time(context: Context, p: CallsInTime) -> Finding:
    """Judge the share of calls answered in time."""
    wanted = _count_wanted(context, p)
    expected = f"{wanted} calls, each answered within {p.within_s:g} s"
    timed = _Timed.of(context.calls(p.step), p.within_s)
    if not timed.latencies_s:
        return context.unanswered(p.step, expected)
    if timed.count >= wanted:
        return _judge_times(context, p, timed, expected)
    few = f"There was time for {timed.count} of {wanted} calls."
    if timed.quick == timed.count < p.enough:
        return unclear(expected, timed.measured, f"{few} Those were answered in time.")
    return _judge_times(context, p, timed, expected, (few,))


def _count_wanted(context: Context, p: CallsInTime) -> int:
    """Return the number of calls that the step was to make."""
    step = context.step(p.step)
    if step is None:
        return 1
    return int(step.given.repeat)


@dataclass(frozen=True)
class _Timed:
    """Calls that were made, beside the allowed time; times in s."""

    within_s: float
    count: int
    #: Times of the answered calls.
    latencies_s: Sequence[float]
    #: Number of calls that may have been in time without the machine delay.
    undelayed: int
    longest_delay_s: float

    @classmethod
    def of(cls, calls: Sequence[Call], within_s: float) -> _Timed:
        """Collect the times of some calls."""
        latencies_s = []
        undelayed = 0
        longest_delay_s = 0.0
        for call in calls:
            if call.response is not None:
                latencies_s.append(call.latency_s)
            if call.latency_s - call.delay_s <= within_s:
                undelayed += 1
            longest_delay_s = max(longest_delay_s, call.delay_s)
        return cls(within_s, len(calls), latencies_s, undelayed, longest_delay_s)

    @property
    def quick(self) -> int:
        """Number of calls answered in time."""
        in_time = [each_s for each_s in self.latencies_s if each_s <= self.within_s]
        return len(in_time)

    @property
    def measured(self) -> str:
        """The number of calls in time, and the slowest answer."""
        slowest_ms = max(self.latencies_s) * 1e3
        shown = apart(slowest_ms, self.within_s * 1e3, places=1)
        return f"{self.quick} of {self.count} calls made in time, slowest {shown} ms"

    @property
    def reason(self) -> str:
        """The number of late calls, and the quickest answer if all were late."""
        late = f"{self.count - self.quick} of {self.count} calls"
        reason = f"{late} took longer than {self.within_s:g} s, or got no answer."
        if not self.quick:
            quickest = apart(min(self.latencies_s), self.within_s, places=2)
            reason += f" The quickest took {quickest} s."
        return reason


def _judge_times(
    context: Context,
    p: CallsInTime,
    timed: _Timed,
    expected: str,
    notes: Sequence[str] = (),
) -> Finding:
    """Judge the share of calls answered in time, of those that were made."""
    share = timed.quick / timed.count
    best = timed.undelayed / timed.count
    where = _calls_at(context, p.step)
    busy = "Not your fault: the grading computer was too busy to time the calls"
    doubt = f"{busy} (up to {timed.longest_delay_s:.2f} s)."
    return graded(
        share,
        expected,
        timed.measured,
        timed.reason,
        where=(where,),
        notes=notes,
        best=max(share, best),
        doubt=doubt,
    )
