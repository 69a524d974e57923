"""Names of ROS 2 Jazzy that this machine may lack: modules of `launch`, keywords and packages."""

from __future__ import annotations

import re
from collections.abc import Iterable
from configparser import ConfigParser
from pathlib import Path

_HERE = Path(__file__).parent
_LISTS = ConfigParser(delimiters="=", interpolation=None)
_LISTS.optionxform = str  # type: ignore[assignment,method-assign]
_LISTS.read([_HERE / "jazzy.ini", _HERE / "jazzy_modules.ini"], encoding="utf-8")


def _words(section: str) -> dict[str, list[str]]:
    return {name: text.split() for name, text in _LISTS[section].items()}


def _with_patches(names: dict[str, list[str]]) -> dict[str, list[str]]:
    for module, later in _words("patches").items():
        names.setdefault(module, []).extend(later)
    return names


def _sub_modules(modules: Iterable[str]) -> dict[str, list[str]]:
    """Return the sub-modules by package, e.g. `events: [process, ...]`."""
    found: dict[str, list[str]] = {}
    for module in modules:
        package, _, name = module.rpartition(".")
        found.setdefault(package, []).append(name)
    return found


#: Names by module: names of `launch` and its companions, and names of other packages.
NAMES, FOREIGN = _with_patches(_words("names")), _words("foreign")
SUBMODULES = _sub_modules(NAMES)
LATER = _words("later")
TYPES = _words("types")["types"]
RENAMED = dict(_LISTS["keywords"])
_STARRED = _words("starred")
_RELEASED = re.compile("|".join(_words("packages")["released"]))


def starred(module: str) -> list[str]:
    """Return the names that `from module import *` brings."""
    if module in _STARRED:
        return _STARRED[module]
    return [*NAMES[module], *FOREIGN.get(module, ())]


def is_released(package: str) -> bool:
    """Return whether a package of this name can be installed with ROS, e.g. `nav2_bringup`."""
    return _RELEASED.fullmatch(package) is not None


def homes_of(name: str) -> list[str]:
    """Return the packages of `launch` and `launch_ros` that show a name, e.g. of `Node`; else the modules."""
    modules: list[str] = []
    packages: list[str] = []
    for module, names in sorted(NAMES.items()):
        if name not in names:
            continue
        modules.append(module)
        if module in SUBMODULES:
            packages.append(module)
    if not packages:
        return modules
    return packages
