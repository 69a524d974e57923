"""One evaluation of a launch file, by the stand-in or by the real `launch`: what would be started, and when.

No process is started. Instead each one that would be is noted with what it waits for, and the events that its
start and its end would bring about are played in virtual time: first everything that happens at once, then the
timers by their time, then the ends of processes, then the shutdown. Both implementations of `launch` have the same
public interface, so that the same functions serve as `execute` of the actions of either.
"""

from __future__ import annotations

import heapq
import itertools
import math
import os
import shutil
import time
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from . import parameter_text
from .installed import ELSEWHERE, missing_data_file
from .problems import SUBSTITUTION_AS_TEXT, LimitExceededError, blame, mistake, no_action, problem_of, relative

SCHEMA = "ros-lab-grader/launch-plan/v1"

EVENT_LIMIT = 2000
PROCESS_LIMIT = 400
ENTITY_LIMIT = 10_000
LOG_LIMIT, LOG_LENGTH = 500, 2000
DEPTH_LIMIT = 150
INCLUDE_LIMIT = 20
EXIT_LIMIT = 2  # ends of processes that were started because another ended, and so on
FILE_LIMIT, FILE_BYTES = 50, 256 * 1024
_CLOCK_GRAIN_NS = 10_000_000  # by so much the times of files may be behind
_PLAN_DEPTH = 40

_AT_ONCE, _TIMED, _EXITS, _SHUTDOWN = range(4)

_KINDS = (
    *("arguments", "processes", "includes", "logs", "warnings", "shutdowns", "signals"),
    *("transitions", "loaded_components", "not_started"),
)
#: Actions of which it is noted when their condition does not hold, besides those that start processes.
_HOLD_OTHERS = ("GroupAction", "IncludeLaunchDescription", "OpaqueFunction", "TimerAction")

# By the id in `lifecycle_msgs/msg/Transition`: name, state before, state while it lasts, state after.
TRANSITIONS = {
    1: ("configure", "unconfigured", "configuring", "inactive"),
    2: ("cleanup", "inactive", "cleaningup", "unconfigured"),
    3: ("activate", "inactive", "activating", "active"),
    4: ("deactivate", "active", "deactivating", "inactive"),
    5: ("shutdown", "unconfigured", "shuttingdown", "finalized"),
    6: ("shutdown", "inactive", "shuttingdown", "finalized"),
    7: ("shutdown", "active", "shuttingdown", "finalized"),
}

_ROS_TYPES = {bool: "bool", int: "integer", float: "double", str: "string", bytes: "byte_array"}


def private(action: Any, owner: str, name: str, default: Any = None) -> Any:
    """What an action was given and does not show: in the stand-in a field, in the original a private attribute."""
    given: dict[str, Any] | None = getattr(action, "given", None)
    if given is not None and name in given:
        return given[name]
    return getattr(action, f"_{owner}__{name}", default)


def text_of(subs: Any, context: Any) -> str:
    """A list of substitutions, or what can become one, resolved."""
    from launch.utilities import normalize_to_list_of_substitutions, perform_substitutions

    return str(perform_substitutions(context, normalize_to_list_of_substitutions(subs)))


class Executor:
    """What an evaluation has found so far, and what is still to happen.

    Parameters
    ----------
    root : str
        Folder of the submission; lines are reported of the files in it.
    """

    def __init__(self, root: str = "") -> None:
        self.root = root
        self.initial_environment = dict(os.environ)
        self.found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in _KINDS}
        self.parameter_files: dict[str, str] = {}
        self.when: dict[str, Any] | None = None
        self._began_ns = time.time_ns() - _CLOCK_GRAIN_NS
        self._top: Any = None  # the include that stands for the command line
        self._top_file = ""
        self._open_includes: list[str] = []
        self._condition_of: dict[int, str] = {}
        self._executed: dict[int, Any] = {}
        self._timers: list[Any] = []
        self._completions: dict[int, Any] = {}
        self._states: dict[int, str] = {}
        self._entries: dict[int, dict[str, Any]] = {}
        self._labels: dict[str, str] = {}
        self._of_nodes: set[str] = set()
        self._names: dict[str, int] = {}
        self._deferred: list[Callable[[], None]] = []
        self._queue: list[tuple[int, float, int, int, dict[str, Any] | None, Callable[[], None]]] = []
        self._order = itertools.count()
        self._clock_s, self._stage, self._ends_before, self._visited = 0.0, _AT_ONCE, 0, 0
        self._shut_down_in: int | None = None
        self._current: Any = None

    # -- evaluation ---------------------------------------------------------------------------

    def evaluate(self, context: Any, file: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Evaluate a launch file as `ros2 launch FILE name:=value` would; returns the plan, ready for JSON."""
        given = {str(name): str(value) for name, value in arguments.items()}
        outcome, problem = "ok", None
        try:
            self._launch(context, file, given)
            self._carry_written_files()
        except BaseException as error:
            outcome, problem = problem_of(error, self.root, file, context.launch_configurations)
        if outcome == "ok":
            for name in sorted(set(given) - {entry["name"] for entry in self.found["arguments"]}):
                self.warn(f"the argument '{name}' is given, but the launch file declares no such argument", None)
        configurations = {n: v for n, v in context.launch_configurations.items() if isinstance(v, str)}
        plan = {"schema": SCHEMA, "outcome": outcome, "problem": problem, "configurations": configurations}
        plain: dict[str, Any] = _plain({**plan, **self.found, "parameter_files": self.parameter_files}, 0)
        return plain

    def _launch(self, context: Any, file: str, arguments: dict[str, str]) -> None:
        from launch import LaunchDescription
        from launch.actions import IncludeLaunchDescription
        from launch.launch_description_sources import AnyLaunchDescriptionSource

        source, self._top_file = AnyLaunchDescriptionSource(file), str(Path(file).absolute())
        self._top = IncludeLaunchDescription(source, launch_arguments=list(arguments.items()))
        self.visit_all([self._top], context, LaunchDescription())
        self._do_deferred()
        self._play()

    # -- what is found ------------------------------------------------------------------------

    def note(self, kind: str, entry: dict[str, Any], source: Any) -> dict[str, Any]:
        """Note something, with the line that wrote it; the line of what is being visited if it has none."""
        if source is not None and not hasattr(source, "source_line"):
            source = self._current
        file, line = getattr(source, "source_line", None) or (None, None)
        shown = None if file is None else relative(file, self.root)
        found = {"when": self.when, **entry, "by" if "file" in entry else "file": shown, "line": line}
        self.found[kind].append(found)
        return found

    def warn(self, message: str, source: Any) -> None:
        """Note something that does not stop the launch."""
        self.note("warnings", {"message": message}, source)

    def add_file(self, name: str, suffix: str, text: str, *, of_node: bool = False) -> str:
        """Keep the text of a file to be written when the process runs; the path as it stands in the command line.

        Parameters
        ----------
        of_node : bool
            `launch` itself writes it, out of the values that one node is given.
        """
        stem = "".join(c if c.isalnum() or c in "_-" else "_" for c in name) or "node"
        number = self._names[stem] = self._names.get(stem, 0) + 1
        self.parameter_files[f"{stem}_{number}{suffix}"] = text
        path = f"{{parameters}}/{stem}_{number}{suffix}"
        self._of_nodes |= {path} if of_node else set()
        return path

    def _warn_of_objects(self, texts: Iterable[str], source: Any) -> None:
        if any(SUBSTITUTION_AS_TEXT.search(text) for text in texts):
            message = "str() or an f-string made text of a substitution before it has a value"
            self.warn(f"{message}; write a list instead: ['text', LaunchConfiguration(...)]", source)

    # -- visiting -----------------------------------------------------------------------------

    def visit_all(self, entities: Any, context: Any, parent: Any, depth: int = 0) -> None:
        """Visit entities, and what they yield, in order.

        Raises
        ------
        LimitExceededError
            They are nested without end, or there are too many.
        AttributeError
            One of them is no entity.
        """
        from launch import LaunchDescriptionEntity

        if depth > DEPTH_LIMIT:
            raise LimitExceededError("the launch description is nested without end")
        if isinstance(entities, LaunchDescriptionEntity):
            raise mistake(
                TypeError, f"'{type(entities).__name__}' object is not iterable", "not_a_list", "Make it a list."
            )
        for position, entity in enumerate(() if entities is None else entities, start=1):
            if not hasattr(entity, "visit"):
                raise no_action(entity, position, parent)
            included = len(self._open_includes)
            try:
                self._visited += 1
                if self._visited > ENTITY_LIMIT:
                    raise LimitExceededError(f"the launch description has more than {ENTITY_LIMIT} actions")
                self._current = entity
                self.visit_all(entity.visit(context), context, entity, depth + 1)
            except Exception as error:
                blame(error, entity)
                raise
            finally:
                del self._open_includes[included:]

    def visit_action(self, action: Any, context: Any) -> Any:
        """Carry out an action if its condition holds, and let it be known that it is complete."""
        from launch.events import ExecutionComplete

        if action.condition is not None:
            holds = action.condition.evaluate(context)
            described = action.condition.describe()
            self._condition_of[id(action)] = f"{described} holds"
            if not holds:
                if hasattr(action, "process_description") or type(action).__name__ in _HOLD_OTHERS:
                    entry = {"what": type(action).__name__, "why": f"{described} does not hold"}
                    self.note("not_started", entry, action)
                return None
        result = action.execute(context)
        event = ExecutionComplete(action=action)
        if context.would_handle_event(event):
            context.emit_event_sync(event)
        return result

    # -- time ---------------------------------------------------------------------------------

    def defer(self, work: Callable[[], None]) -> None:
        """Do something once all entities of the event that is being handled were visited, as a task would."""
        self._deferred.append(work)

    def _do_deferred(self) -> None:
        while self._deferred:
            self._deferred.pop(0)()

    def later(
        self, work: Callable[[], None], when: dict[str, Any] | None, phase: int = _AT_ONCE, after_s: float = 0.0
    ) -> None:
        """Queue something."""
        entry = (phase, self._clock_s + after_s, next(self._order), self._ends_before, when, work)
        heapq.heappush(self._queue, entry)

    def _play(self) -> None:
        for _ in range(EVENT_LIMIT):
            if not self._queue:
                return
            phase, self._clock_s, _order, before, self.when, work = heapq.heappop(self._queue)
            self._ends_before = before + (phase == _EXITS)
            self._stage = max(self._stage, phase)
            try:
                work()
                self._do_deferred()
            except Exception as error:
                if phase < _EXITS or isinstance(error, LimitExceededError):
                    raise
                self.warn(f"when this happens, it fails: {error}", _Line(getattr(error, "launch_source", None)))
        endless = LimitExceededError(f"the launch description gives rise to more than {EVENT_LIMIT} events")
        blame(endless, self._current)
        raise endless

    def _happen(self, event: Any, context: Any) -> None:
        if self._stage >= _EXITS and self._shut_down_in == _TIMED:
            context._set_is_shutdown(False)  # processes may have ended before the time of the shutdown
        for handler in list(context._event_handlers):
            if not handler.matches(event):
                continue
            self._current = handler
            context._push_locals()
            context.extend_locals({"event": event})
            try:
                entities = handler.handle(event, context)
                listed = entities if isinstance(entities, (list, tuple)) else [entities]
                self.visit_all([entity for entity in listed if entity is not None], context, handler)
            except Exception as error:
                blame(error, handler)
                raise
            finally:
                context._pop_locals()

    def emit(self, event: Any, context: Any) -> None:
        """Let an event happen: at once, or when that which it tells of would."""
        from launch.events import ExecutionComplete, Shutdown
        from launch.events.process import ProcessTargetedEvent

        if isinstance(event, ExecutionComplete):
            self._complete(event, context)
        elif isinstance(event, Shutdown):
            self.note("shutdowns", {"reason": str(event.reason)}, event)
            if self._shut_down_in is None:
                self._shut_down_in = self._stage
                phase = _AT_ONCE if self._stage < _EXITS else _SHUTDOWN
                self.later(lambda: self._shut_down(event, context), {"on_shutdown": True}, phase)
        else:
            if isinstance(event, ProcessTargetedEvent):
                self.note("signals", {"signal": getattr(event, "signal_name", "SIGINT")}, event)
            self.later(lambda: self._happen(event, context), self.when)

    def _shut_down(self, event: Any, context: Any) -> None:
        # What the handlers start is started still: that of the launch itself, which forbids it, is asked last.
        self._happen(event, context)
        self._do_deferred()
        context._set_is_shutdown(True)
        for timer in self._timers:
            timer.cancel()

    def _complete(self, event: Any, context: Any) -> None:
        from launch.actions import ExecuteLocal, TimerAction

        action = event.action
        if isinstance(action, TimerAction):
            self._completions[id(action)] = event  # it is over when the time has passed
        elif isinstance(action, ExecuteLocal):
            when = {"on_exit_of": str((action.process_details or {}).get("name"))}
            if self._ends_before < EXIT_LIMIT:
                self.later(lambda: self._happen(event, context), when, _EXITS)
        else:
            self.later(lambda: self._happen(event, context), {"on_completion_of": type(action).__name__})

    # -- what actions do ----------------------------------------------------------------------

    def declare(self, action: Any, context: Any) -> None:
        """Note the argument that `DeclareLaunchArgument` declares."""
        default = None
        if action.default_value is not None:
            try:
                default = text_of(action.default_value, context)
            except Exception:
                if action.name not in context.launch_configurations:
                    raise
        entry = {
            "name": str(action.name),
            "default": default,
            "description": str(private(action, "", "description", action.description) or ""),
            "choices": None if action.choices is None else [str(choice) for choice in action.choices],
            "included": len(self._open_includes) > 0,
        }
        self.note("arguments", entry, action)

    def enter(self, action: Any, context: Any) -> None:
        """Note the launch file that `IncludeLaunchDescription` includes.

        Raises
        ------
        LimitExceededError
            It includes itself without end.
        """
        if action is self._top:
            return
        file = str(Path(action.launch_description_source.location).absolute())
        self._open_includes.append(file)
        if self._open_includes.count(file) + (file == self._top_file) > INCLUDE_LIMIT:
            remedy = "Include another file, or put the include under a condition."
            message = f"'{relative(file, self.root)}' includes itself without end"
            raise mistake(LimitExceededError, message, "include_recursive", remedy)
        given = {text_of(name, context): text_of(value, context) for name, value in action.launch_arguments}
        self.note("includes", {"file": relative(file, self.root), "arguments": given}, action)

    def is_command_line(self, include: Any) -> bool:
        """Whether an include is the one of the launch file itself."""
        return include is self._top

    def log(self, action: Any, context: Any) -> None:
        """Note what `LogInfo` says, unless the launch file has said more than anybody reads."""
        message = text_of(action.msg, context)
        if len(self.found["logs"]) < LOG_LIMIT:
            self.note("logs", {"message": message[:LOG_LENGTH]}, action)

    def wait(self, action: Any, context: Any) -> None:
        """Play the actions of `TimerAction` when its time has come, with the configurations of now."""
        from launch.utilities.type_utils import perform_typed_substitution

        if private(action, "TimerAction", "canceled"):
            return
        kept, before, local = dict(context.launch_configurations), self.when, dict(context.get_locals_as_dict())
        if perform_typed_substitution(context, private(action, "TimerAction", "cancel_on_shutdown", True), bool):
            self._timers.append(action)

        def fire() -> None:
            if private(action, "TimerAction", "canceled"):
                return
            context._push_locals()
            context.extend_locals(local)
            context._push_launch_configurations()
            context.launch_configurations.clear()
            context.launch_configurations.update(kept)
            try:
                self.visit_all(list(action.actions), context, action)
            except Exception as error:
                blame(error, action)
                raise
            finally:
                context._pop_launch_configurations()
                context._pop_locals()

        def begin() -> None:
            # The time is resolved in a task, when a scope around the timer has ended already.
            try:
                period_s = max(0.0, float(perform_typed_substitution(context, action.period, float)))
            except Exception as error:
                message = f"the timer's period is resolved once the whole file was read, and then it fails: {error}"
                self.warn(f"{message}; what waits for it never starts", action)
                return
            when = _after(period_s, before)
            self.later(fire, when, _TIMED, period_s)
            if completion := self._completions.get(id(action)):
                self.later(lambda: self._happen(completion, context), when, _TIMED, period_s)

        self.defer(begin)

    def skip_coroutine(self, action: Any, context: Any) -> None:
        """Note that what `OpaqueCoroutine` would run is not evaluated."""
        self.note("not_started", {"what": "OpaqueCoroutine", "why": "coroutines are not evaluated"}, action)

    def follow_sim_time(self, action: Any, context: Any) -> None:
        """Warn of `SetUseSimTime`, of which no node gets anything.

        Raises
        ------
        RuntimeError
            It is to end simulation time, which it cannot.
        """
        from launch.utilities.type_utils import perform_typed_substitution

        if not perform_typed_substitution(context, action.value, bool):
            raise RuntimeError("SetUseSimTime can only set the parameter use_sim_time to true")
        message = "SetUseSimTime is for the timers of the launch itself, and no node gets use_sim_time by it"
        self.warn(f"{message}; SetParameter('use_sim_time', True) would do that", action)

    # -- processes ----------------------------------------------------------------------------

    def start(self, action: Any, context: Any) -> None:
        """Note the process that `ExecuteLocal` would start, and play its start and its end.

        Raises
        ------
        RuntimeError
            The same action has started a process before.
        LimitExceededError
            There are too many processes.
        """
        from launch.event_handlers import OnProcessExit
        from launch.events.process import ProcessExited, ProcessStarted

        action.prepare(context)
        details = {"pid": 0, **action.process_details}
        name = str(details["name"])
        if id(action) in self._executed:
            message = f"the process '{name}' is started twice: the same action stands in two places"
            raise mistake(RuntimeError, message, "started_twice", "Put each action into the description once.")
        self._executed[id(action)] = action
        if context.is_shutdown:
            return
        if len(self.found["processes"]) >= PROCESS_LIMIT:
            raise LimitExceededError(f"the launch description starts more than {PROCESS_LIMIT} processes")
        entry = self._entries[id(action)] = self.note("processes", self._process(action, context), action)
        on_exit = private(action, "ExecuteLocal", "on_exit")
        if on_exit is not None:
            context.register_event_handler(OnProcessExit(target_action=action, on_exit=on_exit))
        self.defer(lambda: self._settle_tty(action, entry, context))
        started, exited = ProcessStarted(**details), ProcessExited(returncode=0, **details)
        self.later(lambda: self._happen(started, context), {"on_start_of": name})
        if self._ends_before < EXIT_LIMIT:
            self.later(lambda: self._happen(exited, context), {"on_exit_of": name}, _EXITS)

    def _process(self, action: Any, context: Any) -> dict[str, Any]:
        description, details = action.process_description, action.process_details
        words = [str(word) for word in details["cmd"]]
        before, after = self.initial_environment, {str(k): str(v) for k, v in (details["env"] or {}).items()}
        replaces = description.env is not None
        prefixed = len(words) - len(description.cmd)
        path, argv = words[prefixed], words[prefixed + 1 :]
        self._warn_of_objects([*words, *after.values()], action)
        if not action.shell:
            found = shutil.which(path, path=context.environment.get("PATH"))
            if found is None and not path.startswith(f"{ELSEWHERE}/"):
                self.warn(f"the program '{path}' is not found, so it cannot start", action)
            path = found or path
        return {
            "id": str(details["name"]),
            "kind": "executable",
            "package": None,
            "executable": os.path.basename(words[prefixed]),  # noqa: PTH119 - keeps a trailing slash
            "name": None,
            "namespace": None,
            "prefix": words[:prefixed],
            "path": path,
            "argv": argv,
            "env": {name: value for name, value in after.items() if replaces or before.get(name) != value},
            "env_unset": [] if replaces else sorted(set(before) - set(after)),
            "env_replaces": replaces,
            "cwd": None if details["cwd"] is None else os.path.abspath(details["cwd"]),  # noqa: PTH100
            "parameters": [],
            "remappings": [],
            "output": self._output(action, context),
            "respawn": bool(private(action, "ExecuteLocal", "respawn")),
            "respawn_delay_s": self._number(action, "respawn_delay", 0.0),
            "respawn_max_retries": self._number(action, "respawn_max_retries", -1),
            "emulate_tty": bool(action.emulate_tty),
            "shell": bool(action.shell),
            "sigterm_timeout_s": self._seconds(action, "sigterm_timeout", context),
            "sigkill_timeout_s": self._seconds(action, "sigkill_timeout", context),
            "condition_note": self._condition_of.get(id(action), ""),
            "absent": "",
            **self._node(action, [path, *argv], context),
        }

    def _number(self, action: Any, name: str, default: float) -> float:
        """A number that is not looked at before the process ended."""
        value = private(action, "ExecuteLocal", name)
        if value is None or isinstance(value, (int, float)):
            return value or default
        message = f"{name} must be a number, but it is of type '{type(value).__name__}'"
        self.warn(f"{message}; the launch fails when it would start the process again", action)
        return default

    def _seconds(self, action: Any, name: str, context: Any) -> float:
        """A time that is not resolved before the launch ends."""
        try:
            return float(text_of(getattr(action, name), context))
        except Exception as error:
            self.warn(f"{name} fails when the launch ends: {error}", action)
            return 5.0

    def _output(self, action: Any, context: Any) -> Any:
        """Where the output goes, which `launch` itself checks; where it would log is no matter here."""
        from launch.logging import get_output_loggers

        chosen = action.output if isinstance(action.output, dict) else text_of(action.output, context)
        try:
            get_output_loggers(action.process_details["name"], chosen)
        except OSError:
            return chosen
        if isinstance(chosen, str):
            return chosen
        return {stream: [words] if isinstance(words, str) else sorted(words) for stream, words in chosen.items()}

    def _settle_tty(self, action: Any, entry: dict[str, Any], context: Any) -> None:
        # The task that starts the process looks at the configuration, after the whole file was read.
        from launch.conditions import evaluate_condition_expression
        from launch.utilities import normalize_to_list_of_substitutions

        if "emulate_tty" not in context.launch_configurations:
            return
        try:
            text = normalize_to_list_of_substitutions(context.launch_configurations["emulate_tty"])
            entry["emulate_tty"] = evaluate_condition_expression(context, text)
        except Exception as error:
            blame(error, action)
            raise

    # -- nodes --------------------------------------------------------------------------------

    def _node(self, action: Any, words: list[str], context: Any) -> dict[str, Any]:
        """What a node has besides: its names, and the parameters and rules that stand on its command line."""
        from launch_ros.actions import ComposableNodeContainer, LifecycleNode, Node

        if not isinstance(action, Node):
            return {}
        kinds = {LifecycleNode: "lifecycle_node", ComposableNodeContainer: "container"}
        namespace, _, name = action.node_name.rpartition("/")
        known = action.expanded_node_namespace != Node.UNSPECIFIED_NODE_NAMESPACE
        named = name != Node.UNSPECIFIED_NODE_NAME
        package = None if action.node_package is None else text_of(action.node_package, context)
        node: dict[str, Any] = {
            "kind": next((kind for cls, kind in kinds.items() if isinstance(action, cls)), "node"),
            "package": package,
            "executable": text_of(action.node_executable, context),
            "name": name if named else None,
            "namespace": action.expanded_node_namespace if known else None,
            "parameters": self._parameters(words, name, action),
            "remappings": [list(rule) for rule in action.expanded_remapping_rules or []],
            "parameter_files": {n: t for n, t in self.parameter_files.items() if f"{{parameters}}/{n}" in words},
        }
        if words[0].startswith(f"{ELSEWHERE}/lib/{package}/") and not os.access(words[0], os.X_OK):
            node["absent"] = f"the package '{package}' is not installed where this is evaluated"
        same = [p for p in self.found["processes"] if (p["name"], p["namespace"]) == (node["name"], node["namespace"])]
        if known and named and same:
            self.warn(f"two nodes have the name '{namespace.rstrip('/')}/{name}'", action)
        return node

    def _parameters(self, words: list[str], label: str, action: Any) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        ros_words = words[words.index("--ros-args") :]
        for flag, word in pairwise(ros_words):
            name, is_rule, value = word.partition(":=")
            if flag in ("-p", "--param") and is_rule:
                # What is on the command line is for any node of the process, as `/**` in a file is.
                found.append({**_parameter(name, _read_or_text(value)), "wildcard": True})
            elif flag == "--params-file":
                found += self._file_of_parameters(word, label, action)
        return found

    def _file_of_parameters(self, path: str, label: str, action: Any) -> list[dict[str, Any]]:
        """A file as one entry, or an entry for each value if `launch_ros` has written it."""
        of_node = path in self._of_nodes or Path(path).name.startswith("launch_params_")
        try:
            text = self._text_of_file(path)
            content = parameter_text.read(text)
        except Exception as error:
            message = f"the parameter file '{path}' cannot be read, so the node will not start: {error}"
            self.warn(message, action)
            return [{"file": path, "content": None}]
        self._labels[path] = label.strip("<>")
        self._warn_of_lost_texts(text, content, action)
        own = isinstance(content, Mapping) and set(content) <= {"/**", action.node_name}
        values = _only_section(content) if of_node and own else None
        if values is None:
            return [{"file": path, "content": content}]
        return [_parameter(name, value) for name, value in values.items()]

    def _warn_of_lost_texts(self, text: str, content: Any, action: Any) -> None:
        """Warn of texts that PyYAML wrote without quotes, and that the node reads as something else."""
        import yaml

        if "!!python/" in text:
            kind = text.partition("!!python/")[2].split()[0].partition(":")[2].removesuffix(".scalar")
            message = f"the value of a parameter is a {kind}, which a node cannot read, so it will not start"
            self.warn(f"{message}; write float(...)", action)
            return
        written, read = _only_section(yaml.safe_load(text)) or {}, _only_section(content) or {}
        self._warn_of_objects([value for value in written.values() if isinstance(value, str)], action)
        for name, given in written.items():
            for item, became in zip(_listed(given), _listed(read.get(name)), strict=False):
                if isinstance(item, str) and not isinstance(became, str):
                    message = f"the text '{item}' of the parameter '{name}' is written without quotes for the node"
                    self.warn(f"{message}, which reads it as {ros_type(became)}", action)

    def load(self, action: Any, context: Any) -> None:
        """Note the nodes that `LoadComposableNodes` would load into a container."""
        nodes = private(action, "LoadComposableNodes", "composable_node_descriptions") or []
        wanted = [node for node in nodes if node.condition() is None or node.condition().evaluate(context)]
        target = private(action, "LoadComposableNodes", "target_container")
        components = [self._component(node, context) for node in wanted]
        if id(target) in self._entries:
            self._entries[id(target)]["components"] = components
            return
        container = target.node_name if hasattr(target, "node_name") else text_of(target, context)
        self.note("loaded_components", {"container": container, "components": components}, action)

    def _component(self, node: Any, context: Any) -> dict[str, Any]:
        from launch_ros.utilities import make_namespace_absolute, prefix_namespace

        def text(subs: Any) -> str | None:
            return None if subs is None else text_of(subs, context)

        base = context.launch_configurations.get("ros_namespace")
        rules = [list(rule) for rule in context.launch_configurations.get("ros_remaps") or []]
        file, line = getattr(node, "source_line", None) or (None, None)
        return {
            "package": text(node.package),
            "plugin": text(node.node_plugin),
            "name": text(node.node_name),
            "namespace": make_namespace_absolute(prefix_namespace(base, text(node.node_namespace))),
            "parameters": self._parameters_of_component(node, context),
            "remappings": [*rules, *([text(a), text(b)] for a, b in node.remappings or [])],
            "file": None if file is None else relative(file, self.root),
            "line": line,
        }

    def _parameters_of_component(self, node: Any, context: Any) -> list[dict[str, Any]]:
        """What `launch` sends to the container: it reads files itself."""
        import yaml
        from launch_ros.descriptions import Parameter
        from launch_ros.utilities import evaluate_parameters

        found: list[dict[str, Any]] = []
        shared = context.launch_configurations.get("global_params") or []
        for item in [*shared, *evaluate_parameters(context, node.parameters or ())]:
            if isinstance(item, tuple):
                found.append(_parameter(*item))
            elif isinstance(item, Mapping):
                found += [_parameter(name, value) for name, value in item.items()]
            elif isinstance(item, Parameter):
                found.append(_parameter(*item.evaluate(context)))
            else:
                found.append({"file": str(item), "content": yaml.safe_load(self._text_of_file(str(item)))})
        return found

    def _text_of_file(self, path: str) -> str:
        kept = self.parameter_files.get(path.removeprefix("{parameters}/"))
        return Path(path).read_text() if kept is None else kept

    def warn_of_missing_file(self, path: str, source: Any) -> None:
        """Warn of a file of parameters that is not there: the node starts without it."""
        message = f"the parameter file '{path}' does not exist, so the node starts without it"
        if missing := missing_data_file(path, self.root):
            message = f"the parameter file '{missing[0]}' is not installed, so the node starts without it"
            message += f": add to {missing[1]}: {missing[2]}"
        self.warn(message, source)

    # -- lifecycle nodes ----------------------------------------------------------------------

    def start_lifecycle(self, action: Any, context: Any) -> Any:
        """Note a lifecycle node, whose changes of state are played as if each of them went well."""
        from launch import EventHandler
        from launch.actions import OpaqueFunction
        from launch_ros.actions import LifecycleTransition, Node
        from launch_ros.events.lifecycle import ChangeState

        change = OpaqueFunction(function=lambda context: self._change_state(action, context))
        handler = EventHandler(matcher=lambda event: isinstance(event, ChangeState), entities=[change])
        context.register_event_handler(handler)
        Node.execute(action, context)
        autostart = bool(private(action, "LifecycleNode", "autostart"))
        if id(action) in self._entries:
            self._entries[id(action)]["autostart"] = autostart
        if not autostart:
            return None
        started = LifecycleTransition(lifecycle_node_names=[action.node_name], transition_ids=[1, 3])
        started.source_line = action.source_line
        return [started]

    def _change_state(self, action: Any, context: Any) -> None:
        from launch_ros.events.lifecycle import StateTransition

        event = context.locals.event
        if not event.lifecycle_node_matcher(action) or event.transition_id not in TRANSITIONS:
            return
        label, before, meanwhile, after = TRANSITIONS[event.transition_id]
        name = str((action.process_details or {}).get("name"))
        self.note("transitions", {"process": name, "transition": label}, event)
        state = self._states.get(id(action), "unconfigured")
        if before != state:
            message = f"{action.node_name} is asked to {label}, which it can only from the state '{before}'"
            self.warn(f"{message}; it is '{state}' by then", event)
            return
        self._states[id(action)] = after
        for transition, start, goal in ((label, before, meanwhile), ("transition_success", meanwhile, after)):
            labels = {"transition": transition, "start_state": start, "goal_state": goal}
            told = SimpleNamespace(timestamp=0, **{key: SimpleNamespace(label=text) for key, text in labels.items()})
            change = StateTransition(action=action, msg=told)
            when = {"on_transition_of": name, "state": goal}
            self.later(lambda change=change: self._happen(change, context), when)  # type: ignore[misc]

    # -- files --------------------------------------------------------------------------------

    def _carry_written_files(self) -> None:
        """Put the files that processes are given, and that were written meanwhile, where the nodes will find them."""
        places: dict[str, str] = {}
        for process in self.found["processes"]:
            values = [p["value"] for p in process["parameters"] if isinstance(p.get("value"), str)]
            for text in [process["path"], *process["argv"], *process["env"].values(), *values]:
                for path in (text, *text.split("=")[1:]):
                    written = None if path in places or len(places) >= FILE_LIMIT else self._written(path)
                    if written is not None:
                        places[path] = self._added(path, written)
        for process in self.found["processes"] if places else ():
            self._replace(process, places)

    def _added(self, path: str, text: str) -> str:
        stem, suffix = os.path.splitext(os.path.basename(path))  # noqa: PTH119, PTH122
        suffix = suffix if suffix[1:].isalnum() else ""
        if stem.startswith("launch_params_") and path in self._labels:
            stem, suffix = self._labels[path], ".yaml"
        return self.add_file(stem, suffix, text)

    def _written(self, path: str) -> str | None:
        if not path.startswith("/"):
            return None
        # A file of parameters that came with ROS is there while the file is evaluated, and not afterwards.
        foreign = path in self._labels and not Path(path).is_relative_to(Path(self.root).parent)
        try:
            status = os.stat(path)  # noqa: PTH116
            wanted = foreign or status.st_mtime_ns >= self._began_ns
            if not wanted or status.st_size > FILE_BYTES or not os.path.isfile(path):  # noqa: PTH113
                return None
            return Path(path).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return None

    def _replace(self, process: dict[str, Any], places: dict[str, str]) -> None:
        def replaced(text: str) -> str:
            for path in sorted(places, key=len, reverse=True):
                text = text.replace(path, places[path])
            return text

        process["path"] = replaced(process["path"])
        process["argv"] = [replaced(word) for word in process["argv"]]
        process["env"] = {name: replaced(value) for name, value in process["env"].items()}
        own = {name: replaced(text) for name, text in process.get("parameter_files", {}).items()}
        given = [process["path"], *process["argv"], *process["env"].values(), *own.values()]
        for place in places.values():
            if any(place in text for text in given):
                name = place.removeprefix("{parameters}/")
                own[name] = self.parameter_files[name]
        process["parameter_files"] = own
        self.parameter_files.update(own)


class _Line:
    """A line, where an object is wanted that knows its own."""

    def __init__(self, source_line: Any) -> None:
        self.source_line = source_line


def _after(period_s: float, before: dict[str, Any] | None) -> dict[str, Any]:
    """When something happens that waits for a time, and began to wait some while after the start."""
    if before is None:
        return {"after_s": period_s}
    if set(before) == {"after_s"}:
        return {"after_s": period_s + before["after_s"]}
    return {"after_s": period_s, "since": before}


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _only_section(content: Any) -> dict[str, Any] | None:
    """The values of a file that `launch_ros` writes: one pattern, and under it names with their values."""
    section = next(iter(content.values())) if isinstance(content, Mapping) and len(content) == 1 else None
    values = section.get("ros__parameters") if isinstance(section, Mapping) and len(section) == 1 else None
    return dict(values) if isinstance(values, Mapping) else None


def _read_or_text(text: str) -> Any:
    """What a node makes of a value behind `-p name:=`: quotes, and with them text, may be lost."""
    import yaml

    try:
        return parameter_text.read(text)
    except yaml.YAMLError:
        return text


def ros_type(value: Any) -> str:
    """The ROS type that a parameter of a value has."""
    if isinstance(value, (list, tuple)):
        return f"{_ROS_TYPES.get(type(value[0]), 'string')}_array" if value else "not_set"
    return _ROS_TYPES.get(type(value), type(value).__name__)


def _parameter(name: str, value: Any) -> dict[str, Any]:
    return {"name": name, "value": value, "type": ros_type(value)}


def _plain(value: Any, depth: int) -> Any:
    """A value as JSON can hold it, no deeper than a plan is."""
    if depth > _PLAN_DEPTH:
        return "…"
    if isinstance(value, Mapping):
        return {str(name): _plain(item, depth + 1) for name, item in value.items()}
    if isinstance(value, (list, tuple, bytes)):
        return [_plain(item, depth + 1) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"!!float": str(float(value))}
    if isinstance(value, (bool, int, float)) or value is None:
        return value
    try:
        return str(value)
    except Exception:
        return f"<{type(value).__name__}>"
