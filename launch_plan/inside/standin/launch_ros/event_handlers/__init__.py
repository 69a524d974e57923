"""Handlers of the events of ROS nodes."""

from __future__ import annotations

from typing import Any

from launch import EventHandler
from launch._base import Field

from launch_plan.inside.problems import mistake, shown

from ..events.lifecycle import StateTransition


class OnStateTransition(EventHandler):
    """A handler of matching changes of a lifecycle node's state."""

    matcher = Field(None)
    entities = Field()
    target_lifecycle_node = Field(None)
    transition = Field(None)
    start_state = Field(None)
    goal_state = Field(None)

    def made(self) -> None:
        target = self.target_lifecycle_node
        if target is not None and not hasattr(target, "is_lifecycle_node"):
            message = f"OnStateTransition: target_lifecycle_node must be a LifecycleNode, but {shown(target)}"
            remedy = "Give the action itself, as it is kept in a variable."
            raise mistake(RuntimeError, message, "bad_target", remedy)

    def matches(self, event: Any) -> bool:
        if self.matcher is not None:
            return bool(self.matcher(event))
        if not isinstance(event, StateTransition):
            return False
        if self.target_lifecycle_node not in (None, event.action):
            return False
        asked = ("transition", "start_state", "goal_state")
        return all(self.given[name] in (None, getattr(event, name)) for name in asked)
