"""A class in numbers, checked against numbers worked out by hand."""

from __future__ import annotations

import math
from decimal import Decimal

import pytest

from grader.cohort.entries import ClassEntry
from grader.cohort.statistics import Need, Silent, discrimination, summarise
from grader.result import Outcome
from tests.cohort.made_up import entries_of, entry_of, result_of, rubric_of

ONE = rubric_of(("a.only", 100))
TWO = rubric_of(("a.first", 4), ("b.second", 6))


def decimals(*numbers: int) -> list[Decimal]:
    """Give numbers as points."""
    return [Decimal(n) for n in numbers]


# -- how points spread -------------------------------------------------------------------------


def test_mean_median_and_quartiles_are_those_worked_out_by_hand() -> None:
    """For 10, 20, 40, 80 and 90 the mean is 48, the median 40, and the quartiles are 20 and 80."""
    spread = summarise(entries_of(ONE, [0.9], [0.1], [0.4], [0.2], [0.8]), ONE).spread
    assert spread is not None
    assert spread.count == 5
    assert [spread.mean, spread.median] == decimals(48, 40)
    assert [spread.first_quartile, spread.third_quartile] == decimals(20, 80)
    assert [spread.lowest, spread.highest, spread.possible] == decimals(10, 90, 100)


def test_quartiles_between_two_values_lie_in_proportion() -> None:
    """For 1, 2, 3, 4 a quarter of the way from first to last lies at 1.75; a single value is its own quartile."""
    spread = summarise(entries_of(ONE, [0.01], [0.02], [0.03], [0.04]), ONE).spread
    assert spread is not None
    quartiles = [spread.first_quartile, spread.median, spread.third_quartile]
    assert quartiles == [Decimal("1.75"), Decimal("2.5"), Decimal("3.25")]
    alone = summarise(entries_of(ONE, [0.5]), ONE).spread
    assert alone is not None
    assert [alone.first_quartile, alone.third_quartile] == decimals(50, 50)


def test_bars_hold_their_lower_bound_and_the_last_one_the_top() -> None:
    """5 points lie in the second of twenty bars, 4.9 in the first, 100 and more with a bonus in the last."""
    bonus = {"kind": "bonus", "what": "score", "points": 3}
    best = entry_of("d", result_of(ONE, [1.0]) | {"adjustments": [bonus]})
    spread = summarise([*entries_of(ONE, [0.05], [0.049], [1.0]), best], ONE).spread
    assert spread is not None
    counts = [bar.count for bar in spread.bars]
    assert (counts[0], counts[1], counts[-1], sum(counts)) == (1, 1, 2, 4)
    assert [spread.bars[1].low, spread.bars[1].high, spread.bars[-1].high] == decimals(5, 10, 100)


def test_adjustments_count_in_points_but_not_in_criteria() -> None:
    """A late submission has the rest of its points, and its criterion as judged."""
    plain = result_of(ONE, [0.8])
    plain["adjustments"] = [
        {"kind": "late", "what": "score", "points": -10, "reason": "late", "who": "", "when": ""}
    ]
    row = summarise([entry_of("a", plain)], ONE).rows[0]
    assert row.result is not None
    assert row.result.final == 70
    assert row.cells[0] is not None
    assert row.cells[0].earned == 80
    assert row.result.adjustments[0].points == -10


def test_a_class_without_results_has_no_spread() -> None:
    """Nothing graded, or nobody at all: no numbers, and no failure."""
    assert summarise([], ONE).spread is None
    summary = summarise([ClassEntry("a", None, "broken archive")], ONE)
    assert summary.spread is None
    assert summary.rows[0].entry.problem == "broken archive"
    assert summary.checks[0].mean_credit is None


# -- rows --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("credit", "outcome"),
    [
        (1.0, Outcome.PASSED),
        (0.5, Outcome.PARTIAL),
        (0.0, Outcome.FAILED),
        (None, Outcome.INCONCLUSIVE),
    ],
)
def test_a_cell_has_the_outcome_of_its_points(credit: float | None, outcome: Outcome) -> None:
    """All, some or none of the points, or none decided."""
    cell = summarise(entries_of(ONE, [credit]), ONE).rows[0].cells[0]
    assert cell is not None
    assert cell.outcome is outcome


def test_a_criterion_that_was_not_judged_has_no_cell() -> None:
    """Where only one session was asked for, the others' criteria stay empty, and nothing is made of them."""
    plain = result_of(TWO, [1.0, 1.0])
    plain["criteria"] = plain["criteria"][:1]
    summary = summarise([entry_of("a", plain)], TWO)
    assert [cell is None for cell in summary.rows[0].cells] == [False, True]
    assert summary.columns[1].mean is None
    assert [check.decided for check in summary.checks] == [1, 0]


def test_means_of_criteria_add_up_to_the_mean_of_the_points() -> None:
    """Undecided points count nowhere; decisions about a check count in its criterion, a bonus beside all."""
    points = {
        "kind": "points",
        "what": "a.first",
        "points": 1,
        "reason": "",
        "who": "J. Smith",
        "when": "2026-11-21",
    }
    bonus = points | {"kind": "bonus", "what": "score", "points": 2}
    adjusted = entry_of("d", result_of(TWO, [0.5, 1]) | {"adjustments": [points, bonus]})
    summary = summarise([*entries_of(TWO, [1, 1], [0.5, 1], [None, 1]), adjusted], TWO)
    assert adjusted.result is not None
    assert summary.columns[0].mean == Decimal("2.25")
    beside = adjusted.result.beside_criteria / 4
    assert beside == Decimal("0.5")
    assert summary.spread is not None
    assert (
        sum((c.mean for c in summary.columns if c.mean is not None), beside) == summary.spread.mean
    )


# -- statistics of each check ------------------------------------------------------------------


def test_pass_share_and_credit_leave_out_the_undecided() -> None:
    """Passed once, half once, undecided once: one of two, and three quarters of the credit."""
    first = summarise(entries_of(TWO, [1, 1], [0.5, 1], [None, 1]), TWO).checks[0]
    assert (first.passed, first.decided, first.mean_credit) == (1, 2, 0.75)


def test_discrimination_is_the_correlation_worked_out_by_hand() -> None:
    """Ten students, credit 1 for the five with 0.6 to 1.0 of the rest: r = 1.25 / sqrt(2.5 * 0.825)."""
    pairs = [(float(n >= 5), 0.1 * (n + 1)) for n in range(10)]
    told = discrimination(pairs)
    assert not isinstance(told, Silent)
    assert told == pytest.approx(1.25 / math.sqrt(2.5 * 0.825), abs=1e-12)


def test_the_check_itself_is_left_out_of_the_total() -> None:
    """A check that is the exact opposite of the others has -1, although it is most of the points."""
    heavy = rubric_of(("a.heavy", 90), ("b.light", 10))
    entries = [entry_of(str(n), result_of(heavy, [n % 2, 1 - n % 2])) for n in range(10)]
    told = summarise(entries, heavy).checks[0].discrimination
    assert not isinstance(told, Silent)
    assert told == pytest.approx(-1)


def test_undecided_checks_are_left_out_of_the_rest_too() -> None:
    """The rest is a share of the decided points: an undecided check neither lifts nor lowers it."""
    three = rubric_of(("a.x", 2), ("a.y", 2), ("a.z", 6))
    decided = [entry_of(str(n), result_of(three, [n / 9, n / 9, n / 9])) for n in range(10)]
    opened = []
    for n in range(10):
        opened.append(entry_of(str(n), result_of(three, [n / 9, n / 9, None if n == 9 else n / 9])))
    for entries in (decided, opened):
        told = summarise(entries, three).checks[0].discrimination
        assert not isinstance(told, Silent)
        assert told == pytest.approx(1)


def test_where_nothing_can_be_said_it_is_said_why() -> None:
    """Nine submissions are too few; ten that all pass are all alike; one check alone has no rest."""
    entries = entries_of(TWO, *([n / 9, 1 - n / 9] for n in range(9)))
    few = summarise(entries, TWO)
    assert {check.discrimination for check in few.checks} == {Silent.TOO_FEW}
    assert few.noise is None
    alike = summarise(entries_of(TWO, *([1, n / 9] for n in range(10))), TWO)
    assert [check.discrimination for check in alike.checks] == [Silent.ALL_ALIKE, Silent.ALL_ALIKE]
    assert alike.noise == pytest.approx(2 / math.sqrt(10))
    alone = summarise(entries_of(ONE, *([n / 9] for n in range(10))), ONE)
    assert alone.checks[0].discrimination is Silent.TOO_FEW


# -- tasks for a person ------------------------------------------------------------------------


def test_what_needs_a_person_stands_in_the_order_of_its_weight() -> None:
    """The order is: not graded, violations, undecided, judged by another rubric; each with its known facts."""
    plain = [result_of(TWO, credits) for credits in ([1, 1], [1, None], [1, 1])]
    plain[0]["provenance"] = {"rubric_sha256": "another"}
    plain[2]["violations"] = [
        {
            "kind": "spoofs_clock",
            "session": "s",
            "text": "It published on /clock.",
            "certain": True,
        },
        {"kind": "spoofs_clock", "session": "s", "text": "It did so twice.", "certain": False},
    ]
    known = [entry_of(name, each) for name, each in zip("abc", plain, strict=True)]
    todos = summarise([*known, ClassEntry("d", None, "An empty archive.")], TWO).todos
    assert [(todo.row, todo.need) for todo in todos] == [
        (3, Need.NOT_GRADED),
        (2, Need.VIOLATION),
        (1, Need.UNDECIDED),
        (0, Need.OTHER_RUBRIC),
    ]
    assert todos[0].texts == ("An empty archive.",)
    assert (todos[1].titles, todos[1].texts) == (
        ("spoofs clock",),
        (
            "It published on /clock.",
            "It did so twice. This may have another cause than the submission.",
        ),
    )
    assert todos[2].points == 6
    assert (todos[2].titles, todos[2].check_id) == (("B.SECOND",), "b.second")


@pytest.mark.parametrize("what", ["b.second", "b"])
def test_what_a_person_has_decided_is_not_to_do_again(what: str) -> None:
    """Points given by hand for an undecided check, or for its criterion, settle it."""
    plain = result_of(TWO, [1, None])
    decided = {
        "kind": "points",
        "what": what,
        "points": 6,
        "reason": "seen",
        "who": "JS",
        "when": "2026-11-21",
    }
    entry = entry_of("a", plain | {"adjustments": [decided]})
    assert summarise([entry], TWO).todos == ()
    assert entry.result is not None
    assert entry.result.still_undecided == 0


def test_equal_entries_give_an_equal_summary() -> None:
    """Nothing depends on anything but entries and rubric."""
    entries = entries_of(TWO, [1, 0.5], [0, None], [0.3, 1])
    assert summarise(entries, TWO) == summarise(entries, TWO)


def test_numbers_that_nothing_measured_are_to_do() -> None:
    """The task names the check that reports them, whatever it cost."""
    plain = result_of(TWO, [0, 1])
    plain["criteria"][0]["checks"][0]["unmeasured"] = "All counts are constants of its source."
    (todo,) = summarise([entry_of("a", plain), *entries_of(TWO, [1, 1])], TWO).todos
    assert (todo.need, todo.row, todo.points, todo.check_id) == (
        Need.UNMEASURED,
        0,
        Decimal(4),
        "a.first",
    )
    assert todo.texts == ("All counts are constants of its source.",)
