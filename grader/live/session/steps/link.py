"""The action of the step `link`: begins to carry messages beside the steps that follow."""

from __future__ import annotations

from grader.lab.steps.base import Answer
from grader.lab.steps.link import LinkStep
from grader.live.session.programs import Programs


async def link(programs: Programs, step: LinkStep) -> Answer:
    """Begin; the session waits for the link after its last step."""
    return programs.start_link(step)
