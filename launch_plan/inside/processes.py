"""Processes of a launch file as entries of a plan: command line, environment, and parameters of a node."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from launch_plan.format import PARAMETERS_PLACEHOLDER
from launch_plan.inside import parameter_text
from launch_plan.inside.installed import ELSEWHERE
from launch_plan.inside.problems import SUBSTITUTION_AS_TEXT, place_of

_ROS_TYPES = {bool: "bool", int: "integer", float: "double", str: "string", bytes: "byte_array"}


def private(action: Any, owner: str, name: str, default: Any = None) -> Any:
    """Return an argument of an action without a public property: a field in the stand-in, else a private attribute."""
    given: dict[str, Any] | None = getattr(action, "given", None)
    if given is not None and name in given:
        return given[name]
    return getattr(action, f"_{owner}__{name}", default)


def text_of(subs: Any, context: Any) -> str:
    """Return a substitution, a text, or a list of both, resolved."""
    from launch.utilities import normalize_to_list_of_substitutions, perform_substitutions

    return str(perform_substitutions(context, normalize_to_list_of_substitutions(subs)))


def process_name(action: Any) -> str:
    """Return the name of an action's process, e.g. `talker-1`; "None" before the action is prepared."""
    details = action.process_details or {}
    return str(details.get("name"))


class Describer:
    """Describer of processes, with warnings about effects that the author cannot have wanted."""

    def __init__(self, executor: Any) -> None:
        self._plan = executor
        self._warn = executor.warn
        self._files = executor.files

    def process(self, action: Any, context: Any) -> dict[str, Any]:
        """Return the entry of a process; its action is prepared."""
        description = action.process_description
        details = action.process_details
        words = [str(word) for word in details["cmd"]]
        cwd = details["cwd"]
        prefixed = len(words) - len(description.cmd)
        environment = {str(name): str(value) for name, value in (details["env"] or {}).items()}
        self._warn_of_objects([*words, *environment.values()], action)
        path = words[prefixed] if action.shell else self._program(words[prefixed], action, context)
        argv = words[prefixed + 1 :]
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
            **self._environment(environment, replaces=description.env is not None),
            "cwd": None if cwd is None else os.path.abspath(cwd),  # noqa: PTH100
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

    def _program(self, program: str, action: Any, context: Any) -> str:
        """Return the path of a program; a program that is not found keeps its name."""
        found = shutil.which(program, path=context.environment.get("PATH"))
        if found is not None:
            return found
        if not program.startswith(f"{ELSEWHERE}/"):
            self._warn(f"the program '{program}' is not found, so it cannot start", action)
        return program

    def _environment(self, environment: dict[str, str], *, replaces: bool) -> dict[str, Any]:
        """Return the variables that differ from the launch's variables; all of them if they replace the launch's."""
        before = self._plan.initial_environment
        if replaces:
            return {"env": environment, "env_unset": [], "env_replaces": True}
        changed = {n: value for n, value in environment.items() if before.get(n) != value}
        unset = sorted(set(before) - set(environment))
        return {"env": changed, "env_unset": unset, "env_replaces": False}

    def _number(self, action: Any, name: str, default: float) -> float:
        """Return a number that `launch` reads only after the exit of the process."""
        value = private(action, "ExecuteLocal", name)
        if value is None or isinstance(value, (int, float)):
            return value or default
        message = f"{name} must be a number, but it is of type '{type(value).__name__}'"
        self._warn(f"{message}; the launch fails when it would start the process again", action)
        return default

    def _seconds(self, action: Any, name: str, context: Any) -> float:
        """Return a time that `launch` resolves only at its shutdown."""
        try:
            return float(text_of(getattr(action, name), context))
        except Exception as error:
            self._warn(f"{name} fails when the launch ends: {error}", action)
            return 5.0

    def _output(self, action: Any, context: Any) -> Any:
        """Return the destination of the output; `launch` refuses unknown ones."""
        from launch.logging import get_output_loggers

        chosen = action.output
        if not isinstance(chosen, dict):
            chosen = text_of(chosen, context)
        try:
            get_output_loggers(action.process_details["name"], chosen)
        except OSError:
            # The folder for logs is of no importance here.
            return chosen
        if isinstance(chosen, str):
            return chosen
        return {stream: _sorted_words(words) for stream, words in chosen.items()}

    def _node(self, action: Any, words: list[str], context: Any) -> dict[str, Any]:
        """Return the part of an entry that only nodes have: names, parameters and rules of the command line."""
        from launch_ros.actions import Node

        if not isinstance(action, Node):
            return {}
        _, _, name = action.node_name.rpartition("/")
        package = None if action.node_package is None else text_of(action.node_package, context)
        node: dict[str, Any] = {
            "kind": _kind_of(action),
            "package": package,
            "executable": text_of(action.node_executable, context),
            "name": _unless(Node.UNSPECIFIED_NODE_NAME, name),
            "namespace": _unless(Node.UNSPECIFIED_NODE_NAMESPACE, action.expanded_node_namespace),
            "parameters": self._parameters(words, name, action),
            "remappings": [list(rule) for rule in action.expanded_remapping_rules or []],
            "parameter_files": self._files_named(words),
        }
        elsewhere = f"{ELSEWHERE}/lib/{package}/"
        if words[0].startswith(elsewhere) and not os.access(words[0], os.X_OK):
            node["absent"] = f"the package '{package}' is not installed where this is evaluated"
        self._warn_of_equal_names(node, action)
        return node

    def _files_named(self, words: list[str]) -> dict[str, str]:
        """Return the plan's files with a path among the words of a command line."""
        files: dict[str, str] = {}
        for name, text in self._files.texts.items():
            if f"{PARAMETERS_PLACEHOLDER}/{name}" in words:
                files[name] = text
        return files

    def _warn_of_equal_names(self, node: dict[str, Any], action: Any) -> None:
        if node["name"] is None or node["namespace"] is None:
            return
        full_name = (node["name"], node["namespace"])
        before = [(p["name"], p["namespace"]) for p in self._plan.found["processes"]]
        if full_name in before:
            namespace, _, name = action.node_name.rpartition("/")
            self._warn(f"two nodes have the name '{namespace.rstrip('/')}/{name}'", action)

    def _parameters(self, words: list[str], label: str, action: Any) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        ros_words = words[words.index("--ros-args") :]
        for flag, word in pairwise(ros_words):
            name, is_rule, value = word.partition(":=")
            if flag in ("-p", "--param") and is_rule:
                # A parameter on the command line is for any node of the process, as one under `/**` in a file.
                found.append({**_parameter(name, _read_or_text(value)), "wildcard": True})
            elif flag == "--params-file":
                found += self._file_of_parameters(word, label, action)
        return found

    def _file_of_parameters(self, path: str, label: str, action: Any) -> list[dict[str, Any]]:
        """Return one entry for a file, or an entry for each value if `launch_ros` has written the file."""
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
        values = self._own_values(path, content, action)
        if values is None:
            return [{"file": path, "content": content}]
        return [_parameter(name, value) for name, value in values.items()]

    def _own_values(self, path: str, content: Any, action: Any) -> dict[str, Any] | None:
        """Return the values of a file that `launch_ros` has written for one node; None for another file."""
        of_node = path in self._files.of_nodes or Path(path).name.startswith("launch_params_")
        if not of_node or not isinstance(content, Mapping):
            return None
        if not set(content) <= {"/**", action.node_name}:
            return None
        return _only_section(content)

    def _warn_of_lost_texts(self, text: str, content: Any, action: Any) -> None:
        """Warn of texts written by PyYAML without quotes and read by the node as values of another type."""
        import yaml

        # A node reads a tuple of PyYAML as a list.
        text = text.replace("!!python/tuple", "")
        _, tagged, behind = text.partition("!!python/")
        if tagged:
            kind = behind.split()[0].partition(":")[2].removesuffix(".scalar")
            message = f"the value of a parameter is a {kind}, which a node cannot read, so it will not start"
            self._warn(f"{message}; write float(...)", action)
            return
        written = _only_section(yaml.safe_load(text)) or {}
        read = _only_section(content) or {}
        texts = [value for value in written.values() if isinstance(value, str)]
        self._warn_of_objects(texts, action)
        for name, given in written.items():
            for item, became in zip(_listed(given), _listed(read.get(name)), strict=False):
                if isinstance(item, str) and not isinstance(became, str):
                    message = f"the text '{item}' of the parameter '{name}' is written without quotes for the node"
                    self._warn(f"{message}, which reads it as {ros_type(became)}", action)

    def component(self, node: Any, context: Any) -> dict[str, Any]:
        """Return the entry of a node to be loaded into a container."""
        from launch_ros.utilities import make_namespace_absolute, prefix_namespace

        def text(subs: Any) -> str | None:
            return None if subs is None else text_of(subs, context)

        shared = context.launch_configurations
        rules = [list(rule) for rule in shared.get("ros_remaps") or []]
        for source, target in node.remappings or []:
            rules.append([text(source), text(target)])
        namespace = prefix_namespace(shared.get("ros_namespace"), text(node.node_namespace))
        file, line = place_of(node, self._plan.root)
        return {
            "package": text(node.package),
            "plugin": text(node.node_plugin),
            "name": text(node.node_name),
            "namespace": make_namespace_absolute(namespace),
            "parameters": self._parameters_of_component(node, context),
            "remappings": rules,
            "file": file,
            "line": line,
        }

    def _parameters_of_component(self, node: Any, context: Any) -> list[dict[str, Any]]:
        """Return the parameters that `launch` sends to the container, including parameters from files."""
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
                content = yaml.safe_load(self._files.text_of(str(item)))
                found.append({"file": str(item), "content": content})
        return found

    def _warn_of_objects(self, texts: Iterable[str], source: Any) -> None:
        if not any(SUBSTITUTION_AS_TEXT.search(text) for text in texts):
            return
        message = "str() or an f-string made text of a substitution before it has a value"
        remedy = "write a list instead: ['text', LaunchConfiguration(...)]"
        self._warn(f"{message}; {remedy}", source)


def _kind_of(node: Any) -> str:
    from launch_ros.actions import ComposableNodeContainer, LifecycleNode

    if isinstance(node, LifecycleNode):
        return "lifecycle_node"
    if isinstance(node, ComposableNodeContainer):
        return "container"
    return "node"


def _unless(placeholder: str, name: str) -> str | None:
    """Return a name, or None for the placeholder of an unspecified one."""
    return None if name == placeholder else name


def _sorted_words(words: Any) -> list[str]:
    return [words] if isinstance(words, str) else sorted(words)


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _only_section(content: Any) -> dict[str, Any] | None:
    """Return the values of a file of the form that `launch_ros` writes: one pattern with `ros__parameters`."""
    if not isinstance(content, Mapping) or len(content) != 1:
        return None
    (section,) = content.values()
    if not isinstance(section, Mapping) or len(section) != 1:
        return None
    values = section.get("ros__parameters")
    return dict(values) if isinstance(values, Mapping) else None


def _read_or_text(text: str) -> Any:
    """Return the value that a node reads from the text behind `-p name:=`, e.g. 5 from `5`."""
    import yaml

    try:
        return parameter_text.read(text)
    except yaml.YAMLError:
        return text


def ros_type(value: Any) -> str:
    """Return the ROS type of a parameter's value, e.g. `double_array` for `[1.5]`."""
    if isinstance(value, (list, tuple)) and not value:
        return "not_set"
    if isinstance(value, (list, tuple)):
        return f"{_ROS_TYPES.get(type(value[0]), 'string')}_array"
    return _ROS_TYPES.get(type(value), type(value).__name__)


def _parameter(name: str, value: Any) -> dict[str, Any]:
    return {"name": name, "value": value, "type": ros_type(value)}
