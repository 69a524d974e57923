"""An installation of ROS for students' programs: found by its folder, probed, and given to programs."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from grader.errors import PlatformError
from grader.live.sandbox.course_ros import installation_at, require_usable
from grader.live.sandbox.environment import find_native_launch, student_environment
from grader.live.sandbox.installation import Installation, wheels_of
from grader.live.sandbox.room import StudentRoom
from tests.live.imitated_prefix import MODULES

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone"),
]
PYTHON = Path(sys.executable)


def folder_with(prefix: Path, rclpy: str, *packages: str) -> Path:
    """Make the folder of an installation, with the name of rclpy's version and a list of packages."""
    (prefix / MODULES / f"rclpy-{rclpy}-py3.egg-info").mkdir(parents=True)
    index = prefix / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for package in packages:
        (index / package).touch()
    return prefix


def test_a_workspace_brings_the_installations_below_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its setup.bash is asked in an environment without the caller's variables."""
    below = folder_with(tmp_path / "opt", "7.1.4", "rclpy")
    workspace = tmp_path / "ws/install"
    workspace.mkdir(parents=True)
    (workspace / "setup.bash").write_text(
        f"export AMENT_PREFIX_PATH={workspace}:{below}${{AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}}\n"
        f"export PYTHONPATH=relative:{below}/{MODULES}\n"
        "echo a greeting\n",
        encoding="utf-8",
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/elsewhere")
    found = installation_at(workspace, PYTHON)
    assert found.prefixes == (str(workspace), str(below))
    assert found.modules == (f"{below}/{MODULES}",)
    assert found.has("rclpy")
    assert str(found) == f"Jazzy (rclpy 7.1.4) in {workspace}"
    assert list(found.folders) == [str(below), str(workspace)]
    tools = StudentRoom.below(tmp_path / "room", found).tools
    assert tools[str(below)] == below


def test_a_setup_that_fails_is_quoted(tmp_path: Path) -> None:
    """The last line of the shell is the reason."""
    (tmp_path / "setup.bash").write_text("cat no-such-file\nfalse\n", encoding="utf-8")
    with pytest.raises(PlatformError, match=r"setup.bash cannot be sourced .*no-such-file"):
        installation_at(tmp_path)


def test_an_older_distribution_is_refused(tmp_path: Path) -> None:
    """The word says which one it is, and which ones work."""
    installation = installation_at(folder_with(tmp_path / "humble", "3.3.13"), PYTHON)
    with pytest.raises(
        PlatformError, match=r"Humble \(rclpy 3.3.13\) has other discovery"
    ) as caught:
        require_usable(installation)
    assert caught.value.exit_status == 5
    assert "Jazzy, Kilted or Rolling" in caught.value.remedy


def test_an_installation_without_its_modules_is_refused(tmp_path: Path) -> None:
    """The probe imports the needed modules."""
    other = Path("/usr/bin/python3")
    installation = installation_at(folder_with(tmp_path / "jazzy", "7.1.4"), other)
    with pytest.raises(PlatformError, match="rclpy cannot be imported"):
        require_usable(installation)


def test_the_probe_accepts_the_graders_own_wheels() -> None:
    """Names of 16 bytes and type hashes."""
    require_usable(installation_at(Path(sys.prefix)))


def test_a_launch_that_is_installed_and_broken_is_no_reason_for_the_stand_in(
    tmp_path: Path,
) -> None:
    """Without launch_ros the stand-in is taken; a missing library of the real launch is named."""
    lacking = installation_at(folder_with(tmp_path / "a", "7.1.4"), PYTHON)
    assert find_native_launch(lacking, "auto") is None
    broken = installation_at(folder_with(tmp_path / "b", "7.1.4", "launch_ros"), PYTHON)
    assert find_native_launch(broken, "standin") is None
    with pytest.raises(PlatformError, match="launch_ros cannot be imported") as caught:
        find_native_launch(broken, "auto")
    assert "--launch standin" in caught.value.remedy


def test_programs_get_the_modules_and_the_session_its_variables(tmp_path: Path) -> None:
    """The tap comes before the modules of the installation; the variable of the profile is Fast DDS 3's for Kilted."""
    kilted = installation_at(folder_with(tmp_path, "9.1.2"), PYTHON)
    environment = student_environment(kilted, "/home", "/ws", "/inside", 7)
    assert environment["PYTHONPATH"] == f"/inside:{tmp_path}/{MODULES}"
    assert environment["AMENT_PREFIX_PATH"] == f"/ws/install:{tmp_path}"
    assert environment["ROS_DISTRO"] == "kilted"
    assert environment["FASTDDS_DEFAULT_PROFILES_FILE"] == "/inside/discovery.xml"
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in environment
    own = student_environment(wheels_of(PYTHON), "/home", "/ws", "/inside", 7)
    assert own["ROS_DISTRO"] == "jazzy"
    assert own["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/inside/discovery.xml"


def test_a_changed_installation_has_other_facts(tmp_path: Path) -> None:
    """A new package or a new library leads to new builds and new gradings."""
    installation: Installation = installation_at(folder_with(tmp_path, "7.1.4"), PYTHON)
    before = installation.facts()
    assert replace(installation).facts() == before
    (tmp_path / "lib/libnew.so").touch()
    assert installation.facts() != before
