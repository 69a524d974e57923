"""Normal forms of parameters, remappings and namespaces."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from launch._base import (
    Substitution,
    ensure_argument_type,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from launch.substitutions import TextSubstitution

from launch_plan.inside.problems import mistake, shown

from ..parameter_descriptions import Parameter, ParameterFile, ParameterValue

_SCALARS = (str, bool, int, float)


def add_node_name(context: Any, node_name: str) -> None:
    names = context.get_locals_as_dict().get("unique_ros_node_names", ())
    context.extend_globals({"unique_ros_node_names": [*names, node_name]})


def get_node_name_count(context: Any, node_name: str) -> int:
    return list(context.get_locals_as_dict().get("unique_ros_node_names", ())).count(node_name)


class InvalidNodeNameException(ValueError):
    """Raised for an invalid name of a node."""


class InvalidNamespaceException(ValueError):
    """Raised for an invalid namespace."""


def validate_node_name(name: str) -> None:
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) or len(name) > 255:
        message = f"invalid node name '{name}': it may hold only letters, digits and '_', and may not begin with a digit"
        remedy = "Use letters, digits and '_', and put '/' into namespace=."
        raise mistake(InvalidNodeNameException, message, "bad_name", remedy)


def validate_namespace(namespace: str) -> None:
    if namespace != "/" and not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", namespace):
        message = (
            f"invalid namespace '{namespace}': its parts may hold only letters, digits and '_', "
        )
        message += "may not begin with a digit, and are separated by one '/' each"
        remedy = "Use letters, digits and '_', with one '/' between the parts."
        raise mistake(InvalidNamespaceException, message, "bad_name", remedy)


def make_namespace_absolute(ns: str | None) -> str | None:
    if ns is None or ns.startswith("/"):
        return ns
    return "/" + ns


def prefix_namespace(base_ns: str | None, ns: str | None) -> str | None:
    """Return a namespace inside another, e.g. `/a/b` for `/a` and `b`; an absolute one stays as it is."""
    if ns is None:
        combined = base_ns
    elif not base_ns or ns.startswith("/"):
        combined = ns
    else:
        outer = "" if base_ns == "/" else base_ns
        combined = f"{outer}/{ns}"
    if combined is None or combined == "/":
        return combined
    return combined.rstrip("/")


def normalize_remap_rule(remap_rule: Any) -> tuple[list[Substitution], list[Substitution]]:
    if not isinstance(remap_rule, tuple):
        raise _bad_remapping(shown(remap_rule))
    if len(remap_rule) != 2:
        raise _bad_remapping(f"{remap_rule!r:.120} has {len(remap_rule)}")
    source, target = remap_rule
    return normalize_to_list_of_substitutions(source), normalize_to_list_of_substitutions(target)


def _bad_remapping(reason: str) -> Any:
    message = f"a remapping must be a tuple of two, but {reason}"
    remedy = "Write a list of tuples: remappings=[('from', 'to')]."
    return mistake(TypeError, message, "bad_remapping", remedy)


def normalize_remap_rules(
    remap_rules: Any,
) -> Iterator[tuple[list[Substitution], list[Substitution]]]:
    return (normalize_remap_rule(rule) for rule in remap_rules)


def normalize_parameters(parameters: Any) -> tuple[Any, ...]:
    """Return parameters in normal form: dicts, files, and `Parameter`s."""
    if isinstance(parameters, str) or not isinstance(parameters, Sequence):
        remedy = "Put the parameters into a list: parameters=[{...}]."
        message = f"argument 'parameters' must be a list, but {shown(parameters)}"
        raise mistake(TypeError, message, "parameters_not_list", remedy)
    # All files are checked before any dict.
    listed: list[Any] = []
    for item in parameters:
        is_known = isinstance(item, (Mapping, Parameter, ParameterFile))
        listed.append(item if is_known else ParameterFile(item))
    normal: list[Any] = []
    for item in listed:
        normal.append(normalize_parameter_dict(item) if isinstance(item, Mapping) else item)
    return tuple(normal)


def normalize_parameter_dict(parameters: Any, *, _prefix: Any = None) -> dict[Any, Any]:
    """Return a dict of parameters in normal form: flat, with names joined by full stops."""
    if not isinstance(parameters, Mapping):
        raise TypeError(f"a dict of parameters is wanted, but {parameters!r} is given")
    normal: dict[Any, Any] = {}
    for name, value in parameters.items():
        parts = normalize_to_list_of_substitutions(name)
        if _prefix:
            parts = [*_prefix, TextSubstitution(text="."), *parts]
        if isinstance(value, Mapping):
            normal.update(normalize_parameter_dict(value, _prefix=parts))
        else:
            normal[tuple(parts)] = _normalize_value(name, value)
    return normal


_AS_TEXT = "If it is meant as text, wrap it: ParameterValue(..., value_type=str)."


def _no_value(message: str, value: Any) -> Any:
    """Return the error for a value of a type that no parameter can have."""
    return mistake(TypeError, message, "bad_parameter_value", _remedy_for(value))


def _remedy_for(value: Any) -> str:
    """Return the instruction for a value of an unsuitable type."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        if value:
            return "Write all items alike: [1.0, 2.5] instead of [1, 2.5], ['1', 'x'] instead of [1, 'x']."
        return "Leave the parameter out, or give a list with at least one item."
    remedies = {
        "NoneType": "Leave the parameter out, or give it a value.",
        "PosixPath": "Give a path as text: str(path).",
        "ndarray": "Give a plain list: array.tolist().",
    }
    general = "Give a bool, an int, a float, a text, or a list of one of these."
    return remedies.get(type(value).__name__, general)


def _normalize_value(name: Any, value: Any) -> Any:
    # A value written as YAML here is read again after its substitutions are resolved.
    import yaml

    if isinstance(value, str):
        return tuple(normalize_to_list_of_substitutions(yaml.dump(value)))
    if isinstance(value, Substitution):
        return tuple(normalize_to_list_of_substitutions(value))
    if isinstance(value, (float, bool, int, bytes, ParameterValue)):
        return value
    if not isinstance(value, Sequence):
        raise _no_value(f"the parameter '{name}' cannot have such a value: {shown(value)}", value)
    return _normalize_list(name, value)


def _normalize_list(name: Any, items: Sequence[Any]) -> tuple[Any, ...]:
    import yaml

    kinds = {_kind_of(name, item) for item in items}
    if kinds in ({int}, {bool}):
        return tuple(items)
    if kinds in ({float}, {int, float}):
        return tuple(float(item) for item in items)
    if Substitution in kinds and kinds <= {str, Substitution}:
        return tuple(normalize_to_list_of_substitutions(items))
    normal: list[Any] = []
    for item in items:
        written = yaml.dump(item) if isinstance(item, _SCALARS) else item
        normal.append(normalize_to_list_of_substitutions(written))
    return tuple(normal)


def _kind_of(name: Any, item: Any) -> Any:
    """Return the kind of an item in the list of a parameter."""
    for kind in (Substitution, *_SCALARS, Sequence):
        if isinstance(item, kind):
            return kind
    message = f"the parameter '{name}' cannot have such an item in its list: {shown(item)}"
    raise _no_value(message, item)


def evaluate_parameters(context: Any, parameters: Any) -> tuple[Any, ...]:
    """Resolve normal parameters: dicts of values, paths of files, or `Parameter`s."""
    # All files are resolved before any dict.
    listed: list[Any] = []
    for item in parameters:
        listed.append(item.evaluate(context) if isinstance(item, ParameterFile) else item)
    resolved: list[Any] = []
    for item in listed:
        is_dict = isinstance(item, Mapping)
        resolved.append(evaluate_parameter_dict(context, item) if is_dict else item)
    return tuple(resolved)


def evaluate_parameter_dict(context: Any, parameters: Any) -> dict[str, Any]:
    named: dict[str, Any] = {}
    for name, value in parameters.items():
        named[perform_substitutions(context, list(name))] = value
    return {name: _evaluate_value(context, name, value) for name, value in named.items()}


def _evaluate_value(context: Any, name: str, value: Any) -> Any:
    import yaml

    if isinstance(value, ParameterValue):
        return value.evaluate(context)
    if not isinstance(value, tuple):
        ensure_argument_type(value, (float, int, str, bool, bytes), "value", f"parameter '{name}'")
        return value
    if value and isinstance(value[0], Substitution):
        return _evaluate_text(name, perform_substitutions(context, value))
    if value and not isinstance(value[0], Sequence):
        return value
    texts = [perform_substitutions(context, item) for item in value]
    return _uniform(name, [yaml.safe_load(text) for text in texts])


def _evaluate_text(name: str, text: str) -> Any:
    import yaml

    try:
        value = yaml.safe_load(text or "''")
    except yaml.YAMLError as error:
        message = f"the value of the parameter '{name}' cannot be read as YAML: {text!r:.120}"
        raise mistake(TypeError, message, "bad_parameter_value", _AS_TEXT) from error
    if type(value) in (*_SCALARS, bytes):
        return value
    if isinstance(value, Sequence):
        return _uniform(name, value)
    message = f"the value of the parameter '{name}' becomes a '{type(value).__name__}' when read as YAML, "
    message += f"which no parameter can have: {text!r:.120}"
    raise mistake(TypeError, message, "bad_parameter_value", _AS_TEXT)


def _uniform(name: str, items: Sequence[Any]) -> tuple[Any, ...]:
    if _is_uniform(items):
        return tuple(items)
    message = f"the list given to the parameter '{name}' must not be empty, and its items must "
    message += f"all be of one type (bool, int, float or str), but it is {list(items)!r:.120}"
    raise _no_value(message, items)


def _is_uniform(items: Sequence[Any]) -> bool:
    if not items:
        return False
    kind = type(items[0])
    return kind in _SCALARS and all(isinstance(item, kind) for item in items)
