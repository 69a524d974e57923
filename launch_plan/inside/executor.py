"""One evaluation of a launch file, by the stand-in or by the real `launch`: what would be started, and when.

No process is started. Each that would be is noted with what it waits for, and the events that its start and its end
would bring about are played in virtual time: first what happens at once, then timers by their time, then the ends of
processes, then the shutdown. The same functions serve as `execute` of the actions of either.
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
from typing import Any

from launch_plan.format import NO_JSON, PROCESS_LIMIT, SCHEMA
from launch_plan.inside.files import PlanFiles
from launch_plan.inside.installed import SubmittedModules, missing_data_file
from launch_plan.inside.problems import (
    LimitExceededError,
    blame,
    blaming,
    mistake,
    no_action,
    problem_of,
    relative,
)
from launch_plan.inside.processes import Describer, private, text_of

EVENT_LIMIT = 2000
ENTITY_LIMIT = 10_000
LOG_LIMIT, LOG_LENGTH = 500, 2000
DEPTH_LIMIT = 150
INCLUDE_LIMIT = 20
EXIT_LIMIT = 2  # ends of processes that were started because another ended, and so on
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


class Executor:
    """What an evaluation has found so far, and what is still to happen; `root` is the submission's folder."""

    def __init__(self, root: str = "") -> None:
        self.root = root
        self.initial_environment = dict(os.environ)
        self.found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in _KINDS}
        self.files = PlanFiles(root)
        self._describer = Describer(self)
        self.when: dict[str, Any] | None = None
        self._top: Any = None  # the include that stands for the command line
        self._top_file = ""
        self._open_includes: list[str] = []
        self._condition_of: dict[int, str] = {}
        self._executed: dict[int, Any] = {}
        self._timers: list[Any] = []
        self._completions: dict[int, Any] = {}
        self._states: dict[int, str] = {}
        self._entries: dict[int, dict[str, Any]] = {}
        self._deferred: list[Callable[[], None]] = []
        self._queue: list[
            tuple[int, float, int, int, dict[str, Any] | None, Callable[[], None]]
        ] = []
        self._order = itertools.count()
        self._clock_s, self._stage, self._ends_before, self._visited = 0.0, _AT_ONCE, 0, 0
        self._shut_down_in: int | None = None
        self._current: Any = None

    # -- evaluation ---------------------------------------------------------------------------

    def evaluate(self, context: Any, file: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Evaluate a launch file as `ros2 launch FILE name:=value` would; returns the plan, ready for JSON."""
        given = {str(name): str(value) for name, value in arguments.items()}
        sys.meta_path.append(SubmittedModules(self.root))
        sys.argv = ["ros2", "launch", file, *(f"{name}:={value}" for name, value in given.items())]
        outcome, problem = "ok", None
        try:
            self._launch(context, file, given)
            self.files.carry_written(self.found["processes"])
        except BaseException as error:
            outcome, problem = problem_of(error, self.root, file, context.launch_configurations)
        if outcome == "ok":
            for name in sorted(set(given) - {entry["name"] for entry in self.found["arguments"]}):
                self.warn(
                    f"the argument '{name}' is given, but the launch file declares no such argument",
                    None,
                )
        configurations = {
            n: v for n, v in context.launch_configurations.items() if isinstance(v, str)
        }
        plan = {
            "schema": SCHEMA,
            "outcome": outcome,
            "problem": problem,
            "configurations": configurations,
        }
        plain: dict[str, Any] = _plain(
            {**plan, **self.found, "parameter_files": self.files.texts}, 0
        )
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
        found = {
            "when": self.when,
            **entry,
            "by" if "file" in entry else "file": shown,
            "line": line,
        }
        self.found[kind].append(found)
        return found

    def warn(self, message: str, source: Any) -> None:
        """Note something that does not stop the launch."""
        self.note("warnings", {"message": message}, source)

    def warn_of_missing_file(self, path: str, source: Any) -> None:
        """Warn of a file of parameters that is not there."""
        message = f"the parameter file '{path}' does not exist, so the node starts without it"
        if missing := missing_data_file(path, self.root):
            message = (
                f"the parameter file '{missing[0]}' is not installed, so the node starts without it"
            )
            message += f": add to {missing[1]}: {missing[2]}"
        self.warn(message, source)

    # -- visiting -----------------------------------------------------------------------------

    def visit_all(self, entities: Any, context: Any, parent: Any, depth: int = 0) -> None:
        """Visit entities, and what they yield, in order."""
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
                    self._visited += 1
                    if self._visited > ENTITY_LIMIT:
                        raise LimitExceededError(
                            f"the launch description has more than {ENTITY_LIMIT} actions"
                        )
                    self._current = entity
                    self.visit_all(entity.visit(context), context, entity, depth + 1)
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
        self,
        work: Callable[[], None],
        when: dict[str, Any] | None,
        phase: int = _AT_ONCE,
        after_s: float = 0.0,
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
                source = SimpleNamespace(source_line=getattr(error, "launch_source", None))
                self.warn(f"when this happens, it fails: {error}", source)
        endless = LimitExceededError(
            f"the launch description gives rise to more than {EVENT_LIMIT} events"
        )
        blame(endless, self._current)
        raise endless

    def _happen(self, event: Any, context: Any) -> None:
        if self._stage >= _EXITS and self._shut_down_in == _TIMED:
            context._set_is_shutdown(
                False
            )  # processes may have ended before the time of the shutdown
        for handler in list(context._event_handlers):
            if not handler.matches(event):
                continue
            self._current = handler
            context._push_locals()
            context.extend_locals({"event": event})
            try:
                with blaming(handler):
                    entities = handler.handle(event, context)
                    listed = entities if isinstance(entities, (list, tuple)) else [entities]
                    self.visit_all(
                        [entity for entity in listed if entity is not None], context, handler
                    )
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
            self.later(
                lambda: self._happen(event, context), {"on_completion_of": type(action).__name__}
            )

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
            "choices": None
            if action.choices is None
            else [str(choice) for choice in action.choices],
            "included": len(self._open_includes) > 0,
        }
        self.note("arguments", entry, action)

    def enter(self, action: Any, context: Any) -> None:
        """Note the launch file that `IncludeLaunchDescription` includes."""
        if action is self._top:
            return
        file = str(Path(action.launch_description_source.location).absolute())
        self._open_includes.append(file)
        if self._open_includes.count(file) + (file == self._top_file) > INCLUDE_LIMIT:
            remedy = "Include another file, or put the include under a condition."
            message = f"'{relative(file, self.root)}' includes itself without end"
            raise mistake(LimitExceededError, message, "include_recursive", remedy)
        given = {
            text_of(name, context): text_of(value, context)
            for name, value in action.launch_arguments
        }
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
        kept, before, local = (
            dict(context.launch_configurations),
            self.when,
            dict(context.get_locals_as_dict()),
        )
        if perform_typed_substitution(
            context, private(action, "TimerAction", "cancel_on_shutdown", True), bool
        ):
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
                with blaming(action):
                    self.visit_all(list(action.actions), context, action)
            finally:
                context._pop_launch_configurations()
                context._pop_locals()

        def begin() -> None:
            # The time is resolved in a task, when a scope around the timer has ended already.
            try:
                period_s = max(
                    0.0, float(perform_typed_substitution(context, action.period, float))
                )
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
        self.note(
            "not_started",
            {"what": "OpaqueCoroutine", "why": "coroutines are not evaluated"},
            action,
        )

    def follow_sim_time(self, action: Any, context: Any) -> None:
        """Warn of `SetUseSimTime`, of which no node gets anything."""
        from launch.utilities.type_utils import perform_typed_substitution

        if not perform_typed_substitution(context, action.value, bool):
            raise RuntimeError("SetUseSimTime can only set the parameter use_sim_time to true")
        message = "SetUseSimTime is for the timers of the launch itself, and no node gets use_sim_time by it"
        self.warn(f"{message}; SetParameter('use_sim_time', True) would do that", action)

    # -- processes ----------------------------------------------------------------------------

    def start(self, action: Any, context: Any) -> None:
        """Note the process that `ExecuteLocal` would start, and play its start and its end."""
        from launch.event_handlers import OnProcessExit
        from launch.events.process import ProcessExited, ProcessStarted

        action.prepare(context)
        details = {"pid": 0, **action.process_details}
        name = str(details["name"])
        if id(action) in self._executed:
            message = f"the process '{name}' is started twice: the same action stands in two places"
            raise mistake(
                RuntimeError, message, "started_twice", "Put each action into the description once."
            )
        self._executed[id(action)] = action
        if context.is_shutdown:
            return
        if len(self.found["processes"]) >= PROCESS_LIMIT:
            raise LimitExceededError(
                f"the launch description starts more than {PROCESS_LIMIT} processes"
            )
        entry = {
            "condition_note": self._condition_of.get(id(action), ""),
            **self._describer.process(action, context),
        }
        entry = self._entries[id(action)] = self.note("processes", entry, action)
        on_exit = private(action, "ExecuteLocal", "on_exit")
        if on_exit is not None:
            context.register_event_handler(OnProcessExit(target_action=action, on_exit=on_exit))
        self.defer(lambda: self._settle_tty(action, entry, context))
        started, exited = ProcessStarted(**details), ProcessExited(returncode=0, **details)
        self.later(lambda: self._happen(started, context), {"on_start_of": name})
        if self._ends_before < EXIT_LIMIT:
            self.later(lambda: self._happen(exited, context), {"on_exit_of": name}, _EXITS)

    def _settle_tty(self, action: Any, entry: dict[str, Any], context: Any) -> None:
        # The task that starts the process looks at the configuration, after the whole file was read.
        from launch.conditions import evaluate_condition_expression
        from launch.utilities import normalize_to_list_of_substitutions

        if "emulate_tty" not in context.launch_configurations:
            return
        with blaming(action):
            text = normalize_to_list_of_substitutions(context.launch_configurations["emulate_tty"])
            entry["emulate_tty"] = evaluate_condition_expression(context, text)

    def load(self, action: Any, context: Any) -> None:
        """Note the nodes that `LoadComposableNodes` would load into a container."""
        nodes = private(action, "LoadComposableNodes", "composable_node_descriptions") or []
        wanted = [
            node for node in nodes if node.condition() is None or node.condition().evaluate(context)
        ]
        target = private(action, "LoadComposableNodes", "target_container")
        components = [self._describer.component(node, context) for node in wanted]
        if id(target) in self._entries:
            self._entries[id(target)]["components"] = components
            return
        container = target.node_name if hasattr(target, "node_name") else text_of(target, context)
        self.note("loaded_components", {"container": container, "components": components}, action)

    # -- lifecycle nodes ----------------------------------------------------------------------

    def start_lifecycle(self, action: Any, context: Any) -> Any:
        """Note a lifecycle node, whose changes of state are played as if each of them went well."""
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
        for transition, start, goal in (
            (label, before, meanwhile),
            ("transition_success", meanwhile, after),
        ):
            labels = {"transition": transition, "start_state": start, "goal_state": goal}
            state_message = SimpleNamespace(
                timestamp=0, **{key: SimpleNamespace(label=text) for key, text in labels.items()}
            )
            change = StateTransition(action=action, msg=state_message)
            when = {"on_transition_of": name, "state": goal}
            self.later(lambda change=change: self._happen(change, context), when)  # type: ignore[misc]


def _after(period_s: float, before: dict[str, Any] | None) -> dict[str, Any]:
    """When something happens that waits for a time, and began to wait some while after the start."""
    if before is None:
        return {"after_s": period_s}
    if set(before) == {"after_s"}:
        return {"after_s": period_s + before["after_s"]}
    return {"after_s": period_s, "since": before}


def _plain(value: Any, depth: int) -> Any:
    """A value as JSON can hold it, no deeper than a plan is."""
    if depth > _PLAN_DEPTH:
        return "…"
    if isinstance(value, Mapping):
        return {str(name): _plain(item, depth + 1) for name, item in value.items()}
    if isinstance(value, (list, tuple, bytes)):
        return [_plain(item, depth + 1) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {NO_JSON: str(float(value))}
    if isinstance(value, (bool, int, float)) or value is None:
        return value
    try:
        return str(value)
    except Exception:
        return f"<{type(value).__name__}>"
