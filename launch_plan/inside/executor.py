"""One evaluation of a launch file, with the stand-in or with the real `launch`.

No process is started. Each process of the launch is noted with the moment of its start. The events of starts and exits
are played in virtual time: first immediate ones, then timers by their time, then exits of processes, then the shutdown.
The actions of both implementations call the same methods.
"""

from __future__ import annotations

import heapq
import itertools
import math
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from launch_plan.format import NO_JSON, PROCESS_LIMIT, SCHEMA
from launch_plan.inside.files import PlanFiles
from launch_plan.inside.installed import SubmittedModules, missing_data_file
from launch_plan.inside.problems import (
    LimitExceededError,
    blame,
    blaming,
    mistake,
    no_action,
    place_of,
    problem_of,
    relative,
)
from launch_plan.inside.processes import Describer, private, process_name, text_of

#: Most events, visited actions, kept log messages with their length, levels of nesting, and includes of one file.
EVENT_LIMIT = 2000
ENTITY_LIMIT = 10_000
LOG_LIMIT, LOG_LENGTH = 500, 2000
DEPTH_LIMIT = 150
INCLUDE_LIMIT = 20
#: Most exits in a row, each of a process that the previous exit started.
EXIT_LIMIT = 2
#: Most levels of a value in the plan.
_PLAN_DEPTH = 40

#: Phases of virtual time.
_AT_ONCE, _TIMED, _EXITS, _SHUTDOWN = range(4)

#: Lists of a plan.
_KINDS = (
    *("arguments", "processes", "includes", "logs", "warnings", "shutdowns", "signals"),
    *("transitions", "loaded_components", "not_started"),
)
#: Actions listed in `not_started` if their condition does not hold, besides those that start processes.
_HOLD_OTHERS = ("GroupAction", "IncludeLaunchDescription", "OpaqueFunction", "TimerAction")

#: Name, previous state, state during the transition and next state, by the id in `lifecycle_msgs/msg/Transition`.
TRANSITIONS = {
    1: ("configure", "unconfigured", "configuring", "inactive"),
    2: ("cleanup", "inactive", "cleaningup", "unconfigured"),
    3: ("activate", "inactive", "activating", "active"),
    4: ("deactivate", "active", "deactivating", "inactive"),
    5: ("shutdown", "unconfigured", "shuttingdown", "finalized"),
    6: ("shutdown", "inactive", "shuttingdown", "finalized"),
    7: ("shutdown", "active", "shuttingdown", "finalized"),
}


class _Entry(NamedTuple):
    """Something that will happen, ordered by phase, time and order of its noting."""

    phase: int
    time_s: float
    order: int
    exits_before: int
    when: dict[str, Any] | None
    work: Callable[[], None]


class Executor:
    """Findings of an evaluation so far, and the events still to come; `root` is the submission's folder."""

    def __init__(self, root: str = "") -> None:
        self.root = root
        self.initial_environment = dict(os.environ)
        self.found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in _KINDS}
        self.files = PlanFiles(root)
        self._describer = Describer(self)
        self.when: dict[str, Any] | None = None
        #: The include of the launch file itself, in place of the command line.
        self._top: Any = None
        self._top_file = ""
        self._open_includes: list[str] = []
        self._condition_of: dict[int, str] = {}
        self._executed: dict[int, Any] = {}
        self._timers: list[Any] = []
        self._completions: dict[int, Any] = {}
        self._states: dict[int, str] = {}
        self._entries: dict[int, dict[str, Any]] = {}
        self._deferred: list[Callable[[], None]] = []
        self._queue: list[_Entry] = []
        self._order = itertools.count()
        self._clock_s = 0.0
        self._stage = _AT_ONCE
        self._exits_before = 0
        self._visited = 0
        self._shut_down_in: int | None = None
        self._current: Any = None

    # -- evaluation ---------------------------------------------------------------------------

    def evaluate(self, context: Any, file: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Evaluate a launch file as `ros2 launch FILE name:=value` would, and return the plan, ready for JSON."""
        given = {str(name): str(value) for name, value in arguments.items()}
        sys.meta_path.append(SubmittedModules(self.root))
        sys.argv = ["ros2", "launch", file, *(f"{name}:={value}" for name, value in given.items())]
        outcome = "ok"
        problem = None
        try:
            self._launch(context, file, given)
            self.files.carry_written(self.found["processes"])
            self._warn_of_undeclared(given)
        except BaseException as error:
            outcome, problem = problem_of(error, self.root, file, context.launch_configurations)
        configurations: dict[str, str] = {}
        for name, value in context.launch_configurations.items():
            if isinstance(value, str):
                configurations[name] = value
        plan = {
            "schema": SCHEMA,
            "outcome": outcome,
            "problem": problem,
            "configurations": configurations,
            **self.found,
            "parameter_files": self.files.texts,
        }
        plain: dict[str, Any] = _plain(plan, 0)
        return plain

    def _warn_of_undeclared(self, given: Mapping[str, str]) -> None:
        declared = {entry["name"] for entry in self.found["arguments"]}
        for name in sorted(set(given) - declared):
            message = (
                f"the argument '{name}' is given, but the launch file declares no such argument"
            )
            self.warn(message, None)

    def _launch(self, context: Any, file: str, arguments: dict[str, str]) -> None:
        from launch import LaunchDescription
        from launch.actions import IncludeLaunchDescription
        from launch.launch_description_sources import AnyLaunchDescriptionSource

        source = AnyLaunchDescriptionSource(file)
        self._top_file = str(Path(file).absolute())
        self._top = IncludeLaunchDescription(source, launch_arguments=list(arguments.items()))
        self.visit_all([self._top], context, LaunchDescription())
        self._do_deferred()
        self._play()

    # -- findings -----------------------------------------------------------------------------

    def note(self, kind: str, entry: dict[str, Any], source: Any) -> dict[str, Any]:
        """Add an entry to a list of the plan, with the line of its source or else of the action being visited."""
        if source is not None and not hasattr(source, "source_line"):
            source = self._current
        file, line = place_of(source, self.root)
        # An include has a file of its own.
        key = "by" if "file" in entry else "file"
        found = {"when": self.when, **entry, key: file, "line": line}
        self.found[kind].append(found)
        return found

    def warn(self, message: str, source: Any) -> None:
        """Note a mistake that does not stop the launch."""
        self.note("warnings", {"message": message}, source)

    def warn_of_missing_file(self, path: str, source: Any) -> None:
        """Warn of a missing parameter file."""
        missing = missing_data_file(path, self.root)
        if missing is None:
            message = f"the parameter file '{path}' does not exist, so the node starts without it"
            self.warn(message, source)
            return
        file, build, line = missing
        message = f"the parameter file '{file}' is not installed, so the node starts without it"
        self.warn(f"{message}: add to {build}: {line}", source)

    # -- visiting -----------------------------------------------------------------------------

    def visit_all(self, entities: Any, context: Any, parent: Any, depth: int = 0) -> None:
        """Visit entities in order, each followed by the entities that its visit returns."""
        from launch import LaunchDescriptionEntity

        if depth > DEPTH_LIMIT:
            raise LimitExceededError("the launch description is nested without end")
        if isinstance(entities, LaunchDescriptionEntity):
            message = f"'{type(entities).__name__}' object is not iterable"
            raise mistake(TypeError, message, "not_a_list", "Make it a list.")
        for position, entity in enumerate(() if entities is None else entities, start=1):
            if not hasattr(entity, "visit"):
                raise no_action(entity, position, parent)
            included = len(self._open_includes)
            try:
                with blaming(entity):
                    self._count_visit()
                    self._current = entity
                    self.visit_all(entity.visit(context), context, entity, depth + 1)
            finally:
                del self._open_includes[included:]

    def _count_visit(self) -> None:
        self._visited += 1
        if self._visited > ENTITY_LIMIT:
            message = f"the launch description has more than {ENTITY_LIMIT} actions"
            raise LimitExceededError(message)

    def visit_action(self, action: Any, context: Any) -> Any:
        """Execute an action if its condition holds, and tell the handlers of its completion."""
        from launch.events import ExecutionComplete

        if action.condition is not None and not self._condition_holds(action, context):
            return None
        result = action.execute(context)
        event = ExecutionComplete(action=action)
        if context.would_handle_event(event):
            context.emit_event_sync(event)
        return result

    def _condition_holds(self, action: Any, context: Any) -> bool:
        """Return whether the condition of an action holds, and note the result."""
        holds = bool(action.condition.evaluate(context))
        described = action.condition.describe()
        self._condition_of[id(action)] = f"{described} holds"
        title = type(action).__name__
        noted = hasattr(action, "process_description") or title in _HOLD_OTHERS
        if not holds and noted:
            entry = {"what": title, "why": f"{described} does not hold"}
            self.note("not_started", entry, action)
        return holds

    # -- time ---------------------------------------------------------------------------------

    def defer(self, work: Callable[[], None]) -> None:
        """Call a function after all entities of the current event are visited, as a task of `launch` would run."""
        self._deferred.append(work)

    def _do_deferred(self) -> None:
        while self._deferred:
            self._deferred.pop(0)()

    def later(
        self,
        work: Callable[[], None],
        when: dict[str, Any] | None,
        phase: int = _AT_ONCE,
        after_s: float = 0.0,
    ) -> None:
        """Queue a function for a phase and a time."""
        time_s = self._clock_s + after_s
        entry = _Entry(phase, time_s, next(self._order), self._exits_before, when, work)
        heapq.heappush(self._queue, entry)

    def _play(self) -> None:
        """Call the queued functions in order; raise an error if there is no end to them."""
        for _ in range(EVENT_LIMIT):
            if not self._queue:
                return
            entry = heapq.heappop(self._queue)
            self._clock_s = entry.time_s
            self.when = entry.when
            self._exits_before = entry.exits_before + (entry.phase == _EXITS)
            self._stage = max(self._stage, entry.phase)
            self._do(entry)
        message = f"the launch description gives rise to more than {EVENT_LIMIT} events"
        endless = LimitExceededError(message)
        blame(endless, self._current)
        raise endless

    def _do(self, entry: _Entry) -> None:
        """Call a queued function; a failure after the exit of a process is only a warning."""
        try:
            entry.work()
            self._do_deferred()
        except Exception as error:
            if entry.phase < _EXITS or isinstance(error, LimitExceededError):
                raise
            source = SimpleNamespace(source_line=getattr(error, "launch_source", None))
            self.warn(f"when this happens, it fails: {error}", source)

    def _happen(self, event: Any, context: Any) -> None:
        if self._stage >= _EXITS and self._shut_down_in == _TIMED:
            # Processes may exit before the time of the shutdown.
            context._set_is_shutdown(False)
        for handler in list(context._event_handlers):
            if handler.matches(event):
                self._handle(handler, event, context)

    def _handle(self, handler: Any, event: Any, context: Any) -> None:
        """Visit the entities of a handler, with the event in the locals of the context."""
        self._current = handler
        context._push_locals()
        context.extend_locals({"event": event})
        try:
            with blaming(handler):
                entities = handler.handle(event, context)
                listed = entities if isinstance(entities, (list, tuple)) else [entities]
                given = [entity for entity in listed if entity is not None]
                self.visit_all(given, context, handler)
        finally:
            context._pop_locals()

    def emit(self, event: Any, context: Any) -> None:
        """Queue an event: for now, or for the moment of an exit or of the shutdown."""
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
        # The handlers may start processes. The handler of `launch` itself, which forbids this, comes last.
        self._happen(event, context)
        self._do_deferred()
        context._set_is_shutdown(True)
        for timer in self._timers:
            timer.cancel()

    def _complete(self, event: Any, context: Any) -> None:
        from launch.actions import ExecuteLocal, TimerAction

        action = event.action
        if isinstance(action, TimerAction):
            # A timer is complete when its time has passed.
            self._completions[id(action)] = event
        elif isinstance(action, ExecuteLocal):
            when = {"on_exit_of": process_name(action)}
            if self._exits_before < EXIT_LIMIT:
                self.later(lambda: self._happen(event, context), when, _EXITS)
        else:
            when = {"on_completion_of": type(action).__name__}
            self.later(lambda: self._happen(event, context), when)

    # -- effects of actions -------------------------------------------------------------------

    def declare(self, action: Any, context: Any) -> None:
        """Note the argument of a `DeclareLaunchArgument`."""
        default = None
        if action.default_value is not None:
            try:
                default = text_of(action.default_value, context)
            except Exception:
                if action.name not in context.launch_configurations:
                    raise
        choices = None
        if action.choices is not None:
            choices = [str(choice) for choice in action.choices]
        entry = {
            "name": str(action.name),
            "default": default,
            "description": str(private(action, "", "description", action.description) or ""),
            "choices": choices,
            "included": len(self._open_includes) > 0,
        }
        self.note("arguments", entry, action)

    def enter(self, action: Any, context: Any) -> None:
        """Note the launch file of an `IncludeLaunchDescription`."""
        if action is self._top:
            return
        file = str(Path(action.launch_description_source.location).absolute())
        self._open_includes.append(file)
        if self._open_includes.count(file) + (file == self._top_file) > INCLUDE_LIMIT:
            remedy = "Include another file, or put the include under a condition."
            message = f"'{relative(file, self.root)}' includes itself without end"
            raise mistake(LimitExceededError, message, "include_recursive", remedy)
        given: dict[str, str] = {}
        for name, value in action.launch_arguments:
            given[text_of(name, context)] = text_of(value, context)
        self.note("includes", {"file": relative(file, self.root), "arguments": given}, action)

    def is_command_line(self, include: Any) -> bool:
        """Return whether an include stands for the launch file of the command line."""
        return include is self._top

    def log(self, action: Any, context: Any) -> None:
        """Note the message of a `LogInfo`, up to a limit."""
        message = text_of(action.msg, context)
        if len(self.found["logs"]) < LOG_LIMIT:
            self.note("logs", {"message": message[:LOG_LENGTH]}, action)

    def wait(self, action: Any, context: Any) -> None:
        """Queue the actions of a `TimerAction`, to be visited with the present configurations."""
        from launch.utilities.type_utils import perform_typed_substitution

        if private(action, "TimerAction", "canceled"):
            return
        configurations = dict(context.launch_configurations)
        local = dict(context.get_locals_as_dict())
        before = self.when
        cancel = private(action, "TimerAction", "cancel_on_shutdown", True)
        if perform_typed_substitution(context, cancel, bool):
            self._timers.append(action)

        def fire() -> None:
            if not private(action, "TimerAction", "canceled"):
                self._visit_timer(action, context, configurations, local)

        # `launch` resolves the period in a task, after the end of a scope around the timer.
        self.defer(lambda: self._begin_timer(action, context, fire, before))

    def _begin_timer(
        self, action: Any, context: Any, fire: Callable[[], None], before: dict[str, Any] | None
    ) -> None:
        """Queue the end of a timer's period; `before` is the moment of its start."""
        from launch.utilities.type_utils import perform_typed_substitution

        try:
            period_s = float(perform_typed_substitution(context, action.period, float))
        except Exception as error:
            message = (
                "the timer's period is resolved once the whole file was read, and then it fails: "
            )
            self.warn(f"{message}{error}; what waits for it never starts", action)
            return
        period_s = max(0.0, period_s)
        when = _after(period_s, before)
        self.later(fire, when, _TIMED, period_s)
        completion = self._completions.get(id(action))
        if completion is not None:
            self.later(lambda: self._happen(completion, context), when, _TIMED, period_s)

    def _visit_timer(
        self, action: Any, context: Any, configurations: dict[str, Any], local: dict[str, Any]
    ) -> None:
        """Visit the actions of a timer with the configurations and locals of its start."""
        context._push_locals()
        context.extend_locals(local)
        context._push_launch_configurations()
        context.launch_configurations.clear()
        context.launch_configurations.update(configurations)
        try:
            with blaming(action):
                self.visit_all(list(action.actions), context, action)
        finally:
            context._pop_launch_configurations()
            context._pop_locals()

    def skip_coroutine(self, action: Any, context: Any) -> None:
        """Note that the coroutine of an `OpaqueCoroutine` is not evaluated."""
        entry = {"what": "OpaqueCoroutine", "why": "coroutines are not evaluated"}
        self.note("not_started", entry, action)

    def follow_sim_time(self, action: Any, context: Any) -> None:
        """Warn of `SetUseSimTime`, because it has no effect on nodes."""
        from launch.utilities.type_utils import perform_typed_substitution

        if not perform_typed_substitution(context, action.value, bool):
            raise RuntimeError("SetUseSimTime can only set the parameter use_sim_time to true")
        message = "SetUseSimTime is for the timers of the launch itself, and no node gets use_sim_time by it"
        self.warn(f"{message}; SetParameter('use_sim_time', True) would do that", action)

    # -- processes ----------------------------------------------------------------------------

    def start(self, action: Any, context: Any) -> None:
        """Note the process of an `ExecuteLocal`, and queue its start and its exit."""
        from launch.event_handlers import OnProcessExit
        from launch.events.process import ProcessExited, ProcessStarted

        action.prepare(context)
        details = {"pid": 0, **action.process_details}
        name = str(details["name"])
        self._require_first_start(action, name)
        if context.is_shutdown:
            return
        if len(self.found["processes"]) >= PROCESS_LIMIT:
            message = f"the launch description starts more than {PROCESS_LIMIT} processes"
            raise LimitExceededError(message)
        described = self._describer.process(action, context)
        condition_note = self._condition_of.get(id(action), "")
        entry = self.note("processes", {"condition_note": condition_note, **described}, action)
        self._entries[id(action)] = entry
        on_exit = private(action, "ExecuteLocal", "on_exit")
        if on_exit is not None:
            context.register_event_handler(OnProcessExit(target_action=action, on_exit=on_exit))
        self.defer(lambda: self._settle_tty(action, entry, context))
        started = ProcessStarted(**details)
        exited = ProcessExited(returncode=0, **details)
        self.later(lambda: self._happen(started, context), {"on_start_of": name})
        if self._exits_before < EXIT_LIMIT:
            self.later(lambda: self._happen(exited, context), {"on_exit_of": name}, _EXITS)

    def _require_first_start(self, action: Any, name: str) -> None:
        """Refuse an action that was executed before."""
        if id(action) in self._executed:
            message = f"the process '{name}' is started twice: the same action stands in two places"
            remedy = "Put each action into the description once."
            raise mistake(RuntimeError, message, "started_twice", remedy)
        self._executed[id(action)] = action

    def _settle_tty(self, action: Any, entry: dict[str, Any], context: Any) -> None:
        # A task of `launch` reads the configuration, after the whole file is read.
        from launch.conditions import evaluate_condition_expression
        from launch.utilities import normalize_to_list_of_substitutions

        if "emulate_tty" not in context.launch_configurations:
            return
        with blaming(action):
            text = normalize_to_list_of_substitutions(context.launch_configurations["emulate_tty"])
            entry["emulate_tty"] = evaluate_condition_expression(context, text)

    def load(self, action: Any, context: Any) -> None:
        """Note the nodes of a `LoadComposableNodes`."""
        nodes = private(action, "LoadComposableNodes", "composable_node_descriptions") or []
        wanted: list[Any] = []
        for node in nodes:
            condition = node.condition()
            if condition is None or condition.evaluate(context):
                wanted.append(node)
        target = private(action, "LoadComposableNodes", "target_container")
        components = [self._describer.component(node, context) for node in wanted]
        if id(target) in self._entries:
            entry = self._entries[id(target)]
            entry.setdefault("components", []).extend(components)
            return
        container = target.node_name if hasattr(target, "node_name") else text_of(target, context)
        self.note("loaded_components", {"container": container, "components": components}, action)

    # -- lifecycle nodes ----------------------------------------------------------------------

    def start_lifecycle(self, action: Any, context: Any) -> Any:
        """Note a lifecycle node; each change of its state is played as a success."""
        from launch import EventHandler
        from launch.actions import OpaqueFunction
        from launch_ros.actions import LifecycleTransition, Node
        from launch_ros.events.lifecycle import ChangeState

        change = OpaqueFunction(function=lambda context: self._change_state(action, context))
        handler = EventHandler(
            matcher=lambda event: isinstance(event, ChangeState), entities=[change]
        )
        context.register_event_handler(handler)
        Node.execute(action, context)
        autostart = bool(private(action, "LifecycleNode", "autostart"))
        if id(action) in self._entries:
            self._entries[id(action)]["autostart"] = autostart
        if not autostart:
            return None
        started = LifecycleTransition(
            lifecycle_node_names=[action.node_name], transition_ids=[1, 3]
        )
        started.source_line = action.source_line
        return [started]

    def _change_state(self, action: Any, context: Any) -> None:
        event = context.locals.event
        if not event.lifecycle_node_matcher(action) or event.transition_id not in TRANSITIONS:
            return
        label, before, meanwhile, after = TRANSITIONS[event.transition_id]
        name = process_name(action)
        self.note("transitions", {"process": name, "transition": label}, event)
        state = self._states.get(id(action), "unconfigured")
        if before != state:
            message = f"{action.node_name} is asked to {label}, which it can only from the state '{before}'"
            self.warn(f"{message}; it is '{state}' by then", event)
            return
        self._states[id(action)] = after
        self._queue_transition(action, context, label, before, meanwhile)
        self._queue_transition(action, context, "transition_success", meanwhile, after)

    def _queue_transition(
        self, action: Any, context: Any, label: str, start: str, goal: str
    ) -> None:
        """Queue the event of a change from a state to another."""
        from launch_ros.events.lifecycle import StateTransition

        name = process_name(action)
        message = SimpleNamespace(
            timestamp=0,
            transition=SimpleNamespace(label=label),
            start_state=SimpleNamespace(label=start),
            goal_state=SimpleNamespace(label=goal),
        )
        change = StateTransition(action=action, msg=message)
        when = {"on_transition_of": name, "state": goal}
        self.later(lambda: self._happen(change, context), when)


def _after(period_s: float, before: dict[str, Any] | None) -> dict[str, Any]:
    """Return the moment at the end of a period, e.g. `{"after_s": 3.0}` for 2 s that begin 1 s after the launch."""
    if before is None:
        return {"after_s": period_s}
    if set(before) == {"after_s"}:
        return {"after_s": period_s + before["after_s"]}
    return {"after_s": period_s, "since": before}


def _plain(value: Any, depth: int) -> Any:
    """Return a value in a form for JSON, cut off below the deepest level of a plan."""
    if depth > _PLAN_DEPTH:
        return "…"
    if isinstance(value, Mapping):
        return {str(name): _plain(item, depth + 1) for name, item in value.items()}
    if isinstance(value, (list, tuple, bytes)):
        return [_plain(item, depth + 1) for item in value]
    return _plain_scalar(value)


def _plain_scalar(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return {NO_JSON: str(float(value))}
    if isinstance(value, (bool, int, float)) or value is None:
        return value
    try:
        return str(value)
    except Exception:
        return f"<{type(value).__name__}>"
