"""The plan of a launch file: the processes that would start, with their command lines and moments.

A plan is data, to be run, kept or shown. Unknown keys of an evaluator's answer are left out.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from itertools import accumulate, pairwise
from operator import or_
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from launch_plan.format import NO_JSON, PARAMETERS_PLACEHOLDER, PROCESS_LIMIT, SCHEMA

#: Largest plan of an evaluation. A launch file may write a larger answer by itself.
_MOST_FILES, _DEEPEST = 2000, 60
#: Largest line number, and largest time in seconds.
_LARGEST = 10**9
#: Most names in the full name of a node, because that has at most 255 characters.
_MOST_NAMES = 128
#: Longest path and longest name of a file on Linux, in bytes.
_LONGEST_NAME, _LONGEST_FILE_NAME = 4096, 255
_NO_MOMENT = "a start must wait for a time in seconds or for an event of a process"


#: Name of a package or of an executable.
_PLAIN_NAME = re.compile(r"[\w+-][\w.+-]{0,199}")


class MalformedPlanError(ValueError):
    """Raised for data that is not a plan."""


def _as_text(value: Any) -> Any:
    """Write a number or a truth value as text; lists and mappings are left for the type check to refuse."""
    if isinstance(value, (Mapping, list, tuple)):
        return value
    return str(value)


def _require_folder(path: str) -> str:
    """Refuse a relative path and steps upwards, because an evaluation resolves both."""
    if not path.startswith("/") or ".." in PurePosixPath(path).parts:
        raise ValueError("a working folder must be an absolute path without steps upwards")
    return path


def _require_file_name(name: str) -> str:
    """Refuse a text that names no file directly in a folder, e.g. `..` or `a/b`."""
    if not _is_file_name(name):
        raise ValueError("not a name for a file of a launch plan")
    return name


def _is_file_name(name: str) -> bool:
    """Tell whether a text names a file directly in a folder."""
    if name in ("", ".", ".."):
        return False
    if {"/", "\0"} & set(name):
        return False
    return len(os.fsencode(name)) <= _LONGEST_FILE_NAME


def _require_moment(when: Mapping[str, Any]) -> Mapping[str, Any]:
    """Refuse an infinite time, and an event of something other than a process."""
    names = [value for key, value in when.items() if key.endswith("_of")]
    if not all(isinstance(name, str) for name in names):
        raise ValueError(_NO_MOMENT)
    after_s = when.get("after_s", 0)
    if not isinstance(after_s, (int, float)):
        raise ValueError(_NO_MOMENT)
    if not abs(after_s) <= _LARGEST:
        raise ValueError(_NO_MOMENT)
    return when


def _with_doubles(value: Any) -> Any:
    """Return the value of a parameter with numbers instead of e.g. `{"!!float": "inf"}`."""
    if isinstance(value, list):
        return [_with_doubles(item) for item in value]
    if not isinstance(value, Mapping):
        return value
    if set(value) == {NO_JSON} and value[NO_JSON] in ("inf", "-inf", "nan"):
        return float(value[NO_JSON])
    return {name: _with_doubles(item) for name, item in value.items()}


# Types are not converted, except scalars to text where a launch file may give any scalar.
_Text = Annotated[str, BeforeValidator(_as_text)]
_Word = Annotated[str, Field(pattern=r"^[^\x00]*$")]
_Path = Annotated[_Word, Field(max_length=_LONGEST_NAME)]
_Line = Annotated[int, Strict(), Field(ge=-_LARGEST, le=_LARGEST)]
_Seconds = Annotated[float, Strict(), Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
_Flag = Annotated[bool, Strict()]
_Value = Annotated[Any, BeforeValidator(_with_doubles)]
_Moment = Annotated[Mapping[str, Any], AfterValidator(_require_moment)]
_Texts = Mapping[_Text, _Text]
_Files = Mapping[Annotated[str, AfterValidator(_require_file_name)], _Text]
_Environment = Mapping[_Word, Annotated[_Word, BeforeValidator(_as_text)]]
_Remappings = tuple[tuple[_Text, _Text], ...]


@dataclass(frozen=True)
class Problem:
    """Reason why a launch file cannot be launched, or cannot be assessed."""

    #: A slug, such as `unknown_executable`.
    kind: str
    message: str
    #: Path relative to the submission.
    file: str | None = None
    #: Line of `file`, counted from 1.
    line: _Line | None = None
    #: Instruction for the author, e.g. "Correct the import."
    remedy: str = ""
    #: The module missing here, for a launch file that is not assessable.
    module: str = ""


@dataclass(frozen=True)
class Argument:
    """A declared launch argument; `default` is None if it must be given."""

    name: str
    default: str | None = None
    description: str = ""
    choices: tuple[_Text, ...] | None = None
    file: str | None = None
    line: _Line | None = None


@dataclass(frozen=True)
class Parameter:
    """One parameter (`name`, `value`, `type`) or one file of them (`file`, `content`), in the order given."""

    name: str | None = None
    value: _Value = None
    type: str | None = None
    file: str | None = None
    content: _Value = None
    #: True for a parameter on the command line, which any node of the process gets.
    wildcard: _Flag = False

    def sections(self) -> list[tuple[str, dict[str, Any]]]:
        """Return the sections of a file: a pattern of nodes, e.g. `/arm/*`, and the values by name."""
        if not isinstance(self.content, Mapping):
            return []
        found = []
        for pattern, values in _sections(self.content, ""):
            found.append((pattern, _flat(values, "")))
        return found


@dataclass(frozen=True)
class Component:
    """A node to be loaded into a container."""

    plugin: str | None = None
    name: str | None = None


@dataclass(frozen=True)
class Process:
    """One process of a plan."""

    #: Name with a running number, as `ros2 launch` shows it.
    id: _Path
    path: _Path
    #: `node`, `lifecycle_node`, `container` or `executable`.
    kind: str = "executable"
    package: str | None = None
    executable: str | None = None
    name: _Path | None = None
    namespace: _Path | None = None
    #: Words before `path` in the command line; `argv` follows `path`. The text `{parameters}` in `argv` stands for a
    #: folder with `parameter_files`, chosen by the runner.
    prefix: tuple[_Word, ...] = ()
    argv: tuple[_Word, ...] = ()
    #: Variables that differ from the environment of the launch.
    env: _Environment = field(default_factory=dict)
    cwd: Annotated[_Path, AfterValidator(_require_folder)] | None = None
    parameters: tuple[Parameter, ...] = ()
    remappings: _Remappings = ()
    output: Any = "log"
    respawn: _Flag = False
    respawn_delay_s: _Seconds = 0.0
    shell: _Flag = False
    #: Moment of the start: None for at once, or e.g. `{"after_s": 2.0}`, `{"on_exit_of": "arm-1"}`,
    #: `{"on_start_of": "arm-1"}`, `{"on_shutdown": True}`.
    when: _Moment | None = None
    #: Condition for the start, e.g. "IfCondition('true') holds".
    condition_note: str = ""
    #: Text by file name. A text refers to another of these files as e.g. `{parameters}/arm_1.yaml`.
    parameter_files: _Files = field(default_factory=dict)
    components: tuple[Component, ...] = ()
    autostart: _Flag = False
    #: Reason why the process cannot start here, through no fault of the launch file.
    absent: str = ""
    file: str | None = None
    line: _Line | None = None

    @property
    def full_name(self) -> str | None:
        """The node's name with its namespace, e.g. `/arm/talker`; None if the launch file does not name the node."""
        if self.called is None:
            return None
        namespace = self._ruled("__ns") or self.namespace or ""
        return f"{namespace.rstrip('/')}/{self.called}"

    @property
    def _words(self) -> list[str]:
        words = [self.path, *self.argv]
        if self.shell:
            return " ".join(words).split()
        return words

    @property
    def runs(self) -> str:
        """Name of the executable or script; that behind `ros2 run` or a Python interpreter, if there is one."""
        own = self.executable or PurePosixPath(self.path).name
        words = self._words
        if self.kind != "executable" or not words:
            return own
        program = PurePosixPath(words[0]).name
        if program == "ros2":
            run = ros2_run(words[1:])
            return own if run is None else run[1]
        if re.fullmatch(r"python3?(\.\d+)?", program):
            for word in words[1:]:
                if word.endswith(".py"):
                    return PurePosixPath(word).name
        return own

    @property
    def called(self) -> str | None:
        """The node's name without its namespace, from the launch file or from a rule on the command line."""
        return self._ruled("__node", "__name") or self.name

    def _ruled(self, *sources: str) -> str | None:
        """Return the target of the first rule for a name, e.g. of `__node:=arm`; later rules have no effect."""
        for word in self._words:
            source, is_rule, target = word.partition(":=")
            if is_rule and source in sources:
                return target
        return None

    def command(self, parameters_folder: str) -> list[str]:
        """Return the command line, with the parameter files in a folder."""
        words = [*self.prefix, self.path, *self.argv]
        return [word.replace(PARAMETERS_PLACEHOLDER, parameters_folder) for word in words]

    def effective_parameters(self, node: str | None = None) -> dict[str, Any]:
        """Return value by name as the node would get them; the last one given counts.

        `rcl` keeps the values by pattern, each pattern at its first appearance, and applies the patterns that match the
        node's name in this order; `talker` and `/talker` are two patterns. Parameters of the launch file are for the
        full name if the file gives the node a name and a namespace, else for any node. `node` is the full name if the
        code of the node chooses the name.
        """
        full_name = self.full_name or node or "/"
        effective: dict[str, Any] = {}
        for pattern, values in self._values_by_pattern(full_name).items():
            if _matches(pattern, full_name):
                effective.update(values)
        return effective

    def _values_by_pattern(self, full_name: str) -> dict[str, dict[str, Any]]:
        """Return the values in the order of the first appearance of their patterns."""
        by_pattern: dict[str, dict[str, Any]] = {}
        if not self.parameters:
            on_command_line = self._values_on_command_line()
            if on_command_line:
                by_pattern["/**"] = on_command_line
        named = self.name is not None and self.namespace is not None
        for parameter in self.parameters:
            if parameter.name is not None:
                pattern = full_name if named and not parameter.wildcard else "/**"
                values = by_pattern.setdefault(pattern, {})
                values[parameter.name] = parameter.value
                continue
            for section, of_section in parameter.sections():
                by_pattern.setdefault(section, {}).update(of_section)
        return by_pattern

    def _values_on_command_line(self) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for flag, word in pairwise(self._words):
            name, is_rule, value = word.partition(":=")
            if is_rule and flag in ("-p", "--param"):
                values[name] = value
        return values


def _sections(content: Mapping[str, Any], above: str) -> list[tuple[str, Mapping[str, Any]]]:
    found: list[tuple[str, Mapping[str, Any]]] = []
    for key, value in content.items():
        if isinstance(value, Mapping) and key == "ros__parameters":
            found.append((above, value))
        elif isinstance(value, Mapping):
            section = str(key)
            if above:
                section = f"{above}/{key}"
            found += _sections(value, section)
    return found


def _matches(section: str, full_name: str) -> bool:
    """Return whether a full name fits a pattern of names with `*` and `**`.

    The number of steps is the product of the numbers of parts.
    """
    wanted = section.strip("/").split("/")
    given = full_name.strip("/").split("/")
    if max(len(wanted), len(given)) > _MOST_NAMES:
        return False
    # Item n tells whether the parts of the pattern so far fit the first n names.
    fits = [True] + [False] * len(given)
    for part in wanted:
        if part == "**":
            fits = list(accumulate(fits, or_))
            continue
        before = fits
        fits = [False]
        for name, fitted in zip(given, before, strict=False):
            fits.append(fitted and part in ("*", name))
    return fits[-1]


def _flat(content: Mapping[str, Any], above: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{above}{key}."))
        else:
            flat[f"{above}{key}"] = value
    return flat


def ros2_run(words: Sequence[str]) -> tuple[str, str, list[str]] | None:
    """Return package, executable and arguments of the words behind `ros2`, e.g. of `run demo talker --fast`.

    The result is None for any other command than `run`, and for names that are not plain.
    """
    rest = list(words)
    if rest[:1] != ["run"]:
        return None
    rest = rest[1:]
    while rest and rest[0].startswith("--prefix"):
        taken = 1 if "=" in rest[0] else 2
        rest = rest[taken:]
    if len(rest) < 2:
        return None
    package, executable = rest[:2]
    if not _PLAIN_NAME.fullmatch(package) or not _PLAIN_NAME.fullmatch(executable):
        return None
    return package, executable, rest[2:]


@dataclass(frozen=True)
class Include:
    """An included launch file; the inclusion is in the file `by`, at `line`."""

    file: str
    arguments: _Texts = field(default_factory=dict)
    when: Mapping[str, Any] | None = None
    by: str | None = None
    line: _Line | None = None


@dataclass(frozen=True)
class Note:
    """A warning of the evaluation, or a message of the launch file."""

    message: str
    when: Mapping[str, Any] | None = None
    file: str | None = None
    line: _Line | None = None


@dataclass(frozen=True)
class Plan:
    """The effects of a launch file."""

    #: `ok`, `error` if the file cannot be launched, or `not_assessable` if it cannot be evaluated here, through no fault
    #: of its own.
    outcome: Literal["ok", "error", "not_assessable"]
    #: The reason, unless `ok`.
    problem: Problem | None = None
    arguments: tuple[Argument, ...] = ()
    #: The launch configurations at the end.
    configurations: _Texts = field(default_factory=dict)
    processes: Annotated[tuple[Process, ...], Field(max_length=PROCESS_LIMIT)] = ()
    includes: tuple[Include, ...] = ()
    logs: tuple[Note, ...] = ()
    warnings: tuple[Note, ...] = ()
    loaded_components: tuple[Mapping[str, Any], ...] = ()
    #: Actions with a false condition, or without an evaluation: `what`, `why`, `file`, `line`.
    not_started: tuple[Mapping[str, Any], ...] = ()
    parameter_files: _Files = field(default_factory=dict)

    @classmethod
    def from_plain(cls, plain: Any) -> Plan:
        """Read a plan from plain data, or raise `MalformedPlanError`.

        Nothing in the data is trusted, because the launch file may have written it.
        """
        if not _is_shallow(plain):
            raise MalformedPlanError("this is not a launch plan: it is too large")
        schema = None
        if isinstance(plain, Mapping):
            schema = plain.get("schema")
        if schema != SCHEMA:
            raise MalformedPlanError(f"this is not a launch plan: its schema is not {SCHEMA}")
        try:
            return _reader().validate_python(plain)
        except ValidationError as problem:
            first = problem.errors(include_url=False, include_context=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            message = f"this is not a launch plan: {place:.80}: {first['msg']}"
            raise MalformedPlanError(message) from problem

    @model_validator(mode="after")
    def _few_files(self) -> Plan:
        texts = [self.parameter_files, *(process.parameter_files for process in self.processes)]
        if sum(map(len, texts)) > _MOST_FILES:
            raise ValueError("it has too many files")
        return self

    def to_plain(self) -> dict[str, Any]:
        """Return the plan as plain data, ready for JSON."""
        return {"schema": SCHEMA, **_plain(self)}


def prepare_reader() -> None:
    """Build the reader of plans, which the first plan would build otherwise; forks then have it."""
    _reader()


@cache
def _reader() -> TypeAdapter[Plan]:
    return TypeAdapter(Plan)


def _is_shallow(plain: Any) -> bool:
    """Return whether data is no deeper than any plan."""
    level = [plain]
    for _ in range(_DEEPEST):
        inner: list[Any] = []
        for value in level:
            if isinstance(value, Mapping):
                inner.extend(value.values())
            elif isinstance(value, (list, tuple)):
                inner.extend(value)
        level = inner
    return not level


def _plain(value: Any) -> Any:
    if isinstance(value, Parameter):
        return _plain_parameter(value)
    if is_dataclass(value):
        plain = {}
        for each in fields(value):
            held = getattr(value, each.name)
            plain[each.name] = _plain(held)
        return plain
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {NO_JSON: str(value)}
    return value


def _plain_parameter(parameter: Parameter) -> dict[str, Any]:
    """Return the fields of a value or of a file."""
    names = ["file", "content"] if parameter.name is None else ["name", "value", "type"]
    if parameter.wildcard:
        names.append("wildcard")
    return {name: _plain(getattr(parameter, name)) for name in names}
