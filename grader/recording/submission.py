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
    """A person, from the download of a learning-management system or a class list; a fact that neither has is empty.

    All facts are texts as they were written there; leading zeros are part of an id.
    """

    name: str = ""
    #: The university's id: Moodle's ID number, Canvas' SIS User ID, Brightspace's OrgDefinedId.
    student_id: str = ""
    login: str = ""
    email: str = ""
    section: str = ""
    #: The systems' own numbers: Moodle's of a participant in one assignment, Canvas' of a user.
    moodle: str = ""
    canvas: str = ""
    #: Tag of the language of mails and reports, such as `de`.
    language: str = ""

    def completed(self, other: Person) -> Person:
        """Return these facts, with those of another record of the person where these are empty."""
        facts = vars(self).copy()
        for fact, text in vars(other).items():
            if not facts[fact]:
                facts[fact] = text
        return Person(**facts)

    @property
    def names(self) -> tuple[str, ...]:
        """All names and numbers that can identify something as handed in by the person."""
        names = [self.name, self.student_id, self.login, self.email]
        if self.moodle:
            names.append(f"moodle {self.moodle}")
        if self.canvas:
            names.append(f"canvas {self.canvas}")
        return tuple(names)


@dataclass(frozen=True)
class Identity:
    """The people that handed a submission in, and the way of a report back to them."""

    #: Several if they handed it in together.
    people: tuple[Person, ...] = ()
    #: Learning-management system of the download.
    system: str = ""
    #: Paths in an archive at which that system takes something back for it; see `Delivered.handback`.
    handback: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a single person; none of several, because no name of one stands for all."""
        if len(self.people) == 1:
            return self.people[0].names
        return ()

    def completed(self, other: Identity) -> Identity:
        """Return this identity, with the facts of another one of the same submission where this one has none."""
        people = self.people or other.people
        for first in other.people[:1]:
            people = (people[0].completed(first), *people[1:])
        system = self.system or other.system
        handback = self.handback or other.handback
        return Identity(people, system, handback)


@dataclass
class FileFact:
    """One file of the submission, by its path relative to the root."""

    path: str
    size_bytes: int
    sha256: str


@dataclass
class ArtifactFact:
    """The file of the submission that stands for an artifact of the rubric."""

    name: str
    #: The file name that the lab asks for.
    expected: str
    #: Relative path; None if no file was found.
    path: str | None = None
    #: "name" (as asked for), "near miss" (a similar name) or "missing".
    found_by: str = "missing"
    #: Other files that could have been meant.
    candidates: list[str] = field(default_factory=list)
    #: Other files of its name that were not taken.
    passed_over: list[str] = field(default_factory=list)
    #: The reason why the file was preferred to them.
    why: str = ""
    #: True if no fact speaks for the file rather than for the others.
    is_open: bool = False
    #: True if only the bonus needs it.
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
    #: Files that its build installs below `share/`: path below the prefix -> file's path; None if they are not known.
    shared: dict[str, str] | None = None
    #: Mistakes that make `colcon build` fail, or leave a file out.
    problems: list[str] = field(default_factory=list)


@dataclass
class BuildFact:
    """The outcome of `colcon build` for a package of the submission."""

    package: str
    #: Folder of its package.xml, relative to the root; "" for the root itself.
    path: str
    #: "built", "failed", "ignored" (colcon did not find it) or "not built" (through no fault of the submission).
    outcome: str
    #: Why it was not built; empty for each other outcome.
    reason: str = ""
    #: Words of colcon, setuptools and CMake; beginning and end of a long output.
    output: str = ""
    #: Installed files below the package's own prefix.
    installed: list[str] = field(default_factory=list)
    #: Installed executables that the system cannot start, because they have no `#!` line.
    without_interpreter: list[str] = field(default_factory=list)
    #: Installed scripts that `ros2 run` does not find, because their mode forbids to execute them.
    not_executable: list[str] = field(default_factory=list)


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
    #: Texts that the lab gave to all students, by their paths; empty in recordings of earlier versions.
    given_texts: dict[str, str] = field(default_factory=dict)
    #: The sessions that were asked for; None for all of the rubric's.
    sessions: list[str] | None = None
    #: When it was handed in, as ISO 8601, without offset from UTC if its source names none; None if nothing tells.
    submitted_at: str | None = None
    #: The source of this time, in words; empty in recordings of earlier versions.
    time_source: str = ""
    #: The time of the newest file in the archive, in the same form; it proves nothing.
    newest_file: str | None = None
    #: The time of the last commit in the repository, in the same form; it proves nothing.
    last_commit: str | None = None
    #: The learning-management system that marks the submission as late; empty for none.
    marked_late_by: str = ""
    #: The student's id in a grade book, if a learning-management system or a class list has it.
    student_id: str | None = None
    identity: Identity = field(default_factory=Identity)
    #: The path at which it was found; empty if it is not known.
    source: str = ""
    #: Modules that the submission may import, and that are missing in its programs' environment; None if the
    #: grader did not look.
    absent_modules: list[str] | None = None
    #: Packages of interfaces that were not built here, through no fault of the submission -> reason; None if
    #: none were built.
    not_built: dict[str, str] | None = None
    #: Builds of the packages; None if the grader did not build, as on machines without colcon.
    builds: list[BuildFact] | None = None
    #: The lab of the recording: its id and hash (`grader.lab.kept_lab.identity_of`), and its folder.
    lab_id: str = ""
    lab_sha256: str = ""
    lab_folder: str = ""
    #: Files that the rubric names -> their hashes.
    lab_files: dict[str, str] = field(default_factory=dict)

    def build_of(self, package: PackageFact) -> BuildFact | None:
        """Return the build of a package, or None if the grader did not build it."""
        if self.builds is None:
            return None
        for build in self.builds:
            if build.path == package.path:
                return build
        return None

    def artifact(self, name: str) -> ArtifactFact | None:
        """Return the artifact with a name, or None if the rubric has no such artifact."""
        for artifact in self.artifacts:
            if artifact.name == name:
                return artifact
        return None


def write_submission(folder: Path, record: SubmissionRecord) -> None:
    """Write `submission.json`."""
    write_record(folder / SUBMISSION_FILE, record)


def read_submission(folder: Path) -> SubmissionRecord:
    """Read `submission.json`; raises as `read_record` does."""
    return read_record(folder / SUBMISSION_FILE, SubmissionRecord, SUBMISSION_SCHEMA)
