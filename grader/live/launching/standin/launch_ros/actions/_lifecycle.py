"""Lifecycle nodes, whose changes of state are played as if each of them went well."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from launch._base import Action, normalize_to_list_of_substitutions, perform_substitutions
from launch.actions import EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import EventHandler
from launch.frontend.expose import expose_action

from ..event_handlers import OnStateTransition
from ..events import matches_node_name
from ..events.lifecycle import ChangeState, StateTransition
from ._node import Node

# By the id in `lifecycle_msgs/msg/Transition`: name, state before, state while it lasts, state after.
_TRANSITIONS = {
    1: ("configure", "unconfigured", "configuring", "inactive"),
    2: ("cleanup", "inactive", "cleaningup", "unconfigured"),
    3: ("activate", "inactive", "activating", "active"),
    4: ("deactivate", "active", "deactivating", "inactive"),
    5: ("shutdown", "unconfigured", "shuttingdown", "finalized"),
    6: ("shutdown", "inactive", "shuttingdown", "finalized"),
    7: ("shutdown", "active", "shuttingdown", "finalized"),
}
_CONFIGURE, _ACTIVATE = 1, 3


@expose_action("lifecycle_node")
class LifecycleNode(Node):
    """Would start a lifecycle node; notes it instead."""

    kind = "lifecycle_node"
    is_lifecycle_node = True

    def __init__(self, *, name: Any, namespace: Any, autostart: Any = False, **kwargs: Any) -> None:
        super().__init__(name=name, namespace=namespace, **kwargs)
        self.__autostart = autostart
        self.__state = "unconfigured"

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<lifecycle_node>`."""
        _, kwargs = super().parse(entity, parser)
        autostart = entity.get_attr("autostart", data_type=bool, optional=True)
        if autostart is not None:
            kwargs["autostart"] = autostart
        return cls, kwargs

    @property
    def node_autostart(self) -> Any:
        """Whether it is activated once it runs."""
        return self.__autostart

    def execute(self, context: Any) -> list[Any] | None:
        """Note the node."""
        change = OpaqueFunction(function=self._change_state)
        context.register_event_handler(
            EventHandler(matcher=lambda event: isinstance(event, ChangeState), entities=[change])
        )
        super().execute(context)
        if context.session.processes and not context.is_shutdown:
            context.session.processes[-1]["autostart"] = bool(self.__autostart)
        if not self.__autostart:
            return None
        started = LifecycleTransition(lifecycle_node_names=[self.node_name], transition_ids=[_CONFIGURE, _ACTIVATE])
        started.source_line = self.source_line
        return [started]

    def _change_state(self, context: Any) -> None:
        event = context.locals.event
        if not event.lifecycle_node_matcher(self) or event.transition_id not in _TRANSITIONS:
            return
        label, before, meanwhile, after = _TRANSITIONS[event.transition_id]
        session, name = context.session, (self.process_details or {}).get("name")
        session.transitions.append(
            {"process": name, "transition": label, "when": session.when, "source": event.source_line}
        )
        if before != self.__state:
            session.warn(
                f"{self.node_name} is asked to {label}, which it can only from the state '{before}'; "
                f"it is '{self.__state}' by then",
                event.source_line,
            )
            return
        self.__state = after
        for transition, start, goal in ((label, before, meanwhile), ("transition_success", meanwhile, after)):
            labels = {"transition": transition, "start_state": start, "goal_state": goal}
            message = SimpleNamespace(**{key: SimpleNamespace(label=text) for key, text in labels.items()})
            session.emit(StateTransition(action=self, msg=message), {"on_transition_of": name, "state": goal})


class LifecycleTransition(Action):
    """Leads lifecycle nodes through some transitions, one after the other."""

    def __init__(self, *, lifecycle_node_names: Any, transition_ids: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if len(transition_ids) == 0 or len(lifecycle_node_names) == 0:
            raise ValueError("LifecycleTransition needs at least one node name and one transition id")
        self.__names = [normalize_to_list_of_substitutions(name) for name in lifecycle_node_names]
        texts = [str(given) if isinstance(given, int) else given for given in transition_ids]
        self.__ids = [normalize_to_list_of_substitutions(text) for text in texts]

    def execute(self, context: Any) -> list[Any]:
        """Register what follows each transition, and ask for the first."""
        names = [perform_substitutions(context, name) for name in self.__names]
        ids = [int(perform_substitutions(context, given)) for given in self.__ids]
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
        wanted = (meanwhile, after)
        return isinstance(event, StateTransition) and is_node(event.action) and _states(event) == wanted

    return RegisterEventHandler(OnStateTransition(matcher=matches, entities=[following], handle_once=True))


def _states(event: StateTransition) -> tuple[str, str]:
    return event.start_state, event.goal_state
