"""The steps of a session: what each may be given, and how it is described while it runs.

A further step is a class here, listed in `STEPS`, and what the live half does for it: an operation of that name in
`grader.live.ros_node.director`, or where it concerns processes, in `grader.live.session.session`.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from grader.lab import references as ref
from grader.lab.lab_code import Settings
from grader.lab.references import Parameters
from grader.lab.yaml_with_lines import mistakes_at
from grader.recording.session import AWAITED


class Step(Parameters):
    """Base of the steps."""

    #: What it does, for the progress display and the report; of `exactly_one`, `{key}` and `{target}` stand for the
    #: name and what it holds.
    words: ClassVar[str]
    #: What does the same in a terminal, with names of its parameters; empty where nothing does.
    command: ClassVar[str] = ""

    def describe(self) -> str:
        """Say in a few words what it does."""
        key = next((key for key in self.exactly_one if getattr(self, key) is not None), "")
        return self.words.format(
            key=key.replace("_", " "), target=getattr(self, key, ""), **vars(self)
        )

    def commands(self) -> Sequence[str]:
        """Return what does the same in a terminal, as templates with names of its parameters."""
        return [self.command] if self.command else []


class StartStep(Step):
    """Start a student's artifact, the processes of a launch plan, or a reference node."""

    words = "starting {target}"
    exactly_one = ("student", "launch", "reference")
    example: ClassVar = {"student": "talker"}

    student: ref.Artifact | None = None
    launch: ref.Artifact | None = None
    reference: ref.ReferenceNode | None = None
    name: str | None = Field(
        None, description="Name of the process; the artifact's by default (student only)."
    )
    parameters: dict[str, Any] = Field(
        default_factory=dict, description="ROS parameters (student only)."
    )
    remappings: dict[str, str] = Field(
        default_factory=dict, description="Name remappings (student only)."
    )
    composed: dict[str, str] = Field(
        default_factory=dict,
        description="Name remappings besides, where the artifact's file holds others too.",
    )
    if_ended: bool = Field(False, description="Start it again only if it has ended.")
    with_: Settings = Field(
        default_factory=dict, alias="with", description="Settings (reference only)."
    )

    @model_validator(mode="after")
    def _is_of_use(self) -> StartStep:
        owners = dict.fromkeys(
            ("name", "parameters", "remappings", "composed", "if_ended"), "student"
        )
        owners["with_"] = "reference"
        if useless := [
            key
            for key in self.model_fields_set & owners.keys()
            if getattr(self, owners[key]) is None
        ]:
            raise mistakes_at(
                ((key.rstrip("_"),), f"only a {owners[key]} takes it") for key in useless
            )
        return self


class WaitForStep(Step):
    """Wait for a node, an endpoint, a service, an action or a line of output; near misses of a name are found.

    What did not come is waited for half a second once more, until something is started, done or new in the graph.
    """

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


class ObserveStep(Step):
    """Let the system run for a time; the window opens with the first message on `first_message_on`.

    Where the machine leaves the student's processes less than 0.7 s of it undisturbed, it goes on until they had
    that, for `extend_s` at most.
    """

    words = "observing for {duration_s:g} s"

    duration_s: float = Field(gt=0, le=300)
    extend_s: float = Field(0.0, ge=0, le=300)
    first_message_on: ref.Topic | None = None
    timeout_s: float = Field(5.0, gt=0, le=300, description="How long the first message may take.")


class PublishStep(Step):
    """Publish one message some times, offered so that every subscription is compatible."""

    words = "publishing {count} messages on {topic}"
    command = "ros2 topic pub -r {rate_hz} {topic} {type} {message}"

    topic: ref.RosName
    type: ref.MessageType
    message: Annotated[dict[str, Any], ref.fields_of_type()]
    count: int = Field(10, ge=1, le=10_000)
    rate_hz: float = Field(100.0, gt=0, le=1000)


class CallStep(Step):
    """Call a service; keeps each request, response and latency."""

    words = "calling {service} ({repeat}×)"
    command = "ros2 service call {service} {type} {request}"
    example: ClassVar = {"request": {"data": True}}

    service: ref.RosName
    type: ref.ServiceType
    request: Annotated[dict[str, Any], ref.fields_of_type("_Request")] = Field(default_factory=dict)
    repeat: int = Field(1, ge=1, le=10_000)
    clients: int = Field(1, ge=1, le=16)
    timeout_s: float = Field(5.0, gt=0, le=60, description="For each call.")
    at_most_s: float = Field(
        30.0, gt=0, le=300, description="For all of them; calls not made by then are skipped."
    )


class SendGoalStep(Step):
    """Send a goal to an action; keeps the answer, the feedback with its times, and the result.

    While the goal is under way, it may be cancelled, or a newer one sent.
    """

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


class GetParametersStep(Step):
    """Read parameters of a student's node through its parameter services."""

    words = "reading parameters of {node}"
    command = "ros2 param dump {node}"

    node: ref.RosName
    names: tuple[ref.GivenName, ...]
    timeout_s: float = Field(5.0, gt=0, le=60)


class SetParametersStep(Step):
    """Set parameters of a student's node through its parameter services."""

    words = "setting parameters of {node}"

    node: ref.RosName
    values: dict[str, Any]
    refusal_expected: bool = Field(
        False,
        description="The values are invalid; what the node has is kept from before and after, and restored.",
    )
    timeout_s: float = Field(5.0, gt=0, le=60)

    def commands(self) -> Sequence[str]:
        """Return a command for each of the values."""
        written = (
            f"{name} {json.dumps(value)}"
            if not isinstance(value, str)
            else f"{name} {shlex.quote(value)}"
            for name, value in self.values.items()
        )
        return [
            "ros2 param set {node} " + text.replace("{", "{{").replace("}", "}}")
            for text in written
        ]


class ChangeStateStep(Step):
    """Ask a lifecycle node for a transition; keeps its answer, and its states before and after."""

    words = "asking {node} to {transition}"
    command = "ros2 lifecycle set {node} {transition}"

    node: ref.RosName
    transition: ref.LifecycleTransition
    timeout_s: float = Field(5.0, gt=0, le=60, description="For each of the three calls.")


class InterruptStep(Step):
    """Send SIGINT, as Ctrl-C would, and wait for the exit; '*' means all of the student's processes."""

    words = "interrupting {process}"

    process: ref.StudentProcesses
    timeout_s: float = Field(4.0, gt=0, le=60)


class WaitExitStep(Step):
    """Wait for a process to end by itself."""

    words = "waiting until {process} ends"

    process: ref.Process
    timeout_s: float = Field(20.0, gt=0, le=600)


class PlanStep(Step):
    """Evaluate a launch file with arguments, without starting what it describes."""

    words = "evaluating {launch}"
    command = "ros2 launch {launch}"

    launch: ref.Artifact
    arguments: dict[str, str] = Field(default_factory=dict)
    assume: dict[str, str] = Field(
        default_factory=dict,
        description="Values for arguments that the file uses without declaring them.",
    )
    timeout_s: float = Field(10.0, gt=0, le=60)


class LinkStep(Step):
    """Carry messages between two programs of the grader's over a link that loses and delays, with a student's QoS.

    Each topic has the profiles that the student's publisher offers and subscription requests, and messages of the
    type with nothing in them. Lost are packets of data and those that acknowledge them, for each share anew; not those
    by which both sides find each other. After the last message four subscriptions join late. It goes on beside the
    steps that follow, and takes `duration_s` and 1 s for each share. It costs nobody points: a figure shows it.
    """

    words = "the student's profiles on a link that loses packets"

    topics: tuple[ref.Topic, ...] = Field(min_length=1, max_length=8)
    loss: tuple[ref.Share, ...] = Field(
        ("5%", "30%"), min_length=1, max_length=4, validate_default=True
    )
    delay_ms: float = Field(
        10.0, ge=0, le=500, description="Delay of each packet that is not lost."
    )
    rate_hz: float = Field(100.0, gt=0, le=200, description="Messages a second on each topic.")
    duration_s: float = Field(2.5, gt=0, le=30, description="For each share.")


#: Kind of a step -> its model.
STEPS: dict[str, type[Step]] = {
    "start": StartStep,
    "wait_for": WaitForStep,
    "observe": ObserveStep,
    "publish": PublishStep,
    "call": CallStep,
    "send_goal": SendGoalStep,
    "get_parameters": GetParametersStep,
    "set_parameters": SetParametersStep,
    "change_state": ChangeStateStep,
    "interrupt": InterruptStep,
    "wait_exit": WaitExitStep,
    "plan": PlanStep,
    "link": LinkStep,
}
