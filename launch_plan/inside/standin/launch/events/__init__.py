"""Events of a launch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .._base import POSITIONAL, Event, Field


class Shutdown(Event):
    reason = Field("reason not given")
    due_to_sigint = Field(False)


class TimerEvent(Event):
    timer_action = Field()


class ExecutionComplete(Event):
    action = Field()


class IncludeLaunchDescription(Event):
    launch_description = Field(positional=POSITIONAL)


def matches_action(target_action: Any) -> Callable[[Any], bool]:
    return lambda action: bool(action == target_action)


from . import process  # noqa: E402 - it needs the names above
