"""What a process of a launch file is given: its command line, its surroundings, and the parameters of a node."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from launch_plan.inside import parameter_text
from launch_plan.inside.installed import ELSEWHERE
from launch_plan.inside.problems import SUBSTITUTION_AS_TEXT, relative

_ROS_TYPES = {bool: "bool", int: "integer", float: "double", str: "string", bytes: "byte_array"}


def private(action: Any, owner: str, name: str, default: Any = None) -> Any:
    """What an action was given and does not show: in the stand-in a field, in the original a private attribute."""
    given: dict[str, Any] | None = getattr(action, "given", None)
    if given is not None and name in given:
        return given[name]
    return getattr(action, f"_{owner}__{name}", default)


def text_of(subs: Any, context: Any) -> str:
    """A list of substitutions, or what can become one, resolved."""
    from launch.utilities import normalize_to_list_of_substitutions, perform_substitutions

    return str(perform_substitutions(context, normalize_to_list_of_substitutions(subs)))


class Describer:
    """Describes the processes of a plan, and warns of what would not go as it is meant."""

    def __init__(self, executor: Any) -> None:
        self._plan, self._warn, self._files = executor, executor.warn, executor.files

    def process(self, action: Any, context: Any) -> dict[str, Any]:
        """The entry of a process, which its action has prepared."""
        description, details = action.process_description, action.process_details
        words = [str(word) for word in details["cmd"]]
        before, after = (
            self._plan.initial_environment,
            {str(k): str(v) for k, v in (details["env"] or {}).items()},
        )
        replaces = description.env is not None
        prefixed = len(words) - len(description.cmd)
        path, argv = words[prefixed], words[prefixed + 1 :]
        self._warn_of_objects([*words, *after.values()], action)
        if not action.shell:
            found = shutil.which(path, path=context.environment.get("PATH"))
            if found is None and not path.startswith(f"{ELSEWHERE}/"):
                self._warn(f"the program '{path}' is not found, so it cannot start", action)
            path = found or path
        return {
            "id": str(details["name"]),
            "kind": "executable",
            "package": None,
            "executable": os.path.basename(words[prefixed]),  # noqa: PTH119 - keeps a trailing slash
            "name": None,
            "namespace": None,
            "prefix": words[:prefixed],
            "path": path,
            "argv": argv,
            "env": {
                name: value
                for name, value in after.items()
                if replaces or before.get(name) != value
            },
            "env_unset": [] if replaces else sorted(set(before) - set(after)),
            "env_replaces": replaces,
            "cwd": None if details["cwd"] is None else os.path.abspath(details["cwd"]),  # noqa: PTH100
            "parameters": [],
            "remappings": [],
            "output": self._output(action, context),
            "respawn": bool(private(action, "ExecuteLocal", "respawn")),
            "respawn_delay_s": self._number(action, "respawn_delay", 0.0),
            "respawn_max_retries": self._number(action, "respawn_max_retries", -1),
            "emulate_tty": bool(action.emulate_tty),
            "shell": bool(action.shell),
            "sigterm_timeout_s": self._seconds(action, "sigterm_timeout", context),
            "sigkill_timeout_s": self._seconds(action, "sigkill_timeout", context),
            "absent": "",
            **self._node(action, [path, *argv], context),
        }

    def _number(self, action: Any, name: str, default: float) -> float:
        """A number that is not looked at before the process ended."""
        value = private(action, "ExecuteLocal", name)
        if value is None or isinstance(value, (int, float)):
            return value or default
        message = f"{name} must be a number, but it is of type '{type(value).__name__}'"
        self._warn(f"{message}; the launch fails when it would start the process again", action)
        return default

    def _seconds(self, action: Any, name: str, context: Any) -> float:
        """A time that is not resolved before the launch ends."""
        try:
            return float(text_of(getattr(action, name), context))
        except Exception as error:
            self._warn(f"{name} fails when the launch ends: {error}", action)
            return 5.0

    def _output(self, action: Any, context: Any) -> Any:
        """Where the output goes, which `launch` itself checks; where it would log is no matter here."""
        from launch.logging import get_output_loggers

        chosen = (
            action.output if isinstance(action.output, dict) else text_of(action.output, context)
        )
        try:
            get_output_loggers(action.process_details["name"], chosen)
        except OSError:
            return chosen
        if isinstance(chosen, str):
            return chosen
        return {
            stream: [words] if isinstance(words, str) else sorted(words)
            for stream, words in chosen.items()
        }

    def _node(self, action: Any, words: list[str], context: Any) -> dict[str, Any]:
        """What a node has besides: its names, and the parameters and rules that stand on its command line."""
        from launch_ros.actions import ComposableNodeContainer, LifecycleNode, Node

        if not isinstance(action, Node):
            return {}
        kinds = {LifecycleNode: "lifecycle_node", ComposableNodeContainer: "container"}
        namespace, _, name = action.node_name.rpartition("/")
        known = action.expanded_node_namespace != Node.UNSPECIFIED_NODE_NAMESPACE
        named = name != Node.UNSPECIFIED_NODE_NAME
        package = None if action.node_package is None else text_of(action.node_package, context)
        node: dict[str, Any] = {
            "kind": next((kind for cls, kind in kinds.items() if isinstance(action, cls)), "node"),
            "package": package,
            "executable": text_of(action.node_executable, context),
            "name": name if named else None,
            "namespace": action.expanded_node_namespace if known else None,
            "parameters": self._parameters(words, name, action),
            "remappings": [list(rule) for rule in action.expanded_remapping_rules or []],
            "parameter_files": {
                n: t for n, t in self._files.texts.items() if f"{{parameters}}/{n}" in words
            },
        }
        if words[0].startswith(f"{ELSEWHERE}/lib/{package}/") and not os.access(words[0], os.X_OK):
            node["absent"] = f"the package '{package}' is not installed where this is evaluated"
        before = [(p["name"], p["namespace"]) for p in self._plan.found["processes"]]
        if known and named and (node["name"], node["namespace"]) in before:
            self._warn(f"two nodes have the name '{namespace.rstrip('/')}/{name}'", action)
        return node

    def _parameters(self, words: list[str], label: str, action: Any) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        ros_words = words[words.index("--ros-args") :]
        for flag, word in pairwise(ros_words):
            name, is_rule, value = word.partition(":=")
            if flag in ("-p", "--param") and is_rule:
                # What is on the command line is for any node of the process, as `/**` in a file is.
                found.append({**_parameter(name, _read_or_text(value)), "wildcard": True})
            elif flag == "--params-file":
                found += self._file_of_parameters(word, label, action)
        return found

    def _file_of_parameters(self, path: str, label: str, action: Any) -> list[dict[str, Any]]:
        """A file as one entry, or an entry for each value if `launch_ros` has written it."""
        of_node = path in self._files.of_nodes or Path(path).name.startswith("launch_params_")
        try:
            text = self._files.text_of(path)
            content = parameter_text.read(text)
        except Exception as error:
            message = (
                f"the parameter file '{path}' cannot be read, so the node will not start: {error}"
            )
            self._warn(message, action)
            return [{"file": path, "content": None}]
        self._files.labels[path] = label.strip("<>")
        self._warn_of_lost_texts(text, content, action)
        own = isinstance(content, Mapping) and set(content) <= {"/**", action.node_name}
        values = _only_section(content) if of_node and own else None
        if values is None:
            return [{"file": path, "content": content}]
        return [_parameter(name, value) for name, value in values.items()]

    def _warn_of_lost_texts(self, text: str, content: Any, action: Any) -> None:
        """Warn of texts that PyYAML wrote without quotes, and that the node reads as something else."""
        import yaml

        if "!!python/" in text:
            kind = (
                text.partition("!!python/")[2].split()[0].partition(":")[2].removesuffix(".scalar")
            )
            message = f"the value of a parameter is a {kind}, which a node cannot read, so it will not start"
            self._warn(f"{message}; write float(...)", action)
            return
        written, read = _only_section(yaml.safe_load(text)) or {}, _only_section(content) or {}
        self._warn_of_objects(
            [value for value in written.values() if isinstance(value, str)], action
        )
        for name, given in written.items():
            for item, became in zip(_listed(given), _listed(read.get(name)), strict=False):
                if isinstance(item, str) and not isinstance(became, str):
                    message = f"the text '{item}' of the parameter '{name}' is written without quotes for the node"
                    self._warn(f"{message}, which reads it as {ros_type(became)}", action)

    def component(self, node: Any, context: Any) -> dict[str, Any]:
        """The entry of a node that is loaded into a container."""
        from launch_ros.utilities import make_namespace_absolute, prefix_namespace

        def text(subs: Any) -> str | None:
            return None if subs is None else text_of(subs, context)

        base = context.launch_configurations.get("ros_namespace")
        rules = [list(rule) for rule in context.launch_configurations.get("ros_remaps") or []]
        file, line = getattr(node, "source_line", None) or (None, None)
        return {
            "package": text(node.package),
            "plugin": text(node.node_plugin),
            "name": text(node.node_name),
            "namespace": make_namespace_absolute(prefix_namespace(base, text(node.node_namespace))),
            "parameters": self._parameters_of_component(node, context),
            "remappings": [*rules, *([text(a), text(b)] for a, b in node.remappings or [])],
            "file": None if file is None else relative(file, self._plan.root),
            "line": line,
        }

    def _parameters_of_component(self, node: Any, context: Any) -> list[dict[str, Any]]:
        """What `launch` sends to the container: it reads files itself."""
        import yaml
        from launch_ros.descriptions import Parameter
        from launch_ros.utilities import evaluate_parameters

        found: list[dict[str, Any]] = []
        shared = context.launch_configurations.get("global_params") or []
        for item in [*shared, *evaluate_parameters(context, node.parameters or ())]:
            if isinstance(item, tuple):
                found.append(_parameter(*item))
            elif isinstance(item, Mapping):
                found += [_parameter(name, value) for name, value in item.items()]
            elif isinstance(item, Parameter):
                found.append(_parameter(*item.evaluate(context)))
            else:
                found.append(
                    {"file": str(item), "content": yaml.safe_load(self._files.text_of(str(item)))}
                )
        return found

    def _warn_of_objects(self, texts: Iterable[str], source: Any) -> None:
        if any(SUBSTITUTION_AS_TEXT.search(text) for text in texts):
            message = "str() or an f-string made text of a substitution before it has a value"
            self._warn(
                f"{message}; write a list instead: ['text', LaunchConfiguration(...)]", source
            )


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _only_section(content: Any) -> dict[str, Any] | None:
    """The values of a file that `launch_ros` writes: one pattern, and under it names with their values."""
    section = (
        next(iter(content.values())) if isinstance(content, Mapping) and len(content) == 1 else None
    )
    values = (
        section.get("ros__parameters")
        if isinstance(section, Mapping) and len(section) == 1
        else None
    )
    return dict(values) if isinstance(values, Mapping) else None


def _read_or_text(text: str) -> Any:
    """What a node makes of a value behind `-p name:=`: quotes, and with them text, may be lost."""
    import yaml

    try:
        return parameter_text.read(text)
    except yaml.YAMLError:
        return text


def ros_type(value: Any) -> str:
    """The ROS type that a parameter of a value has."""
    if isinstance(value, (list, tuple)):
        return f"{_ROS_TYPES.get(type(value[0]), 'string')}_array" if value else "not_set"
    return _ROS_TYPES.get(type(value), type(value).__name__)


def _parameter(name: str, value: Any) -> dict[str, Any]:
    return {"name": name, "value": value, "type": ros_type(value)}
