"""Values that may be given as they are or as substitutions, and their types."""

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
    """Whether a type is `typing.List`, or a list of something; a plain `list` is not."""
    return data_type is List or get_origin(data_type) is list  # noqa: UP006


def extract_type(data_type: Any) -> tuple[Any, bool]:
    """The scalar type, and whether a list of it is meant."""
    is_list = is_typing_list(data_type)
    scalar = get_args(data_type)[0] if is_list and get_args(data_type) else data_type
    if scalar not in ScalarTypesTuple:
        remedy = "Use int, float, bool, str, or List[...] of one of them."
        raise mistake(
            ValueError,
            f"{data_type!r} is not a type that a value can have here",
            "bad_type",
            remedy,
        )
    return scalar, is_list


def _type_of_items(items: list[Any], data_type: Any) -> Any:
    """The type that each item of a list must have, if one is wanted."""
    if data_type is None:
        return None
    scalar, is_list = extract_type(data_type)
    if not is_list:
        message = f"the list {items!r} is given where one {scalar.__name__} is wanted"
        raise mistake(TypeError, message, "bad_type", "Give one value, not a list.")
    return scalar


def is_instance_of_valid_type(value: Any, can_be_str: bool = False) -> bool:
    """Whether a value is a scalar or a list of scalars of one type."""
    if not isinstance(value, list):
        return isinstance(value, ScalarTypesTuple)
    kind = next((type(item) for item in value if type(item) is not str), str)
    wanted = (kind, str) if can_be_str else kind
    return kind in ScalarTypesTuple and all(isinstance(item, wanted) for item in value)


def is_instance_of(value: Any, data_type: Any = None, can_be_str: bool = False) -> bool:
    """Whether a value is of a type; without a type, whether it is of any valid one."""
    if data_type is None:
        return is_instance_of_valid_type(value, can_be_str)
    scalar, is_list = extract_type(data_type)
    wanted = (str, scalar) if can_be_str else scalar
    if is_list:
        return isinstance(value, list) and all(isinstance(item, wanted) for item in value)
    return isinstance(value, wanted)


def coerce_to_type(value: str, data_type: Any = None, can_be_str: bool = False) -> Any:
    """Read a text as a value of a type, or by the rules of YAML if no type is given."""
    import yaml

    ensure_argument_type(value, str, "value", "coerce_to_type")
    scalar: Any = None
    is_list = False
    if data_type is not None:
        scalar, is_list = extract_type(data_type)
    aim = (
        "a parameter value"
        if scalar is None
        else "true or false"
        if scalar is bool
        else scalar.__name__
    )
    if is_list:
        aim = f"a list of {scalar.__name__}"
    elif scalar is str:
        return value
    elif scalar is bool and value in ("1", "0"):
        return value == "1"
    read = scalar if scalar in (int, float) and not is_list else yaml.safe_load
    try:
        output = read(value) if value else value
    except Exception as error:
        if not can_be_str:
            raise _unreadable(f"'{value}' cannot be read as {aim}") from error
        output = value
    if not is_instance_of_valid_type(output, can_be_str):
        kind = (
            "list whose items are not of one type"
            if isinstance(output, list)
            else type(output).__name__
        )
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
    """Read a text or a list of texts as a value of a type."""
    if not isinstance(value, list):
        return coerce_to_type(value, data_type, can_be_str)
    return coerce_list(value, _type_of_items(value, data_type), can_be_str)


def is_substitution(x: Any) -> bool:
    """Whether something is a substitution, or a list of texts with at least one substitution."""
    if isinstance(x, Substitution):
        return True
    if (
        isinstance(x, str)
        or not isinstance(x, collections.abc.Sized)
        or not isinstance(x, collections.abc.Iterable)
    ):
        return False
    return all(isinstance(i, (Substitution, str)) for i in x) and any(
        isinstance(i, Substitution) for i in x
    )


def is_normalized_substitution(x: Any) -> bool:
    """Whether something is a non-empty list of substitutions."""
    return isinstance(x, list) and len(x) > 0 and all(isinstance(item, Substitution) for item in x)


def normalize_typed_substitution(value: Any, data_type: Any) -> Any:
    """Bring a value or substitution into the form that `perform_typed_substitution` takes."""
    if isinstance(value, ScalarTypesTuple):
        if not is_instance_of(value, data_type):
            name = getattr(data_type, "__name__", str(data_type))
            message = f"{'an' if name == 'int' else 'a'} {name} is wanted, but {shown(value)}"
            raise mistake(
                TypeError, message, "bad_type", "Give a value of this type, without quotes."
            )
        return value
    if is_substitution(value):
        return normalize_to_list_of_substitutions(value)
    if not isinstance(value, collections.abc.Iterable):
        message = f"a value, a substitution, or a list of them is wanted, but {shown(value)}"
        raise mistake(TypeError, message, "bad_type", "Give a value of this type, without quotes.")
    return _normalize_typed_list(list(value), data_type)


def _normalize_typed_list(items: list[Any], data_type: Any) -> list[Any]:
    kinds = set()
    for item in items:
        if not isinstance(item, ScalarTypesTuple) and not is_substitution(item):
            raise _unreadable(
                f"in this list only values and substitutions can stand, but {shown(item)}",
                TypeError,
            )
        kinds.add(type(item) if isinstance(item, ScalarTypesTuple) else Substitution)
    data_type = _type_of_items(items, data_type)
    plain = kinds - {Substitution}
    if plain in ({float}, {int, float}):
        found: Any = float
    elif len(plain) > 1 or not plain <= set(ScalarTypesTuple):
        raise _unreadable(f"the items of {items!r} are not of one type", TypeError)
    else:  # an empty list counts as one of texts; a list of substitutions can become anything
        found = plain.pop() if plain else None if kinds else str
    if found is not None and data_type not in (None, found):
        message = (
            f"a list of {found.__name__} is given where a list of {data_type.__name__} is wanted"
        )
        raise _unreadable(message, TypeError)
    convert = float if found is float else (lambda item: item)
    return [
        normalize_to_list_of_substitutions(i) if is_substitution(i) else convert(i) for i in items
    ]


def perform_typed_substitution(context: Any, value: Any, data_type: Any) -> Any:
    """Resolve what `normalize_typed_substitution` returned."""
    if isinstance(value, ScalarTypesTuple):
        if data_type is not None and not is_instance_of(value, data_type):
            raise TypeError(f"{value!r} is not a {data_type}")
        return value
    if is_normalized_substitution(value):
        return coerce_to_type(perform_substitutions(context, value), data_type)
    if isinstance(value, list):
        scalar = _type_of_items(value, data_type)
        output = [
            coerce_to_type(perform_substitutions(context, item), scalar)
            if is_normalized_substitution(item)
            else item
            for item in value
        ]
        if not is_instance_of(output, data_type):
            message = f"the items of the list {output!r} are not of one type, or not of the one that is wanted"
            raise _unreadable(message)
        return output
    raise TypeError(f"{value!r} is no value, no substitution and no list of them")
