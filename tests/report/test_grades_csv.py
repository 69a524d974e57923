"""`grades.csv`: a grade book reads its values, and no cell of it is a formula."""

from __future__ import annotations

import csv
import io
import re
from datetime import UTC, datetime
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.cohort.entries import ClassEntry
from grader.cohort.statistics import summarise
from grader.report.grades_csv import BYTE_ORDER_MARK, csv_cell, render
from tests.cohort.made_up import entry_of, result_of, rubric_of

LAB = rubric_of(("pub.topic", 12), ("pub.rate", 8), ("doc.readme", 10))
FORMULA = "=+-@＝＋－＠"
QUOTES = "\"'`‘’“”„«»＂＇"
RISKY = st.text(
    st.sampled_from(f"{FORMULA}{QUOTES}\t\r\n ,;|1aA()!\u00a0\u200b\ufeff"), max_size=12
)


def rows_of(text: str, separator: str = ",") -> list[list[str]]:
    """Read a table as a spreadsheet does."""
    return list(
        csv.reader(io.StringIO(text.removeprefix(BYTE_ORDER_MARK), newline=""), delimiter=separator)
    )


def as_written(text: str) -> str:
    """Give a text as one cell of a table."""
    out = io.StringIO(newline="")
    csv.writer(out).writerow(["name", csv_cell(text), 1])
    return out.getvalue()


@pytest.mark.parametrize(
    "begin",
    [
        *FORMULA,
        "\t=",
        "\r=",
        "\n=",
        " =",
        "\u00a0@",
        '"=',
        "'=",
        "“+",
        " ' -",
        "\ufeff=",
        "\t",
        "\r",
    ],
)
def test_text_that_begins_like_a_formula_gets_an_apostrophe(begin: str) -> None:
    """Formulas are found behind blanks and quotes, in the full-width form, and behind invisible characters."""
    cell = csv_cell(f"{begin}cmd|' /C calc'!A0")
    assert isinstance(cell, str)
    assert cell[0] not in FORMULA
    assert cell.startswith(("'", "⟨U+FEFF⟩"))


@pytest.mark.parametrize(
    "text",
    ["alice", "o'brien", "a-b", "1+1=2", "ü (x)", "/joint_commands", "7", "", "‘x’", "a, b; c"],
)
def test_harmless_text_stays_as_it_is(text: str) -> None:
    """An apostrophe stands only where it is needed."""
    assert csv_cell(text) == text


@pytest.mark.parametrize("value", [0, -3, Decimal("-2.5"), Decimal("17.6")])
def test_numbers_stay_numbers(value: int | Decimal) -> None:
    """A deduction is a number, although it begins with a minus."""
    assert csv_cell(value) is value


def test_what_another_separator_would_cut_off_is_no_formula_either() -> None:
    """A spreadsheet that divides at semicolons finds no formula behind one."""
    assert csv_cell('x;=1+1; "@a",-2') == "x;'=1+1; \"'@a\",'-2"


@given(st.one_of(st.text(max_size=40), RISKY))
def test_no_cell_is_a_formula_whatever_separates_them(text: str) -> None:
    """Read with commas, or divided at semicolons, tabs or bars by a program that knows no quotes."""
    written = as_written(text)
    (row,) = rows_of(written)
    assert row == ["name", str(csv_cell(text)), "1"]
    pieces = [row[1], *re.split(r"[,;\t|\r\n]", written)]
    assert [
        piece for piece in pieces if piece.strip().lstrip('"').strip()[:1] in tuple(FORMULA)
    ] == []


@given(st.one_of(st.text(max_size=40), RISKY), st.text(max_size=20), RISKY)
def test_a_class_comes_back_as_it_was_written(name: str, student_id: str, problem: str) -> None:
    """A line a student and a cell a column, whatever students call themselves."""
    entries = [
        entry_of(name, result_of(LAB, [0.5, 1, 0]), student_id=student_id),
        ClassEntry(name, None, problem),
    ]
    table = rows_of(render(summarise(entries, LAB)))
    assert [len(row) for row in table] == [len(table[0])] * 3
    graded, other = (dict(zip(table[0], row, strict=True)) for row in table[1:])
    assert graded["submission"] == csv_cell(name)
    assert graded["student_id"] == csv_cell(student_id)
    assert other["problem"] == csv_cell(problem)
    assert Decimal(graded["total"]) == Decimal(14)


def test_the_columns_are_those_of_a_grade_book() -> None:
    """Points as judged and with adjustments, each criterion with its outcome, times with their offset."""
    plain = result_of(LAB, [0.5, 1, None])
    late = {
        "kind": "late",
        "what": "score",
        "points": -2.5,
        "reason": "A day late.",
        "who": "",
        "when": "",
    }
    entry = entry_of(
        "alice",
        plain | {"adjustments": [late]},
        submitted_at=datetime(2026, 11, 20, 23, 59, tzinfo=UTC),
        student_id="0012",
    )
    head, row, missing = rows_of(
        render(summarise([entry, ClassEntry("bob", None, "No files.")], LAB))
    )
    assert dict(zip(head, row, strict=True)) == {
        "submission": "alice",
        "student_id": "0012",
        "submitted_at": "2026-11-20T23:59:00+00:00",
        "total": "11.5",
        "earned": "14",
        "possible": "30",
        "undecided": "10",
        "pub": "14",
        "doc": "0",
        "pub_outcome": "partial",
        "doc_outcome": "undecided",
        "adjustments": "late -2.5: A day late.",
        "extensions": "",
        "needs": "undecided",
        "problem": "",
    }
    assert missing == ["bob", *[""] * 12, "not graded", "No files."]


def test_the_file_opens_in_spreadsheets() -> None:
    """A byte order mark tells Excel that it is UTF-8; lines end as RFC 4180 has it; Python reads it back."""
    data = render(summarise([entry_of("zoë", result_of(LAB, [1, 1, 1]))], LAB)).encode("utf-8")
    assert data.startswith(b"\xef\xbb\xbfsubmission,")
    assert data.count(b"\r\n") == data.count(b"\n") == 2
    assert data.decode("utf-8-sig").splitlines()[1].startswith("zoë,")
