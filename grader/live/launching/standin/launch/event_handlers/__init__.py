"""Event handlers: entities to visit when something happens."""

from __future__ import annotations

import collections.abc
from collections.abc import Callable
from typing import Any

from .._base import Event, LaunchDescriptionEntity, Located, is_a_subclass, shown
from .._catalogue import missing_name
from ..events import ExecutionComplete, IncludeLaunchDescription, Shutdown
from ..events.process import ProcessExited, ProcessIO, ProcessStarted

__all__ = [
    "BaseEventHandler",
    "EventHandler",
    "OnActionEventBase",
    "OnExecutionComplete",
    "OnIncludeLaunchDescription",
    "OnProcessExit",
    "OnProcessIO",
    "OnProcessStart",
    "OnShutdown",
]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


class BaseEventHandler(Located):
    """Handles the events that match."""

    def __init__(self, *, matcher: Callable[[Any], bool], handle_once: bool = False) -> None:
        self.__matcher = matcher
        self.__handle_once = handle_once

    @property
    def handle_once(self) -> bool:
        """Whether only the first event counts."""
        return self.__handle_once

    @property
    def entities(self) -> Any:
        """Entities known beforehand."""
        return None

    def matches(self, event: Any) -> bool:
        """Whether an event is for this handler."""
        return bool(self.__matcher(event))

    def describe(self) -> tuple[str, list[Any]]:
        """Text for people, and the entities known beforehand."""
        return type(self).__name__, []

    def handle(self, event: Any, context: Any) -> Any:
        """The entities to visit."""
        if self.handle_once:
            context.unregister_event_handler(self)
        return None


class EventHandler(BaseEventHandler):
    """Visits fixed entities when an event matches."""

    def __init__(self, *, matcher: Callable[[Any], bool], entities: Any = None, handle_once: bool = False) -> None:
        super().__init__(matcher=matcher, handle_once=handle_once)
        self.__entities = entities

    @property
    def entities(self) -> Any:
        """The entities."""
        return self.__entities

    def handle(self, event: Any, context: Any) -> Any:
        """The entities to visit."""
        super().handle(event, context)
        return self.__entities


class OnActionEventBase(BaseEventHandler):
    """Handles events that one action, or any, gives rise to."""

    def __init__(
        self,
        *,
        action_matcher: Any,
        on_event: Any,
        target_event_cls: type[Event],
        target_action_cls: type,
        **kwargs: Any,
    ) -> None:
        name = type(self).__name__
        if not isinstance(action_matcher, (target_action_cls, type(None))) and not callable(action_matcher):
            wanted = f"one action ({target_action_cls.__name__}) or a function"
            raise TypeError(f"{name}: target_action must be {wanted}, but {shown(action_matcher)}")
        self.target = action_matcher
        self.__actions: list[Any] = []
        self.__on_event = on_event
        if not callable(on_event):
            self.__actions = _entities(on_event, name)
            self.__on_event = lambda event, context: None

        def matcher(event: Any) -> bool:
            if not isinstance(event, target_event_cls):
                return False
            if action_matcher is None or isinstance(action_matcher, target_action_cls):
                return action_matcher is None or event.action is action_matcher  # type: ignore[attr-defined]
            return bool(action_matcher(event.action))  # type: ignore[attr-defined]

        super().__init__(matcher=matcher, **kwargs)

    def handle(self, event: Any, context: Any) -> Any:
        """The entities to visit."""
        super().handle(event, context)
        return self.__actions or self.__on_event(event, context)

    def describe(self) -> tuple[str, list[Any]]:
        """Text for people, and the entities known beforehand."""
        return type(self).__name__, list(self.__actions)


def _entities(given: Any, name: str) -> list[Any]:
    if not isinstance(given, collections.abc.Iterable):
        return [given]
    entities = list(given)
    for entity in entities:
        if not isinstance(entity, LaunchDescriptionEntity):
            raise TypeError(f"{name}: every item must be an action, but one is of type '{type(entity).__name__}'")
    return entities


class OnProcessExit(OnActionEventBase):
    """Visits entities when a process ends."""

    def __init__(self, *, target_action: Any = None, on_exit: Any, **kwargs: Any) -> None:
        from ..actions import ExecuteLocal

        super().__init__(
            action_matcher=target_action,
            on_event=on_exit,
            target_event_cls=ProcessExited,
            target_action_cls=ExecuteLocal,
            **kwargs,
        )


class OnProcessStart(OnActionEventBase):
    """Visits entities when a process starts."""

    def __init__(self, *, target_action: Any = None, on_start: Any, **kwargs: Any) -> None:
        from ..actions import ExecuteLocal

        super().__init__(
            action_matcher=target_action,
            on_event=on_start,
            target_event_cls=ProcessStarted,
            target_action_cls=ExecuteLocal,
            **kwargs,
        )


class OnProcessIO(OnActionEventBase):
    """Calls functions when a process writes."""

    def __init__(
        self,
        *,
        target_action: Any = None,
        on_stdin: Any = None,
        on_stdout: Any = None,
        on_stderr: Any = None,
        **kwargs: Any,
    ) -> None:
        from ..actions import ExecuteLocal

        by_fd = (on_stdin, on_stdout, on_stderr)

        def on_event(event: Any, _: Any) -> Any:
            function = by_fd[event.fd]
            return None if function is None else function(event)

        super().__init__(
            action_matcher=target_action,
            on_event=on_event,
            target_event_cls=ProcessIO,
            target_action_cls=ExecuteLocal,
            **kwargs,
        )


class OnExecutionComplete(OnActionEventBase):
    """Visits entities when an action was carried out."""

    def __init__(self, *, target_action: Any = None, on_completion: Any, **kwargs: Any) -> None:
        from .._base import Action

        super().__init__(
            action_matcher=target_action,
            on_event=on_completion,
            target_event_cls=ExecutionComplete,
            target_action_cls=Action,
            **kwargs,
        )


class OnShutdown(BaseEventHandler):
    """Visits entities when the launch ends."""

    def __init__(self, *, on_shutdown: Any, **kwargs: Any) -> None:
        super().__init__(matcher=lambda event: is_a_subclass(event, Shutdown), **kwargs)
        self.__on_shutdown = on_shutdown if callable(on_shutdown) else lambda event, context: on_shutdown

    def handle(self, event: Any, context: Any) -> Any:
        """The entities to visit."""
        super().handle(event, context)
        return self.__on_shutdown(event, context)


class OnIncludeLaunchDescription(BaseEventHandler):
    """Visits a launch description that an event asks for."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(matcher=lambda event: is_a_subclass(event, IncludeLaunchDescription), **kwargs)

    def handle(self, event: Any, context: Any) -> Any:
        """The launch description."""
        super().handle(event, context)
        return event.launch_description


def event_named(event_name: str) -> Callable[[Any], bool]:
    """A matcher of events by their name."""
    return lambda event: bool(event.name == event_name)


def gen_handler(entities: Any) -> Callable[[Any, Any], Any]:
    """A handler that gives fixed entities."""
    return lambda event, context: entities
