"""The step `observe`.

The session does it (`grader.live.session.steps.observe`) with the director (`grader.live.ros_node.steps.observe`).
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult


@dataclass
class ObserveResult(StepResult):
    """The window; or the topic on which no first message came."""

    opened_ns: int | None = None
    closed_ns: int | None = None
    topic: str | None = None

    def note(self) -> str:
        """Name the topic without a first message."""
        if self.topic is None:
            return ""
        return f"no message on {self.topic}"


class ObserveStep(Step):
    """Let the system run for a time; the window opens with the first message on `first_message_on`.

    Where the machine leaves the student's processes less than 0.7 s of it undisturbed, it goes on until they had
    that, for `extend_s` at most.
    """

    kind = "observe"
    result = ObserveResult
    words = "observing for {duration_s:g} s"

    duration_s: float = Field(gt=0, le=300)
    extend_s: float = Field(0.0, ge=0, le=300)
    first_message_on: ref.Topic | None = None
    timeout_s: float = Field(5.0, gt=0, le=300, description="How long the first message may take.")
