"""The messages that cross a link, for both programs at its ends; knows no ROS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from grader.lab.steps.link import LinkedTopic


@dataclass(frozen=True)
class LinkPlan:
    """Each topic at a rate, once for each share of packets that the link loses."""

    topics: Sequence[LinkedTopic]
    loss: Sequence[float]
    rate_hz: float
    duration_s: float
