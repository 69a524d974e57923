"""Events of lifecycle nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch._base import Event, Field


class ChangeState(Event):
    #: Ids of `lifecycle_msgs/msg/Transition`: requests 0 to 8, and results 10, 11, 12, 20 ... 62.
    valid_transitions = frozenset([*range(9), *(n for n in range(10, 70) if n % 10 < 3)])

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
