"""The steps of a session, a module a step: its parameters, its words, its result. No ROS is needed to read them.

The action of a step is in a module of the same name below `grader.live.ros_node.steps`, or below
`grader.live.session.steps` if the step starts or ends processes. Imports the files of the lab and the recording's format.
"""

from __future__ import annotations

from grader.lab.steps.base import Step as Step
from grader.lab.steps.call import CallStep as CallStep
from grader.lab.steps.change_state import ChangeStateStep as ChangeStateStep
from grader.lab.steps.get_parameters import GetParametersStep as GetParametersStep
from grader.lab.steps.interrupt import InterruptStep as InterruptStep
from grader.lab.steps.link import LinkStep as LinkStep
from grader.lab.steps.observe import ObserveStep as ObserveStep
from grader.lab.steps.plan import PlanStep as PlanStep
from grader.lab.steps.publish import PublishStep as PublishStep
from grader.lab.steps.send_goal import SendGoalStep as SendGoalStep
from grader.lab.steps.set_parameters import SetParametersStep as SetParametersStep
from grader.lab.steps.start import StartStep as StartStep
from grader.lab.steps.wait_exit import WaitExitStep as WaitExitStep
from grader.lab.steps.wait_for import WaitForStep as WaitForStep

_MODELS: tuple[type[Step], ...] = (
    StartStep,
    WaitForStep,
    ObserveStep,
    PublishStep,
    CallStep,
    SendGoalStep,
    GetParametersStep,
    SetParametersStep,
    ChangeStateStep,
    InterruptStep,
    WaitExitStep,
    PlanStep,
    LinkStep,
)
#: Kind of a step -> its model, in the order of the documentation.
STEPS: dict[str, type[Step]] = {model.kind: model for model in _MODELS}
