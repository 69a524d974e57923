"""Check of the answers of services, field by field, and helpers of other checks of answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from grader.checks.base import Context, Part, failed, not_reached, of_parts, unexplained
from grader.checks.service import (
    THEN_THESE,
    answer_of,
    call_location,
    earlier_silence,
    problem_of,
    problem_said,
    same_request,
    shown,
    silence,
)
from grader.checks.subscriber import Alternative
from grader.evidence.fields import equal_within, value_at
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern
from grader.lab.steps.call import CallStep
from grader.recording.session import StepRun
from grader.result import Finding


class WantedAnswer(Parameters):
    """The right answer to a call, by the paths of fields."""

    step: ref.CallLabel
    values: Annotated[Mapping[str, Any], ref.fields_of_type("_Response", "step")] = Field(
        default_factory=dict
    )
    patterns: Annotated[Mapping[str, Pattern], ref.fields_of_type("_Response", "step")] = Field(
        default_factory=dict
    )


class CallValue(Parameters):
    """Calls are answered with the right numbers and texts, in nested fields too; each call is a part."""

    example: ClassVar = {"each": [{"step": "call", "values": {"success": True}}]}
    artifact: ref.Artifact
    each: tuple[WantedAnswer, ...] = Field(min_length=1)
    oracle: ref.Loadable | None = Field(
        None,
        description="file.py:function(request, parameters, seed); gives values by the paths of fields.",
    )
    parameters: Mapping[str, Any] = Field(
        default_factory=dict, description="Passed on to the oracle."
    )
    alternatives: tuple[Alternative, ...] = Field(
        (), description="Known mistakes, by other parameters of the oracle."
    )
    tolerance: float = Field(1e-6, ge=0, description="Of numbers.")
    tolerances: Mapping[str, float] = Field(
        default_factory=dict, description="Path of a field -> its own tolerance."
    )

    @model_validator(mode="after")
    def _asks_for_something(self) -> CallValue:
        if self.oracle is None:
            for answer in self.each:
                if not answer.values and not answer.patterns:
                    raise ValueError("each needs values or patterns, where no oracle computes them")
        return self

    def wanted(
        self,
        context: Context,
        answer: WantedAnswer,
        step: StepRun,
        other: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Return the values that an answer must have, with other parameters of the oracle."""
        if self.oracle is None:
            return dict(answer.values)
        request = CallStep.given(step).request
        parameters = {**self.parameters, **(other or {})}
        computed = context.oracle(self.oracle)(request, parameters, context.session.record.seed)
        plain = {path: _without_numpy(value) for path, value in computed.items()}
        return {**plain, **answer.values}

    def right(self, got: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
        """Return the paths of the right fields."""
        right = []
        for path, value in wanted.items():
            tolerance = self.tolerances.get(path, self.tolerance)
            if equal_within(value_at(got, path), value, tolerance):
                right.append(path)
        return right


def _without_numpy(value: Any) -> Any:
    """Return a value of an oracle as plain Python."""
    return value.tolist() if hasattr(value, "tolist") else value


def call_value(context: Context, p: CallValue) -> Finding:
    """Judge the answers to several calls by their fields; if none is answered, it costs points only once."""
    steps = [context.session.step(answer.step) for answer in p.each]
    asked = [f"{answer.step}: {_wanted_words(answer, p)}" for answer in p.each]
    expected = "; ".join(asked)
    answers = [answer_of(step) for step in steps]
    if all(answer is None for answer in answers):
        return silence(context, steps[0], expected, problem_of(steps[0]))
    parts = []
    for answer, step in zip(p.each, steps, strict=True):
        parts.append(_judge_answer(context, p, answer, step))
    if _all_alike(steps) and any(part.share < 1 for part in parts):
        reason = f"All {len(parts)} calls get the same answer, whatever they ask for."
        parts[0] = replace(parts[0], reason=reason)
        parts[1:] = [replace(part, reason="") for part in parts[1:]]
    where = [call_location(context, step) for step in steps]
    return of_parts(expected, parts, where=where)


def _all_alike(steps: Sequence[StepRun | None]) -> bool:
    """Tell whether several calls got the same answer, though the first request differs from the others."""
    answers = [answer_of(step) for step in steps]
    count = len(answers)
    if count < 2 or answers.count(answers[0]) < count:
        return False
    requests = [CallStep.given(step).request for step in steps if step is not None]
    return requests.count(requests[0]) == 1


def _wanted_words(answer: WantedAnswer, p: CallValue) -> str:
    patterns = {path: f"like {pattern}" for path, pattern in answer.patterns.items()}
    return shown({**answer.values, **patterns}) or f"as {p.oracle} computes it"


def _judge_answer(
    context: Context, p: CallValue, answer: WantedAnswer, step: StepRun | None
) -> Part:
    """Judge one answer by the share of its right fields, or by a known mistake."""
    got = answer_of(step)
    if step is None or got is None:
        return _no_answer(context, answer, step)
    same = same_request(context, step)
    if same is not None:
        reason = f"The request of '{answer.step}' cannot be sent: it is that of '{same.label}'."
        return Part(0.0, reason=reason)
    wanted = p.wanted(context, answer, step)
    values = {path: value_at(got, path) for path in (*wanted, *answer.patterns)}
    right = [*p.right(got, wanted), *_matching(answer, values)]
    text = f"{answer.step}: {shown(values)[:_MOST_SHOWN]}"
    judged = len(wanted) + len(answer.patterns)
    share = len(right) / max(1, judged)
    if share == 1:
        return Part(1.0, text)
    reason = _wrong_fields(answer, wanted, values, right)
    for known in p.alternatives:
        other = p.wanted(context, answer, step, known.parameters)
        if len(p.right(got, other)) == len(other):
            part = Part(max(share, known.credit), text, f"{reason} It matches {known.meaning}.")
            return known.charge(context, part)
    return Part(share, text, reason)


def _no_answer(context: Context, answer: WantedAnswer, step: StepRun | None) -> Part:
    """State that a call got no answer; the reason is only given for the first such call."""
    reason = ""
    if earlier_silence(context, step, "") is None:
        reason = f"{answer.step}: {problem_of(step)}"
    return Part(0.0, f"{answer.step}: no answer", reason)


def _matching(answer: WantedAnswer, values: Mapping[str, Any]) -> list[str]:
    """Return the paths of the fields that match their patterns."""
    matching = []
    for path, pattern in answer.patterns.items():
        value = values[path]
        if value is not None and search(pattern, str(value)):
            matching.append(path)
    return matching


def _wrong_fields(
    answer: WantedAnswer,
    wanted: Mapping[str, Any],
    values: Mapping[str, Any],
    right: Sequence[str],
) -> str:
    """Say which fields of an answer are wrong."""
    wrong = []
    for path, value in values.items():
        if path not in right:
            clause = f"{path} is {value!r}"[:_MOST_SHOWN]
            if path not in answer.patterns:
                clause += f", not {wanted[path]!r}"
            wrong.append(clause)
    more = ""
    if len(wrong) > _MOST_WRONG:
        more = f" and {len(wrong) - _MOST_WRONG} more are wrong"
    return f"In the answer to '{answer.step}', {' and '.join(wrong[:_MOST_WRONG])}{more}."


#: Greatest number of characters of an answer that are shown, and of its fields that are named.
_MOST_SHOWN, _MOST_WRONG = 200, 3


#: Steps that the node itself must answer.
_ASKING = ("call", "get_parameters", "set_parameters", "change_state")


def unanswered(context: Context, step: StepRun | None, expected: str) -> Finding | None:
    """State that a node did not answer a step; None if it did.

    This costs points once: in the step's check, unless an earlier step had no answer either.
    """
    if step is not None and step.outcome in ("done", "failed"):
        return None
    steps = context.session.record.steps
    before = steps
    if step is not None:
        before = steps[: steps.index(step)]
    for earlier in before:
        if earlier.kind in _ASKING and earlier.outcome in ("timeout", "cancelled"):
            which = f"an earlier step ({earlier.kind})"
            if earlier.label:
                which = f'"{earlier.label}"'
            reason = f"Not tested, because {which} got no answer. {THEN_THESE}"
            return not_reached(reason, expected=expected)
    reason = f"The node did not answer{problem_said(step)}."
    return unexplained(failed(expected, "no answer", reason))
