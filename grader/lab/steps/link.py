"""The step `link`.

The session does it: `grader.live.session.steps.link`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult
from ros_bag.qos import Qos


@dataclass
class Crossing:
    """A topic on the link while the link lost a share of the packets of data."""

    loss: float
    #: Number of messages that were sent.
    sent: int
    #: Publication sequence number, from 1, and latency in µs of each message, in the order of arrival.
    received: list[list[int]] = field(default_factory=list)
    #: Sequence numbers of the messages that each subscription got which joined after the last message.
    late: list[list[int]] = field(default_factory=list)


@dataclass
class LinkedTopic:
    """A topic with the profiles of the student's publisher and subscription; carried only if it has both."""

    #: Name in the rubric.
    name: str
    #: Name that the student uses.
    topic: str
    type: str = ""
    offered: Qos | None = None
    requested: Qos | None = None
    crossings: list[Crossing] = field(default_factory=list)


@dataclass
class LinkResult(StepResult):
    """The topics, and the link that they crossed."""

    #: Reason for missing topics or crossings; the record has it in any case.
    problem: str | None = ""
    topics: list[LinkedTopic] = field(default_factory=list)
    #: Delay of the link itself, each way; the latencies include it.
    delay_ms: float = 0.0
    #: Delay by the grading computer that 95 % of the packets did not exceed.
    late_ms: float = 0.0
    #: Means of the link to lose and delay packets, in words.
    means: str = ""
    #: CPU time that the link took.
    cpu_s: float = 0.0


class LinkStep(Step):
    """Carry messages between two programs of the grader's over a link that loses and delays, with a student's QoS.

    Each topic has the profiles that the student's publisher offers and subscription requests, and messages of the
    type with nothing in them. Lost are packets of data and those that acknowledge them, for each share anew; not those
    by which both sides find each other. After the last message four subscriptions join late. It goes on beside the
    steps that follow, and takes `duration_s` and 1 s for each share. It costs nobody points: a figure shows it.
    """

    kind = "link"
    result = LinkResult
    words = "the QoS profiles on a link that loses packets"

    topics: tuple[ref.Topic, ...] = Field(min_length=1, max_length=8)
    loss: tuple[ref.Share, ...] = Field(
        ("5%", "30%"), min_length=1, max_length=4, validate_default=True
    )
    delay_ms: float = Field(
        10.0, ge=0, le=500, description="Delay of each packet that is not lost."
    )
    rate_hz: float = Field(100.0, gt=0, le=200, description="Messages a second on each topic.")
    duration_s: float = Field(2.5, gt=0, le=30, description="For each share.")
