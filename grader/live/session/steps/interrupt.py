"""The action of the step `interrupt`: SIGINT to the student's processes."""

from __future__ import annotations

import asyncio

from grader.lab.steps.base import Answer
from grader.lab.steps.interrupt import InterruptResult, InterruptStep
from grader.live.process.process import RunningProcess
from grader.live.session.programs import Programs

_FORCED = ("terminate", "kill")


async def interrupt(programs: Programs, step: InterruptStep) -> Answer:
    """Send SIGINT, and end processes that do not stop in time."""
    chosen = programs.sandbox.students()
    if step.process == "*":
        programs.launch.end()
    else:
        chosen = [process for process in chosen if process.run.name == step.process]
    alive = [process for process in chosen if process.alive]
    stacks = programs.sandbox.stacks
    await stacks.look(alive, hang=False)

    async def stop(process: RunningProcess) -> None:
        await process.stop(step.timeout_s, lambda: stacks.look([process], hang=True))

    await asyncio.gather(*map(stop, alive))
    for process in alive:
        run = process.run
        if run.interrupted_ns is None and run.ended_by in _FORCED:
            problem = f"{run.name} was not interrupted: its process was not found"
            programs.record.problems.append(problem)
    ended = {process.run.name: process.run.ended_by for process in chosen}
    is_stubborn = any(how in _FORCED for how in ended.values())
    return Answer("timeout" if is_stubborn else "done", InterruptResult(ended_by=ended))
