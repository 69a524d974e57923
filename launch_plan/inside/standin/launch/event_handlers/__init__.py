"""Event handlers: entities to visit after an event."""

from __future__ import annotations

import collections.abc
from typing import Any

from launch_plan.inside.problems import mistake, shown

from .._base import Field, LaunchDescriptionEntity, Located, is_a_subclass
from ..events import ExecutionComplete, IncludeLaunchDescription, Shutdown
from ..events.process import ProcessExited, ProcessIO, ProcessStarted


class BaseEventHandler(Located):
    """A handler of matching events."""

    matcher = Field()
    handle_once = Field(False)
    entities: Any = None
    _actions: tuple[Any, ...] | list[Any] = ()

    def matches(self, event: Any) -> bool:
        """Return whether an event is for this handler."""
        return bool(self.matcher(event))

    def describe(self) -> Any:
        return type(self).__name__, self._actions

    def handle(self, event: Any, context: Any) -> Any:
        """Return the entities to visit."""
        if self.handle_once:
            context.unregister_event_handler(self)
        return None


class EventHandler(BaseEventHandler):
    """A handler with fixed entities."""

    entities = Field(None)

    def handle(self, event: Any, context: Any) -> Any:
        super().handle(event, context)
        return self.entities


class OnActionEventBase(BaseEventHandler):
    """A handler of the events of one action, or of any."""

    matcher = None
    action_matcher = Field()
    on_event = Field()
    target_event_cls = Field()
    target_action_cls = Field()

    def made(self) -> None:
        action = self.action_matcher
        wanted = self.target_action_cls
        if not isinstance(action, (wanted, type(None))) and not callable(action):
            message = f"target_action must be one action ({wanted.__name__}) or a function, but {shown(action)}"
            remedy = "Give the action itself, as it is kept in a variable."
            raise mistake(TypeError, f"{type(self).__name__}: {message}", "bad_target", remedy)
        self._actions = []
        if not callable(self.on_event):
            self._actions = _entities(self.on_event, type(self).__name__)

    def matches(self, event: Any) -> bool:
        wanted = self.action_matcher
        if not isinstance(event, self.target_event_cls):
            return False
        if wanted is None:
            return True
        if isinstance(wanted, self.target_action_cls):
            return event.action is wanted
        return bool(wanted(event.action))

    def handle(self, event: Any, context: Any) -> Any:
        super().handle(event, context)
        if callable(self.on_event):
            return self.on_event(event, context)
        return self._actions


def _entities(given: Any, name: str) -> list[Any]:
    if given is None:
        return []
    if not isinstance(given, collections.abc.Iterable):
        return [given]
    entities = list(given)
    for entity in entities:
        if not isinstance(entity, LaunchDescriptionEntity):
            message = f"{name}: every item must be an action, but one is of type '{type(entity).__name__}'"
            raise mistake(TypeError, message, "not_an_action", "Put only actions into this list.")
    return entities


class _OnEvent(OnActionEventBase):
    """A handler of one class of events; `_follows` names the keyword for its entities."""

    action_matcher = None
    on_event = None
    target_action_cls: Any = None
    target_event_cls: Any = None
    target_action = Field(None)
    _follows = ""

    def made(self) -> None:
        from .. import Action, actions

        self.action_matcher = self.target_action
        self.on_event = self.given[self._follows]
        self.target_action_cls = actions.ExecuteLocal
        if self.target_event_cls is ExecutionComplete:
            self.target_action_cls = Action
        super().made()


class OnProcessExit(_OnEvent):
    on_exit = Field()
    _follows = "on_exit"
    target_event_cls = ProcessExited


class OnProcessStart(_OnEvent):
    on_start = Field()
    _follows = "on_start"
    target_event_cls = ProcessStarted


class OnProcessIO(_OnEvent):
    on_stdin = Field(None)
    on_stdout = Field(None)
    on_stderr = Field(None)
    _follows = "on_stdin"
    target_event_cls = ProcessIO

    def handle(self, event: Any, context: Any) -> Any:
        function = (self.on_stdin, self.on_stdout, self.on_stderr)[event.fd]
        return None if function is None else function(event)


class OnExecutionComplete(_OnEvent):
    on_completion = Field()
    _follows = "on_completion"
    target_event_cls = ExecutionComplete


class OnShutdown(BaseEventHandler):
    matcher = None
    on_shutdown = Field()

    def matches(self, event: Any) -> bool:
        return is_a_subclass(event, Shutdown)

    def handle(self, event: Any, context: Any) -> Any:
        super().handle(event, context)
        if callable(self.on_shutdown):
            return self.on_shutdown(event, context)
        return self.on_shutdown


class OnIncludeLaunchDescription(BaseEventHandler):
    matcher = None

    def matches(self, event: Any) -> bool:
        return is_a_subclass(event, IncludeLaunchDescription)

    def handle(self, event: Any, context: Any) -> Any:
        super().handle(event, context)
        return event.launch_description
