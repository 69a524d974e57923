"""Actions that start nodes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from launch._base import (
    Action,
    blame,
    ensure_argument_type,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch._catalogue import ELSEWHERE, parameter_text
from launch._installed import missing_data_file
from launch.actions import ExecuteProcess
from launch.frontend.expose import expose_action
from launch.substitutions import LocalSubstitution

from ..descriptions import ComposableNode
from ..parameter_descriptions import Parameter, ParameterFile, ParameterValue
from ..substitutions import ExecutableInPackage
from ..utilities import (
    evaluate_parameters,
    make_namespace_absolute,
    normalize_parameters,
    normalize_remap_rules,
    prefix_namespace,
    validate_namespace,
    validate_node_name,
)

_ROS_TYPES = {bool: "bool", int: "integer", float: "double", str: "string", bytes: "byte_array"}


def ros_type(value: Any) -> str:
    """The ROS type that a parameter of a value has."""
    if isinstance(value, (list, tuple)):
        return f"{_ROS_TYPES.get(type(value[0]), 'string')}_array" if value else "not_set"
    return _ROS_TYPES.get(type(value), type(value).__name__)


def plain_value(value: Any) -> Any:
    """A value as JSON and YAML can hold it."""
    if isinstance(value, (list, tuple)):
        return [plain_value(item) for item in value]
    if isinstance(value, Mapping):
        return {str(k): plain_value(v) for k, v in value.items()}
    if type(value) in (bool, int, float, str) or value is None:
        return value
    return list(value) if isinstance(value, bytes) else str(value)


def dumped(content: Any) -> str:
    """YAML text; what is no plain value gets a tag of Python's, which no node can read."""
    import yaml

    return str(yaml.dump(content, default_flow_style=False))


def read_from_command_line(value: Any) -> Any:
    """What a node makes of a value that is written behind `-p name:=`: quotes, and with them text, may be lost."""
    import yaml

    try:
        return parameter_text.read(str(value))
    except yaml.YAMLError:
        return str(value)


@expose_action("node")
class Node(ExecuteProcess):
    """Would start a node; notes it instead."""

    kind = "node"
    UNSPECIFIED_NODE_NAME = "<node_name_unspecified>"
    UNSPECIFIED_NODE_NAMESPACE = "<node_namespace_unspecified>"

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        # Python would complain of the missing 'executable', and not say what was given instead.
        other = next((name for name in ("node_executable", "exec", "type") if name in kwargs), None)
        if other is not None and "executable" not in kwargs:
            raise TypeError(f"{cls.__name__}() got an unexpected keyword argument '{other}'")
        return super().__new__(cls, *args, **kwargs)

    def __init__(
        self,
        *,
        executable: Any,
        package: Any = None,
        name: Any = None,
        namespace: Any = None,
        exec_name: Any = None,
        parameters: Any = None,
        remappings: Any = None,
        ros_arguments: Any = None,
        arguments: Any = None,
        **kwargs: Any,
    ) -> None:
        program = executable if package is None else ExecutableInPackage(package=package, executable=executable)
        self.__letters = isinstance(arguments, str) and len(arguments) > 1
        cmd: list[Any] = [program]
        cmd += [] if arguments is None else arguments
        cmd += [] if ros_arguments is None else ["--ros-args", *_as_list(ros_arguments)]
        self.__written_words = len(cmd)
        cmd += ["--ros-args"]
        if name is not None:
            cmd += ["-r", LocalSubstitution("ros_specific_arguments['name']", description="node name")]
        if parameters is not None:
            ensure_argument_type(parameters, list, "parameters", "Node")
        normal_parameters = [] if parameters is None else normalize_parameters(parameters)
        kwargs["name"] = exec_name
        super().__init__(cmd=cmd, **kwargs)
        self.__package = package
        self.__executable = executable
        self.__name = name
        self.__namespace = namespace
        self.__parameters = normal_parameters
        self.__remappings = [] if remappings is None else list(normalize_remap_rules(remappings))
        self.__expanded_name = self.UNSPECIFIED_NODE_NAME
        self.__expanded_namespace = self.UNSPECIFIED_NODE_NAMESPACE
        self.__final_name: str | None = None
        self.__expanded_remappings: list[tuple[str, str]] = []
        self.__planned_parameters: list[dict[str, Any]] = []
        self.__performed = False

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<node>`."""
        kwargs = cls.parse_process(entity, parser)
        for attribute, keyword in {"args": "arguments", "ros_args": "ros_arguments"}.items():
            line = entity.get_attr(attribute, optional=True)
            if line is not None:
                kwargs[keyword] = cls._parse_cmdline(line, parser)
        attributes = {"name": "name", "exec_name": "exec_name", "pkg": "package", "namespace": "namespace"}
        for attribute, keyword in attributes.items():
            value = entity.get_attr(attribute, optional=True)
            if value is not None:
                kwargs[keyword] = parser.parse_substitution(value)
        kwargs["executable"] = parser.parse_substitution(entity.get_attr("exec"))
        kwargs.update(cls.parse_ros(entity, parser))
        return cls, kwargs

    @classmethod
    def parse_ros(cls, entity: Any, parser: Any) -> dict[str, Any]:
        """What a node and a composable node have in common: `<remap>` and `<param>`."""
        kwargs: dict[str, Any] = {}
        remaps = entity.nested("remap")
        if remaps:
            kwargs["remappings"] = [
                (parser.parse_substitution(r.get_attr("from")), parser.parse_substitution(r.get_attr("to")))
                for r in remaps
            ]
        params = entity.nested("param")
        if params:
            kwargs["parameters"] = [_parse_param_at_its_line(param, parser) for param in params]
        for inner in [*remaps, *params]:
            inner.assert_entity_completely_parsed()
        return kwargs

    @property
    def node_package(self) -> Any:
        """The package."""
        return self.__package

    @property
    def node_executable(self) -> Any:
        """The executable."""
        return self.__executable

    @property
    def node_name(self) -> str:
        """The node's full name."""
        if self.__final_name is None:
            raise RuntimeError("the name of a node is known only once it is executed")
        return self.__final_name

    @property
    def expanded_node_namespace(self) -> str:
        """The namespace."""
        return self.__expanded_namespace

    @property
    def expanded_remapping_rules(self) -> list[tuple[str, str]]:
        """The remappings."""
        return self.__expanded_remappings

    def is_node_name_fully_specified(self) -> bool:
        """Whether name and namespace are both given."""
        unknown = (self.UNSPECIFIED_NODE_NAME, self.UNSPECIFIED_NODE_NAMESPACE)
        return all(word not in self.node_name for word in unknown)

    def _extend(self, *words: Any) -> None:
        self.process_description.cmd.extend(normalize_to_list_of_substitutions(word) for word in words)

    def _perform_substitutions(self, context: Any) -> None:
        if self.__performed:
            return
        self.__performed = True
        self._perform_name(context)
        self._add_global_parameters(context)
        self._add_parameters(context)
        self._add_remappings(context)

    def _perform_name(self, context: Any) -> None:
        if self.__name is not None:
            name = perform_substitutions(context, normalize_to_list_of_substitutions(self.__name))
            validate_node_name(name)
            self.__expanded_name = name
        given = None
        if self.__namespace is not None:
            given = perform_substitutions(context, normalize_to_list_of_substitutions(self.__namespace))
        base = context.launch_configurations.get("ros_namespace")
        namespace = make_namespace_absolute(prefix_namespace(base, given))
        if namespace is not None:
            validate_namespace(namespace)
            self.__expanded_namespace = namespace
            self._extend("-r", LocalSubstitution("ros_specific_arguments['ns']", description="namespace"))
        self.__final_name = prefix_namespace(self.__expanded_namespace, self.__expanded_name)

    def _add_global_parameters(self, context: Any) -> None:
        for item in context.launch_configurations.get("global_params") or []:
            if isinstance(item, tuple):
                name, value = item
                self._extend("-p", f"{name}:={value}")
                self._plan_value(name, read_from_command_line(value), wildcard=True)
                continue
            path = os.path.abspath(item)  # noqa: PTH100 - must not resolve links
            if not Path(path).is_file():
                raise FileNotFoundError(2, "no such file, which SetParametersFromFile gives this node", path)
            self._extend("--params-file", path)
            self._plan_file(context, Path(path))

    def _add_parameters(self, context: Any) -> None:
        for item in evaluate_parameters(context, self.__parameters):
            if isinstance(item, dict):
                key = self.node_name if self.is_node_name_fully_specified() else "/**"
                self._warn_of_strange_values(context, item)
                plain = {name: list(value) if isinstance(value, tuple) else value for name, value in item.items()}
                content = {key: {"ros__parameters": plain}}
                path = context.session.add_file(self._label(), ".yaml", dumped(content))
                self._extend("--params-file", path)
                for name, value in item.items():
                    self._plan_value(name, self._as_read(context, name, value))
            elif isinstance(item, Parameter):
                import yaml

                name, value = item.evaluate(context)
                self._extend("-p", f"{name}:={yaml.dump(value)}")
                self._plan_value(name, value, wildcard=True)
            else:
                self._add_file(context, *item)

    def _add_file(self, context: Any, path: Path, text: str | None) -> None:
        if text is not None:
            placeholder = context.session.add_file(path.stem, ".yaml", text)
            self._extend("--params-file", placeholder)
        elif not path.is_file():
            message = f"the parameter file '{path}' does not exist, so the node starts without it"
            if missing := missing_data_file(str(path), context.session.root):
                message = (
                    f"the parameter file '{missing[0]}' is not installed, so the node starts without it: "
                    f"add to {missing[1]}: {missing[2]}"
                )
            context.session.warn(message, self.source_line)
            return
        else:
            self._extend("--params-file", str(path))
        self._plan_file(context, path, text)

    def _warn_of_strange_values(self, context: Any, values: dict[str, Any]) -> None:
        context.session.warn_of_objects([v for v in values.values() if isinstance(v, str)], self.source_line)
        for name, value in values.items():
            kinds = {type(item) for item in (value if isinstance(value, (list, tuple)) else [value])}
            strange = [kind for kind in kinds if kind not in (bool, int, float, str, bytes)]
            if strange:
                kind = f"{strange[0].__module__}.{strange[0].__name__}"
                message = f"the value of the parameter '{name}' is a {kind}, which a node cannot read"
                context.session.warn(f"{message}, so it will not start; write float(...)", self.source_line)

    def _as_read(self, context: Any, name: str, value: Any) -> Any:
        """The value that reaches the node, with a warning where it is no text any more."""
        texts = [item for item in (value if isinstance(value, (list, tuple)) else [value]) if type(item) is str]
        lost = next((text for text in texts if type(parameter_text.as_read(text)) is not str), None)
        if lost is None:
            return value
        became = ros_type(parameter_text.as_read(lost))
        message = f"the text '{lost}' of the parameter '{name}' is written without quotes for the node"
        context.session.warn(f"{message}, which reads it as {became}", self.source_line)
        return parameter_text.as_read(value)

    def _plan_value(self, name: str, value: Any, *, wildcard: bool = False) -> None:
        planned = _planned(name, value)
        # What is on the command line is for any node of the process, as `/**` in a file is.
        self.__planned_parameters.append({**planned, **({"wildcard": True} if wildcard else {})})

    def _plan_file(self, context: Any, path: Path, text: str | None = None) -> None:
        content = None
        try:
            content = parameter_text.read(path.read_text() if text is None else text)
        except Exception as error:
            message = f"the parameter file '{path}' cannot be read, so the node will not start: {error}"
            context.session.warn(message, self.source_line)
        self.__planned_parameters.append({"file": str(path), "content": content})

    def _given_in(self, words: list[str], context: Any) -> list[dict[str, Any]]:
        """Parameters among the arguments that the launch file writes itself."""
        after, self.__planned_parameters = self.__planned_parameters, []
        for flag, word in pairwise(words[words.index("--ros-args") :] if "--ros-args" in words else []):
            name, is_rule, value = word.partition(":=")
            if flag in ("-p", "--param") and is_rule:
                self._plan_value(name, read_from_command_line(value), wildcard=True)
            elif flag == "--params-file":
                self._plan_file(context, Path(word))
        given, self.__planned_parameters = self.__planned_parameters, after
        return given

    def _label(self) -> str:
        return str(self.__name if isinstance(self.__name, str) else self.__expanded_name).strip("<>")

    def _add_remappings(self, context: Any) -> None:
        rules = list(context.launch_configurations.get("ros_remaps") or [])
        for source, target in self.__remappings:
            rules.append((perform_substitutions(context, source), perform_substitutions(context, target)))
        self.__expanded_remappings = rules
        for source, target in rules:
            self._extend("-r", f"{source}:={target}")

    def execute(self, context: Any) -> list[Any] | None:
        """Note the node."""
        self._perform_substitutions(context)
        if self.__letters:
            message = "arguments is one text, of which each letter becomes an argument: arguments=['...', '...']"
            context.session.warn(message, self.source_line)
        words = {"name": f"__node:={self.__expanded_name}", "ns": f"__ns:={self.__expanded_namespace}"}
        context.extend_locals({"ros_specific_arguments": words})
        result = super().execute(context)
        if context.session.processes and not context.is_shutdown:
            self._complete_plan(context, context.session.processes[-1])
        return result

    def _complete_plan(self, context: Any, plan: dict[str, Any]) -> None:
        normal = normalize_to_list_of_substitutions
        if self.__package is not None:
            package = plan["package"] = perform_substitutions(context, normal(self.__package))
            if plan["path"].startswith(f"{ELSEWHERE}/lib/{package}/") and not os.access(plan["path"], os.X_OK):
                plan["absent"] = f"the package '{package}' is not installed where this is evaluated"
        plan["executable"] = perform_substitutions(context, normal(self.__executable))
        plan["name"] = None if self.__name is None else self.__expanded_name
        known = self.__expanded_namespace != self.UNSPECIFIED_NODE_NAMESPACE
        plan["namespace"] = self.__expanded_namespace if known else None
        words = (self.process_description.final_cmd or [])[len(plan["prefix"]) :][1 : self.__written_words]
        plan["parameters"] = [*self._given_in(words, context), *self.__planned_parameters]
        plan["remappings"] = [list(rule) for rule in self.__expanded_remappings]
        plan["parameter_files"] = {
            name: text
            for name, text in context.session.parameter_files.items()
            if f"{{parameters}}/{name}" in plan["argv"]
        }
        full = self.node_name
        same = [p["id"] for p in context.session.processes[:-1] if p.get("_full_name") == full]
        plan["_full_name"] = full if self.is_node_name_fully_specified() else None
        if same and plan["_full_name"]:
            context.session.warn(f"two nodes have the name '{full}'", self.source_line)


def _as_list(given: Any) -> Any:
    if not isinstance(given, list):
        raise TypeError(f'can only concatenate list (not "{type(given).__name__}") to list')
    return given


_TYPE_NAMES: dict[str, Any] = {
    "int": int,
    "float": float,
    "bool": bool,
    "str": str,
    "list_of_int": "List[int]",
    "list_of_float": "List[float]",
    "list_of_bool": "List[bool]",
    "list_of_str": "List[str]",
    "yaml": None,
}


def _type_named(name: str | None) -> Any:
    if name is None:
        return None
    if name not in _TYPE_NAMES:
        raise ValueError(f"the type '{name}' is not one of {', '.join(_TYPE_NAMES)}")
    kind = _TYPE_NAMES[name]
    if isinstance(kind, str):
        from typing import List  # noqa: UP035

        return {"int": List[int], "float": List[float], "bool": List[bool], "str": List[str]}[name[8:]]  # noqa: UP006
    return kind


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
        raise RuntimeError("a <param> has either 'name' or 'from'")
    if source is None and allow is not None:
        raise RuntimeError("a <param> has 'allow_substs' only with 'from'")
    if source is not None:
        allow = parser.parse_substitution(allow) if isinstance(allow, str) else bool(allow)
        return ParameterFile(parser.parse_substitution(source), allow_substs=allow)
    if name is None:
        raise ValueError("a <param> needs 'name' or 'from'")
    return _named_param(param, parser)


def _named_param(param: Any, parser: Any) -> dict[Any, Any]:
    name = tuple(parser.parse_substitution(param.get_attr("name")))
    kind = _type_named(param.get_attr("type", optional=True))
    value = param.get_attr("value", data_type=kind, optional=True)
    inner = param.nested("param")
    if inner and (value is not None or kind is not None):
        raise RuntimeError("a <param> has either 'value' and 'type', or others inside")
    if value is not None:
        return {name: ParameterValue(parser.parse_if_substitutions(value), value_type=kind)}
    if not inner:
        raise RuntimeError("a <param> needs 'value' or others inside")
    content: dict[Any, Any] = {}
    for each in inner:
        content.update(_named_param(each, parser))
        each.assert_entity_completely_parsed()
    return {name: content}


def composable_plan(context: Any, node: ComposableNode) -> dict[str, Any]:
    """What a composable node adds to the plan."""

    def text(subs: Any) -> str | None:
        return None if subs is None else perform_substitutions(context, subs)

    base = context.launch_configurations.get("ros_namespace")
    rules = [list(rule) for rule in context.launch_configurations.get("ros_remaps") or []]
    return {
        "package": text(node.package),
        "plugin": text(node.node_plugin),
        "name": text(node.node_name),
        "namespace": make_namespace_absolute(prefix_namespace(base, text(node.node_namespace))),
        "parameters": _composable_parameters(context, node),
        "remappings": [*rules, *([text(a), text(b)] for a, b in node.remappings or [])],
        "source": node.source_line,
    }


def _composable_parameters(context: Any, node: ComposableNode) -> list[dict[str, Any]]:
    parameters: list[dict[str, Any]] = []
    for item in context.launch_configurations.get("global_params") or []:
        parameters.append(_planned(*item) if isinstance(item, tuple) else _planned_file(item))
    for item in evaluate_parameters(context, node.parameters or ()):
        if isinstance(item, dict):
            parameters += [_planned(name, value) for name, value in item.items()]
        elif isinstance(item, Parameter):
            parameters.append(_planned(*item.evaluate(context)))
        else:
            parameters.append(_planned_file(*item))
    return parameters


def _planned_file(path: Any, text: str | None = None) -> dict[str, Any]:
    """A file for a composable node, which `launch` itself reads while it asks for the node."""
    import yaml

    content = yaml.safe_load(Path(path).read_text() if text is None else text)
    return {"file": str(path), "content": plain_value(content)}


def _planned(name: str, value: Any) -> dict[str, Any]:
    return {"name": name, "value": plain_value(value), "type": ros_type(value)}


def _wanted(context: Any, nodes: Any) -> list[ComposableNode]:
    return [n for n in nodes or [] if n.condition() is None or n.condition().evaluate(context)]


@expose_action("node_container")
class ComposableNodeContainer(Node):
    """Would start a container of nodes; notes it instead."""

    kind = "container"

    def __init__(self, *, name: Any, namespace: Any, composable_node_descriptions: Any = None, **kwargs: Any) -> None:
        super().__init__(name=name, namespace=namespace, **kwargs)
        self.__nodes = composable_node_descriptions

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<node_container>`."""
        _, kwargs = super().parse(entity, parser)
        made = [ComposableNode.parse(inner, parser) for inner in entity.nested("composable_node")]
        kwargs["composable_node_descriptions"] = [cls_(**kw) for cls_, kw in made]
        return cls, kwargs

    def execute(self, context: Any) -> list[Any] | None:
        """Note the container."""
        super().execute(context)
        loaded = [composable_plan(context, node) for node in _wanted(context, self.__nodes)]
        if context.session.processes and not context.is_shutdown:
            context.session.processes[-1]["components"] = loaded
        return None


@expose_action("load_composable_node")
class LoadComposableNodes(Action):
    """Would load nodes into a running container; notes it instead."""

    def __init__(self, *, composable_node_descriptions: Any, target_container: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__composable_node_descriptions = composable_node_descriptions
        self.__target_container = target_container

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<load_composable_node>`."""
        _, kwargs = parser.common(entity)
        kwargs["target_container"] = parser.parse_substitution(entity.get_attr("target"))
        made = [ComposableNode.parse(inner, parser) for inner in entity.nested("composable_node")]
        kwargs["composable_node_descriptions"] = [cls_(**kw) for cls_, kw in made]
        return cls, kwargs

    def execute(self, context: Any) -> None:
        """Note the nodes."""
        if isinstance(self.__target_container, ComposableNodeContainer):
            target = self.__target_container.node_name
        else:
            target = perform_substitutions(context, normalize_to_list_of_substitutions(self.__target_container))
        loaded = [composable_plan(context, node) for node in _wanted(context, self.__composable_node_descriptions)]
        session = context.session
        session.components.append({"container": target, "when": session.when, "components": loaded})
