"""The step `publish`.

The director does it: `grader.live.ros_node.steps.publish`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult


@dataclass
class PublishResult(StepResult):
    """The topic under the name that the student uses, and whether all of its subscriptions matched in time."""

    topic: str | None = None
    matched: bool | None = None

    def note(self) -> str:
        """Tell that nothing subscribed."""
        return "no subscription was matched" if self.matched is False else ""


class PublishStep(Step):
    """Publish one message some times, offered so that every subscription is compatible.

    Its label can also be a check's window, from the start of the step to its end.
    """

    kind = "publish"
    result = PublishResult
    words = "publishing {count} messages on {topic}"
    command = "ros2 topic pub -r {rate_hz} {topic} {type} {message}"

    topic: ref.RosName
    type: ref.MessageType
    message: Annotated[dict[str, Any], ref.fields_of_type()]
    count: int = Field(10, ge=1, le=10_000)
    rate_hz: float = Field(100.0, gt=0, le=1000)
    observe_s: float = Field(
        0.0, ge=0, description="How long the step goes on after the last message."
    )
