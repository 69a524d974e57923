"""The action of the step `wait_exit`: a process that ends by itself."""

from __future__ import annotations

from grader.lab.steps.base import Answer, StepResult
from grader.lab.steps.wait_exit import WaitExitStep
from grader.live.session.programs import Programs


async def wait_exit(programs: Programs, step: WaitExitStep) -> Answer:
    """Wait until the process has ended."""
    process = programs.processes.get(step.process)
    if process is None:
        return Answer("failed", StepResult(f"there is no process {step.process}"))
    has_ended = await process.wait_exit(step.timeout_s)
    return Answer("done" if has_ended else "timeout")
