"""Names of packages that programs for ROS import, as data: a missing package need not be misspelt."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from pathlib import Path

_FOLDER = Path(__file__).parent


@functools.cache
def ros_packages() -> frozenset[str]:
    """Return the packages of ROS 2 Jazzy that Python programs import."""
    return _names("ros_jazzy.txt")


@functools.cache
def known_packages() -> frozenset[str]:
    """Return the packages of ROS 2 Jazzy and the Python libraries that students know."""
    return ros_packages() | _names("python.txt")


@functools.cache
def buildable_packages() -> frozenset[str]:
    """Return the packages and libraries that build files for ROS 2 name."""
    return ros_packages() | _names("ros_cpp.txt")


def package_meant_by(name: str, others: Iterable[str] = ()) -> str:
    """Return the known package meant by a misspelt name; empty for a known name, and for one unlike all.

    A slip is a letter that is missing, added, changed or swapped with its neighbour, or another use of capitals, `_` and
    `-`. Names with different digits are two packages, such as `arm1_msgs` and `arm2_msgs`. No name of a package in the
    ROS 2 distributions Foxy to Lyrical is a slip of a known one.

    Parameters
    ----------
    others
        Names of further packages, such as those of the submission.

    Examples
    --------
    >>> package_meant_by("rlccpp"), package_meant_by("std_msg"), package_meant_by("rclc")
    ('rclcpp', 'std_msgs', '')
    >>> package_meant_by("python-numpy")
    ''
    """
    known = buildable_packages().union(others)
    if name in known:
        return ""
    meant = [each for each in known if _is_slip(name, each)]
    return min(meant, default="", key=lambda each: (each[:1] != name[:1], -len(each), each))


def _is_slip(name: str, wanted: str) -> bool:
    """Return whether a name differs from a wanted one by one letter, or by its spelling alone."""
    if _digits(name) != _digits(wanted):
        return False
    if _plain(name) == _plain(wanted):
        return True
    start = 0
    for letter, other in zip(name, wanted, strict=False):
        if letter != other:
            break
        start += 1
    rest = name[start:]
    wanted_rest = wanted[start:]
    is_missing = rest == wanted_rest[1:]
    is_added = rest[1:] == wanted_rest
    is_changed = rest[1:] == wanted_rest[1:]
    is_swapped = rest == wanted_rest[1::-1] + wanted_rest[2:]
    return any((is_missing, is_added, is_changed, is_swapped))


def _digits(name: str) -> list[str]:
    return list(filter(str.isdigit, name))


def _plain(name: str) -> str:
    return name.lower().replace("_", "").replace("-", "")


def _names(file: str) -> frozenset[str]:
    names: set[str] = set()
    for line in (_FOLDER / file).read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            names.update(line.split())
    return frozenset(names)
