"""Events of lifecycle nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch._base import Event
from launch._catalogue import missing_name

__all__ = ["ChangeState", "StateTransition", "matches_node_name"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


class ChangeState(Event):
    """Lifecycle nodes are to change their state."""

    name = "launch_ros.events.lifecycle.ChangeState"

    def __init__(self, *, lifecycle_node_matcher: Callable[[Any], bool], transition_id: int) -> None:
        self.lifecycle_node_matcher = lifecycle_node_matcher
        self.transition_id = transition_id


class StateTransition(Event):
    """A lifecycle node changed its state."""

    name = "launch_ros.events.lifecycle.StateTransition"

    def __init__(self, *, action: Any, msg: Any) -> None:
        self.action = action
        self.msg = msg


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    """A matcher of one node."""
    return lambda action: bool(action.node_name == node_name)
