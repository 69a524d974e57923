"""Loads libraries of the middleware before a process forks, because each fork would load them anew."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from contextlib import suppress

#: Kinds of type support that rmw_fastrtps_cpp opens at the first use of a package's type.
_KINDS = ("fastrtps_c", "introspection_c")


def load_type_support(types: Iterable[str]) -> None:
    """Load the type support of the packages of some types, such as "std_msgs/msg/String", if there is any."""
    packages = {name.partition("/")[0] for name in types}
    for package in sorted(packages):
        for kind in _KINDS:
            with suppress(OSError):
                ctypes.CDLL(f"lib{package}__rosidl_typesupport_{kind}.so")
