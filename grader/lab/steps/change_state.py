"""The step `change_state`.

The director does it: `grader.live.ros_node.steps.change_state`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import ABSENT, Step, StepResult


@dataclass
class ChangeStateResult(StepResult):
    """The node's answer to the transition, and its states before and after."""

    node: str | None = None
    success: bool | None = None
    before: str | None = None
    after: str | None = None
    #: Times of the request and of the answer to it.
    called_ns: int = field(default=0, metadata=ABSENT)
    answered_ns: int = field(default=0, metadata=ABSENT)

    def note(self) -> str:
        """Write the states, e.g. "inactive → active"."""
        return " → ".join(state for state in (self.before, self.after) if state is not None)


class ChangeStateStep(Step):
    """Ask a lifecycle node for a transition; keeps its answer, and its states before and after."""

    kind = "change_state"
    result = ChangeStateResult
    words = "asking {node} to {transition}"
    command = "ros2 lifecycle set {node} {transition}"

    node: ref.RosName
    transition: ref.LifecycleTransition
    timeout_s: float = Field(5.0, gt=0, le=60, description="For each of the three calls.")
