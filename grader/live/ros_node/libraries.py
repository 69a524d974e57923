"""Loads libraries of the middleware before a process forks, because each fork would load them anew."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from contextlib import suppress

#: Kinds of type support that rmw_fastrtps_cpp opens at the first use of a package's type.
_KINDS = ("fastrtps_c", "introspection_c")
#: `TypeObjectFactory::get_instance()` of Fast DDS 2: it builds a table of types, which takes 1 ms, and starts no thread.
_TABLE_OF_TYPES = "_ZN8eprosima8fastrtps5types17TypeObjectFactory12get_instanceEv"


def load_type_support(types: Iterable[str]) -> None:
    """Load the type support of the packages of some types, such as "std_msgs/msg/String", if there is any."""
    packages = {name.partition("/")[0] for name in types}
    for package in sorted(packages):
        for kind in _KINDS:
            with suppress(OSError):
                ctypes.CDLL(f"lib{package}__rosidl_typesupport_{kind}.so")


def build_table_of_types() -> None:
    """Build the table of types that Fast DDS would build with the first participant of each process."""
    # Another version of Fast DDS may have no such function, or no such library.
    with suppress(OSError, AttributeError):
        build = getattr(ctypes.CDLL("librmw_fastrtps_cpp.so"), _TABLE_OF_TYPES)
        build.restype = ctypes.c_void_p
        build()
