"""Result of a step `link`: how topics crossed a link with loss and delay, under a student's QoS profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from grader.recording.session import Qos


@dataclass
class Crossing:
    """A topic on the link at one share of lost packets of data."""

    loss: float
    #: Number of sent messages.
    sent: int
    #: Publication sequence number, from 1, and latency in µs of each message, in the order of reception.
    received: list[list[int]] = field(default_factory=list)
    #: For each subscription that joined after the last message: the numbers of its received messages.
    late: list[list[int]] = field(default_factory=list)


@dataclass
class LinkedTopic:
    """A topic with the profiles of the student's publisher and subscription; a topic without both did not cross the link."""

    #: Name in the rubric.
    name: str
    #: Name in the student's graph.
    topic: str
    type: str = ""
    offered: Qos | None = None
    requested: Qos | None = None
    crossings: list[Crossing] = field(default_factory=list)


@dataclass
class LinkResult:
    """All results of the step. Latencies include `delay_ms`, the link's own delay each way."""

    topics: list[LinkedTopic] = field(default_factory=list)
    delay_ms: float = 0.0
    #: Delay that the grading computer added: 95th percentile of the packets.
    late_ms: float = 0.0
    #: Means of loss and delay.
    means: str = ""
    #: CPU time of the link.
    cpu_s: float = 0.0
    #: Reason why the result is incomplete.
    problem: str = ""


@dataclass(frozen=True)
class LinkPlan:
    """The messages to send: each topic at a rate, once for each share of packets that the link loses."""

    topics: Sequence[LinkedTopic]
    loss: Sequence[float]
    rate_hz: float
    duration_s: float
