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
    """A node cannot be named so."""


class InvalidNamespaceException(ValueError):
    """A namespace cannot be named so."""


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
    return ns if ns is None or ns.startswith("/") else "/" + ns


def prefix_namespace(base_ns: str | None, ns: str | None) -> str | None:
    """A namespace inside another; an absolute one stays."""
    if ns is None:
        combined = base_ns
    elif not base_ns or ns.startswith("/"):
        combined = ns
    else:
        combined = ("" if base_ns == "/" else base_ns) + "/" + ns
    return combined if combined in (None, "/") else str(combined).rstrip("/")


def normalize_remap_rule(remap_rule: Any) -> tuple[list[Substitution], list[Substitution]]:
    if not isinstance(remap_rule, tuple) or len(remap_rule) != 2:
        why = (
            f"{remap_rule!r:.120} has {len(remap_rule)}"
            if isinstance(remap_rule, tuple)
            else shown(remap_rule)
        )
        remedy = "Write a list of tuples: remappings=[('from', 'to')]."
        raise mistake(
            TypeError, f"a remapping must be a tuple of two, but {why}", "bad_remapping", remedy
        )
    return normalize_to_list_of_substitutions(remap_rule[0]), normalize_to_list_of_substitutions(
        remap_rule[1]
    )


def normalize_remap_rules(
    remap_rules: Any,
) -> Iterator[tuple[list[Substitution], list[Substitution]]]:
    return (normalize_remap_rule(rule) for rule in remap_rules)


def normalize_parameters(parameters: Any) -> tuple[Any, ...]:
    """Parameters in normal form: dicts, files, and `Parameter`s."""
    if isinstance(parameters, str) or not isinstance(parameters, Sequence):
        remedy = "Put the parameters into a list: parameters=[{...}]."
        message = f"argument 'parameters' must be a list, but {shown(parameters)}"
        raise mistake(TypeError, message, "parameters_not_list", remedy)
    kept = (Parameter, ParameterFile)
    files = [
        item if isinstance(item, (Mapping, *kept)) else ParameterFile(item) for item in parameters
    ]
    return tuple(
        normalize_parameter_dict(item) if isinstance(item, Mapping) else item for item in files
    )


def normalize_parameter_dict(parameters: Any, *, _prefix: Any = None) -> dict[Any, Any]:
    """A dict of parameters in normal form: flat, with names joined by dots."""
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
    """The error about a value that no parameter can have, with what to do about a value of its type."""
    remedies = {
        "NoneType": "Leave the parameter out, or give it a value.",
        "PosixPath": "Give a path as text: str(path).",
        "ndarray": "Give a plain list: array.tolist().",
    }
    remedy = remedies.get(
        type(value).__name__, "Give a bool, an int, a float, a text, or a list of one of these."
    )
    if isinstance(value, Sequence) and not isinstance(value, str):
        remedy = (
            "Write all items alike: [1.0, 2.5] instead of [1, 2.5], ['1', 'x'] instead of [1, 'x']."
        )
        remedy = (
            remedy if value else "Leave the parameter out, or give a list with at least one item."
        )
    return mistake(TypeError, message, "bad_parameter_value", remedy)


def _normalize_value(name: Any, value: Any) -> Any:
    # What is written as YAML here is read again once its substitutions have values.
    import yaml

    if isinstance(value, (str, Substitution)):
        return tuple(
            normalize_to_list_of_substitutions(
                yaml.dump(value) if isinstance(value, str) else value
            )
        )
    if isinstance(value, (float, bool, int, bytes, ParameterValue)):
        return value
    if not isinstance(value, Sequence):
        raise _no_value(f"the parameter '{name}' cannot have such a value: {shown(value)}", value)
    kinds = set()
    for item in value:
        kinds.add(
            next(
                (kind for kind in (Substitution, *_SCALARS, Sequence) if isinstance(item, kind)),
                None,
            )
        )
        if None in kinds:
            raise _no_value(
                f"the parameter '{name}' cannot have such an item in its list: {shown(item)}", item
            )
    if kinds in ({int}, {bool}):
        return tuple(value)
    if kinds in ({float}, {int, float}):
        return tuple(float(item) for item in value)
    if Substitution in kinds and kinds <= {str, Substitution}:
        return tuple(normalize_to_list_of_substitutions(value))
    items = [yaml.dump(item) if isinstance(item, _SCALARS) else item for item in value]
    return tuple(normalize_to_list_of_substitutions(item) for item in items)


def evaluate_parameters(context: Any, parameters: Any) -> tuple[Any, ...]:
    """Normal parameters, resolved: dicts of values, paths of files, or `Parameter`s."""
    files = [
        item.evaluate(context) if isinstance(item, ParameterFile) else item for item in parameters
    ]
    return tuple(
        evaluate_parameter_dict(context, item) if isinstance(item, Mapping) else item
        for item in files
    )


def evaluate_parameter_dict(context: Any, parameters: Any) -> dict[str, Any]:
    names = {
        perform_substitutions(context, list(name)): value for name, value in parameters.items()
    }
    return {name: _evaluate_value(context, name, value) for name, value in names.items()}


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
    return _uniform(name, [yaml.safe_load(perform_substitutions(context, item)) for item in value])


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
    if (
        not items
        or type(items[0]) not in _SCALARS
        or not all(isinstance(i, type(items[0])) for i in items)
    ):
        message = f"the list given to the parameter '{name}' must not be empty, and its items must "
        message += f"all be of one type (bool, int, float or str), but it is {list(items)!r:.120}"
        raise _no_value(message, items)
    return tuple(items)
