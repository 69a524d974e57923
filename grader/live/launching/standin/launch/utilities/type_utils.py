"""Values that may be given as they are or as substitutions, and their types."""

from __future__ import annotations

import collections.abc
from typing import Any, List, get_args, get_origin  # noqa: UP035

from .._base import (
    Substitution,
    ensure_argument_type,
    mistake,
    normalize_to_list_of_substitutions,
    perform_substitutions,
    shown,
)

ScalarTypesTuple = (int, float, bool, str)
ListTypesTuple = (List[int], List[float], List[bool], List[str])  # noqa: UP006
AllowedTypesTuple = ScalarTypesTuple + ListTypesTuple
AllowedTypesType = Any
AllowedValueType = Any
NormalizedValueType = Any
SomeValueType = Any
StrSomeValueType = Any


def _unreadable(message: str, raised: type[Exception] = ValueError) -> Any:
    remedy = "Give a value of the type that is asked for, or a text that can be read as one."
    return mistake(raised, message, "bad_parameter_value", remedy)


def _no_list(items: list[Any], data_type: Any) -> Any:
    message = f"the list {items!r} is given where one {data_type.__name__} is wanted"
    return mistake(TypeError, message, "bad_type", "Give one value, not a list.")


def is_valid_scalar_type(data_type: Any) -> bool:
    """Whether a type is one of the four scalar ones."""
    return data_type in ScalarTypesTuple


def is_typing_list(data_type: Any) -> bool:
    """Whether a type is `typing.List`, or a list of something; a plain `list` is not."""
    return data_type is List or get_origin(data_type) is list  # noqa: UP006


def extract_type(data_type: Any) -> tuple[Any, bool]:
    """The scalar type, and whether a list of it is meant.

    Raises
    ------
    ValueError
        The type is not one that a parameter can have.
    """
    is_list = is_typing_list(data_type)
    scalar = get_args(data_type)[0] if is_list and get_args(data_type) else data_type
    if scalar not in ScalarTypesTuple:
        remedy = "Use int, float, bool, str, or List[...] of one of them."
        raise mistake(ValueError, f"{data_type!r} is not a type that a value can have here", "bad_type", remedy)
    return scalar, is_list


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


def _read_yaml(value: str, aim: str, can_be_str: bool) -> Any:
    import yaml

    if not value:
        return value
    try:
        output = yaml.safe_load(value)
    except Exception as error:
        if can_be_str:
            return value
        raise _unreadable(f"'{value}' cannot be read as {aim}: it is not valid YAML ({error})") from error
    if not is_instance_of_valid_type(output, can_be_str):
        kind = "list whose items are not of one type" if isinstance(output, list) else type(output).__name__
        raise _unreadable(f"'{value}' cannot be read as {aim}: YAML makes it a {kind}")
    return output


def coerce_to_type(value: str, data_type: Any = None, can_be_str: bool = False) -> Any:
    """Read a text as a value of a type, or by the rules of YAML if no type is given.

    Raises
    ------
    TypeError
        `value` is no text.
    ValueError
        The text is no such value.
    """
    ensure_argument_type(value, str, "value", "coerce_to_type")
    if data_type is None:
        return _read_yaml(value, "a parameter value", can_be_str)
    scalar, is_list = extract_type(data_type)
    wanted = (str, scalar) if can_be_str else scalar
    if is_list:
        output = _read_yaml(value, f"a list of {scalar.__name__}", can_be_str)
        if not isinstance(output, list) or not all(isinstance(item, wanted) for item in output):
            raise _unreadable(f"'{value}' cannot be read as a list of {scalar.__name__}")
        return output
    return _coerce_scalar(value, scalar, can_be_str)


def _coerce_scalar(value: str, scalar: Any, can_be_str: bool) -> Any:
    if scalar is str:
        return value
    if scalar in (int, float):
        try:
            return scalar(value)
        except ValueError as error:
            if can_be_str:
                return value
            raise _unreadable(f"'{value}' cannot be read as {scalar.__name__}") from error
    if value in ("1", "0"):
        return value == "1"
    output = _read_yaml(value, "true or false", can_be_str)
    if isinstance(output, bool) or (can_be_str and isinstance(output, str)):
        return output
    raise _unreadable(f"'{value}' cannot be read as true or false")


def coerce_list(value: list[str], data_type: Any = None, can_be_str: bool = False) -> list[Any]:
    """Read a list of texts as values of one type.

    Raises
    ------
    ValueError
        They are not of one type.
    """
    ensure_argument_type(value, list, "value", "coerce_list")
    output = [coerce_to_type(item, data_type, can_be_str) for item in value]
    if not is_instance_of_valid_type(output, can_be_str):
        raise _unreadable(f"the items of {value!r} are not of one type")
    return output


def get_typed_value(value: Any, data_type: Any, can_be_str: bool = False) -> Any:
    """Read a text or a list of texts as a value of a type.

    Raises
    ------
    TypeError
        A list is given where a scalar is wanted.
    """
    if not isinstance(value, list):
        return coerce_to_type(value, data_type, can_be_str)
    if data_type is not None:
        data_type, is_list = extract_type(data_type)
        if not is_list:
            raise _no_list(value, data_type)
    return coerce_list(value, data_type, can_be_str)


def is_substitution(x: Any) -> bool:
    """Whether something is a substitution, or a list of texts with at least one substitution."""
    if isinstance(x, Substitution):
        return True
    if isinstance(x, str) or not isinstance(x, collections.abc.Sized) or not isinstance(x, collections.abc.Iterable):
        return False
    return all(isinstance(i, (Substitution, str)) for i in x) and any(isinstance(i, Substitution) for i in x)


def is_normalized_substitution(x: Any) -> bool:
    """Whether something is a non-empty list of substitutions."""
    return isinstance(x, list) and len(x) > 0 and all(isinstance(item, Substitution) for item in x)


def normalize_typed_substitution(value: Any, data_type: Any) -> Any:
    """Bring a value or substitution into the form that `perform_typed_substitution` takes.

    Raises
    ------
    TypeError
        It can never become a value of the type.
    """
    if isinstance(value, ScalarTypesTuple):
        if not is_instance_of(value, data_type):
            name = getattr(data_type, "__name__", str(data_type))
            message = f"{'an' if name == 'int' else 'a'} {name} is wanted, but {shown(value)}"
            raise mistake(TypeError, message, "bad_type", "Give a value of this type, without quotes.")
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
            raise _unreadable(f"in this list only values and substitutions can stand, but {shown(item)}", TypeError)
        kinds.add(type(item) if isinstance(item, ScalarTypesTuple) else Substitution)
    if data_type is not None:
        data_type, is_list = extract_type(data_type)
        if not is_list:
            raise _no_list(items, data_type)
    plain = kinds - {Substitution}
    if plain in ({float}, {int, float}):
        found: Any = float
    elif len(plain) > 1 or not plain <= set(ScalarTypesTuple):
        raise _unreadable(f"the items of {items!r} are not of one type", TypeError)
    else:  # an empty list counts as one of texts; a list of substitutions can become anything
        found = plain.pop() if plain else None if kinds else str
    if found is not None and data_type not in (None, found):
        message = f"a list of {found.__name__} is given where a list of {data_type.__name__} is wanted"
        raise _unreadable(message, TypeError)
    convert = float if found is float else (lambda item: item)
    return [normalize_to_list_of_substitutions(i) if is_substitution(i) else convert(i) for i in items]


def perform_typed_substitution(context: Any, value: Any, data_type: Any) -> Any:
    """Resolve what `normalize_typed_substitution` returned.

    Raises
    ------
    ValueError
        The text is no value of the type.
    TypeError
        The value is not in normal form.
    """
    if isinstance(value, ScalarTypesTuple):
        if data_type is not None and not is_instance_of(value, data_type):
            raise TypeError(f"{value!r} is not a {data_type}")
        return value
    if is_normalized_substitution(value):
        return coerce_to_type(perform_substitutions(context, value), data_type)
    if isinstance(value, list):
        scalar = None
        if data_type is not None:
            scalar, is_list = extract_type(data_type)
            if not is_list:
                raise _no_list(value, scalar)
        output = [
            coerce_to_type(perform_substitutions(context, item), scalar) if is_normalized_substitution(item) else item
            for item in value
        ]
        if not is_instance_of(output, data_type):
            message = f"the items of the list {output!r} are not of one type, or not of the one that is wanted"
            raise _unreadable(message)
        return output
    raise TypeError(f"{value!r} is no value, no substitution and no list of them")
