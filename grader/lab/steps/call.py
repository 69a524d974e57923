"""The step `call`.

The director does it: `grader.live.ros_node.steps.call`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import ABSENT, Step, StepResult


@dataclass
class CallRecord:
    """One call that ended: with a response, too late, or because the service was gone."""

    started_ns: int = 0
    ended_ns: int = 0
    response: Any = None
    #: Time that the grader itself stalled, in ns; counts for no deadline.
    held_up_ns: int = field(default=0, metadata=ABSENT)
    #: True if the service was gone from the graph.
    gone: bool = field(default=False, metadata=ABSENT)


@dataclass
class CallResult(StepResult):
    """The service under the name that the student uses, the request as it was sent, and the calls."""

    service: str | None = None
    type: str | None = None
    request: dict[str, Any] | None = None
    calls: list[CallRecord] = field(default_factory=list)


class CallStep(Step):
    """Call a service; keeps each request, response and latency."""

    kind = "call"
    result = CallResult
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
