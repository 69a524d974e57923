"""Message definitions as text, found in the installed ROS packages.

A bag carries the definition of each of its types, so that it can be read where ROS is not
installed. Packages install the definitions in `share/<package>/<msg|srv|action>/`.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

SEPARATOR = "=" * 80

_TYPE_NAME = re.compile(r"([A-Za-z][A-Za-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)")
_PRIMITIVES = frozenset(
    {"bool", "byte", "char", "string", "wstring", "float32", "float64"}
    | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
)
_CHAR_FIELD = re.compile(r"^[ \t]*char\b", re.MULTILINE)
# Values of type_description_interfaces/msg/FieldType, as IDL spells the types.
_IDL_TYPES = {
    2: "int8", 3: "uint8", 4: "int16", 5: "uint16", 6: "int32", 7: "uint32", 8: "int64", 9: "uint64",
    10: "float", 11: "double", 12: "long double", 13: "char", 14: "wchar", 15: "boolean", 16: "octet",
    17: "string", 18: "wstring", 21: "string", 22: "wstring",
}  # fmt: skip
_NESTED, _BOUNDED_STRINGS = 1, (21, 22)
_ARRAY, _BOUNDED_SEQUENCE, _SEQUENCE, _STEP = 1, 2, 3, 48


class DefinitionNotFound(LookupError):
    """No installed package defines the type."""

    def __init__(self, topic_type: str) -> None:
        super().__init__(
            f"no installed package defines {topic_type!r}; install the package that does, "
            "or add its prefix to AMENT_PREFIX_PATH"
        )
        self.topic_type = topic_type


@dataclass(frozen=True)
class MessageDefinition:
    """The definition of a message type and of all types in it.

    Attributes
    ----------
    encoding : str
        "ros2msg" or "ros2idl", as MCAP names them.
    text : str
        `ros2msg`: the text of the `.msg` file, then a line of 80 `=`, `MSG: package/Type` and the text for
        each type it depends on. `ros2idl`: for each type a line of 80 `=`, `IDL: package/folder/Type` and
        one struct.
    """

    encoding: Literal["ros2msg", "ros2idl"]
    text: str


def share_folders() -> tuple[Path, ...]:
    """Folders in which packages install their definitions, in order of search."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    return tuple(Path(prefix) / "share" for prefix in dict.fromkeys([*prefixes, sys.prefix]))


def definition_of(topic_type: str) -> MessageDefinition:
    """Definition of a type such as "std_msgs/msg/String" or "std_srvs/srv/SetBool_Event".

    Raises
    ------
    DefinitionNotFound
        If no installed package defines the type, or a type that it depends on.
    """
    return _definition_in(topic_type, share_folders())


def type_hash_of(topic_type: str) -> str:
    """Hash ("RIHS01_...") of an installed type; empty where the package does not tell it."""
    return _hash_in(topic_type, share_folders())


@lru_cache(maxsize=1024)
def fields_of(name: str) -> Mapping[str, str] | None:
    """Return the fields of a message type, or of a service's request or response, with their types.

    Parameters
    ----------
    name : str
        "std_msgs/msg/String", or "std_srvs/srv/SetBool_Request" and "..._Response".

    Returns
    -------
    mapping or None
        Field -> type as `.msg` files spell it, e.g. "float64[]"; None where the type is not known here.
    """
    package, folder, short = name.split("/")
    owner, _, part = short.partition("_")
    try:
        if folder == "srv":
            halves = re.split(r"^---.*$", _find(f"{package}/srv/{owner}", ".srv", share_folders()), flags=re.MULTILINE)
            return _fields_in(halves[part != "Request"], package)
        return _fields_in(_find(name, ".msg", share_folders()), package)
    except DefinitionNotFound:
        return _fields_in_rosbags(name)


def _fields_in(text: str, package: str) -> dict[str, str]:
    lines = [line.split("#", 1)[0].split() for line in text.splitlines()]
    # What has a "=" is a constant; a bound of a string is written as "<=".
    fields = [words for words in lines if len(words) > 1 and not any(word.startswith("=") for word in words[1:3])]
    return {words[1]: _full_type(words[0], package) for words in fields if "=" not in words[1]}


def _full_type(spelled: str, package: str) -> str:
    """Write "Header[]" as "std_msgs/msg/Header[]"."""
    name = re.split(r"[\[<]", spelled, maxsplit=1)[0]
    if name in _PRIMITIVES:
        return spelled
    parts = name.split("/")
    return f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}{spelled[len(name) :]}"


def _fields_in_rosbags(name: str) -> dict[str, str] | None:
    """Return the fields of a message type of ROS itself where ROS is not installed, as where one only regrades."""
    known = _types_of_rosbags().get(name)
    return {field: _spelled(*kind) for field, kind in known[1]} if known is not None else None


@lru_cache(maxsize=1)
def _types_of_rosbags() -> Mapping[str, Any]:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY).fielddefs


def _spelled(nodetype: int, kind: Any) -> str:
    """Spell a type of `rosbags`: 1 is a primitive, 2 a message, 3 an array, and 4 a sequence of one of these."""
    if nodetype in (3, 4):
        return f"{_spelled(*kind[0])}[]"
    return str(kind[0] if nodetype == 1 else kind)


@lru_cache(maxsize=64)
def types_in(package: str, folder: str) -> tuple[str, ...]:
    """Return the types of a package in its folder ("msg", "srv"); none where the package is not known here."""
    found = {path.stem for share in share_folders() for path in (share / package / folder).glob(f"*.{folder}")}
    if found or folder != "msg":
        return tuple(f"{package}/{folder}/{stem}" for stem in sorted(found))
    return tuple(name for name in _types_of_rosbags() if name.startswith(f"{package}/msg/"))


def packages_with(folder: str) -> tuple[str, ...]:
    """Return the packages that are installed here and have such types."""
    return tuple(sorted({path.parts[-3] for share in share_folders() for path in share.glob(f"*/{folder}/*.{folder}")}))


@lru_cache(maxsize=1024)
def _definition_in(topic_type: str, folders: tuple[Path, ...]) -> MessageDefinition:
    try:
        texts = _message_texts(topic_type, folders)
    except DefinitionNotFound:
        texts = {}
    # `rosbags` takes `char` for another type than ROS does, and refuses a whole bag for the hash of one
    # such topic. The IDL says `uint8`.
    if not texts or any(_CHAR_FIELD.search(text) for text in texts.values()):
        return MessageDefinition("ros2idl", _idl_text(topic_type, folders))
    root = texts.pop(topic_type)
    blocks = [f"{SEPARATOR}\nMSG: {name.replace('/msg/', '/')}\n{text}" for name, text in texts.items()]
    return MessageDefinition("ros2msg", "\n".join([root, *blocks]))


def _message_texts(root: str, folders: tuple[Path, ...]) -> dict[str, str]:
    """Text of the `.msg` files of `root` and of all that it depends on, `root` first."""
    texts: dict[str, str] = {}
    open_types = [root]
    while open_types:
        name = open_types.pop(0)
        if name not in texts:
            texts[name] = _find(name, ".msg", folders)
            open_types += _dependencies(texts[name], name.split("/")[0])
    return texts


def _find(topic_type: str, suffix: str, folders: tuple[Path, ...]) -> str:
    # The name comes from the graph, hence from students: it must not lead out of the folders.
    match = _TYPE_NAME.fullmatch(topic_type)
    if match is None or (suffix == ".msg" and match[2] != "msg"):
        raise DefinitionNotFound(topic_type)
    for folder in folders:
        try:
            return (folder / match[1] / match[2] / (match[3] + suffix)).read_text(encoding="utf-8")
        except (OSError, ValueError):
            continue
    raise DefinitionNotFound(topic_type)


def _dependencies(text: str, package: str) -> Iterator[str]:
    for line in text.splitlines():
        words = line.split("#", 1)[0].split()
        full = _full_type(words[0], package) if words else ""
        if "/" in full:
            yield re.split(r"[\[<]", full, maxsplit=1)[0]


def _description(topic_type: str, folders: tuple[Path, ...]) -> dict[str, Any]:
    """The installed type description (`.json`) that includes the type."""
    # Types that a service or an action implies (X_Event, X_Request, ...) are described with it; the name
    # of a service or an action itself has no underscore.
    folder, _, name = topic_type.rpartition("/")
    owner = topic_type if folder.endswith("/msg") else f"{folder}/{name.partition('_')[0]}"
    description: dict[str, Any] = json.loads(_find(owner, ".json", folders))
    return description


def _idl_text(topic_type: str, folders: tuple[Path, ...]) -> str:
    message = _description(topic_type, folders)["type_description_msg"]
    every = [message["type_description"], *message["referenced_type_descriptions"]]
    fields = {entry["type_name"]: entry["fields"] for entry in every}
    if topic_type not in fields:
        raise DefinitionNotFound(topic_type)
    needed = [topic_type]
    for name in needed:
        nested = (field["type"]["nested_type_name"] for field in fields[name])
        needed += [n for n in dict.fromkeys(nested) if n and n not in needed]
    return "\n".join(f"{SEPARATOR}\nIDL: {name}\n{_idl_struct(name, fields[name])}" for name in needed) + "\n"


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


@lru_cache(maxsize=1024)
def _hash_in(topic_type: str, folders: tuple[Path, ...]) -> str:
    try:
        hashes = _description(topic_type, folders)["type_hashes"]
    except (DefinitionNotFound, KeyError, ValueError):
        return ""
    return next((str(h["hash_string"]) for h in hashes if h["type_name"] == topic_type), "")
