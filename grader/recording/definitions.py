"""Message definitions as text, found in the installed ROS packages.

A bag carries the definition of each of its types, so that it can be read where ROS is not installed. Packages install
the texts and descriptions of their types in `share/<package>/<msg|srv|action>/`, with all that services and actions imply.
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

from grader.recording.interfaces import InterfacePackage

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
_NESTED, _BOUNDED_STRINGS, _WIDE = 1, (21, 22), (14, 18, 20, 22)
_ARRAY, _BOUNDED_SEQUENCE, _SEQUENCE, _STEP = 1, 2, 3, 48


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
        """Return the types in it by their names, as `rosbags` describes them; `TypesysError` if it is no definition."""
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        if self.encoding == "ros2msg":
            found = get_types_from_msg(self.text, topic_type)
            # A constant is no part of a message, but `rosbags` has a field for it.
            return {name: ([], fields) for name, (_, fields) in found.items()}
        blocks = re.sub(r"^IDL: .*", "", self.text, flags=re.MULTILINE).split(SEPARATOR)
        return {
            name: kind
            for block in blocks
            if block.strip()
            for name, kind in get_types_from_idl(block).items()
        }


def share_folders() -> tuple[Path, ...]:
    """Folders in which packages install their definitions, in order of search."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    return tuple(Path(prefix) / "share" for prefix in dict.fromkeys([*prefixes, sys.prefix]))


def definition_of(topic_type: str) -> MessageDefinition:
    """Return the definition of a type such as "std_msgs/msg/String" or "std_srvs/srv/SetBool_Event".

    A type is defined by `.msg` texts where its package and those that it depends on install them, as in bags of rosbag2:
    many readers know no other language. Types that services and actions imply have no such text, and no reader knows
    wide strings in it: both are given as IDL.

    Raises
    ------
    DefinitionNotFound
        No installed package defines the type, or a type that it depends on.
    """
    fields = _needed_fields(topic_type)
    texts = [_msg_text(name) for name in fields]
    if None not in texts and not any(map(_has_wide_strings, fields.values())):
        return MessageDefinition("ros2msg", _joined(zip(fields, map(str, texts), strict=True)))
    text = "\n".join(
        f"{SEPARATOR}\nIDL: {name}\n{_idl_struct(name, fields[name])}" for name in fields
    )
    return MessageDefinition("ros2idl", text + "\n")


def _needed_fields(topic_type: str) -> dict[str, list[dict[str, Any]]]:
    """Return the described fields of a type and of each type that it depends on; the type itself comes first."""
    message = _description(topic_type, share_folders())["type_description_msg"]
    every = [message["type_description"], *message["referenced_type_descriptions"]]
    fields = {entry["type_name"]: entry["fields"] for entry in every}
    if topic_type not in fields:
        raise DefinitionNotFound(topic_type)
    needed = [topic_type]
    for name in needed:
        nested = (field["type"]["nested_type_name"] for field in fields[name])
        needed += [n for n in dict.fromkeys(nested) if n and n not in needed]
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
    """Return a `.msg` text without what readers of bags take for something else than rosidl does.

    A ruler in a comment is no end of the definition, each line ends with a line feed, and `char` is `uint8`.
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


#: Packages whose definitions are at hand, and which need not be installed here.
_at_hand: ContextVar[tuple[InterfacePackage, ...]] = ContextVar("_at_hand", default=())


@contextmanager
def also_defined(packages: Sequence[InterfacePackage]) -> Iterator[None]:
    """Let `fields_of`, `types_in` and `packages_with` know these packages too, as they are written."""
    token = _at_hand.set(tuple(packages))
    try:
        yield
    finally:
        _at_hand.reset(token)


_FIELD_STEP = re.compile(r"\.?([A-Za-z_]\w*)|[.\[](\d+)\]?")
_FIELD_PATH = re.compile(r"[A-Za-z_]\w*(\.\w+|\[\d+\])*")


def field_steps(path: str) -> tuple[str | int, ...]:
    """Return the names and numbers of a field's path; `ValueError` if it is none.

    "pose.position.x", "transforms[0].child_frame_id"; a number may stand behind a dot too: "layout.dim.0.size".
    """
    if not _FIELD_PATH.fullmatch(path):
        raise ValueError(
            f"{path!r} is no path of a field such as pose.position.x or transforms[0].child_frame_id"
        )
    return tuple(int(number) if number else name for name, number in _FIELD_STEP.findall(path))


def fields_of(name: str) -> Mapping[str, str] | None:
    """Return the fields of a message type, with their types as `.msg` files spell them, e.g. "float64[]".

    The name may be that of a service's request or response too: "std_srvs/srv/SetBool_Request". None where it is not
    known here.
    """
    own = next((package.fields[name] for package in _at_hand.get() if name in package.fields), None)
    return _spelled_fields(own[1]) if own is not None else installed_fields(name)


@lru_cache(maxsize=1024)
def installed_fields(name: str) -> Mapping[str, str] | None:
    """Return those of a type that is installed, or of ROS itself."""
    try:
        known: Mapping[str, Any] = definition_of(name).types(name)
    except DefinitionNotFound:
        known = _types_of_rosbags()  # ROS itself is known also where one only judges again.
    return _spelled_fields(known[name][1]) if name in known else None


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
    return str(kind[0] if nodetype == 1 else kind)


def types_in(package: str, folder: str) -> tuple[str, ...]:
    """Return the types of a package in its folder ("msg", "srv"); none where the package is not known here."""
    own = (name for each in _at_hand.get() if each.name == package for name in each.types)
    found = tuple(sorted(name for name in own if f"/{folder}/" in name))
    if found:
        return found
    return installed_types(package, folder)


@lru_cache(maxsize=64)
def installed_types(package: str, folder: str) -> tuple[str, ...]:
    """Return those of a package that is installed, or of ROS itself."""
    found = {
        path.stem
        for share in share_folders()
        for path in (share / package / folder).glob(f"*.{folder}")
    }
    if found or folder != "msg":
        return tuple(f"{package}/{folder}/{stem}" for stem in sorted(found))
    return tuple(name for name in _types_of_rosbags() if name.startswith(f"{package}/msg/"))


def packages_with(folder: str) -> tuple[str, ...]:
    """Return the packages that are installed here and have such types."""
    installed = {
        path.parts[-3] for share in share_folders() for path in share.glob(f"*/{folder}/*.{folder}")
    }
    own = {
        each.name for each in _at_hand.get() if any(f"/{folder}/" in name for name in each.types)
    }
    return tuple(sorted(installed | own))


@lru_cache(maxsize=256)
def _description(topic_type: str, folders: tuple[Path, ...]) -> dict[str, Any]:
    """The installed type description (`.json`) that includes the type."""
    # The name comes from the graph, hence from students: it must not lead out of the folders.
    match = _TYPE_NAME.fullmatch(topic_type)
    if match is None:
        raise DefinitionNotFound(topic_type)
    # Types that a service or an action implies (X_Event, X_Request, ...) are described with it; the name
    # of a service or an action itself has no underscore.
    owner = match[3] if match[2] == "msg" else match[3].partition("_")[0]
    for folder in folders:
        try:
            description: dict[str, Any] = json.loads(
                (folder / match[1] / match[2] / f"{owner}.json").read_bytes()
            )
        except (OSError, ValueError):
            continue
        return description
    raise DefinitionNotFound(topic_type)


def _idl_struct(name: str, fields: list[dict[str, Any]]) -> str:
    package, folder, struct = name.split("/")
    members = "".join(f"      {_idl_member(field['name'], field['type'])};\n" for field in fields)
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
    return f"sequence<{spelled}> {name}" if container == _SEQUENCE else f"{spelled} {name}"
