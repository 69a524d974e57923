"""Handlers of the events of ROS nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch._base import shown
from launch._catalogue import missing_name
from launch.event_handlers import EventHandler

from ..events.lifecycle import StateTransition

__all__ = ["OnStateTransition"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


class OnStateTransition(EventHandler):
    """Visits entities when a lifecycle node changes its state, and all that is asked of the change is so."""

    def __init__(
        self,
        *,
        entities: Any,
        target_lifecycle_node: Any = None,
        transition: str | None = None,
        start_state: str | None = None,
        goal_state: str | None = None,
        matcher: Callable[[Any], bool] | None = None,
        **kwargs: Any,
    ) -> None:
        if target_lifecycle_node is not None and not getattr(target_lifecycle_node, "is_lifecycle_node", False):
            raise RuntimeError(
                f"OnStateTransition: target_lifecycle_node must be a LifecycleNode, but {shown(target_lifecycle_node)}"
            )
        wanted = {"transition": transition, "start_state": start_state, "goal_state": goal_state}

        def matches(event: Any) -> bool:
            return (
                isinstance(event, StateTransition)
                and target_lifecycle_node in (None, event.action)
                and all(value in (None, getattr(event, name)) for name, value in wanted.items())
            )

        super().__init__(matcher=matcher or matches, entities=entities, **kwargs)
