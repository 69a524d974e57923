"""Labs of other kinds than Lab 09-01: their solution has all points, and each fixture loses what it should."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader.live.interfaces.build import lacking_toolchain
from tests.live.sample import ROOT, grade
from tests.thorough import part

pytestmark = pytest.mark.live

LABS = sorted(path.parent for path in (Path(__file__).parents[1] / "labs").glob("*/fixtures"))
#: Those that were written from the documentation, complete in their folders, each with its solution and fixtures; all
#: would take eight minutes, so that each commit has a part of them, as its name has it.
WRITTEN = sorted(path.parent for path in (ROOT / "labs").glob("*/rubric.yaml"))
SUBMISSIONS = [
    (lab, name)
    for lab in WRITTEN
    for name in ("solution", *sorted(p.name for p in lab.glob("fixtures/*")))
]
CHOSEN = part(SUBMISSIONS, 25, os.environ.get("FIXTURES", "") == "all")
#: So often one is graded at most, each time with the repetitions of a grading.
MOST_GRADINGS = 2
#: Types that the wheels of ROS lack, and which are built.
BUILT = "tf2_msgs/"


def skip_unless_built(lab: Path) -> None:
    """Skip a lab whose interfaces cannot be built here."""
    built = (lab / "interfaces").is_dir() or BUILT in (lab / "rubric.yaml").read_text(
        encoding="utf-8"
    )
    if built and (lacking := lacking_toolchain()):
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
    """The solution has all points, a fixture loses what it should; what other work left undecided is graded again."""
    skip_unless_built(lab)
    for _ in range(MOST_GRADINGS):
        run = grade("selftest", "--rubric", lab / "rubric.yaml", "--jobs", "1", name, cwd=tmp_path)
        if "1 undecided: the machine was too busy" not in run.stdout:
            break
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("lab", LABS, ids=lambda path: path.name)
def test_a_lab_gets_its_verdicts(lab: Path, tmp_path: Path) -> None:
    """As `grade selftest` compares them, which repeats what the machine left undecided."""
    skip_unless_built(lab)
    run = grade("selftest", "--rubric", lab / "rubric.yaml", "--jobs", "2", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
