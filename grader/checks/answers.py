"""Check of what services answer, field by field; and what checks of answers have in common."""

from __future__ import annotations

from collections.abc import Mapping
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
    same_request,
    shown,
    silence,
)
from grader.checks.subscriber import Alternative
from grader.evidence.fields import equal_within, value_at
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern
from grader.recording.session import StepRun
from grader.result import Finding


class WantedAnswer(Parameters):
    """What a call is answered with, by the paths of fields."""

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
        if self.oracle is None and not all(
            answer.values or answer.patterns for answer in self.each
        ):
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
        request, parameters = (
            step.parameters.get("request", {}),
            {**self.parameters, **(other or {})},
        )
        computed = context.oracle(self.oracle)(request, parameters, context.session.record.seed)
        # An oracle may compute with numpy.
        plain = {
            path: value.tolist() if hasattr(value, "tolist") else value
            for path, value in computed.items()
        }
        return {**plain, **answer.values}

    def right(self, got: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
        """Return the paths of the fields that are as wanted."""
        tolerances = {path: self.tolerances.get(path, self.tolerance) for path in wanted}
        return [
            path
            for path, value in wanted.items()
            if equal_within(value_at(got, path), value, tolerances[path])
        ]


def call_value(context: Context, p: CallValue) -> Finding:
    """Judge the answers to several calls by their fields; where none is answered, that costs more only once."""
    steps = [context.session.step(answer.step) for answer in p.each]
    expected = "; ".join(f"{answer.step}: {_wanted_words(answer, p)}" for answer in p.each)
    answers = [answer_of(step) for step in steps]
    if all(answer is None for answer in answers):
        return silence(context, steps[0], expected, problem_of(steps[0]))
    parts = [
        _judge_answer(context, p, answer, step) for answer, step in zip(p.each, steps, strict=True)
    ]
    requests = [step.parameters.get("request") for step in steps if step is not None]
    alike = (
        len(answers) > 1
        and answers.count(answers[0]) == len(answers)
        and requests.count(requests[0]) == 1
    )
    if alike and any(part.share < 1 for part in parts):
        parts[0] = replace(
            parts[0], reason=f"All {len(parts)} calls get the same answer, whatever they ask for."
        )
        parts[1:] = [replace(part, reason="") for part in parts[1:]]
    return of_parts(expected, parts, where=tuple(call_location(context, step) for step in steps))


def _wanted_words(answer: WantedAnswer, p: CallValue) -> str:
    patterns = {path: f"like {pattern}" for path, pattern in answer.patterns.items()}
    return shown({**answer.values, **patterns}) or f"as {p.oracle} computes it"


def _judge_answer(
    context: Context, p: CallValue, answer: WantedAnswer, step: StepRun | None
) -> Part:
    """Judge one answer by the share of its fields that are right, or by the known mistake that it shows."""
    got = answer_of(step)
    if step is None or got is None:
        earlier = earlier_silence(context, step, "") is not None
        return Part(
            0.0,
            f"{answer.step}: no answer",
            "" if earlier else f"{answer.step}: {problem_of(step)}",
        )
    if (same := same_request(context, step)) is not None:
        return Part(
            0.0,
            reason=f"The request of '{answer.step}' cannot be sent: it is that of '{same.label}'.",
        )
    wanted = p.wanted(context, answer, step)
    right = p.right(got, wanted)
    paths = [*wanted, *answer.patterns]
    values = {path: value_at(got, path) for path in paths}
    there = {path: str(values[path]) for path in answer.patterns if values[path] is not None}
    right += [path for path, text in there.items() if search(answer.patterns[path], text)]
    text = f"{answer.step}: {shown(values)[:_MOST_SHOWN]}"
    share = len(right) / max(1, len(paths))
    if share == 1:
        return Part(1.0, text)
    asked = {
        **{path: f", not {value!r}" for path, value in wanted.items()},
        **dict.fromkeys(answer.patterns, ""),
    }
    wrong = [
        f"{path} is {values[path]!r}"[:_MOST_SHOWN] + words
        for path, words in asked.items()
        if path not in right
    ]
    more = f" and {len(wrong) - _MOST_WRONG} more are wrong" if len(wrong) > _MOST_WRONG else ""
    reason = f"In the answer to '{answer.step}', {' and '.join(wrong[:_MOST_WRONG])}{more}."
    for known in p.alternatives:
        other = p.wanted(context, answer, step, known.parameters)
        if len(p.right(got, other)) == len(other):
            return Part(
                max(share, known.left(context)), text, f"{reason} It matches {known.meaning}."
            )
    return Part(share, text, reason)


#: Characters of an answer that are shown, and fields of it that are named.
_MOST_SHOWN, _MOST_WRONG = 200, 3


#: Steps in which the node itself has to answer.
_ASKING = ("call", "get_parameters", "set_parameters", "change_state")


def unanswered(context: Context, step: StepRun | None, expected: str) -> Finding | None:
    """State that a node did not answer a step that asked it; None if it did.

    That costs points once: in the step's check, unless an earlier step had no answer either.
    """
    if step is not None and step.outcome in ("done", "failed"):
        return None
    steps = context.session.record.steps
    before = steps[: steps.index(step)] if step is not None else steps
    silent = next(
        (s for s in before if s.kind in _ASKING and s.outcome in ("timeout", "cancelled")), None
    )
    if silent is not None:
        which = f'"{silent.label}"' if silent.label else f"an earlier step ({silent.kind})"
        return not_reached(
            f"Not tested, because {which} got no answer. {THEN_THESE}", expected=expected
        )
    problem = str(step.result.get("problem", "")) if step is not None else ""
    reason = f"The node did not answer{': ' + problem if problem else ''}."
    return unexplained(failed(expected, "no answer", reason))
