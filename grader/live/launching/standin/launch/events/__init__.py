"""Events: what can happen while a launch description runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .._base import Event
from .._catalogue import missing_name

__all__ = [
    "ExecutionComplete",
    "IncludeLaunchDescription",
    "Shutdown",
    "TimerEvent",
    "matches_action",
    "process",
]


class Shutdown(Event):
    """The launch ends."""

    name = "launch.events.Shutdown"

    def __init__(self, *, reason: str = "reason not given", due_to_sigint: bool = False, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.reason = reason
        self.due_to_sigint = due_to_sigint


class TimerEvent(Event):
    """A timer fired."""

    name = "launch.events.TimerEvent"

    def __init__(self, *, timer_action: Any) -> None:
        self.timer_action = timer_action


class ExecutionComplete(Event):
    """An action was carried out."""

    name = "launch.events.ExecutionComplete"

    def __init__(self, *, action: Any) -> None:
        self.action = action


class IncludeLaunchDescription(Event):
    """A launch description is to be visited."""

    name = "launch.events.IncludeLaunchDescription"

    def __init__(self, launch_description: Any) -> None:
        self.launch_description = launch_description


def matches_action(target_action: Any) -> Callable[[Any], bool]:
    """A matcher that is true for one action."""

    def matcher(action: Any) -> bool:
        return action == target_action  # type: ignore[no-any-return]

    return matcher


from . import process  # noqa: E402 - it needs the names above


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)
