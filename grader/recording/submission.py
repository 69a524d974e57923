"""`submission.json`: the static facts of a submission, kept beside the recorded sessions.

It holds the texts that the judging half parses, so that regrading needs neither the submission nor ROS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from grader.recording.record import read_record, write_record

SUBMISSION_SCHEMA = "ros-lab-grader/submission/v1"
SUBMISSION_FILE = "submission.json"


@dataclass(frozen=True)
class Person:
    """A person, as the download of a learning-management system or a class list knows them; empty where neither does.

    All are texts as they were written there: the zeros that an id begins with are part of it.
    """

    name: str = ""
    #: By which the university knows them: Moodle's ID number, Canvas' SIS User ID, Brightspace's OrgDefinedId.
    student_id: str = ""
    login: str = ""
    email: str = ""
    section: str = ""
    #: The systems' own numbers: Moodle's of a participant in one assignment, Canvas' of a user.
    moodle: str = ""
    canvas: str = ""

    def completed(self, other: Person) -> Person:
        """Return what this one knows, and where it is empty the other."""
        return Person(**{fact: text or getattr(other, fact) for fact, text in vars(self).items()})

    @property
    def names(self) -> tuple[str, ...]:
        """All by which something that was handed in can be known to be theirs."""
        numbers = (
            f"{system} {n}" for system, n in (("moodle", self.moodle), ("canvas", self.canvas)) if n
        )
        return (self.name, self.student_id, self.login, self.email, *numbers)


@dataclass(frozen=True)
class Identity:
    """Who handed a submission in, and how a report gets back to them."""

    #: Several if they handed it in together.
    people: tuple[Person, ...] = ()
    #: Of which learning-management system the download was.
    system: str = ""
    #: Under which paths in an archive that system takes something back for it; see `Delivered.handback`.
    handback: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the one who handed it in; none of several, of whom no name tells for all."""
        return self.people[0].names if len(self.people) == 1 else ()

    def completed(self, other: Identity) -> Identity:
        """Return what this one knows, and where it knows less what another one of the same submission does."""
        people = self.people or other.people
        if self.people and other.people:
            people = (people[0].completed(other.people[0]), *people[1:])
        return Identity(people, self.system or other.system, self.handback or other.handback)


@dataclass
class FileFact:
    """One file of the submission, by its path relative to the root."""

    path: str
    size_bytes: int
    sha256: str


@dataclass
class ArtifactFact:
    """Where an artifact of the rubric was found."""

    name: str
    #: The file name that the lab asks for.
    expected: str
    #: Relative path; None when nothing was found.
    path: str | None = None
    #: "name" (as asked for), "near miss" (a similar name) or "missing".
    found_by: str = "missing"
    #: Other files that could have been meant.
    candidates: list[str] = field(default_factory=list)
    #: Other files of its name that were not taken, why not, and whether nothing told them from the one that was.
    passed_over: list[str] = field(default_factory=list)
    why: str = ""
    is_open: bool = False
    #: Whether nothing but the bonus is about it.
    bonus: bool = False


@dataclass
class PackageFact:
    """A ROS package in the submission."""

    name: str
    #: Folder of its package.xml, relative to the root; "" for the root itself.
    path: str
    build_type: str
    #: Executable name -> "module:function" or a file's path.
    executables: dict[str, str] = field(default_factory=dict)
    #: What is installed below `share/`: path below the prefix -> file's path; None if that is not known.
    shared: dict[str, str] | None = None
    #: What `colcon build` would stumble over, or not install.
    problems: list[str] = field(default_factory=list)


@dataclass
class SubmissionRecord:
    """Static facts of one submission."""

    name: str
    schema: str = SUBMISSION_SCHEMA
    sha256: str = ""
    files: list[FileFact] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    artifacts: list[ArtifactFact] = field(default_factory=list)
    packages: list[PackageFact] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    #: The sessions that were asked for; None for all of the rubric's.
    sessions: list[str] | None = None
    #: When it was handed in, as ISO 8601, without offset from UTC if its source names none; None if nothing tells.
    submitted_at: str | None = None
    #: The source of this time, in words; empty in recordings of earlier versions.
    time_source: str = ""
    #: The time of the newest file in the archive, in the same form; it proves nothing.
    newest_file: str | None = None
    #: By which a grade book knows the student, where a learning-management system or a class list told it.
    student_id: str | None = None
    identity: Identity = field(default_factory=Identity)
    #: The path that it was found by; empty where nobody knows.
    source: str = ""
    #: Modules that the submission may import, and that the grader did not find where its programs run; None
    #: where it did not look.
    absent_modules: list[str] | None = None
    #: Packages of interfaces that were not built where its programs run, through no fault of its own -> why; None
    #: where none were built.
    not_built: dict[str, str] | None = None
    #: The lab by which it was recorded: its id and hash (`grader.lab.kept_lab.identity_of`), and where it was.
    lab_id: str = ""
    lab_sha256: str = ""
    lab_folder: str = ""
    #: Files that the rubric names -> their hashes.
    lab_files: dict[str, str] = field(default_factory=dict)

    def artifact(self, name: str) -> ArtifactFact | None:
        """Return the artifact of this name, or None if the rubric has none such."""
        return next((a for a in self.artifacts if a.name == name), None)


def write_submission(folder: Path, record: SubmissionRecord) -> None:
    """Write `submission.json`."""
    write_record(folder / SUBMISSION_FILE, record)


def read_submission(folder: Path) -> SubmissionRecord:
    """Read `submission.json`; `read_record` says what it raises."""
    return read_record(folder / SUBMISSION_FILE, SubmissionRecord, SUBMISSION_SCHEMA)
