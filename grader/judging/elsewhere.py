"""Recordings of other sessions as evidence for checks without evidence in their own session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from grader.checks.base import Context
from grader.checks.registry import check_given
from grader.evidence.recorded import Recorded
from grader.judging.rules import faults, is_by_endpoints
from grader.lab.rubric import CheckSpec
from grader.result import Finding


def evidence_elsewhere(
    spec: CheckSpec, specs: Mapping[str, CheckSpec], context: Context
) -> tuple[str | None, Recorded | None]:
    """Return a failed check and the recording of another session that passes it; None twice if the own one counts.

    For example, a publisher that is silent alone may publish beside a node of the launch file that gives the time.

    Parameters
    ----------
    spec
        The check to judge.
    specs
        All checks, by id.
    context
        Findings of earlier checks, and the recordings that are sound and free of tampering.
    """
    for gate in _required(spec, specs):
        finding = context.findings.get(gate.id)
        if gate.session != spec.session or finding is None:
            continue
        if not _shows_nothing(spec, finding):
            continue
        for session in gate.also_in:
            other = context.sessions.get(session)
            if other is None or not _can_judge(spec, other):
                continue
            if _passes(gate, context, other):
                return gate.id, other
    return None, None


def _required(spec: CheckSpec, specs: Mapping[str, CheckSpec]) -> Iterator[CheckSpec]:
    """Yield the checks that a check requires, directly or not."""
    for id_ in spec.requires:
        yield specs[id_]
        yield from _required(specs[id_], specs)


def _shows_nothing(spec: CheckSpec, gate: Finding) -> bool:
    """Tell whether the own session of a check shows nothing, by the finding of a required check."""
    if not gate.outcome.decided:
        return False
    if gate.is_silent:
        return not is_by_endpoints(spec)
    return not gate.outcome.goes_on


def _can_judge(spec: CheckSpec, other: Recorded) -> bool:
    """Tell whether a recording is sound and has all steps to which a check refers."""
    if faults(other):
        return False
    missing = set(spec.given.references().steps)
    for step in other.record.steps:
        missing.discard(step.label)
    return not missing


def _passes(gate: CheckSpec, context: Context, other: Recorded) -> bool:
    """Tell whether a recording passes a check."""
    check = check_given(gate.check, gate.parameters)
    finding = check.judge(replace(context, recorded=other), gate.parameters)
    if finding.is_silent:
        return False
    return finding.outcome.goes_on


def with_origin(finding: Finding, own: str | None, other: Recorded) -> Finding:
    """Return a finding with a note on the session that it is about."""
    session = other.record.session
    note = f"Judged by the session '{session}', because the session '{own}' does not show it."
    return replace(finding, notes=(*finding.notes, note))
