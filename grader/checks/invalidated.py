"""Which checks are invalidated by tampering with the grader's own, or by a recording that was filled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Any

from grader.evidence.gaps import describe_gap
from grader.evidence.integrity import Tampering
from grader.evidence.recorded import Recorded
from grader.lab.rubric import CheckSpec, Rubric
from grader.recording.session import RecordingGap
from grader.result import Finding, Outcome, Violation


def with_checks(tampering: Tampering, recorded: Recorded, rubric: Rubric) -> Violation:
    """Return a violation with the checks of its session that rest on what was invalidated.

    A check rests on a topic, a service or a node if its parameters name it, or the label of a step that does.
    """
    violation = tampering.violation
    if not violation.certain:
        return violation
    specs = [spec for spec in rubric.checks() if spec.session == violation.session]
    invalidated = tuple(
        s.id
        for s in specs
        if tampering.whole or not tampering.invalidated.isdisjoint(named(s, recorded))
    )
    return replace(violation, checks=invalidated)


def not_measurable(expected: str, violation: Violation) -> Finding:
    """Return what is found instead, where what a check measures was tampered with."""
    reason = f"{violation.text} So this cannot be measured."
    return Finding(
        Outcome.FAILED, Decimal(0), expected, "not measured", reason, where=(violation.where,)
    )


def without_rest(finding: Finding, gap: RecordingGap, *, timed: bool) -> Finding:
    """Return what is found where a check cannot see all messages of a topic, through the student's own doing.

    Where it measures over time, what is missing looks like silence, and the student was not silent.
    """
    seen = finding.outcome in (Outcome.FAILED, Outcome.PARTIAL) and gap.messages > 0 and not timed
    return replace(
        finding,
        outcome=Outcome.FAILED,
        credit=Decimal(0),
        measured=finding.measured if seen else "not measured in full",
        reason=" ".join([*([finding.reason] if seen else []), describe_gap(gap)]),
        hint=finding.hint
        if seen
        else "Send messages no larger and no more often than the lab asks for.",
    )


def is_timed(spec: CheckSpec, recorded: Recorded) -> bool:
    """Whether a check measures within the time of an `observe` step."""
    words = set(_words(spec.parameters.model_dump()))
    return any(step.kind == "observe" and step.label in words for step in recorded.record.steps)


def named(spec: CheckSpec, recorded: Recorded) -> set[str]:
    """Return the names that a check's parameters hold, and those of the steps to which they refer."""
    words = set(_words(spec.parameters.model_dump()))
    labelled = [step for step in recorded.record.steps if step.label in words]
    words.update(word for step in labelled for word in _words(step.parameters))
    return {recorded.used(word) for word in words}


def _words(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    inner = (
        value.values()
        if isinstance(value, Mapping)
        else value
        if isinstance(value, (list, tuple))
        else ()
    )
    for part in inner:
        yield from _words(part)
