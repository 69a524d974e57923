"""What a step of the kind `link` found: how topics crossed a link that loses and delays, with a student's profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from grader.recording.session import Qos


@dataclass
class Crossing:
    """A topic on the link while that lost a share of the packets of data."""

    loss: float
    #: So many messages were sent.
    sent: int
    #: Publication sequence number, from 1, and latency in µs of each message, in the order in which they were taken.
    received: list[list[int]] = field(default_factory=list)
    #: For each subscription that joined after the last message: the numbers of those that it got.
    late: list[list[int]] = field(default_factory=list)


@dataclass
class LinkedTopic:
    """A topic with the profiles of the student's publisher and subscription; what has not both was not carried."""

    #: Its name in the rubric, and the one that the student used.
    name: str
    topic: str
    type: str = ""
    offered: Qos | None = None
    requested: Qos | None = None
    crossings: list[Crossing] = field(default_factory=list)


@dataclass
class LinkResult:
    """All of the step. The latencies are of the link; `delay_ms` of them is its own delay, each way."""

    topics: list[LinkedTopic] = field(default_factory=list)
    delay_ms: float = 0.0
    #: Of the packets 95 % were no more than this later than that: what the grading computer added.
    late_ms: float = 0.0
    #: By what means it loses and delays.
    means: str = ""
    #: What it took of the grading computer.
    cpu_s: float = 0.0
    #: Why there is no more.
    problem: str = ""


@dataclass(frozen=True)
class LinkPlan:
    """What is sent: each topic at a rate, once for each share of packets that the link loses."""

    topics: Sequence[LinkedTopic]
    loss: Sequence[float]
    rate_hz: float
    duration_s: float
