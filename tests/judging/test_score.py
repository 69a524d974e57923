"""From findings to points: the sum, undecided points never lost, and rounding to tenths."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from itertools import chain
from operator import attrgetter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.checks.base import credit_of, ramp
from grader.judging.score import TENTH, score_check, score_criteria, total
from grader.lab.rubric import CheckSpec, CriterionSpec, LabSpec, Rubric
from grader.result import Finding, Outcome

POINTS = st.decimals(0, 20, places=1)
CREDITS = {
    Outcome.PASSED: st.just(Decimal(1)),
    Outcome.EXCUSED: st.just(Decimal(1)),
    Outcome.PARTIAL: st.decimals("0.001", "0.999", places=3),
    Outcome.FAILED: st.just(Decimal(0)),
    Outcome.NOT_REACHED: st.just(Decimal(0)),
    Outcome.INCONCLUSIVE: st.just(Decimal(0)),
    Outcome.ERROR: st.just(Decimal(0)),
}
FINDINGS = st.sampled_from(Outcome).flatmap(lambda o: CREDITS[o].map(lambda c: Finding(o, c)))


def spec(points: Decimal, name: str = "a") -> CheckSpec:
    """Give a check with these points."""
    return CheckSpec.model_validate({"id": name, "points": points, "check": "any"})


def rubric(points: list[list[Decimal]]) -> Rubric:
    """Give a rubric by the points of each criterion's checks."""
    criteria = tuple(
        CriterionSpec(
            id=str(n),
            title=str(n),
            points=sum(row, Decimal(0)),
            checks=tuple(spec(value, f"{n}.{m}") for m, value in enumerate(row)),
        )
        for n, row in enumerate(points)
    )
    lab = LabSpec(id="1", title="", points=sum((c.points for c in criteria), Decimal(0)))
    return Rubric(lab=lab, criteria=criteria, folder=Path(), text="")


@given(POINTS, FINDINGS)
def test_a_check_never_gives_more_than_it_has(points: Decimal, finding: Finding) -> None:
    """Points lie between nothing and all, in tenths, and full credit is all."""
    result = score_check(spec(points), finding)
    assert 0 <= result.earned <= result.possible == points
    assert result.earned == result.earned.quantize(TENTH)
    assert finding.credit != 1 or result.earned == points


@given(POINTS, FINDINGS)
def test_what_is_undecided_is_neither_earned_nor_lost(points: Decimal, finding: Finding) -> None:
    """An inconclusive or broken check holds all its points back, and a decided one none."""
    result = score_check(spec(points), finding)
    if finding.outcome in (Outcome.INCONCLUSIVE, Outcome.ERROR):
        assert (result.earned, result.undecided) == (Decimal(0), points)
    else:
        assert result.undecided == 0


def sum_of(figure: str, parts: Iterable[object]) -> Decimal:
    """Return the sum of a figure over checks or criteria."""
    return sum(map(attrgetter(figure), parts), Decimal(0))


@given(
    st.lists(st.lists(st.tuples(POINTS, FINDINGS), min_size=1, max_size=6), min_size=1, max_size=6)
)
def test_points_add_up(table: list[list[tuple[Decimal, Finding]]]) -> None:
    """Checks add up to criteria and criteria to the score, to the last tenth."""
    rows: list[list[Decimal]] = []
    findings: dict[str, Finding] = {}
    for n, row in enumerate(table):
        rows.append([points for points, _ in row])
        for m, (_, finding) in enumerate(row):
            findings[f"{n}.{m}"] = finding
    whole = rubric(rows)
    criteria = score_criteria(whole.criteria, findings, {})
    score = total(criteria)
    checks = list(chain.from_iterable(criterion.checks for criterion in criteria))
    assert len(checks) == len(findings)
    assert score.possible == whole.lab.points == sum_of("possible", checks)
    assert score.earned == sum_of("earned", criteria) == sum_of("earned", checks)
    assert score.undecided == sum_of("undecided", checks)
    assert score.earned + score.undecided <= score.possible


@given(st.decimals(0, 1, places=3), st.decimals(0, 1, places=3), POINTS)
def test_more_credit_never_gives_fewer_points(
    one: Decimal, other: Decimal, points: Decimal
) -> None:
    """Points rise with credit."""
    low, high = sorted((one, other))
    first, second = (
        score_check(spec(points), Finding(Outcome.PARTIAL, credit)) for credit in (low, high)
    )
    assert first.earned <= second.earned


@pytest.mark.parametrize(
    ("points", "credit", "earned"),
    [
        ("6", "0.972", "5.8"),
        ("1", "0.05", "0.1"),
        ("1", "0.049", "0.0"),
        ("5", "0.25", "1.3"),
        ("3", "0.15", "0.5"),
    ],
)
def test_halves_of_a_tenth_round_up(points: str, credit: str, earned: str) -> None:
    """Rounding is to tenths, in the student's favour at the half."""
    assert score_check(
        spec(Decimal(points)), Finding(Outcome.PARTIAL, Decimal(credit))
    ).earned == Decimal(earned)


def test_criteria_without_a_judged_check_are_left_out() -> None:
    """If only some sessions ran, only their checks count."""
    whole = rubric([[Decimal(2), Decimal(3)], [Decimal(5)]])
    criteria = score_criteria(whole.criteria, {"0.1": Finding(Outcome.PASSED, Decimal(1))}, {})
    assert [criterion.id for criterion in criteria] == ["0"]
    assert total(criteria).possible == Decimal(3)


@given(st.floats(-2, 3, allow_nan=False))
def test_credit_is_a_share(share: float) -> None:
    """Any share becomes a credit from 0 to 1 in thousandths."""
    credit = credit_of(share)
    assert 0 <= credit <= 1
    assert credit == round(credit, 3)


@given(st.floats(0, 1), st.floats(0.01, 0.5), st.floats(0.01, 0.5))
def test_a_ramp_falls_between_its_limits(value: float, full: float, width: float) -> None:
    """The ramp is 1 up to the first limit and 0 from the second."""
    share = ramp(value, full, full + width)
    assert 0 <= share <= 1
    assert value > full or share == 1
    assert value < full + width or share == 0


def test_a_ramp_without_width_is_a_step() -> None:
    """Equal limits leave no part credit."""
    assert (ramp(0.1, 0.1, 0.1), ramp(0.11, 0.1, 0.1)) == (1.0, 0.0)
