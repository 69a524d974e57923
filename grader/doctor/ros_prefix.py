"""Examination of an installation of ROS 2 for students' programs, such as `/opt/ros/jazzy` or an environment of wheels.

The examination reads names and versions of packages, and imports rclpy once. Nothing of the installation is changed.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from confine.helpers import find_tool
from grader.doctor.status import Status, Verdict
from grader.live.sandbox.environment import ask_interpreter

#: First number of rclpy's version in each distribution, by the distributions' package lists.
_DISTRIBUTIONS = {3: "Humble", 4: "Iron", 7: "Jazzy", 9: "Kilted"}
#: First number of rclpy's version in the oldest distribution with the grader's discovery messages and type hashes.
_OLDEST = 7
#: Packages for more kinds of submissions, each with its use.
_OPTIONAL: Mapping[str, str] = {
    "rclcpp": "nodes in C++",
    "launch_ros": "the real launch",
    "tf2_ros": "all of tf2_ros",
}
_PACKAGES = "share/ament_index/resource_index/packages"
_NEEDED = ("rclpy", "rmw_fastrtps_cpp", "std_msgs", "std_srvs")
#: The arguments are folders with modules.
_IMPORT = """
import sys
sys.path[:0] = sys.argv[1:]
import rclpy, std_msgs.msg, std_srvs.srv
print(rclpy.get_rmw_implementation_identifier())
"""


def examine_ros(prefix: Path) -> Iterator[Status]:
    """Examine an installation; ends early if the remaining statuses need a failed one."""
    installed = _Installed.at(prefix)
    if installed is None:
        remedy = "Give the folder with `share` and `lib`, such as /opt/ros/jazzy."
        yield Status(Verdict.FAIL, "ROS 2", f"no rclpy in {prefix}", remedy)
        return
    yield _distribution(installed)
    missing = list(itertools.filterfalse(installed.has, _NEEDED))
    if missing:
        remedy = "Install them there, for example with apt."
        yield Status(Verdict.FAIL, "ROS 2 packages", f"missing: {', '.join(missing)}", remedy)
        return
    yield _import(installed)
    yield _optional(installed)


@dataclass(frozen=True)
class _Installed:
    """Facts about an installation, from the names of its files."""

    prefix: Path
    #: Folder with its Python modules.
    modules: Path
    #: Version of Python, such as `3.12`.
    python: str
    #: Version of rclpy, such as `7.1.5`.
    rclpy: str

    @classmethod
    def at(cls, prefix: Path) -> _Installed | None:
        """Find rclpy below a prefix; None if it is not there."""
        for folder in ("site-packages", "dist-packages"):
            for path in sorted(prefix.glob(f"lib/python3.*/{folder}/rclpy-*")):
                version = re.match(r"rclpy-(\d+\.\d+\.\d+)", path.name)
                if version is not None:
                    modules = path.parent
                    python = modules.parent.name.removeprefix("python")
                    return cls(prefix, modules, python, version[1])
        return None

    @property
    def major(self) -> int:
        """First number of rclpy's version."""
        return int(self.rclpy.partition(".")[0])

    @property
    def name(self) -> str:
        """Name of the distribution."""
        if self.major > max(_DISTRIBUTIONS):
            return "Rolling"
        return _DISTRIBUTIONS.get(self.major, "an older distribution")

    def has(self, package: str) -> bool:
        """Tell whether a package is installed."""
        return (self.prefix / _PACKAGES / package).exists()

    @property
    def interpreter(self) -> Path | None:
        """Python of the installation's version: its own, or one of the system; None without one."""
        own = self.prefix / "bin/python"
        if own.exists():
            return own
        found = find_tool(f"python{self.python}")
        return None if found is None else Path(found)


def _distribution(installed: _Installed) -> Status:
    """State whether the grader can watch nodes of the distribution."""
    found = f"{installed.name} (rclpy {installed.rclpy}) for Python {installed.python}"
    if installed.major < _OLDEST:
        remedy = (
            "Discovery messages and type hashes differ before Jazzy. Use Jazzy, Kilted or Rolling."
        )
        return Status(Verdict.FAIL, "ROS 2", found, remedy)
    return Status(Verdict.PASS, "ROS 2", found)


def _optional(installed: _Installed) -> Status:
    """Name the packages that are there, and the missing ones with their use."""
    there = list(_NEEDED)
    missing = []
    for package, use in _OPTIONAL.items():
        if installed.has(package):
            there.append(package)
        else:
            missing.append(f"{package} (for {use})")
    found = ", ".join(there)
    if missing:
        found += f"; missing: {', '.join(missing)}"
    return Status(Verdict.PASS, "ROS 2 packages", found)


def _import(installed: _Installed) -> Status:
    """State whether rclpy can be imported with a Python of its version."""
    interpreter = installed.interpreter
    subject = "ROS 2 in Python"
    if interpreter is None:
        found = f"there is no Python {installed.python} on this machine"
        return Status(Verdict.FAIL, subject, found, "Install it.")
    libraries = [installed.prefix / "lib", *sorted(installed.modules.glob("ros_*.libs"))]
    more = {
        "AMENT_PREFIX_PATH": str(installed.prefix),
        "LD_LIBRARY_PATH": ":".join(map(str, libraries)),
    }
    try:
        rmw = ask_interpreter(interpreter, _IMPORT, str(installed.modules), more=more)
    except ValueError as problem:
        remedy = "Source the installation in a terminal, and try `python3 -c 'import rclpy'`."
        return Status(Verdict.FAIL, subject, f"rclpy cannot be imported: {problem}", remedy)
    return Status(Verdict.PASS, subject, f"rclpy can be imported, with {rmw.strip()}")
