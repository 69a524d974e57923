"""Names of packages: known ones, and slips of them."""

from __future__ import annotations

import pytest

from grader.evidence.known_packages import package_meant_by


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("rlccpp", "rclcpp"),
        ("rclcp", "rclcpp"),
        ("rclcppp", "rclcpp"),
        ("std_msg", "std_msgs"),
        ("geometry-msgs", "geometry_msgs"),
        ("OpenCv", "OpenCV"),
        ("my_interfces", "my_interfaces"),
        ("python-numpy", ""),
        ("my_interfaces2", ""),
        ("rclcpp", ""),
        ("rclc", ""),
        ("tensor_msgs", ""),
        ("my_interfaces", ""),
        ("moveit_everything", ""),
        ("", ""),
    ],
)
def test_a_slip_of_a_known_package(name: str, meant: str) -> None:
    """One letter, or another spelling, makes a slip; another digit or a real package with a similar name does not."""
    assert package_meant_by(name, ["my_interfaces"]) == meant
