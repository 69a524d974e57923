"""Events of lifecycle nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch._base import Event, Field


class ChangeState(Event):
    """Lifecycle nodes are to change their state."""

    #: As `lifecycle_msgs/msg/Transition` numbers them: what is asked for, then how each of them can end.
    valid_transitions = frozenset({*range(9), *(tens + how for tens in range(10, 70, 10) for how in range(3))})

    lifecycle_node_matcher = Field()
    transition_id = Field()

    def made(self) -> None:
        if self.transition_id not in self.valid_transitions:
            raise ValueError(f"{self.transition_id!r} is no id of a lifecycle transition")


class StateTransition(Event):
    """A lifecycle node changed its state."""

    action = Field()
    msg = Field()

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
