"""Actions that start processes, wait, react, or say something."""

from __future__ import annotations

import collections.abc
import os
import shlex
import shutil
import warnings
from collections.abc import Callable
from typing import Any

from .. import logging as launch_logging
from .._base import (
    Action,
    Event,
    SomeSubstitutionsType_types_tuple,
    Substitution,
    blame,
    ensure_argument_type,
    is_a_subclass,
    normalize_to_list_of_substitutions,
    perform_substitutions,
    shown,
)
from .._catalogue import ELSEWHERE
from ..conditions import evaluate_condition_expression
from ..descriptions import Executable
from ..event_handlers import BaseEventHandler, EventHandler, OnProcessExit
from ..events import Shutdown as ShutdownEvent
from ..events import TimerEvent
from ..events.process import ProcessExited, ProcessStarted
from ..frontend.expose import expose_action
from ..substitutions import LaunchConfiguration, TextSubstitution
from ..utilities.type_utils import normalize_typed_substitution, perform_typed_substitution
from ._configurations import PopLaunchConfigurations, PushLaunchConfigurations, ResetLaunchConfigurations


class EmitEvent(Action):
    """Lets something happen."""

    def __init__(self, *, event: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not is_a_subclass(event, Event):
            raise RuntimeError(f"EmitEvent needs an event, but {shown(event)}")
        self.__event = event

    @property
    def event(self) -> Any:
        """The event."""
        return self.__event

    def execute(self, context: Any) -> None:
        """Let it happen."""
        context.emit_event_sync(self.__event)


@expose_action("shutdown")
class Shutdown(EmitEvent):
    """Ends the launch."""

    def __init__(self, *, reason: str = "reason not given", **kwargs: Any) -> None:
        super().__init__(event=ShutdownEvent(reason=reason), **kwargs)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<shutdown>`."""
        _, kwargs = parser.common(entity)
        reason = entity.get_attr("reason", optional=True)
        if reason:
            kwargs["reason"] = parser.escape_characters(reason)
        return cls, kwargs


@expose_action("log")
class LogInfo(Action):
    """Says something."""

    def __init__(self, *, msg: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__msg = normalize_to_list_of_substitutions(msg)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<log>`."""
        return parser.with_substitutions(cls, entity, {"message": "msg"})

    @property
    def msg(self) -> list[Substitution]:
        """What is said."""
        return self.__msg

    def execute(self, context: Any) -> None:
        """Say it."""
        text = perform_substitutions(context, self.__msg)
        context.session.log(text, self.source_line)


class OpaqueFunction(Action):
    """Calls a function of the launch file."""

    def __init__(self, *, function: Callable[..., Any], args: Any = None, kwargs: Any = None, **left_over: Any) -> None:
        super().__init__(**left_over)
        if not callable(function):
            raise TypeError(f"OpaqueFunction needs a function, but {shown(function)}")
        ensure_argument_type(args, (collections.abc.Iterable, type(None)), "args", "OpaqueFunction")
        ensure_argument_type(kwargs, (dict, type(None)), "kwargs", "OpaqueFunction")
        self.__function = function
        self.__args = args if args is not None else []
        self.__kwargs = kwargs if kwargs is not None else {}

    def execute(self, context: Any) -> Any:
        """Call it; the entities that it returns."""
        return self.__function(context, *self.__args, **self.__kwargs)


class OpaqueCoroutine(Action):
    """Would run a coroutine, which is not evaluated."""

    def __init__(
        self,
        *,
        coroutine: Callable[..., Any],
        args: Any = None,
        kwargs: Any = None,
        ignore_context: bool = False,
        **left_over: Any,
    ) -> None:
        super().__init__(**left_over)
        if not callable(coroutine):
            raise TypeError("OpaqueCoroutine needs a coroutine function")

    def execute(self, context: Any) -> None:
        """Note that it is not evaluated."""
        session = context.session
        why = "coroutines are not evaluated"
        session.unassessed.append({"what": "OpaqueCoroutine", "why": why, "source": self.source_line})


class RegisterEventHandler(Action):
    """Adds an event handler."""

    def __init__(self, event_handler: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__handler = event_handler

    @property
    def event_handler(self) -> Any:
        """The handler."""
        return self.__handler

    def describe_conditional_sub_entities(self) -> list[tuple[str, Any]]:
        """Entities that the handler may visit."""
        found = super().describe_conditional_sub_entities()
        if isinstance(self.__handler, BaseEventHandler):
            text, entities = self.__handler.describe()
            found.append((text, entities))
        return found

    def execute(self, context: Any) -> None:
        """Add it."""
        if not hasattr(self.__handler, "matches"):
            raise AttributeError(f"'{type(self.__handler).__name__}' object has no attribute 'matches'")
        context.register_event_handler(self.__handler)


class UnregisterEventHandler(Action):
    """Removes an event handler."""

    def __init__(self, event_handler: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__handler = event_handler

    def execute(self, context: Any) -> None:
        """Remove it."""
        context.unregister_event_handler(self.__handler)


@expose_action("timer")
class TimerAction(Action):
    """Visits entities after a time."""

    def __init__(self, *, period: Any, actions: Any, cancel_on_shutdown: Any = True, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        types = (*SomeSubstitutionsType_types_tuple, float)
        ensure_argument_type(period, types, "period", type(self).__name__)
        ensure_argument_type(actions, collections.abc.Iterable, "actions", type(self).__name__)
        if isinstance(period, str):
            warnings.warn("a period should be a float or a substitution, not a str", stacklevel=2)
            period = float(period)
        self.__period = normalize_typed_substitution(period, float)
        self.__actions = actions
        self.__cancel_on_shutdown = normalize_typed_substitution(cancel_on_shutdown, bool)
        self.__canceled = False
        self.__locals: dict[str, Any] = {}
        self.__configurations: dict[str, Any] = {}
        self.__completion: Any = None

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<timer>`."""
        _, kwargs = parser.common(entity)
        kwargs["period"] = parser.parse_if_substitutions(entity.get_attr("period", data_type=float))
        kwargs["actions"] = [parser.parse_action(child) for child in entity.children]
        cancel = entity.get_attr("cancel_on_shutdown", data_type=bool, optional=True)
        if cancel is not None:
            kwargs["cancel_on_shutdown"] = parser.parse_if_substitutions(cancel)
        return cls, kwargs

    @property
    def period(self) -> Any:
        """The time in seconds."""
        return self.__period

    @property
    def actions(self) -> Any:
        """The entities."""
        return self.__actions

    def describe_conditional_sub_entities(self) -> list[tuple[str, Any]]:
        """The entities, which follow unless the timer is cancelled."""
        return [("a time passes", self.__actions)]

    def cancel(self) -> None:
        """Do nothing when the time has passed."""
        self.__canceled = True

    def handle(self, context: Any) -> Any:
        """The entities, once the time has passed."""
        if self.__canceled:
            return None
        context.extend_locals(self.__locals)
        # They see the configurations of when the wait began, and keep what they change to themselves.
        kept = ResetLaunchConfigurations(self.__configurations)
        return [PushLaunchConfigurations(), kept, *self.__actions, PopLaunchConfigurations()]

    def execute(self, context: Any) -> None:
        """Begin to wait."""
        if self.__canceled:
            return
        if not hasattr(context, "waits_for_timers"):
            context.waits_for_timers = True
            context.register_event_handler(_OnTimer())
        self.__locals = context.get_locals_as_dict()
        self.__configurations = dict(context.launch_configurations)
        perform_typed_substitution(context, self.__cancel_on_shutdown, bool)
        context.session.defer(lambda: self._wait(context))

    def _wait(self, context: Any) -> None:
        # The time is resolved in a task, when a scope around the timer has ended already.
        try:
            period_s = float(perform_typed_substitution(context, self.__period, float))
        except Exception as error:
            message = f"the timer's period is resolved once the whole file was read, and then it fails: {error}"
            context.session.warn(f"{message}; what waits for it never starts", self.source_line)
            return
        context.session.emit_after(TimerEvent(timer_action=self), max(0.0, period_s))
        if self.__completion is not None:
            context.session.emit_after(self.__completion, max(0.0, period_s))

    def complete(self, event: Any, session: Any) -> None:
        """It is over when the time has passed."""
        self.__completion = event


class _OnTimer(EventHandler):
    def __init__(self) -> None:
        super().__init__(matcher=lambda event: isinstance(event, TimerEvent))

    def handle(self, event: Any, context: Any) -> Any:
        try:
            entities = event.timer_action.handle(context)
            return None if entities is None else list(entities)
        except Exception as error:
            blame(error, event.timer_action)
            raise


class ExecuteLocal(Action):
    """Would start a process; notes it instead."""

    kind = "executable"

    def __init__(
        self,
        *,
        process_description: Executable,
        shell: bool = False,
        sigterm_timeout: Any = None,
        sigkill_timeout: Any = None,
        emulate_tty: bool = False,
        output: Any = "log",
        output_format: str = "[{this.process_description.final_name}] {line}",
        cached_output: bool = False,
        log_cmd: bool = False,
        on_exit: Any = None,
        respawn: Any = False,
        respawn_delay: float | None = None,
        respawn_max_retries: int = -1,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.__process_description = process_description
        self.__shell = shell
        default = LaunchConfiguration
        self.__sigterm_timeout = normalize_to_list_of_substitutions(
            default("sigterm_timeout", default=5) if sigterm_timeout is None else sigterm_timeout
        )
        self.__sigkill_timeout = normalize_to_list_of_substitutions(
            default("sigkill_timeout", default=5) if sigkill_timeout is None else sigkill_timeout
        )
        self.__emulate_tty = emulate_tty
        output = os.environ.get("OVERRIDE_LAUNCH_PROCESS_OUTPUT", output)
        self.__output = output if isinstance(output, dict) else normalize_to_list_of_substitutions(output)
        self.__on_exit = on_exit
        self.__respawn = normalize_typed_substitution(respawn, bool)
        self.__respawn_delay = respawn_delay
        self.__respawn_max_retries = respawn_max_retries
        self.__executed = False

    @property
    def process_description(self) -> Executable:
        """The command line with its surroundings."""
        return self.__process_description

    @property
    def shell(self) -> bool:
        """Whether a shell runs it."""
        return self.__shell

    @property
    def emulate_tty(self) -> bool:
        """Whether the process is to believe that it has a terminal."""
        return self.__emulate_tty

    @property
    def output(self) -> Any:
        """Where its output goes."""
        return self.__output

    @property
    def process_details(self) -> dict[str, Any] | None:
        """Name, command and surroundings, once they are known."""
        description = self.__process_description
        if description.final_cmd is None:
            return None
        return {
            "action": self,
            "name": description.final_name,
            "cmd": description.final_cmd,
            "cwd": description.final_cwd,
            "env": description.final_env,
        }

    @property
    def return_code(self) -> int | None:
        """Nothing has ended."""
        return None

    def get_sub_entities(self) -> list[Any]:
        """The entities that follow its end."""
        return self.__on_exit if isinstance(self.__on_exit, list) else []

    def prepare(self, context: Any) -> None:
        """Resolve everything."""
        self.__process_description.prepare(context, self)
        self.__respawn = perform_typed_substitution(context, self.__respawn, bool)

    def execute(self, context: Any) -> list[Any] | None:
        """Note the process."""
        self.prepare(context)
        name = self.__process_description.final_name or ""
        if self.__executed:
            raise RuntimeError(f"the process '{name}' is started twice: the same action stands in two places")
        self.__executed = True
        if context.is_shutdown:
            return None
        if self.__on_exit is not None:
            context.register_event_handler(OnProcessExit(target_action=self, on_exit=self.__on_exit))
        plan = self._as_plan(context, name)
        context.session.add_process(plan)
        context.session.defer(lambda: self._settle_tty(context, plan))
        details = self.process_details or {}
        context.session.emit(ProcessStarted(**details), {"on_start_of": name})
        context.session.emit_exit(ProcessExited(returncode=0, **details), {"on_exit_of": name})
        return None

    def complete(self, event: Any, session: Any) -> None:
        """It is over when the process ends."""
        session.emit_exit(event, {"on_exit_of": self.__process_description.final_name})

    def _as_plan(self, context: Any, name: str) -> dict[str, Any]:
        description = self.__process_description
        prefix = description.final_prefix
        command = (description.final_cmd or [""])[len(prefix) :]
        return {
            "id": name,
            "kind": self.kind,
            "package": None,
            "executable": os.path.basename(command[0]),  # noqa: PTH119
            "name": None,
            "namespace": None,
            "prefix": prefix,
            **self._program(context, command),
            **self._environment(context),
            "cwd": None if description.final_cwd is None else os.path.abspath(description.final_cwd),  # noqa: PTH100
            "parameters": [],
            "remappings": [],
            "output": self._output_plan(context, name),
            "respawn": bool(self.__respawn),
            "respawn_delay_s": self._number(context, "respawn_delay", self.__respawn_delay or 0.0, 0.0),
            "respawn_max_retries": self._number(context, "respawn_max_retries", self.__respawn_max_retries, -1),
            "emulate_tty": bool(self.__emulate_tty),
            "shell": bool(self.__shell),
            "sigterm_timeout_s": self._seconds(context, "sigterm_timeout", self.__sigterm_timeout),
            "sigkill_timeout_s": self._seconds(context, "sigkill_timeout", self.__sigkill_timeout),
            "when": context.session.when,
            "condition_note": context.session.condition_note(self),
            "absent": "",
            "source": self.source_line,
        }

    def _number(self, context: Any, name: str, value: Any, default: float) -> Any:
        """A number that is not looked at before the process ended."""
        if isinstance(value, (int, float)):
            return value
        kind = type(value).__name__
        message = f"{name} must be a number, but it is of type '{kind}'"
        context.session.warn(f"{message}; the launch fails when it would start the process again", self.source_line)
        return default

    def _seconds(self, context: Any, name: str, value: Any) -> float:
        """A time that is not resolved before the launch ends."""
        try:
            return float(perform_substitutions(context, value))
        except Exception as error:
            context.session.warn(f"{name} fails when the launch ends: {error}", self.source_line)
            return 5.0

    def _program(self, context: Any, command: list[str]) -> dict[str, Any]:
        path, argv = command[0], command[1:]
        if not self.__shell:
            found = shutil.which(path, path=context.environment.get("PATH"))
            if found is None and not path.startswith(f"{ELSEWHERE}/"):
                context.session.warn(f"the program '{path}' is not found, so it cannot start", self.source_line)
            path = found or path
        return {"path": path, "argv": argv}

    def _environment(self, context: Any) -> dict[str, Any]:
        before = context.session.initial_environment
        after = self.__process_description.final_env or {}
        replaces = self.__process_description.env is not None
        changed = {k: v for k, v in after.items() if replaces or before.get(k) != v}
        return {
            "env": changed,
            "env_unset": [] if replaces else sorted(set(before) - set(after)),
            "env_replaces": replaces,
        }

    def _output_plan(self, context: Any, name: str) -> Any:
        chosen: Any = self.__output
        if not isinstance(chosen, dict):
            chosen = perform_substitutions(context, chosen)
        return launch_logging.get_output_loggers(name, chosen)

    def _settle_tty(self, context: Any, plan: dict[str, Any]) -> None:
        # The task that starts the process looks at the configuration, after the whole file was read.
        if "emulate_tty" not in context.launch_configurations:
            return
        try:
            text = normalize_to_list_of_substitutions(context.launch_configurations["emulate_tty"])
            plan["emulate_tty"] = evaluate_condition_expression(context, text)
        except Exception as error:
            blame(error, self)
            raise


@expose_action("executable")
class ExecuteProcess(ExecuteLocal):
    """Would start a program; notes it instead."""

    def __init__(
        self,
        *,
        cmd: Any,
        prefix: Any = None,
        name: Any = None,
        cwd: Any = None,
        env: Any = None,
        additional_env: Any = None,
        **kwargs: Any,
    ) -> None:
        description = Executable(cmd=cmd, prefix=prefix, name=name, cwd=cwd, env=env, additional_env=additional_env)
        super().__init__(process_description=description, **kwargs)

    @classmethod
    def parse_process(cls, entity: Any, parser: Any) -> dict[str, Any]:
        """What `<executable>` and `<node>` have in common."""
        _, kwargs = parser.common(entity)
        for attribute, keyword in {"cwd": "cwd", "launch-prefix": "prefix", "output": "output"}.items():
            value = entity.get_attr(attribute, optional=True)
            if value is not None:
                kwargs[keyword] = parser.parse_substitution(value)
        respawn = entity.get_attr("respawn", optional=True)
        if respawn is not None:
            kwargs["respawn"] = parser.parse_substitution(respawn)
        kinds: dict[str, Any] = {
            "respawn_delay": float,
            "respawn_max_retries": int,
            "sigkill_timeout": float,
            "sigterm_timeout": float,
            "shell": bool,
            "emulate_tty": bool,
        }
        for attribute, kind in kinds.items():
            value = entity.get_attr(attribute, optional=True, data_type=kind, can_be_str=kind is bool)
            if value is not None:
                if kind is float and value < 0:
                    raise ValueError(f"the attribute '{attribute}' must not be negative, but it is {value}")
                kwargs[attribute] = str(value) if attribute.endswith("_timeout") else value
        on_exit = entity.get_attr("on_exit", optional=True)
        if on_exit is not None:
            if on_exit != "shutdown":
                raise ValueError(f"the attribute 'on_exit' can only be 'shutdown', but it is '{on_exit}'")
            kwargs["on_exit"] = [Shutdown()]
        environment = parser.pairs(entity, "env")
        if environment:
            kwargs["additional_env"] = environment
        return dict(kwargs)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<executable>`."""
        kwargs = cls.parse_process(entity, parser)
        kwargs["cmd"] = cls._parse_cmdline(entity.get_attr("cmd"), parser)
        name = entity.get_attr("name", optional=True)
        if name is not None:
            kwargs["name"] = parser.parse_substitution(name)
        return cls, kwargs

    @classmethod
    def _parse_cmdline(cls, cmd: str, parser: Any) -> list[list[Substitution]]:
        arguments: list[list[Substitution]] = []
        current: list[Substitution] = []
        for sub in parser.parse_substitution(cmd):
            if not isinstance(sub, TextSubstitution):
                current.append(sub)
                continue
            words = shlex.split(sub.text)
            if not words or (sub.text[0].isspace() and current):  # blanks alone always end an argument
                arguments.append(current)
                current = []
            for position, word in enumerate(words):
                if position:
                    arguments.append(current)
                    current = []
                current.append(TextSubstitution(text=word))
            if words and sub.text[-1].isspace():
                arguments.append(current)
                current = []
        return [*arguments, current] if current else arguments

    @property
    def name(self) -> Any:
        """Name of the process."""
        description = self.process_description
        return description.name if description.final_name is None else description.final_name

    @property
    def cmd(self) -> Any:
        """The command line."""
        description = self.process_description
        return description.cmd if description.final_cmd is None else description.final_cmd

    @property
    def cwd(self) -> Any:
        """The working folder."""
        description = self.process_description
        return description.cwd if description.final_cwd is None else description.final_cwd

    @property
    def env(self) -> Any:
        """The environment."""
        description = self.process_description
        return description.env if description.final_env is None else description.final_env

    @property
    def additional_env(self) -> Any:
        """What is added to the environment."""
        return self.process_description.additional_env
