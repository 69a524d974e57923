"""Lists the names in all modules of the `launch` packages on the path, for `launch_plan/jazzy_modules.ini`.

With the original's folder on PYTHONPATH, `python tests/launch_plan/original_names.py > launch_plan/jazzy_modules.ini`
renews that file.
"""

from __future__ import annotations

import importlib
import json
import pkgutil
import sys
import textwrap
import types
import typing
from collections.abc import Iterator
from types import ModuleType
from typing import Any

PACKAGES = ("launch", "launch_ros", "launch_xml", "launch_yaml")
HEAD = """\
# Names in the modules of `launch` 3.4.3 and `launch_ros` 0.26.6, written by tests/launch_plan/original_names.py.

# Names of these packages that an import of the module finds, without its sub-modules.
"""
FOREIGN = "# Names of other packages that an import of the module finds.\n"
STARRED = "# Names that an import of `*` brings, where these are not just the names above.\n"


def modules() -> Iterator[tuple[str, ModuleType]]:
    """Import each module of the packages; yield its title and the module."""
    for top in PACKAGES:
        package = importlib.import_module(top)
        yield top, package
        for info in pkgutil.walk_packages(package.__path__, f"{top}."):
            if "conftest" not in info.name:
                yield info.name, importlib.import_module(info.name)


def is_sub_module(title: str, name: str, value: Any) -> bool:
    """Tell whether a name of a module stands for its sub-module."""
    if not isinstance(value, types.ModuleType):
        return False
    return sys.modules.get(f"{title}.{name}") is value


def is_foreign(name: str, value: Any) -> bool:
    """Tell whether a name comes from another package, e.g. `os` or `Text` of `typing`."""
    if isinstance(value, types.ModuleType):
        return not value.__name__.startswith("launch")
    if name in ("Text", "TYPE_CHECKING", "g_entry_points_impl"):
        return True
    if name in vars(typing):
        return True
    home = str(getattr(value, "__module__", None) or "launch")
    return not home.startswith(("launch", "typing"))


def public_names() -> dict[str, dict[str, list[str]]]:
    """Return the names by section of the file and by module."""
    found: dict[str, dict[str, list[str]]] = {"names": {}, "foreign": {}, "starred": {}}
    for title, module in modules():
        own: list[str] = []
        foreign: list[str] = []
        for name, value in sorted(vars(module).items()):
            if not name.startswith("_") and not is_sub_module(title, name, value):
                (foreign if is_foreign(name, value) else own).append(name)
        found["names"][title] = own
        if foreign:
            found["foreign"][title] = foreign
        starred = sorted(set(getattr(module, "__all__", [*own, *foreign])) & set(vars(module)))
        if starred != sorted([*own, *foreign]):
            found["starred"][title] = starred
    return found


def as_text(found: dict[str, dict[str, list[str]]]) -> str:
    """Return the names in the format of the file."""
    parts: list[str] = []
    heads = {"names": HEAD, "foreign": FOREIGN, "starred": STARRED}
    for section, head in heads.items():
        lines = [f"{head}[{section}]"]
        for title, names in sorted(found[section].items()):
            line = f"{title} = {' '.join(names)}".rstrip()
            lines += textwrap.wrap(line, 118, subsequent_indent="    ", break_long_words=False)
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    # Sub-modules are attributes of their packages only once all modules are imported.
    list(modules())
    names = public_names()
    print(json.dumps(names) if "--json" in sys.argv else as_text(names), end="")
