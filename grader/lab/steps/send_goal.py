"""The step `send_goal`.

The director does it: `grader.live.ros_node.steps.send_goal`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import ABSENT, Step, StepResult


@dataclass
class Feedback:
    """A message of feedback: when it was sent, and its values as far as they were kept."""

    t_ns: int = 0
    values: Any = None


@dataclass
class Cancelling:
    """A request to cancel a goal, and the answer to it."""

    sent_ns: int = 0
    answered_ns: int | None = None
    accepted: bool | None = None
    #: As `action_msgs/srv/CancelGoal` numbers them.
    code: int | None = None


@dataclass
class GoalRecord:
    """A sent goal and its course; None for each missing answer."""

    goal: Any = None
    goal_id: str = ""
    sent_ns: int = 0
    answered_ns: int | None = None
    accepted: bool | None = None
    #: When the server says that it accepted the goal.
    stamp_ns: int | None = None
    #: The first messages of feedback.
    feedback: list[Feedback] = field(default_factory=list)
    #: Number of all messages of feedback.
    feedback_count: int = 0
    first_feedback_ns: int | None = None
    last_feedback_ns: int | None = None
    ended_ns: int | None = None
    #: Last known status in words, e.g. "succeeded".
    status: str | None = None
    result: Any = None
    cancel: Cancelling | None = None

    @property
    def answer_ns(self) -> int:
        """Time of the server's answer; 0 if there was none."""
        return 0 if self.answered_ns is None else self.answered_ns

    @property
    def feedback_span_ns(self) -> tuple[int, int]:
        """Times of the first and of the last feedback; 0 if there was none."""
        if self.first_feedback_ns is None or self.last_feedback_ns is None:
            return 0, 0
        return self.first_feedback_ns, self.last_feedback_ns


@dataclass
class SendGoalResult(StepResult):
    """The action under the name that the student uses, and the goals."""

    action: str | None = None
    type: str | None = None
    goals: list[GoalRecord] = field(default_factory=list)
    #: Time that the grader itself stalled, in ns; counts for no deadline.
    held_up_ns: int = field(default=0, metadata=ABSENT)


class SendGoalStep(Step):
    """Send a goal to an action; keeps the answer, the feedback with its times, and the result.

    While the goal is under way, it may be cancelled, or a newer one sent.
    """

    kind = "send_goal"
    result = SendGoalResult
    words = "sending a goal to {action}"
    command = "ros2 action send_goal -f {action} {type} {goal}"

    action: ref.RosName
    type: ref.ActionType
    goal: Annotated[dict[str, Any], ref.fields_of_type("_Goal")] = Field(default_factory=dict)
    cancel_after_s: float | None = Field(
        None, ge=0, le=300, description="Cancel it so long after it was accepted."
    )
    cancel_after_feedback: int | None = Field(
        None, ge=1, description="Cancel it after so much feedback."
    )
    newer_goal: Annotated[dict[str, Any], ref.fields_of_type("_Goal")] | None = Field(
        None, description="Another goal, sent while the first is under way."
    )
    newer_after_s: float = Field(
        0.5, ge=0, le=300, description="How long after the first was accepted."
    )
    timeout_s: float = Field(
        10.0, gt=0, le=300, description="Until all has been answered, the results included."
    )
