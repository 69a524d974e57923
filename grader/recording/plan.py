"""The plan of a launch file: what would start, with which command line, and when.

A plan is data: the live half runs it, the recording keeps it, the report shows it.
"""

from __future__ import annotations

import math
import numbers
import os
import re
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any, TypeVar

PLAN_SCHEMA = "ros-lab-grader/launch-plan/v1"

OUTCOMES = ("ok", "error", "not_assessable")

PARAMETERS_PLACEHOLDER = "{parameters}"

#: More than these no evaluation gives: what it runs may write a plan of its own instead.
_MOST_PROCESSES, _MOST_FILES, _DEEPEST = 400, 2000, 60
_LARGEST = 10**9
_NO_JSON = "!!float"
#: A node's full name has 255 characters at most, so that it cannot consist of more names.
_MOST_NAMES = 128
#: Linux takes no longer path, and no longer name of a file, in bytes.
_LONGEST_NAME, _LONGEST_FILE_NAME = 4096, 255

_T = TypeVar("_T")


class MalformedPlanError(ValueError):
    """Data that is said to be a plan is none."""


@dataclass(frozen=True)
class Problem:
    """Why a launch file cannot be launched, or not be assessed.

    Attributes
    ----------
    kind : str
        A slug, such as `unknown_executable`.
    message, remedy : str
        What is wrong, and how to mend it.
    file : str or None
        Path relative to the submission.
    line : int or None
        Line of `file`, counted from 1.
    module : str
        The module that is missing, for a launch file that is not assessable.
    """

    kind: str
    message: str
    file: str | None = None
    line: int | None = None
    remedy: str = ""
    module: str = ""


@dataclass(frozen=True)
class Argument:
    """A declared launch argument; `default` is None if it must be given."""

    name: str
    default: str | None = None
    description: str = ""
    choices: tuple[str, ...] | None = None
    included: bool = False
    file: str | None = None
    line: int | None = None


@dataclass(frozen=True)
class Parameter:
    """One parameter (`name`, `value`, `type`) or one file of them (`file`, `content`), in the order given.

    Attributes
    ----------
    wildcard : bool
        It is given on the command line, where it is for any node of the process.
    """

    name: str | None = None
    value: Any = None
    type: str | None = None
    file: str | None = None
    content: Any = None
    wildcard: bool = False


@dataclass(frozen=True)
class Component:
    """A node that is loaded into a container."""

    package: str | None = None
    plugin: str | None = None
    name: str | None = None
    namespace: str | None = None
    parameters: tuple[Parameter, ...] = ()
    remappings: tuple[tuple[str, str], ...] = ()
    file: str | None = None
    line: int | None = None


@dataclass(frozen=True)
class Process:
    """One process that would be started.

    Attributes
    ----------
    id : str
        Name with a running number, as `ros2 launch` shows it.
    kind : str
        `node`, `lifecycle_node`, `container` or `executable`.
    prefix, path, argv
        The command line is all three in this order. `{parameters}` in `argv` stands for a folder of the
        runner's choice that holds `parameter_files`.
    env, env_unset, env_replaces
        What differs from the environment of the launch; if `env_replaces`, `env` is all there is.
    when : mapping or None
        None: at once. Else what it waits for: `after_s`, `on_start_of`, `on_exit_of`, `on_shutdown`, ...
    condition_note : str
        On what condition it was started.
    parameter_files : mapping
        Text by file name. Another file of these is meant where a text holds `{parameters}/` and its name.
    absent : str
        Why it cannot be started here, through no fault of the launch file's.
    """

    id: str
    path: str
    kind: str = "executable"
    package: str | None = None
    executable: str | None = None
    name: str | None = None
    namespace: str | None = None
    prefix: tuple[str, ...] = ()
    argv: tuple[str, ...] = ()
    env: Mapping[str, str] = field(default_factory=dict)
    env_unset: tuple[str, ...] = ()
    env_replaces: bool = False
    cwd: str | None = None
    parameters: tuple[Parameter, ...] = ()
    remappings: tuple[tuple[str, str], ...] = ()
    output: Any = "log"
    respawn: bool = False
    respawn_delay_s: float = 0.0
    respawn_max_retries: int = -1
    emulate_tty: bool = False
    shell: bool = False
    sigterm_timeout_s: float = 5.0
    sigkill_timeout_s: float = 5.0
    when: Mapping[str, Any] | None = None
    condition_note: str = ""
    parameter_files: Mapping[str, str] = field(default_factory=dict)
    components: tuple[Component, ...] = ()
    autostart: bool = False
    absent: str = ""
    file: str | None = None
    line: int | None = None

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
        return next((target for source, is_rule, target in rules if is_rule and source in sources), None)

    def command(self, parameters_folder: str) -> list[str]:
        """The command line, with the parameter files in a folder."""
        words = [*self.prefix, self.path, *self.argv]
        return [word.replace(PARAMETERS_PLACEHOLDER, parameters_folder) for word in words]

    def effective_parameters(self, node: str | None = None) -> dict[str, Any]:
        """Value by name as the node would get them; the last one given counts.

        Parameters
        ----------
        node : str or None
            Full name of the node, for a launch file that leaves its name to its code.

        Notes
        -----
        As `rcl` does it: values are kept by the pattern that they are for, each pattern where it first appears,
        and those that match the node's name are applied in this order. Parameters given in the launch file are
        for the full name if it names the node and its namespace, else for any node.
        """
        full_name = self.full_name or node or "/"
        named = self.name is not None and self.namespace is not None
        by_pattern: dict[str, dict[str, Any]] = {}
        for pattern, values in self._values_on_command_line() if not self.parameters else ():
            by_pattern.setdefault(pattern, {}).update(values)
        for parameter in self.parameters:
            if parameter.name is not None:
                pattern = full_name if named and not parameter.wildcard else "/**"
                by_pattern.setdefault(pattern.strip("/"), {})[parameter.name] = parameter.value
            elif isinstance(parameter.content, Mapping):
                for section, content in _sections(parameter.content, ""):
                    by_pattern.setdefault(section.strip("/"), {}).update(_flat(content, ""))
        return {
            name: value
            for pattern, values in by_pattern.items()
            if _matches(pattern, full_name)
            for name, value in values.items()
        }

    def _values_on_command_line(self) -> Iterator[tuple[str, dict[str, Any]]]:
        for flag, word in pairwise(self._words):
            name, is_rule, value = word.partition(":=")
            if is_rule and flag in ("-p", "--param"):
                yield "**", {name: value}


def _sections(content: Mapping[str, Any], above: str) -> list[tuple[str, Mapping[str, Any]]]:
    found: list[tuple[str, Mapping[str, Any]]] = []
    for key, value in content.items():
        if not isinstance(value, Mapping):
            continue
        if key == "ros__parameters":
            found.append((above, value))
        else:
            found += _sections(value, f"{above}/{str(key).strip('/')}")
    return found


def _matches(section: str, full_name: str) -> bool:
    """Whether a full name fits a pattern of names, `*` and `**`; in steps as many as both have parts, multiplied."""
    wanted, given = section.strip("/").split("/"), full_name.strip("/").split("/")
    if max(len(wanted), len(given)) > _MOST_NAMES:
        return False
    reached = _beyond_any(wanted, {0})  # how many parts of the pattern may be used up
    for name in given:
        ahead = {n for n in reached if n < len(wanted) and wanted[n] == "**"}
        ahead |= {n + 1 for n in reached if n < len(wanted) and wanted[n] in ("*", name)}
        reached = _beyond_any(wanted, ahead)
    return len(wanted) in reached


def _beyond_any(wanted: list[str], reached: set[int]) -> set[int]:
    """Add the parts that are reached because `**` may stand for nothing."""
    found = set(reached)
    for n in sorted(reached):
        while n < len(wanted) and wanted[n] == "**":
            n += 1
            found.add(n)
    return found


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
    arguments: Mapping[str, str] = field(default_factory=dict)
    when: Mapping[str, Any] | None = None
    by: str | None = None
    line: int | None = None


@dataclass(frozen=True)
class Note:
    """A warning, or something that the launch file says."""

    message: str
    when: Mapping[str, Any] | None = None
    file: str | None = None
    line: int | None = None


@dataclass(frozen=True)
class Plan:
    """What a launch file would do.

    Attributes
    ----------
    outcome : str
        `ok`; `error`: it cannot be launched; `not_assessable`: it cannot be evaluated here, through no
        fault of its own.
    problem : Problem or None
        Why, unless `ok`.
    configurations : mapping
        The launch configurations at the end.
    transitions : tuple of mapping
        What lifecycle nodes are asked to do: `process`, `transition`, `when`, `file`, `line`.
    not_started : tuple of mapping
        What a condition kept back, or what is not evaluated: `what`, `why`, `file`, `line`.
    """

    outcome: str
    problem: Problem | None = None
    arguments: tuple[Argument, ...] = ()
    configurations: Mapping[str, str] = field(default_factory=dict)
    processes: tuple[Process, ...] = ()
    includes: tuple[Include, ...] = ()
    logs: tuple[Note, ...] = ()
    warnings: tuple[Note, ...] = ()
    shutdowns: tuple[Mapping[str, Any], ...] = ()
    signals: tuple[Mapping[str, Any], ...] = ()
    transitions: tuple[Mapping[str, Any], ...] = ()
    loaded_components: tuple[Mapping[str, Any], ...] = ()
    not_started: tuple[Mapping[str, Any], ...] = ()
    parameter_files: Mapping[str, str] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the launch file can be launched."""
        return self.outcome == "ok"

    def node(self, full_name: str) -> Process | None:
        """The process that starts a node of a name, if any."""
        return next((p for p in self.processes if p.full_name == full_name), None)

    @classmethod
    def from_plain(cls, plain: Any) -> Plan:
        """Read a plan from plain data.

        Raises
        ------
        MalformedPlanError
            It is no plan. The data may come from a process that ran a student's code, so nothing is trusted.
        """
        if not _is_bounded(plain):
            raise MalformedPlanError("this is no launch plan: it is larger than any")
        if not isinstance(plain, Mapping) or plain.get("schema") != PLAN_SCHEMA:
            raise MalformedPlanError(f"this is no launch plan: its schema is not {PLAN_SCHEMA}")
        if plain.get("outcome") not in OUTCOMES:
            raise MalformedPlanError(f"the outcome of a launch plan must be one of {', '.join(OUTCOMES)}")
        try:
            return cls(
                outcome=plain["outcome"],
                problem=None if plain.get("problem") is None else _made(Problem, plain["problem"]),
                arguments=tuple(_argument(item) for item in _listed(plain, "arguments")),
                configurations=_texts(plain.get("configurations")),
                processes=tuple(_process(item) for item in _listed(plain, "processes")),
                includes=tuple(_made(Include, item) for item in _listed(plain, "includes")),
                logs=tuple(_made(Note, item) for item in _listed(plain, "logs")),
                warnings=tuple(_made(Note, item) for item in _listed(plain, "warnings")),
                shutdowns=tuple(_listed(plain, "shutdowns")),
                signals=tuple(_listed(plain, "signals")),
                transitions=tuple(_listed(plain, "transitions")),
                loaded_components=tuple(_listed(plain, "loaded_components")),
                not_started=tuple(_listed(plain, "not_started")),
                parameter_files=_files(plain.get("parameter_files")),
            )
        except MalformedPlanError:
            raise
        except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
            raise MalformedPlanError(f"this is no launch plan: {error}") from error

    def to_plain(self) -> dict[str, Any]:
        """The plan as plain data, ready for JSON."""
        plain = _plain(self)
        return {"schema": PLAN_SCHEMA, **plain}


def _is_bounded(plain: Any) -> bool:
    """Whether data is no deeper, and what is in its lists no more, than in any plan."""
    level = [plain]
    for _ in range(_DEEPEST):
        level = [
            inner
            for value in level
            if isinstance(value, (Mapping, list, tuple))
            for inner in (value.values() if isinstance(value, Mapping) else value)
        ]
    if level or not isinstance(plain, Mapping):
        return not level
    processes = plain.get("processes")
    listed = processes if isinstance(processes, list) else []
    files = [each.get("parameter_files") for each in (plain, *listed) if isinstance(each, Mapping)]
    count = sum(len(texts) for texts in files if isinstance(texts, Mapping))
    return len(listed) <= _MOST_PROCESSES and count <= _MOST_FILES


def _with_doubles(value: Any) -> Any:
    """A parameter's value, in which the numbers that JSON has not are written `{"!!float": "inf"}`."""
    if isinstance(value, Mapping):
        if set(value) == {_NO_JSON} and value[_NO_JSON] in ("inf", "-inf", "nan"):
            return float(value[_NO_JSON])
        return {name: _with_doubles(item) for name, item in value.items()}
    return [_with_doubles(item) for item in value] if isinstance(value, list) else value


def _made(cls: type[_T], item: Mapping[str, Any], **converted: Any) -> _T:
    hints = typing.get_type_hints(cls)
    given = {name: value for name, value in item.items() if name in hints and name not in converted}
    for name, value in given.items():
        hint = hints[name]
        kinds = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
        if not all(kind in _PLAIN for kind in kinds):
            continue  # the value of a parameter, which may be any
        fits = isinstance(value, tuple(_PLAIN[kind] for kind in kinds))
        if not fits or not _is_moderate(value):
            raise MalformedPlanError(f"'{name}' of a {cls.__name__} in a launch plan cannot be {value!r:.80}")
    return cls(**given, **converted)


def _is_moderate(value: Any) -> bool:
    """Whether a value, if it is a number, is one that can be waited for and shown."""
    return not isinstance(value, (int, float)) or abs(value) <= _LARGEST  # NaN is not


#: What a field of a kind may hold; a field of another kind may hold anything.
_PLAIN: Mapping[Any, type] = {
    str: str,
    int: int,
    float: numbers.Real,
    bool: bool,
    type(None): type(None),
    Mapping[str, str]: Mapping,
    Mapping[str, Any]: Mapping,
}


def _listed(plain: Mapping[str, Any], name: str) -> list[Any]:
    items = plain.get(name) or []
    if not isinstance(items, list) or not all(isinstance(item, Mapping) for item in items):
        raise MalformedPlanError(f"'{name}' of a launch plan must be a list of mappings")
    return items


def _texts(given: Any) -> dict[str, str]:
    texts = {str(name): value for name, value in dict(given or {}).items()}
    for name, value in texts.items():
        if isinstance(value, (Mapping, list)):
            raise MalformedPlanError(f"'{name:.80}' in a launch plan must be a text")
    return {name: str(value) for name, value in texts.items()}


def _words(item: Mapping[str, Any], name: str) -> tuple[str, ...]:
    words = item.get(name) or []
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise MalformedPlanError(f"'{name}' of a Process in a launch plan must be a list of texts")
    return tuple(words)


def _argument(item: Mapping[str, Any]) -> Argument:
    choices = item.get("choices")
    return _made(Argument, item, choices=None if choices is None else tuple(map(str, choices)))


def _common(item: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "parameters": tuple(_made(Parameter, _with_doubles(p)) for p in _listed(item, "parameters")),
        "remappings": tuple((str(a), str(b)) for a, b in item.get("remappings") or []),
    }


def _process(item: Mapping[str, Any]) -> Process:
    process = _made(
        Process,
        item,
        env=_texts(item.get("env")),
        parameter_files=_files(item.get("parameter_files")),
        components=tuple(_made(Component, c, **_common(c)) for c in _listed(item, "components")),
        **{name: _words(item, name) for name in ("prefix", "argv", "env_unset")},
        **_common(item),
    )
    _require_startable(process)
    return process


def _require_startable(process: Process) -> None:
    """Raise if no system could start a process so, or if its working folder has a step upwards.

    An evaluation resolves such steps; what still has one was written by others, to lead elsewhere.
    """
    cwd = process.cwd if process.cwd is not None else "/"
    if not cwd.startswith("/") or ".." in PurePosixPath(cwd).parts:
        raise MalformedPlanError(f"the working folder of {process.id:.80} leads elsewhere: {cwd:.200}")
    named = (process.id, process.path, cwd, process.name or "", process.namespace or "")
    if max(map(len, named)) > _LONGEST_NAME:
        raise MalformedPlanError(f"a name or path of the process {process.id:.80} is longer than any that exists")
    words = (*named, *process.prefix, *process.argv, *process.env, *process.env.values(), *process.env_unset)
    if any("\0" in word for word in words):
        raise MalformedPlanError(f"the command of {process.id:.80} holds a NUL character, which none can")
    moments = dict(process.when or {})
    after_s = moments.pop("after_s", 0)
    awaited = all(isinstance(moments[key], str) for key in moments if key.endswith("_of"))
    if not awaited or not isinstance(after_s, (int, float)) or not _is_moderate(after_s):
        raise MalformedPlanError(f"what {process.id:.80} waits for is no moment")


def _files(given: Any) -> dict[str, str]:
    """Read texts by the names of their files, which lie beside each other in one folder."""
    texts = _texts(given)
    for name in texts:
        if name in ("", ".", "..") or "/" in name or "\0" in name or len(os.fsencode(name)) > _LONGEST_FILE_NAME:
            raise MalformedPlanError(f"a launch plan's file cannot be called {name!r:.80}")
    return texts


def _plain(value: Any) -> Any:
    if hasattr(value, "__dataclass_fields__"):
        plain = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
        if isinstance(value, Parameter):
            kept = ("file", "content") if value.name is None else ("name", "value", "type")
            return {name: plain[name] for name in (*kept, *(("wildcard",) if value.wildcard else ()))}
        return plain
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return {_NO_JSON: str(value)} if isinstance(value, float) and not math.isfinite(value) else value
