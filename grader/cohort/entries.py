"""The entries of a class: one per student, each with a finished result or the reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from grader.errors import RecordingError
from grader.files import text_of
from grader.lab.policy import Policy, SubmissionTime
from grader.recording.submission import Identity, Person, read_submission
from grader.result import Result, load_result, result_of_text
from grader.result_folder import EARLIER_FILE, RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.submission.roster import Match, Student, matches, person_of
from grader.submission.submission_time import submission_time_of

NOTHING_SUBMITTED = (
    "There is no result under this name: nothing was handed in, or under another name."
)


@dataclass(frozen=True)
class ClassEntry:
    """One student of a class."""

    #: Name of the submission; written by students, and therefore untrusted.
    name: str
    #: None if the submission was not graded, or its result is not of this version.
    result: Result | None
    #: Reason why it was not graded.
    problem: str = ""
    #: Link to the report, relative to the class page; empty if there is none.
    report: str = ""
    #: Time of submission, if known; without offset from UTC if its source names none.
    submitted_at: datetime | None = None
    #: Id of the student in a grade book.
    student_id: str | None = None
    identity: Identity = field(default_factory=Identity)
    #: Result of the previous submission, or of another run, for comparison.
    before: Result | None = None
    #: The source of the time of submission, in words.
    time_source: str = ""
    #: The time of the newest file in the archive.
    newest_file: datetime | None = None
    #: The time of the last commit in the repository.
    last_commit: datetime | None = None
    #: The learning-management system that marks the submission as late; empty for none.
    marked_late_by: str = ""

    @property
    def submission_time(self) -> SubmissionTime:
        """When it was handed in, and how that is known."""
        return SubmissionTime(
            self.submitted_at,
            self.time_source,
            self.newest_file,
            self.last_commit,
            self.marked_late_by,
        )

    @property
    def people(self) -> tuple[Person, ...]:
        """Authors of the submission; if unknown, one person with the submission's name."""
        return self.identity.people or (Person(self.name, self.student_id or ""),)


# -- a folder of results -----------------------------------------------------------------------


def entries_in(results: Path) -> list[ClassEntry]:
    """Read the finished results `*/result.json` of a folder, in the order of their names.

    Folders in it without any part of a result are skipped.
    """
    if not results.is_dir():
        return []
    entries = []
    for path in sorted(results.iterdir()):
        if _holds_result(path):
            entries.append(entry_in(path))
    return entries


def _holds_result(path: Path) -> bool:
    """Return whether a path is a folder with at least a part of a result."""
    if path.name.startswith(".") or not path.is_dir():
        return False
    return any((path / part).exists() for part in (RESULT_FILE, REPORT_FILE, RECORDINGS))


def report_link(name: str) -> str:
    """Return the link from the class page to a submission's report, such as `alice/report.html`."""
    return f"{quote(name, safe='', errors='surrogateescape')}/{REPORT_FILE}"


def entry_in(folder: Path) -> ClassEntry:
    """Read the finished result of one submission."""
    report = ""
    if (folder / REPORT_FILE).is_file():
        report = report_link(folder.name)
    try:
        result = load_result(folder / RESULT_FILE)
    except FileNotFoundError:
        problem = "There is no result; the grading was interrupted."
        return ClassEntry(folder.name, None, problem, report)
    except RecordingError:
        problem = f"Its {RESULT_FILE} cannot be read, or is of another version; `grade regrade` writes it again."
        return ClassEntry(folder.name, None, problem, report)
    entry = ClassEntry(folder.name, result, "", report)
    return _with_record(entry, folder / RECORDINGS)


def _with_record(entry: ClassEntry, recordings: Path) -> ClassEntry:
    """Return an entry with the facts that were recorded with its submission, if they can be read."""
    try:
        record = read_submission(recordings)
    except (OSError, ValueError):
        return entry
    submission_time = submission_time_of(record)
    return replace(
        entry,
        submitted_at=submission_time.at,
        student_id=record.student_id,
        identity=record.identity,
        before=result_of_text(text_of(recordings / EARLIER_FILE)),
        time_source=submission_time.source,
        newest_file=submission_time.newest_file,
        last_commit=submission_time.last_commit,
        marked_late_by=submission_time.marked_late_by,
    )


def in_zone(entries: Sequence[ClassEntry], policy: Policy) -> list[ClassEntry]:
    """Return the entries, with the zone of a policy in times without one."""
    zoned = []
    for entry in entries:
        submission_time = policy.zoned(entry.submission_time)
        zoned.append(replace(entry, submitted_at=submission_time.at))
    return zoned


# -- other results, and a list of the class ----------------------------------------------------


def compared_with(entries: Sequence[ClassEntry], earlier: Sequence[ClassEntry]) -> list[ClassEntry]:
    """Return the entries with the results of another run, found by ids or else by names."""
    by_id = {entry.student_id: entry.result for entry in earlier if entry.student_id}
    by_name = {entry.name: entry.result for entry in earlier}
    compared = []
    for entry in entries:
        before = by_id.get(entry.student_id or "")
        if not before:
            before = by_name.get(entry.name)
        compared.append(replace(entry, before=before))
    return compared


def with_roster(entries: Sequence[ClassEntry], students: Sequence[Student]) -> list[ClassEntry]:
    """Return the entries with further facts from a list of students, by name.

    Each student of the list without a submission gets an entry, too.
    """
    found = _matches(entries, students)
    completed = {}
    submitted: list[Person] = []
    for entry, match in zip(entries, found, strict=True):
        completed[entry.name] = _completed(entry, match)
        submitted += match.people
    for student in students:
        if person_of(student) not in submitted:
            missing = _without_submission(student)
            completed.setdefault(missing.name, missing)
    return sorted(completed.values(), key=lambda entry: entry.name)


def _matches(entries: Sequence[ClassEntry], students: Sequence[Student]) -> list[Match]:
    """Return the match of each entry in a list of students."""
    wanted = []
    for entry in entries:
        source = entry.time_source
        own = Student(entry.name, entry.student_id, entry.submitted_at, time_source=source)
        wanted.append((own, (_without_id(entry), *entry.identity.names)))
    return matches(students, wanted)


def _completed(entry: ClassEntry, match: Match) -> ClassEntry:
    return replace(
        entry,
        student_id=match.student_id,
        submitted_at=match.submitted_at,
        time_source=match.time_source,
        identity=match.completed(entry.identity),
    )


def _without_submission(student: Student) -> ClassEntry:
    """Return the entry of a student without a submission."""
    name = student.name or student.student_id or student.person.login
    return ClassEntry(
        name,
        None,
        NOTHING_SUBMITTED,
        submitted_at=student.submitted_at,
        student_id=student.student_id,
        time_source=student.time_source,
    )


def _without_id(entry: ClassEntry) -> str:
    """Return the student's name from a submission's name that ends with the id, such as `Alice Liddell_1234`.

    It is empty if there is no id.
    """
    if not entry.student_id:
        return ""
    return entry.name.removesuffix(f"_{entry.student_id}")
