"""Goals that the director sends to the server of an action, and the records of them.

The server is a student's. Parts of its messages are kept within bounds; missing answers stay None.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from unique_identifier_msgs.msg import UUID

from grader.lab.steps.send_goal import Cancelling, Feedback, GoalRecord, SendGoalStep
from grader.live.ros_node.deadline import Deadline
from grader.live.ros_node.graph import interface_named
from grader.live.ros_node.plain import Room, plain

#: As `action_msgs/msg/GoalStatus` numbers them.
STATUS = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
#: Messages of feedback that the middleware keeps until they are taken.
_FEEDBACK_DEPTH = 1000
#: Messages of feedback that are kept of a goal.
_MOST_FEEDBACK = 500
#: Size of a message of feedback above which its values are left out.
_LARGEST_FEEDBACK_BYTES = 2**20
#: Characters and values that are kept of a goal's feedback.
_FEEDBACK_ROOM = 100_000
#: Serialised bytes of a goal's feedback that are decoded. A MiB of short elements takes 0.2 s.
_MOST_DECODED_BYTES = 4 * 2**20
#: Offset of the goal's identifier in a serialised message of feedback, after the header of CDR.
_GOAL_ID = slice(4, 20)
#: Longest wait for earlier feedback after the last result, in s.
_SETTLED_S = 0.2
#: Time in s that a server may be gone from the graph, as it is when its node has ended.
_GONE_S = 1.0


class ActionProbe:
    """A client of an action, with a subscription of its own to the feedback.

    The subscription of rclpy's client keeps ten messages, and drops those that are taken after the result.
    """

    def __init__(self, node: Node, action: str, action_type: str) -> None:
        self.type = interface_named(action_type)
        self._client = ActionClient(node, self.type, action)
        self._goals: dict[bytes, Goal] = {}
        message, topic = self.type.Impl.FeedbackMessage, f"{action}/_action/feedback"
        node.create_subscription(
            message, topic, self._take_feedback, QoSProfile(depth=_FEEDBACK_DEPTH), raw=True
        )

    @property
    def ready(self) -> bool:
        """True if all of a server is in the graph."""
        return bool(self._client.server_is_ready())

    def send(self, message: Any) -> Goal:
        """Send a goal."""
        goal = Goal(self._client, message)
        self._goals[goal.id] = goal
        return goal

    def _take_feedback(self, data: bytes, info: Mapping[str, Any]) -> None:
        goal = self._goals.get(data[_GOAL_ID])
        if goal is not None:
            goal.take_feedback(self.type.Impl.FeedbackMessage, data, int(info["source_timestamp"]))


class Goal:
    """A goal that was sent, and its `record` until now."""

    def __init__(self, client: ActionClient, message: Any) -> None:
        self.id = uuid.uuid4().bytes
        self._handle: Any = None
        self._room = Room(_FEEDBACK_ROOM)
        self._left_bytes = _MOST_DECODED_BYTES
        self.record = GoalRecord(plain(message), self.id.hex(), time.time_ns())
        sending = client.send_goal_async(message, goal_uuid=UUID(uuid=list(self.id)))
        sending.add_done_callback(self._answered)

    @property
    def under_way(self) -> bool:
        """True if the goal was accepted and has no result yet."""
        return self.record.accepted is True and self.record.ended_ns is None

    @property
    def over(self) -> bool:
        """True if no more answers can come: after a rejection, or the result and an answer to a cancelling."""
        if self.record.accepted is not False and self.record.ended_ns is None:
            return False
        cancel = self.record.cancel
        return cancel is None or cancel.answered_ns is not None

    @property
    def accepted_for_s(self) -> float:
        """Time since the goal was accepted, in s."""
        assert self.record.answered_ns is not None
        return (time.time_ns() - self.record.answered_ns) / 1e9

    def cancel(self) -> None:
        """Ask the server to cancel the goal, unless that was asked before."""
        if self.record.cancel is None:
            self.record.cancel = Cancelling(time.time_ns())
            self._handle.cancel_goal_async().add_done_callback(self._cancel_answered)

    def take_feedback(self, kind: type, data: bytes, source_ns: int) -> None:
        """Note a message of feedback."""
        record = self.record
        record.feedback_count += 1
        if len(record.feedback) < _MOST_FEEDBACK and self._has_room(data):
            self._left_bytes -= len(data)
            values = None
            # A publisher without ROS may send bytes that are not a message.
            with suppress(Exception):
                values = plain(deserialize_message(data, kind).feedback, self._room)
            record.feedback.append(Feedback(source_ns, values))
        if record.first_feedback_ns is None:
            record.first_feedback_ns = source_ns
        record.last_feedback_ns = source_ns

    def _has_room(self, data: bytes) -> bool:
        is_small = len(data) <= min(_LARGEST_FEEDBACK_BYTES, self._left_bytes)
        return is_small and self._room.left > 0

    def finish(self) -> GoalRecord:
        """Return the record; of a goal without a result, with the last status that the server published."""
        if self._handle is not None and self.record.ended_ns is None:
            self.record.status = _status(self._handle.status)
        return self.record

    def _answered(self, future: Any) -> None:
        self._handle = future.result()
        stamp = self._handle.stamp
        self.record.answered_ns = time.time_ns()
        self.record.accepted = self._handle.accepted
        self.record.stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        if self._handle.accepted:
            self._handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        response = future.result()
        self.record.ended_ns = time.time_ns()
        self.record.status = _status(response.status)
        self.record.result = plain(response.result)

    def _cancel_answered(self, future: Any) -> None:
        response = future.result()
        cancel = self.record.cancel
        assert cancel is not None
        cancel.answered_ns = time.time_ns()
        cancel.accepted = any(
            bytes(info.goal_id.uuid) == self.id for info in response.goals_canceling
        )
        cancel.code = response.return_code


def _status(number: int) -> str:
    return STATUS[number] if 0 <= number < len(STATUS) else STATUS[0]


class GoalSeries:
    """The goals of a step; the executor must spin between two calls of `advance`.

    Parameters
    ----------
    goal, newer
        Messages of the type that the server has.
    """

    def __init__(
        self, probe: ActionProbe, step: SendGoalStep, timeout_s: float, goal: Any, newer: Any = None
    ) -> None:
        self._probe = probe
        self._step = step
        self._newer = newer
        self._deadline = Deadline(timeout_s)
        self._gone = Deadline(_GONE_S)
        self._settled: Deadline | None = None
        self._goals = [probe.send(goal)]
        self.outcome = ""

    def advance(self) -> bool:
        """Cancel or send the due goals, and return whether the series is over, with an `outcome`."""
        first = self._goals[0]
        if first.under_way and self._is_time_to_cancel(first):
            first.cancel()
        if first.under_way and self._is_time_for_newer(first):
            self._goals.append(self._probe.send(self._newer))
            self._newer = None
        self.outcome = self._outcome_now()
        return bool(self.outcome)

    def _outcome_now(self) -> str:
        if all(goal.over for goal in self._goals):
            return "done" if self._is_settled() else ""
        if self._probe.ready:
            self._gone = Deadline(_GONE_S)
        if self._deadline.passed():
            return "timeout"
        # A server that is gone would never have answered, however busy the machine.
        return "failed" if self._gone.passed() else ""

    def _is_settled(self) -> bool:
        """Return whether feedback from before the last result had time to arrive."""
        if self._settled is None:
            time_s = _SETTLED_S if self._goals[0].record.accepted else 0.0
            self._settled = Deadline(time_s)
        return self._settled.passed()

    def _is_time_to_cancel(self, goal: Goal) -> bool:
        after_s = self._step.cancel_after_s
        if after_s is not None and goal.accepted_for_s >= after_s:
            return True
        count = self._step.cancel_after_feedback
        return count is not None and goal.record.feedback_count >= count

    def _is_time_for_newer(self, goal: Goal) -> bool:
        return self._newer is not None and goal.accepted_for_s >= self._step.newer_after_s

    def finish(self) -> list[GoalRecord]:
        """Return the records of the goals."""
        return [goal.finish() for goal in self._goals]

    @property
    def held_up_ns(self) -> int:
        """Time that the grader itself stalled, in ns."""
        return round(self._deadline.stall_s * 1e9)
