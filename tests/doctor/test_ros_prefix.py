"""Examination of an installation of ROS 2."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from grader.doctor.ros_prefix import examine_ros
from grader.doctor.status import Verdict

pytestmark = pytest.mark.live

PYTHON = Path(sys.executable)
NEEDED = ("rclpy", "rmw_fastrtps_cpp", "std_msgs", "std_srvs")


def installation(folder: Path, rclpy: str, packages: tuple[str, ...] = NEEDED) -> Path:
    """Imitate an installation: the folder of rclpy's version, and the index of packages."""
    (folder / f"lib/python3.99/site-packages/rclpy-{rclpy}-py3.99.egg-info").mkdir(parents=True)
    index = folder / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for package in packages:
        (index / package).touch()
    return folder


@pytest.mark.parametrize(
    ("rclpy", "name", "verdict"),
    [
        ("3.3.13", "Humble", Verdict.FAIL),
        ("7.1.4", "Jazzy", Verdict.PASS),
        ("9.1.2", "Kilted", Verdict.PASS),
        ("10.0.3", "Rolling", Verdict.PASS),
    ],
)
def test_the_distribution_is_told_by_the_version_of_rclpy(
    tmp_path: Path, rclpy: str, name: str, verdict: Verdict
) -> None:
    """An older distribution has other discovery messages."""
    first = next(iter(examine_ros(installation(tmp_path, rclpy), PYTHON)))
    found = f"{name} (rclpy {rclpy}) in {tmp_path}, for {PYTHON}"
    assert (first.verdict, first.found) == (verdict, found)


def test_a_missing_python_and_missing_packages_are_named(tmp_path: Path) -> None:
    """The examination ends without a Python of the installation's version, and goes on with a chosen one."""
    prefix = installation(tmp_path, "7.1.4", (*NEEDED, "rclcpp"))
    (only,) = examine_ros(prefix)
    found = f"there is no Python 3.99 on this machine: {prefix}"
    assert (only.verdict, only.found) == (Verdict.FAIL, found)
    _, imported, packages = examine_ros(prefix, PYTHON)
    assert imported.verdict is Verdict.FAIL
    there, _, missing = packages.found.partition("; missing: ")
    assert there.endswith("rclcpp")
    assert missing == "launch_ros (for the real launch), tf2_ros (for all of tf2_ros)"


def test_a_folder_without_rclpy_or_its_middleware_cannot_run_nodes(tmp_path: Path) -> None:
    """The examination ends where the rest would need the missing part."""
    (only,) = examine_ros(tmp_path)
    assert (only.verdict, only.found) == (Verdict.FAIL, f"there is no rclpy: {tmp_path}")
    _, last = examine_ros(installation(tmp_path, "7.1.4", ("rclpy",)), PYTHON)
    assert (last.verdict, last.found) == (
        Verdict.FAIL,
        "missing: rmw_fastrtps_cpp, std_msgs, std_srvs",
    )


def test_the_graders_own_wheels_are_an_installation() -> None:
    """The import of rclpy is real."""
    statuses = list(examine_ros(Path(sys.prefix)))
    assert {status.verdict for status in statuses} == {Verdict.PASS}
    assert statuses[1].found == "rclpy can be imported, with rmw_fastrtps_cpp"
