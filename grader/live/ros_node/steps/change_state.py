"""The action of the step `change_state`: a transition of a lifecycle node."""

from __future__ import annotations

import time
from typing import Any

from grader.lab.steps.base import Answer
from grader.lab.steps.change_state import ChangeStateResult, ChangeStateStep
from grader.live.ros_node.graph import interface_named
from grader.live.ros_node.probe import Probe

_NO_LIFECYCLE = "it offers no get_state service that answers, as a lifecycle node does"
_STUCK = "the transition was not answered"
#: Characters that are passed on of a state's name.
_LONGEST_LABEL = 40


def change_state(probe: Probe, step: ChangeStateStep) -> Answer:
    """Ask for the state, the transition and the state again."""
    node = probe.node_name(step.node)

    def ask(operation: str, kind: str, **fields: Any) -> Any:
        service, service_type = f"{node}/{operation}", f"lifecycle_msgs/srv/{kind}"
        return probe.ask(service, service_type, step.timeout_s, fields)

    before = ask("get_state", "GetState")
    if before is None:
        return Answer("timeout", ChangeStateResult(_NO_LIFECYCLE, node))
    # By its label: an id that is not possible in the node's state ends a node of rclpy.
    transition = interface_named("lifecycle_msgs/msg/Transition")(label=step.transition)
    called_ns = time.time_ns()
    changed = ask("change_state", "ChangeState", transition=transition)
    answered_ns = time.time_ns()
    after = None
    if changed is not None:
        after = ask("get_state", "GetState")
    if changed is None or after is None:
        return Answer("timeout", ChangeStateResult(_STUCK, node))
    result = ChangeStateResult(
        node=node,
        success=changed.success,
        before=before.current_state.label[:_LONGEST_LABEL],
        after=after.current_state.label[:_LONGEST_LABEL],
        called_ns=called_ns,
        answered_ns=answered_ns,
    )
    return Answer("done", result)
