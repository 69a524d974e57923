"""What is mended of a launch file's workspace is within it, whatever the file says of itself."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from grader.live.launched import _mend_executable, _mend_package, own_folder

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
