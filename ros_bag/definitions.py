"""Message definitions as text, from the installed ROS packages.

A bag carries the definition of each of its types, and can be read on machines without ROS. Packages install the texts
and descriptions of their types in `share/<package>/<msg|srv|action>/`, with all types that services and actions imply.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

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
        from rosbags.typesys import get_types_from_msg

        types: Typesdict = {}
        if self.encoding == "ros2msg":
            for name, (_, fields) in get_types_from_msg(self.text, topic_type).items():
                # A constant is not part of a message, but `rosbags` has a field for it.
                types[name] = ([], fields)
            return types
        text = re.sub(r"^IDL: .*", "", self.text, flags=re.MULTILINE)
        for block in text.split(SEPARATOR):
            if block.strip():
                types.update(_types_of_idl(block))
        return types


@lru_cache(maxsize=256)
def _types_of_idl(text: str) -> Typesdict:
    """Return the types in a block of IDL; services share blocks, and a block takes 2 ms."""
    from rosbags.typesys import get_types_from_idl

    return get_types_from_idl(text)


def share_folders() -> tuple[Path, ...]:
    """Return the folders with the definitions of installed packages, in order of search."""
    return _share_folders(os.environ.get("AMENT_PREFIX_PATH", ""), sys.prefix)


@lru_cache(maxsize=4)
def _share_folders(searched: str, last: str) -> tuple[Path, ...]:
    prefixes = filter(None, searched.split(os.pathsep))
    used = dict.fromkeys([*prefixes, last])
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
    folders = share_folders()
    fields = _needed_fields(topic_type, folders)
    texts = [_msg_text(name, folders) for name in fields]
    has_wide_strings = any(map(_has_wide_strings, fields.values()))
    if None not in texts and not has_wide_strings:
        named = zip(fields, map(str, texts), strict=True)
        return MessageDefinition("ros2msg", _joined(named))
    blocks = []
    for name, members in fields.items():
        blocks.append(f"{SEPARATOR}\nIDL: {name}\n{_idl_struct(name, members)}\n")
    return MessageDefinition("ros2idl", "".join(blocks))


def _needed_fields(topic_type: str, folders: tuple[Path, ...]) -> dict[str, list[dict[str, Any]]]:
    """Return the described fields of a type and of each type that it depends on; the type itself comes first."""
    message = _description(topic_type, folders)["type_description_msg"]
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


def _msg_text(name: str, folders: tuple[Path, ...]) -> str | None:
    """Return the installed `.msg` text of a type, with plain line ends; None if there is none."""
    with suppress(OSError):
        return _plain_text(name, folders)
    return None


@lru_cache(maxsize=256)
def _plain_text(name: str, folders: tuple[Path, ...]) -> str:
    """Return a `.msg` text without the parts that readers of bags understand differently than rosidl.

    A ruler in a comment does not end the definition, each line ends with a line feed, and `char` is `uint8`. Raises
    OSError if there is no text, because the cache keeps no error: a text installed later is found.
    """
    package, folder, stem = name.split("/")
    if folder != "msg":
        raise FileNotFoundError(name)
    for share in folders:
        place = share / package
        described = place / folder / f"{stem}.json"
        if described.is_file():
            file = described.with_suffix(".msg")
            text = file.read_text(encoding="utf-8", errors="replace")
            lines = [_CHAR.sub("uint8", line) for line in text.splitlines()]
            plain = "\n".join(lines)
            return plain.replace(SEPARATOR, "")
    raise FileNotFoundError(name)


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
        return _type_hash(topic_type, share_folders())
    except (DefinitionNotFound, KeyError):
        return ""


@lru_cache(maxsize=256)
def _type_hash(topic_type: str, folders: tuple[Path, ...]) -> str:
    needed = _needed_fields(topic_type, folders)
    if any(map(_has_wide_strings, needed.values())):
        return ""
    for described in _description(topic_type, folders)["type_hashes"]:
        if described["type_name"] == topic_type:
            return str(described["hash_string"])
    return ""


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
