"""The action of the step `observe` in the session: windows of the director, until the machine was calm."""

from __future__ import annotations

from dataclasses import replace

from grader.lab.steps.base import Answer
from grader.lab.steps.observe import ObserveResult, ObserveStep
from grader.live.session.programs import Programs

#: Undisturbed time that a measurement needs, in s.
_CALM_S = 0.7
#: Increment of a measurement's window, in s.
_MORE_S = 0.5


async def observe(programs: Programs, step: ObserveStep) -> Answer:
    """Observe for the duration, and longer if the machine disturbed the student's processes."""
    answer = await programs.direct(step)
    window = answer.result
    if answer.outcome != "done" or not isinstance(window, ObserveResult):
        return answer
    for _ in range(int(step.extend_s / _MORE_S)):
        if await programs.watch.calm_s(window.opened_ns or 0) >= _CALM_S:
            break
        more = await programs.direct(ObserveStep(duration_s=_MORE_S))
        if more.outcome != "done" or not isinstance(more.result, ObserveResult):
            break
        window = replace(window, closed_ns=more.result.closed_ns)
    return Answer("done", window)
