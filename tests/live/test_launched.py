"""What is mended of a launch file's workspace is within it, whatever the file says of itself."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from grader.live.launched import _mend_executable, _mend_package, _read_plan, own_folder, with_places
from grader.recording.plan import PLAN_SCHEMA, Plan
from grader.recording.session import ProcessRun

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Make a workspace with a package of one executable, beside a folder that is none of its."""
    for part in ("lib", "share"):
        (tmp_path / "ws/install" / part / "arm_lab").mkdir(parents=True)
    (tmp_path / "ws/install/lib/arm_lab/talk").write_text("x")
    index = tmp_path / "ws/install/share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "arm_lab").touch()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/talk").write_text("theirs")
    return tmp_path / "ws"


@pytest.mark.parametrize(
    "name", ["../../../outside", "..", ".", "", "/etc", "arm_lab/../../..", "a\0b", "x" * 300, "gone"]
)
def test_a_name_that_leads_elsewhere_is_no_package(workspace: Path, name: str) -> None:
    """Neither steps upwards nor whole paths are followed."""
    assert own_folder(workspace, "install", "lib", name) is None
    assert own_folder(workspace, "install", "lib", "arm_lab") == workspace / "install/lib/arm_lab"


@pytest.mark.parametrize("part", ["install", "install/lib", "install/lib/arm_lab"])
def test_links_are_not_followed(workspace: Path, part: str) -> None:
    """A folder that is a link is the work of the launch file, wherever it leads."""
    (workspace / part).rename(workspace / "moved")
    (workspace / part).symlink_to(workspace / "moved")
    assert own_folder(workspace, "install", "lib", "arm_lab") is None
    assert not _mend_package(workspace, "arm_lap")


def test_an_executable_is_installed_under_the_name_that_was_used(workspace: Path) -> None:
    """The nearest one is copied, neither from a link nor onto one."""
    folder = workspace / "install/lib/arm_lab"
    (folder / "talkk").symlink_to(workspace.parent / "outside/talk")
    (folder / "talky").symlink_to(workspace.parent / "outside/made")
    assert _mend_executable(folder, "talks")
    assert (folder / "talks").read_text() == "x"
    assert not _mend_executable(folder, "talky")
    assert not (workspace.parent / "outside/made").exists()


def test_a_package_is_installed_under_the_name_that_was_used(workspace: Path) -> None:
    """Its files are copied, links as links."""
    (workspace / "install/share/arm_lab/link").symlink_to(workspace.parent / "outside/talk")
    assert _mend_package(workspace, "arm_lap")
    assert (workspace / "install/lib/arm_lap/talk").is_file()
    assert (workspace / "install/share/arm_lap/link").is_symlink()


def test_what_is_kept_of_a_plan_is_a_plan() -> None:
    """A number that JSON has not is a level deeper when it is kept; what would be too deep then is no description."""
    for depth, kind in ((50, None), (56, "no_plan")):
        value: object = float("nan")
        for _ in range(depth):
            value = {"a": value}
        plain = {"schema": PLAN_SCHEMA, "outcome": "ok", "processes": [{"id": "a-1", "path": "a", "output": value}]}
        plan = _read_plan(
            json.dumps(plain), in_time=True, timeout_s=1.0, run=ProcessRun("it", "student", []), source=""
        )
        assert (plan.problem.kind if plan.problem is not None else None) == kind
        assert Plan.from_plain(plan.to_plain()) is not None


def test_a_plans_own_files_are_placed_in_one_pass() -> None:
    """Each file that the plan brings is found under its whole name, however many files and texts there are."""
    names = {f"arm_{n}.yaml" for n in range(2000)}
    texts = ["{parameters}/arm_1.yaml:{parameters}/arm_12.yaml.", "{parameters}/else.yaml", *["x" * 20] * 100_000]
    began_s = time.process_time()
    placed = [with_places(text, names, "/p") for text in texts]
    assert time.process_time() - began_s < 5.0
    assert placed[:3] == ["/p/arm_1.yaml:/p/arm_12.yaml.", "{parameters}/else.yaml", "x" * 20]
