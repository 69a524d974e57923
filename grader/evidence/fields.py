"""Values of messages' fields: as numbers and times, and such as stand in a step's result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grader.recording.definitions import field_steps

_NUMBERS = (bool, int, float, np.number, np.bool_)
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
#: Numbers that are taken one by one out of a message's value: a flood of nested ones is no vector.
_MOST_NESTED = 10_000


def numbers_of(value: Any) -> NDArray[np.float64] | None:
    """Return the numbers in a field's value, in the order of the definition: float64[n]; None if it holds others too.

    A number is one, a point three, a quaternion x, y, z and w, a time or duration its seconds.
    """
    if isinstance(value, np.ndarray):
        return value.astype(np.float64) if value.ndim == 1 and value.dtype.kind in "biuf" else None
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
    if is_number(value):
        yield float(value)
    elif (t_ns := time_ns(value)) is not None:
        yield t_ns / 1e9
    elif isinstance(value, (list, tuple, np.ndarray)):
        for element in value:
            yield from _numbers_in(element)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            yield from _numbers_in(getattr(value, name)) if not name.startswith("__") else ()
    else:
        raise TypeError(type(value).__name__)


def is_number(value: Any) -> bool:
    """Whether a field's value is one number, or true or false; so are the elements of arrays."""
    return isinstance(value, _NUMBERS)


def time_ns(value: Any) -> int | None:
    """Return a time stamp or duration of a message in ns; None if it is none: students may define types anew."""
    sec, nanosec = getattr(value, "sec", None), getattr(value, "nanosec", None)
    if (
        getattr(value, "__msgtype__", None) in _TIMES
        and isinstance(sec, int)
        and isinstance(nanosec, int)
    ):
        return sec * 10**9 + nanosec
    return None


def value_at(values: Any, path: str) -> Any:
    """Return the value of a field in a message that stands in a step's result as JSON; None where there is none."""
    try:
        for step in field_steps(path):
            values = values[step]
    except (IndexError, KeyError, TypeError):
        return None
    return values


def equal_within(got: Any, wanted: Any, tolerance: float) -> bool:
    """Whether a value of such a message is one of a rubric's, of which a mapping may leave out fields."""
    if isinstance(wanted, Mapping):
        pairs = ((value_at(got, path), value) for path, value in wanted.items())
        return isinstance(got, Mapping) and all(equal_within(*pair, tolerance) for pair in pairs)
    if isinstance(wanted, (list, tuple)):
        alike = isinstance(got, list) and len(got) == len(wanted)
        return alike and all(
            equal_within(a, b, tolerance) for a, b in zip(got, wanted, strict=True)
        )
    if isinstance(wanted, (int, float)) and isinstance(got, (int, float)):
        return bool(
            got == wanted or abs(got - wanted) <= tolerance
        )  # the difference of infinite ones is no number
    return bool(got == wanted)
