"""Values of a rubric in a message; the type of the message may be a student's own.

The C code of a type ends the process where a field holds something else, such as an integer for a `float64`. So every
value is checked in Python before.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from grader.live.ros_node.graph import interface_named

#: The type of an array's elements, in `sequence<package/Name>`, `sequence<double, 3>` or `package/Name[3]`.
_ELEMENT = re.compile(r"(?:sequence<)?([\w/]+)")
_NESTED = re.compile(r"(\w+)/(\w+)")
_FLOATS = ("float", "double")
#: Characters that are shown of a value.
_MOST_SHOWN = 60


class DoesNotFit(ValueError):
    """Raised for values that a type has no place for."""


def filled(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return a message of a type with some values; raises DoesNotFit."""
    message = kind(check_fields=True)
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in types:
            raise DoesNotFit(f"{_name_of(kind)} has no field {name}")
        try:
            setattr(message, name, _value(types[name], value))
        except DoesNotFit:
            raise
        except (AssertionError, AttributeError, TypeError, ValueError, OverflowError) as problem:
            shown = repr(value)[:_MOST_SHOWN]
            words = f"the field {name} of {_name_of(kind)} is of type {types[name]}, and cannot hold {shown}"
            raise DoesNotFit(words) from problem
    return message


def fields_in(kind: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values with a field in a type: a student's type may have other fields."""
    types = kind.get_fields_and_field_types()
    return {name: value for name, value in values.items() if name in types}


def _value(spelled: str, value: Any) -> Any:
    """Return a value in the form that a field takes; `spelled` is the type of the field, e.g. "sequence<double>"."""
    if isinstance(value, (list, tuple)):
        return [_value(_element(spelled), each) for each in value]
    if isinstance(value, Mapping):
        nested = _NESTED.fullmatch(spelled)
        if nested is None:
            shown = repr(dict(value))[:_MOST_SHOWN]
            raise DoesNotFit(f"a field of type {spelled} cannot hold {shown}")
        return filled(interface_named(f"{nested[1]}/msg/{nested[2]}"), value)
    if isinstance(value, int) and not isinstance(value, bool) and spelled in _FLOATS:
        return float(value)
    return value


def _element(spelled: str) -> str:
    found = _ELEMENT.match(spelled)
    return found[1] if found is not None else spelled


def _name_of(kind: Any) -> str:
    """Return a type's name as ROS writes it: "std_msgs/msg/String"."""
    parts = kind.__module__.split(".")
    return "/".join([*parts[:2], kind.__name__])
