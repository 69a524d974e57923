"""`submission.json`: the static facts of a submission, kept beside the recorded sessions.

It holds the texts that the judging half parses (sources, README, package manifests), so that
regrading needs neither the submission nor ROS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from grader.recording.record import read_record, write_record

SUBMISSION_SCHEMA = "ros-lab-grader/submission/v1"
SUBMISSION_FILE = "submission.json"


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
    #: When it was handed in, as ISO 8601 with its offset from UTC; None where nobody knows.
    submitted_at: str | None = None
    #: By which a grade book knows the student, where a learning-management system or a class list told it.
    student_id: str | None = None
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
