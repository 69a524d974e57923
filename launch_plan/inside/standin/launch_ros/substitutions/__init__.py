"""Substitutions about ROS packages."""

from __future__ import annotations

from typing import Any

from launch._base import (
    POSITIONAL,
    Substitution,
    SubstitutionFailure,
    Text,
    as_default,
    expose_substitution,
)
from launch.substitutions import PathSubstitution

from launch_plan.inside.installed import find_executable
from launch_plan.inside.problems import mistake


class FindPackage(PathSubstitution):
    """A path of an installed package."""

    path = None
    package = Text(positional=POSITIONAL)

    def find(self, package_name: str) -> str:
        raise NotImplementedError

    def perform(self, context: Any) -> str:
        return self.find(self.text("package", context))


@expose_substitution("find-pkg-prefix")
class FindPackagePrefix(FindPackage):
    def find(self, package_name: str) -> str:
        from ament_index_python.packages import get_package_prefix

        return str(get_package_prefix(package_name))


@expose_substitution("find-pkg-share")
class FindPackageShare(FindPackage):
    def find(self, package_name: str) -> str:
        from ament_index_python.packages import get_package_share_directory

        return str(get_package_share_directory(package_name, print_warning=False))


@expose_substitution("exec-in-pkg")
class ExecutableInPackage(FindPackagePrefix):
    executable = Text(positional=POSITIONAL)
    package = Text(positional=POSITIONAL)

    def perform(self, context: Any) -> str:
        executable = self.text("executable", context)
        package = self.text("package", context)
        path: str = find_executable(executable, package, context.session.root)
        return path


@expose_substitution("param")
class Parameter(Substitution):
    """The value of a parameter set for all nodes of the scope."""

    name = Text(positional=POSITIONAL)
    default = Text(None, normal=as_default)

    def perform(self, context: Any) -> str:
        name = self.text("name", context)
        for item in context.launch_configurations.get("global_params", []):
            if isinstance(item, tuple) and item[0] == name:
                return str(item[1])
        if self.default is not None:
            return self.text("default", context)
        message = f"parameter '{name}' was not set with SetParameter in this scope"
        raise mistake(SubstitutionFailure, message, "exception", "Set it, or give a default.")
