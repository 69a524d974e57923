"""Examination of an installation of ROS 2 for students' programs, such as `/opt/ros/jazzy` or an environment of wheels.

The examination reads names and versions of packages, and imports rclpy once. Nothing of the installation is changed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path

from grader.doctor.status import Status, Verdict
from grader.errors import PlatformError
from grader.live.sandbox.course_ros import installation_at, probed
from grader.live.sandbox.installation import Installation

#: Packages for more kinds of submissions, each with its use.
_OPTIONAL: Mapping[str, str] = {
    "rclcpp": "nodes in C++",
    "launch_ros": "the real launch",
    "tf2_ros": "all of tf2_ros",
}
_NEEDED = ("rclpy", "rmw_fastrtps_cpp", "std_msgs", "std_srvs")
_SUBJECT = "ROS 2"
_OLDER = "Discovery messages and type hashes differ before Jazzy. Use Jazzy, Kilted or Rolling."


def examine_ros(prefix: Path, interpreter: Path | None = None) -> Iterator[Status]:
    """Examine an installation; ends early if the remaining statuses need a failed one.

    Parameters
    ----------
    prefix
        Folder of the installation.
    interpreter
        Python for its programs; None for the one of its rclpy.
    """
    try:
        installation = installation_at(prefix, interpreter)
    except PlatformError as error:
        yield Status(Verdict.FAIL, _SUBJECT, f"{error.problem}: {error.location}", error.remedy)
        return
    found = f"{installation}, for {installation.interpreter}"
    if installation.is_older:
        yield Status(Verdict.FAIL, _SUBJECT, found, _OLDER)
        return
    yield Status(Verdict.PASS, _SUBJECT, found)
    missing = list(itertools.filterfalse(installation.has, _NEEDED))
    if missing:
        remedy = "Install them there, for example with apt."
        yield Status(Verdict.FAIL, "ROS 2 packages", f"missing: {', '.join(missing)}", remedy)
        return
    yield _import(installation)
    yield _optional(installation)


def _optional(installation: Installation) -> Status:
    """Name the present packages, and the missing ones with their use."""
    there = list(_NEEDED)
    missing = []
    for package, use in _OPTIONAL.items():
        if installation.has(package):
            there.append(package)
        else:
            missing.append(f"{package} (for {use})")
    found = ", ".join(there)
    if missing:
        found += f"; missing: {', '.join(missing)}"
    return Status(Verdict.PASS, "ROS 2 packages", found)


def _import(installation: Installation) -> Status:
    """State whether rclpy can be imported, with the discovery of Jazzy."""
    subject = "ROS 2 in Python"
    try:
        middleware = probed(installation)
    except ValueError as problem:
        remedy = "Source the installation in a terminal, and try `python3 -c 'import rclpy'`."
        return Status(Verdict.FAIL, subject, f"rclpy cannot be imported: {problem}", remedy)
    if not middleware:
        return Status(Verdict.FAIL, subject, "it has other discovery messages than Jazzy", _OLDER)
    return Status(Verdict.PASS, subject, f"rclpy can be imported, with {middleware}")
