"""Checks that are invalidated by tampering with the grader, or by a recording gap."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal

from grader.evidence.gaps import describe_gap
from grader.evidence.integrity import Tampering
from grader.evidence.recorded import Recorded
from grader.lab.references import references_in
from grader.lab.rubric import CheckSpec, Rubric
from grader.lab.steps import STEPS
from grader.recording.session import RecordingGap
from grader.result import Finding, Outcome, Violation


@dataclass(frozen=True)
class Referents:
    """Names in the graph and steps in the recording to which a check refers."""

    #: Names as the student used them.
    names: frozenset[str]
    #: True if one of the steps is an `observe` step: then the check measures within its time.
    is_timed: bool


def referents(spec: CheckSpec, recorded: Recorded) -> Referents:
    """Return the names in a check's parameters and in the steps that the parameters refer to."""
    own = spec.given.references()
    names = set(own.names)
    kinds = set()
    for step in recorded.record.steps:
        if step.label in own.steps and step.kind in STEPS:
            kinds.add(step.kind)
            names |= references_in(STEPS[step.kind], step.parameters).names
    return Referents(frozenset(map(recorded.used, names)), "observe" in kinds)


def with_checks(tampering: Tampering, recorded: Recorded, rubric: Rubric) -> Violation:
    """Return a violation with the checks of its session that refer to something invalidated."""
    violation = tampering.violation
    if not violation.certain:
        return violation
    checks = []
    for spec in rubric.checks():
        if spec.session != violation.session:
            continue
        if tampering.whole or tampering.invalidated & referents(spec, recorded).names:
            checks.append(spec.id)
    return replace(violation, checks=tuple(checks))


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
    described = describe_gap(gap)
    if described in finding.reason:
        return lost
    if finding.outcome.took_points and gap.messages > 0 and not timed:
        measured = f"in the first {gap.messages} messages: {finding.measured}"
        return replace(lost, measured=measured, reason=f"{finding.reason} {described}")
    return replace(
        lost,
        measured="not measured in full",
        reason=described,
        hint="Send messages no larger and no more often than the lab asks for.",
    )
