"""Sources of launch descriptions."""

from __future__ import annotations

import difflib
import inspect
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from launch_plan.inside.problems import mistake

from .._base import POSITIONAL, Field, InvalidLaunchFileError, Text
from .._description import LaunchDescription, LaunchDescriptionSource
from ..frontend import InvalidFrontendLaunchFileError, Parser, markup_of, read_entity


class InvalidPythonLaunchFileError(InvalidLaunchFileError):
    """Raised for a Python launch file without its function."""


def load_python_launch_file_as_module(python_launch_file_path: str) -> ModuleType:
    """Execute a Python launch file as a module outside of `sys.modules`."""
    loader = SourceFileLoader("python_launch_file", python_launch_file_path)
    spec = spec_from_loader(loader.name, loader)
    if spec is None:
        raise RuntimeError(f"'{python_launch_file_path}' cannot be loaded")
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def get_launch_description_from_python_launch_file(python_launch_file_path: str) -> Any:
    """Return the launch description of a Python launch file."""
    module = load_python_launch_file_as_module(python_launch_file_path)
    function = getattr(module, "generate_launch_description", None)
    if not callable(function):
        raise _no_function(module, python_launch_file_path)
    try:
        description = function()
    except TypeError as error:
        error.__dict__.setdefault("launch_source", _written_at(function, python_launch_file_path))
        raise
    if isinstance(description, LaunchDescription):
        return description
    remedy = "End the function with 'return LaunchDescription([...])'."
    if inspect.iscoroutine(description):
        description.close()
        remedy = "Write 'def', not 'async def': the function is called, and nobody awaits it."
    elif inspect.isgenerator(description):
        remedy = "Write 'return LaunchDescription([...])' instead of 'yield'."
    message = f"generate_launch_description() returns {_named(description)}"
    wrong = mistake(AttributeError, message, "wrong_return", remedy)
    wrong.launch_source = _written_at(function, python_launch_file_path)
    raise wrong


def _no_function(module: ModuleType, file: str) -> Any:
    """Return the error for a file without the function, at the line of the function with the likeliest name."""
    message = "the launch file has no function generate_launch_description()"
    if hasattr(module, "generate_launch_description"):
        named = _named(module.generate_launch_description)
        message = f"generate_launch_description must be a function, but it is {named}"
    lines: dict[str, int] = {}
    for name, value in vars(module).items():
        code = None if name.startswith("__") else getattr(value, "__code__", None)
        if code is not None:
            lines[name] = code.co_firstlineno
    line = None
    remedy = (
        "rite a function 'def generate_launch_description():' that returns a LaunchDescription."
    )
    meant = difflib.get_close_matches("generate_launch_description", lines, n=1)
    if meant:
        line = lines[meant[0]]
        remedy = f"Rename '{meant[0]}': w{remedy}"
    else:
        remedy = f"W{remedy}"
    error = mistake(InvalidPythonLaunchFileError, message, "no_generate_function", remedy)
    error.__dict__.update(launch_file=file, launch_line=line)
    return error


def _written_at(function: Any, file: str) -> tuple[str, int]:
    code = getattr(function, "__code__", None)
    return getattr(code, "co_filename", file), getattr(code, "co_firstlineno", 1)


def _named(description: Any) -> str:
    return "nothing" if description is None else f"a {type(description).__name__}"


def get_launch_description_from_frontend_launch_file(
    launch_file_path: str, parser: Any = None
) -> Any:
    """Return the launch description of an XML or YAML launch file."""
    return Parser().parse_description(read_entity(launch_file_path))


def get_launch_description_from_any_launch_file(launch_file_path: str, parser: Any = None) -> Any:
    """Return the launch description of a launch file, in the language of its name or of its beginning."""
    path = Path(launch_file_path)
    is_markup = path.suffix in (".xml", ".yaml", ".yml")
    if not is_markup and path.suffix != ".py":
        text = path.read_text(encoding="utf-8", errors="replace")
        is_markup = markup_of(text) is not None
    if is_markup:
        return get_launch_description_from_frontend_launch_file(launch_file_path)
    return get_launch_description_from_python_launch_file(launch_file_path)


class _FileSource(LaunchDescriptionSource):
    """A launch file, to be read by a function."""

    launch_description = location = None
    method = Field("launch file")
    launch_file_path = Text(positional=POSITIONAL)

    def made(self) -> None:
        self.location = self.launch_file_path
        super().made()


class PythonLaunchDescriptionSource(_FileSource):
    def _get_launch_description(self, location: str) -> Any:
        return get_launch_description_from_python_launch_file(location)


class FrontendLaunchDescriptionSource(_FileSource):
    parser = Field(None)

    def _get_launch_description(self, location: str) -> Any:
        return get_launch_description_from_frontend_launch_file(location)


class XMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """An XML launch file."""


class YAMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A YAML launch file."""


class AnyLaunchDescriptionSource(_FileSource):
    def _get_launch_description(self, location: str) -> Any:
        return get_launch_description_from_any_launch_file(location)
