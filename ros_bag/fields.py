"""Known types and their fields: of installed packages, of ROS itself, and of packages that are not built.

Types are spelled as in `.msg` files: "float64[]", "geometry_msgs/msg/Point".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from typing import Any

from ros_bag.definitions import DefinitionNotFound, definition_of, share_folders
from ros_bag.interfaces import InterfacePackage, shipped_packages

_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
#: Packages of Jazzy in `rosbags`. Importing their descriptions takes 0.05 s.
PACKAGES_OF_ROSBAGS = frozenset(
    re.findall(
        r"\w+",
        """
    action_msgs actionlib_msgs builtin_interfaces diagnostic_msgs geometry_msgs lifecycle_msgs nav_msgs rcl_interfaces
    rmw_dds_common rosbag2_interfaces rosgraph_msgs sensor_msgs service_msgs shape_msgs statistics_msgs std_msgs
    stereo_msgs tf2_msgs trajectory_msgs type_description_interfaces unique_identifier_msgs visualization_msgs
        """,
    )
)
_PRIMITIVE_NUMBER = re.compile(r"float\d+|u?int\d+|bool|boolean|byte|octet|char|double|float")
#: Packages with definitions at hand, which need not be installed here.
_at_hand: ContextVar[tuple[InterfacePackage, ...]] = ContextVar("_at_hand", default=())


@contextmanager
def also_defined(packages: Sequence[InterfacePackage]) -> Iterator[None]:
    """Let `fields_of`, `types_in` and `packages_with` know these packages too, which are not built."""
    token = _at_hand.set(tuple(packages))
    try:
        yield
    finally:
        _at_hand.reset(token)


def _packages_at_hand() -> tuple[InterfacePackage, ...]:
    """Return the packages with definitions known without an installation; the first of a name counts."""
    return (*_at_hand.get(), *shipped_packages())


class NoSuchField(ValueError):
    """A type has no field of a name; it has the `known` ones."""

    def __init__(self, spelled: str, field: str, known: tuple[str, ...]) -> None:
        super().__init__(f"{spelled} has no field {field!r}")
        self.field = field
        self.known = known


# -- known types -----------------------------------------------------------------------------------


def fields_of(name: str) -> Mapping[str, str] | None:
    """Return the fields of a message type, with their types as `.msg` files spell them, e.g. "float64[]".

    The name may also be that of a service's request or response, such as "std_srvs/srv/SetBool_Request". None if the
    type is not known here.
    """
    for package in _packages_at_hand():
        if name in package.fields:
            return _spelled_fields(package.fields[name][1])
    return installed_fields(name)


@lru_cache(maxsize=1024)
def installed_fields(name: str) -> Mapping[str, str] | None:
    """Return the fields of a type that is installed, or of ROS itself."""
    try:
        known: Mapping[str, Any] = definition_of(name).types(name)
    except DefinitionNotFound:
        # Types of ROS itself are known on machines without ROS, too.
        known = _types_of_rosbags(name.partition("/")[0])
    if name in known:
        return _spelled_fields(known[name][1])
    return None


def _spelled_fields(fields: Sequence[tuple[str, tuple[int, Any]]]) -> Mapping[str, str]:
    return {field: _spelled(*kind) for field, kind in fields}


@lru_cache(maxsize=32)
def _types_of_rosbags(package: str) -> Mapping[str, Any]:
    """Return the types in `rosbags`; none for a package without types there."""
    if package not in PACKAGES_OF_ROSBAGS:
        return {}
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY).fielddefs


def _spelled(nodetype: int, kind: Any) -> str:
    """Spell a type of `rosbags`: 1 is a primitive, 2 a message, 3 an array, and 4 a sequence of one of these."""
    if nodetype in (3, 4):
        return f"{_spelled(*kind[0])}[]"
    if nodetype == 1:
        return str(kind[0])
    return str(kind)


def types_in(package: str, folder: str) -> tuple[str, ...]:
    """Return the types of a package in its folder ("msg", "srv"); none if the package is not known here."""
    found: set[str] = set()
    for own in _packages_at_hand():
        if own.name == package:
            found.update(name for name in own.types if f"/{folder}/" in name)
    if found:
        return tuple(sorted(found))
    return installed_types(package, folder)


@lru_cache(maxsize=64)
def installed_types(package: str, folder: str) -> tuple[str, ...]:
    """Return the types of a package that is installed, or of ROS itself."""
    found: set[str] = set()
    for share in share_folders():
        for path in (share / package / folder).glob(f"*.{folder}"):
            found.add(f"{package}/{folder}/{path.stem}")
    if found or folder != "msg":
        return tuple(sorted(found))
    described = []
    for name in _types_of_rosbags(package):
        if name.startswith(f"{package}/msg/"):
            described.append(name)
    return tuple(described)


def packages_with(folder: str) -> tuple[str, ...]:
    """Return the installed packages with types in a folder ("msg", "srv"), and those at hand."""
    packages = set()
    for share in share_folders():
        for path in share.glob(f"*/{folder}/*.{folder}"):
            packages.add(path.parts[-3])
    for own in _packages_at_hand():
        if any(f"/{folder}/" in name for name in own.types):
            packages.add(own.name)
    return tuple(sorted(packages))


# -- paths of fields -------------------------------------------------------------------------------


_FIELD_STEP = re.compile(r"\.?([A-Za-z_]\w*)|[.\[](\d+)\]?")
_FIELD_PATH = re.compile(r"[A-Za-z_]\w*(\.\w+|\[\d+\])*")


def field_steps(path: str) -> tuple[str | int, ...]:
    """Return the names and numbers of a field's path; raise `ValueError` if the text is not such a path.

    "pose.position.x", "transforms[0].child_frame_id"; a number may follow a dot too: "layout.dim.0.size".
    """
    if not _FIELD_PATH.fullmatch(path):
        raise ValueError(
            f"{path!r} is no path of a field such as pose.position.x or transforms[0].child_frame_id"
        )
    steps: list[str | int] = []
    for name, number in _FIELD_STEP.findall(path):
        steps.append(int(number) if number else name)
    return tuple(steps)


def type_at(name: str, path: str) -> str | None:
    """Return the type of a field as `.msg` files spell it; None if a type is unknown here.

    The type at `data` of "std_msgs/msg/Float64MultiArray" is "float64[]". Raises ValueError for an element of a type
    without elements, and `NoSuchField`.
    """
    spelled = name
    for step in field_steps(path):
        if isinstance(step, int):
            if not spelled.endswith("]"):
                raise ValueError(f"a {spelled} has no elements, so that [{step}] says nothing")
            spelled = spelled[: spelled.rindex("[")]
            continue
        fields = _fields_of_type(spelled)
        if fields is None:
            return None
        if step not in fields:
            raise NoSuchField(spelled, step, tuple(fields))
        spelled = fields[step]
    return spelled


def _fields_of_type(spelled: str) -> Mapping[str, str] | None:
    """Return the fields of a type, none for an array or a primitive; None if the type is unknown here."""
    if spelled.count("/") != 2 or spelled.endswith("]"):
        return {}
    return fields_of(spelled)


def is_number(spelled: str) -> bool:
    """Return whether a type, as `.msg` files spell it, is a number or a truth value."""
    return _PRIMITIVE_NUMBER.fullmatch(spelled) is not None


def holds_numbers(spelled: str) -> bool:
    """Return whether a type has numbers only: a number, a vector or quaternion, a time, or an array of these."""
    element = spelled.partition("[")[0]
    fields = _fields_of_type(element)
    if not fields:
        return fields is None or is_number(element)
    return all(map(holds_numbers, fields.values()))


def numbers_in(spelled: str) -> int | None:
    """Return the number of numbers in a type, one for a time; None if it is unknown, as for an array."""
    fields = _fields_of_type(spelled)
    if spelled.endswith("]") or fields is None:
        return None
    if not fields or spelled in _TIMES:
        return 1
    total = 0
    for each in fields.values():
        count = numbers_in(each)
        if count is None:
            return None
        total += count
    return total
