"""Which checks cannot be judged since something of the grader's own was touched, and what is found then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Any

from grader.evidence.census import Touched
from grader.evidence.recorded import Recorded
from grader.result import Finding, Outcome, Violation
from grader.rubric import CheckSpec, Rubric


def with_checks(touched: Touched, recorded: Recorded, rubric: Rubric) -> Violation:
    """Return a violation with the checks of its session that rest on what was spoilt.

    A check rests on a topic, a service or a node if its parameters name it, or the label of a step that does.
    """
    violation = touched.violation
    if not violation.certain:
        return violation
    specs = [spec for spec in rubric.checks() if spec.session == violation.session]
    spoilt = tuple(spec.id for spec in specs if not touched.spoilt.isdisjoint(_named(spec, recorded)))
    return replace(violation, checks=spoilt)


def not_measurable(finding: Finding, violation: Violation) -> Finding:
    """Return what is found instead, where what a check measures was touched."""
    return Finding(
        Outcome.FAILED,
        Decimal(0),
        finding.expected,
        "not measured",
        f"{violation.text} So this cannot be measured.",
        where=(violation.where,),
    )


def _named(spec: CheckSpec, recorded: Recorded) -> set[str]:
    words = set(_words(spec.parameters.model_dump()))
    labelled = [step for step in recorded.record.steps if step.label in words]
    words.update(word for step in labelled for word in _words(step.parameters))
    return {recorded.used(word) for word in words}


def _words(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _words(part)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _words(part)
