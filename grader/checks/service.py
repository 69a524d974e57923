"""Checks of a node that serves: the service offered, its answers, its parameters, its quickness.

All answers come from the grader's own client calls.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from grader.checks.base import (
    Context,
    Part,
    apart,
    failed,
    graded,
    not_reached,
    of_parts,
    passed,
    unclear,
    unexplained,
)
from grader.checks.endpoints import OfEndpoint, claim_of, claimed_at
from grader.evidence.cpu_delay import Span
from grader.lab import references as ref
from grader.lab.patterns import search, without
from grader.lab.references import Parameters, Pattern, Share
from grader.recording.session import StepRun
from grader.result import Finding, Location, Outcome


class ServiceOffered(OfEndpoint):
    """A node offers a service of a type under a name."""

    artifact: ref.Artifact
    service: ref.RosName
    type: ref.ServiceType


def service_offered(context: Context, p: ServiceOffered) -> Finding:
    """Judge the service from discovery."""
    expected = f"{p.service} of type {p.type}" + (f", from node {p.node}" if p.node else "")
    used = context.session.used(p.service)
    offers = [s for graph in context.session.record.graph for s in graph.services if s.name == used]
    offers = [s for s in offers if s.node not in context.reference_nodes]
    call = next((step for step in context.session.record.steps if step.kind == "call"), None)
    run = next(iter(context.session.processes_of(p.artifact)), None)
    # The graph may have had the service of a node that ended at once for a moment, in which nobody could call it.
    too_short = (
        call is not None
        and run is not None
        and (run.exited_ns or call.started_ns) < call.started_ns
    )
    if not offers or too_short:
        fallback = f"The service {p.service} did not appear, nor one of a similar name. A client would wait forever."
        return unexplained(failed(expected, "no service in the graph", fallback))
    offer = next((s for s in offers if s.type == p.type), offers[0])
    wrong = p.faults("service", (p.service, p.type), (used, offer.type), [offer.node])
    wrong += p.node_faults([offer.node])
    measured = f"{used} of type {offer.type}, from {offer.node}"
    where = (*claimed_at(claim_of(context, "service", p.service)), context.location())
    return of_parts(expected, [Part(1.0, measured)], costs=wrong, where=where)


class Given(Parameters):
    """A parameter with the value under which an answer is asked for; its own default is judged elsewhere."""

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
    again: ref.CallLabel | None = Field(
        None, description="A later step with the same request, which must get the same answer."
    )
    again_charged_by: ref.EarlierCheckId | None = Field(
        None,
        description="Where this check took points, neither a later answer nor a contrary message takes any.",
    )
    given: Given | None = Field(None, description="A parameter on which the answer depends.")
    changed_credit: Share = Field(
        0.75, description="Credit of a right answer that is another one later."
    )
    wordless_credit: Share = Field(
        0.75, description="Credit of a right answer whose message is empty."
    )


def _calls(step: StepRun | None) -> list[Mapping[str, Any]]:
    return step.result.get("calls", []) if step is not None else []


def answer_of(step: StepRun | None) -> Mapping[str, Any] | None:
    """Return the response to the first call of a step, None without one."""
    calls = _calls(step)
    return calls[0]["response"] if calls else None


def _latency_s(call: Mapping[str, Any]) -> float:
    return float(call["ended_ns"] - call["started_ns"]) / 1e9


def problem_of(step: StepRun | None) -> str:
    """Say what went wrong in place of an answer."""
    if calls := _calls(step):
        return f"No answer came within {_latency_s(calls[0]):.1f} s."
    problem = str(step.result.get("problem", "")) if step is not None else ""
    return f"The call could not be made{': ' + problem if problem else ''}."


def call_location(context: Context, step: StepRun | None) -> Location:
    """Point at the calls of a step."""
    if step is None:
        return context.location()
    service = step.result.get("service") or step.parameters.get("service")
    return context.location(service, Span(step.started_ns, step.ended_ns or step.started_ns))


def shown(response: Mapping[str, Any] | None) -> str:
    """Return an answer, or a request, in words."""
    return "no answer" if response is None else ", ".join(f"{k}={v!r}" for k, v in response.items())


def _silent(step: StepRun) -> bool:
    return step.kind == "call" and all(c["response"] is None for c in _calls(step))


def not_asked(context: Context, step: StepRun | None, kind: str) -> str:
    """Say, as a clause, that a service or action was asked for by the lab's name, and has another; empty if not so."""
    name = step.parameters.get(kind) if step is not None else None
    awaited = any(
        s.kind == "wait_for" and s.parameters.get(kind) == name
        for s in context.session.record.steps
    )
    used = context.session.used(str(name))
    return (
        ""
        if name is None or awaited or used == name
        else f"it was called as {name}, and yours is named {used}"
    )


def earlier_silence(context: Context, step: StepRun | None, expected: str) -> Finding | None:
    """State that a call could not be judged since an earlier one had no answer either; that is one mistake."""
    if why := not_asked(context, step, "service"):
        return not_reached(f"Not tested, because {why}. {THEN_THESE}", expected=expected)
    steps = context.session.record.steps
    before = steps[: steps.index(step)] if step is not None else steps
    silent = next((earlier for earlier in before if _silent(earlier)), None)
    if silent is None:
        return None
    reason = f'Not tested, because the call "{silent.label}" got no answer. {THEN_THESE}'
    return not_reached(reason, expected=expected)


THEN_THESE = "Fix that, and these points can be earned too."
_STUCK = "The node does not answer parameter requests either: it does not spin, or a callback never returns."
_UNANSWERED_HINT = "End the service callback with `return response`, and do not wait in it."
_STUCK_HINT = (
    "rclpy.spin(node) must be reached; and a callback that waits for an answer, as client.call() does, keeps the node "
    "from getting it: use call_async()."
)


def silence(context: Context, step: StepRun | None, expected: str, problem: str) -> Finding:
    """State that a call had no answer, which is charged once: with the first of them."""
    steps = context.session.record.steps
    stuck = bool(_calls(step)) and any(
        s.kind == "get_parameters" and s.outcome == "timeout" for s in steps
    )
    hint = _STUCK_HINT if stuck else _UNANSWERED_HINT if _calls(step) else ""
    reason = f"{problem} {_STUCK}" if stuck else problem
    fails = failed(expected, "no answer", reason, hint=hint, where=(call_location(context, step),))
    return earlier_silence(context, step, expected) or unexplained(fails)


def call_answered(context: Context, p: CallAnswered) -> Finding:
    """Judge one answer."""
    step = context.session.step(p.step)
    if p.given is not None:
        value = context.parameter(p.given.step, p.given.name)
        otherwise = isinstance(value, type(p.given.value)) and value != p.given.value
        step = context.session.step(p.given.instead) if otherwise else step
    request = step.parameters.get("request", {}) if step is not None else {}
    expected = f"{shown(request)} → {shown(p.response)}"
    response = answer_of(step)
    where = (call_location(context, step),)
    if response is None:
        return silence(context, step, expected, problem_of(step))
    if (same := same_request(context, step)) is not None:
        reason = f"A request of this type has no field {' or '.join(request)}, so nobody can ask for this: "
        return failed(
            expected,
            "the same request",
            f"{reason}it is the same as that of '{same.label}'.",
            where=where,
        )
    measured = f"{shown(response)} after {_latency_s(_calls(step)[0]) * 1e3:.1f} ms"
    wrong = [
        f"{k} is {response.get(k)!r}, not {v!r}"
        for k, v in p.response.items()
        if response.get(k) != v
    ]
    if wrong:
        return failed(expected, measured, f"In the answer, {' and '.join(wrong)}.", where=where)
    later = [] if context.charged(p.again_charged_by) else _later_answers(context, p)
    contrary = next((answer for answer in (response, *later) if _contradicts(p, answer)), None)
    if contrary is not None and not context.charged(p.again_charged_by):
        reason = f"It answers this request with {shown(contrary)}, which means the opposite."
        hint = "Set the state to request.data instead of toggling it, and report the new state, not the previous one."
        return failed(expected, measured, reason, hint=hint, where=where)
    if (
        changed := next((answer for answer in later if not _fits(answer, p.response)), None)
    ) is not None:
        reason = f"To the same request it answers {shown(changed)} later."
        hint = "Answer each request by its own content, whatever the previous state was."
        return graded(p.changed_credit, expected, measured, reason, hint=hint, where=where)
    text = str(response.get(p.message_field, ""))
    if p.message is not None and not text.strip():
        return graded(
            p.wordless_credit, expected, measured, "The answer's message is empty.", where=where
        )
    other_words = p.message is not None and not search(p.message, text)
    notes = [f"The message {text!r} is not worded as in the lab."] if other_words else []
    return passed(expected, measured, where=where, notes=notes)


def _fits(answer: Mapping[str, Any] | None, wanted: Mapping[str, Any]) -> bool:
    return answer is not None and all(answer.get(k) == v for k, v in wanted.items())


def _was_sent(step: StepRun | None) -> bool:
    """Whether a call was made as the rubric has it: the student's type may lack some of the request's fields."""
    asked = step.parameters.get("request") if step is not None else None
    return step is not None and step.result.get("request", asked) == asked


def same_request(context: Context, step: StepRun | None) -> StepRun | None:
    """Return an earlier call that should have been another one, but for lack of a field was the same."""
    if step is None or _was_sent(step):
        return None
    steps = context.session.record.steps
    earlier = (s for s in steps[: steps.index(step)] if s.kind == step.kind)
    return next(
        (s for s in earlier if s.parameters.get("request") != step.parameters.get("request")), None
    )


def _later_answers(context: Context, p: CallAnswered) -> list[Mapping[str, Any]]:
    """Return the answers of the later step, if it made the same request."""
    step, later = context.session.step(p.step), context.session.step(p.again) if p.again else None
    requests = [
        s.parameters.get("request") for s in (step, later) if s is not None and _was_sent(s)
    ]
    alike = len(requests) == 2 and requests[0] == requests[1]
    return [c["response"] for c in _calls(later) if c["response"] is not None] if alike else []


def _contradicts(p: CallAnswered, answer: Mapping[str, Any]) -> bool:
    """Whether a message says the contrary of the request, and not what is wanted too, as "enabled (was disabled)"."""
    rest, found = (
        without(p.contrary, str(answer.get(p.message_field, "")))
        if p.contrary is not None
        else ("", False)
    )
    return bool(found) and not (p.message is not None and search(p.message, rest))


class CallGated(Parameters):
    """A parameter decides over the answer, and may be changed while the node runs."""

    set_step: ref.SetLabel = Field(description="The step that sets the parameter.")
    refused_step: ref.CallLabel
    recovered_step: ref.CallLabel
    from_start_step: ref.CallLabel = Field(
        description="The call to a node that had the parameter from its start."
    )
    allowed_step: ref.CallLabel | None = Field(
        None, description="A call that must be answered as ever while the parameter is off."
    )
    enables: ref.EarlierCheckId | None = Field(
        None,
        description="Check of the answer in the normal case; if that one fails, this is not tested.",
    )
    allowed_charged_by: ref.EarlierCheckId | None = Field(
        None,
        description="Where this check took points, another answer to the allowed call takes none.",
    )
    refused: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "refused_step")]
    recovered: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "recovered_step")]
    message_field: Annotated[str, ref.fields_of_type("_Response", "refused_step")] = "message"
    allowed: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "allowed_step")] = Field(
        default_factory=dict
    )
    refusal: Pattern | None = Field(
        None, description="A message that refuses, whatever the other fields say."
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


def call_gated(context: Context, p: CallGated) -> Finding:
    """Judge refusal, and recovery after it; recovery alone earns nothing, a refusal only from the start little."""
    refused, recovered = shown(p.refused), shown(p.recovered)
    expected = f"{refused} while the parameter is off, and after such a refusal {recovered} when it is on again"
    steps = {
        name: context.session.step(name)
        for name in (p.refused_step, p.recovered_step, p.from_start_step)
    }
    off, on, started_off = (answer_of(step) for step in steps.values())
    refuses, recovers, refuses_at_start = (
        _fits(off, p.refused),
        _fits(on, p.recovered),
        _fits(started_off, p.refused),
    )
    measured = f"off: {shown(off)}; on again: {shown(on)}; off from the start: {shown(started_off)}"
    where = tuple(call_location(context, step) for step in steps.values())
    enabling = context.findings.get(p.enables) if p.enables is not None else None
    fails = enabling is not None and enabling.outcome in (Outcome.FAILED, Outcome.NOT_REACHED)
    turned = fails and _fits(off, p.recovered) and _fits(on, p.refused)
    if fails and not turned and not (refuses and recovers):
        reason = "Not tested: the robot cannot be enabled at all, so a refusal proves nothing."
        return not_reached(reason, expected=expected)
    if off is None and not turned:
        step = steps[p.refused_step]
        if not_asked(context, step, "service") or earlier_silence(context, step, expected) is None:
            return silence(context, step, expected, "No answer came while the parameter was false.")
        reason = "Not tested, because the node had already stopped answering."
        return graded(
            p.half_credit * refuses_at_start,
            expected,
            measured,
            reason,
            hint=THEN_THESE,
            where=where,
        )
    unset = _not_set(context.session.step(p.set_step))
    words = str(off.get(p.message_field, "")) if off is not None else ""
    allowed_step = context.session.step(p.allowed_step) if p.allowed_step is not None else None
    allowed = answer_of(allowed_step) if _was_sent(allowed_step) else None
    is_charged = context.charged(p.allowed_charged_by)
    disallows = refuses and allowed is not None and not is_charged and not _fits(allowed, p.allowed)
    only_message = recovers and p.refusal is not None and search(p.refusal, words)
    rows: tuple[tuple[object, float, str, str], ...] = (
        (turned, p.half_credit, _REVERSED, "Invert the condition."),
        (disallows, p.disallowed_credit, f"{_DISALLOWS} {shown(allowed)}.", _DISALLOWS_HINT),
        (refuses and recovers, 1.0, "", ""),
        (
            refuses,
            p.half_credit,
            "It refuses, but does not recover when the parameter is true again.",
            "",
        ),
        (
            only_message,
            p.half_credit,
            _ONLY_MESSAGE,
            "Set the success field to False too, not only the message.",
        ),
        (refuses_at_start and unset, p.half_credit, f"{_AT_START} {unset}", _SET_HINT),
        (
            refuses_at_start,
            p.from_start_credit,
            f"{_AT_START} a change while it runs has no effect.",
            "",
        ),
        (unset, 0.0, f"It still enables the robot, because {unset}", _SET_HINT),
        (True, 0.0, "It enables although the parameter is false.", ""),
    )
    _, share, reason, hint = next(row for row in rows if row[0])
    return graded(share, expected, measured, reason, hint=hint, where=where)


def _not_set(step: StepRun | None) -> str:
    """Say that the parameter could not be set while the node ran, and what the node answered, if so."""
    if step is None or step.outcome == "done":
        return ""
    why = "; ".join(str(problem).rstrip(".") for problem in step.result.get("refused", {}).values())
    return f"the parameter could not be set while it ran{': ' + why if why else ''}."


_AT_START = "It refuses only when the parameter is false from the start;"
_ONLY_MESSAGE = (
    "Its message refuses, but the other fields report success, and client programs read those."
)
_DISALLOWS = "While the parameter is false it refuses what must always be possible too:"
_DISALLOWS_HINT = (
    "Let the parameter decide over enabling alone; to disable must always be possible."
)
_REVERSED = "It follows the parameter, but inverted: it enables while it is false and refuses while it is true."
_SET_HINT = "Declare the parameter with a default of the type that the lab gives it, not read-only; others can then set it."


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


def parameters_declared(context: Context, p: ParametersDeclared) -> Finding:
    """Judge the parameters as the running node gives them."""
    expected = ", ".join(f"{w.name} = {w.value!r}" for w in p.parameters)
    step = context.session.step(p.step)
    read = step is not None and step.outcome == "done"
    if step is not None and not read and any(map(_silent, context.session.record.steps)):
        ended = (
            "the node had ended before it could be asked"
            if step.outcome == "cancelled"
            else "it answers no call"
        )
        return not_reached(f"Not tested: {ended}. {THEN_THESE}", expected=expected)
    if step is None or not read:
        problem = str(step.result.get("problem", "")) if step is not None else ""
        reason = f"The node's parameters could not be read{': ' + problem if problem else ''}."
        return failed(expected, "no answer", reason)
    values: Mapping[str, Mapping[str, Any]] = step.result["values"]
    parts = []
    for wanted in p.parameters:
        got = values.get(wanted.name, {"type": "", "value": None})
        right = (got["type"], got["value"]) == (wanted.type, wanted.value)
        reason = f"{wanted.name} is {got['value']!r} ({got['type']}), not {wanted.value!r} ({wanted.type})."
        reason = reason if wanted.name in values else f"{wanted.name} is not declared."
        share = p.other_value_credit if wanted.name in values else 0.0
        parts.append(Part(1.0) if right else Part(share, reason=reason))
    measured = ", ".join(f"{n} = {v['value']!r}" for n, v in values.items()) or "none of them"
    return of_parts(expected, parts, measured=measured)


class CallsInTime(Parameters):
    """Calls back to back are each answered in time."""

    step: ref.CallLabel
    within_s: float = Field(gt=0)
    enough: int = Field(
        10,
        description="If all answers were in time, this many calls are enough where there was no time for more.",
    )


def calls_in_time(context: Context, p: CallsInTime) -> Finding:
    """Judge the share of calls answered in time."""
    step = context.session.step(p.step)
    wanted = int(step.parameters.get("repeat", 1)) if step is not None else 1
    expected = f"{wanted} calls, each answered within {p.within_s:g} s"
    calls, where = _calls(step), (call_location(context, step),)
    if step is None or _silent(step):
        return silence(context, step, expected, problem_of(step))
    latencies = [_latency_s(call) for call in calls if call["response"] is not None]
    quick = sum(latency <= p.within_s for latency in latencies)
    slowest = (
        f", slowest {apart(max(latencies) * 1e3, p.within_s * 1e3, places=1)} ms"
        if latencies
        else ""
    )
    measured = f"{quick} of {len(calls)} calls made in time{slowest}"
    few = f"There was time for {len(calls)} of {wanted} calls." if len(calls) < wanted else ""
    if few and quick == len(calls) < p.enough:
        return unclear(expected, measured, f"{few} Those were answered in time.")
    # How long the machine delayed a process in a call, that which makes it included, may be why it took so long.
    spans = [Span(int(call["started_ns"]), int(call["ended_ns"])) for call in calls]
    delays = [asking_delay_s(context, *each) for each in zip(spans, calls, strict=True)]
    best = sum(
        _latency_s(call) - delay <= p.within_s for call, delay in zip(calls, delays, strict=True)
    ) / len(calls)
    share, notes = quick / len(calls), [few] if few else []
    doubt = f"Not your fault: the grading computer was too busy to time the calls (up to {max(delays):.2f} s)."
    reason = f"{len(calls) - quick} of {len(calls)} calls took longer than {p.within_s:g} s, or got no answer."
    reason += (
        f" The quickest took {apart(min(latencies), p.within_s, places=2)} s."
        if latencies and not quick
        else ""
    )
    return graded(
        share,
        expected,
        measured,
        reason,
        where=where,
        notes=notes,
        best=max(share, best),
        doubt=doubt,
    )


def asking_delay_s(context: Context, span: Span, asked: Mapping[str, Any]) -> float:
    """Return for how long the machine delayed a process within a span, that which asked included, by its record."""
    own_s = context.session.recorder_delay_s(span) + int(asked.get("held_up_ns", 0)) / 1e9
    return context.session.longest_delay_s(span) + own_s
