"""`grades.csv`: a class for the grade book, a line a student.

It is written for spreadsheets as they open a file by a double click: UTF-8 with a byte order mark, without which Excel
takes it for the system's code page, commas, and CR LF.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Literal

from grader.cohort.statistics import ClassSummary
from grader.report.escape import line
from grader.report.views import bonus_lines, points
from grader.result import CriterionResult

BYTE_ORDER_MARK = "\ufeff"
LONGEST = 500

_FORMULA = "=+\\-@\uff1d\uff0b\uff0d\uff20"
_QUOTES = "\"'`‘’“”„«»＂＇"
#: The beginning of a cell that a spreadsheet may take for a formula, behind blanks and quotes.
_BEGINS = re.compile(rf"[\s{_QUOTES}]*[{_FORMULA}\t\r]")
#: The same behind what another spreadsheet may take for the end of a cell.
_GOES_ON = re.compile(rf"([,;|][\s{_QUOTES}]*)(?=[{_FORMULA}])")


def csv_cell(value: str | int | Decimal) -> str | int | Decimal:
    """Return a value as a cell that no spreadsheet takes for a formula; text becomes one line that can be shown.

    An apostrophe stands before text that begins like a formula, and before what does so behind a comma or semicolon in
    it, where a spreadsheet with another separator would divide it.

    References
    ----------
    OWASP, "CSV Injection".
    """
    if not isinstance(value, str):
        return value
    tabbed = value[:1] in ("\t", "\r")
    text = line(value, LONGEST)
    text = f"'{text}" if tabbed or _BEGINS.match(text) else text
    return _GOES_ON.sub(r"\1'", text)


def csv_text(
    rows: Iterable[Sequence[str | int | Decimal]], quoting: Literal[0, 1] = csv.QUOTE_MINIMAL
) -> str:
    """Return the text of a file of rows, the first of them its head; numbers without trailing zeros."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\r\n", quoting=quoting)
    for row in rows:
        cells = map(csv_cell, row)
        writer.writerow(
            [points(cell) if isinstance(cell, Decimal) else str(cell) for cell in cells]
        )
    return BYTE_ORDER_MARK + text.getvalue()


def render(summary: ClassSummary) -> str:
    """Return the text of `grades.csv`, to be written as UTF-8; equal summaries give equal bytes.

    The total is with all adjustments, the points that were earned without; those of extensions are in no sum.
    """
    ids = [column.id for column in summary.columns]
    head = ["submission", "student_id", "submitted_at", "total", "earned", "possible", "undecided"]
    last = ["adjustments", "extensions", "needs", "problem"]
    rows: list[list[str | Decimal]] = [[*head, *ids, *(f"{name}_outcome" for name in ids), *last]]
    for number, row in enumerate(summary.rows):
        submitted, result = row.entry.submitted_at, row.result
        sums: list[str | Decimal] = [""] * 4
        if result:
            sums = [
                result.final,
                result.score.earned,
                result.score.possible,
                result.still_undecided,
            ]
        adjustments = result.adjustments if result else ()
        rows.append(
            [
                row.entry.name,
                row.entry.student_id or "",
                submitted.isoformat() if submitted else "",
                *sums,
                *(cell.earned if cell else "" for cell in row.cells),
                *map(_outcome, row.cells),
                "; ".join(
                    f"{a.kind.value} {points(a.points)}: {a.reason}".rstrip(": ")
                    for a in adjustments
                ),
                "; ".join(bonus_lines(result)) if result else "",
                ", ".join(todo.need.value for todo in summary.todos if todo.row == number),
                row.entry.problem,
            ]
        )
    return csv_text(rows)


def _outcome(cell: CriterionResult | None) -> str:
    if cell is None:
        return ""
    return cell.outcome.value if cell.outcome.decided else "undecided"
