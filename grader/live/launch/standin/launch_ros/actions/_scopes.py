"""Actions whose effect lasts for the nodes that follow in the scope."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import POSITIONAL, Action, Field, SubstitutionFailure, Text, Typed, expose_action, mistake
from launch.actions import TimerAction

from ..utilities import (
    evaluate_parameter_dict,
    make_namespace_absolute,
    normalize_parameter_dict,
    prefix_namespace,
    validate_namespace,
)


@expose_action("push_ros_namespace")
@expose_action("push-ros-namespace")
class PushROSNamespace(Action):
    namespace = Text(positional=POSITIONAL, attribute="namespace")

    def execute(self, context: Any) -> None:
        pushed = self.text("namespace", context)
        before = context.launch_configurations.get("ros_namespace")
        namespace = make_namespace_absolute(prefix_namespace(before, pushed))
        try:
            validate_namespace(namespace or "")
        except ValueError as error:
            message = f"{error} (pushed '{pushed}' onto '{before or ''}')"
            raise mistake(SubstitutionFailure, message, "bad_name", error.__dict__["launch_remedy"]) from error
        context.launch_configurations["ros_namespace"] = namespace


PushRosNamespace = PushROSNamespace


def _add(context: Any, kept: str, items: Any) -> None:
    """Add to what is kept for the nodes that follow, among the launch configurations."""
    context.launch_configurations.setdefault(kept, []).extend(items)


@expose_action("set_parameter")
class SetParameter(Action):
    name = Text(positional=POSITIONAL, attribute="name")
    value: Any = Field(positional=POSITIONAL, attribute="value", read=Text.reading)

    def made(self) -> None:
        self.__parameters = normalize_parameter_dict({tuple(self.name): self.value})
        self.value = next(iter(self.__parameters.values()))

    def execute(self, context: Any) -> None:
        _add(context, "global_params", evaluate_parameter_dict(context, self.__parameters).items())


@expose_action("set_use_sim_time")
class SetUseSimTime(Action):
    """Lets the launch's own node, and with it `ROSTimer`, follow simulation time; other nodes get nothing of it."""

    performs = "follow_sim_time"

    value = Typed(positional=POSITIONAL, attribute="value", kind=bool)


@expose_action("set_parameters_from_file")
class SetParametersFromFile(Action):
    """Gives the nodes that follow a file of parameters; whether it is there is looked at when a node starts."""

    filename = Text(positional=POSITIONAL, attribute="filename")

    def execute(self, context: Any) -> None:
        _add(context, "global_params", [self.text("filename", context)])


@expose_action("set_ros_log_dir")
class SetROSLogDir(Action):
    """Sets the folder of the log files of the nodes that follow; a relative one lies in the present one."""

    new_log_dir = Text(positional=POSITIONAL, attribute="new_log_dir")
    log_dir = property(lambda self: self.new_log_dir)

    def execute(self, context: Any) -> None:
        before = context.environment.get("ROS_LOG_DIR") or str(Path.home() / ".ros" / "log")
        wanted = self.text("new_log_dir", context)
        context.environment["ROS_LOG_DIR"] = os.path.join(before, wanted)  # noqa: PTH118 - keeps the text as it is


@expose_action("set_remap")
class SetRemap(Action):
    src = Text(positional=POSITIONAL, attribute="from")
    dst = Text(positional=POSITIONAL, attribute="to")

    def execute(self, context: Any) -> None:
        _add(context, "ros_remaps", [(self.text("src", context), self.text("dst", context))])


@expose_action("ros_timer")
class ROSTimer(TimerAction):
    """Visits entities after a time of the ROS clock."""


RosTimer = ROSTimer
