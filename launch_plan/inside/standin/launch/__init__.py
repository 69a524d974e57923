"""Stand-in for the ROS 2 package `launch`: the same names and meanings, but nothing is started."""

from __future__ import annotations

from ._base import (
    Action,
    Condition,
    Event,
    InvalidLaunchFileError,
    LaunchDescriptionEntity,
    SomeEntitiesType_types_tuple,
    SomeSubstitutionsType_types_tuple,
    Substitution,
)

from ._catalogue import publish  # isort: skip
from . import substitutions  # isort: skip
from . import conditions, descriptions, events, logging  # isort: skip
from ._context import LaunchContext
from ._description import LaunchDescription, LaunchDescriptionSource, LaunchIntrospector
from .event_handlers import BaseEventHandler, EventHandler

from . import actions, event_handlers, frontend, launch_description_sources, utilities  # isort: skip

publish()
