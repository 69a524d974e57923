"""Changes by judging a class again, on the terminal and in `changes.csv`."""

from __future__ import annotations

import csv
import io
from decimal import Decimal

import pytest
from hypothesis import given
from rich.console import Console

from grader.cohort.changes import Change, Changes
from grader.report.changes import changes_csv, print_changes
from grader.report.grades_csv import BYTE_ORDER_MARK
from grader.result import Outcome
from tests.report.untrusted_texts import hostile


def change(
    name: str,
    before: str | None,
    after: str,
    *,
    outcome: Outcome = Outcome.FAILED,
    words: bool = False,
) -> Changes:
    """Return the changes of a submission, all of them in one check; none if the points are equal."""
    if before is None or before == after:
        return Changes(
            name,
            None if before is None else Decimal(before),
            Decimal(after),
            _NONE,
            _NONE,
            words=words,
        )
    difference = Decimal(after) - Decimal(before)
    check = Change("check", "p.rate", "Rate", Decimal(6), 6 + difference, (Outcome.PASSED, outcome))
    criterion = Change("criterion", "p", "Publisher", Decimal(20), 20 + difference)
    return Changes(
        name, Decimal(before), Decimal(after), _NONE, _NONE, (criterion, check), words=True
    )


_NONE = (Decimal(0), Decimal(0))


def printed(*changes: Changes, width: int = 120) -> str:
    """Return the printed text with single spaces."""
    file = io.StringIO()
    print_changes(
        Console(file=file, width=width, highlight=False),
        {each.submission: each for each in changes},
    )
    return "\n".join(" ".join(line.split()) for line in file.getvalue().splitlines())


# -- the terminal ----------------------------------------------------------------------------------


def test_who_changes_by_how_much_and_where() -> None:
    """Submission, criterion and check are told, each with old and new points."""
    assert printed(change("ann", "90", "84.5")).splitlines()[:3] == [
        "ann 90 → 84.5 −5.5",
        "Publisher 20 → 14.5 −5.5",
        "Rate passed → failed 6 → 0.5 −5.5",
    ]


def test_the_greatest_change_comes_first() -> None:
    """Up or down, by size; equal ones by name."""
    text = printed(change("ann", "90", "89"), change("eve", "50", "56"), change("bob", "40", "39"))
    assert [line.split()[0] for line in text.splitlines() if "→" in line and line[0] in "abe"] == [
        "eve",
        "ann",
        "bob",
    ]


def test_a_class_is_summed_up_by_check() -> None:
    """The summary counts the submissions that gain and lose by a check, and those that change at all."""
    text = printed(
        change("ann", "90", "88"),
        change("bob", "90", "91"),
        change("eve", "70", "70"),
        change("fay", "7", "7", words=True),
    )
    assert "Rate 1 1 −1" in text
    assert (
        "Points or outcomes change for 2 of 4 submissions, 1 only in words; 2 keep theirs." in text
    )


def test_another_total_is_reported() -> None:
    """Fewer possible points are reported once for all submissions with them; renamed checks have ids."""
    checks = []
    for n in "ab":
        checks.append(Change("check", f"p.{n}", "Rate", None, Decimal(6), (None, Outcome.PASSED)))
    criterion = Change("criterion", "p", "Publisher", Decimal(20), Decimal(20))
    each = []
    for name in ("ann", "bob"):
        each.append(
            Changes(
                name,
                Decimal(100),
                Decimal(90),
                _NONE,
                (Decimal(100), Decimal(90)),
                (criterion, *checks),
                True,
            )
        )
    text = printed(*each, change("eve", "90", "88"))
    assert text.count("2 submissions: of 90 points, before of 100") == 1
    assert "Rate (p.a) not there → passed" in text
    only = Changes("ann", Decimal(9), Decimal(9), _NONE, (Decimal(100), Decimal(90)), (), True)
    assert "1 submission: of 90 points, before of 100" in printed(only)


def test_nothing_changes() -> None:
    """A line reports that no points change, and counts the submissions that change only in words."""
    assert printed(change("ann", "90", "90")) == "No points change; 1 submission judged."
    assert "No points change, 1 only in words; 2 submissions judged." in printed(
        change("ann", "90", "90"), change("bob", "9", "9", words=True)
    )


def test_a_first_result_has_nothing_before_it() -> None:
    """Where there was no result, that is said in its place."""
    assert "ann none → 90 +90" in printed(change("ann", None, "90"))


def test_outcomes_adjustments_and_undecided_points_are_reported() -> None:
    """Changes without a check's points have a line too."""
    adjusted = Change("adjustment", "score", "bonus", Decimal(0), Decimal(3))
    check = Change("check", "p.rate", "Rate", None, Decimal(0), (None, Outcome.NOT_REACHED))
    criterion = Change("criterion", "p", "Publisher", Decimal(4), Decimal(4))
    text = printed(
        Changes(
            "ann",
            Decimal(1),
            Decimal(4),
            (Decimal(6), Decimal(0)),
            _NONE,
            (criterion, check, adjusted),
        )
    )
    assert "bonus: score 0 → 3 +3" in text
    assert "undecided 6 → 0" in text
    assert "Rate not there → not reached none → 0" in text
    assert "Publisher 4\n" in text


@given(hostile)
def test_no_name_steers_the_terminal(name: str) -> None:
    """Names of submissions are shown, not obeyed, and markup in them stays text."""
    text = printed(change(f"{name}[red]x[/red]", "1", "0"))
    assert not {"\x1b", "\r", "\x9b", "\u202e", "\x00"} & set(text)


# -- changes.csv -----------------------------------------------------------------------------------


def rows(*changes: Changes) -> list[dict[str, str]]:
    """Read the table as a spreadsheet does."""
    text = changes_csv(changes)
    assert text.startswith(BYTE_ORDER_MARK)
    return list(csv.DictReader(io.StringIO(text.removeprefix(BYTE_ORDER_MARK), newline="")))


def test_a_row_for_each_part() -> None:
    """Total, criterion, check and adjustment have a row each, with numbers as numbers."""
    adjusted = Change("adjustment", "score", "late", Decimal(0), Decimal("-2.5"))
    found = rows(
        change("ann", "90", "84.5"),
        Changes("bob", Decimal(9), Decimal("6.5"), _NONE, _NONE, (adjusted,)),
    )
    assert [(row["submission"], row["level"], row["id"], row["difference"]) for row in found] == [
        ("ann", "total", "", "-5.5"),
        ("ann", "criterion", "p", "-5.5"),
        ("ann", "check", "p.rate", "-5.5"),
        ("bob", "total", "", "-2.5"),
        ("bob", "adjustment", "score", "-2.5"),
    ]
    check = found[2]
    assert (check["outcome before"], check["outcome after"]) == ("passed", "failed")
    assert (check["points before"], check["points after"], check["title"]) == ("6", "0.5", "Rate")
    assert found[0]["undecided before"] == "0"
    assert found[4]["title"] == "late"


def test_a_first_result_has_an_empty_sandbox() -> None:
    """Missing previous values are empty, not 0."""
    assert [row["points before"] for row in rows(change("ann", None, "90"))] == [""]


def test_without_changes_there_is_a_head() -> None:
    """An empty table still names its columns."""
    assert rows() == []
    assert changes_csv([]).startswith(f"{BYTE_ORDER_MARK}submission,level,")


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "＝1"])
def test_no_name_is_a_formula(name: str) -> None:
    """A spreadsheet takes no cell that a student named for a formula."""
    assert [row["submission"][0] for row in rows(change(name, "1", "0"))] == ["'"] * 3


@given(hostile)
def test_any_name_can_be_written(name: str) -> None:
    """Whatever a submission is called, the table has its rows and can be saved as UTF-8."""
    changes_csv([change(name, "1", "0")]).encode()
    assert [row["level"] for row in rows(change(name, "1", "0"))] == ["total", "criterion", "check"]
