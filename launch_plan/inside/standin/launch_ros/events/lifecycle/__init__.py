"""Events of lifecycle nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch._base import Event, Field


class ChangeState(Event):
    #: As `lifecycle_msgs/msg/Transition` numbers them: what is asked for, then how each of them can end.
    valid_transitions = frozenset(
        {*range(9), *(tens + how for tens in range(10, 70, 10) for how in range(3))}
    )

    lifecycle_node_matcher = Field()
    transition_id = Field()

    def made(self) -> None:
        if self.transition_id not in self.valid_transitions:
            raise ValueError(f"{self.transition_id!r} is no id of a lifecycle transition")


class StateTransition(Event):
    action = Field()
    msg = Field()

    @property
    def transition(self) -> str:
        return str(self.msg.transition.label)

    @property
    def start_state(self) -> str:
        return str(self.msg.start_state.label)

    @property
    def goal_state(self) -> str:
        return str(self.msg.goal_state.label)


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    wanted = node_name if node_name.startswith("/") else f"/{node_name}"
    return lambda action: bool(action.node_name == wanted)
