"""`--ros`: students' programs on another installation of ROS 2 earn the same points."""

from __future__ import annotations

import json
import subprocess
import venv
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from tests.launch_plan.evaluations import ORIGINAL, needs_the_original
from tests.live.imitated_prefix import add_launch, imitate, replace_library, system_python
from tests.live.sample import ROOT, grade
from tests.thorough import THOROUGH, part

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(system_python() is None, reason="the system has another Python than grade"),
]
#: NumPy of ROS 2 Jazzy.
NUMPY = "numpy==1.26.4"
KILTED = ("ros-kilted-rclpy[fastrtps]", "ros-kilted-common-interfaces", "numpy", "scipy")
#: Evaluators of launch files: an installation's own, and the stand-in without one. Each commit tries one.
LAUNCHES = (pytest.param("native", marks=needs_the_original), "stand-in")


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """Give a prefix that imitates /opt/ros/jazzy."""
    return imitate(tmp_path / "opt/ros/jazzy")


def with_numpy_of_jazzy(prefix: Path) -> None:
    """Give a prefix Jazzy's version of NumPy; skip the test without a package index."""
    reason = replace_library(prefix, NUMPY)
    if reason:
        pytest.skip(f"{NUMPY} cannot be installed: {reason}")


def graded(prefix: Path, folder: Path) -> dict[str, Any]:
    """Grade the solution with students' programs on an installation; all points not undecided are earned."""
    run = grade(ROOT / "reference/solution", "--ros", prefix, cwd=folder)
    assert run.returncode == 0, run.stderr
    text = (folder / "results/solution/result.json").read_text(encoding="utf-8")
    result: dict[str, Any] = json.loads(text)
    score = result["score"]
    assert score["earned"] + score["undecided"] == 100
    assert score["earned"] > 80
    versions: dict[str, Any] = result["provenance"]["versions"]
    return versions


@pytest.mark.parametrize("launch", part(LAUNCHES, of=2))
def test_the_solution_loses_nothing_on_an_installation(
    launch: Any, prefix: Path, tmp_path: Path
) -> None:
    """The system's Python, the modules of the prefix, its NumPy, and its launch or the stand-in take part."""
    if launch == "native":
        add_launch(prefix, ORIGINAL)
    with_numpy_of_jazzy(prefix)
    versions = graded(prefix, tmp_path)
    assert versions["launch"] == launch
    assert versions["students' ROS"].endswith(f" in {prefix}")


def test_the_examination_accepts_an_installation(prefix: Path, tmp_path: Path) -> None:
    """The last step of Dockerfile.ros names version, interpreter and packages; machines differ in all other lines."""
    said = grade("doctor", "--ros", prefix, cwd=tmp_path).stdout
    lines = [line for line in said.split("\n") if line.startswith("PASS    ROS 2")]
    assert len(lines) == 3, said
    assert all(line.startswith("PASS") for line in lines), said
    assert f"Jazzy (rclpy 7.1.5) in {prefix}, for {system_python()}" in lines[0]
    assert "rclpy can be imported, with rmw_fastrtps_cpp" in lines[1]
    dockerfile = (ROOT / "Dockerfile.ros").read_text(encoding="utf-8")
    assert "RUN grade doctor --ros /opt/ros/jazzy" in dockerfile
    assert 'grep -q "rclpy can be imported"' in dockerfile


@pytest.mark.skipif(not THOROUGH, reason="`make course-ros` installs the wheels, for a minute")
def test_the_solution_loses_nothing_on_kilted(tmp_path: Path) -> None:
    """Students' nodes with Fast DDS 3 talk to the grader's with Fast DDS 2."""
    kilted = tmp_path / "kilted"
    venv.create(kilted, symlinks=True, with_pip=True)
    install = [str(kilted / "bin/python"), "-m", "pip", "install", "--quiet", *KILTED]
    done = subprocess.run(install, capture_output=True, text=True, check=False, timeout=900)
    if done.returncode:
        pytest.skip(f"the wheels cannot be had: {done.stderr.strip()[-200:]}")
    assert graded(kilted, tmp_path)["students' ROS"].startswith("Kilted")
