"""Stand-in for the ROS 2 package `launch`: the same names and meanings, but nothing is started.

It serves to evaluate a student's launch file where the real package cannot be installed.
"""

from __future__ import annotations

from ._base import (
    Action,
    Condition,
    Event,
    InvalidLaunchFileError,
    LaunchDescriptionEntity,
    SomeEntitiesType,
    SomeEntitiesType_types_tuple,
    SomeSubstitutionsType,
    SomeSubstitutionsType_types_tuple,
    Substitution,
)

from ._catalogue import missing_name_of  # isort: skip
from . import substitutions  # isort: skip
from . import conditions, descriptions, events, frontend, logging  # isort: skip
from ._context import LaunchContext
from ._description import LaunchDescription, LaunchDescriptionSource
from ._service import LaunchIntrospector
from .event_handlers import BaseEventHandler, EventHandler

from . import actions, event_handlers, launch_description_sources, utilities  # isort: skip

__all__ = [
    "Action",
    "BaseEventHandler",
    "Condition",
    "Event",
    "EventHandler",
    "InvalidLaunchFileError",
    "LaunchContext",
    "LaunchDescription",
    "LaunchDescriptionEntity",
    "LaunchDescriptionSource",
    "LaunchIntrospector",
    "SomeEntitiesType",
    "SomeEntitiesType_types_tuple",
    "SomeSubstitutionsType",
    "SomeSubstitutionsType_types_tuple",
    "Substitution",
    "actions",
    "conditions",
    "descriptions",
    "event_handlers",
    "events",
    "frontend",
    "launch_description_sources",
    "logging",
    "substitutions",
    "utilities",
]
__getattr__ = missing_name_of(__name__)
