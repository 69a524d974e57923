"""Findings by bounds of the credit."""

from __future__ import annotations

from decimal import Decimal

import pytest

from grader.checks.base import graded
from grader.result import Outcome

BUSY = "The machine was busy."


@pytest.mark.parametrize(
    ("least", "best", "doubt", "credit"),
    [
        (0.25, 0.35, BUSY, "0.3"),
        (0.25, 0.35, "", None),
        (0.25, 0.55, BUSY, None),
        (0.95, 1.0, BUSY, None),
        (0.35, 0.35, BUSY, "0.3"),
    ],
    ids=["neighbours", "no delay", "far apart", "full credit", "no difference"],
)
def test_a_loss_that_the_machine_cannot_have_caused_is_decided(
    least: float, best: float, doubt: str, credit: str | None
) -> None:
    """The upper one of two neighbouring levels counts, unless it is full credit."""
    finding = graded(least, "", "", "It is wrong.", best=best, doubt=doubt, levels=10)
    assert finding.outcome.decided == (credit is not None)
    if credit is not None:
        assert (finding.outcome, finding.credit) == (Outcome.PARTIAL, Decimal(credit))
        assert finding.reason == "It is wrong."
