"""Names of packages that programs for ROS import, as data: what is missing here is not misspelt for that."""

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
    """Return these, and the libraries of Python that students know."""
    return ros_packages() | _names("python.txt")


def _names(file: str) -> frozenset[str]:
    lines = (_FOLDER / file).read_text(encoding="utf-8").splitlines()
    return frozenset(name for line in lines if not line.startswith("#") for name in line.split())
