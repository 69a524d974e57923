"""Substitutions: texts that are known only while launching."""

from __future__ import annotations

import collections.abc
import importlib
import math
import os
import shlex
import shutil
from pathlib import Path
from typing import Any

from .._base import (
    Substitution,
    SubstitutionFailure,
    ensure_argument_type,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from .._catalogue import missing_name
from ..frontend.expose import expose_substitution
from ..utilities.type_utils import is_substitution, perform_typed_substitution

__all__ = [
    "AllSubstitution",
    "AndSubstitution",
    "AnonName",
    "AnySubstitution",
    "Command",
    "EnvironmentVariable",
    "EqualsSubstitution",
    "FileContent",
    "FindExecutable",
    "IfElseSubstitution",
    "LaunchConfiguration",
    "LaunchLogDir",
    "LocalSubstitution",
    "NotEqualsSubstitution",
    "NotSubstitution",
    "OrSubstitution",
    "PathJoinSubstitution",
    "PathSubstitution",
    "PythonExpression",
    "SubstitutionFailure",
    "TextSubstitution",
    "ThisLaunchFile",
    "ThisLaunchFileDir",
]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


def _described(subs: Any) -> str:
    return " + ".join(sub.describe() for sub in subs)


class TextSubstitution(Substitution):
    """A fixed text."""

    def __init__(self, *, text: str) -> None:
        super().__init__()
        if not isinstance(text, str):
            raise TypeError(f"TextSubstitution takes a str, but {text!r} is of type '{type(text).__name__}'")
        self.__text = text

    @property
    def text(self) -> str:
        """The text."""
        return self.__text

    def describe(self) -> str:
        """Text for people."""
        return f"'{self.text}'"

    def perform(self, context: Any) -> str:
        """The text."""
        return self.__text


@expose_substitution("var")
class LaunchConfiguration(Substitution):
    """The value of a launch configuration; always text."""

    def __init__(self, variable_name: Any, *, default: Any = None) -> None:
        super().__init__()
        self.__variable_name = normalize_to_list_of_substitutions(variable_name)
        self.__default = None if default is None else texts_and_substitutions(default)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(var name [default])`."""
        _count(data, "var", 1, 2)
        return cls, {"variable_name": data[0], **({"default": data[1]} if len(data) == 2 else {})}

    @property
    def variable_name(self) -> list[Substitution]:
        """Name of the configuration."""
        return self.__variable_name

    def describe(self) -> str:
        """Text for people."""
        return f"LaunchConfig({_described(self.variable_name)})"

    def perform(self, context: Any) -> str:
        """The value."""
        name = perform_substitutions(context, self.__variable_name)
        if name in context.launch_configurations:
            return context.launch_configurations[name]  # type: ignore[no-any-return]
        if self.__default is None:
            raise SubstitutionFailure(f"launch configuration '{name}' does not exist")
        return perform_substitutions(context, self.__default)


def texts_and_substitutions(default: Any) -> list[Substitution]:
    """A default, in which everything else than substitutions is turned into text."""
    items = default if isinstance(default, collections.abc.Iterable) else (default,)
    return normalize_to_list_of_substitutions(
        [item if isinstance(item, (str, Substitution)) else str(item) for item in items]
    )


def _count(data: Any, name: str, least: int, most: int) -> None:
    if not least <= len(data) <= most:
        span = str(least) if least == most else f"{least} to {most}"
        raise TypeError(f"$({name} ...) takes {span} arguments, not {len(data)}")


@expose_substitution("env")
class EnvironmentVariable(Substitution):
    """The value of an environment variable while launching."""

    def __init__(self, name: Any, *, default_value: Any = None) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)
        self.__default = None if default_value is None else normalize_to_list_of_substitutions(default_value)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(env NAME [default])`."""
        _count(data, "env", 1, 2)
        return cls, {"name": data[0], **({"default_value": data[1]} if len(data) == 2 else {})}

    @property
    def name(self) -> list[Substitution]:
        """Name of the variable."""
        return self.__name

    @property
    def default_value(self) -> list[Substitution] | None:
        """Value if it is not set."""
        return self.__default

    def describe(self) -> str:
        """Text for people."""
        return f"EnvVar({_described(self.name)})"

    def perform(self, context: Any) -> str:
        """The value."""
        name = perform_substitutions(context, self.__name)
        if name in context.environment:
            return str(context.environment[name])
        if self.__default is None:
            raise SubstitutionFailure(f"environment variable '{name}' does not exist")
        return perform_substitutions(context, self.__default)


@expose_substitution("find-exec")
class FindExecutable(Substitution):
    """Path of a program on the PATH."""

    def __init__(self, *, name: Any) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(find-exec name)`."""
        _count(data, "find-exec", 1, 1)
        return cls, {"name": data[0]}

    @property
    def name(self) -> list[Substitution]:
        """Name of the program."""
        return self.__name

    def describe(self) -> str:
        """Text for people."""
        return f"FindExec({_described(self.name)})"

    def perform(self, context: Any) -> str:
        """The path."""
        name = perform_substitutions(context, self.__name)
        found = shutil.which(name)
        if found is None:
            raise SubstitutionFailure(f"executable '{name}' not found on the PATH")
        return found


@expose_substitution("anon")
class AnonName(Substitution):
    """A name made unique; the same name gives the same result in one launch."""

    def __init__(self, name: Any) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(anon name)`."""
        _count(data, "anon", 1, 1)
        return cls, {"name": data[0]}

    @property
    def name(self) -> list[Substitution]:
        """Name to start from."""
        return self.__name

    def describe(self) -> str:
        """Text for people."""
        return f"AnonName({_described(self.name)})"

    def perform(self, context: Any) -> str:
        """The unique name."""
        name = perform_substitutions(context, self.__name)
        made: dict[str, str] = context.launch_configurations.setdefault("anon", {})
        return made.setdefault(name, f"{name}_{os.getpid()}_{next(context.session.anonymous_numbers)}")


class LocalSubstitution(Substitution):
    """A local of the launch context."""

    def __init__(self, expression: str, description: str | None = None) -> None:
        super().__init__()
        self.__expression = expression
        self.__description = description

    @property
    def expression(self) -> str:
        """What follows `context.locals.`."""
        return self.__expression

    def describe(self) -> str:
        """Text for people."""
        return f"LocalVar('{self.__description or self.__expression}')"

    def perform(self, context: Any) -> str:
        """The text."""
        return str(eval("context.locals." + self.__expression, {}, {"context": context}))


class PathJoinSubstitution(Substitution):
    """A path joined of parts, each of which may itself be a list; `/` joins another part to it."""

    def __init__(self, substitutions: Any) -> None:
        self.__substitutions = [normalize_to_list_of_substitutions(part) for part in substitutions]

    @property
    def substitutions(self) -> list[list[Substitution]]:
        """The parts."""
        return self.__substitutions

    def __truediv__(self, additional_path: Any) -> PathJoinSubstitution:
        return PathJoinSubstitution([*self.substitutions, normalize_to_list_of_substitutions(additional_path)])

    def describe(self) -> str:
        """Text for people."""
        return f"PathJoin('{' + '.join(_described(part) for part in self.substitutions)}')"

    def perform(self, context: Any) -> str:
        """The path."""
        parts: list[str] = [perform_substitutions(context, part) for part in self.__substitutions]
        return os.path.join(*parts)  # noqa: PTH118 - keeps what the real one keeps: "./", a trailing slash


class PathSubstitution(PathJoinSubstitution):
    """A path of one part, so that `/` can be used on it."""

    def __init__(self, path: Any) -> None:
        super().__init__([path])


@expose_substitution("eval")
class PythonExpression(Substitution):
    """The value of a Python expression, as text."""

    def __init__(self, expression: Any, python_modules: Any = ("math",)) -> None:
        super().__init__()
        types = (str, Substitution, collections.abc.Iterable)
        ensure_argument_type(expression, types, "expression", "PythonExpression")
        ensure_argument_type(python_modules, types, "python_modules", "PythonExpression")
        self.__expression = normalize_to_list_of_substitutions(expression)
        self.__modules = normalize_to_list_of_substitutions(python_modules)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(eval 'expression' ['modules'])`."""
        _count(data, "eval", 1, 2)
        kwargs: dict[str, Any] = {"expression": data[0]}
        if len(data) == 2:
            names = "".join(sub.text for sub in data[1])
            kwargs["python_modules"] = [name.strip() for name in names.split(",")]
        return cls, kwargs

    @property
    def expression(self) -> list[Substitution]:
        """The expression."""
        return self.__expression

    @property
    def python_modules(self) -> list[Substitution]:
        """Modules that the expression may use."""
        return self.__modules

    def describe(self) -> str:
        """Text for people."""
        return f"PythonExpr({_described(self.expression)}, [{_described(self.python_modules)}])"

    def perform(self, context: Any) -> str:
        """The value as text."""
        scope: dict[str, Any] = {}
        for sub in self.__modules:
            module = importlib.import_module(context.perform_substitution(sub))
            if module is math:
                scope.update(vars(module))
            scope[module.__name__] = module
        text = perform_substitutions(context, self.__expression)
        try:
            return str(eval(text, {}, scope))
        except Exception as error:
            error.launch_note = f"the expression was: {text}"  # type: ignore[attr-defined]
            raise


@expose_substitution("command")
class Command(Substitution):
    """The output of a program."""

    def __init__(self, command: Any, *, on_stderr: Any = "fail") -> None:
        super().__init__()
        self.__command = normalize_to_list_of_substitutions(command)
        self.__on_stderr = normalize_to_list_of_substitutions(on_stderr)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(command 'text' ['on_stderr'])`."""
        if not 1 <= len(data) <= 2:
            raise ValueError(f"$(command ...) takes 1 to 2 arguments, not {len(data)}")
        return cls, {"command": data[0], **({"on_stderr": data[1]} if len(data) == 2 else {})}

    @property
    def command(self) -> list[Substitution]:
        """The command line."""
        return self.__command

    @property
    def on_stderr(self) -> list[Substitution]:
        """What to do with standard error."""
        return self.__on_stderr

    def describe(self) -> str:
        """Text for people."""
        return f"Command({_described(self.command)})"

    def perform(self, context: Any) -> str:
        """Run the program; its standard output."""
        import subprocess

        line = perform_substitutions(context, self.__command)
        on_stderr = perform_substitutions(context, self.__on_stderr)
        if on_stderr not in ("fail", "ignore", "warn", "capture"):
            raise SubstitutionFailure(f"on_stderr must be fail, ignore, warn or capture, not '{on_stderr}'")
        stderr = subprocess.STDOUT if on_stderr == "capture" else subprocess.PIPE
        try:
            done = subprocess.run(shlex.split(line), stdout=subprocess.PIPE, stderr=stderr, text=True, check=False)
        except FileNotFoundError as error:
            raise SubstitutionFailure(f"command not found: '{shlex.split(line)[0]}'") from error
        said = f", which said: {done.stderr.strip()}" if done.stderr else ""
        if done.returncode != 0:
            raise SubstitutionFailure(f"command '{line}' failed with exit status {done.returncode}{said}")
        if done.stderr and on_stderr == "fail":
            raise SubstitutionFailure(f"command '{line}' wrote to standard error{said}")
        if done.stderr and on_stderr == "warn":
            context.session.warn(f"command '{line}' wrote to standard error{said}", self.source_line)
        return done.stdout


@expose_substitution("dirname")
class ThisLaunchFileDir(PathSubstitution):
    """Folder of the launch file that is being read."""

    def __init__(self) -> None:
        super().__init__(self)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(dirname)`."""
        _count(data, "dirname", 0, 0)
        return cls, {}

    def describe(self) -> str:
        """Text for people."""
        return "ThisLaunchFileDir()"

    def perform(self, context: Any) -> str:
        """The folder."""
        if "current_launch_file_directory" not in context.get_locals_as_dict():
            raise SubstitutionFailure("ThisLaunchFileDir has a value only inside a launch file")
        return str(context.locals.current_launch_file_directory)


@expose_substitution("filename")
class ThisLaunchFile(Substitution):
    """Path of the launch file that is being read."""

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(filename)`."""
        _count(data, "filename", 0, 0)
        return cls, {}

    def describe(self) -> str:
        """Text for people."""
        return "ThisLaunchFile()"

    def perform(self, context: Any) -> str:
        """The path."""
        if "current_launch_file_path" not in context.get_locals_as_dict():
            raise SubstitutionFailure("ThisLaunchFile has a value only inside a launch file")
        return str(context.locals.current_launch_file_path)


@expose_substitution("launch_log_dir")
@expose_substitution("log_dir")
class LaunchLogDir(PathSubstitution):
    """Folder of the log files."""

    def __init__(self) -> None:
        super().__init__(self)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(log_dir)`."""
        _count(data, "log_dir", 0, 0)
        return cls, {}

    def describe(self) -> str:
        """Text for people."""
        return "LaunchLogDir()"

    def perform(self, context: Any) -> str:
        """The folder."""
        return os.environ.get("ROS_LOG_DIR") or str(Path.home() / ".ros" / "log")


@expose_substitution("file-content")
class FileContent(Substitution):
    """What a file says."""

    def __init__(self, path: Any) -> None:
        super().__init__()
        self.__path = normalize_to_list_of_substitutions(path)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(file-content path)`."""
        _count(data, "file-content", 1, 1)
        return cls, {"path": data[0]}

    @property
    def path(self) -> list[Substitution]:
        """Path of the file."""
        return self.__path

    def describe(self) -> str:
        """Text for people."""
        return f"FileContent({_described(self.path)})"

    def perform(self, context: Any) -> str:
        """The text."""
        path = perform_substitutions(context, self.__path)
        try:
            return Path(path).read_text()
        except OSError as error:
            raise SubstitutionFailure(f"file '{path}' cannot be read: {error.strerror}") from error


@expose_substitution("if")
class IfElseSubstitution(Substitution):
    """One of two texts."""

    def __init__(self, condition: Any, if_value: Any = "", else_value: Any = "") -> None:
        super().__init__()
        if if_value == else_value == "":
            raise RuntimeError("IfElseSubstitution needs an if_value, an else_value, or both")
        self.__condition = normalize_to_list_of_substitutions(condition)
        self.__if_value = normalize_to_list_of_substitutions(if_value)
        self.__else_value = normalize_to_list_of_substitutions(else_value)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(if condition [a [b]])`."""
        _count(data, "if", 2, 3)
        return cls, dict(zip(("condition", "if_value", "else_value"), data, strict=False))

    def describe(self) -> str:
        """Text for people."""
        return f"IfElseSubstitution({_described(self.__condition)})"

    def perform(self, context: Any) -> str:
        """The text that the condition chooses."""
        chosen = self.__if_value if _truth(context, self.__condition) else self.__else_value
        return perform_substitutions(context, chosen)


def _truth(context: Any, subs: list[Substitution]) -> bool:
    try:
        return bool(perform_typed_substitution(context, subs, bool))
    except (TypeError, ValueError) as error:
        raise SubstitutionFailure(str(error)) from error


@expose_substitution("not")
class NotSubstitution(Substitution):
    """The opposite of a truth value."""

    def __init__(self, value: Any) -> None:
        super().__init__()
        self.__value = normalize_to_list_of_substitutions(value)

    @classmethod
    def parse(cls, data: Any) -> Any:
        """From `$(not value)`."""
        _count(data, "not", 1, 1)
        return cls, {"value": data[0]}

    @property
    def value(self) -> list[Substitution]:
        """The truth value."""
        return self.__value

    def describe(self) -> str:
        """Text for people."""
        return f"NotSubstitution({_described(self.__value)})"

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        return str(not _truth(context, self.__value)).lower()


class _Pair(Substitution):
    _word = ""

    def __init__(self, left: Any, right: Any) -> None:
        super().__init__()
        self._left = normalize_to_list_of_substitutions(left)
        self._right = normalize_to_list_of_substitutions(right)

    @classmethod
    def parse(cls, data: Any) -> Any:
        _count(data, cls._word, 2, 2)
        return cls, {"left": data[0], "right": data[1]}

    @property
    def left(self) -> list[Substitution]:
        return self._left

    @property
    def right(self) -> list[Substitution]:
        return self._right

    def describe(self) -> str:
        return f"{type(self).__name__}({_described(self._left)}, {_described(self._right)})"


@expose_substitution("and")
class AndSubstitution(_Pair):
    """Whether both truth values hold."""

    _word = "and"

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        left, right = _truth(context, self._left), _truth(context, self._right)
        return str(left and right).lower()


@expose_substitution("or")
class OrSubstitution(_Pair):
    """Whether one of two truth values holds."""

    _word = "or"

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        left, right = _truth(context, self._left), _truth(context, self._right)
        return str(left or right).lower()


class _Several(Substitution):
    def __init__(self, *args: Any) -> None:
        super().__init__()
        self._args = [normalize_to_list_of_substitutions(arg) for arg in args]

    @classmethod
    def parse(cls, data: Any) -> Any:
        return lambda args: cls(*args), {"args": data}

    @property
    def args(self) -> list[list[Substitution]]:
        return self._args

    def describe(self) -> str:
        return f"{type(self).__name__}({', '.join(_described(arg) for arg in self._args)})"


@expose_substitution("any")
class AnySubstitution(_Several):
    """Whether one of several truth values holds."""

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        return str(any([_truth(context, arg) for arg in self._args])).lower()  # noqa: C419 - resolves all


@expose_substitution("all")
class AllSubstitution(_Several):
    """Whether several truth values all hold."""

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        return str(all([_truth(context, arg) for arg in self._args])).lower()  # noqa: C419 - resolves all


def _comparable(value: Any) -> Any:
    if is_substitution(value):
        return value
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@expose_substitution("equals")
class EqualsSubstitution(_Pair):
    """Whether two texts are the same truth value, number, or text."""

    _word = "equals"

    def __init__(self, left: Any, right: Any) -> None:
        super().__init__(_comparable(left), _comparable(right))

    def _equal(self, context: Any) -> bool:
        left = perform_substitutions(context, self._left)
        right = perform_substitutions(context, self._right)
        words = ("true", "false", "1", "0")
        if left.lower() in words and right.lower() in words:
            return (left.lower() in ("true", "1")) == (right.lower() in ("true", "1"))
        if _is_number(left) and _is_number(right):
            return math.isclose(float(left), float(right))
        return left == right

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        return str(self._equal(context)).lower()


@expose_substitution("not-equals")
class NotEqualsSubstitution(EqualsSubstitution):
    """Whether two texts differ."""

    def perform(self, context: Any) -> str:
        """`true` or `false`."""
        return str(not self._equal(context)).lower()
