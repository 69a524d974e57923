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

    #: As `lifecycle_msgs/msg/Transition` numbers them: what is asked for, then how each of them can end.
    valid_transitions = frozenset({*range(9), *(tens + how for tens in range(10, 70, 10) for how in range(3))})

    def __init__(self, *, lifecycle_node_matcher: Callable[[Any], bool], transition_id: int) -> None:
        if transition_id not in self.valid_transitions:
            raise ValueError(f"{transition_id!r} is no id of a lifecycle transition")
        self.lifecycle_node_matcher = lifecycle_node_matcher
        self.transition_id = transition_id


class StateTransition(Event):
    """A lifecycle node changed its state."""

    name = "launch_ros.events.lifecycle.StateTransition"

    def __init__(self, *, action: Any, msg: Any) -> None:
        self.action = action
        self.msg = msg

    @property
    def transition(self) -> str:
        """Name of the transition."""
        return str(self.msg.transition.label)

    @property
    def start_state(self) -> str:
        """Name of the state before."""
        return str(self.msg.start_state.label)

    @property
    def goal_state(self) -> str:
        """Name of the state after."""
        return str(self.msg.goal_state.label)


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    """A matcher of one node."""
    return lambda action: bool(action.node_name == node_name)
