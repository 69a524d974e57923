"""Types of values, given plainly or as substitutions."""

from __future__ import annotations

import collections.abc
from typing import Any, List, get_args, get_origin  # noqa: UP035

from launch_plan.inside.problems import mistake, shown

from .._base import (
    Substitution,
    ensure_argument_type,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)

ScalarTypesTuple = (int, float, bool, str)


def _unreadable(message: str, raised: type[Exception] = ValueError) -> Any:
    remedy = "Give a value of the type that is asked for, or a text that can be read as one."
    return mistake(raised, message, "bad_parameter_value", remedy)


def is_typing_list(data_type: Any) -> bool:
    """Return whether a type is `typing.List` or `List[...]`; a plain `list` is neither."""
    return data_type is List or get_origin(data_type) is list  # noqa: UP006


def extract_type(data_type: Any) -> tuple[Any, bool]:
    """Return the scalar type, and whether a list of it is meant, e.g. `(int, True)` for `List[int]`."""
    is_list = is_typing_list(data_type)
    scalar = data_type
    if is_list and get_args(data_type):
        scalar = get_args(data_type)[0]
    if scalar not in ScalarTypesTuple:
        message = f"{data_type!r} is not a type that a value can have here"
        remedy = "Use int, float, bool, str, or List[...] of one of them."
        raise mistake(ValueError, message, "bad_type", remedy)
    return scalar, is_list


def _type_of_items(items: list[Any], data_type: Any) -> Any:
    """Return the type of each item of a list, or None if any is accepted."""
    if data_type is None:
        return None
    scalar, is_list = extract_type(data_type)
    if not is_list:
        message = f"the list {items!r} is given where one {scalar.__name__} is wanted"
        raise mistake(TypeError, message, "bad_type", "Give one value, not a list.")
    return scalar


def is_instance_of_valid_type(value: Any, can_be_str: bool = False) -> bool:
    """Return whether a value is a scalar or a list of scalars of one type."""
    if not isinstance(value, list):
        return isinstance(value, ScalarTypesTuple)
    kinds = [type(item) for item in value if type(item) is not str]
    kind: Any = kinds[0] if kinds else str
    if kind not in ScalarTypesTuple:
        return False
    wanted = (kind, str) if can_be_str else kind
    return all(isinstance(item, wanted) for item in value)


def is_instance_of(value: Any, data_type: Any = None, can_be_str: bool = False) -> bool:
    """Return whether a value is of a type, or of any valid one if no type is given."""
    if data_type is None:
        return is_instance_of_valid_type(value, can_be_str)
    scalar, is_list = extract_type(data_type)
    wanted = (str, scalar) if can_be_str else scalar
    if is_list:
        return isinstance(value, list) and all(isinstance(item, wanted) for item in value)
    return isinstance(value, wanted)


def coerce_to_type(value: str, data_type: Any = None, can_be_str: bool = False) -> Any:
    """Return the value of a text, read as a type, or by the rules of YAML if no type is given."""
    import yaml

    ensure_argument_type(value, str, "value", "coerce_to_type")
    scalar: Any = None
    is_list = False
    if data_type is not None:
        scalar, is_list = extract_type(data_type)
    if is_list:
        return _read(value, data_type, yaml.safe_load, f"a list of {scalar.__name__}", can_be_str)
    if scalar is str:
        return value
    if scalar is bool and value in ("1", "0"):
        return value == "1"
    if scalar in (int, float):
        return _read(value, data_type, scalar, scalar.__name__, can_be_str)
    aim = "a parameter value" if scalar is None else "true or false"
    return _read(value, data_type, yaml.safe_load, aim, can_be_str)


def _read(value: str, data_type: Any, read: Any, aim: str, can_be_str: bool) -> Any:
    """Return the value of a text, read by a function; `aim` names the type in messages."""
    output: Any = value
    try:
        if value:
            output = read(value)
    except Exception as error:
        if not can_be_str:
            raise _unreadable(f"'{value}' cannot be read as {aim}") from error
    if not is_instance_of_valid_type(output, can_be_str):
        kind = type(output).__name__
        if isinstance(output, list):
            kind = "list whose items are not of one type"
        raise _unreadable(f"'{value}' cannot be read as {aim}: YAML makes it a {kind}")
    if not is_instance_of(output, data_type, can_be_str):
        raise _unreadable(f"'{value}' cannot be read as {aim}")
    return output


def coerce_list(value: list[str], data_type: Any = None, can_be_str: bool = False) -> list[Any]:
    ensure_argument_type(value, list, "value", "coerce_list")
    output = [coerce_to_type(item, data_type, can_be_str) for item in value]
    if not is_instance_of_valid_type(output, can_be_str):
        raise _unreadable(f"the items of {value!r} are not of one type")
    return output


def get_typed_value(value: Any, data_type: Any, can_be_str: bool = False) -> Any:
    """Return the value of a text or of a list of texts, read as a type."""
    if not isinstance(value, list):
        return coerce_to_type(value, data_type, can_be_str)
    return coerce_list(value, _type_of_items(value, data_type), can_be_str)


def is_substitution(x: Any) -> bool:
    """Return whether an object is a substitution, or a list of texts with at least one substitution."""
    if isinstance(x, Substitution):
        return True
    if isinstance(x, str) or not isinstance(x, collections.abc.Sized):
        return False
    if not isinstance(x, collections.abc.Iterable):
        return False
    if not all(isinstance(i, (Substitution, str)) for i in x):
        return False
    return any(isinstance(i, Substitution) for i in x)


def is_normalized_substitution(x: Any) -> bool:
    """Return whether an object is a non-empty list of substitutions."""
    if not isinstance(x, list) or not x:
        return False
    return all(isinstance(item, Substitution) for item in x)


def normalize_typed_substitution(value: Any, data_type: Any) -> Any:
    """Return a value or a substitution in the form for `perform_typed_substitution`."""
    if isinstance(value, ScalarTypesTuple):
        if not is_instance_of(value, data_type):
            name = getattr(data_type, "__name__", str(data_type))
            message = f"{'an' if name == 'int' else 'a'} {name} is wanted, but {shown(value)}"
            raise _wrong_type(message)
        return value
    if is_substitution(value):
        return normalize_to_list_of_substitutions(value)
    if not isinstance(value, collections.abc.Iterable):
        message = f"a value, a substitution, or a list of them is wanted, but {shown(value)}"
        raise _wrong_type(message)
    return _normalize_typed_list(list(value), data_type)


def _wrong_type(message: str) -> Any:
    remedy = "Give a value of this type, without quotes."
    return mistake(TypeError, message, "bad_type", remedy)


def _normalize_typed_list(items: list[Any], data_type: Any) -> list[Any]:
    kinds = _plain_types(items)
    data_type = _type_of_items(items, data_type)
    found = _type_found(items, kinds)
    if found is not None and data_type not in (None, found):
        message = (
            f"a list of {found.__name__} is given where a list of {data_type.__name__} is wanted"
        )
        raise _unreadable(message, TypeError)
    normal: list[Any] = []
    for item in items:
        if is_substitution(item):
            normal.append(normalize_to_list_of_substitutions(item))
        else:
            normal.append(float(item) if found is float else item)
    return normal


def _plain_types(items: list[Any]) -> set[Any]:
    """Return the types of the plain items of a list; the others are substitutions."""
    kinds: set[Any] = set()
    for item in items:
        if isinstance(item, ScalarTypesTuple):
            kinds.add(type(item))
        elif not is_substitution(item):
            message = f"in this list only values and substitutions can stand, but {shown(item)}"
            raise _unreadable(message, TypeError)
    return kinds


def _type_found(items: list[Any], kinds: set[Any]) -> Any:
    """Return the type that plain items give a list; None for a list of substitutions, because it fits any type."""
    if kinds in ({float}, {int, float}):
        return float
    if len(kinds) > 1 or not kinds <= set(ScalarTypesTuple):
        raise _unreadable(f"the items of {items!r} are not of one type", TypeError)
    if kinds:
        return kinds.pop()
    # An empty list counts as a list of texts.
    return None if items else str


def perform_typed_substitution(context: Any, value: Any, data_type: Any) -> Any:
    """Resolve the result of `normalize_typed_substitution`."""
    if isinstance(value, ScalarTypesTuple):
        if data_type is not None and not is_instance_of(value, data_type):
            raise TypeError(f"{value!r} is not a {data_type}")
        return value
    if is_normalized_substitution(value):
        return coerce_to_type(perform_substitutions(context, value), data_type)
    if isinstance(value, list):
        return _perform_list(context, value, data_type)
    raise TypeError(f"{value!r} is no value, no substitution and no list of them")


def _perform_list(context: Any, items: list[Any], data_type: Any) -> list[Any]:
    scalar = _type_of_items(items, data_type)
    output: list[Any] = []
    for item in items:
        resolved = item
        if is_normalized_substitution(item):
            resolved = coerce_to_type(perform_substitutions(context, item), scalar)
        output.append(resolved)
    if not is_instance_of(output, data_type):
        message = f"the items of the list {output!r} are not of one type, or not of the one that is wanted"
        raise _unreadable(message)
    return output
