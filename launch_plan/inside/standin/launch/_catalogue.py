"""Modules of the real packages, as an import statement sees them.

A module of the stand-in offers the names of the real one, and no name that it imports for itself. A name missing in
Jazzy cannot be imported. A name of Jazzy that the stand-in does not evaluate can be imported, and its use makes the
file "not assessable here".
"""

from __future__ import annotations

import importlib
import sys
import typing
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from launch_plan import jazzy as _jazzy
from launch_plan.inside.problems import UnsupportedByStandin

#: Modules of the stand-in by name, with all that they define.
_implemented: dict[str, ModuleType] = {}


class _Unevaluated:
    """A name of the real packages that has no effect here."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self()

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        message = f"{self._name} is not evaluated by this grader"
        raise UnsupportedByStandin(message, name=self._name.partition(".")[0])


class PublicModule(ModuleType):
    """A module of the real packages, with or without a file in the stand-in."""

    def __getattr__(self, name: str) -> Any:
        title = self.__name__
        if name == "__all__":
            return _jazzy.starred(title)
        if name in _jazzy.NAMES[title]:
            return _evaluated(title, name)
        if name in _jazzy.SUBMODULES.get(title, ()):
            return importlib.import_module(f"{title}.{name}")
        if name in _jazzy.FOREIGN.get(title, ()):
            return _foreign(title, name)
        raise AttributeError(f"module '{title}' has no attribute '{name}'")


def _evaluated(title: str, name: str) -> Any:
    """Return the object of the stand-in for a name of a module, or an object without effect."""
    for home in (title, title.rpartition(".")[0], *_implemented):
        found = vars(_implemented.get(home, object)).get(name)
        if found is None:
            continue
        if name in _jazzy.NAMES[home]:
            return found
        if getattr(found, "__module__", None) == home:
            return found
    if name in _jazzy.TYPES:
        return Any
    return sys.modules["launch"] if name == "launch" else _Unevaluated(f"{title}.{name}")


def _foreign(title: str, name: str) -> Any:
    """Return an object of another package, e.g. the module `os` or the type `Text`."""
    if hasattr(typing, name):
        return getattr(typing, name)
    if name in sys.stdlib_module_names:
        return importlib.import_module(name)
    return _Unevaluated(f"{title}.{name}")


class _SubmoduleFinder(MetaPathFinder, Loader):
    """Finder for the modules of the real packages that have no file here."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        file = Path(__file__).parents[1].joinpath(*fullname.split("."))
        has_file = file.with_suffix(".py").exists() or (file / "__init__.py").exists()
        if has_file:
            return None
        if fullname not in _jazzy.NAMES:
            return None
        return ModuleSpec(fullname, self, is_package=fullname in _jazzy.SUBMODULES)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return PublicModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


def publish() -> None:
    """Show the names of the real modules, instead of all in the modules of the stand-in imported so far."""
    for title, module in list(sys.modules.items()):
        if title not in _jazzy.NAMES:
            continue
        if isinstance(module, PublicModule):
            continue
        _implemented[title] = module
        shown = PublicModule(title)
        for name, value in vars(module).items():
            if name.startswith("__"):
                vars(shown)[name] = value
        sys.modules[title] = shown


sys.meta_path.insert(0, _SubmoduleFinder())
