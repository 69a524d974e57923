"""Compiled programs of a submission, which are not assessable here unless their package was built."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from grader.evidence.known_packages import package_meant_by
from grader.recording.submission import ArtifactFact, BuildFact, PackageFact, SubmissionRecord
from grader.submission.packages.compiled import compiled_programs, is_compiled_source

_MISSING = re.compile(
    r'package\s+configuration\s+file\s+provided\s+by\s+"([\w-]{1,100})"'
    r"|Could NOT find ([\w-]{1,100})"
)
#: Endings of launch files, which no compiler makes.
_LAUNCH = re.compile(r"launch\.(py|xml|ya?ml)$")


def missing_here(build: BuildFact) -> str:
    """Return the package that CMake did not find in a failed build; empty if it failed by another fault.

    A misspelt name of a package is a fault of the build files.
    """
    if build.outcome != "failed":
        return ""
    match = _MISSING.search(build.output)
    if match is None:
        return ""
    name = match[1] or match[2]
    if package_meant_by(name):
        return ""
    return name


def why_not_built(build: BuildFact | None) -> str:
    """Say why a package could not be built here; empty if it was built, or failed by its own fault."""
    if build is None:
        return "the grading computer lacks colcon or a sandbox for it"
    if build.outcome == "not built":
        return build.reason
    missing = missing_here(build)
    if missing:
        return f"the grading computer lacks the package {missing}"
    return ""


def unbuilt_programs(submission: SubmissionRecord) -> dict[str, PackageFact]:
    """Return the compiled executables of packages that could not be built here: name -> package."""
    found = {}
    for package in submission.packages:
        if not why_not_built(submission.build_of(package)):
            continue
        for name in compiled_programs(package, submission.texts):
            found[name] = package
    return found


def package_of(submission: SubmissionRecord, artifact: ArtifactFact) -> PackageFact | None:
    """Return the package that compiles an artifact's file; None for other files."""
    path = artifact.path or ""
    if not is_compiled_source(path):
        return None
    owners = []
    for package in submission.packages:
        if PurePosixPath(path).is_relative_to(package.path):
            owners.append(package)
    return max(owners, key=lambda package: len(package.path), default=None)


def not_assessable(submission: SubmissionRecord, package: PackageFact, program: str) -> str:
    """Say that a compiled program is not assessable here."""
    why = why_not_built(submission.build_of(package))
    return (
        f"{program} is compiled by the package {package.name}, which was not built: {why}. "
        "Your instructor decides."
    )


def unbuilt_program_for(submission: SubmissionRecord, expected: str) -> str:
    """Say that a missing Python program may be a compiled one; empty if no such program is in the submission.

    A compiled program with the name of another artifact stands for that artifact alone.

    Parameters
    ----------
    expected
        Name of the missing file, such as `talker.py`.
    """
    if not expected.endswith(".py") or _LAUNCH.search(expected):
        return ""
    programs = unbuilt_programs(submission)
    for artifact in submission.artifacts:
        if artifact.expected != expected:
            programs.pop(artifact.expected.removesuffix(".py"), None)
    if not programs:
        return ""
    wanted = expected.removesuffix(".py")
    name = wanted if wanted in programs else next(iter(programs))
    reason = not_assessable(submission, programs[name], name)
    return f"There is no {expected}, and {reason}"
