"""The step `wait_exit`.

The session does it: `grader.live.session.steps.wait_exit`.
"""

from __future__ import annotations

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step


class WaitExitStep(Step):
    """Wait for a process to end by itself."""

    kind = "wait_exit"
    words = "waiting until {process} ends"

    process: ref.Process
    timeout_s: float = Field(20.0, gt=0, le=600)
