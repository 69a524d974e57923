"""Tables that grade books import: one student a line, with the cells by which the grade book finds the student.

Cells by which students are found are written unchanged, to the last zero, or not at all: one that a spreadsheet would
take for a formula is left empty. All other texts are made harmless (see `csv_cell`). Every cell is in quotes,
without a byte order mark before the first, because not all importers expect one.

An importer that finds students by one column needs a cell in each line of it. A column with an empty cell is therefore
left out, and students without a cell in any complete column go into a further table.

References
----------
Moodle: `mod/assign/feedback/offline` (the grading worksheet: the columns Identifier, Grade and Last modified (grade)
are needed; an empty cell in the last is older than any grade given in Moodle; a grade above the maximum is skipped) and
`grade/import/csv` (by one of ID number, user name and address; with an empty cell there, 3.3 gives the grade to the
student of the line above, and 4.2 looks for a user without an ID number; a grade above the maximum ends the import),
in moodle/moodle.
Canvas: `lib/gradebook_importer.rb` in instructure/canvas-lms: the first columns and their order are fixed; students
are found by ID, else by SIS ids; a column is an assignment's if its heading ends with the assignment's number; columns
with the names of Canvas' own sums are ignored (`NON_ASSIGNMENT_COLUMN_HEADERS`; by issue 2134 any with "final").
Blackboard Help, "Work offline with grade data": Username, and a column's own number after `|` in its heading; cells
of comma-separated files are in quotes.
D2L, "Importing grades" (community.d2l.com): OrgDefinedId or Username, headings that end with `Points Grade`, and
`End-of-Line Indicator`; University of Wisconsin KB 4330: `#` before ids keeps their zeros.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import partial

from grader.errors import UsageError
from grader.report.escape import line
from grader.report.exports.returned import Returned, ReturnedClass, Share, comment
from grader.report.grades_csv import BYTE_ORDER_MARK, csv_cell, csv_text
from grader.report.views import points


@dataclass(frozen=True)
class Column:
    """A column: its heading (none for the points), its content, and whether it identifies students."""

    heading: str
    cell: Callable[[Share], str | Decimal]
    is_key: bool = False


@dataclass(frozen=True)
class _Line:
    """A student's line: the share, and the cells that identify the student in the grade book, by heading."""

    share: Share
    keys: dict[str, str]


def _as_it_is(heading: str, asked: bool) -> str:
    return heading


def _no_advice(headings: Sequence[str]) -> str:
    return ""


@dataclass(frozen=True)
class GradeBook:
    """The table that a system's grade book imports."""

    columns: Sequence[Column]
    #: Heading of the column of points, unless the user gives one; `{lab}` and `{points}` stand for the lab's.
    heading: str = "{lab}"
    #: First cell of a second line with the possible points in the column of points; empty if there is no such line.
    second: str = ""
    #: True if each line is looked up by its first cell that is not empty; key columns may then have empty cells.
    line_by_line: bool = False
    #: Consequence of more points than the maximum; empty if the system takes them.
    above: str = ""
    #: Returns a heading in the form that the system reads; the other argument is true if the user asked for it.
    readable: Callable[[str, bool], str] = _as_it_is
    #: Tells the person who imports a table how to map its key columns.
    advice: Callable[[Sequence[str]], str] = _no_advice

    @property
    def _key_headings(self) -> list[str]:
        return [column.heading for column in self.columns if column.is_key]

    def render(self, given: ReturnedClass) -> Returned:
        """Return the table of a class with at least one result, and further tables if one cannot name all students.

        Raises
        ------
        UsageError
            If the system ignores the column that the user asks for.
        """
        lab = next(given.shares).result
        possible = lab.score.possible
        default = self.heading.format(lab=line(lab.lab), points=points(possible))
        asked = given.column or default
        heading = self.readable(asked, bool(given.column))
        left_out = Returned().left_out
        lines = self._lines(given, left_out)
        tables = [self._table(part, heading, possible) for part in self._parts(lines)]
        returned, *returned.further = tables or [Returned()]
        returned.left_out = left_out
        returned.notes |= self._notes(lines)
        if heading != asked:
            returned.notes[f"ignores columns like {asked!r}; this one is called {heading!r}"] = []
        return returned

    def _lines(self, given: ReturnedClass, left_out: dict[str, list[str]]) -> list[_Line]:
        """Return the lines of the students that can be found, and note the others."""
        lines = [_Line(share, self._keys(share)) for share in given.shares]
        times: Counter[tuple[str, str]] = Counter()
        for found in lines:
            times.update(found.keys.items())
        unknown = f"none of these is known: {', '.join(self._key_headings)}"
        kept = []
        for found in lines:
            name = found.share.entry.name
            if not found.keys:
                left_out[unknown].append(name)
            elif any(times[key] > 1 for key in found.keys.items()):
                left_out["the same student stands behind several submissions"].append(name)
            else:
                kept.append(found)
        return kept

    def _parts(self, lines: Sequence[_Line]) -> Iterator[Sequence[_Line]]:
        """Divide the lines into tables that have a complete key column each, the largest first."""
        while lines:
            missing = self._missing(lines)
            # The first column in the table, if several name equally many students.
            key = min(missing, key=lambda heading: len(missing[heading]))
            others = [] if self.line_by_line else missing[key]
            yield [found for found in lines if found not in others]
            lines = others

    def _table(self, lines: Sequence[_Line], heading: str, possible: Decimal) -> Returned:
        missing = self._missing(lines)
        complete = [name for name in missing if not missing[name]]
        columns = list(self.columns)
        if not self.line_by_line:
            columns = [column for column in columns if not missing.get(column.heading)]
        head = [column.heading or heading for column in columns]
        table: list[Sequence[str | Decimal]] = [head]
        if self.second:
            table.append([self.second, *[""] * (len(columns) - 2), possible])
        for found in lines:
            table.append([_cell(column, found) for column in columns])
        text = csv_text(table, csv.QUOTE_ALL).removeprefix(BYTE_ORDER_MARK)
        returned = Returned(text.encode(), len(lines))
        advice = self.advice(complete)
        if advice:
            returned.notes[advice] = []
        return returned

    def _missing(self, lines: Sequence[_Line]) -> dict[str, list[_Line]]:
        """Return by each heading of a key column the lines with an empty cell there."""
        missing = {}
        for heading in self._key_headings:
            missing[heading] = [found for found in lines if heading not in found.keys]
        return missing

    def _notes(self, lines: Sequence[_Line]) -> dict[str, list[str]]:
        """Return notes on incomplete columns and on points above the maximum, each with its submissions."""
        notes = {}
        if not self.line_by_line:
            for name, without in self._missing(lines).items():
                note = f"not all have {name}, so no table has it with a gap; it is missing for"
                if 0 < len(without) < len(lines):
                    notes[note] = _names(without)
        above = [found for found in lines if found.share.is_above]
        if self.above and above:
            notes[f"more points than the maximum, {self.above}"] = _names(above)
        return notes

    def _keys(self, share: Share) -> dict[str, str]:
        """Return the cells that identify a student in the grade book, by heading, as far as they can be written unchanged."""
        keys = {}
        for column in self.columns:
            if column.is_key:
                cell = str(column.cell(share))
                if cell and csv_cell(cell) == cell:
                    keys[column.heading] = cell
        return keys


def _names(lines: Sequence[_Line]) -> list[str]:
    return [found.share.entry.name for found in lines]


def _cell(column: Column, found: _Line) -> str | Decimal:
    if column.is_key:
        return found.keys.get(column.heading, "")
    return column.cell(found.share)


def _known(fact: str, share: Share, before: str = "") -> str:
    text = str(getattr(share.person, fact))
    return before + text if text else ""


def _number(fact: str, share: Share, before: str = "") -> str:
    """Return a system's own number of a student; empty if students are anonymous."""
    if _known(fact, share).isdecimal():
        return _known(fact, share, before)
    return ""


_POINTS = Column("", lambda share: share.result.final)
_NAME = partial(_known, "name")
_ID = partial(_known, "student_id")
_LOGIN = partial(_known, "login")
_EMAIL = partial(_known, "email")


def _moodle_advice(headings: Sequence[str]) -> str:
    """Say which columns find students in Moodle's two imports."""
    mapped = [heading for heading in headings if heading != _PARTICIPANT]
    texts = []
    if _PARTICIPANT in headings:
        texts.append("'Upload grading worksheet' finds students by Identifier")
    if mapped:
        others = "all other columns but Grade"
        if _PARTICIPANT in headings:
            others = f"{_PARTICIPANT} and {others}"
        texts.append(
            f"for 'Import > CSV file' choose 'Map from' {' or '.join(mapped)}, and leave {others} on 'Ignore'"
        )
    else:
        texts.append("'Import > CSV file' cannot; --class-list adds what it needs")
    return "; ".join(texts)


#: Words in a heading that make Canvas take the column for one of its own sums.
_CANVAS_SUMS = re.compile(
    r"\b\w*final\w*|\b(?:current|override) (?:score|points|grade|status)", re.IGNORECASE
)
#: Number of an assignment at the end of a heading.
_CANVAS_NUMBER = re.compile(r"\s\(\d+\)$")


def _read_by_canvas(heading: str, asked: bool) -> str:
    """Return a heading without the words that make Canvas ignore a column, such as `Lab (4711)` for `Final Lab (4711)`.

    The number of an assignment is enough to find it. Raises UsageError if the user asks for a heading without number.
    """
    if not _CANVAS_SUMS.search(heading):
        return heading
    number = _CANVAS_NUMBER.search(heading)
    if asked and number is None:
        raise UsageError(
            f"Canvas ignores a column that is called {heading!r}, as it does all with 'final' in their name",
            location="--column",
            remedy="Give the heading with the assignment's number as Canvas' export has it, as in 'Lab 9 (4711)'.",
        )
    title = _CANVAS_NUMBER.sub("", heading)
    kept = " ".join(_CANVAS_SUMS.sub("", title).split()) or "Lab"
    if number is None:
        return kept
    return f"{kept} {number[0].strip()}"


_PARTICIPANT = "Identifier"
MOODLE = GradeBook(
    (
        Column(_PARTICIPANT, partial(_number, "moodle", before="Participant "), is_key=True),
        Column("Full name", _NAME),
        Column("ID number", _ID, is_key=True),
        Column("Username", _LOGIN, is_key=True),
        Column("Email address", _EMAIL, is_key=True),
        _POINTS,
        Column("Maximum Grade", lambda share: share.result.score.possible),
        Column("Last modified (grade)", lambda share: ""),
        Column("Feedback comments", lambda share: comment(share.result, share.language)),
    ),
    heading="Grade",
    above="with which 'Import > CSV file' imports nobody, and 'Upload grading worksheet' skips the line: raise the "
    "maximum in Moodle, or give these by hand",
    advice=_moodle_advice,
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
    line_by_line=True,
    readable=_read_by_canvas,
)
BLACKBOARD = GradeBook(
    (
        Column("Username", _LOGIN, is_key=True),
        _POINTS,
        Column("Feedback to Learner", lambda share: comment(share.result, share.language)),
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
    above="which Brightspace cuts off unless the item has 'Can Exceed'",
)
