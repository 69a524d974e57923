"""Values of messages' fields as numbers and times."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
#: Numbers that are taken one by one out of a message's value: a flood of nested ones is no vector.
_MOST_NESTED = 1000


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
    if isinstance(value, (bool, int, float, np.number)):
        yield float(value)
    elif getattr(value, "__msgtype__", None) in _TIMES:
        yield time_ns(value) / 1e9
    elif isinstance(value, (list, tuple, np.ndarray)):
        for element in value:
            yield from _numbers_in(element)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            yield from _numbers_in(getattr(value, name)) if not name.startswith("__") else ()
    else:
        raise TypeError(type(value).__name__)


def time_ns(value: Any) -> int:
    """Return a time stamp or duration of a message in ns."""
    return int(value.sec) * 10**9 + int(value.nanosec)
