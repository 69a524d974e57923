"""Modules of the real packages, as an import statement sees them.

A name missing in Jazzy cannot be imported. A name of Jazzy that the stand-in does not evaluate can be imported, and its
use makes the file "not assessable here".
"""

from __future__ import annotations

import importlib
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from launch_plan import jazzy as _jazzy
from launch_plan.inside.problems import UnsupportedByStandin

#: Packages with names that other modules of the real `launch` show too.
_USED = (
    "launch",
    "launch.frontend",
    "launch.launch_description_sources",
    "launch_ros.parameter_descriptions",
)


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
        parent = title.rpartition(".")[0]
        known = _jazzy.NAMES.get(title) or _jazzy.NAMES.get(parent, [])
        inner = _jazzy.SUBMODULES.get(title, [])
        if name == "__all__":
            modules = [each for each in inner if f"{title}.{each}" in _jazzy.NAMES]
            return [*known, *modules]
        if name in inner:
            return importlib.import_module(f"{title}.{name}")
        home = None if "__file__" in vars(self) else _home_of(name, known, parent)
        if home is not None:
            return getattr(home, name)
        if name in _jazzy.TYPES:
            return Any
        if name in known:
            return _Unevaluated(f"{title}.{name}")
        raise AttributeError(f"module '{title}' has no attribute '{name}'")


def _home_of(name: str, known: list[str], parent: str) -> ModuleType | None:
    """Return the module of the stand-in that holds a name of a module without a file."""
    for home in (parent, *_USED):
        if not home or name not in (*known, *_jazzy.NAMES.get(home, [])):
            continue
        module = importlib.import_module(home)
        if name in vars(module):
            return module
    return None


class _SubmoduleFinder(MetaPathFinder, Loader):
    """Finder for the modules of the real packages that have no file here."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        parent, _, name = fullname.rpartition(".")
        file = Path(__file__).parents[1].joinpath(*fullname.split("."))
        if fullname not in _jazzy.NAMES and name not in _jazzy.SUBMODULES.get(parent, ()):
            return None
        has_file = file.with_suffix(".py").exists() or (file / "__init__.py").exists()
        return None if has_file else ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return PublicModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


def publish() -> None:
    """Let the modules imported so far show the names of the real ones."""
    for title, module in sys.modules.items():
        if title in _jazzy.NAMES:
            module.__class__ = PublicModule


sys.meta_path.insert(0, _SubmoduleFinder())
