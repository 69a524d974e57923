"""Actions whose effect lasts for the nodes that follow in the scope."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import (
    Action,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch.actions import TimerAction
from launch.frontend.expose import expose_action
from launch.utilities.type_utils import normalize_typed_substitution, perform_typed_substitution

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
    """Puts the nodes that follow into a namespace."""

    def __init__(self, namespace: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__namespace = normalize_to_list_of_substitutions(namespace)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<push_ros_namespace>`."""
        return parser.with_substitutions(cls, entity, {"namespace": "namespace"})

    @property
    def namespace(self) -> Any:
        """The namespace."""
        return self.__namespace

    def execute(self, context: Any) -> None:
        """Put them there."""
        pushed = perform_substitutions(context, self.__namespace)
        before = context.launch_configurations.get("ros_namespace")
        namespace = make_namespace_absolute(prefix_namespace(before, pushed))
        try:
            validate_namespace(namespace or "")
        except ValueError as error:
            raise SubstitutionFailure(f"{error} (pushed '{pushed}' onto '{before or ''}')") from error
        context.launch_configurations["ros_namespace"] = namespace


PushRosNamespace = PushROSNamespace


def _add_global(context: Any, items: Any) -> None:
    known = context.launch_configurations.get("global_params", [])
    known.extend(items)
    context.launch_configurations["global_params"] = known


@expose_action("set_parameter")
class SetParameter(Action):
    """Sets a parameter of the nodes that follow."""

    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__parameters = normalize_parameter_dict({tuple(normalize_to_list_of_substitutions(name)): value})

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<set_parameter>`."""
        _, kwargs = parser.with_substitutions(cls, entity, {"name": "name"})
        value = parser.parse_substitution(entity.get_attr("value"))
        kwargs["value"] = value
        return cls, kwargs

    @property
    def name(self) -> Any:
        """The name."""
        return next(iter(self.__parameters))

    @property
    def value(self) -> Any:
        """The value."""
        return next(iter(self.__parameters.values()))

    def execute(self, context: Any) -> None:
        """Set it."""
        _add_global(context, evaluate_parameter_dict(context, self.__parameters).items())


@expose_action("set_use_sim_time")
class SetUseSimTime(Action):
    """Lets the launch's own node, and with it `ROSTimer`, follow simulation time; other nodes get nothing of it."""

    def __init__(self, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__value = normalize_typed_substitution(value, bool)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<set_use_sim_time>`."""
        _, kwargs = parser.common(entity)
        kwargs["value"] = parser.parse_if_substitutions(entity.get_attr("value", data_type=bool))
        return cls, kwargs

    @property
    def value(self) -> Any:
        """Whether it follows simulation time."""
        return self.__value

    def execute(self, context: Any) -> None:
        """Set it."""
        if not perform_typed_substitution(context, self.__value, bool):
            raise RuntimeError("SetUseSimTime can only set the parameter use_sim_time to true")
        message = "SetUseSimTime is for the timers of the launch itself, and no node gets use_sim_time by it"
        context.session.warn(f"{message}; SetParameter('use_sim_time', True) would do that", self.source_line)


@expose_action("set_parameters_from_file")
class SetParametersFromFile(Action):
    """Gives the nodes that follow a file of parameters."""

    def __init__(self, filename: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__file = normalize_to_list_of_substitutions(filename)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<set_parameters_from_file>`."""
        return parser.with_substitutions(cls, entity, {"filename": "filename"})

    def execute(self, context: Any) -> None:
        """Give it; whether the file is there is looked at when a node starts."""
        _add_global(context, [perform_substitutions(context, self.__file)])


@expose_action("set_ros_log_dir")
class SetROSLogDir(Action):
    """Sets the folder of the log files of the nodes that follow."""

    def __init__(self, new_log_dir: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__log_dir = normalize_to_list_of_substitutions(new_log_dir)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<set_ros_log_dir>`."""
        return parser.with_substitutions(cls, entity, {"new_log_dir": "new_log_dir"})

    @property
    def log_dir(self) -> Any:
        """The folder."""
        return self.__log_dir

    def execute(self, context: Any) -> None:
        """Set it; a relative one lies in the present one."""
        before = context.environment.get("ROS_LOG_DIR") or str(Path.home() / ".ros" / "log")
        wanted = perform_substitutions(context, self.__log_dir)
        context.environment["ROS_LOG_DIR"] = os.path.join(before, wanted)  # noqa: PTH118 - keeps the text as it is


@expose_action("set_remap")
class SetRemap(Action):
    """Remaps a name in the nodes that follow."""

    def __init__(self, src: Any, dst: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__src = normalize_to_list_of_substitutions(src)
        self.__dst = normalize_to_list_of_substitutions(dst)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<set_remap>`."""
        return parser.with_substitutions(cls, entity, {"from": "src", "to": "dst"})

    @property
    def src(self) -> Any:
        """The name."""
        return self.__src

    @property
    def dst(self) -> Any:
        """What it becomes."""
        return self.__dst

    def execute(self, context: Any) -> None:
        """Remap it."""
        known = context.launch_configurations.get("ros_remaps", [])
        known.append((perform_substitutions(context, self.__src), perform_substitutions(context, self.__dst)))
        context.launch_configurations["ros_remaps"] = known


@expose_action("ros_timer")
class ROSTimer(TimerAction):
    """Visits entities after a time of the ROS clock."""


RosTimer = ROSTimer
