"""Reading launch files."""

from __future__ import annotations

import inspect
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from ._base import InvalidLaunchFileError
from ._description import LaunchDescription, LaunchDescriptionSource


class InvalidPythonLaunchFileError(InvalidLaunchFileError):
    """A Python launch file lacks what it must have."""

    def __init__(self, message: str) -> None:
        Exception.__init__(self, message)
        self.likely_errors = ()


class WrongReturnError(AttributeError):
    """`generate_launch_description` returns something else than a launch description."""


def load_python_launch_file_as_module(python_launch_file_path: str) -> ModuleType:
    """Run a Python launch file as a module that is not registered anywhere."""
    loader = SourceFileLoader("python_launch_file", python_launch_file_path)
    spec = spec_from_loader(loader.name, loader)
    if spec is None:
        raise RuntimeError(f"'{python_launch_file_path}' cannot be loaded")
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def get_launch_description_from_python_launch_file(python_launch_file_path: str) -> Any:
    """The launch description that a Python launch file generates.

    Raises
    ------
    InvalidPythonLaunchFileError
        It has no function for it.
    WrongReturnError
        The function returns something else.
    """
    module = load_python_launch_file_as_module(python_launch_file_path)
    if not hasattr(module, "generate_launch_description"):
        error = InvalidPythonLaunchFileError("the launch file has no function generate_launch_description()")
        error.launch_file = python_launch_file_path  # type: ignore[attr-defined]
        error.module_names = {  # type: ignore[attr-defined]
            name: getattr(getattr(value, "__code__", None), "co_firstlineno", None)
            for name, value in vars(module).items()
            if not name.startswith("__")
        }
        raise error
    function = module.generate_launch_description
    if not callable(function):
        message = f"generate_launch_description must be a function, but it is {_named(function)}"
        no_function = InvalidPythonLaunchFileError(message)
        no_function.launch_file = python_launch_file_path  # type: ignore[attr-defined]
        raise no_function
    try:
        description = function()
    except TypeError as error:
        if not hasattr(error, "launch_source"):
            error.launch_source = _written_at(function, python_launch_file_path)  # type: ignore[attr-defined]
        raise
    if not isinstance(description, LaunchDescription):
        if inspect.iscoroutine(description):
            description.close()
        wrong = WrongReturnError(f"generate_launch_description() returns {_named(description)}")
        wrong.launch_source = _written_at(function, python_launch_file_path)  # type: ignore[attr-defined]
        raise wrong
    return description


def _written_at(function: Any, file: str) -> tuple[str, int]:
    code = getattr(function, "__code__", None)
    return getattr(code, "co_filename", file), getattr(code, "co_firstlineno", 1)


def _named(description: Any) -> str:
    return "nothing" if description is None else f"a {type(description).__name__}"


def get_launch_description_from_frontend_launch_file(launch_file_path: str, parser: Any = None) -> Any:
    """The launch description that an XML or YAML launch file holds."""
    from .frontend import read_launch_file

    return read_launch_file(launch_file_path)


def get_launch_description_from_any_launch_file(launch_file_path: str, parser: Any = None) -> Any:
    """The launch description of a launch file, whose format its name tells.

    Raises
    ------
    InvalidLaunchFileError
        The file is not of that format.
    """
    from .frontend import markup_of

    extension = Path(launch_file_path).suffix.lstrip(".")
    if extension in ("xml", "yaml", "yml"):
        return get_launch_description_from_frontend_launch_file(launch_file_path)
    if extension != "py" and markup_of(Path(launch_file_path).read_text(encoding="utf-8", errors="replace")):
        return get_launch_description_from_frontend_launch_file(launch_file_path)
    return get_launch_description_from_python_launch_file(launch_file_path)


class PythonLaunchDescriptionSource(LaunchDescriptionSource):
    """A Python launch file."""

    def __init__(self, launch_file_path: Any) -> None:
        super().__init__(None, launch_file_path, "interpreted python launch file")

    def _get_launch_description(self, location: str) -> Any:
        return get_launch_description_from_python_launch_file(location)


class FrontendLaunchDescriptionSource(LaunchDescriptionSource):
    """An XML or YAML launch file."""

    def __init__(
        self, launch_file_path: Any, *, method: str = "interpreted frontend launch file", parser: Any = None
    ) -> None:
        super().__init__(None, launch_file_path, method)

    def _get_launch_description(self, location: str) -> Any:
        return get_launch_description_from_frontend_launch_file(location)


class XMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """An XML launch file."""

    def __init__(self, launch_file_path: Any) -> None:
        super().__init__(launch_file_path, method="interpreted XML launch file")


class YAMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A YAML launch file."""

    def __init__(self, launch_file_path: Any) -> None:
        super().__init__(launch_file_path, method="interpreted YAML launch file")


class AnyLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file of any format."""

    def __init__(self, launch_file_path: Any) -> None:
        super().__init__(None, launch_file_path, "interpreted from any launch file")

    def _get_launch_description(self, location: str) -> Any:
        return get_launch_description_from_any_launch_file(location)
