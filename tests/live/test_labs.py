"""Labs of other kinds than Lab 09-01: their solution has all points, and each fixture loses what it should."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader.live.interfaces.build import lacking_toolchain
from tests.live.sample import ROOT, grade
from tests.thorough import part

pytestmark = pytest.mark.live

LABS = sorted(path.parent for path in (Path(__file__).parents[1] / "labs").glob("*/fixtures"))
#: Types that the wheels of ROS lack, and which are built.
BUILT = "tf2_msgs/"
#: The labs that are shipped, each with its solution and its fixtures, of which every commit tries a tenth.
SHIPPED = [
    (lab.parent, name)
    for lab in sorted(ROOT.glob("labs/*/rubric.yaml"))
    for name in ("solution", *sorted(path.parent.name for path in lab.parent.glob("fixtures/*/expected.yaml")))
]
ALL = os.environ.get("FIXTURES", "") == "all"


def try_lab(lab: Path, *names: str, cwd: Path) -> None:
    """Compare as `grade selftest` does, which repeats what the machine left undecided."""
    if BUILT in (lab / "rubric.yaml").read_text(encoding="utf-8") and (lacking := lacking_toolchain()):
        pytest.skip(f"not here: {lacking}")
    run = grade("selftest", "--lab", lab, "--jobs", "2", *names, cwd=cwd)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("lab", LABS, ids=lambda path: path.name)
def test_a_lab_gets_its_verdicts(lab: Path, tmp_path: Path) -> None:
    """A small one gets all of them."""
    try_lab(lab, cwd=tmp_path)


@pytest.mark.parametrize(("lab", "name"), part(SHIPPED, 10, ALL), ids=lambda value: getattr(value, "name", value))
def test_a_shipped_lab_gets_a_verdict(lab: Path, name: str, tmp_path: Path) -> None:
    """Its solution, or one of its fixtures."""
    try_lab(lab, name, cwd=tmp_path)
