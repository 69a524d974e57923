"""Handlers of the events of ROS nodes."""

from __future__ import annotations

from typing import Any

from launch._catalogue import missing_name
from launch.event_handlers import BaseEventHandler

from ..events.lifecycle import StateTransition

__all__ = ["OnStateTransition"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


class OnStateTransition(BaseEventHandler):
    """Visits entities when a lifecycle node changes its state; this happens only in a real launch."""

    def __init__(
        self,
        *,
        entities: Any,
        target_lifecycle_node: Any = None,
        transition: str | None = None,
        start_state: str | None = None,
        goal_state: str | None = None,
        **kwargs: Any,
    ) -> None:
        if transition and (start_state or goal_state):
            raise RuntimeError("OnStateTransition takes either transition, or start_state and goal_state")
        super().__init__(matcher=lambda event: isinstance(event, StateTransition), **kwargs)
        self.waits_for = {"node": target_lifecycle_node, "transition": transition, "goal_state": goal_state}
        self.__entities = entities

    @property
    def entities(self) -> Any:
        """The entities."""
        return self.__entities

    def handle(self, event: Any, context: Any) -> Any:
        """The entities."""
        super().handle(event, context)
        return self.__entities
