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
    """Where an artifact of the rubric was found.

    Attributes
    ----------
    path : str or None
        Relative path; None when nothing was found.
    expected : str
        The file name that the lab asks for.
    found_by : str
        "name" (as asked for), "near miss" (a similar name) or "missing".
    candidates : list of str
        Other files that could have been meant.
    """

    name: str
    expected: str
    path: str | None = None
    found_by: str = "missing"
    candidates: list[str] = field(default_factory=list)


@dataclass
class PackageFact:
    """A ROS package in the submission.

    Attributes
    ----------
    path : str
        Folder of its package.xml, relative to the root; "" for the root itself.
    executables : dict
        Executable name -> "module:function" or a file's path.
    shared : dict or None
        What is installed below `share/`: path below the prefix -> file's path; None if that is not known.
    problems : list of str
        What `colcon build` would stumble over, or not install.
    """

    name: str
    path: str
    build_type: str
    executables: dict[str, str] = field(default_factory=dict)
    shared: dict[str, str] | None = None
    problems: list[str] = field(default_factory=list)


@dataclass
class SubmissionRecord:
    """Static facts of one submission.

    Attributes
    ----------
    sessions : list of str or None
        The sessions that were asked for; None for all of the rubric's.
    submitted_at : str or None
        When it was handed in, as ISO 8601 with its offset from UTC; None where nobody knows.
    absent_modules : list of str or None
        Modules that the submission may import, and that the grader did not find where its programs run; None where
        it did not look.
    student_id : str or None
        By which a grade book knows the student, where a learning-management system or a class list told it.
    source : str
        The path that it was found by; empty where nobody knows.
    lab_folder : str
        Where the lab was by which it was recorded.
    lab_files : dict
        Files that the rubric names -> their hashes.
    """

    name: str
    schema: str = SUBMISSION_SCHEMA
    sha256: str = ""
    files: list[FileFact] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    artifacts: list[ArtifactFact] = field(default_factory=list)
    packages: list[PackageFact] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    sessions: list[str] | None = None
    submitted_at: str | None = None
    student_id: str | None = None
    source: str = ""
    absent_modules: list[str] | None = None
    lab_folder: str = ""
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
