"""The actions of steps that the director does, a module a step. Each takes the probe and the step, and answers.

Their models are in the modules of the same names of `grader.lab.steps`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from grader.lab import steps
from grader.lab.steps.base import Answer, Step
from grader.live.ros_node.probe import Probe
from grader.live.ros_node.steps.call import call
from grader.live.ros_node.steps.change_state import change_state
from grader.live.ros_node.steps.get_parameters import get_parameters
from grader.live.ros_node.steps.observe import observe
from grader.live.ros_node.steps.publish import publish
from grader.live.ros_node.steps.send_goal import send_goal
from grader.live.ros_node.steps.set_parameters import set_parameters
from grader.live.ros_node.steps.wait_for import wait_for

#: Model of a step -> its action.
ACTIONS: dict[type[Step], Callable[[Probe, Any], Answer]] = {
    steps.WaitForStep: wait_for,
    steps.ObserveStep: observe,
    steps.PublishStep: publish,
    steps.CallStep: call,
    steps.SendGoalStep: send_goal,
    steps.GetParametersStep: get_parameters,
    steps.SetParametersStep: set_parameters,
    steps.ChangeStateStep: change_state,
}
