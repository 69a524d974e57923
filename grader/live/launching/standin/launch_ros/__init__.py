"""Stand-in for the ROS 2 package `launch_ros`: the same names and meanings, but nothing is started."""

from __future__ import annotations

from launch._catalogue import missing_name_of

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
__getattr__ = missing_name_of(__name__)
