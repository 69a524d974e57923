"""The step `wait_for`.

The session does it (`grader.live.session.steps.wait_for`) with the director (`grader.live.ros_node.steps.wait_for`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult
from grader.recording.session import AWAITED


@dataclass
class WaitForResult(StepResult):
    """The name and the type under which it was found, or the names of its kind that are there instead."""

    waited_s: float | None = None
    name: str | None = None
    type: str | None = None
    there: list[str] | None = None


class WaitForStep(Step):
    """Wait for a node, an endpoint, a service, an action or a line of output; near misses of a name are found.

    What did not come is waited for half a second once more, until something is started, done or new in the graph.
    """

    kind = "wait_for"
    result = WaitForResult
    words = "waiting for {key} {target}"
    exactly_one = (*AWAITED, "output_of")
    example: ClassVar = {"publisher": "/chatter", "type": "std_msgs/msg/String"}

    node: ref.RosName | None = None
    publisher: ref.RosName | None = None
    subscription: ref.RosName | None = None
    service: ref.RosName | None = None
    action: ref.RosName | None = Field(None, description="An action's server.")
    action_client: ref.RosName | None = None
    output_of: ref.Process | None = Field(None, description="Process whose output is watched.")
    text: str | None = Field(None, description="Text that the line holds (with output_of).")
    type: ref.AnyType | None = None
    timeout_s: float = Field(10.0, gt=0, le=300)

    @property
    def awaited(self) -> tuple[str, str]:
        """Key and name of the awaited part of the graph, e.g. ("publisher", "/chatter"); two empty texts for output."""
        for key in AWAITED:
            name: str | None = getattr(self, key, None)
            if name:
                return key, name
        return "", ""
