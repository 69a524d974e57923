"""What ROS 2 Jazzy has, and the machine of the grader has not: names of modules, keywords and packages."""

from __future__ import annotations

import re
from configparser import ConfigParser
from pathlib import Path

_LISTS = ConfigParser(delimiters="=", interpolation=None)
_LISTS.optionxform = str  # type: ignore[assignment,method-assign]
_LISTS.read(Path(__file__).with_suffix(".ini"), encoding="utf-8")


def _words(section: str) -> dict[str, list[str]]:
    return {name: text.split() for name, text in _LISTS[section].items()}


NAMES, SUBMODULES, LATER = _words("names"), _words("submodules"), _words("later")
TYPES = _words("types")["types"]
RENAMED = dict(_LISTS["keywords"])
_RELEASED = re.compile("|".join(_words("packages")["released"]))


def is_released(package: str) -> bool:
    """Whether a package of this name can be had on a ROS machine."""
    return _RELEASED.fullmatch(package) is not None


def homes_of(name: str) -> list[str]:
    """Modules of `launch` and `launch_ros` that hold a name."""
    return sorted(module for module, names in NAMES.items() if name in names)
