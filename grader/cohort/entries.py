"""What a class consists of: one entry a student, each with a finished result or the reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from grader.errors import RecordingError
from grader.files import text_of
from grader.lab.policy import HandedIn, Policy
from grader.recording.submission import Identity, Person, read_submission
from grader.result import Result, load_result, result_of_text
from grader.result_folder import EARLIER_FILE, RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.submission.handed_in import handed_in_of
from grader.submission.roster import Student, matches, person_of

NOTHING_SUBMITTED = (
    "There is no result under this name: nothing was handed in, or under another name."
)


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
    #: When it was handed in, if that is known; without offset from UTC if its source names none.
    submitted_at: datetime | None = None
    #: By which a grade book knows the student.
    student_id: str | None = None
    identity: Identity = field(default_factory=Identity)
    #: The result of what was handed in before, or of another run, that this one is compared with.
    before: Result | None = None
    #: The source of the time of submission, in words.
    time_source: str = ""
    #: The time of the newest file in the archive.
    newest_file: datetime | None = None

    @property
    def handed_in(self) -> HandedIn:
        """When it was handed in, and how that is known."""
        return HandedIn(self.submitted_at, self.time_source, self.newest_file)

    @property
    def people(self) -> tuple[Person, ...]:
        """Who handed it in; nothing but the submission's name where that is all that is known."""
        return self.identity.people or (Person(self.name, self.student_id or ""),)


def entries_in(results: Path) -> list[ClassEntry]:
    """Read the finished results `*/result.json` of a folder, in the order of their names.

    Folders in it that hold no part of a result are passed over.
    """
    if not results.is_dir():
        return []
    folders = sorted(
        path for path in results.iterdir() if path.is_dir() and not path.name.startswith(".")
    )
    parts = (RESULT_FILE, REPORT_FILE, RECORDINGS)
    return [
        entry_in(folder) for folder in folders if any((folder / part).exists() for part in parts)
    ]


def report_link(name: str) -> str:
    """Return the link from the class page to a submission's report."""
    return f"{quote(name, safe='', errors='surrogateescape')}/{REPORT_FILE}"


def entry_in(folder: Path) -> ClassEntry:
    """Read the finished result of one submission."""
    report = report_link(folder.name) if (folder / REPORT_FILE).is_file() else ""
    try:
        result = load_result(folder / RESULT_FILE)
    except FileNotFoundError:
        return ClassEntry(
            folder.name, None, "There is no result; the grading was interrupted.", report
        )
    except RecordingError:
        problem = f"Its {RESULT_FILE} cannot be read, or is of another version; `grade regrade` writes it again."
        return ClassEntry(folder.name, None, problem, report)
    try:
        record = read_submission(folder / RECORDINGS)
    except (OSError, ValueError):
        return ClassEntry(folder.name, result, "", report)
    handed_in = handed_in_of(record)
    return ClassEntry(
        folder.name,
        result,
        "",
        report,
        handed_in.at,
        record.student_id,
        record.identity,
        result_of_text(text_of(folder / RECORDINGS / EARLIER_FILE)),
        handed_in.source,
        handed_in.newest_file,
    )


def in_zone(entries: Sequence[ClassEntry], policy: Policy) -> list[ClassEntry]:
    """Return the entries with the zone that a policy names in times that have none."""
    return [replace(e, submitted_at=policy.zoned(e.handed_in).at) for e in entries]


def compared_with(entries: Sequence[ClassEntry], earlier: Sequence[ClassEntry]) -> list[ClassEntry]:
    """Return the entries with the results of another run, which are found by their ids, or else their names."""
    by_id = {entry.student_id: entry.result for entry in earlier if entry.student_id}
    by_name = {entry.name: entry.result for entry in earlier}
    return [
        replace(e, before=by_id.get(e.student_id or "") or by_name.get(e.name)) for e in entries
    ]


def with_roster(entries: Sequence[ClassEntry], students: Sequence[Student]) -> list[ClassEntry]:
    """Return the entries with what a list knows of them, and one for each student of it who has none, by name."""
    own = [
        Student(entry.name, entry.student_id, entry.submitted_at, time_source=entry.time_source)
        for entry in entries
    ]
    others = [(_without_id(entry), *entry.identity.names) for entry in entries]
    found = matches(students, list(zip(own, others, strict=True)))
    completed = {
        entry.name: replace(
            entry,
            student_id=match.student_id,
            submitted_at=match.submitted_at,
            time_source=match.time_source,
            identity=match.completed(entry.identity),
        )
        for entry, match in zip(entries, found, strict=True)
    }
    there = [person for match in found for person in match.people]
    for student in (student for student in students if person_of(student) not in there):
        name = student.name or student.student_id or student.person.login
        missing = ClassEntry(
            name,
            None,
            NOTHING_SUBMITTED,
            "",
            student.submitted_at,
            student.student_id,
            time_source=student.time_source,
        )
        completed.setdefault(name, missing)
    return sorted(completed.values(), key=lambda entry: entry.name)


def _without_id(entry: ClassEntry) -> str:
    """Return the student's name in a name that ends with the id, as of a download; empty if there is none."""
    return entry.name.removesuffix(f"_{entry.student_id}") if entry.student_id else ""
