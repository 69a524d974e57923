"""The autograder of Classroom 50: grades the checkout that is the working folder, and writes `result.json`.

Copy it to `CLASSROOM/autograders/ASSIGNMENT/autograder.py` in the classroom's repository, and name the grader's
repository below. Its exit status is 0 if the submission was graded, whatever the score; any other tells Classroom 50
that grading did not work. `release-body.md` tells the student the reason for each lost point, and `report.html` can
be attached to the release (`release_assets`).
"""

from __future__ import annotations

import os
import sys

# The working folder is a submission: no module is imported from there, nor from beside this file if that lies there.
sys.path[:] = [p for p in sys.path if os.path.realpath(p) != os.getcwd()]  # noqa: PTH109

import shutil  # noqa: E402
import subprocess  # noqa: E402
import tempfile  # noqa: E402
from pathlib import Path  # noqa: E402

GRADER_URL = "https://git.example.edu/robotics/grade.git"
GRADER_REF = "v1"
GRADE = Path(os.environ.get("GRADE", "/opt/grade/bin/grade"))
#: More options for `grade`, separated by blanks.
OPTIONS = os.environ.get("GRADE_OPTIONS", "").split()
#: GitHub takes no longer text for a release.
MOST_RELEASE_BYTES = 120_000


def as_root(*command: str | Path) -> list[str]:
    """Return a command as root runs it: only then has the student's code a user id of its own."""
    return [*(["sudo", "--"] if os.geteuid() else []), *map(str, command)]


def install() -> None:
    """Install the grader, where it is not there yet."""
    if GRADE.exists():
        return
    source = Path(tempfile.mkdtemp(prefix="grade-source-"))
    subprocess.run(
        ["git", "clone", "--quiet", "--depth=1", f"--branch={GRADER_REF}", GRADER_URL, str(source)],
        check=True,
        cwd="/",  # Git also reads the configuration of a repository in which it is called.
    )
    subprocess.run(["bash", str(source / "ci/install.sh"), str(source)], check=True, cwd="/")


def grade(results: Path) -> int:
    """Grade the working folder; returns the exit status."""
    command = as_root(
        GRADE, ".", "--one", "--output", results, "--require-isolation", "no-cgroup", *OPTIONS
    )
    status = subprocess.run(command, check=False).returncode
    subprocess.run(as_root("chown", "-R", f"{os.getuid()}:{os.getgid()}", results), check=True)
    return status


def hand_over(folder: Path) -> None:
    """Write what Classroom 50 reads into the working folder, through no link that the submission has laid out there."""
    subprocess.run(
        [GRADE, "export", folder, "--to", "classroom50=result.json", "--to", "github-summary"],
        check=True,
    )
    place(folder / "report.html", Path("report.html"))
    if (folder / "summary.md").stat().st_size <= MOST_RELEASE_BYTES:
        place(folder / "summary.md", Path("release-body.md"))


def place(source: Path, target: Path) -> None:
    """Copy a file to where nothing is left of what had the name; the grade does not depend on it."""
    try:
        target.unlink(missing_ok=True)
        shutil.copyfile(source, target)
    except OSError as error:
        print(f"{target} was not written: {error.strerror}", file=sys.stderr)


def main() -> int:
    """Install, grade, hand over; returns the exit status."""
    install()
    results = Path(tempfile.mkdtemp(prefix="grade-results-"))
    status = grade(results)
    found = list(results.glob("*/result.json"))
    if not found:
        print("::error::The submission could not be graded; the log says why.", file=sys.stderr)
        return status or 1
    hand_over(found[0].parent)
    shutil.rmtree(results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
