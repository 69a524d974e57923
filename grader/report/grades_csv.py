"""`grades.csv`: the class for the grade book, one student a line.

The file is written for spreadsheets that open it by a double click: UTF-8 with a byte order mark, because Excel
assumes the system's code page without one, commas, and CR LF.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Literal

from grader.cohort.statistics import ClassSummary, Row
from grader.report.escape import line
from grader.report.views import bonus_lines, points
from grader.result import Adjustment, CriterionResult

BYTE_ORDER_MARK = "\ufeff"
LONGEST = 500
#: Columns before and after those of the criteria.
_FIRST = ("submission", "student_id", "submitted_at", "total", "earned", "possible", "undecided")
_LAST = ("adjustments", "extensions", "needs", "problem")

_FORMULA = "=+\\-@\uff1d\uff0b\uff0d\uff20"
_QUOTES = "\"'`‘’“”„«»＂＇"
#: Beginning of a cell that a spreadsheet may take for a formula, after blanks and quotes.
_BEGINS = re.compile(rf"[\s{_QUOTES}]*[{_FORMULA}\t\r]")
#: The same after a mark that another spreadsheet may take for the end of a cell.
_GOES_ON = re.compile(rf"([,;|][\s{_QUOTES}]*)(?=[{_FORMULA}])")


def csv_cell(value: str | int | Decimal) -> str | int | Decimal:
    """Return a value as a cell that no spreadsheet takes for a formula; text becomes one line that can be shown.

    Text that begins like a formula gets an apostrophe before it. The same goes for text after a comma or semicolon,
    because a spreadsheet with another separator would divide the cell there.

    References
    ----------
    OWASP, "CSV Injection".
    """
    if not isinstance(value, str):
        return value
    tabbed = value[:1] in ("\t", "\r")
    text = line(value, LONGEST)
    if tabbed or _BEGINS.match(text):
        text = f"'{text}"
    return _GOES_ON.sub(r"\1'", text)


def csv_text(
    rows: Iterable[Sequence[str | int | Decimal]], quoting: Literal[0, 1] = csv.QUOTE_MINIMAL
) -> str:
    """Return the text of a file of rows, the head first; numbers have no trailing zeros."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\r\n", quoting=quoting)
    for row in rows:
        cells = []
        for value in row:
            cell = csv_cell(value)
            if isinstance(cell, Decimal):
                cell = points(cell)
            cells.append(str(cell))
        writer.writerow(cells)
    return BYTE_ORDER_MARK + text.getvalue()


def render(summary: ClassSummary) -> str:
    """Return the text of `grades.csv`, to be written as UTF-8; equal summaries give equal bytes.

    The total includes all adjustments, and the earned points none; no sum includes the points of extensions.
    """
    ids = [column.id for column in summary.columns]
    outcomes = [f"{name}_outcome" for name in ids]
    rows: list[list[str | Decimal]] = [[*_FIRST, *ids, *outcomes, *_LAST]]
    for number, row in enumerate(summary.rows):
        needs = [todo.need.value for todo in summary.todos if todo.row == number]
        rows.append(_row(row, needs))
    return csv_text(rows)


def _row(row: Row, needs: Sequence[str]) -> list[str | Decimal]:
    """Return the cells of a submission; `needs` are the tasks that a person has with it."""
    entry = row.entry
    submitted = entry.submitted_at.isoformat() if entry.submitted_at else ""
    sums: list[str | Decimal] = [""] * 4
    adjustments = []
    extensions = []
    if row.result:
        score = row.result.score
        sums = [row.result.final, score.earned, score.possible, row.result.still_undecided]
        adjustments = [_adjustment(each) for each in row.result.adjustments]
        extensions = bonus_lines(row.result)
    earned = [cell.earned if cell else "" for cell in row.cells]
    return [
        entry.name,
        entry.student_id or "",
        submitted,
        *sums,
        *earned,
        *map(_outcome, row.cells),
        "; ".join(adjustments),
        "; ".join(extensions),
        ", ".join(needs),
        entry.problem,
    ]


def _adjustment(each: Adjustment) -> str:
    """Write an adjustment: `late -5: two days`."""
    return f"{each.kind.value} {points(each.points)}: {each.reason}".rstrip(": ")


def _outcome(cell: CriterionResult | None) -> str:
    if cell is None:
        return ""
    return cell.outcome.value if cell.outcome.decided else "undecided"
