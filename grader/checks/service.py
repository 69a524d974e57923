"""Checks of a serving node: its service, answers, parameters and response times.

All answers are answers to the grader's own client calls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

from pydantic import Field

from grader.checks.base import (
    Context,
    Part,
    credit_of,
    failed,
    graded,
    not_reached,
    of_parts,
    passed,
    unexplained,
)
from grader.checks.endpoints import OfEndpoint, claim_of, claimed_at
from grader.evidence.cpu_delay import Span
from grader.lab import references as ref
from grader.lab.patterns import search, without
from grader.lab.references import Parameters, Pattern, Share
from grader.lab.steps.base import StepResult
from grader.lab.steps.call import CallRecord, CallResult, CallStep
from grader.lab.steps.get_parameters import GetParametersResult, GetParametersStep, ParameterValue
from grader.recording.session import ServiceEndpoint, StepRun
from grader.result import Finding, Location

#: Response to a call, by the names of its fields; None if none came.
Answer = Mapping[str, Any] | None


class ServiceOffered(OfEndpoint):
    """A node offers a service of a type under a name."""

    artifact: ref.Artifact
    service: ref.RosName
    type: ref.ServiceType
    rest: Share = Field(
        1.0,
        description="Share of the credit left to dependent checks if no client of the lab finds the service.",
    )

    def sought(self) -> Sequence[ref.Sought]:
        """Return the service."""
        return (ref.Sought("service", self.service, self.type),)


def service_offered(context: Context, p: ServiceOffered) -> Finding:
    """Judge the service from discovery."""
    expected = f"{p.service} of type {p.type}"
    if p.node:
        expected += f", from node {p.node}"
    offers = _offers(context, p.service)
    if not offers or _ended_before_call(context, p.artifact):
        fallback = f"The service {p.service} did not appear, nor one of a similar name. A client would wait forever."
        return unexplained(failed(expected, "no service in the graph", fallback))
    offer = next((each for each in offers if each.type == p.type), offers[0])
    wanted = (p.service, p.type)
    found = (offer.name, offer.type)
    costs = p.faults("service", wanted, found, [offer.node])
    is_unknown = bool(costs)
    costs += p.node_faults([offer.node])
    measured = f"{offer.name} of type {offer.type}, from {offer.node}"
    source = claimed_at(claim_of(context, "service", p.service))
    where = (*source, context.location())
    finding = of_parts(expected, [Part(1.0, measured)], costs=costs, where=where)
    if not is_unknown:
        return finding
    if p.rest >= 1:
        return finding
    return replace(finding, passes_on=credit_of(p.rest))


def _offers(context: Context, service: str) -> list[ServiceEndpoint]:
    """Return the student's servers of a service in all graphs."""
    used = context.session.used(service)
    offers = []
    for graph in context.session.record.graph:
        for endpoint in graph.services:
            if endpoint.name == used and endpoint.node not in context.reference_nodes:
                offers.append(endpoint)
    return offers


def _ended_before_call(context: Context, artifact: str) -> bool:
    """Tell whether the process of an artifact ended before the first call.

    The graph may have shown its service for a moment, too short for a call.
    """
    runs = context.session.processes_of(artifact)
    exited_ns = runs[0].exited_ns if runs else None
    if not exited_ns:
        return False
    for step in context.session.record.steps:
        if step.kind == "call":
            return exited_ns < step.started_ns
    return False


class Given(Parameters):
    """A parameter with the value on which an answer depends; another check judges its default."""

    step: ref.GetLabel = Field(description="The step that read the parameter.")
    name: ref.GivenName
    value: Any
    instead: ref.CallLabel = Field(
        description="The call that counts where the node began with another value."
    )


class CallAnswered(Parameters):
    """A call is answered with the right values; an empty message, or another answer later, costs a part."""

    artifact: ref.Artifact
    step: ref.CallLabel
    response: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "step")] = Field(
        description="Fields that must have these values."
    )
    message_field: Annotated[str, ref.fields_of_type("_Response", "step")] = "message"
    message: Pattern | None = Field(None, description="Regular expression for the message field.")
    contrary: Pattern | None = Field(
        None, description="A message that matches contradicts the answer: no credit."
    )
    contrary_cause: str | None = Field(
        None,
        description="Name of this mistake; only its dearest check charges it. Without it, each check does.",
    )
    again: ref.CallLabel | None = Field(
        None, description="A later step with the same request, which must get the same answer."
    )
    again_charged_by: ref.EarlierCheckId | None = Field(
        None,
        description="In rubrics of earlier versions: a check that charges later answers and contrary messages too.",
    )
    given: Given | None = Field(None, description="A parameter on which the answer depends.")
    changed_credit: Share = Field(
        0.75, description="Credit of a right answer that is another one later."
    )
    wordless_credit: Share = Field(
        0.75, description="Credit of a right answer whose message is empty."
    )


def _calls(step: StepRun | None) -> list[CallRecord]:
    """Return the calls of a step, none for a step of another kind."""
    if step is None or step.kind != CallStep.kind:
        return []
    return CallResult.of(step).calls


def answer_of(step: StepRun | None) -> Answer:
    """Return the response to the first call of a step, None without one."""
    calls = _calls(step)
    return calls[0].response if calls else None


def _latency_s(call: CallRecord) -> float:
    return (call.ended_ns - call.started_ns) / 1e9


def problem_of(step: StepRun | None) -> str:
    """Describe the problem of a call without an answer."""
    calls = _calls(step)
    if calls:
        return f"No answer came within {_latency_s(calls[0]):.1f} s."
    return f"The call could not be made{problem_said(step)}."


def problem_said(step: StepRun | None) -> str:
    """Return the problem that a step reports, after a colon; empty if there is none."""
    if step is None:
        return ""
    problem = StepResult.of(step).problem
    return f": {problem}" if problem else ""


def call_location(context: Context, step: StepRun | None) -> Location:
    """Point at the calls of a step."""
    if step is None:
        return context.location()
    service = CallResult.of(step).service or CallStep.given(step).service
    return context.location(service, Span(step.started_ns, step.ended_ns or step.started_ns))


def shown(response: Answer) -> str:
    """Return the fields of an answer or a request, such as `success=True, message='on'`."""
    if response is None:
        return "no answer"
    return ", ".join(f"{name}={value!r}" for name, value in response.items())


def _silent(step: StepRun) -> bool:
    if step.kind != "call":
        return False
    return all(call.response is None for call in _calls(step))


def not_asked(context: Context, step: StepRun | None, kind: str) -> str:
    """Say, as a clause, that a service or action was called by the lab's name and has another name.

    Empty if it was called by its own name.
    """
    name = None
    if step is not None:
        name = step.parameters.get(kind)
    used = context.session.used(str(name))
    if name is None or used == name:
        return ""
    if _awaited(context, kind, name):
        return ""
    return f"it was called as {name}, and yours is named {used}"


def _awaited(context: Context, kind: str, name: str) -> bool:
    """Tell whether a step waits for a service or action of this name."""
    for step in context.session.record.steps:
        if step.kind == "wait_for" and step.parameters.get(kind) == name:
            return True
    return False


def earlier_silence(context: Context, step: StepRun | None, expected: str) -> Finding | None:
    """State that a call was not tested because an earlier one had no answer either.

    Both are the same mistake. None if all earlier calls were answered.
    """
    why = not_asked(context, step, "service")
    if why:
        return not_reached(f"Not tested, because {why}. {THEN_THESE}", expected=expected)
    for earlier in _steps_before(context, step):
        if _silent(earlier):
            reason = f'Not tested, because the call "{earlier.label}" got no answer. {THEN_THESE}'
            if _calls(step):
                reason = f'No answer came, as none did to the call "{earlier.label}". {THEN_THESE}'
            return not_reached(reason, expected=expected)
    return None


def _steps_before(context: Context, step: StepRun | None) -> Sequence[StepRun]:
    """Return the steps before a step, or all steps if it was not reached."""
    steps = context.session.record.steps
    if step is not None:
        return steps[: steps.index(step)]
    return steps


THEN_THESE = "Fix that, and these points can be earned too."
_STUCK = "The node does not answer parameter requests either."
_UNANSWERED_HINT = "End the service callback with `return response`, and do not wait in it."
_GUESS = "it does not spin, or a callback never returns."
_STUCK_HINT = (
    "rclpy.spin(node) must be reached, and each callback must return. A callback that waits for an answer, as "
    "client.call() does, keeps the node from getting it: use call_async()."
)


def silence(context: Context, step: StepRun | None, expected: str, problem: str) -> Finding:
    """State that a call had no answer; only the first such call costs points."""
    earlier = earlier_silence(context, step, expected)
    if earlier is not None:
        return earlier
    reason = problem
    hint = ""
    if _calls(step):
        hint = _UNANSWERED_HINT
        if _ignores_parameter_requests(context):
            reason = f"{problem} {_STUCK}"
            if not _hangs(context):
                reason = f"{reason[:-1]}: {_GUESS}"
            hint = _STUCK_HINT
    where = (call_location(context, step),)
    return unexplained(failed(expected, "no answer", reason, hint=hint, where=where))


def _hangs(context: Context) -> bool:
    """Tell whether the stacks of a program show where it hangs, which the finding then says."""
    artifacts = {run.artifact for run in context.session.students if run.artifact}
    return any(context.hang(artifact) for artifact in artifacts)


def _ignores_parameter_requests(context: Context) -> bool:
    """Tell whether the node left a request for its parameters unanswered."""
    for step in context.session.record.steps:
        if step.kind == "get_parameters" and step.outcome == "timeout":
            return True
    return False


@dataclass(frozen=True)
class _Answered:
    """An answer to the call that a check is about."""

    response: Mapping[str, Any]
    expected: str
    measured: str
    where: tuple[Location, ...]


def call_answered(context: Context, p: CallAnswered) -> Finding:
    """Judge one answer."""
    step = _step_that_counts(context, p)
    if step is None:
        request = {}
    else:
        request = CallStep.given(step).request
    expected = f"{shown(request)} → {shown(p.response)}"
    if p.contrary is not None:
        expected += ", with a message that does not say the opposite"
    response = answer_of(step)
    where = (call_location(context, step),)
    if response is None:
        return silence(context, step, expected, problem_of(step))
    same = same_request(context, step)
    if same is not None:
        fields = " or ".join(request)
        reason = f"A request of this type has no field {fields}, so nobody can ask for this: "
        reason += f"it is the same as that of '{same.label}'."
        return failed(expected, "the same request", reason, where=where)
    measured = f"{shown(response)} after {_latency_s(_calls(step)[0]) * 1e3:.1f} ms"
    answered = _Answered(response, expected, measured, where)
    finding = _wrong_fields(answered, p)
    if finding is not None:
        return context.charge(finding, _answer_cause(step))
    finding = _judge_state(context, answered, p)
    if finding is not None:
        return finding
    return _judge_message(answered, p)


def _judge_state(context: Context, answered: _Answered, p: CallAnswered) -> Finding | None:
    """Charge the states that the answers to one request report; None if all are right."""
    later = _later_answers(context, p)
    finding = _contrary(answered, p, later)
    if finding is not None:
        # Without a cause, each report of the opposite misleads by itself.
        return context.charge(finding, p.contrary_cause, [p.again_charged_by])
    finding = _changed(answered, p, later)
    if finding is not None:
        cause = f"later answers of {_service_of(_step_that_counts(context, p))}"
        return context.charge(finding, cause, [p.again_charged_by])
    return None


def _service_of(step: StepRun | None) -> str:
    if step is None:
        return ""
    return CallStep.given(step).service


def _answer_cause(step: StepRun | None) -> str:
    request: Mapping[str, Any] = {}
    if step is not None:
        request = CallStep.given(step).request
    return answer_cause(_service_of(step), request)


def answer_cause(service: str, request: Mapping[str, Any]) -> str:
    """Name the mistake of a wrong answer to a request."""
    return f"answer of {service} to {shown(request)}"


def parameter_cause(node: str, parameter: str) -> str:
    """Name the mistake of a parameter with another name or type."""
    return f"parameter {parameter} of {node}"


def _step_that_counts(context: Context, p: CallAnswered) -> StepRun | None:
    """Return the call to judge, which depends on the value of a parameter if one is given."""
    if p.given is not None:
        value = context.parameter(p.given.step, p.given.name)
        if isinstance(value, type(p.given.value)) and value != p.given.value:
            return context.session.step(p.given.instead)
    return context.session.step(p.step)


def _wrong_fields(answered: _Answered, p: CallAnswered) -> Finding | None:
    """State which fields of an answer have other values; None if all are right."""
    wrong = []
    for name, value in p.response.items():
        if name not in answered.response:
            wrong.append(f"there is no field {name}")
        elif answered.response[name] != value:
            wrong.append(f"{name} is {answered.response[name]!r}, not {value!r}")
    if not wrong:
        return None
    reason = f"In the answer, {' and '.join(wrong)}."
    return failed(answered.expected, answered.measured, reason, where=answered.where)


def _contrary(
    answered: _Answered, p: CallAnswered, later: Sequence[Mapping[str, Any]]
) -> Finding | None:
    """State that an answer means the opposite of the request; None if all are right."""
    for answer in (answered.response, *later):
        if _contradicts(p, answer):
            reason = f"It answers this request with {shown(answer)}, which means the opposite."
            hint = (
                "Set the state to request.data first, and compose the message from the new state."
            )
            return _less_for_answer(0.0, answered, reason, hint)
    return None


def _changed(
    answered: _Answered, p: CallAnswered, later: Sequence[Mapping[str, Any]]
) -> Finding | None:
    """State that a later answer to the request is another one; None if all are equal."""
    for answer in later:
        if not _fits(answer, p.response):
            reason = f"To the same request it answers {shown(answer)} later."
            hint = "Answer each request by its own content, whatever the previous state was."
            return _less_for_answer(p.changed_credit, answered, reason, hint)
    return None


def _less_for_answer(share: float, answered: _Answered, reason: str, hint: str = "") -> Finding:
    """State that an answer earns only a share of the credit."""
    return graded(
        share, answered.expected, answered.measured, reason, hint=hint, where=answered.where
    )


def _judge_message(answered: _Answered, p: CallAnswered) -> Finding:
    """Judge the message of an answer that is right otherwise."""
    text = str(answered.response.get(p.message_field, ""))
    notes = []
    if p.message is not None:
        if not text.strip():
            reason = "The answer's message is empty."
            return _less_for_answer(p.wordless_credit, answered, reason)
        if not search(p.message, text):
            notes.append(f"The message {text!r} is not worded as in the lab.")
    return passed(answered.expected, answered.measured, where=answered.where, notes=notes)


def _fits(answer: Answer, wanted: Mapping[str, Any]) -> bool:
    if answer is None:
        return False
    return all(answer.get(name) == value for name, value in wanted.items())


def _was_sent(step: StepRun | None) -> bool:
    """Tell whether a call was made with the rubric's request.

    The student's type may lack some fields of it.
    """
    if step is None:
        return False
    sent = CallResult.of(step).request
    return sent is None or sent == CallStep.given(step).request


def same_request(context: Context, step: StepRun | None) -> StepRun | None:
    """Return an earlier call with the same request, though the rubric has another request for it.

    The student's type then lacks the fields that differ. None if there is no such call.
    """
    if step is None or _was_sent(step):
        return None
    request = CallStep.given(step).request
    for earlier in _steps_before(context, step):
        if earlier.kind == step.kind and CallStep.given(earlier).request != request:
            return earlier
    return None


def _later_answers(context: Context, p: CallAnswered) -> list[Mapping[str, Any]]:
    """Return the answers to a later step with the same request."""
    step = context.session.step(p.step)
    later = None
    if p.again:
        later = context.session.step(p.again)
    if step is None or later is None:
        return []
    if not _was_sent(step) or not _was_sent(later):
        return []
    if CallStep.given(step).request != CallStep.given(later).request:
        return []
    return [call.response for call in _calls(later) if call.response is not None]


def _contradicts(p: CallAnswered, answer: Mapping[str, Any]) -> bool:
    """Tell whether a message says the contrary of the request alone.

    The message "enabled (was disabled)" says both, and does not contradict.
    """
    if p.contrary is None:
        return False
    rest, found = without(p.contrary, str(answer.get(p.message_field, "")))
    if not found:
        return False
    return p.message is None or not search(p.message, rest)


class WantedParameter(Parameters):
    """A parameter with its type and default."""

    name: ref.GivenName
    type: ref.ParameterType
    value: Any


class ParametersDeclared(Parameters):
    """A node declares parameters with defaults; each is a part, half for being declared."""

    step: ref.GetLabel
    parameters: tuple[WantedParameter, ...] = Field(min_length=1)
    other_value_credit: Share = Field(
        0.5, description="Credit of one that is declared with another type or default."
    )
    other_type_costs: Share = Field(
        0.0,
        description="Share of the whole that another type costs: a value of the wanted type ends the node.",
    )


def parameters_declared(context: Context, p: ParametersDeclared) -> Finding:
    """Judge the parameters as the running node gives them."""
    expected = ", ".join(f"{wanted.name} = {wanted.value!r}" for wanted in p.parameters)
    step = context.session.step(p.step)
    if step is None or step.outcome != "done":
        return _not_read(context, step, expected)
    values = GetParametersResult.of(step).read
    node = GetParametersStep.given(step).node
    parts = []
    costs = []
    for wanted in p.parameters:
        got = values.get(wanted.name)
        overwritten = _overwritten(context)
        if got is None and overwritten is not None:
            parts.append(overwritten)
            continue
        part = _judge_parameter(wanted, got, p)
        part = context.charge_part(part, parameter_cause(node, wanted.name))
        if part.share < 1:
            costs.append((_cost_of_type(wanted, got, p), ""))
        parts.append(part)
    read = [f"{name} = {got.value!r}" for name, got in values.items()]
    measured = ", ".join(read) or "none of them"
    return of_parts(expected, parts, measured=measured, costs=costs)


def _cost_of_type(
    wanted: WantedParameter, got: ParameterValue | None, p: ParametersDeclared
) -> float:
    """Return the share of the whole that another type of a parameter costs."""
    if got is None:
        return 0.0
    if got.type == wanted.type:
        return 0.0
    return p.other_type_costs


def _overwritten(context: Context) -> Part | None:
    """Charge an overwritten attribute of the node; None without one."""
    students = context.session.students
    if not students:
        return None
    found = context.overwritten(students[0].artifact)
    if found is None:
        return None
    part = Part(0.0, reason=found.problem, hint=found.remedy)
    return context.charge_part(part, found.problem)


def _not_read(context: Context, step: StepRun | None, expected: str) -> Finding:
    """State that the parameters could not be read."""
    if step is not None and any(map(_silent, context.session.record.steps)):
        why = "it answers no call"
        if step.outcome == "cancelled":
            why = "the node had ended before it could be asked"
        return not_reached(f"Not tested: {why}. {THEN_THESE}", expected=expected)
    reason = f"The node's parameters could not be read{problem_said(step)}."
    return failed(expected, "no answer", reason)


def _judge_parameter(
    wanted: WantedParameter, got: ParameterValue | None, p: ParametersDeclared
) -> Part:
    """Judge type and value of one parameter; None if the node did not give it."""
    if got is None:
        return Part(0.0, reason=f"{wanted.name} is not declared.")
    if (got.type, got.value) == (wanted.type, wanted.value):
        return Part(1.0)
    is_so = f"{got.value!r} ({got.type})"
    reason = f"{wanted.name} is {is_so}, not {wanted.value!r} ({wanted.type})."
    return Part(p.other_value_credit, reason=reason)
