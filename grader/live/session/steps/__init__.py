"""The actions of steps that concern processes, a module a step. Each takes the session and the step, and answers.

Their models are in the modules of the same names of `grader.lab.steps`. The director does all other steps alone.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from grader.lab import steps
from grader.lab.steps.base import Answer, Step
from grader.live.session.programs import Programs
from grader.live.session.steps.interrupt import interrupt
from grader.live.session.steps.link import link
from grader.live.session.steps.observe import observe
from grader.live.session.steps.plan import plan
from grader.live.session.steps.start import start
from grader.live.session.steps.wait_exit import wait_exit
from grader.live.session.steps.wait_for import wait_for


async def by_director(programs: Programs, step: Step) -> Answer:
    """Have the director do a step alone."""
    return await programs.direct(step)


#: Model of a step -> its action.
ACTIONS: dict[type[Step], Callable[[Programs, Any], Coroutine[Any, Any, Answer]]] = {
    steps.StartStep: start,
    steps.WaitForStep: wait_for,
    steps.ObserveStep: observe,
    steps.PublishStep: by_director,
    steps.CallStep: by_director,
    steps.SendGoalStep: by_director,
    steps.GetParametersStep: by_director,
    steps.SetParametersStep: by_director,
    steps.ChangeStateStep: by_director,
    steps.InterruptStep: interrupt,
    steps.WaitExitStep: wait_exit,
    steps.PlanStep: plan,
    steps.LinkStep: link,
}
