"""Actions that start nodes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import (
    Action,
    Field,
    Substitution,
    Text,
    ensure_argument_type,
    expose_action,
    mistake,
    normalize_to_list_of_substitutions,
    perform_substitutions,
    read_element,
)
from launch.actions import ExecuteProcess, parse_words
from launch.substitutions import LocalSubstitution

from .._markup import read_parameters, read_remappings
from ..descriptions import ComposableNode
from ..parameter_descriptions import Parameter
from ..substitutions import ExecutableInPackage
from ..utilities import (
    add_node_name,
    evaluate_parameters,
    make_namespace_absolute,
    normalize_parameters,
    normalize_remap_rules,
    prefix_namespace,
    validate_namespace,
    validate_node_name,
)


@expose_action("node")
class Node(ExecuteProcess):
    """Would start a node; notes it instead."""

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
        words += [] if self.arguments is None else self.arguments
        if self.ros_arguments is not None:
            if not isinstance(self.ros_arguments, list):
                kind = type(self.ros_arguments).__name__
                message = f'can only concatenate list (not "{kind}") to list'
                raise mistake(TypeError, message, "not_a_list", "Make it a list, even of one item.")
            words += ["--ros-args", *self.ros_arguments]
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
                raise FileNotFoundError(2, "no such file, which SetParametersFromFile gives this node", path)
            self._extend("--params-file", path)

    def _add_parameters(self, context: Any) -> None:
        import yaml

        for item in evaluate_parameters(context, self.__parameters):
            if isinstance(item, dict):
                key = self.node_name if self.is_node_name_fully_specified() else "/**"
                plain = {name: list(value) if isinstance(value, tuple) else value for name, value in item.items()}
                text = yaml.dump({key: {"ros__parameters": plain}}, default_flow_style=False)
                path = context.session.files.add(self.__expanded_name.strip("<>"), ".yaml", text, of_node=True)
                self._extend("--params-file", path)
            elif isinstance(item, Parameter):
                name, value = item.evaluate(context)
                self._extend("-p", f"{name}:={yaml.dump(value)}")
            elif not str(item).startswith("{parameters}/") and not item.is_file():
                context.session.warn_of_missing_file(str(item), self)
            else:
                self._extend("--params-file", str(item))

    def _add_remappings(self, context: Any) -> None:
        rules = list(context.launch_configurations.get("ros_remaps") or [])
        for source, target in self.__remappings:
            rules.append((perform_substitutions(context, source), perform_substitutions(context, target)))
        self.expanded_remapping_rules = rules
        for source, target in rules:
            self._extend("-r", f"{source}:={target}")

    def execute(self, context: Any) -> Any:
        self._perform_substitutions(context)
        if isinstance(self.arguments, str) and len(self.arguments) > 1:
            message = "arguments is one text, of which each letter becomes an argument: arguments=['...', '...']"
            context.session.warn(message, self)
        words = {"name": f"__node:={self.__expanded_name}", "ns": f"__ns:={self.expanded_node_namespace}"}
        context.extend_locals({"ros_specific_arguments": words})
        found = super().execute(context)
        if self.is_node_name_fully_specified():
            add_node_name(context, self.node_name)
        return found


def _composable_nodes(entity: Any, parser: Any) -> list[ComposableNode]:
    """The nodes of `<composable_node>` inside an element."""
    found = []
    for node in entity.nested("composable_node"):
        found.append(ComposableNode(**read_element(ComposableNode, node, parser)))
        node.assert_entity_completely_parsed()
    return found


@expose_action("node_container")
class ComposableNodeContainer(Node):
    """Would start a container of nodes; notes it instead."""

    name = Text(attribute="name")
    namespace = Text(attribute="namespace")
    composable_node_descriptions = Field(None, nested=_composable_nodes)

    def execute(self, context: Any) -> Any:
        super().execute(context)
        nodes = self.composable_node_descriptions
        return [LoadComposableNodes(composable_node_descriptions=nodes, target_container=self)] if nodes else None


@expose_action("load_composable_node")
class LoadComposableNodes(Action):
    """Would load nodes into a running container; notes it instead."""

    performs = "load"

    composable_node_descriptions = Field(nested=_composable_nodes)
    target_container = Field(attribute="target")

    def made(self) -> None:
        target = self.target_container
        if not isinstance(target, ComposableNodeContainer):
            ensure_argument_type(
                target, (str, Path, Action, list, tuple, Substitution), "target_container", "LoadComposableNodes"
            )
