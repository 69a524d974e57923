"""The modules of the real packages, as an import statement sees them.

A name that Jazzy has not cannot be imported here either. One that Jazzy has and nobody evaluates can be imported,
and to use it ends in "not assessable here".
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

#: Packages whose names other modules of the original show, too.
_USED = (
    "launch",
    "launch.frontend",
    "launch.launch_description_sources",
    "launch_ros.parameter_descriptions",
)


class _Unevaluated:
    """Something of the real packages that can be imported here, and does nothing."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self()

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        raise UnsupportedByStandin(
            f"{self._name} is not evaluated by this grader", name=self._name.partition(".")[0]
        )


class PublicModule(ModuleType):
    """A module of the real packages, with a file of the stand-in or without."""

    def __getattr__(self, name: str) -> Any:
        title = self.__name__
        parent = title.rpartition(".")[0]
        known = _jazzy.NAMES.get(title) or _jazzy.NAMES.get(parent, [])
        inner = _jazzy.SUBMODULES.get(title, [])
        if name == "__all__":
            return [*known, *(each for each in inner if f"{title}.{each}" in _jazzy.NAMES)]
        if name in inner:
            return importlib.import_module(f"{title}.{name}")
        for home in () if "__file__" in vars(self) else filter(None, (parent, *_USED)):
            if name in (*known, *_jazzy.NAMES.get(home, [])) and name in vars(
                held := importlib.import_module(home)
            ):
                return getattr(held, name)
        if name in _jazzy.TYPES:
            return Any
        if name in known:
            return _Unevaluated(f"{title}.{name}")
        raise AttributeError(f"module '{title}' has no attribute '{name}'")


class _SubmoduleFinder(MetaPathFinder, Loader):
    """Finds the modules of the real packages that have no file here."""

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
    """Let the modules that were imported so far show what the real ones do."""
    for title, module in sys.modules.items():
        if title in _jazzy.NAMES:
            module.__class__ = PublicModule


sys.meta_path.insert(0, _SubmoduleFinder())
