"""Substitutions: texts known only during the launch."""

from __future__ import annotations

import collections.abc
import importlib
import math
import os
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

from launch_plan.inside.problems import configuration_remedy, missing_program, mistake

from .._base import (
    POSITIONAL,
    Field,
    Substitution,
    SubstitutionFailure,
    Text,
    Texts,
    as_default,
    expose_substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from ..utilities.type_utils import is_substitution, perform_typed_substitution


def _failure(message: str, kind: str, remedy: str) -> Any:
    return mistake(SubstitutionFailure, message, kind, remedy)


class TextSubstitution(Substitution):
    text: Any = Field(types=str, remedy="Give text.")

    def describe(self) -> str:
        return f"'{self.text}'"

    def perform(self, context: Any) -> str:
        return str(self.text)


@expose_substitution("var")
class LaunchConfiguration(Substitution):
    """The value of a launch configuration; always text."""

    variable_name = Text(positional=POSITIONAL)
    default = Text(None, normal=as_default)

    def describe(self) -> str:
        return f"LaunchConfig({self.described('variable_name')})"

    def perform(self, context: Any) -> str:
        name = self.text("variable_name", context)
        known = context.launch_configurations
        if name in known:
            return known[name]  # type: ignore[no-any-return]
        if self.default is None:
            message = f"launch configuration '{name}' does not exist"
            remedy = configuration_remedy(name, known)
            raise _failure(message, "undefined_configuration", remedy)
        return self.text("default", context)


@expose_substitution("env")
class EnvironmentVariable(Substitution):
    name = Text(positional=POSITIONAL)
    default_value = Text(None)

    def perform(self, context: Any) -> str:
        name = self.text("name", context)
        if name in context.environment:
            return str(context.environment[name])
        if self.default_value is None:
            message = f"environment variable '{name}' does not exist"
            remedy = "Set the variable, or give default_value=."
            raise _failure(message, "undefined_variable", remedy)
        return self.text("default_value", context)


@expose_substitution("find-exec")
class FindExecutable(Substitution):
    name = Text()

    def perform(self, context: Any) -> str:
        name = self.text("name", context)
        found = shutil.which(name)
        if found is None:
            raise _no_program(f"executable '{name}' not found on the PATH", name, "unknown_program")
        return found


def _no_program(message: str, program: str, kind: str) -> Any:
    absent = missing_program(program)
    if absent is None:
        return _failure(message, kind, "Install the program, or give its path.")
    kind, message, remedy = absent
    error = _failure(message, kind, remedy)
    error.name = program
    return error


@expose_substitution("anon")
class AnonName(Substitution):
    """A unique name; equal names give equal results in one launch."""

    name = Text(positional=POSITIONAL)

    def perform(self, context: Any) -> str:
        name = self.text("name", context)
        made: dict[str, str] = context.launch_configurations.setdefault("anon", {})
        number = next(context.anonymous_numbers)
        return made.setdefault(name, f"{name}_{os.getpid()}_{number}")


class LocalSubstitution(Substitution):
    expression = Field(positional=POSITIONAL)
    description = Field(None, POSITIONAL)

    def describe(self) -> str:
        return f"LocalVar('{self.description or self.expression}')"

    def perform(self, context: Any) -> str:
        return str(eval("context.locals." + self.expression, {}, {"context": context}))


class PathJoinSubstitution(Substitution):
    """A path of parts, each a text or a list of texts; the operator `/` adds a part."""

    substitutions = Texts(positional=POSITIONAL)

    def __truediv__(self, additional_path: Any) -> PathJoinSubstitution:
        added = normalize_to_list_of_substitutions(additional_path)
        return PathJoinSubstitution([*self.substitutions, added])

    def perform(self, context: Any) -> str:
        parts = [perform_substitutions(context, part) for part in self.substitutions]
        return os.path.join(*parts)  # noqa: PTH118 - keeps what the real one keeps: "./", a trailing slash


class PathSubstitution(PathJoinSubstitution):
    """A path of one part, for the operator `/`."""

    substitutions = None
    path = Text(positional=POSITIONAL)

    def __truediv__(self, additional_path: Any) -> PathJoinSubstitution:
        return PathJoinSubstitution([[self], additional_path])

    def perform(self, context: Any) -> str:
        return self.text("path", context)


@expose_substitution("eval")
class PythonExpression(Substitution):
    """The value of a Python expression, as text."""

    _TYPES = (str, Substitution, collections.abc.Iterable)

    expression = Text(positional=POSITIONAL, types=_TYPES)
    python_modules = Text(("math",), POSITIONAL, types=_TYPES)

    @classmethod
    def parse(cls, data: Any) -> Any:
        # The form is $(eval 'expression' ['modules']), with commas between the names of modules.
        made, kwargs = super().parse(data)
        if "python_modules" in kwargs:
            names = "".join(sub.text for sub in kwargs["python_modules"])
            kwargs["python_modules"] = [name.strip() for name in names.split(",")]
        return made, kwargs

    def perform(self, context: Any) -> str:
        scope = self._scope(context)
        text = self.text("expression", context)
        try:
            return str(eval(text, {}, scope))
        except Exception as error:
            remedy = "Texts need quotes inside the expression: [\"'\", LaunchConfiguration(...), \"' == 'x'\"]."
            if str(error).startswith(("name 'true' is", "name 'false' is")):
                remedy = "The expression is read as Python, which writes True and False."
            message = f"{type(error).__name__}: {error} (the expression was: {text})"
            raise _failure(message, "bad_expression", remedy) from error

    def _scope(self, context: Any) -> dict[str, Any]:
        """Return the names for the expression: the modules, and the functions of `math`."""
        scope: dict[str, Any] = {}
        for sub in self.python_modules:
            module = importlib.import_module(context.perform_substitution(sub))
            if module is math:
                scope.update(vars(module))
            scope[module.__name__] = module
        return scope


@expose_substitution("command")
class Command(Substitution):
    command = Text(positional=POSITIONAL)
    on_stderr = Text("fail")

    def perform(self, context: Any) -> str:
        line = self.text("command", context)
        on_stderr = self.text("on_stderr", context)
        if on_stderr not in ("fail", "ignore", "warn", "capture"):
            message = f"on_stderr must be fail, ignore, warn or capture, not '{on_stderr}'"
            raise _failure(message, "exception", "Use one of these words.")
        done = _run(line, on_stderr)
        said = f", which said: {done.stderr.strip()}" if done.stderr else ""
        remedy = "Run the command by hand and correct what it says."
        if done.returncode != 0:
            message = f"command '{line}' failed with exit status {done.returncode}{said}"
            raise _failure(message, "command_failed", remedy)
        message = f"command '{line}' wrote to standard error{said}"
        if done.stderr and on_stderr == "fail":
            raise _failure(message, "command_failed", remedy)
        if done.stderr and on_stderr == "warn":
            context.session.warn(message, self)
        return done.stdout


def _run(line: str, on_stderr: str) -> subprocess.CompletedProcess[str]:
    """Run a command line to its end; `capture` adds standard error to the output."""
    stderr = subprocess.STDOUT if on_stderr == "capture" else subprocess.PIPE
    words = shlex.split(line)
    try:
        return subprocess.run(words, stdout=subprocess.PIPE, stderr=stderr, text=True, check=False)
    except FileNotFoundError as error:
        message = f"command not found: '{words[0]}'"
        raise _no_program(message, words[0], "command_failed") from error


class _Local(PathSubstitution):
    """A local of the context, present only inside a launch file."""

    path = None
    _local = ""

    def perform(self, context: Any) -> str:
        known = context.get_locals_as_dict()
        if self._local not in known:
            message = f"{type(self).__name__} has a value only inside a launch file"
            raise _failure(message, "exception", "Use it in a launch file.")
        return str(known[self._local])


@expose_substitution("dirname")
class ThisLaunchFileDir(_Local):
    _local = "current_launch_file_directory"


@expose_substitution("filename")
class ThisLaunchFile(_Local):
    _local = "current_launch_file_path"


@expose_substitution("launch_log_dir")
@expose_substitution("log_dir")
class LaunchLogDir(PathSubstitution):
    path = None

    def perform(self, context: Any) -> str:
        return os.environ.get("ROS_LOG_DIR") or str(Path.home() / ".ros" / "log")


@expose_substitution("file-content")
class FileContent(Substitution):
    path = Text(positional=POSITIONAL)

    def perform(self, context: Any) -> str:
        path = self.text("path", context)
        try:
            return Path(path).read_text()
        except OSError as error:
            message = f"file '{path}' cannot be read: {error.strerror}"
            remedy = "Correct the path, or hand the file in."
            raise _failure(message, "exception", remedy) from error


class _Logical(Substitution):
    """A truth value computed from others, as text."""

    def truth(self, subs: Any, context: Any) -> bool:
        try:
            return bool(perform_typed_substitution(context, subs, bool))
        except (TypeError, ValueError) as error:
            remedy = (
                "Give a value of the type that is asked for, or a text that can be read as one."
            )
            raise _failure(str(error), "bad_parameter_value", remedy) from error

    def perform(self, context: Any) -> str:
        return str(self.holds(context)).lower()

    #: Function of the truth values, which are all resolved before.
    decide: Any = staticmethod(all)

    def operands(self) -> list[Any]:
        return list(self.given.values())

    def holds(self, context: Any) -> bool:
        return bool(self.decide([self.truth(subs, context) for subs in self.operands()]))


@expose_substitution("if")
class IfElseSubstitution(_Logical):
    condition = Text(positional=POSITIONAL)
    if_value = Text("", POSITIONAL)
    else_value = Text("", POSITIONAL)
    least = 2

    def __init__(self, condition: Any, if_value: Any = "", else_value: Any = "") -> None:
        if if_value == else_value == "":
            raise RuntimeError("IfElseSubstitution needs an if_value, an else_value, or both")
        super().__init__(condition, if_value, else_value)

    def perform(self, context: Any) -> str:
        chosen = "if_value" if self.truth(self.condition, context) else "else_value"
        return self.text(chosen, context)


@expose_substitution("not")
class NotSubstitution(_Logical):
    value = Text(positional=POSITIONAL)
    decide = staticmethod(lambda truths: not truths[0])


@expose_substitution("and")
class AndSubstitution(_Logical):
    left = Text(positional=POSITIONAL)
    right = Text(positional=POSITIONAL)


@expose_substitution("or")
class OrSubstitution(AndSubstitution):
    decide = staticmethod(any)


@expose_substitution("all")
class AllSubstitution(_Logical):
    """True if all of several truth values are."""

    def __init__(self, *args: Any) -> None:
        super().__init__()
        self.args = [normalize_to_list_of_substitutions(arg) for arg in args]

    @classmethod
    def parse(cls, data: Any) -> Any:
        return lambda args: cls(*args), {"args": data}

    def describe(self) -> str:
        words: list[str] = []
        for arg in self.args:
            words.extend(sub.describe() for sub in arg)
        return f"{type(self).__name__}({', '.join(words)})"

    def operands(self) -> list[Any]:
        return self.args


@expose_substitution("any")
class AnySubstitution(AllSubstitution):
    decide = staticmethod(any)


def _comparable(value: Any) -> list[Substitution]:
    if is_substitution(value):
        return normalize_to_list_of_substitutions(value)
    if value is None:
        return normalize_to_list_of_substitutions("")
    text = str(value)
    return normalize_to_list_of_substitutions(text.lower() if isinstance(value, bool) else text)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


@expose_substitution("equals")
class EqualsSubstitution(_Logical):
    """True if two texts are the same truth value, number, or text."""

    left = Text(positional=POSITIONAL, normal=_comparable)
    right = Text(positional=POSITIONAL, normal=_comparable)

    def holds(self, context: Any) -> bool:
        left = self.text("left", context)
        right = self.text("right", context)
        truths = {"true": True, "1": True, "false": False, "0": False}
        if left.lower() in truths and right.lower() in truths:
            return truths[left.lower()] == truths[right.lower()]
        first = _number(left)
        second = _number(right)
        if first is None or second is None:
            return left == right
        return math.isclose(first, second)


@expose_substitution("not-equals")
class NotEqualsSubstitution(EqualsSubstitution):
    def holds(self, context: Any) -> bool:
        return not super().holds(context)
