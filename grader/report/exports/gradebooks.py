"""Tables that grade books import: a line a student, found by what the grade book knows them by.

Cells by which students are found are written as they are known, to the last zero, or not at all: one that a
spreadsheet would take for a formula is left empty. All other texts are made harmless (see `csv_cell`). Every cell
stands in quotes, without a byte order mark before the first, since not all importers expect one.

References
----------
Moodle: `mod/assign/feedback/offline` (the grading worksheet: the columns Identifier, Grade and Last modified (grade)
are needed; what is empty in the last is older than any grade given in Moodle) and `grade/import/csv` (by ID number,
user name or address), in moodle/moodle.
Canvas: `lib/gradebook_importer.rb` in instructure/canvas-lms: the first columns and their order are fixed; students
are found by ID, else by SIS ids; a column is an assignment's if its heading ends with the assignment's number.
Blackboard Help, "Work offline with grade data": Username, and a column's own number behind `|` in its heading; cells
of comma-separated files stand in quotes.
D2L, "Importing grades" (community.d2l.com): OrgDefinedId or Username, headings that end with `Points Grade`, and
`End-of-Line Indicator`; University of Wisconsin KB 4330: `#` before ids keeps their zeros.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import partial

from grader.report.escape import line
from grader.report.exports.returned import Returned, ReturnedClass, Share, comment
from grader.report.grades_csv import BYTE_ORDER_MARK, csv_cell, csv_text
from grader.report.views import points


@dataclass(frozen=True)
class Column:
    """A column: its heading (none for that of the points), what stands in it, and whether students are found by it."""

    heading: str
    cell: Callable[[Share], str | Decimal]
    is_key: bool = False


@dataclass(frozen=True)
class GradeBook:
    """What a system's grade book imports."""

    columns: Sequence[Column]
    #: The heading of the column of points, unless the user knows it; `{lab}` and `{points}` stand for the lab's.
    heading: str = "{lab}"
    #: What the second line says before the points that there are, in the column of points; none if there is no such.
    second: str = ""

    def render(self, given: ReturnedClass) -> Returned:
        """Return the table of a class in which somebody has a result."""
        returned, shares = Returned(), list(given.shares)
        found = [self._keys(share) for share in shares]
        times = Counter(key for keys in found for key in keys.items())
        rows = []
        for share, keys in zip(shares, found, strict=True):
            if not keys:
                wanted = ", ".join(column.heading for column in self.columns if column.is_key)
                returned.left_out[f"none of these is known: {wanted}"].append(share.entry.name)
            elif any(times[key] > 1 for key in keys.items()):
                returned.left_out["the same student stands behind several submissions"].append(
                    share.entry.name
                )
            else:
                rows.append(
                    [keys.get(c.heading, "") if c.is_key else c.cell(share) for c in self.columns]
                )
        first = shares[0].result
        heading = given.column or self.heading.format(
            lab=line(first.lab), points=points(first.score.possible)
        )
        others = ["" for _ in self.columns[1:-1]]
        second: list[list[str | Decimal]] = (
            [[self.second, *others, first.score.possible]] if self.second else []
        )
        head = [column.heading or heading for column in self.columns]
        returned.count = len(rows)
        returned.content = (
            csv_text([head, *second, *rows], csv.QUOTE_ALL).removeprefix(BYTE_ORDER_MARK).encode()
        )
        return returned

    def _keys(self, share: Share) -> dict[str, str]:
        """Return by what the grade book finds a student, as far as that is known and can be written as it is."""
        cells = {
            column.heading: str(column.cell(share)) for column in self.columns if column.is_key
        }
        return {heading: cell for heading, cell in cells.items() if cell and csv_cell(cell) == cell}


def _known(fact: str, share: Share, before: str = "") -> str:
    text = str(getattr(share.person, fact))
    return before + text if text else ""


def _number(fact: str, share: Share, before: str = "") -> str:
    """Return a system's own number of a student; where students are anonymous, it is none."""
    return _known(fact, share, before) if _known(fact, share).isdecimal() else ""


_POINTS = Column("", lambda share: share.result.final)
_NAME = partial(_known, "name")
_ID, _LOGIN, _EMAIL = (
    partial(_known, "student_id"),
    partial(_known, "login"),
    partial(_known, "email"),
)


MOODLE = GradeBook(
    (
        Column("Identifier", partial(_number, "moodle", before="Participant "), is_key=True),
        Column("Full name", _NAME),
        Column("ID number", _ID, is_key=True),
        Column("Username", _LOGIN, is_key=True),
        Column("Email address", _EMAIL, is_key=True),
        _POINTS,
        Column("Maximum Grade", lambda share: share.result.score.possible),
        Column("Last modified (grade)", lambda share: ""),
        Column("Feedback comments", lambda share: comment(share.result)),
    ),
    heading="Grade",
)
CANVAS = GradeBook(
    (
        Column("Student", _NAME),
        Column("ID", partial(_number, "canvas"), is_key=True),
        Column("SIS User ID", _ID, is_key=True),
        Column("SIS Login ID", _LOGIN, is_key=True),
        Column("Section", partial(_known, "section")),
        _POINTS,
    ),
    second="    Points Possible",
)
BLACKBOARD = GradeBook(
    (
        Column("Username", _LOGIN, is_key=True),
        _POINTS,
        Column("Feedback to Learner", lambda share: comment(share.result)),
        Column("Feedback Format", lambda share: "SMART_TEXT"),
    ),
    heading="{lab} [Total Pts: {points} Score]",
)
BRIGHTSPACE = GradeBook(
    (
        Column("OrgDefinedId", partial(_ID, before="#"), is_key=True),
        Column("Username", partial(_LOGIN, before="#"), is_key=True),
        _POINTS,
        Column("End-of-Line Indicator", lambda share: "#"),
    ),
    heading="{lab} Points Grade",
)
