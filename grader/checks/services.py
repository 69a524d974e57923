"""Checks of a node that serves: the service offered, its answers, its parameters, its quickness.

All answers come from the grader's own client calls.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from grader import references as ref
from grader.checks.endpoints import OfEndpoint, claimed_at
from grader.checks.finding import (
    Context,
    apart,
    ended_already,
    failed,
    graded,
    inconclusive,
    not_reached,
    nothing_seen,
    passed,
    unclear,
    why_nothing,
)
from grader.evidence.recorded import Span
from grader.patterns import search, without
from grader.recording.session import StepRun
from grader.references import Parameters, Pattern, Share
from grader.result import Finding, Outcome, Where


class ServiceOffered(OfEndpoint):
    """A node offers a service of a type under a name."""

    artifact: ref.Artifact
    service: ref.RosName
    type: ref.ServiceType
    node: ref.RosName | None = None


def service_offered(context: Context, p: ServiceOffered) -> Finding:
    """Judge the service from discovery."""
    expected = f"{p.service} of type {p.type}" + (f", from node {p.node}" if p.node else "")
    used = context.session.used(p.service)
    offers = [s for graph in context.session.record.graph for s in graph.services if s.name == used]
    offers = [s for s in offers if s.node not in context.reference_nodes]
    if not offers:
        fallback = f"The service {p.service} never came up, nor one of a similar name. A client would wait in vain."
        return nothing_seen(context, p.artifact, expected, fallback, "service", [p.service])
    offer = next((s for s in offers if s.type == p.type), offers[0])
    wrong = p.faults("service", (p.service, p.type), (used, offer.type), [offer.node])
    wrong += p.node_faults(p.node, [offer.node])
    measured = f"{used} of type {offer.type}, from {offer.node}"
    where = (*claimed_at(context, "service", p.service), context.where())
    return graded(1 - sum(w for w, _ in wrong), expected, measured, " ".join(r for _, r in wrong), where=where)


class Given(Parameters):
    """A parameter with the value under which an answer is asked for; its own default is judged elsewhere."""

    step: ref.GetLabel = Field(description="The step that read the parameter.")
    name: str
    value: Any
    instead: ref.CallLabel = Field(description="The call that counts where the node began with another value.")


class CallAnswered(Parameters):
    """A call is answered with the right values; an empty message, or another answer later, costs a part."""

    artifact: ref.Artifact
    step: ref.CallLabel
    response: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "step")] = Field(
        description="Fields that must have these values."
    )
    message_field: Annotated[str, ref.fields_of_type("_Response", "step")] = "message"
    message: Pattern | None = Field(None, description="Regular expression for the message field.")
    contrary: Pattern | None = Field(None, description="A message that matches says the contrary: no credit.")
    again: ref.CallLabel | None = Field(None, description="A later step with the same request, to be answered alike.")
    again_charged_by: ref.EarlierCheckId | None = Field(
        None, description="Where this check took points, neither a later answer nor a contrary message takes any."
    )
    opposite: ref.CallLabel | None = Field(
        None, description="A step at which this answer would be wrong, to see a mix-up."
    )
    given: Given | None = Field(None, description="A parameter on which the answer depends.")
    changed_credit: Share = Field(0.75, description="Credit of a right answer that is another one later.")
    wordless_credit: Share = Field(0.75, description="Credit of a right answer whose message is empty.")


def _answer(step: StepRun | None) -> tuple[Mapping[str, Any] | None, float, str]:
    """Return the response of a call step, its latency in s, and what went wrong instead."""
    calls = step.result.get("calls", []) if step is not None else []
    if step is None or not calls:
        problem = str(step.result.get("problem", "")) if step is not None else ""
        return None, 0.0, f"The call could not be made{': ' + problem if problem else ''}."
    latency_s = (calls[0]["ended_ns"] - calls[0]["started_ns"]) / 1e9
    if calls[0]["response"] is None:
        return None, latency_s, f"No answer came within {latency_s:.1f} s."
    return calls[0]["response"], latency_s, ""


def _spot(context: Context, step: StepRun | None) -> Where:
    if step is None:
        return context.where()
    service = step.result.get("service") or step.parameters.get("service")
    return Where(
        session=context.session.record.session,
        topic=service,
        start_s=context.session.since_start_s(step.started_ns),
        end_s=context.session.since_start_s(step.ended_ns or step.started_ns),
    )


def _shown(response: Mapping[str, Any] | None) -> str:
    return "no answer" if response is None else ", ".join(f"{k}={v!r}" for k, v in response.items())


def _silent(step: StepRun) -> bool:
    calls = step.result.get("calls", [])
    return step.kind == "call" and all(c["response"] is None for c in calls)


def _other_type(context: Context, step: StepRun | None) -> str | None:
    """Return the type under which the service of a call is offered, if it is never offered under the call's."""
    if step is None:
        return None
    name = context.session.used(str(step.parameters.get("service")))
    types = {s.type for graph in context.session.record.graph for s in graph.services if s.name == name}
    return min(types) if types and step.parameters.get("type") not in types else None


def _earlier_silence(context: Context, step: StepRun | None, expected: str) -> Finding | None:
    """State that a call could not be judged since an earlier one had no answer either; that is one mistake."""
    steps = context.session.record.steps
    before = steps[: steps.index(step)] if step is not None else steps
    silent = next((earlier for earlier in before if _silent(earlier)), None)
    if silent is None:
        return None
    called = f'the call "{silent.label}"' if silent.label else "an earlier call"
    return not_reached(f"Not tested, because {called} got no answer. {_THEN_THESE}", expected=expected)


_THEN_THESE = "Fix that, and these points can be earned too."


_STUCK = "it does not spin, or one of its callbacks never returns."
_STUCK_HINT = (
    "rclpy.spin(node) must be reached; and a callback that waits for an answer, as client.call() does, keeps the node "
    "from getting it: use call_async()."
)


def _silence(context: Context, artifact: str, expected: str, problem: str, where: tuple[Where, ...]) -> Finding:
    """Explain why a call had no answer: an exception, a node that does not spin, or a callback that never returns."""
    if context.diagnosis(artifact) is None and (ended := ended_already(context, artifact)) is not None:
        return failed(expected, "no answer", ended[0], hint=ended[1], where=(*ended[2], *where))
    stuck = any(s.kind == "get_parameters" and s.outcome == "timeout" for s in context.session.record.steps)
    unknown = f"The node does not answer questions for its parameters either: {_STUCK}" if stuck else ""
    reason, hint, spots = why_nothing(context, artifact, unknown)
    hint = hint or (_STUCK_HINT if stuck else "A service callback must return its response, and soon.")
    return failed(expected, "no answer", f"{problem} {reason}".strip(), hint=hint, where=(*spots, *where))


def _given_otherwise(context: Context, given: Given) -> bool:
    """Whether a node began with another value of a parameter than the answer is asked for."""
    value = context.parameter(given.step, given.name)
    return isinstance(value, type(given.value)) and value != given.value


def call_answered(context: Context, p: CallAnswered) -> Finding:
    """Judge one answer."""
    step = context.session.step(p.step)
    if p.given is not None and _given_otherwise(context, p.given):
        step = context.session.step(p.given.instead)
    request = step.parameters.get("request", {}) if step is not None else {}
    expected = f"{_shown(request)} → {_shown(p.response)}"
    response, latency_s, problem = _answer(step)
    where = (_spot(context, step),)
    if response is None and (other := _other_type(context, step)):
        reason = f"The service is of type {other}, so it cannot be asked; that is charged where it is offered."
        return not_reached(reason, expected=expected)
    if response is None:
        return _earlier_silence(context, step, expected) or _silence(context, p.artifact, expected, problem, where)
    measured = f"{_shown(response)} after {latency_s * 1e3:.1f} ms"
    wrong = [f"{k} is {response.get(k)!r}, not {v!r}" for k, v in p.response.items() if response.get(k) != v]
    if wrong:
        swapped = _fits(_answer(context.session.step(p.opposite) if p.opposite else None)[0], p.response)
        reason = f"In the answer, {' and '.join(wrong)}.{_SWAPPED if swapped else ''}"
        return failed(expected, measured, reason, where=where)
    charged = context.charged(p.again_charged_by)
    if not charged and (contrary := _contrary(context, p, response)) is not None:
        also = "" if contrary is response else "also "
        reason = f"To this request it {also}answers {_shown(contrary)}, which says the contrary."
        return failed(expected, measured, reason, hint=_CONTRARY_HINT, where=where)
    later = next((a for a in _later_answers(context, p) if not _fits(a, p.response)), None)
    if later is not None and not charged:
        reason = f"To the same request it answers {_shown(later)} later."
        return graded(p.changed_credit, expected, measured, reason, hint=_ALIKE_HINT, where=where)
    text = str(response.get(p.message_field, ""))
    if p.message is not None and not text.strip():
        return graded(p.wordless_credit, expected, measured, "The answer's message is empty.", where=where)
    if p.message is not None and not search(p.message, text):
        note = f"The message {text!r} is worded otherwise than the lab's."
        return passed(expected, measured, where=where, notes=(note,))
    return passed(expected, measured, where=where)


_SWAPPED = " Where this would be right, it answers the contrary: the condition is the wrong way round."
_CONTRARY_HINT = "Do what request.data says, without switching over; and tell the new state, not the one before."
_ALIKE_HINT = "Answer each request by what it asks for, whatever the state was before."


def _fits(answer: Mapping[str, Any] | None, wanted: Mapping[str, Any]) -> bool:
    return answer is not None and all(answer.get(k) == v for k, v in wanted.items())


def _message(answer: Mapping[str, Any] | None, name: str) -> str:
    return str(answer.get(name, "")) if answer is not None else ""


def _later_answers(context: Context, p: CallAnswered) -> list[Mapping[str, Any]]:
    """Return the answers of the later step, if it made the same request."""
    step, later = context.session.step(p.step), context.session.step(p.again) if p.again else None
    alike = step is not None and later is not None and later.parameters.get("request") == step.parameters.get("request")
    calls = later.result.get("calls", []) if later is not None and alike else []
    return [c["response"] for c in calls if c["response"] is not None]


def _contrary(context: Context, p: CallAnswered, first: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the first answer whose message says the contrary of the request, of this step or of the later one.

    One that says what is wanted as well says no contrary, as in "Robot enabled (was disabled)".
    """
    for answer in (first, *_later_answers(context, p)) if p.contrary is not None else ():
        rest, found = without(p.contrary or "", str(answer.get(p.message_field, "")))
        if found and not (p.message is not None and search(p.message, rest)):
            return answer
    return None


class CallGated(Parameters):
    """A parameter decides over the answer, and may be changed while the node runs."""

    set_step: ref.SetLabel = Field(description="The step that sets the parameter.")
    refused_step: ref.CallLabel
    recovered_step: ref.CallLabel
    from_start_step: ref.CallLabel = Field(description="The call to a node that had the parameter from its start.")
    enables: ref.EarlierCheckId | None = Field(
        None, description="Check of the answer while all is well; without it nothing is said."
    )
    refused: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "refused_step")]
    recovered: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "recovered_step")]
    message_field: Annotated[str, ref.fields_of_type("_Response", "refused_step")] = "message"
    refusal: Pattern | None = Field(None, description="A message that refuses, whatever the other fields say.")
    half_credit: Share = Field(0.5, description="Credit of one half, such as refusing without recovering.")


def call_gated(context: Context, p: CallGated) -> Finding:
    """Judge refusal (half) and recovery (half); refusing only with the parameter given at start earns half."""
    expected = (
        f"{_shown(p.refused)} while the parameter is off (half), {_shown(p.recovered)} when it is on again (half)"
    )
    steps = {name: context.session.step(name) for name in (p.refused_step, p.recovered_step, p.from_start_step)}
    answers = {name: _answer(step)[0] for name, step in steps.items()}
    refuses, recovers = _fits(answers[p.refused_step], p.refused), _fits(answers[p.recovered_step], p.recovered)
    measured = f"off: {_shown(answers[p.refused_step])}; on again: {_shown(answers[p.recovered_step])}"
    where = tuple(_spot(context, steps[n]) for n in (p.refused_step, p.recovered_step))
    enabling = context.findings.get(p.enables) if p.enables is not None else None
    fails = enabling is not None and enabling.outcome in (Outcome.FAILED, Outcome.NOT_REACHED)
    if fails and not (refuses and recovers):
        if _fits(answers[p.refused_step], p.recovered) and _fits(answers[p.recovered_step], p.refused):
            return graded(p.half_credit, expected, measured, _REVERSED, hint=_REVERSED_HINT, where=where)
        return not_reached(
            "Not tested: the robot cannot be enabled at all, so a refusal proves nothing.", expected=expected
        )
    if refuses:
        reason = "It refuses, but does not recover when the parameter is true again."
        return graded(1.0 if recovers else p.half_credit, expected, measured, reason, where=where)
    if recovers and p.refusal is not None and search(p.refusal, _message(answers[p.refused_step], p.message_field)):
        return graded(p.half_credit, expected, measured, _ONLY_SAID, hint=_ONLY_SAID_HINT, where=where)
    if answers[p.refused_step] is None:
        started_off = p.half_credit * _fits(answers[p.from_start_step], p.refused)
        return _no_answer_while_off(context, steps[p.refused_step], expected, measured, started_off, where)
    unset = _not_set(context.session.step(p.set_step))
    if _fits(answers[p.from_start_step], p.refused):
        reason = "It refuses only when the parameter is false from the start; "
        reason += unset or "a change while it runs has no effect."
        measured += f"; off from the start: {_shown(answers[p.from_start_step])}"
        where = (*where, _spot(context, steps[p.from_start_step]))
        return graded(p.half_credit, expected, measured, reason, hint=_SET_HINT if unset else "", where=where)
    if unset:
        return failed(expected, measured, f"It goes on enabling, since {unset}", hint=_SET_HINT, where=where)
    return failed(expected, measured, "It enables although the parameter is false.", where=where)


def _not_set(step: StepRun | None) -> str:
    """Say that the parameter could not be set while the node ran, and what the node answered, if so."""
    if step is None or step.outcome == "done":
        return ""
    why = "; ".join(str(problem).rstrip(".") for problem in step.result.get("refused", {}).values())
    return f"the parameter could not be set while it ran{': ' + why if why else ''}."


def _no_answer_while_off(
    context: Context, step: StepRun | None, expected: str, measured: str, started_off: float, where: tuple[Where, ...]
) -> Finding:
    """State that no answer came while the parameter was off: charged here, unless the node was silent before."""
    if _earlier_silence(context, step, expected) is not None:
        reason = "The node had stopped answering before, which is charged there, so no change could be looked at."
        hint = "Mend the earlier call first."
        return graded(started_off, expected, measured, reason, hint=hint, where=where)
    students = (run.artifact for run in context.session.record.processes if run.role == "student")
    problem = "No answer came while the parameter was false."
    return _silence(context, next(students, None) or "", expected, problem, where)


_ONLY_SAID = "Its message refuses, but the other fields say that it was done, and those are what a program goes by."
_ONLY_SAID_HINT = "Set what tells of success to False beside the message."
_REVERSED_HINT = "Turn the condition round."
_REVERSED = (
    "It follows the parameter, but the wrong way round: it enables while it is false and refuses while it is true."
)
_SET_HINT = (
    "Declare the parameter with a default of the type that the lab gives it, not read-only; others can then set it."
)


class WantedParameter(Parameters):
    """A parameter with its type and default."""

    name: str
    type: ref.ParameterType
    value: Any


class ParametersDeclared(Parameters):
    """A node declares parameters with defaults; each is a part, half for being declared."""

    step: ref.GetLabel
    parameters: tuple[WantedParameter, ...]
    other_value_credit: Share = Field(0.5, description="Credit of one that is declared with another type or default.")


def parameters_declared(context: Context, p: ParametersDeclared) -> Finding:
    """Judge the parameters as the running node gives them."""
    expected = ", ".join(f"{w.name} = {w.value!r}" for w in p.parameters)
    step = context.session.step(p.step)
    if step is not None and step.outcome != "done" and any(_silent(s) for s in context.session.record.steps):
        ended = "the node had ended before it could be asked" if step.outcome == "cancelled" else "it answers no call"
        return not_reached(f"Not tested: {ended}. {_THEN_THESE}", expected=expected)
    if step is None or step.outcome != "done":
        problem = str(step.result.get("problem", "")) if step is not None else ""
        return failed(
            expected,
            "no answer",
            f"The node's parameters could not be read{': ' + problem if problem else ''}.",
            where=(context.where(),),
        )
    values: Mapping[str, Mapping[str, Any]] = step.result["values"]
    parts, reasons = [], []
    for wanted in p.parameters:
        got = values.get(wanted.name)
        if got is None:
            parts.append(0.0)
            reasons.append(f"{wanted.name} is not declared.")
        elif got["type"] != wanted.type or got["value"] != wanted.value:
            parts.append(p.other_value_credit)
            reasons.append(f"{wanted.name} is {got['value']!r} ({got['type']}), not {wanted.value!r} ({wanted.type}).")
        else:
            parts.append(1.0)
    measured = ", ".join(f"{n} = {v['value']!r}" for n, v in values.items()) or "none of them"
    return graded(sum(parts) / len(parts), expected, measured, " ".join(reasons), where=(context.where(),))


class CallsInTime(Parameters):
    """Calls back to back are each answered in time."""

    step: ref.CallLabel
    within_s: float = Field(gt=0)
    enough: int = Field(10, description="Where all were in time, so many will do if there was no time for more.")


def calls_in_time(context: Context, p: CallsInTime) -> Finding:
    """Judge the share of calls answered in time."""
    step = context.session.step(p.step)
    wanted = int(step.parameters.get("repeat", 1)) if step is not None else 1
    expected = f"{wanted} calls, each answered within {p.within_s:g} s"
    calls = step.result.get("calls", []) if step is not None else []
    where = (_spot(context, step),)
    silent = step is None or _silent(step)
    if silent and (silence := _earlier_silence(context, step, expected)) is not None:
        return silence
    if not calls:
        return failed(expected, "no calls", _answer(step)[2], where=where)
    latencies = [(c["ended_ns"] - c["started_ns"]) / 1e9 for c in calls if c["response"] is not None]
    quick = sum(latency <= p.within_s for latency in latencies)
    slowest = f", slowest {apart(max(latencies) * 1e3, p.within_s * 1e3, places=1)} ms" if latencies else ""
    measured = f"{quick} of {len(calls)} calls made in time{slowest}"
    if quick == len(calls) < wanted and quick >= p.enough:
        note = f"There was time for {quick} of {wanted} calls, as each took {min(latencies):.2f} s or more."
        return passed(expected, measured, where=where, notes=(note,))
    if quick == len(calls) < wanted:
        return unclear(
            expected,
            measured,
            "There was no time for all the calls, but those made were answered in time.",
            where=where,
        )
    delay_s = max((_delay_s(context, c) for c in calls), default=0.0)
    if quick < len(calls) == sum(latency - delay_s <= p.within_s for latency in latencies):
        late = f"The machine kept a process from a core for up to {delay_s:.2f} s during a call, which may be why."
        return inconclusive(expected, measured, late, where=where)
    share = quick / len(calls)
    reason = f"{len(calls) - quick} of {len(calls)} calls took longer than {p.within_s:g} s, or got no answer."
    reason += f" The quickest took {apart(min(latencies), p.within_s, places=2)} s." if latencies and not quick else ""
    return graded(share, expected, measured, reason, where=where)


def _delay_s(context: Context, call: Mapping[str, Any]) -> float:
    """Return for how long the machine kept a process from its core during a call, that which makes it included."""
    span = Span(int(call["started_ns"]), int(call["ended_ns"]))
    own_s = context.session.recorder_delay_s(span) + int(call.get("held_up_ns", 0)) / 1e9
    return context.session.longest_delay_s(span) + own_s
