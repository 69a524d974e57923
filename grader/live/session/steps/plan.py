"""The action of the step `plan`: evaluates a launch file."""

from __future__ import annotations

from grader.lab.steps.base import Answer
from grader.lab.steps.plan import PlanResult, PlanStep
from grader.live.session.programs import Programs


async def plan(programs: Programs, step: PlanStep) -> Answer:
    """Evaluate the launch file; the first plan without arguments is the one that the session can start."""
    answer = await programs.launch.plan(step)
    is_first = programs.record.plan is None and not step.arguments
    if is_first and isinstance(answer.result, PlanResult):
        programs.record.plan = answer.result.plan
    return answer
