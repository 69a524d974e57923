"""Imports of other systems, written from their published rules; each docstring names its source."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import PurePosixPath


@dataclass(frozen=True)
class User:
    """A student, as a learning-management system has them."""

    number: str
    name: str
    student_id: str = ""
    login: str = ""
    email: str = ""


class Refused(Exception):
    """The system imports nothing of the file."""


def table(content: bytes) -> list[list[str]]:
    """Give the rows of a comma-separated file, all of one length; a byte order mark would be part of the first cell."""
    rows = list(csv.reader(io.StringIO(content.decode("utf-8"), newline="")))
    if len({len(row) for row in rows}) != 1:
        raise Refused("rows of several lengths")
    return rows


def moodle_worksheet(
    content: bytes, users: Iterable[User], most: Decimal
) -> dict[str, tuple[Decimal, str]]:
    """Read a grading worksheet: user's number -> grade and comment.

    `assignfeedback_offline_grade_importer` and `process_import_grades` in `mod/assign/feedback/offline`: three columns
    are needed under their English names; the text after `Participant ` is the number; unknown ones are passed over,
    and so are grades that are empty, below 0 or above the most; a column of comments that is the first is none.
    """
    head, *rows = table(content)
    if not {"Identifier", "Grade", "Last modified (grade)"} <= {*head}:
        raise Refused("columns are missing")
    feedback = head.index("Feedback comments")
    known = {user.number for user in users}
    read = {}
    for row in rows:
        number, grade = (
            row[head.index("Identifier")][len("Participant ") :],
            row[head.index("Grade")],
        )
        if number in known and grade and 0 <= Decimal(grade) <= most:
            read[number] = Decimal(grade), row[feedback] if feedback else ""
    return read


def moodle_grade_book(
    content: bytes,
    users: Sequence[User],
    heading: str,
    fact: str,
    most: Decimal = Decimal(100),
    *,
    skips_empty_keys: bool = False,
) -> dict[str, Decimal | None]:
    """Read a table into the grade book, students by one column: user's number -> grade.

    `gradeimport_csv_load_data` in `grade/import/csv`: a key without a student, or with several,
    ends the import; `-` and nothing are no grade; another cell that is no number ends the import,
    and so does a grade above the maximum. Until 4.1 an empty key cell is skipped, which leaves the
    student of the line before; since then it is looked up like any other. `MOODLE_SAID` in the
    tests has the PHP's own answers.
    """
    head, *rows = table(content)
    read: dict[str, Decimal | None] = {}
    student = ""
    for row in rows:
        key = row[head.index(heading)].strip()
        if key or not skips_empty_keys:
            found = [user.number for user in users if getattr(user, fact) == key]
            if len(found) != 1:
                raise Refused(f"no user or several: {key!r}")
            (student,) = found
        if not student:
            raise Refused("no user")
        read[student] = _moodle_grade(row[head.index("Grade")], most)
    return read


def _moodle_grade(cell: str, most: Decimal) -> Decimal | None:
    if cell in ("", "-"):
        return None
    if not re.fullmatch(r"-?\d+(\.\d+)?", cell):
        raise Refused(f"no grade: {cell}")
    if Decimal(cell) > most:
        raise Refused(f"too big: {cell}")
    return Decimal(cell)


def canvas(
    content: bytes, users: Sequence[User], assignments: Mapping[str, str]
) -> dict[str, dict[str, str]]:
    """Read a gradebook: assignment's number, or the title of a new one -> user's number -> score.

    `GradebookImporter` in `lib/gradebook_importer.rb`: `Student` first, then `ID`; either `SIS Login ID` or both SIS
    columns, `Section` last before the assignments; a heading's number in brackets is the assignment's, else its title
    is looked up; columns called like Canvas' own sums are passed over (issue 2134: any with "final" in its name); lines
    of nothing but commas are skipped, a line with `Points Possible` is about no student; numbers with a decimal comma get
    a point. A student is found by ID, else by SIS ids, else by name; others would be new.
    """
    head, *lines = [row for row in table(content) if any(cell.strip(" ;,") for cell in row)]
    rows = [row for row in lines if "Points Possible" not in row[0]]
    read: dict[str, dict[str, str]] = {}
    for at in range(_first_assignment(head), len(head)):
        if _CANVAS_SUMS.search(head[at]):
            continue
        scores = read[_assignment_of(head[at], assignments)] = {}
        for row in rows:
            user = _canvas_user(dict(zip(head, row, strict=True)), users)
            scores[user] = _with_point(row[at])
    return read


#: Columns of Canvas' own.
_CANVAS_SUMS = re.compile("final|(Current|Override) (Score|Points|Grade|Status)", re.IGNORECASE)


def _first_assignment(head: Sequence[str]) -> int:
    """Return the first column after those about the student; raises Refused for another order of these."""
    if len(head) <= 3:
        raise Refused("Invalid header row")
    for wanted, heading in zip(("Student", "ID"), head, strict=False):
        if wanted not in heading:
            raise Refused("Invalid header row")
    sis = ["SIS Login ID"]
    if head[2] == "SIS User ID":
        sis = ["SIS User ID", "SIS Login ID"]
    end = 2
    if head[2 : 2 + len(sis)] == sis:
        end += len(sis)
    if "Section" not in head[end]:
        raise Refused("Invalid header row")
    return end + 1


def _assignment_of(heading: str, assignments: Mapping[str, str]) -> str:
    """Return the number of a column's assignment, by the number or the title in its heading; else the heading."""
    named = re.fullmatch(r"(.*)\s\((\d+)\)", heading)
    number = named[2] if named else ""
    if number in assignments:
        return number
    titled = {title: number for number, title in assignments.items()}
    return titled.get(heading, heading)


def _with_point(cell: str) -> str:
    if not re.fullmatch(r"-?[0-9.,]+%?", cell):
        return cell
    *whole, last = re.split(r"[,.]", cell)
    return f"{''.join(whole)}.{last}" if whole else last


def _canvas_user(row: Mapping[str, str], users: Sequence[User]) -> str:
    for heading, fact in (
        ("ID", "number"),
        ("SIS User ID", "student_id"),
        ("SIS Login ID", "login"),
        ("Student", "name"),
    ):
        found = [
            user
            for user in users
            if row[heading] and getattr(user, fact) == _with_point(row[heading])
        ]
        if found:
            return found[0].number
    return f"new: {row['Student']}"


def blackboard(
    content: bytes, users: Iterable[User], columns: Mapping[str, str]
) -> dict[str, dict[str, str]]:
    """Read a grade center's file: column's number, or a new heading -> user's login -> cell.

    Blackboard Help, "Work offline with grade data", and `Upload Gradebook`: a header row, every cell of a file with
    commas in quotes; the upload fails where a user name is missing, users from outside of the course are not processed;
    the number behind `|` is an existing column's. Feedback has columns of its own, with its format.
    """
    head, *rows = table(content)
    if any(
        not re.fullmatch(r'"([^"]|"")*"(,"([^"]|"")*")*', line)
        for line in content.decode().splitlines()
    ):
        raise Refused("a cell without quotes")
    if "Username" not in head or any(not row[head.index("Username")] for row in rows):
        raise Refused("no user name")
    known = {user.login for user in users}
    read: dict[str, dict[str, str]] = {}
    for at, heading in enumerate(head):
        if heading != "Username":
            number = (
                heading.rpartition("|")[2] if heading.rpartition("|")[2] in columns else heading
            )
            read[number] = {
                row[head.index("Username")]: row[at]
                for row in rows
                if row[head.index("Username")] in known
            }
    return read


def brightspace(
    content: bytes, users: Iterable[User], most: Decimal
) -> dict[str, dict[str, Decimal]]:
    """Read grades: item -> user's number -> points.

    D2L, "Importing grades": OrgDefinedId or Username; an item's heading is its name and `Points Grade`; the last column
    is `End-of-Line Indicator`, with `#` in every line; points above the item's are capped. KB 4330 of the University of
    Wisconsin: a `#` before an id is no part of it, and an id of digits without it may lose its zeros.
    """
    head, *rows = table(content)
    if head[-1] != "End-of-Line Indicator" or any(row[-1] != "#" for row in rows):
        raise Refused("no end of line")
    read: dict[str, dict[str, Decimal]] = {}
    for at, heading in enumerate(head):
        if item := re.fullmatch(r"(.+) Points Grade( <Numeric MaxPoints:.*>)?", heading):
            points = read[item[1]] = {}
            for row in rows:
                cells = dict(zip(head, row, strict=True))
                ids = [_unmarked(cells.get(name, "")) for name in ("OrgDefinedId", "Username")]
                known = [
                    u
                    for u in users
                    if (ids[0] and u.student_id == ids[0]) or (ids[1] and u.login == ids[1])
                ]
                points[known[0].number] = min(Decimal(row[at]), most)
    return read


def _unmarked(cell: str) -> str:
    return cell[1:] if cell.startswith("#") else cell.lstrip("0")


def moodle_feedback(content: bytes, users: Iterable[User]) -> dict[str, dict[str, bytes]]:
    """Read feedback files: user's number -> the files' names -> their contents.

    `is_valid_filename_for_import` in `mod/assign/feedback/file/importziplib.php`: hidden files are ignored; the first
    part of the path that has a known number in second place, and a plugin in third and fourth, names the student; the
    rest is the file's name.
    """
    known = {int(user.number) for user in users}
    read: dict[str, dict[str, bytes]] = {}
    for path, file in _unpacked(content).items():
        parts = path.split("/")
        if parts[-1].startswith((".", "~")):
            continue
        while parts:
            info = parts.pop(0).split("_", 4)
            if len(info) < 4 or info[2] != "assignsubmission":
                continue
            if info[1].isdigit() and int(info[1]) in known:
                parts.insert(0, info[4] if len(info) > 4 else "")
                read.setdefault(info[1], {})["/".join(filter(None, parts))] = file
                break
    return read


def canvas_feedback(
    content: bytes, attachments: Mapping[str, tuple[str, str]], groups: Sequence[str] = ()
) -> dict[str, tuple[str, bytes]]:
    """Read marked submissions: user's number -> file name shown to the student, and file content.

    `infer_comment_context_from_filename` in `app/models/abstract_assignment.rb`: a group's name before it is cut off,
    `LATE` does not count; the first two parts of digits, or the two behind `anon`, are user and attachment; that has to
    be an attachment of that user, and gives the name. Attachments: number -> user's number and name.
    """
    read = {}
    for path, file in _unpacked(content).items():
        name = PurePosixPath(path).name
        name = next(
            (name.removeprefix(f"{group}_") for group in groups if name.startswith(f"{group}_")),
            name,
        )
        parts = [part for part in name.split("_") if part != "LATE"]
        digits = [part for part in parts if re.fullmatch(r"\d+", part)][:2]
        user, attachment = (
            parts[1:3] if parts[0] == "anon" else (digits if len(digits) == 2 else ("", ""))
        )
        if not parts[-1].startswith("link") and attachments.get(attachment, ("", ""))[0] == user:
            read[user] = attachments[attachment][1], file
    return read


def _unpacked(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        return {
            info.filename: archive.read(info) for info in archive.infolist() if not info.is_dir()
        }
