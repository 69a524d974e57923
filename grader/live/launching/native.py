"""Evaluates a launch file with the real `launch`, on a machine that has it, into the plan of the stand-in.

Entities are visited as a launch service visits them, but an action that would start a process, or talk with a
running node, is noted instead. Events are played in virtual time: first what happens at once, then timers by
their time, then the ends of processes, then the shutdown.
"""

from __future__ import annotations

import difflib
import heapq
import importlib.util
import itertools
import os
import re
import sys
import time
import traceback
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

SCHEMA = "ros-lab-grader/launch-plan/v1"
_MOST_PROCESSES, _MOST_EVENTS, _MOST_EXITS, _MOST_BYTES = 400, 2000, 2, 256 * 1024
_MOST_LOGS, _LONGEST_LOG = 500, 2000
_AT_ONCE, _TIMED, _EXITS, _SHUTDOWN = range(4)
_CLOCK_GRAIN_NS = 10_000_000
_INCLUDE = "include of the command line"


class _Notes:
    """What an evaluation has found so far, and what is still to be played."""

    def __init__(self, root: str) -> None:
        self.root = root
        self.before = dict(os.environ)
        self.began_ns = time.time_ns() - _CLOCK_GRAIN_NS
        self.when: dict[str, Any] | None = None
        self.found: dict[str, list[Any]] = {
            name: []
            for name in (
                "processes",
                "arguments",
                "includes",
                "logs",
                "warnings",
                "shutdowns",
                "not_started",
                "components",
            )
        }
        self.parameter_files: dict[str, str] = {}
        self.places: dict[str, str] = {}
        self.executed: set[int] = set()
        self.handlers: list[Any] = []
        self.clock_s, self.exits = 0.0, 0
        self._queue: list[tuple[int, float, int, int, Callable[[], None], dict[str, Any] | None]] = []
        self._order = itertools.count()

    def later(self, work: Callable[[], None], when: dict[str, Any] | None, phase: int, after_s: float = 0.0) -> None:
        """Queue something."""
        entry = (phase, self.clock_s + after_s, next(self._order), self.exits, work, when)
        heapq.heappush(self._queue, entry)

    def play(self) -> None:
        """Do what is queued, by its time."""
        for _ in range(_MOST_EVENTS):
            if not self._queue:
                return
            phase, self.clock_s, _order, before, work, self.when = heapq.heappop(self._queue)
            self.exits = before + (phase == _EXITS)
            try:
                work()
            except Exception as error:
                if phase < _EXITS:
                    raise
                self.add("warnings", {"message": f"when this happens, it fails: {error}"}, None)
        raise RuntimeError(f"the launch description gives rise to more than {_MOST_EVENTS} events")

    def add(self, kind: str, entry: dict[str, Any], source: Any) -> None:
        """Note something, with the line of the submission that wrote it."""
        file, line = getattr(source, "_written_at", None) or (None, None)
        shown = None if file is None else os.path.relpath(file, self.root)
        key = "by" if "file" in entry else "file"
        self.found[kind].append({**entry, "when": self.when, key: shown, "line": line})


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
    sys.meta_path.append(_beside("standin/launch/_installed").SubmittedModules(root))
    outcome, problem = "ok", None
    configurations: dict[str, str] = {}
    try:
        context = _launch(notes, file, {str(k): str(v) for k, v in arguments.items()})
        configurations = {k: v for k, v in context.launch_configurations.items() if isinstance(v, str)}
    except BaseException as error:
        outcome, problem = _problem(error, root, file)
    components = notes.found.pop("components")
    return {
        "schema": SCHEMA,
        "outcome": outcome,
        "problem": problem,
        "configurations": configurations,
        **notes.found,
        "loaded_components": components,
        "parameter_files": notes.parameter_files,
    }


def _launch(notes: _Notes, file: str, arguments: dict[str, str]) -> Any:
    from launch import LaunchContext
    from launch.actions import IncludeLaunchDescription
    from launch.events import ExecutionComplete, Shutdown
    from launch.launch_description_sources import AnyLaunchDescriptionSource

    _remember_lines(notes.root)
    for kind, execute in {**_replaced(notes), **_replaced_of_ros(notes)}.items():
        setattr(kind, "execute", execute)  # noqa: B010 - the attribute of a class of somebody else's
    context = LaunchContext(argv=[f"{name}:={value}" for name, value in arguments.items()])

    def emit(event: Any) -> None:
        if isinstance(event, ExecutionComplete):
            _complete(notes, event, context)
        elif isinstance(event, Shutdown):
            notes.add("shutdowns", {"reason": str(event.reason)}, event)
            notes.later(lambda: _happen(notes, event, context), {"on_shutdown": True}, _SHUTDOWN)
        else:
            notes.later(lambda: _happen(notes, event, context), notes.when, _AT_ONCE)

    def is_awaited(event: Any) -> bool:
        return any(handler.matches(event) for handler in notes.handlers)

    setattr(context, "emit_event_sync", emit)  # noqa: B010 - as above
    setattr(context, "would_handle_event", is_awaited)  # noqa: B010 - as above
    include = IncludeLaunchDescription(AnyLaunchDescriptionSource(file), launch_arguments=list(arguments.items()))
    setattr(include, "_grader_note", _INCLUDE)  # noqa: B010 - as above
    _visit(include, context)
    notes.play()
    return context


def _remember_lines(root: str) -> None:
    """Let every action keep the line of the submission that constructs it."""
    from launch import Action

    construct = Action.__init__

    def constructed(action: Any, *args: Any, **kwargs: Any) -> None:
        construct(action, *args, **kwargs)
        frame = sys._getframe(1)
        while frame is not None and not frame.f_code.co_filename.startswith(f"{root}/"):
            frame = frame.f_back  # type: ignore[assignment]
        if frame is not None:
            action._written_at = (frame.f_code.co_filename, frame.f_lineno)

    setattr(Action, "__init__", constructed)  # noqa: B010 - mypy takes no assignment to a method


def _replaced(notes: _Notes) -> dict[Any, Callable[..., Any]]:
    """What actions of `launch` do instead of what they would."""
    from launch.actions import (
        DeclareLaunchArgument,
        ExecuteLocal,
        IncludeLaunchDescription,
        LogInfo,
        RegisterEventHandler,
        TimerAction,
        UnregisterEventHandler,
    )

    declare, include = DeclareLaunchArgument.execute, IncludeLaunchDescription.execute

    def note_argument(action: Any, context: Any) -> Any:
        result = declare(action, context)
        notes.add("arguments", _argument(action, context), action)
        return result

    def note_include(action: Any, context: Any) -> Any:
        entities = include(action, context)
        if getattr(action, "_grader_note", None) != _INCLUDE:
            notes.add("includes", _included(notes, action, context), action)
        return entities

    def note_log(action: Any, context: Any) -> None:
        message = "".join(part.perform(context) for part in action.msg)
        if len(notes.found["logs"]) < _MOST_LOGS:
            notes.add("logs", {"message": message[:_LONGEST_LOG]}, action)

    def note_timer(action: Any, context: Any) -> None:
        _wait(notes, action, context)

    def note_process(action: Any, context: Any) -> None:
        action.prepare(context)
        name = str(action.process_details["name"])
        if id(action) in notes.executed:
            raise RuntimeError(f"the process '{name}' is started twice: the same action stands in two places")
        notes.executed.add(id(action))
        _check_output(name, action, context)
        _start(notes, action, context)

    def note_handler(action: Any, context: Any) -> None:
        notes.handlers.insert(0, action.event_handler)

    def forget_handler(action: Any, context: Any) -> None:
        given = getattr(action, "event_handler", None) or action.__dict__["_UnregisterEventHandler__handler"]
        notes.handlers.remove(given)

    return {
        DeclareLaunchArgument: note_argument,
        IncludeLaunchDescription: note_include,
        LogInfo: note_log,
        TimerAction: note_timer,
        ExecuteLocal: note_process,
        RegisterEventHandler: note_handler,
        UnregisterEventHandler: forget_handler,
    }


def _replaced_of_ros(notes: _Notes) -> dict[Any, Callable[..., Any]]:
    """What actions of `launch_ros` do, of those that would talk with a running node."""
    from launch.utilities.type_utils import perform_typed_substitution
    from launch_ros import actions

    def load(action: Any, context: Any) -> None:
        _load(notes, action, context)

    def wait(action: Any, context: Any) -> None:
        _wait(notes, action, context)

    def start(action: Any, context: Any) -> Any:
        return actions.Node.execute(action, context)

    def lead(action: Any, context: Any) -> None:
        why = "nobody leads lifecycle nodes through their states here"
        notes.add("not_started", {"what": type(action).__name__, "why": why}, action)

    def set_sim_time(action: Any, context: Any) -> None:
        if not perform_typed_substitution(context, action.value, bool):
            raise RuntimeError("Failed to set use_sim_time parameter")

    return {
        actions.LoadComposableNodes: load,
        actions.ROSTimer: wait,
        actions.LifecycleNode: start,
        actions.LifecycleTransition: lead,
        actions.SetUseSimTime: set_sim_time,
    }


def _visit(entity: Any, context: Any) -> None:
    for following in entity.visit(context) or []:
        _visit(following, context)


def _visit_all(entities: Any, context: Any) -> None:
    listed = entities if isinstance(entities, (list, tuple)) else [entities]
    for entity in listed:
        if entity is not None:
            _visit(entity, context)


def _wait(notes: _Notes, action: Any, context: Any) -> None:
    """Play a timer's actions when its time has come, with the configurations of now."""
    kept, before, local = dict(context.launch_configurations), notes.when, context.get_locals_as_dict()

    def fire() -> None:
        if action.__dict__.get("_TimerAction__canceled"):
            return
        context.extend_locals(local)
        context._push_launch_configurations()
        context.launch_configurations.clear()
        context.launch_configurations.update(kept)
        _visit_all(list(action.actions), context)
        context._pop_launch_configurations()

    def begin() -> None:
        try:
            waited = float("".join(part.perform(context) for part in _parts(action.period)))
        except Exception as error:
            message = f"the timer's period is resolved once the whole file was read, and then it fails: {error}"
            notes.add("warnings", {"message": message}, action)
            return
        when: dict[str, Any] = {"after_s": waited}
        if before is not None and set(before) == {"after_s"}:
            when["after_s"] += before["after_s"]
        elif before is not None:
            when["since"] = before
        notes.later(fire, when, _TIMED, waited)

    notes.later(begin, before, _AT_ONCE)


def _happen(notes: _Notes, event: Any, context: Any) -> None:
    for handler in list(notes.handlers):
        if handler.matches(event):
            context.extend_locals({"event": event})
            if handler.handle_once and handler in notes.handlers:
                notes.handlers.remove(handler)
                handler._BaseEventHandler__handle_once = False  # the context does not know it
            _visit_all(handler.handle(event, context), context)


def _complete(notes: _Notes, event: Any, context: Any) -> None:
    """Play the completion of an action: that of a process when it ends, and that of a timer not at all."""
    from launch.actions import ExecuteLocal, TimerAction

    if isinstance(event.action, ExecuteLocal):
        when = {"on_exit_of": str((event.action.process_details or {})["name"])}
        notes.later(lambda: _happen(notes, event, context), when, _EXITS)
    elif not isinstance(event.action, TimerAction):
        when = {"on_completion_of": type(event.action).__name__}
        notes.later(lambda: _happen(notes, event, context), when, _AT_ONCE)


def _start(notes: _Notes, action: Any, context: Any) -> None:
    """Note a process, and play its start and its end."""
    from launch.event_handlers import OnProcessExit
    from launch.events.process import ProcessExited, ProcessStarted

    name = _noted(notes, action, context)
    on_exit = action.__dict__.get("_ExecuteLocal__on_exit")
    if on_exit is not None:
        notes.handlers.insert(0, OnProcessExit(target_action=action, on_exit=on_exit))
    details = {"pid": 0, **action.process_details}
    started, exited = ProcessStarted(**details), ProcessExited(returncode=0, **details)
    notes.later(lambda: _happen(notes, started, context), {"on_start_of": name}, _AT_ONCE)
    if notes.exits < _MOST_EXITS:
        notes.later(lambda: _happen(notes, exited, context), {"on_exit_of": name}, _EXITS)


def _check_output(name: str, action: Any, context: Any) -> None:
    """Let the real one say whether it knows the word for the output; where it would log is no matter here."""
    from launch.logging import get_output_loggers

    output = action.output
    chosen = output if isinstance(output, dict) else "".join(part.perform(context) for part in output)
    try:
        get_output_loggers(name, chosen)
    except OSError:
        return


def _parts(given: Any) -> list[Any]:
    from launch.utilities import normalize_to_list_of_substitutions

    plain = isinstance(given, (int, float))
    return list(normalize_to_list_of_substitutions(str(given) if plain else given))


def _text(given: Any, context: Any) -> str | None:
    return None if given is None else "".join(part.perform(context) for part in _parts(given))


def _argument(action: Any, context: Any) -> dict[str, Any]:
    default = action.default_value
    return {
        "name": str(action.name),
        "default": None if default is None else "".join(part.perform(context) for part in default),
        "description": str(action.description),
        "choices": None if action.choices is None else list(action.choices),
    }


def _included(notes: _Notes, action: Any, context: Any) -> dict[str, Any]:
    source = action.launch_description_source
    given = {_text(name, context): _text(value, context) for name, value in action.launch_arguments}
    return {"file": os.path.relpath(source.location, notes.root), "arguments": given}


def _load(notes: _Notes, action: Any, context: Any) -> None:
    """Note the nodes that would be loaded into a container."""
    target = action.__dict__.get("_LoadComposableNodes__target_container")
    name = target.node_name if hasattr(target, "node_name") else _text(target, context)
    nodes = action.__dict__.get("_LoadComposableNodes__composable_node_descriptions") or []
    wanted = [node for node in nodes if node.condition() is None or node.condition().evaluate(context)]
    listed = [
        {
            "package": _text(node.package, context),
            "plugin": _text(node.node_plugin, context),
            "name": _text(node.node_name, context),
            "namespace": _text(node.node_namespace, context),
        }
        for node in wanted
    ]
    notes.add("components", {"container": name, "components": listed}, action)


def _noted(notes: _Notes, action: Any, context: Any) -> str:
    if len(notes.found["processes"]) >= _MOST_PROCESSES:
        raise RuntimeError(f"the launch description starts more than {_MOST_PROCESSES} processes")
    details = action.process_details
    environment = {str(k): str(v) for k, v in (details["env"] or {}).items() if notes.before.get(k) != v}
    words = [str(word) for word in details["cmd"]]
    files = {word for flag, word in pairwise(words) if flag == "--params-file"}
    for text in [*words, *environment.values()]:
        _carry(text.rpartition("=")[2], notes, text in files)
    command = [_placed(word, notes) for word in words]
    environment = {name: _placed(value, notes) for name, value in environment.items()}
    given = "\n".join([*command, *environment.values()])
    kept = {name: text for name, text in notes.parameter_files.items() if f"{{parameters}}/{name}" in given}
    shown = {
        "id": str(details["name"]),
        "kind": "executable",
        "path": command[0],
        "argv": command[1:],
        "env": environment,
        "cwd": None if details["cwd"] is None else os.path.abspath(details["cwd"]),  # noqa: PTH100
        "shell": bool(action.shell),
        "emulate_tty": bool(action.emulate_tty),
        "respawn": bool(action.__dict__.get("_ExecuteLocal__respawn")),
        "respawn_delay_s": float(action.__dict__.get("_ExecuteLocal__respawn_delay") or 0.0),
        "parameter_files": kept,
        **_node(action, command, kept, context),
    }
    notes.add("processes", shown, action)
    return str(details["name"])


def _carry(path: str, notes: _Notes, always: bool) -> None:
    """Keep a file's text with the plan if it was written since the evaluation began, or is one of parameters."""
    text = _written(path, notes, always) if path.startswith("/") and path not in notes.places else None
    if text is not None:
        name = f"{len(notes.places) + 1}_{Path(path).name}"
        notes.places[path] = f"{{parameters}}/{name}"
        notes.parameter_files[name] = text


def _placed(text: str, notes: _Notes) -> str:
    for path in sorted(notes.places, key=len, reverse=True):
        text = text.replace(path, notes.places[path])
    return text


def _written(path: str, notes: _Notes, always: bool) -> str | None:
    try:
        status = Path(path).stat()
        if not Path(path).is_file() or not (always or status.st_mtime_ns >= notes.began_ns):
            return None
        return Path(path).read_text(encoding="utf-8") if status.st_size <= _MOST_BYTES else None
    except (OSError, ValueError):
        return None


def _node(action: Any, command: list[str], files: dict[str, str], context: Any) -> dict[str, Any]:
    """What a node's action has besides: its names, parameters and remappings, read off the command line."""
    from launch_ros.actions import ComposableNodeContainer, LifecycleNode, Node

    if not isinstance(action, Node):
        return {}
    rules = [word.partition(":=") for flag, word in pairwise(command) if flag == "-r"]
    given = {source: target for source, _, target in rules}
    parameters: list[dict[str, Any]] = []
    read = _beside("parameter_text").read
    for flag, word in pairwise(command):
        if flag == "--params-file":
            name = Path(word).name
            text = files.get(name)
            parameters.append({"file": name, "content": None if text is None else _content(text, read)})
        elif flag == "-p":
            name, _, value = word.partition(":=")
            parameters.append({"name": name, "value": read(value), "wildcard": True})
    kinds = {LifecycleNode: "lifecycle_node", ComposableNodeContainer: "container"}
    return {
        "kind": next((kind for cls, kind in kinds.items() if isinstance(action, cls)), "node"),
        "package": _text(action.node_package, context),
        "executable": _text(action.node_executable, context),
        "name": given.get("__node"),
        "namespace": given.get("__ns"),
        "parameters": parameters,
        "remappings": [[source, target] for source, _, target in rules if not source.startswith("__")],
    }


def _content(text: str, read: Callable[[str], Any]) -> Any:
    """The content of a parameter file, or None if a node cannot read it."""
    import yaml

    try:
        return read(text)
    except yaml.YAMLError:
        return None


def _problem(error: BaseException, root: str, file: str) -> tuple[str, dict[str, Any]]:
    """The outcome and the problem of an exception, at the student's line."""
    while error.__cause__ is not None and type(error).__name__ == "InvalidLaunchFileError":
        error = error.__cause__
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(f"{root}/")]
    where, line = (frames[-1].filename, frames[-1].lineno) if frames else (file, None)
    if isinstance(error, SyntaxError) and error.filename:
        where, line = error.filename, error.lineno
    missing = isinstance(error, ModuleNotFoundError) and not _near_launch(str(error.name))
    lacking = type(error).__name__ == "PackageNotFoundError" and _is_released(str(error))
    kinds: dict[str, Callable[[], bool]] = {
        "missing_module": lambda: missing,
        "syntax_error": lambda: isinstance(error, SyntaxError),
        "missing_package": lambda: lacking,
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
    return ("not_assessable" if missing or lacking else "error"), problem


def _near_launch(module: str) -> bool:
    """Whether a module that is not there is one of `launch`, or was meant to be."""
    return bool(difflib.get_close_matches(module.split(".")[0], ("launch", "launch_ros"), n=1, cutoff=0.85))


def _is_released(message: str) -> bool:
    """Whether the package that a message names can be had on a ROS machine, but is not on this one."""
    named = re.search(r"package '([^']+)'", message)
    return named is not None and bool(_beside("released").is_released(named[1]))


def _beside(name: str) -> Any:
    """A module beside this one, which is a script where it runs."""
    spec = importlib.util.spec_from_file_location(f"grader_{name}", Path(__file__).parent / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
