"""Actions for ROS nodes: starts, transitions of lifecycle nodes, and settings for later nodes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import (
    POSITIONAL,
    Action,
    Field,
    Substitution,
    SubstitutionFailure,
    Text,
    Texts,
    Typed,
    ensure_argument_type,
    expose_action,
    normalize_to_list_of_substitutions,
    perform_substitutions,
    read_element,
)
from launch._words import parse_words
from launch.actions import EmitEvent, ExecuteProcess, RegisterEventHandler, TimerAction
from launch.substitutions import LocalSubstitution

from launch_plan.inside.executor import TRANSITIONS as _TRANSITIONS
from launch_plan.inside.problems import mistake

from ..descriptions import ComposableNode
from ..event_handlers import OnStateTransition
from ..events import matches_node_name
from ..events.lifecycle import ChangeState, StateTransition
from ..parameter_descriptions import Parameter, read_parameters, read_remappings
from ..substitutions import ExecutableInPackage
from ..utilities import (
    add_node_name,
    evaluate_parameter_dict,
    evaluate_parameters,
    make_namespace_absolute,
    normalize_parameter_dict,
    normalize_parameters,
    normalize_remap_rules,
    prefix_namespace,
    validate_namespace,
    validate_node_name,
)


@expose_action("node")
class Node(ExecuteProcess):
    """A node, to be noted instead of started."""

    UNSPECIFIED_NODE_NAME = "<node_name_unspecified>"
    UNSPECIFIED_NODE_NAMESPACE = "<node_namespace_unspecified>"

    cmd = None
    executable = Text(attribute="exec")
    package = Text(None, attribute="pkg")
    name = Text(None, attribute="name")
    namespace = Text(None, attribute="namespace")
    exec_name = Text(None, attribute="exec_name")
    parameters = Field(
        None,
        types=(list, type(None)),
        remedy="Put the parameters into a list: parameters=[{...}].",
        nested=read_parameters,
    )
    remappings = Field(None, nested=read_remappings)
    ros_arguments = Field(None, attribute="ros_args", read=parse_words)
    arguments = Field(None, attribute="args", read=parse_words)

    node_package = property(lambda self: self.package)
    node_executable = property(lambda self: self.executable)

    def made(self) -> None:
        program: Any = self.executable
        if self.package is not None:
            program = [ExecutableInPackage(package=self.package, executable=self.executable)]
        words: list[Any] = [program]
        if self.arguments is not None:
            words += self.arguments
        if self.ros_arguments is not None:
            words += ["--ros-args", *self._listed_ros_arguments()]
        words += ["--ros-args"]
        if self.name is not None:
            words += ["-r", LocalSubstitution("ros_specific_arguments['name']", "node name")]
        self.describe_program(words, self.exec_name)
        self.__parameters = normalize_parameters(self.parameters or [])
        self.__remappings = list(normalize_remap_rules(self.remappings or ()))
        self.__expanded_name = self.UNSPECIFIED_NODE_NAME
        self.expanded_node_namespace = self.UNSPECIFIED_NODE_NAMESPACE
        self.expanded_remapping_rules: list[tuple[str, str]] = []
        self.__final_name: str | None = None
        self.__performed = False

    def _listed_ros_arguments(self) -> list[Any]:
        if isinstance(self.ros_arguments, list):
            return self.ros_arguments
        kind = type(self.ros_arguments).__name__
        message = f'can only concatenate list (not "{kind}") to list'
        raise mistake(TypeError, message, "not_a_list", "Make it a list, even of one item.")

    @property
    def node_name(self) -> str:
        if self.__final_name is None:
            raise RuntimeError("the name of a node is known only once it is executed")
        return self.__final_name

    def is_node_name_fully_specified(self) -> bool:
        unknown = (self.UNSPECIFIED_NODE_NAME, self.UNSPECIFIED_NODE_NAMESPACE)
        return all(word not in self.node_name for word in unknown)

    def _extend(self, *words: Any) -> None:
        description: Any = self.process_description
        description.cmd.extend(normalize_to_list_of_substitutions(word) for word in words)

    def _perform_substitutions(self, context: Any) -> None:
        if self.__performed:
            return
        self.__performed = True
        self._perform_name(context)
        self._add_global_parameters(context)
        self._add_parameters(context)
        self._add_remappings(context)

    def _perform_name(self, context: Any) -> None:
        if self.name is not None:
            name = self.text("name", context)
            validate_node_name(name)
            self.__expanded_name = name
        given = None if self.namespace is None else self.text("namespace", context)
        base = context.launch_configurations.get("ros_namespace")
        namespace = make_namespace_absolute(prefix_namespace(base, given))
        if namespace is not None:
            validate_namespace(namespace)
            self.expanded_node_namespace = namespace
            self._extend("-r", LocalSubstitution("ros_specific_arguments['ns']", "namespace"))
        self.__final_name = prefix_namespace(self.expanded_node_namespace, self.__expanded_name)

    def _add_global_parameters(self, context: Any) -> None:
        for item in context.launch_configurations.get("global_params") or []:
            if isinstance(item, tuple):
                self._extend("-p", f"{item[0]}:={item[1]}")
                continue
            path = os.path.abspath(item)  # noqa: PTH100 - must not resolve links
            if not Path(path).is_file():
                message = "no such file, which SetParametersFromFile gives this node"
                raise FileNotFoundError(2, message, path)
            self._extend("--params-file", path)

    def _add_parameters(self, context: Any) -> None:
        import yaml

        for item in evaluate_parameters(context, self.__parameters):
            if isinstance(item, dict):
                self._extend("--params-file", self._file_of(item, context))
            elif isinstance(item, Parameter):
                name, value = item.evaluate(context)
                self._extend("-p", f"{name}:={yaml.dump(value)}")
            elif not str(item).startswith("{parameters}/") and not item.is_file():
                context.session.warn_of_missing_file(str(item), self)
            else:
                self._extend("--params-file", str(item))

    def _file_of(self, values: dict[str, Any], context: Any) -> str:
        """Add a file with values for this node to the plan, and return its path."""
        import yaml

        key = self.node_name if self.is_node_name_fully_specified() else "/**"
        plain: dict[str, Any] = {}
        for name, value in values.items():
            plain[name] = list(value) if isinstance(value, tuple) else value
        text = yaml.dump({key: {"ros__parameters": plain}}, default_flow_style=False)
        label = self.__expanded_name.strip("<>")
        path: str = context.session.files.add(label, ".yaml", text, of_node=True)
        return path

    def _add_remappings(self, context: Any) -> None:
        rules = list(context.launch_configurations.get("ros_remaps") or [])
        for source, target in self.__remappings:
            resolved = perform_substitutions(context, source)
            rules.append((resolved, perform_substitutions(context, target)))
        self.expanded_remapping_rules = rules
        for source, target in rules:
            self._extend("-r", f"{source}:={target}")

    def execute(self, context: Any) -> Any:
        self._perform_substitutions(context)
        if isinstance(self.arguments, str) and len(self.arguments) > 1:
            message = "arguments is one text, of which each letter becomes an argument: arguments=['...', '...']"
            context.session.warn(message, self)
        words = {
            "name": f"__node:={self.__expanded_name}",
            "ns": f"__ns:={self.expanded_node_namespace}",
        }
        context.extend_locals({"ros_specific_arguments": words})
        found = super().execute(context)
        if self.is_node_name_fully_specified():
            add_node_name(context, self.node_name)
        return found


def _composable_nodes(entity: Any, parser: Any) -> list[ComposableNode]:
    """Return the nodes of the elements `<composable_node>` inside an element."""

    def read(node: Any) -> ComposableNode:
        return ComposableNode(**read_element(ComposableNode, node, parser))

    nodes: list[ComposableNode] = entity.each("composable_node", read)
    return nodes


@expose_action("node_container")
class ComposableNodeContainer(Node):
    """A container of nodes, to be noted instead of started."""

    name = Text(attribute="name")
    namespace = Text(attribute="namespace")
    composable_node_descriptions = Field(None, nested=_composable_nodes)

    def execute(self, context: Any) -> Any:
        super().execute(context)
        nodes = self.composable_node_descriptions
        if not nodes:
            return None
        return [LoadComposableNodes(composable_node_descriptions=nodes, target_container=self)]


def _nodes_to_load(entity: Any, parser: Any) -> list[ComposableNode] | None:
    """Return the nodes of an element that must have some."""
    return _composable_nodes(entity, parser) or entity.get_attr("composable_node")


@expose_action("load_composable_node")
class LoadComposableNodes(Action):
    """Nodes to be noted instead of loaded into a running container."""

    performs = "load"

    composable_node_descriptions = Field(nested=_nodes_to_load)
    target_container = Field(attribute="target", read=Text.reading)

    def made(self) -> None:
        target = self.target_container
        if not isinstance(target, ComposableNodeContainer):
            types = (str, Path, Action, list, tuple, Substitution)
            ensure_argument_type(target, types, "target_container", "LoadComposableNodes")


# -- lifecycle nodes, with each change of state played as a success --------------------------------


def _normal_ids(ids: Any) -> Any:
    """Return ids of transitions as texts."""
    texts = [str(item) if isinstance(item, int) else item for item in ids]
    return Texts.normalized(texts)


@expose_action("lifecycle_node")
class LifecycleNode(Node):
    """A lifecycle node, to be noted instead of started."""

    is_lifecycle_node = True
    name = Text(attribute="name")
    namespace = Text(attribute="namespace")
    autostart = Field(False, attribute="autostart", kind=bool)
    node_autostart = property(lambda self: self.autostart)

    def execute(self, context: Any) -> Any:
        return context.session.start_lifecycle(self, context)


class LifecycleTransition(Action):
    """Transitions of lifecycle nodes, one after the other."""

    lifecycle_node_names = Texts()
    transition_ids = Texts(normal=_normal_ids)

    def made(self) -> None:
        if not self.transition_ids or not self.lifecycle_node_names:
            message = "LifecycleTransition needs at least one node name and one transition id"
            raise ValueError(message)

    def execute(self, context: Any) -> list[Any]:
        names = [perform_substitutions(context, name) for name in self.lifecycle_node_names]
        ids = [int(perform_substitutions(context, given)) for given in self.transition_ids]
        handlers: list[Any] = []
        first: list[Any] = []
        for name in names:
            asked = [self._ask(name, number) for number in ids]
            first.append(asked[0])
            for number, following in zip(ids, asked[1:], strict=False):
                handlers.append(_after(name, number, following))
        return [*handlers, *first]

    def _ask(self, name: str, number: int) -> EmitEvent:
        event = ChangeState(lifecycle_node_matcher=matches_node_name(name), transition_id=number)
        event.source_line = self.source_line
        return EmitEvent(event=event)


def _after(name: str, number: int, following: Any) -> RegisterEventHandler:
    _, _, meanwhile, after = _TRANSITIONS[number]
    is_node = matches_node_name(name)

    def matches(event: Any) -> bool:
        if not isinstance(event, StateTransition) or not is_node(event.action):
            return False
        return (event.start_state, event.goal_state) == (meanwhile, after)

    handler = OnStateTransition(matcher=matches, entities=[following], handle_once=True)
    return RegisterEventHandler(handler)


# -- settings for the later nodes of the scope -----------------------------------------------------


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
            remedy = error.__dict__["launch_remedy"]
            raise mistake(SubstitutionFailure, message, "bad_name", remedy) from error
        context.launch_configurations["ros_namespace"] = namespace


PushRosNamespace = PushROSNamespace


def _add(context: Any, kept: str, items: Any) -> None:
    """Add items to a list among the launch configurations, for the later nodes of the scope."""
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
    """Simulation time for the node of `launch` itself, and so for `ROSTimer`; without effect on other nodes."""

    performs = "follow_sim_time"

    value = Typed(positional=POSITIONAL, attribute="value", kind=bool)


@expose_action("set_parameters_from_file")
class SetParametersFromFile(Action):
    """A parameter file for later nodes; the start of a node fails if the file is missing."""

    filename = Text(positional=POSITIONAL, attribute="filename")

    def execute(self, context: Any) -> None:
        _add(context, "global_params", [self.text("filename", context)])


@expose_action("set_ros_log_dir")
class SetROSLogDir(Action):
    """Folder for the log files of later nodes; a relative path is below the present folder."""

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
    """A timer of the ROS clock."""


RosTimer = ROSTimer
