"""Labs of other kinds than Lab 09-01: all points for the solution, expected losses for fixtures."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader.live.interfaces.build import lacking_toolchain, shipped_for
from tests.live.sample import ROOT, grade
from tests.thorough import EVERY_FIXTURE, part

pytestmark = pytest.mark.live

LABS = sorted(path.parent for path in (Path(__file__).parents[1] / "labs").glob("*/fixtures"))
#: Labs written from the documentation, complete in their folders, each with its solution and
#: fixtures; all would take eight minutes, so that each commit has a part of them, depending on its
#: hash.
WRITTEN = sorted(path.parent for path in (ROOT / "labs").glob("*/rubric.yaml"))


def submissions() -> list[tuple[Path, str]]:
    """Return the solution and the fixtures of each written lab."""
    found = []
    for lab in WRITTEN:
        found.append((lab, "solution"))
        found += [(lab, path.name) for path in sorted(lab.glob("fixtures/*"))]
    return found


SUBMISSIONS = submissions()
CHOSEN = part(SUBMISSIONS, 75, EVERY_FIXTURE)
#: Most gradings of one submission, each with the repetitions of a grading.
MOST_GRADINGS = 2


def skip_unless_built(lab: Path) -> None:
    """Skip a lab with interfaces that cannot be built here."""
    rubric = (lab / "rubric.yaml").read_text(encoding="utf-8")
    is_built = (lab / "interfaces").is_dir() or shipped_for([rubric])
    if is_built and (lacking := lacking_toolchain()):
        pytest.skip(f"not here: {lacking}")


@pytest.mark.parametrize("lab", WRITTEN, ids=lambda path: path.name)
def test_a_lab_is_complete_in_its_folder(lab: Path, tmp_path: Path) -> None:
    """`grade lab check` finds no mistake in a copy that lies elsewhere."""
    shutil.copytree(lab, tmp_path / "lab")
    run = grade("lab", "check", tmp_path / "lab", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize(
    ("lab", "name"), CHOSEN, ids=[f"{lab.name} {name}" for lab, name in CHOSEN]
)
def test_a_written_lab_gets_its_verdicts(lab: Path, name: str, tmp_path: Path) -> None:
    """A solution has all points, and a fixture loses the expected ones.

    A submission that other work on the machine left undecided is graded again.
    """
    skip_unless_built(lab)
    for _ in range(MOST_GRADINGS):
        run = grade("selftest", "--rubric", lab / "rubric.yaml", "--jobs", "1", name, cwd=tmp_path)
        if "1 undecided: " not in run.stdout:
            break
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("lab", part(LABS, 3, EVERY_FIXTURE), ids=lambda path: path.name)
def test_a_lab_gets_its_verdicts(lab: Path, tmp_path: Path) -> None:
    """`grade selftest` confirms a lab's verdicts, with repetitions of undecided sessions."""
    skip_unless_built(lab)
    run = grade("selftest", "--rubric", lab / "rubric.yaml", "--jobs", "2", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
