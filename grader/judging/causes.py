"""The dearest check of each mistake charges it; its other checks are excused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from decimal import Decimal

from grader.judging.rules import Case, decide


def are_contested(cases: Iterable[Case]) -> bool:
    """Tell whether two checks lose points by the same mistake."""
    named: list[str] = []
    for case in cases:
        named += case.found.causes
    return len(set(named)) < len(named)


def charges_of(cases: Iterable[Case]) -> dict[str, str]:
    """Return the dearest check of each mistake: cause -> id. Of equal losses the first counts.

    Parameters
    ----------
    cases
        The checks in the rubric's order, each with its finding.
    """
    charges: dict[str, str] = {}
    dearest: dict[str, Decimal] = {}
    for case in cases:
        for cause in case.found.causes:
            loss = _loss(case, cause)
            if cause in dearest and loss <= dearest[cause]:
                continue
            dearest[cause] = loss
            charges[cause] = case.spec.id
    return charges


def _loss(case: Case, cause: str) -> Decimal:
    """Return the points lost by one mistake in a check."""
    excused = with_charges(case, {cause: ""})
    without = decide(excused)
    lost = without.credit - case.found.credit
    return lost * case.spec.points


def with_charges(case: Case, charges: Mapping[str, str]) -> Case:
    """Return a case with the mistakes charged by other checks."""
    elsewhere = {}
    for cause, check in charges.items():
        if check != case.spec.id:
            elsewhere[cause] = check
    context = replace(case.context, charged_elsewhere=elsewhere)
    return replace(case, context=context)
