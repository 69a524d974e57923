"""Stand-in for the ROS 2 package `launch_ros`: the same names and meanings, but nothing is started."""

from __future__ import annotations

from typing import Any

from launch._catalogue import missing_name

from . import actions, descriptions, event_handlers, events, parameter_descriptions, substitutions, utilities

__all__ = [
    "actions",
    "descriptions",
    "event_handlers",
    "events",
    "parameter_descriptions",
    "substitutions",
    "utilities",
]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)
