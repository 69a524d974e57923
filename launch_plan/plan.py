"""The plan of a launch file: what would start, with which command line, and when.

A plan is data: the live half runs it, the recording keeps it, the report shows it. What an evaluation says besides, by
which the stand-in is compared with the original, is for nobody else and is left out here.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import field, fields, is_dataclass
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
from pydantic.dataclasses import dataclass

from launch_plan.format import NO_JSON, PARAMETERS_PLACEHOLDER, PROCESS_LIMIT, SCHEMA

#: More than these no evaluation gives: what it runs may write a plan of its own instead.
_MOST_FILES, _DEEPEST = 2000, 60
_LARGEST = 10**9
#: A node's full name has 255 characters at most, so that it cannot consist of more names.
_MOST_NAMES = 128
#: Linux takes no longer path, and no longer name of a file, in bytes.
_LONGEST_NAME, _LONGEST_FILE_NAME = 4096, 255
_NO_MOMENT = "what it waits for is no moment"


class MalformedPlanError(ValueError):
    """Data that is said to be a plan is none."""


def _as_text(value: Any) -> Any:
    """Write a number or a truth value as text, and leave to the check what has parts."""
    return value if isinstance(value, (Mapping, list, tuple)) else str(value)


def _require_folder(path: str) -> str:
    """Refuse steps upwards: an evaluation resolves them; what still has one was written to lead elsewhere."""
    if not path.startswith("/") or ".." in PurePosixPath(path).parts:
        raise ValueError("a working folder is none that a plan can name")
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
    """Refuse a moment that no process can wait for: a time without end, or something else than a name."""
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
    """A parameter's value, in which the numbers that JSON has not are written `{"!!float": "inf"}`."""
    if isinstance(value, Mapping):
        if set(value) == {NO_JSON} and value[NO_JSON] in ("inf", "-inf", "nan"):
            return float(value[NO_JSON])
        return {name: _with_doubles(item) for name, item in value.items()}
    return [_with_doubles(item) for item in value] if isinstance(value, list) else value


# Nothing is converted from one type to another but what launch files are free to give as any scalar.
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
    """Why a launch file cannot be launched, or not be assessed."""

    #: A slug, such as `unknown_executable`.
    kind: str
    #: What is wrong, and how to fix it.
    message: str
    #: Path relative to the submission.
    file: str | None = None
    #: Line of `file`, counted from 1.
    line: _Line | None = None
    remedy: str = ""
    #: The module that is missing, for a launch file that is not assessable.
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
    #: It is given on the command line, where it is for any node of the process.
    wildcard: _Flag = False

    def sections(self) -> list[tuple[str, dict[str, Any]]]:
        """What a file sets: for each pattern of nodes the values by name."""
        listed = _sections(self.content, "") if isinstance(self.content, Mapping) else []
        return [(pattern, _flat(values, "")) for pattern, values in listed]


@dataclass(frozen=True)
class Component:
    """A node that is loaded into a container."""

    plugin: str | None = None
    name: str | None = None


@dataclass(frozen=True)
class Process:
    """One process that would be started."""

    #: Name with a running number, as `ros2 launch` shows it.
    id: _Path
    path: _Path
    #: `node`, `lifecycle_node`, `container` or `executable`.
    kind: str = "executable"
    package: str | None = None
    executable: str | None = None
    name: _Path | None = None
    namespace: _Path | None = None
    #: The command line is all three in this order. `{parameters}` in `argv` stands for a folder of the runner's
    #: choice that holds `parameter_files`.
    prefix: tuple[_Word, ...] = ()
    argv: tuple[_Word, ...] = ()
    #: What differs from the environment of the launch.
    env: _Environment = field(default_factory=dict)
    cwd: Annotated[_Path, AfterValidator(_require_folder)] | None = None
    parameters: tuple[Parameter, ...] = ()
    remappings: _Remappings = ()
    output: Any = "log"
    respawn: _Flag = False
    respawn_delay_s: _Seconds = 0.0
    shell: _Flag = False
    #: None: at once. Else what it waits for: `after_s`, `on_start_of`, `on_exit_of`, `on_shutdown`, ...
    when: _Moment | None = None
    #: On what condition it was started.
    condition_note: str = ""
    #: Text by file name. Another file of these is meant where a text holds `{parameters}/` and its name.
    parameter_files: _Files = field(default_factory=dict)
    components: tuple[Component, ...] = ()
    autostart: _Flag = False
    #: Why it cannot be started here, through no fault of the launch file's.
    absent: str = ""
    file: str | None = None
    line: _Line | None = None

    @property
    def full_name(self) -> str | None:
        """The node's name with its namespace, or None if the launch file does not name it."""
        if self.called is None:
            return None
        return f"{(self._ruled('__ns') or self.namespace or '').rstrip('/')}/{self.called}"

    @property
    def _words(self) -> list[str]:
        words = [self.path, *self.argv]
        return " ".join(words).split() if self.shell else words

    @property
    def runs(self) -> str:
        """Name of the executable or script that runs, behind `ros2 run` or a Python interpreter too."""
        own = self.executable or PurePosixPath(self.path).name
        if self.kind != "executable":
            return own
        words = self._words
        program, rest = PurePosixPath(words[0]).name if words else "", words[1:]
        if program == "ros2" and (run := ros2_run(rest)) is not None:
            return run[1]
        if re.fullmatch(r"python3?(\.\d+)?", program):
            scripts = [word for word in rest if word.endswith(".py")]
            return PurePosixPath(scripts[0]).name if scripts else own
        return own

    @property
    def called(self) -> str | None:
        """The node's name without its namespace, from the launch file or from a rule on the command line."""
        return self._ruled("__node", "__name") or self.name

    def _ruled(self, *sources: str) -> str | None:
        """What the first rule for a name on the command line makes of it, where all later ones are ignored."""
        rules = (word.partition(":=") for word in self._words)
        return next(
            (target for source, is_rule, target in rules if is_rule and source in sources), None
        )

    def command(self, parameters_folder: str) -> list[str]:
        """The command line, with the parameter files in a folder."""
        words = [*self.prefix, self.path, *self.argv]
        return [word.replace(PARAMETERS_PLACEHOLDER, parameters_folder) for word in words]

    def effective_parameters(self, node: str | None = None) -> dict[str, Any]:
        """Value by name as the node would get them; the last one given counts.

        As `rcl` does it: values are kept by the pattern that they are for, each pattern where it first appears,
        and those that match the node's name are applied in this order. Parameters given in the launch file are
        for the full name if it names the node and its namespace, else for any node. `node` is the full name where a
        launch file leaves that to the node's code.
        """
        full_name = self.full_name or node or "/"
        named = self.name is not None and self.namespace is not None
        by_pattern: dict[str, dict[str, Any]] = {}
        for flag, word in pairwise(self._words if not self.parameters else ()):
            name, is_rule, value = word.partition(":=")
            if is_rule and flag in ("-p", "--param"):
                by_pattern.setdefault("**", {})[name] = value
        for parameter in self.parameters:
            if parameter.name is not None:
                pattern = full_name if named and not parameter.wildcard else "/**"
                by_pattern.setdefault(pattern.strip("/"), {})[parameter.name] = parameter.value
            for section, values in parameter.sections() if parameter.name is None else ():
                by_pattern.setdefault(section.strip("/"), {}).update(values)
        return {
            name: value
            for pattern, values in by_pattern.items()
            if _matches(pattern, full_name)
            for name, value in values.items()
        }


def _sections(content: Mapping[str, Any], above: str) -> list[tuple[str, Mapping[str, Any]]]:
    found: list[tuple[str, Mapping[str, Any]]] = []
    for key, value in content.items():
        if isinstance(value, Mapping) and key == "ros__parameters":
            found.append((above, value))
        elif isinstance(value, Mapping):
            found += _sections(value, f"{above}/{str(key).strip('/')}")
    return found


def _matches(section: str, full_name: str) -> bool:
    """Whether a full name fits a pattern of names, `*` and `**`; in steps as many as both have parts, multiplied."""
    wanted, given = section.strip("/").split("/"), full_name.strip("/").split("/")
    if max(len(wanted), len(given)) > _MOST_NAMES:
        return False
    # Whether the pattern's parts up to here may stand for the first none, one, two ... of the names.
    fits = [True] + [False] * len(given)
    for part in wanted:
        if part == "**":
            fits = list(accumulate(fits, or_))
        else:
            fits = [
                False,
                *(
                    before and part in ("*", name)
                    for before, name in zip(fits, given, strict=False)
                ),
            ]
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
    """Return package, executable and arguments of what follows `ros2` if it is `run` with a plain name for both."""
    rest = list(words)
    if rest[:1] != ["run"]:
        return None
    rest = rest[1:]
    while rest and rest[0].startswith("--prefix"):
        rest = rest[1 if "=" in rest[0] else 2 :]
    if len(rest) < 2 or not all(re.fullmatch(r"[\w+-][\w.+-]{0,199}", word) for word in rest[:2]):
        return None
    return rest[0], rest[1], rest[2:]


@dataclass(frozen=True)
class Include:
    """Another launch file that is included; `by` and `line` say where."""

    file: str
    arguments: _Texts = field(default_factory=dict)
    when: Mapping[str, Any] | None = None
    by: str | None = None
    line: _Line | None = None


@dataclass(frozen=True)
class Note:
    """A warning, or something that the launch file says."""

    message: str
    when: Mapping[str, Any] | None = None
    file: str | None = None
    line: _Line | None = None


@dataclass(frozen=True)
class Plan:
    """What a launch file would do."""

    #: `ok`; `error`: it cannot be launched; `not_assessable`: it cannot be evaluated here, through no fault of
    #: its own.
    outcome: Literal["ok", "error", "not_assessable"]
    #: Why, unless `ok`.
    problem: Problem | None = None
    arguments: tuple[Argument, ...] = ()
    #: The launch configurations at the end.
    configurations: _Texts = field(default_factory=dict)
    processes: Annotated[tuple[Process, ...], Field(max_length=PROCESS_LIMIT)] = ()
    includes: tuple[Include, ...] = ()
    logs: tuple[Note, ...] = ()
    warnings: tuple[Note, ...] = ()
    loaded_components: tuple[Mapping[str, Any], ...] = ()
    #: What a condition kept back, or what is not evaluated: `what`, `why`, `file`, `line`.
    not_started: tuple[Mapping[str, Any], ...] = ()
    parameter_files: _Files = field(default_factory=dict)

    @classmethod
    def from_plain(cls, plain: Any) -> Plan:
        """Read a plan from plain data, or raise `MalformedPlanError`.

        The data may come from a process that ran a student's code, so nothing is trusted.
        """
        if not _is_shallow(plain):
            raise MalformedPlanError("this is not a launch plan: it is too large")
        if not isinstance(plain, Mapping) or plain.get("schema") != SCHEMA:
            raise MalformedPlanError(f"this is not a launch plan: its schema is not {SCHEMA}")
        try:
            return _READER.validate_python(plain)
        except ValidationError as problem:
            first = problem.errors(include_url=False, include_context=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            raise MalformedPlanError(
                f"this is not a launch plan: {place:.80}: {first['msg']}"
            ) from problem

    @model_validator(mode="after")
    def _few_files(self) -> Plan:
        texts = [self.parameter_files, *(process.parameter_files for process in self.processes)]
        if sum(map(len, texts)) > _MOST_FILES:
            raise ValueError("it has too many files")
        return self

    def to_plain(self) -> dict[str, Any]:
        """The plan as plain data, ready for JSON."""
        return {"schema": SCHEMA, **_plain(self)}


_READER = TypeAdapter(Plan)


def _is_shallow(plain: Any) -> bool:
    """Whether data is no deeper than any plan."""
    level = [plain]
    for _ in range(_DEEPEST):
        parts = (
            v.values() if isinstance(v, Mapping) else v
            for v in level
            if isinstance(v, (Mapping, list, tuple))
        )
        level = [inner for part in parts for inner in part]
    return not level


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        plain = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
        if isinstance(value, Parameter):
            kept = ("file", "content") if value.name is None else ("name", "value", "type")
            return {
                name: plain[name] for name in (*kept, *(("wildcard",) if value.wildcard else ()))
            }
        return plain
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return {NO_JSON: str(value)} if isinstance(value, float) and not math.isfinite(value) else value
