"""Names of ROS 2 Jazzy that this machine may lack: modules of `launch`, keywords and packages."""

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
    """Return whether a package of this name can be installed with ROS, e.g. `nav2_bringup`."""
    return _RELEASED.fullmatch(package) is not None


def homes_of(name: str) -> list[str]:
    """Return the modules of `launch` and `launch_ros` that define a name, e.g. of `Node`."""
    return sorted(module for module, names in NAMES.items() if name in names)
