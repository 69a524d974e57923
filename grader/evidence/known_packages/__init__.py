"""Names of packages that programs for ROS import, as data: a missing package need not be misspelt."""

from __future__ import annotations

import functools
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


def _names(file: str) -> frozenset[str]:
    names: set[str] = set()
    for line in (_FOLDER / file).read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            names.update(line.split())
    return frozenset(names)
