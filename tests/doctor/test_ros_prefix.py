"""Examination of an installation of ROS 2."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from grader.doctor.ros_prefix import examine_ros
from grader.doctor.status import Verdict

pytestmark = pytest.mark.live

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
    first = next(iter(examine_ros(installation(tmp_path, rclpy))))
    assert (first.verdict, first.found) == (verdict, f"{name} (rclpy {rclpy}) for Python 3.99")


def test_a_missing_python_and_missing_packages_are_named(tmp_path: Path) -> None:
    """Nothing is imported without a Python of the installation's version."""
    _, imported, packages = examine_ros(installation(tmp_path, "7.1.4", (*NEEDED, "rclcpp")))
    assert (imported.verdict, imported.found) == (
        Verdict.FAIL,
        "there is no Python 3.99 on this machine",
    )
    there, _, missing = packages.found.partition("; missing: ")
    assert there.endswith("rclcpp")
    assert missing == "launch_ros (for the real launch), tf2_ros (for all of tf2_ros)"


def test_a_folder_without_rclpy_or_its_middleware_cannot_run_nodes(tmp_path: Path) -> None:
    """The examination ends where the rest would need the missing part."""
    (only,) = examine_ros(tmp_path)
    assert (only.verdict, only.found) == (Verdict.FAIL, f"no rclpy in {tmp_path}")
    _, last = examine_ros(installation(tmp_path, "7.1.4", ("rclpy",)))
    assert (last.verdict, last.found) == (
        Verdict.FAIL,
        "missing: rmw_fastrtps_cpp, std_msgs, std_srvs",
    )


def test_the_graders_own_wheels_are_an_installation() -> None:
    """The import of rclpy is real."""
    statuses = list(examine_ros(Path(sys.prefix)))
    assert {status.verdict for status in statuses} == {Verdict.PASS}
    assert statuses[1].found == "rclpy can be imported, with rmw_fastrtps_cpp"
