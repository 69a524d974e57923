"""Events: what can happen while a launch description runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .._base import POSITIONAL, Event, Field


class Shutdown(Event):
    """The launch ends."""

    reason = Field("reason not given")
    due_to_sigint = Field(False)


class TimerEvent(Event):
    """A timer fired."""

    timer_action = Field()


class ExecutionComplete(Event):
    """An action was carried out."""

    action = Field()


class IncludeLaunchDescription(Event):
    """A launch description is to be visited."""

    launch_description = Field(positional=POSITIONAL)


def matches_action(target_action: Any) -> Callable[[Any], bool]:
    """A matcher that is true for one action."""
    return lambda action: bool(action == target_action)


from . import process  # noqa: E402 - it needs the names above
