"""The action of the step `observe` in the director: a window of time."""

from __future__ import annotations

import time

from grader.lab.steps.base import Answer
from grader.lab.steps.observe import ObserveResult, ObserveStep
from grader.live.ros_node.probe import Probe


def observe(probe: Probe, step: ObserveStep) -> Answer:
    """Wait for the first message, then for the duration."""
    if step.first_message_on:
        topic = probe.name(step.first_message_on)

        def is_heard() -> bool:
            counts = probe.recorder.counts.items()
            return any(count for (name, _), count in counts if name == topic)

        if not probe.until(is_heard, step.timeout_s):
            return Answer("timeout", ObserveResult(topic=topic))
    opened_ns = time.time_ns()
    probe.wait(step.duration_s)
    return Answer("done", ObserveResult(opened_ns=opened_ns, closed_ns=time.time_ns()))
