"""Actions: what a launch description can do."""

from __future__ import annotations

import collections.abc
import os
import shlex
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
from ..descriptions import Executable
from ..event_handlers import BaseEventHandler
from ..events import Shutdown as ShutdownEvent
from ..launch_description_sources import AnyLaunchDescriptionSource
from ..substitutions import LaunchConfiguration, TextSubstitution
from ..utilities.type_utils import perform_typed_substitution

# -- on arguments, configurations and the environment, and those that hold others ------------------


@expose_action("arg")
class DeclareLaunchArgument(Action):
    name = Field(positional=POSITIONAL, attribute="name")
    default_value = Text(None, attribute="default")
    description: Any = Field(None, attribute="description")
    choices = Field(
        None,
        nested=lambda e, parser: (
            [parser.escape_characters(c.get_attr("value")) for c in e.nested("choice")] or None
        ),
    )
    _conditionally_included = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        default, choices = kwargs.get("default_value"), self.choices
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
        kept = {
            perform_substitutions(context, normal(name)): _kept_value(context, value)
            for name, value in (self.launch_configurations or {}).items()
        }
        context.launch_configurations.clear()
        context.launch_configurations.update(kept)


def _kept_value(context: Any, value: Any) -> Any:
    # What other actions keep among the configurations, such as a list of parameters, stays as it is; and so
    # does a list that mixes text with substitutions.
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
        name, value = self.text("name", context), self.text("value", context)
        separator = self.text("separator", context)
        prepend = perform_typed_substitution(context, self.prepend, bool)
        if name in context.environment:
            before = context.environment[name]
            value = separator.join([value, before] if prepend else [before, value])
        context.environment[name] = value


@expose_action("unset_env")
class UnsetEnvironmentVariable(_OnName):
    def execute(self, context: Any) -> None:
        context.environment.pop(self.text("name", context), None)


@expose_action("group")
class GroupAction(Action):
    """Holds other actions, in a scope of their own unless told otherwise."""

    actions = Field(
        positional=POSITIONAL,
        nested=lambda e, parser: [
            parser.parse_action(inner) for inner in e.children if inner.type_name != "keep"
        ],
    )
    scoped = Field(True, attribute="scoped", kind=bool)
    forwarding = Field(True, attribute="forwarding", kind=bool)
    launch_configurations = Field(None, nested=_kept)
    _inside: list[Any] | None = None

    def get_sub_entities(self) -> list[Any]:
        if self._inside is None:
            actions, configurations = list(self.actions), self.launch_configurations or {}
            for position, action in enumerate(actions, start=1):
                if not hasattr(action, "visit"):
                    raise no_action(action, position, self)
            first: list[Any] = [
                SetLaunchConfiguration(name, value) for name, value in configurations.items()
            ]
            if self.scoped and not self.forwarding:
                first = [ResetEnvironment(), ResetLaunchConfigurations(configurations)]
            begin = [PushLaunchConfigurations(), PushEnvironment()] if self.scoped else []
            end = [PopEnvironment(), PopLaunchConfigurations()] if self.scoped else []
            self._inside = [*begin, *first, *actions, *end]
        return self._inside

    def execute(self, context: Any) -> list[Any]:
        return self.get_sub_entities()


class _RestoreFile(Action):
    """Gives `ThisLaunchFileDir` back what it was before an include."""

    locals = Field(positional=POSITIONAL)

    def execute(self, context: Any) -> None:
        context.extend_locals(self.locals)


def _arguments(entity: Any, parser: Any) -> list[Any]:
    given = [*entity.nested("arg"), *entity.nested("let")]
    return [
        [parser.parse_substitution(e.get_attr(name)) for name in ("name", "value")] for e in given
    ]


@expose_action("include")
class IncludeLaunchDescription(Action):
    launch_description_source: Any = Field(
        positional=POSITIONAL, attribute="file", read=Text.reading
    )
    launch_arguments: Any = Field(None, nested=_arguments)

    def made(self) -> None:
        if not isinstance(self.launch_description_source, LaunchDescriptionSource):
            self.launch_description_source = AnyLaunchDescriptionSource(
                self.launch_description_source
            )
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
        normal = normalize_to_list_of_substitutions
        return [perform_substitutions(context, normal(name)) for name, _ in self.launch_arguments]

    def execute(self, context: Any) -> list[Any]:
        description = self.launch_description_source.get_launch_description(context)
        file = Path(self.launch_description_source.location).absolute()
        here = {
            "current_launch_file_path": str(file),
            "current_launch_file_directory": str(file.parent),
        }
        restored = {
            name: value for name, value in context.get_locals_as_dict().items() if name in here
        }
        context.extend_locals(here)
        self._check_required(
            description, self._names(context), context.session.is_command_line(self)
        )
        context.session.enter(self, context)
        sets = [SetLaunchConfiguration(name, value) for name, value in self.launch_arguments]
        return [*sets, description, _RestoreFile(restored)]

    def _check_required(self, description: Any, given: list[str], outermost: bool) -> None:
        for (
            argument,
            includes,
        ) in description.get_launch_arguments_with_include_launch_description_actions():
            if argument._conditionally_included or argument.default_value is not None:
                continue
            names = given + [
                name for include in includes or [] for name in include._names_without_context()
            ]
            if argument.name not in names:
                message = f"the launch description needs the argument '{argument.name}' "
                message += (
                    f"({argument.description}); it was given: {', '.join(given) or 'nothing'}"
                )
                remedy = "Give it: a default_value, name:=value when launching, or launch_arguments when including."
                error = mistake(RuntimeError, message, "required_argument", remedy)
                problems.blame(error, (includes or [argument])[0] if outermost else self)
                raise error


# -- that start processes, wait, react, or say something -------------------------------------------


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
    """Would run a coroutine, which is not evaluated."""

    performs = "skip_coroutine"

    coroutine = Field(types=Callable)
    args = Field(None)
    kwargs = Field(None)
    ignore_context = Field(False)


class RegisterEventHandler(Action):
    event_handler = Field(positional=POSITIONAL)

    def describe_conditional_sub_entities(self) -> list[tuple[str, Any]]:
        found = super().describe_conditional_sub_entities()
        known = isinstance(self.event_handler, BaseEventHandler)
        return [*found, self.event_handler.describe()] if known else found

    def execute(self, context: Any) -> None:
        if not hasattr(self.event_handler, "matches"):
            raise AttributeError(
                f"'{type(self.event_handler).__name__}' object has no attribute 'matches'"
            )
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
        """Do nothing when the time has passed."""
        self.given["canceled"] = True


def _on_exit(value: str, parser: Any) -> list[Action]:
    """What follows the end of a process, as XML and YAML write it."""
    if value != "shutdown":
        message = f"the attribute 'on_exit' can only be 'shutdown', but it is '{value}'"
        raise mistake(
            ValueError, message, "bad_markup", "Write this value, or take the attribute out."
        )
    return [Shutdown()]


def _not_negative(value: float, parser: Any) -> float:
    if value < 0:
        message = f"a time must not be negative, but it is {value}"
        raise mistake(ValueError, message, "bad_markup", "Correct this element of the file.")
    return value


def _seconds(value: float, parser: Any) -> str:
    return str(_not_negative(value, parser))


class ExecuteLocal(Action):
    """Would start a process; notes it instead."""

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
    #: Nothing has ended.
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


def parse_words(line: str, parser: Any) -> list[list[Substitution]]:
    """The words of a command line in which substitutions stand."""
    words: list[list[Substitution]] = [[]]
    for sub in parser.parse_substitution(line):
        if not isinstance(sub, TextSubstitution):
            words[-1].append(sub)
            continue
        split = shlex.split(sub.text)
        if not split or (sub.text[0].isspace() and words[-1]):  # blanks alone always end a word
            words.append([])
        for position, word in enumerate(split):
            if position:
                words.append([])
            words[-1].append(TextSubstitution(text=word))
        if split and sub.text[-1].isspace():
            words.append([])
    return words if words[-1] else words[:-1]


@expose_action("executable")
class ExecuteProcess(ExecuteLocal):
    """Would start a program; notes it instead."""

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
        """Keep the command line with its surroundings."""
        described = {
            title: self.given[title] for title in ("prefix", "cwd", "env", "additional_env")
        }
        self.process_description = Executable(cmd=cmd, name=name, **described)
