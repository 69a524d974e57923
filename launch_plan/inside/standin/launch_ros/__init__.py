"""Stand-in for the ROS 2 package `launch_ros`: the same names and meanings, but nothing is started."""

from __future__ import annotations

from launch._catalogue import publish

from . import (
    actions,
    descriptions,
    event_handlers,
    events,
    parameter_descriptions,
    substitutions,
    utilities,
)

publish()
