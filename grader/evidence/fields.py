"""Values of messages' fields as numbers and times, and in the JSON of a step's result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ros_bag.definitions import field_steps

_NUMBERS = (bool, int, float, np.number, np.bool_)
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
#: Numbers that are read one by one from a field's value; a larger number of nested values is not a vector.
_MOST_NESTED = 10_000


def numbers_of(value: Any) -> NDArray[np.float64] | None:
    """Return the numbers in a field's value, in the order of the definition: float64[n]; None for other contents.

    A number gives one, a point x, y and z, a quaternion x, y, z and w, and a time or duration its seconds.
    """
    if isinstance(value, np.ndarray):
        if value.ndim != 1 or value.dtype.kind not in "biuf":
            return None
        return value.astype(np.float64)
    row = []
    try:
        for number in _numbers_in(value):
            row.append(number)
            if len(row) > _MOST_NESTED:
                return None
    except TypeError:
        return None
    return np.array(row, dtype=np.float64)


def _numbers_in(value: Any) -> Iterator[float]:
    """Yield the numbers in a value; raises TypeError for other contents."""
    if is_number(value):
        yield float(value)
        return
    t_ns = time_ns(value)
    if t_ns is not None:
        yield t_ns / 1e9
    elif isinstance(value, (list, tuple, np.ndarray)):
        for element in value:
            yield from _numbers_in(element)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            if not name.startswith("__"):
                yield from _numbers_in(getattr(value, name))
    else:
        raise TypeError(type(value).__name__)


def is_number(value: Any) -> bool:
    """Return whether a field's value, or an element of an array, is a number or a truth value."""
    return isinstance(value, _NUMBERS)


def time_ns(value: Any) -> int | None:
    """Return a time stamp or duration of a message in ns; None for another value.

    A student's workspace can define the types again, with other fields.
    """
    if getattr(value, "__msgtype__", None) not in _TIMES:
        return None
    sec = getattr(value, "sec", None)
    nanosec = getattr(value, "nanosec", None)
    if isinstance(sec, int) and isinstance(nanosec, int):
        return sec * 10**9 + nanosec
    return None


def value_at(values: Any, path: str) -> Any:
    """Return the value of a field in a message of a step's result, given as JSON; None if the field is missing."""
    try:
        for step in field_steps(path):
            values = values[step]
    except (IndexError, KeyError, TypeError):
        return None
    return values


def equal_within(got: Any, wanted: Any, tolerance: float) -> bool:
    """Return whether a value of a step's result equals a rubric's value within a tolerance.

    A mapping of the rubric can leave out fields: `{"pose.x": 1.0}` equals every pose with this x.
    """
    if isinstance(wanted, Mapping):
        is_mapping = isinstance(got, Mapping)
        pairs = [(value_at(got, path), value) for path, value in wanted.items()]
        return is_mapping and _pairs_equal(pairs, tolerance)
    if isinstance(wanted, (list, tuple)):
        is_alike = isinstance(got, list) and len(got) == len(wanted)
        return is_alike and _pairs_equal(zip(got, wanted, strict=True), tolerance)
    if got == wanted:
        return True
    if isinstance(wanted, (int, float)) and isinstance(got, (int, float)):
        # The difference of equal infinite numbers is NaN.
        return bool(abs(got - wanted) <= tolerance)
    return False


def _pairs_equal(pairs: Iterable[tuple[Any, Any]], tolerance: float) -> bool:
    return all(equal_within(got, wanted, tolerance) for got, wanted in pairs)
