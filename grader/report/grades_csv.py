"""`grades.csv`: a class for the grade book, a line a student.

It is written for Excel and LibreOffice as they open a file by a double click: UTF-8 with a byte order mark, without
which Excel takes it for the system's code page, commas, and CR LF. In Python, `encoding="utf-8-sig"` reads it. Where
Excel's list separator is the semicolon, it has to be imported (Data, From Text/CSV).
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
    """Return a value as a cell that no spreadsheet takes for a formula.

    Notes
    -----
    Numbers stay numbers. Text becomes one line that can be shown. Text that begins like a formula, with an equals,
    plus, minus or at sign, in their full-width forms too, also behind blanks and quotes, gets an apostrophe before
    it. So does what stands behind a comma or semicolon in it, since a spreadsheet with another separator would
    divide the text there.

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


def csv_text(rows: Iterable[Sequence[str | int | Decimal]], quoting: Literal[0, 1] = csv.QUOTE_MINIMAL) -> str:
    """Return the text of a file of rows, the first of them its head; numbers without trailing zeros."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\r\n", quoting=quoting)
    for row in rows:
        cells = map(csv_cell, row)
        writer.writerow([points(cell) if isinstance(cell, Decimal) else str(cell) for cell in cells])
    return BYTE_ORDER_MARK + text.getvalue()


def render(summary: ClassSummary) -> str:
    """Return the text of `grades.csv`, to be written as UTF-8; equal summaries give equal bytes.

    Columns are: submission, student_id, submitted_at (ISO 8601); total (with all adjustments), earned (without),
    possible and undecided points; the points of each criterion, under its id, and its outcome, under the id with
    `_outcome`; adjustments, extensions, whose points are in no sum, and what needs a
    person.
    """
    ids = [column.id for column in summary.columns]
    head = ["submission", "student_id", "submitted_at", "total", "earned", "possible", "undecided"]
    last = ["adjustments", "extensions", "needs", "problem"]
    rows: list[list[str | Decimal]] = [[*head, *ids, *(f"{name}_outcome" for name in ids), *last]]
    for number, row in enumerate(summary.rows):
        submitted, result = row.entry.submitted_at, row.result
        sums: list[str | Decimal] = [""] * 4
        if result:
            sums = [result.final, result.score.earned, result.score.possible, result.still_undecided]
        adjustments = result.adjustments if result else ()
        rows.append(
            [
                row.entry.name,
                row.entry.student_id or "",
                submitted.isoformat() if submitted else "",
                *sums,
                *(cell.earned if cell else "" for cell in row.cells),
                *map(_outcome, row.cells),
                "; ".join(f"{a.kind.value} {points(a.points)}: {a.reason}".rstrip(": ") for a in adjustments),
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
