"""Lifecycle nodes, whose changes of state are played as if each of them went well."""

from __future__ import annotations

from typing import Any

from launch._base import Action, Field, Text, Texts, expose_action, perform_substitutions, shared
from launch.actions import EmitEvent, RegisterEventHandler

from ..event_handlers import OnStateTransition
from ..events import matches_node_name
from ..events.lifecycle import ChangeState, StateTransition
from ._node import Node

_TRANSITIONS = shared("executor").TRANSITIONS


@expose_action("lifecycle_node")
class LifecycleNode(Node):
    """Would start a lifecycle node; notes it instead."""

    is_lifecycle_node = True
    name = Text(attribute="name")
    namespace = Text(attribute="namespace")
    autostart = Field(False, attribute="autostart", kind=bool)
    node_autostart = property(lambda self: self.autostart)

    def execute(self, context: Any) -> Any:
        return context.session.start_lifecycle(self, context)


class _Ids(Texts):
    def normal(self, value: Any) -> Any:
        return super().normal([str(item) if isinstance(item, int) else item for item in value])


class LifecycleTransition(Action):
    """Leads lifecycle nodes through some transitions, one after the other."""

    lifecycle_node_names = Texts()
    transition_ids = _Ids()

    def made(self) -> None:
        if not self.transition_ids or not self.lifecycle_node_names:
            raise ValueError("LifecycleTransition needs at least one node name and one transition id")

    def execute(self, context: Any) -> list[Any]:
        names = [perform_substitutions(context, name) for name in self.lifecycle_node_names]
        ids = [int(perform_substitutions(context, given)) for given in self.transition_ids]
        handlers: list[Any] = []
        first: list[Any] = []
        for name in names:
            asked = [self._ask(name, number) for number in ids]
            first.append(asked[0])
            handlers += [_after(name, number, following) for number, following in zip(ids, asked[1:], strict=False)]
        return [*handlers, *first]

    def _ask(self, name: str, number: int) -> EmitEvent:
        event = ChangeState(lifecycle_node_matcher=matches_node_name(name), transition_id=number)
        event.source_line = self.source_line
        return EmitEvent(event=event)


def _after(name: str, number: int, following: Any) -> RegisterEventHandler:
    _, _, meanwhile, after = _TRANSITIONS[number]
    is_node = matches_node_name(name)

    def matches(event: Any) -> bool:
        if not isinstance(event, StateTransition) or not is_node(event.action):
            return False
        return (event.start_state, event.goal_state) == (meanwhile, after)

    return RegisterEventHandler(OnStateTransition(matcher=matches, entities=[following], handle_once=True))
