"""Message definitions as text, from the installed ROS packages.

A bag carries the definition of each of its types, and can be read on machines without ROS. Packages install the texts
and descriptions of their types in `share/<package>/<msg|srv|action>/`, with all types that services and actions imply.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ros_bag.interfaces import InterfacePackage, shipped_packages

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

SEPARATOR = "=" * 80

#: `char` as the type of a field or constant: "char[4] data".
_CHAR = re.compile(r"^\s*char\b(?=[\s\[])")
_TYPE_NAME = re.compile(r"([A-Za-z][A-Za-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)")
# Values of type_description_interfaces/msg/FieldType, as IDL spells the types.
_IDL_TYPES = {
    2: "int8", 3: "uint8", 4: "int16", 5: "uint16", 6: "int32", 7: "uint32", 8: "int64", 9: "uint64",
    10: "float", 11: "double", 12: "long double", 13: "char", 14: "wchar", 15: "boolean", 16: "octet",
    17: "string", 18: "wstring", 21: "string", 22: "wstring",
}  # fmt: skip
_NESTED = 1
_BOUNDED_STRINGS = (21, 22)
_WIDE = (14, 18, 20, 22)
#: Distance between the values of a type's forms: alone, in an array, in a bounded sequence, in a sequence.
_STEP = 48
_ARRAY = 1
_BOUNDED_SEQUENCE = 2
_SEQUENCE = 3


class DefinitionNotFound(LookupError):
    """No installed package defines the type."""

    def __init__(self, topic_type: str) -> None:
        super().__init__(
            f"no installed package defines {topic_type!r}; install the package that does, "
            "or add its prefix to AMENT_PREFIX_PATH"
        )


@dataclass(frozen=True)
class MessageDefinition:
    """The definition of a message type and of all types in it."""

    #: Name by which MCAP knows the language of the text: "ros2msg" for `.msg` files, "ros2idl" for all other types.
    encoding: Literal["ros2msg", "ros2idl"]
    #: `ros2msg`: the text of the `.msg` file, then a line of 80 `=`, `MSG: package/Type` and the text for each type
    #: that it depends on. `ros2idl`: for each type a line of 80 `=`, `IDL: package/folder/Type` and one struct.
    text: str

    def types(self, topic_type: str) -> Typesdict:
        """Return the types in it by their names, as `rosbags` describes them; `TypesysError` if it is not a definition."""
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        types: Typesdict = {}
        if self.encoding == "ros2msg":
            for name, (_, fields) in get_types_from_msg(self.text, topic_type).items():
                # A constant is not part of a message, but `rosbags` has a field for it.
                types[name] = ([], fields)
            return types
        text = re.sub(r"^IDL: .*", "", self.text, flags=re.MULTILINE)
        for block in text.split(SEPARATOR):
            if block.strip():
                types.update(get_types_from_idl(block))
        return types


def share_folders() -> tuple[Path, ...]:
    """Return the folders with the definitions of installed packages, in order of search."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    used = dict.fromkeys([*filter(None, prefixes), sys.prefix])
    return tuple(Path(prefix) / "share" for prefix in used)


def definition_of(topic_type: str) -> MessageDefinition:
    """Return the definition of a type such as "std_msgs/msg/String" or "std_srvs/srv/SetBool_Event".

    A type is defined by `.msg` texts, as in bags of rosbag2, if its package and the packages that it depends on install
    them, because many readers know no other language. Types that services and actions imply have no such text, and no
    reader knows wide strings in it: both are given as IDL.

    Raises
    ------
    DefinitionNotFound
        No installed package defines the type, or a type that it depends on.
    """
    fields = _needed_fields(topic_type)
    texts = [_msg_text(name) for name in fields]
    if None not in texts and not any(map(_has_wide_strings, fields.values())):
        return MessageDefinition("ros2msg", _joined(zip(fields, map(str, texts), strict=True)))
    blocks = []
    for name, members in fields.items():
        blocks.append(f"{SEPARATOR}\nIDL: {name}\n{_idl_struct(name, members)}\n")
    return MessageDefinition("ros2idl", "".join(blocks))


def _needed_fields(topic_type: str) -> dict[str, list[dict[str, Any]]]:
    """Return the described fields of a type and of each type that it depends on; the type itself comes first."""
    message = _description(topic_type, share_folders())["type_description_msg"]
    every = [message["type_description"], *message["referenced_type_descriptions"]]
    fields = {entry["type_name"]: entry["fields"] for entry in every}
    if topic_type not in fields:
        raise DefinitionNotFound(topic_type)
    needed = [topic_type]
    for name in needed:
        for field in fields[name]:
            nested = field["type"]["nested_type_name"]
            if nested and nested not in needed:
                needed.append(nested)
    return {name: fields[name] for name in needed}


def _has_wide_strings(fields: Sequence[Mapping[str, Any]]) -> bool:
    return any(field["type"]["type_id"] % _STEP in _WIDE for field in fields)


def _msg_text(name: str) -> str | None:
    """Return the installed `.msg` text of a type, with plain line ends; None if there is none."""
    package, folder, stem = name.split("/")
    if folder != "msg":
        return None
    for share in share_folders():
        if (share / package / folder / f"{stem}.json").is_file():
            return _plain_text(share / package / folder / f"{stem}.msg")
    return None


def _plain_text(file: Path) -> str | None:
    """Return a `.msg` text without the parts that readers of bags understand differently than rosidl.

    A ruler in a comment does not end the definition, each line ends with a line feed, and `char` is `uint8`.
    """
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    lines = (_CHAR.sub("uint8", line) for line in text.splitlines())
    return "\n".join(lines).replace(SEPARATOR, "")


def _joined(texts: Iterable[tuple[str, str]]) -> str:
    """Join the texts of a type and of those that it depends on, each under its heading but the first."""
    (_, root), *others = texts
    parts = [root]
    for name, text in others:
        package, _, stem = name.split("/")
        parts.append(f"{SEPARATOR}\nMSG: {package}/{stem}\n{text}")
    return "\n".join(parts) + "\n"


def type_hash_of(topic_type: str) -> str:
    """Return the hash ("RIHS01_...") of an installed type, or an empty text if readers of a bag cannot compute it.

    `rosbags` opens no bag at all if it knows no hash of one of the types, as of those with wide strings.
    """
    try:
        if any(map(_has_wide_strings, _needed_fields(topic_type).values())):
            return ""
        hashes = _description(topic_type, share_folders())["type_hashes"]
    except (DefinitionNotFound, KeyError):
        return ""
    return next((str(h["hash_string"]) for h in hashes if h["type_name"] == topic_type), "")


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
    """Return the packages whose definitions are known without an installation; the first of a name counts."""
    return (*_at_hand.get(), *shipped_packages())


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
        known = _types_of_rosbags()  # Types of ROS itself are known on machines without ROS, too.
    if name in known:
        return _spelled_fields(known[name][1])
    return None


def _spelled_fields(fields: Sequence[tuple[str, tuple[int, Any]]]) -> Mapping[str, str]:
    return {field: _spelled(*kind) for field, kind in fields}


@lru_cache(maxsize=1)
def _types_of_rosbags() -> Mapping[str, Any]:
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
    return tuple(name for name in _types_of_rosbags() if name.startswith(f"{package}/msg/"))


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


@lru_cache(maxsize=256)
def _description(topic_type: str, folders: tuple[Path, ...]) -> dict[str, Any]:
    """Return the installed type description (`.json`) that includes the type."""
    # The name comes from the graph, hence from students: it must not lead out of the folders.
    match = _TYPE_NAME.fullmatch(topic_type)
    if match is None:
        raise DefinitionNotFound(topic_type)
    package, kind, owner = match.groups()
    if kind != "msg":
        # Types that a service or an action implies (X_Event, X_Request, ...) are described with it; the name
        # of a service or an action itself has no underscore.
        owner = owner.partition("_")[0]
    for folder in folders:
        file = folder / package / kind / f"{owner}.json"
        try:
            description: dict[str, Any] = json.loads(file.read_bytes())
        except (OSError, ValueError):
            continue
        return description
    raise DefinitionNotFound(topic_type)


def _idl_struct(name: str, fields: list[dict[str, Any]]) -> str:
    package, folder, struct = name.split("/")
    members = ""
    for field in fields:
        members += f"      {_idl_member(field['name'], field['type'])};\n"
    return f"module {package} {{\n  module {folder} {{\n    struct {struct} {{\n{members}    }};\n  }};\n}};"


def _idl_member(name: str, kind: dict[str, Any]) -> str:
    container, element = divmod(kind["type_id"], _STEP)
    if element == _NESTED:
        spelled = kind["nested_type_name"].replace("/", "::")
    else:
        spelled = _IDL_TYPES[element]
        if element in _BOUNDED_STRINGS:
            spelled += f"<{kind['string_capacity']}>"
    if container == _ARRAY:
        return f"{spelled} {name}[{kind['capacity']}]"
    if container == _BOUNDED_SEQUENCE:
        return f"sequence<{spelled}, {kind['capacity']}> {name}"
    if container == _SEQUENCE:
        return f"sequence<{spelled}> {name}"
    return f"{spelled} {name}"
