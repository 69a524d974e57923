"""Evaluates a launch file with the real `launch`, on a machine that has it, into the plan of the stand-in.

Entities are visited as a launch service visits them, but an action that would start a process is noted instead.
Timers are played at once with the time that they would wait, and so are starts and ends of the noted processes.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

SCHEMA = "ros-lab-grader/launch-plan/v1"
_MOST_PROCESSES = 400


class _Notes:
    """What an evaluation has found so far."""

    def __init__(self, root: str) -> None:
        self.root = root
        self.before = dict(os.environ)
        self.when: dict[str, Any] | None = None
        self.processes: list[dict[str, Any]] = []
        self.arguments: list[dict[str, Any]] = []
        self.parameter_files: dict[str, str] = {}
        self.handlers: list[Any] = []
        self.started: list[tuple[Any, str]] = []


def evaluate(file: str, arguments: dict[str, Any], root: str) -> dict[str, Any]:
    """Evaluate a launch file as `ros2 launch FILE name:=value` would, without starting anything.

    Parameters
    ----------
    file : str
        Path of the launch file.
    arguments : dict
        Value by name.
    root : str
        Folder of the submission; lines are reported of the files in it.

    Returns
    -------
    dict
        The plan, ready for JSON.
    """
    notes = _Notes(root)
    outcome, problem = "ok", None
    configurations: dict[str, str] = {}
    try:
        context = _launch(notes, file, {str(k): str(v) for k, v in arguments.items()})
        configurations = {str(k): str(v) for k, v in context.launch_configurations.items()}
    except BaseException as error:
        outcome, problem = _problem(error, root, file)
    return {
        "schema": SCHEMA,
        "outcome": outcome,
        "problem": problem,
        "arguments": notes.arguments,
        "configurations": configurations,
        "processes": notes.processes,
        "parameter_files": notes.parameter_files,
    }


def _launch(notes: _Notes, file: str, arguments: dict[str, str]) -> Any:
    from launch import LaunchContext
    from launch.actions import (
        DeclareLaunchArgument,
        ExecuteLocal,
        IncludeLaunchDescription,
        RegisterEventHandler,
        TimerAction,
    )
    from launch.events.process import ProcessExited, ProcessStarted
    from launch.launch_description_sources import AnyLaunchDescriptionSource

    declare = DeclareLaunchArgument.execute

    def note_argument(action: Any, context: Any) -> Any:
        result = declare(action, context)
        notes.arguments.append(_argument(action, context))
        return result

    def note_process(action: Any, context: Any) -> None:
        action.prepare(context)
        notes.started.append((action, _noted(notes, action)))

    def note_timer(action: Any, context: Any) -> None:
        waited = float("".join(part.perform(context) for part in _parts(action.period)))
        _visit_later(notes, list(action.actions), context, {"after_s": waited})

    def note_handler(action: Any, context: Any) -> None:
        notes.handlers.append(action.event_handler)

    instead = {
        DeclareLaunchArgument: note_argument,
        ExecuteLocal: note_process,
        TimerAction: note_timer,
        RegisterEventHandler: note_handler,
    }
    for kind, execute in instead.items():
        setattr(kind, "execute", execute)  # noqa: B010 - the attribute of a class of somebody else's
    context = LaunchContext(argv=[f"{name}:={value}" for name, value in arguments.items()])
    include = IncludeLaunchDescription(AnyLaunchDescriptionSource(file), launch_arguments=list(arguments.items()))
    _visit(include, context)
    for action, name in notes.started:  # grows while it is walked
        details = action.process_details
        _play(notes, ProcessStarted(**details), context, {"on_start_of": name})
        _play(notes, ProcessExited(returncode=0, **details), context, {"on_exit_of": name})
    return context


def _visit(entity: Any, context: Any) -> None:
    for following in entity.visit(context) or []:
        _visit(following, context)


def _visit_later(notes: _Notes, entities: list[Any], context: Any, when: dict[str, Any]) -> None:
    before, notes.when = notes.when, when
    try:
        for entity in entities:
            _visit(entity, context)
    finally:
        notes.when = before


def _play(notes: _Notes, event: Any, context: Any, when: dict[str, Any]) -> None:
    for handler in list(notes.handlers):
        if handler.matches(event):
            context.extend_locals({"event": event})
            entities = handler.handle(event, context)
            following = entities if isinstance(entities, (list, tuple)) else [entities]
            _visit_later(notes, [entity for entity in following if entity is not None], context, when)


def _parts(given: Any) -> list[Any]:
    from launch.utilities import normalize_to_list_of_substitutions

    plain = isinstance(given, (int, float))
    return list(normalize_to_list_of_substitutions(str(given) if plain else given))


def _argument(action: Any, context: Any) -> dict[str, Any]:
    default = action.default_value
    return {
        "name": str(action.name),
        "default": None if default is None else "".join(part.perform(context) for part in default),
        "description": str(action.description),
        "choices": None if action.choices is None else list(action.choices),
    }


def _noted(notes: _Notes, action: Any) -> str:
    if len(notes.processes) >= _MOST_PROCESSES:
        raise RuntimeError(f"the launch description starts more than {_MOST_PROCESSES} processes")
    details = action.process_details
    command, kept = [str(word) for word in details["cmd"]], {}
    for place, word in enumerate(command):
        if place and command[place - 1] == "--params-file" and Path(word).is_file():
            name = f"{len(notes.parameter_files) + 1}_{Path(word).name}"
            kept[name] = Path(word).read_text(encoding="utf-8", errors="replace")
            command[place] = f"{{parameters}}/{name}"
    notes.parameter_files.update(kept)
    environment = details["env"] or {}
    notes.processes.append(
        {
            "id": str(details["name"]),
            "kind": "executable",
            "path": command[0],
            "argv": command[1:],
            "env": {str(k): str(v) for k, v in environment.items() if notes.before.get(k) != v},
            "cwd": details["cwd"],
            "shell": bool(action.shell),
            "when": notes.when,
            "parameter_files": kept,
            **_node(action, command, kept),
        }
    )
    return str(details["name"])


def _node(action: Any, command: list[str], files: dict[str, str]) -> dict[str, Any]:
    """What a node's action has besides: its names, parameters and remappings, read off the command line."""
    from launch_ros.actions import Node

    if not isinstance(action, Node):
        return {}
    import yaml

    rules = [word.partition(":=") for flag, word in pairwise(command) if flag == "-r"]
    given = {source: target for source, _, target in rules}
    parameters: list[dict[str, Any]] = []
    for flag, word in pairwise(command):
        if flag == "--params-file":
            name = Path(word).name
            text = files.get(name)
            parameters.append({"file": name, "content": None if text is None else yaml.safe_load(text)})
        elif flag == "-p":
            name, _, value = word.partition(":=")
            parameters.append({"name": name, "value": yaml.safe_load(value)})
    executable = Path(command[0])
    return {
        "kind": "node",
        "package": executable.parent.name,
        "executable": executable.name,
        "name": given.get("__node"),
        "namespace": given.get("__ns"),
        "parameters": parameters,
        "remappings": [[a, b] for a, b in given.items() if not a.startswith("__")],
    }


def _problem(error: BaseException, root: str, file: str) -> tuple[str, dict[str, Any]]:
    """The outcome and the problem of an exception, at the student's line."""
    while error.__cause__ is not None and type(error).__name__ == "InvalidLaunchFileError":
        error = error.__cause__
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(f"{root}/")]
    where, line = (frames[-1].filename, frames[-1].lineno) if frames else (file, None)
    if isinstance(error, SyntaxError) and error.filename:
        where, line = error.filename, error.lineno
    missing = isinstance(error, ModuleNotFoundError) and not str(error.name).startswith("launch")
    kinds: dict[str, Callable[[], bool]] = {
        "missing_module": lambda: missing,
        "syntax_error": lambda: isinstance(error, SyntaxError),
        "unknown_package": lambda: type(error).__name__ == "PackageNotFoundError",
        "undefined_configuration": lambda: "launch configuration '" in str(error) and "does not exist" in str(error),
        "unknown_executable": lambda: str(error).startswith("executable '"),
    }
    kind = next((name for name, holds in kinds.items() if holds()), "exception")
    problem = {
        "kind": kind,
        "message": f"{type(error).__name__}: {error}" if kind == "exception" else str(error).strip('"'),
        "file": os.path.relpath(where, root),
        "line": line,
        "remedy": "Mend what `ros2 launch` says of this line.",
        "module": str(getattr(error, "name", None) or "") if missing else "",
    }
    return ("not_assessable" if missing else "error"), problem
