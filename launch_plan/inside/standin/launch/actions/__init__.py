"""Actions of a launch description."""

from __future__ import annotations

import collections.abc
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from launch_plan.inside import problems
from launch_plan.inside.problems import mistake, no_action, shown

from .._base import (
    POSITIONAL,
    Action,
    Event,
    Field,
    SomeSubstitutionsType_types_tuple,
    Substitution,
    Text,
    Typed,
    expose_action,
    is_a_subclass,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from .._description import LaunchDescriptionSource
from .._words import parse_words
from ..descriptions import Executable
from ..event_handlers import BaseEventHandler
from ..events import Shutdown as ShutdownEvent
from ..launch_description_sources import AnyLaunchDescriptionSource
from ..substitutions import LaunchConfiguration
from ..utilities.type_utils import perform_typed_substitution

# -- arguments, configurations, environment, and groups of actions ---------------------------------


def _choices(entity: Any, parser: Any) -> list[str] | None:
    """Return the choices of an argument in XML or YAML."""
    texts = [parser.escape_characters(c.get_attr("value")) for c in entity.nested("choice")]
    return texts or None


@expose_action("arg")
class DeclareLaunchArgument(Action):
    name = Field(positional=POSITIONAL, attribute="name")
    default_value = Text(None, attribute="default")
    description: Any = Field(None, attribute="description")
    choices = Field(None, nested=_choices)
    _conditionally_included = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        default = kwargs.get("default_value")
        choices = self.choices
        if choices is None:
            return
        if len(choices) == 0:
            raise _no_choice(f"the list of choices of the argument '{self.name}' is empty")
        fixed = default is not None and not isinstance(default, (Substitution, list))
        if fixed and default not in choices:
            message = f"the default_value '{default}' of the argument '{self.name}' is not among its choices {choices}"
            raise _no_choice(message)

    def execute(self, context: Any) -> None:
        context.session.declare(self, context)
        known = context.launch_configurations
        if self.name not in known and self.default_value is None:
            remedy = "Give a default_value, or name:=value when launching."
            message = f"the required launch argument '{self.name}' was not given"
            raise mistake(RuntimeError, message, "required_argument", remedy)
        if self.name not in known:
            known[self.name] = self.text("default_value", context)
        if self.choices is not None and known[self.name] not in self.choices:
            message = f"the launch argument '{self.name}' is '{known[self.name]}', but it must be one of {self.choices}"
            raise _no_choice(message)


def _no_choice(message: str) -> Any:
    return mistake(RuntimeError, message, "invalid_choice", "Use one of the choices.")


class _OnName(Action):
    name = Text(positional=POSITIONAL, attribute="name")


class _OnNameAndValue(_OnName):
    value = Text(positional=POSITIONAL, attribute="value")


@expose_action("let")
class SetLaunchConfiguration(_OnNameAndValue):
    def execute(self, context: Any) -> None:
        context.launch_configurations[self.text("name", context)] = self.text("value", context)


class UnsetLaunchConfiguration(_OnName):
    def execute(self, context: Any) -> None:
        context.launch_configurations.pop(self.text("name", context), None)


class PushLaunchConfigurations(Action):
    performs = "_push_launch_configurations"


class PopLaunchConfigurations(Action):
    performs = "_pop_launch_configurations"


def _kept(entity: Any, parser: Any) -> Any:
    return parser.pairs(entity, "keep")


@expose_action("reset")
class ResetLaunchConfigurations(Action):
    launch_configurations = Field(None, POSITIONAL, nested=_kept)

    def execute(self, context: Any) -> None:
        normal = normalize_to_list_of_substitutions
        kept: dict[str, Any] = {}
        for name, value in (self.launch_configurations or {}).items():
            kept[perform_substitutions(context, normal(name))] = _kept_value(context, value)
        context.launch_configurations.clear()
        context.launch_configurations.update(kept)


def _kept_value(context: Any, value: Any) -> Any:
    # Values of other actions, such as a list of parameters, stay as they are, and lists of texts with substitutions too.
    parts = value if isinstance(value, collections.abc.Iterable) else [value]
    if isinstance(value, str) or not all(isinstance(part, Substitution) for part in parts):
        return value
    return perform_substitutions(context, normalize_to_list_of_substitutions(value))


class PushEnvironment(Action):
    performs = "_push_environment"


class PopEnvironment(Action):
    performs = "_pop_environment"


@expose_action("reset_env")
class ResetEnvironment(Action):
    performs = "_reset_environment"


@expose_action("set_env")
class SetEnvironmentVariable(_OnNameAndValue):
    def execute(self, context: Any) -> None:
        context.environment[self.text("name", context)] = self.text("value", context)


@expose_action("append_env")
class AppendEnvironmentVariable(_OnNameAndValue):
    prepend = Typed(False, POSITIONAL, attribute="prepend", kind=bool)
    separator = Text(os.pathsep, POSITIONAL, attribute="separator")

    def execute(self, context: Any) -> None:
        name = self.text("name", context)
        value = self.text("value", context)
        separator = self.text("separator", context)
        prepend = perform_typed_substitution(context, self.prepend, bool)
        if name in context.environment:
            before = context.environment[name]
            parts = [value, before] if prepend else [before, value]
            value = separator.join(parts)
        context.environment[name] = value


@expose_action("unset_env")
class UnsetEnvironmentVariable(_OnName):
    def execute(self, context: Any) -> None:
        context.environment.pop(self.text("name", context), None)


def _actions_of_group(entity: Any, parser: Any) -> list[Any]:
    inner = [child for child in entity.children if child.type_name != "keep"]
    return [parser.parse_action(child) for child in inner]


@expose_action("group")
class GroupAction(Action):
    """A group of actions, in a scope of their own unless `scoped` is false."""

    actions = Field(positional=POSITIONAL, nested=_actions_of_group)
    scoped = Field(True, attribute="scoped", kind=bool)
    forwarding = Field(True, attribute="forwarding", kind=bool)
    launch_configurations = Field(None, nested=_kept)
    _inside: list[Any] | None = None

    def get_sub_entities(self) -> list[Any]:
        if self._inside is None:
            actions = list(self.actions)
            for position, action in enumerate(actions, start=1):
                if not hasattr(action, "visit"):
                    raise no_action(action, position, self)
            self._inside = self._in_scope([*self._first(), *actions])
        return self._inside

    def _first(self) -> list[Any]:
        """Return the actions that prepare the configurations of the group."""
        configurations = self.launch_configurations or {}
        if self.scoped and not self.forwarding:
            return [ResetEnvironment(), ResetLaunchConfigurations(configurations)]
        return [SetLaunchConfiguration(name, value) for name, value in configurations.items()]

    def _in_scope(self, actions: list[Any]) -> list[Any]:
        if not self.scoped:
            return actions
        begin = [PushLaunchConfigurations(), PushEnvironment()]
        end = [PopEnvironment(), PopLaunchConfigurations()]
        return [*begin, *actions, *end]

    def execute(self, context: Any) -> list[Any]:
        return self.get_sub_entities()


class _RestoreFile(Action):
    """Restores the locals of the including file, e.g. for `ThisLaunchFileDir`."""

    locals = Field(positional=POSITIONAL)

    def execute(self, context: Any) -> None:
        context.extend_locals(self.locals)


def _arguments(entity: Any, parser: Any) -> list[Any]:
    pairs: list[Any] = []
    for inner in [*entity.nested("arg"), *entity.nested("let")]:
        name = parser.parse_substitution(inner.get_attr("name"))
        pairs.append([name, parser.parse_substitution(inner.get_attr("value"))])
    return pairs


@expose_action("include")
class IncludeLaunchDescription(Action):
    launch_description_source: Any = Field(
        positional=POSITIONAL, attribute="file", read=Text.reading
    )
    launch_arguments: Any = Field(None, nested=_arguments)

    def made(self) -> None:
        source = self.launch_description_source
        if not isinstance(source, LaunchDescriptionSource):
            self.launch_description_source = AnyLaunchDescriptionSource(source)
        self.launch_arguments = tuple(self.launch_arguments or ())

    def describe(self) -> str:
        return f"IncludeLaunchDescription({self.launch_description_source.location})"

    def get_sub_entities(self) -> list[Any]:
        description = self.launch_description_source.try_get_launch_description_without_context()
        return [] if description is None else [description]

    def _names_without_context(self) -> list[str]:
        from .._context import LaunchContext

        try:
            return self._names(LaunchContext())
        except Exception:
            return []

    def _names(self, context: Any) -> list[str]:
        names = [normalize_to_list_of_substitutions(name) for name, _ in self.launch_arguments]
        return [perform_substitutions(context, name) for name in names]

    def execute(self, context: Any) -> list[Any]:
        description = self.launch_description_source.get_launch_description(context)
        file = Path(self.launch_description_source.location).absolute()
        here = {
            "current_launch_file_path": str(file),
            "current_launch_file_directory": str(file.parent),
        }
        before = context.get_locals_as_dict()
        restored = {name: before[name] for name in here if name in before}
        context.extend_locals(here)
        outermost = context.session.is_command_line(self)
        self._check_required(description, self._names(context), outermost)
        context.session.enter(self, context)
        sets = [SetLaunchConfiguration(name, value) for name, value in self.launch_arguments]
        return [*sets, description, _RestoreFile(restored)]

    def _check_required(self, description: Any, given: list[str], outermost: bool) -> None:
        """Refuse a required argument of the file that neither this include nor an inner one gives."""
        found = description.get_launch_arguments_with_include_launch_description_actions()
        for argument, includes in found:
            if argument._conditionally_included or argument.default_value is not None:
                continue
            names = list(given)
            for include in includes or []:
                names += include._names_without_context()
            if argument.name not in names:
                message = f"the launch description needs the argument '{argument.name}' "
                message += (
                    f"({argument.description}); it was given: {', '.join(given) or 'nothing'}"
                )
                remedy = "Give it: a default_value, name:=value when launching, or launch_arguments when including."
                error = mistake(RuntimeError, message, "required_argument", remedy)
                problems.blame(error, (includes or [argument])[0] if outermost else self)
                raise error


# -- processes, timers, handlers and messages ------------------------------------------------------


class EmitEvent(Action):
    event: Any = Field()

    def made(self) -> None:
        if not is_a_subclass(self.event, Event):
            remedy = "Give an event, such as launch.events.Shutdown(); an action stands in the list by itself."
            message = f"EmitEvent needs an event, but {shown(self.event)}"
            raise mistake(RuntimeError, message, "not_an_event", remedy)

    def execute(self, context: Any) -> None:
        context.emit_event_sync(self.event)


@expose_action("shutdown")
class Shutdown(EmitEvent):
    event = None
    reason = Field("reason not given", attribute="reason")

    def made(self) -> None:
        self.event = ShutdownEvent(reason=self.reason)


@expose_action("log")
class LogInfo(Action):
    performs = "log"

    msg = Text(attribute="message")


class OpaqueFunction(Action):
    function = Field(
        types=Callable, remedy="Give the function itself, without calling it: function=name."
    )
    args = Field(None, types=(collections.abc.Iterable, type(None)))
    kwargs = Field(None, types=(dict, type(None)))

    def execute(self, context: Any) -> Any:
        return self.function(context, *(self.args or ()), **(self.kwargs or {}))


class OpaqueCoroutine(Action):
    """A coroutine, which is not evaluated."""

    performs = "skip_coroutine"

    coroutine = Field(types=Callable)
    args = Field(None)
    kwargs = Field(None)
    ignore_context = Field(False)


class RegisterEventHandler(Action):
    event_handler = Field(positional=POSITIONAL)

    def describe_conditional_sub_entities(self) -> list[tuple[str, Any]]:
        found = super().describe_conditional_sub_entities()
        if isinstance(self.event_handler, BaseEventHandler):
            found.append(self.event_handler.describe())
        return found

    def execute(self, context: Any) -> None:
        if not hasattr(self.event_handler, "matches"):
            title = type(self.event_handler).__name__
            raise AttributeError(f"'{title}' object has no attribute 'matches'")
        context.register_event_handler(self.event_handler)


class UnregisterEventHandler(Action):
    event_handler = Field(positional=POSITIONAL)

    def execute(self, context: Any) -> None:
        context.unregister_event_handler(self.event_handler)


class _Period(Typed):
    def checked(self, value: Any, made: Any) -> Any:
        if isinstance(value, str):
            warnings.warn("a period should be a float or a substitution, not a str", stacklevel=2)
            value = float(value)
        return super().checked(value, made)


@expose_action("timer")
class TimerAction(Action):
    performs = "wait"

    period = _Period(
        attribute="period",
        kind=float,
        types=(*SomeSubstitutionsType_types_tuple, float),
        remedy="Write the period as a float: 2.0.",
    )
    actions = Field(
        types=collections.abc.Iterable,
        remedy="Give a list, even for one action: actions=[...].",
        nested=lambda entity, parser: [parser.parse_action(child) for child in entity.children],
    )
    cancel_on_shutdown = Typed(True, attribute="cancel_on_shutdown", kind=bool)

    def describe_conditional_sub_entities(self) -> list[tuple[str, Any]]:
        return [("a time passes", self.actions)]

    def cancel(self) -> None:
        """Let the end of the period have no effect."""
        self.given["canceled"] = True


def _on_exit(value: str, parser: Any) -> list[Action]:
    """Return the actions after the exit of a process, given in XML or YAML."""
    if value != "shutdown":
        message = f"the attribute 'on_exit' can only be 'shutdown', but it is '{value}'"
        remedy = "Write this value, or take the attribute out."
        raise mistake(ValueError, message, "bad_markup", remedy)
    return [Shutdown()]


def _not_negative(value: float, parser: Any) -> float:
    if value < 0:
        message = f"a time must not be negative, but it is {value}"
        raise mistake(ValueError, message, "bad_markup", "Correct this element of the file.")
    return value


def _seconds(value: float, parser: Any) -> str:
    return str(_not_negative(value, parser))


class ExecuteLocal(Action):
    """A process, to be noted instead of started."""

    performs = "start"

    process_description: Any = Field()
    shell = Field(False, attribute="shell", kind=bool)
    sigterm_timeout = Text(
        None, attribute="sigterm_timeout", kind=float, can_be_str=False, read=_seconds
    )
    sigkill_timeout = Text(
        None, attribute="sigkill_timeout", kind=float, can_be_str=False, read=_seconds
    )
    emulate_tty = Field(False, attribute="emulate_tty", kind=bool)
    output = Text(
        "log",
        attribute="output",
        normal=lambda value: value if isinstance(value, dict) else Text.normalized(value),
    )
    output_format = Field("")
    cached_output = Field(False)
    log_cmd = Field(False)
    on_exit = Field(None, attribute="on_exit", read=_on_exit)
    respawn = Typed(False, attribute="respawn", kind=bool, read_as=str, read=Text.reading)
    respawn_delay = Field(
        None, attribute="respawn_delay", kind=float, can_be_str=False, read=_not_negative
    )
    respawn_max_retries = Field(-1, attribute="respawn_max_retries", kind=int, can_be_str=False)

    def __init__(self, **kwargs: Any) -> None:
        for name in ("sigterm_timeout", "sigkill_timeout"):
            if kwargs.get(name) is None:
                kwargs[name] = LaunchConfiguration(name, default=5)
        if "OVERRIDE_LAUNCH_PROCESS_OUTPUT" in os.environ:
            kwargs["output"] = os.environ["OVERRIDE_LAUNCH_PROCESS_OUTPUT"]
        super().__init__(**kwargs)

    process_details: dict[str, Any] | None = None
    #: None, because no process ends.
    return_code: int | None = None

    def get_sub_entities(self) -> list[Any]:
        return self.on_exit if isinstance(self.on_exit, list) else []

    def prepare(self, context: Any) -> None:
        description = self.process_description
        description.prepare(context, self)
        self.process_details = {
            "action": self,
            "name": description.final_name,
            "cmd": description.final_cmd,
            "cwd": description.final_cwd,
            "env": description.final_env,
        }
        self.given["respawn"] = perform_typed_substitution(context, self.respawn, bool)


@expose_action("executable")
class ExecuteProcess(ExecuteLocal):
    """A program, to be noted instead of started."""

    process_description = None
    cmd: Any = Field(attribute="cmd", read=parse_words)
    prefix = Text(None, attribute="launch-prefix")
    name: Any = Text(None, attribute="name")
    cwd = Text(None, attribute="cwd")
    env = Field(None)
    additional_env = Field(None, nested=lambda entity, parser: parser.pairs(entity, "env") or None)

    def made(self) -> None:
        self.describe_program(self.cmd, self.name)

    def describe_program(self, cmd: Any, name: Any) -> None:
        """Keep the command line with its folder and environment."""
        described = {n: self.given[n] for n in ("prefix", "cwd", "env", "additional_env")}
        self.process_description = Executable(cmd=cmd, name=name, **described)
