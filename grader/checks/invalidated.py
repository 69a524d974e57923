"""Checks that are invalidated by tampering with the grader, or by a recording gap."""

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
    """Return a violation with the checks of its session that depend on something invalidated.

    A check depends on a topic, a service or a node if its parameters name it, or the label of a
    step that names it.
    """
    violation = tampering.violation
    if not violation.certain:
        return violation
    invalidated = []
    for spec in rubric.checks():
        if spec.session != violation.session:
            continue
        if tampering.whole or not tampering.invalidated.isdisjoint(named(spec, recorded)):
            invalidated.append(spec.id)
    return replace(violation, checks=tuple(invalidated))


def not_measurable(expected: str, violation: Violation) -> Finding:
    """Return the finding of a check after tampering with its measurement."""
    reason = f"{violation.text} So this cannot be measured."
    return Finding(
        Outcome.FAILED, Decimal(0), expected, "not measured", reason, where=(violation.where,)
    )


def without_rest(finding: Finding, gap: RecordingGap, *, timed: bool) -> Finding:
    """Return the finding of a check of a topic from which the student's messages were dropped.

    For timed checks, dropped messages look like silence although the student kept publishing.
    """
    lost = replace(finding, outcome=Outcome.FAILED, credit=Decimal(0))
    has_lost_points = finding.outcome in (Outcome.FAILED, Outcome.PARTIAL)
    if has_lost_points and gap.messages > 0 and not timed:
        return replace(lost, reason=f"{finding.reason} {describe_gap(gap)}")
    return replace(
        lost,
        measured="not measured in full",
        reason=describe_gap(gap),
        hint="Send messages no larger and no more often than the lab asks for.",
    )


def is_timed(spec: CheckSpec, recorded: Recorded) -> bool:
    """Tell whether a check measures within the time of an `observe` step."""
    words = set(_words(spec.parameters.model_dump()))
    return any(step.kind == "observe" and step.label in words for step in recorded.record.steps)


def named(spec: CheckSpec, recorded: Recorded) -> set[str]:
    """Return the names in a check's parameters, and in the steps to which they refer."""
    own = set(_words(spec.parameters.model_dump()))
    words = set(own)
    for step in recorded.record.steps:
        if step.label in own:
            words.update(_words(step.parameters))
    return {recorded.used(word) for word in words}


def _words(value: Any) -> Iterator[str]:
    """Yield all texts in nested parameters."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _words(part)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _words(part)
