"""The step `interrupt`.

The session does it: `grader.live.session.steps.interrupt`.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult


@dataclass
class InterruptResult(StepResult):
    """The end of each process, see `ProcessRun.ended_by`."""

    ended_by: dict[str, str] | None = None


class InterruptStep(Step):
    """Send SIGINT, as Ctrl-C would, and wait for the exit; '*' means all of the student's processes."""

    kind = "interrupt"
    result = InterruptResult
    words = "interrupting {process}"

    process: ref.StudentProcesses
    timeout_s: float = Field(4.0, gt=0, le=60)

    def describe(self) -> str:
        """Name the process, or say that all programs are interrupted."""
        if self.process == "*":
            return "interrupting all programs"
        return super().describe()
