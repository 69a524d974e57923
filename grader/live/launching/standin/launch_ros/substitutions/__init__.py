"""Substitutions that look into ROS packages."""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from typing import Any

from launch._base import (
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch._catalogue import ELSEWHERE, is_released, missing_name
from launch._installed import missing_entry_point
from launch.frontend.expose import expose_substitution
from launch.substitutions import PathSubstitution, texts_and_substitutions

__all__ = [
    "ExecutableInPackage",
    "FindPackage",
    "FindPackagePrefix",
    "FindPackageShare",
    "Parameter",
]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


class FindPackage(PathSubstitution):
    """Something about an installed package."""

    def __init__(self, package: Any) -> None:
        super().__init__(self)
        self._package = normalize_to_list_of_substitutions(package)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(find-pkg-... package)`."""
        if len(data) != 1:
            raise AttributeError("this substitution takes one argument: the package")
        return cls, {"package": data[0]}

    @property
    def package(self) -> list[Substitution]:
        """The package."""
        return self._package

    def describe(self) -> str:
        """Text for people."""
        return f"{type(self).__name__}(pkg={' + '.join(sub.describe() for sub in self._package)})"

    def find(self, package_name: str) -> str:
        """What is looked for."""
        raise NotImplementedError

    def perform(self, context: Any) -> str:
        """What is looked for."""
        return self.find(perform_substitutions(context, self._package))


@expose_substitution("find-pkg-prefix")
class FindPackagePrefix(FindPackage):
    """Where a package is installed."""

    def find(self, package_name: str) -> str:
        """The folder."""
        from ament_index_python.packages import get_package_prefix

        return str(get_package_prefix(package_name))


@expose_substitution("find-pkg-share")
class FindPackageShare(FindPackage):
    """The share folder of a package."""

    def find(self, package_name: str) -> str:
        """The folder."""
        from ament_index_python.packages import get_package_share_directory

        return str(get_package_share_directory(package_name, print_warning=False))


@expose_substitution("exec-in-pkg")
class ExecutableInPackage(FindPackagePrefix):
    """Path of an executable of a package."""

    def __init__(self, executable: Any, package: Any) -> None:
        super().__init__(package)
        self.__executable = normalize_to_list_of_substitutions(executable)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(exec-in-pkg executable package)`."""
        if len(data) != 2:
            raise AttributeError("$(exec-in-pkg ...) takes two arguments: the executable and the package")
        return cls, {"executable": data[0], "package": data[1]}

    @property
    def executable(self) -> list[Substitution]:
        """The executable."""
        return self.__executable

    def perform(self, context: Any) -> str:
        """The path."""
        executable = perform_substitutions(context, self.__executable)
        package = perform_substitutions(context, self._package)
        try:
            folder = Path(self.find(package)) / "lib" / package
        except LookupError:
            if is_released(package):
                return f"{ELSEWHERE}/lib/{package}/{executable}"
            raise
        if not folder.exists():
            raise SubstitutionFailure(
                f"package '{package}' has no executables at all: its folder lib/{package} does not exist"
            )
        path = folder / executable
        if path.is_file() and os.access(path, os.X_OK):
            return str(path)
        raise SubstitutionFailure(_not_found(executable, package, folder, context.session.root))


def _not_found(executable: str, package: str, folder: Path, root: str) -> str:
    there = sorted(p.name for p in folder.iterdir() if p.is_file() and os.access(p, os.X_OK))
    if (folder / executable).is_file():
        return f"executable '{executable}' of package '{package}' is there, but may not be executed (chmod +x)"
    listed = ", ".join(there) or "nothing"
    entry = missing_entry_point(executable, package, root)
    if entry is not None:
        return (
            f"executable '{executable}' not found in package '{package}': its file {entry[0]} is there, "
            f"but {entry[1]} does not install it ({entry[2]} is missing). The package has: {listed}"
        )
    close = difflib.get_close_matches(executable.removesuffix(".py"), there, n=1)
    meant = f"; did you mean '{close[0]}'?" if close else "."
    return f"executable '{executable}' not found in package '{package}'{meant} The package has: {listed}"


@expose_substitution("param")
class Parameter(Substitution):
    """The value of a parameter set for all nodes of the scope."""

    def __init__(self, name: Any, *, default: Any = None) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)
        self.__default = None if default is None else texts_and_substitutions(default)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(param name [default])`."""
        if not 1 <= len(data) <= 2:
            raise TypeError("$(param ...) takes 1 to 2 arguments: the name, and a default")
        return cls, dict(zip(("name", "default"), data, strict=False))

    @property
    def name(self) -> list[Substitution]:
        """Name of the parameter."""
        return self.__name

    def perform(self, context: Any) -> str:
        """The value as text."""
        name = perform_substitutions(context, self.__name)
        for item in context.launch_configurations.get("global_params", []):
            if isinstance(item, tuple) and item[0] == name:
                return str(item[1])
        if self.__default is not None:
            return perform_substitutions(context, self.__default)
        raise SubstitutionFailure(f"parameter '{name}' was not set with SetParameter in this scope")
