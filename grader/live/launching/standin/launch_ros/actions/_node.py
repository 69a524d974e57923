"""Actions that start nodes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from launch._base import (
    Action,
    Field,
    Text,
    blame,
    ensure_argument_type,
    expose_action,
    mistake,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch.actions import ExecuteProcess
from launch.substitutions import LocalSubstitution

from ..descriptions import ComposableNode
from ..parameter_descriptions import Parameter, ParameterFile, ParameterValue
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


class _Words(Field):
    """Arguments of a program; in XML and YAML a command line."""

    def read(self, value: Any, parser: Any) -> Any:
        return ExecuteProcess.parse_words(value, parser)


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
    parameters = Field(None, types=(list, type(None)), remedy="Put the parameters into a list: parameters=[{...}].")
    remappings = Field(None)
    ros_arguments = _Words(None, attribute="ros_args")
    arguments = _Words(None, attribute="args")

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

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        made, kwargs = super().parse(entity, parser)
        return made, {**kwargs, **parse_ros(entity, parser)}

    @property
    def node_name(self) -> str:
        """The node's full name."""
        if self.__final_name is None:
            raise RuntimeError("the name of a node is known only once it is executed")
        return self.__final_name

    def is_node_name_fully_specified(self) -> bool:
        """Whether name and namespace are both given."""
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
                path = context.session.add_file(self.__expanded_name.strip("<>"), ".yaml", text, of_node=True)
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


def parse_ros(entity: Any, parser: Any) -> dict[str, Any]:
    """What a node and a composable node have in common: `<remap>` and `<param>`."""
    kwargs: dict[str, Any] = {}
    remaps, params = entity.nested("remap"), entity.nested("param")
    if remaps:
        kwargs["remappings"] = [
            (parser.parse_substitution(r.get_attr("from")), parser.parse_substitution(r.get_attr("to"))) for r in remaps
        ]
    if params:
        kwargs["parameters"] = [_parse_param_at_its_line(param, parser) for param in params]
    for inner in [*remaps, *params]:
        inner.assert_entity_completely_parsed()
    return kwargs


_TYPE_NAMES = ("int", "float", "bool", "str", "list_of_int", "list_of_float", "list_of_bool", "list_of_str", "yaml")


def _bad(message: str, remedy: str = "Correct this element of the file.") -> Any:
    return mistake(RuntimeError, message, "bad_markup", remedy)


def _type_named(name: str | None) -> Any:
    from typing import List  # noqa: UP035

    if name is None or name == "yaml":
        return None
    if name not in _TYPE_NAMES:
        raise _bad(f"the type '{name}' is not one of {', '.join(_TYPE_NAMES)}", "Use one of the types.")
    scalar = {"int": int, "float": float, "bool": bool, "str": str}[name.removeprefix("list_of_")]
    return List[scalar] if name.startswith("list_of_") else scalar  # type: ignore[valid-type]  # noqa: UP006


def _parse_param_at_its_line(param: Any, parser: Any) -> Any:
    try:
        return _parse_param(param, parser)
    except Exception as error:
        blame(error, param)
        raise


def _parse_param(param: Any, parser: Any) -> Any:
    source = param.get_attr("from", optional=True)
    name = param.get_attr("name", optional=True)
    allow = param.get_attr("allow_substs", data_type=bool, optional=True)
    if source is not None and name is not None:
        raise _bad("a <param> has either 'name' or 'from'")
    if source is None and allow is not None:
        raise _bad("a <param> has 'allow_substs' only with 'from'")
    if source is not None:
        allow = parser.parse_substitution(allow) if isinstance(allow, str) else bool(allow)
        return ParameterFile(parser.parse_substitution(source), allow_substs=allow)
    if name is None:
        raise _bad("a <param> needs 'name' or 'from'")
    return _named_param(param, parser)


def _named_param(param: Any, parser: Any) -> dict[Any, Any]:
    name = tuple(parser.parse_substitution(param.get_attr("name")))
    type_name = param.get_attr("type", optional=True)
    kind = _type_named(type_name)
    value = param.get_attr("value", data_type=kind, optional=True)
    inner = param.nested("param")
    if inner and (value is not None or kind is not None):
        raise _bad("a <param> has either 'value' and 'type', or others inside")
    if value is not None:
        return {name: ParameterValue(parser.parse_if_substitutions(value), value_type=kind)}
    if not inner:
        raise _bad("a <param> needs 'value' or others inside")
    content: dict[Any, Any] = {}
    for each in inner:
        content.update(_named_param(each, parser))
        each.assert_entity_completely_parsed()
    return {name: content}


def _composable_nodes(entity: Any, parser: Any) -> list[ComposableNode]:
    """The nodes of `<composable_node>` inside an element."""
    return [
        made(**kwargs) for made, kwargs in (ComposableNode.parse(e, parser) for e in entity.nested("composable_node"))
    ]


@expose_action("node_container")
class ComposableNodeContainer(Node):
    """Would start a container of nodes; notes it instead."""

    name = Text(attribute="name")
    namespace = Text(attribute="namespace")
    composable_node_descriptions = Field(None)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        made, kwargs = super().parse(entity, parser)
        return made, {**kwargs, "composable_node_descriptions": _composable_nodes(entity, parser)}

    def execute(self, context: Any) -> Any:
        super().execute(context)
        nodes = self.composable_node_descriptions
        return [LoadComposableNodes(composable_node_descriptions=nodes, target_container=self)] if nodes else None


@expose_action("load_composable_node")
class LoadComposableNodes(Action):
    """Would load nodes into a running container; notes it instead."""

    performs = "load"

    composable_node_descriptions = Field()
    target_container = Field(attribute="target")

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        made, kwargs = super().parse(entity, parser)
        return made, {**kwargs, "composable_node_descriptions": _composable_nodes(entity, parser)}

    def made(self) -> None:
        target = self.target_container
        if not isinstance(target, ComposableNodeContainer):
            ensure_argument_type(target, (str, Path, Action, *_TEXTS), "target_container", "LoadComposableNodes")


_TEXTS = (list, tuple, type(normalize_to_list_of_substitutions("")[0]).__mro__[1])
