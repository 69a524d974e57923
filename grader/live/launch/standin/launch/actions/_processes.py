"""Actions that start processes, wait, react, or say something."""

from __future__ import annotations

import collections.abc
import os
import shlex
import warnings
from collections.abc import Callable
from typing import Any

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
    mistake,
    shown,
)
from ..descriptions import Executable
from ..event_handlers import BaseEventHandler
from ..events import Shutdown as ShutdownEvent
from ..substitutions import LaunchConfiguration, TextSubstitution
from ..utilities.type_utils import perform_typed_substitution


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
    function = Field(types=Callable, remedy="Give the function itself, without calling it: function=name.")
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
            raise AttributeError(f"'{type(self.event_handler).__name__}' object has no attribute 'matches'")
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
        raise mistake(ValueError, message, "bad_markup", "Write this value, or take the attribute out.")
    return [Shutdown()]


def _not_negative(value: float, parser: Any) -> float:
    if value < 0:
        message = f"a time must not be negative, but it is {value}"
        raise mistake(ValueError, message, "bad_markup", "Correct this element of the file.")
    return value


class _Word(Text):
    """A text that may be a dictionary instead."""

    def normal(self, value: Any) -> Any:
        return value if isinstance(value, dict) else super().normal(value)


def _seconds(value: float, parser: Any) -> str:
    return str(_not_negative(value, parser))


class ExecuteLocal(Action):
    """Would start a process; notes it instead."""

    performs = "start"

    process_description: Any = Field()
    shell = Field(False, attribute="shell", kind=bool)
    sigterm_timeout = Text(None, attribute="sigterm_timeout", kind=float, can_be_str=False, read=_seconds)
    sigkill_timeout = Text(None, attribute="sigkill_timeout", kind=float, can_be_str=False, read=_seconds)
    emulate_tty = Field(False, attribute="emulate_tty", kind=bool)
    output = _Word("log", attribute="output")
    output_format = Field("")
    cached_output = Field(False)
    log_cmd = Field(False)
    on_exit = Field(None, attribute="on_exit", read=_on_exit)
    respawn = Typed(False, attribute="respawn", kind=bool, read_as=str, read=Text.reading)
    respawn_delay = Field(None, attribute="respawn_delay", kind=float, can_be_str=False, read=_not_negative)
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
    words: list[list[Substitution]] = []
    current: list[Substitution] = []
    for sub in parser.parse_substitution(line):
        if not isinstance(sub, TextSubstitution):
            current.append(sub)
            continue
        split = shlex.split(sub.text)
        if not split or (sub.text[0].isspace() and current):  # blanks alone always end a word
            words.append(current)
            current = []
        for position, word in enumerate(split):
            if position:
                words.append(current)
                current = []
            current.append(TextSubstitution(text=word))
        if split and sub.text[-1].isspace():
            words.append(current)
            current = []
    return [*words, current] if current else words


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
        described = {title: self.given[title] for title in ("prefix", "cwd", "env", "additional_env")}
        self.process_description = Executable(cmd=cmd, name=name, **described)
