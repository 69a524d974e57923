"""Goals that the director sends to the server of an action, and what comes of each.

The server is a student's: of what it sends, parts are kept within bounds, and what it never sends stays None.
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

from grader.live.ros_node.deadline import Deadline
from grader.live.ros_node.graph import interface_named
from grader.live.ros_node.plain import Room, plain

#: As `action_msgs/msg/GoalStatus` numbers them.
STATUS = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
#: Messages of feedback that the middleware keeps until they are taken.
_FEEDBACK_DEPTH = 1000
#: What is kept of a goal's feedback: so many messages, none that is larger, in so many characters and values.
_MOST_FEEDBACK, _LARGEST_FEEDBACK_BYTES, _FEEDBACK_ROOM = 500, 2**20, 100_000
#: Serialised bytes of a goal's feedback that are decoded, all messages together: a MiB of short elements takes 0.2 s.
_MOST_DECODED_BYTES = 4 * 2**20
#: Where the identifier of its goal stands in a serialised message of feedback: behind the header of CDR.
_GOAL_ID = slice(4, 20)
#: After the last result, how long feedback that was sent before it may still be on its way.
_SETTLED_S = 0.2
#: How long a server may be gone from the graph, as it is when its node has ended.
_GONE_S = 1.0


class ActionProbe:
    """A client of an action, with a subscription of its own to the feedback.

    That of rclpy's client keeps ten messages, and drops those that are taken after the result.
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
        """Whether all of a server is in the graph."""
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
    """A goal that was sent; `record` is what has come of it so far."""

    def __init__(self, client: ActionClient, message: Any) -> None:
        self.id = uuid.uuid4().bytes
        self._handle: Any = None
        self._room = Room(_FEEDBACK_ROOM)
        self._left_bytes = _MOST_DECODED_BYTES
        self.record: dict[str, Any] = {
            "goal": plain(message),
            "goal_id": self.id.hex(),
            "sent_ns": time.time_ns(),
            "answered_ns": None,
            "accepted": None,
            "stamp_ns": None,
            "feedback": [],
            "feedback_count": 0,
            "first_feedback_ns": None,
            "last_feedback_ns": None,
            "ended_ns": None,
            "status": None,
            "result": None,
            "cancel": None,
        }
        client.send_goal_async(message, goal_uuid=UUID(uuid=list(self.id))).add_done_callback(
            self._answered
        )

    @property
    def under_way(self) -> bool:
        """Whether it was accepted and has no result yet."""
        return self.record["accepted"] is True and self.record["ended_ns"] is None

    @property
    def over(self) -> bool:
        """Whether nothing more is to come of it: it was rejected, or its result is there and a cancelling answered."""
        ended = self.record["accepted"] is False or self.record["ended_ns"] is not None
        return ended and (
            self.record["cancel"] is None or self.record["cancel"]["answered_ns"] is not None
        )

    @property
    def accepted_for_s(self) -> float:
        """How long ago it was accepted, in s."""
        return (time.time_ns() - int(self.record["answered_ns"])) / 1e9

    def cancel(self) -> None:
        """Ask for it to be cancelled, if that was not done before."""
        if self.record["cancel"] is None:
            self.record["cancel"] = {
                "sent_ns": time.time_ns(),
                "answered_ns": None,
                "accepted": None,
                "code": None,
            }
            self._handle.cancel_goal_async().add_done_callback(self._cancel_answered)

    def take_feedback(self, kind: type, data: bytes, source_ns: int) -> None:
        """Note a message of feedback."""
        self.record["feedback_count"] += 1
        kept = self.record["feedback"]
        is_small = len(data) <= min(_LARGEST_FEEDBACK_BYTES, self._left_bytes)
        if len(kept) < _MOST_FEEDBACK and is_small and self._room.left > 0:
            self._left_bytes -= len(data)
            values = None
            with suppress(Exception):  # Whoever publishes without ROS may send what is no message.
                values = plain(deserialize_message(data, kind).feedback, self._room)
            kept.append({"t_ns": source_ns, "values": values})
        self.record["first_feedback_ns"] = self.record["first_feedback_ns"] or source_ns
        self.record["last_feedback_ns"] = source_ns

    def finish(self) -> dict[str, Any]:
        """Return the record; of a goal without a result, with the last status that the server published."""
        if self._handle is not None and self.record["ended_ns"] is None:
            self.record["status"] = _status(self._handle.status)
        return self.record

    def _answered(self, future: Any) -> None:
        self._handle = future.result()
        stamp = self._handle.stamp
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        self.record |= {
            "answered_ns": time.time_ns(),
            "accepted": self._handle.accepted,
            "stamp_ns": stamp_ns,
        }
        if self._handle.accepted:
            self._handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        response = future.result()
        self.record |= {"ended_ns": time.time_ns(), "status": _status(response.status)}
        self.record["result"] = plain(response.result)

    def _cancel_answered(self, future: Any) -> None:
        response = future.result()
        accepted = any(bytes(info.goal_id.uuid) == self.id for info in response.goals_canceling)
        self.record["cancel"] |= {
            "answered_ns": time.time_ns(),
            "accepted": accepted,
            "code": response.return_code,
        }


def _status(number: int) -> str:
    return STATUS[number] if 0 <= number < len(STATUS) else STATUS[0]


class GoalStep:
    """A step that sends a goal, `request` as the rubric has it; the executor is to spin while it is asked to advance.

    The goals are messages of the type that the server has.
    """

    def __init__(
        self,
        probe: ActionProbe,
        request: Mapping[str, Any],
        timeout_s: float,
        goal: Any,
        newer: Any = None,
    ) -> None:
        self._probe, self._request, self._newer = probe, request, newer
        self._deadline, self._gone = Deadline(timeout_s), Deadline(_GONE_S)
        self._settled: Deadline | None = None
        self.goals = [probe.send(goal)]
        self.outcome = ""

    def advance(self) -> bool:
        """Cancel or send what is due, and return whether all is over; the outcome then says how."""
        first = self.goals[0]
        if first.under_way and self._is_time_to_cancel(first):
            first.cancel()
        if (
            first.under_way
            and self._newer is not None
            and first.accepted_for_s >= self._request["newer_after_s"]
        ):
            self.goals.append(self._probe.send(self._newer))
            self._newer = None
        if all(goal.over for goal in self.goals):
            self._settled = self._settled or Deadline(
                _SETTLED_S if first.record["accepted"] else 0.0
            )
            self.outcome = "done" if self._settled.passed() else ""
        else:
            self._gone = self._gone if not self._probe.ready else Deadline(_GONE_S)
            # A server that is gone would never have answered, however busy the machine.
            self.outcome = (
                "timeout" if self._deadline.passed() else "failed" if self._gone.passed() else ""
            )
        return bool(self.outcome)

    def _is_time_to_cancel(self, goal: Goal) -> bool:
        after_s, after_feedback = (
            self._request["cancel_after_s"],
            self._request["cancel_after_feedback"],
        )
        waited = after_s is not None and goal.accepted_for_s >= after_s
        return waited or (
            after_feedback is not None and goal.record["feedback_count"] >= after_feedback
        )

    def result(self) -> dict[str, Any]:
        """Return what came of its goals."""
        stall_ns = round(self._deadline.stall_s * 1e9)
        return {
            "goals": [goal.finish() for goal in self.goals],
            **({"held_up_ns": stall_ns} if stall_ns else {}),
        }
