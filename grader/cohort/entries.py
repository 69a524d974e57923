"""What a class consists of: one entry a student, each with a finished result or the reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from grader.errors import RecordingError
from grader.files import text_of
from grader.lab.overrides import moment_of
from grader.recording.submission import read_submission
from grader.result import Result, load_result, result_of_text
from grader.result_folder import EARLIER_FILE, RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.submission.roster import Student, matches

NOTHING_SUBMITTED = "There is no result under this name: nothing was handed in, or under another name."


@dataclass(frozen=True)
class ClassEntry:
    """One student of a class."""

    #: Name of the submission; written by students, so not to be trusted.
    name: str
    #: None if the submission was not graded, or its result is not of this version.
    result: Result | None
    #: Why it was not graded.
    problem: str = ""
    #: Link to the report, relative to the class page; empty if there is none.
    report: str = ""
    #: When it was handed in, with its offset from UTC, where that is known.
    submitted_at: datetime | None = None
    #: By which a grade book knows the student.
    student_id: str | None = None
    #: The result of what was handed in before, or of another run, that this one is compared with.
    before: Result | None = None


def entries_in(results: Path) -> list[ClassEntry]:
    """Read the finished results `*/result.json` of a folder, in the order of their names.

    Folders in it that hold no part of a result are passed over.
    """
    if not results.is_dir():
        return []
    folders = sorted(path for path in results.iterdir() if path.is_dir() and not path.name.startswith("."))
    parts = (RESULT_FILE, REPORT_FILE, RECORDINGS)
    return [_entry(folder) for folder in folders if any((folder / part).exists() for part in parts)]


def report_link(name: str) -> str:
    """Return the link from the class page to a submission's report."""
    return f"{quote(name, safe='', errors='surrogateescape')}/{REPORT_FILE}"


def _entry(folder: Path) -> ClassEntry:
    report = report_link(folder.name) if (folder / REPORT_FILE).is_file() else ""
    try:
        result = load_result(folder / RESULT_FILE)
    except FileNotFoundError:
        return ClassEntry(folder.name, None, "There is no result; the grading was interrupted.", report)
    except RecordingError:
        problem = f"Its {RESULT_FILE} cannot be read, or is of another version; `grade regrade` writes it again."
        return ClassEntry(folder.name, None, problem, report)
    try:
        record = read_submission(folder / RECORDINGS)
    except (OSError, ValueError):
        return ClassEntry(folder.name, result, "", report)
    before = result_of_text(text_of(folder / RECORDINGS / EARLIER_FILE))
    return ClassEntry(folder.name, result, "", report, moment_of(record.submitted_at), record.student_id, before)


def compared_with(entries: Sequence[ClassEntry], earlier: Sequence[ClassEntry]) -> list[ClassEntry]:
    """Return the entries with the results of another run, which are found by their ids, or else their names."""
    by_id = {entry.student_id: entry.result for entry in earlier if entry.student_id}
    by_name = {entry.name: entry.result for entry in earlier}
    return [replace(e, before=by_id.get(e.student_id or "") or by_name.get(e.name)) for e in entries]


def with_roster(entries: Sequence[ClassEntry], students: Sequence[Student]) -> list[ClassEntry]:
    """Return the entries with what a list knows of them, and one for each student of it who has none, by name."""
    own = [(Student(entry.name, entry.student_id, entry.submitted_at), (_without_id(entry),)) for entry in entries]
    found = matches(students, own)
    completed = {
        entry.name: replace(entry, student_id=known.student_id, submitted_at=known.submitted_at)
        for entry, (known, _, _) in zip(entries, found, strict=True)
    }
    there = [students[index] for _, index, _ in found if index is not None]
    for student in (student for student in students if student not in there):
        name = student.name or student.student_id or ""
        missing = ClassEntry(name, None, NOTHING_SUBMITTED, "", student.submitted_at, student.student_id)
        completed.setdefault(name, missing)
    return sorted(completed.values(), key=lambda entry: entry.name)


def _without_id(entry: ClassEntry) -> str:
    """Return the student's name in a name that ends with the id, as of a download; empty if there is none."""
    return entry.name.removesuffix(f"_{entry.student_id}") if entry.student_id else ""
