"""The action of the step `wait_for` in the session: a line of output; the director looks at the graph."""

from __future__ import annotations

from grader.lab.steps.base import Answer
from grader.lab.steps.wait_for import WaitForResult, WaitForStep
from grader.live.session.programs import Programs


async def wait_for(programs: Programs, step: WaitForStep) -> Answer:
    """Wait, and then hold the student's processes to cores."""
    if step.output_of:
        answer = await programs.wait_output(step.output_of, step.text or "", step.timeout_s)
    else:
        answer = await programs.direct(step)
        _, wanted = step.awaited
        found = answer.result
        if isinstance(found, WaitForResult) and found.name not in (None, wanted):
            programs.record.names[wanted] = found.name
    programs.hold_students_to_cores()
    return answer
