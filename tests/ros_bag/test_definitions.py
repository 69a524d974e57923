"""Definitions found in the installed packages are those that others decode by."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from ros_bag.definitions import (
    SEPARATOR,
    DefinitionNotFound,
    MessageDefinition,
    definition_of,
    share_folders,
    type_hash_of,
)
from ros_bag.fields import fields_of

#: Types with wide strings; `rosbags` has no hash of them.
WIDE = ("test_msgs/msg/WStrings",)


def installed_types() -> list[str]:
    """All message types, and all types that services and actions imply, of the installed packages."""
    share = Path(sys.prefix) / "share"
    messages = [f"{path.parts[-3]}/msg/{path.stem}" for path in share.glob("*/msg/*.msg")]
    services = [f"{path.parts[-3]}/srv/{path.stem}" for path in share.glob("*/srv/*.srv")]
    actions = [f"{path.parts[-3]}/action/{path.stem}" for path in share.glob("*/action/*.action")]
    implied = []
    for name in services:
        for part in ("Request", "Response", "Event"):
            implied.append(f"{name}_{part}")
    implied += [
        f"{name}_{part}"
        for name in actions
        for part in ("Goal", "Result", "Feedback", "FeedbackMessage")
    ]
    return messages + implied


def hash_by_rosbags(topic_type: str, definition: MessageDefinition) -> str:
    """The type's hash, computed by `rosbags` from the definition's text alone."""
    store = get_typestore(Stores.EMPTY)
    store.register(definition.types(topic_type))
    return store.hash_rihs01(topic_type)


def test_every_installed_definition_gives_the_types_hash() -> None:
    """The text of each definition leads another implementation to the hash that the package tells."""
    types = [name for name in installed_types() if name not in WIDE]
    if not types:
        pytest.skip("no ROS packages are installed")
    wrong = []
    for name in types:
        if hash_by_rosbags(name, definition_of(name)) != type_hash_of(name):
            wrong.append(name)
    assert wrong == []
    assert all(type_hash_of(name) == "" for name in WIDE)


def test_text_format() -> None:
    """A message comes as its `.msg` text, each dependency below a ruler; a service event as IDL structs."""
    floats = definition_of("std_msgs/msg/Float64MultiArray")
    assert floats.encoding == "ros2msg"
    root, *others = floats.text.split(f"{SEPARATOR}\n")
    assert re.search(r"^float64\[\] +data\b", root, re.MULTILINE)
    assert [text.split("\n")[0] for text in others] == [
        f"MSG: std_msgs/{name}" for name in ("MultiArrayLayout", "MultiArrayDimension")
    ]
    event = definition_of("std_srvs/srv/SetBool_Event")
    assert event.encoding == "ros2idl"
    assert event.text.startswith(f"{SEPARATOR}\nIDL: std_srvs/srv/SetBool_Event\n")


def test_constants_are_no_fields() -> None:
    """A decoded message has the sent fields, and no others."""
    name = "sensor_msgs/msg/NavSatStatus"
    store = get_typestore(Stores.EMPTY)
    store.register(definition_of(name).types(name))
    fields = dataclasses.fields(store.types[name])  # type: ignore[arg-type]
    assert [field.name for field in fields] == ["status", "service", "__msgtype__"]


@pytest.mark.parametrize(
    "name",
    ["", "String", "nowhere/msg/Thing", "std_msgs/msg/Thing", "std_srvs/srv/SetBool_Thing",
     "../std_msgs/msg/String", "std_msgs/msg/../msg/String", "std_msgs/txt/String", "std_msgs/msg/String\n"],
)  # fmt: skip
def test_unknown_types_are_named(name: str) -> None:
    """A type that no package defines, or a name that leads elsewhere, is refused, and has no hash."""
    with pytest.raises(DefinitionNotFound, match="no installed package defines"):
        definition_of(name)
    assert type_hash_of(name) == ""


def test_packages_on_the_prefix_path_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packages below AMENT_PREFIX_PATH are found, with the bounds of their strings and sequences, and odd line ends."""
    folder = tmp_path / "share" / "own" / "msg"
    folder.mkdir(parents=True)
    kinds = {"parts": {"type_id": 97, "capacity": 4, "nested_type_name": "own/msg/Inner"},
             "name": {"type_id": 21, "string_capacity": 5, "nested_type_name": ""}}  # fmt: skip
    inner = [{"name": "x", "type": {"type_id": 6, "nested_type_name": ""}}]
    outer = [{"name": name, "type": kind} for name, kind in kinds.items()]
    message = {
        "type_description": {"type_name": "own/msg/Outer", "fields": outer},
        "referenced_type_descriptions": [{"type_name": "own/msg/Inner", "fields": inner}],
    }
    description = json.dumps({"type_description_msg": message})
    (folder / "Outer.json").write_text(description)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert share_folders()[0] == tmp_path / "share"
    # Without the texts, there is the description.
    text = definition_of("own/msg/Outer").text
    assert "sequence<own::msg::Inner, 4> parts" in text
    assert "string<5> name" in text
    assert fields_of("own/msg/Outer") == {"parts": "own/msg/Inner[]", "name": "string"}

    (folder / "Outer.msg").write_bytes(
        f"# {SEPARATOR}====\r\nInner[<=4] parts # {SEPARATOR}\r\nstring<=5 name\r\n".encode()
    )
    (folder / "Inner.json").write_text(description)
    (folder / "Inner.msg").write_bytes("char A=5\x0c char x # \xe4\n".encode("latin-1"))
    definition = definition_of("own/msg/Outer")
    assert definition.encoding == "ros2msg"
    assert definition.text.count(SEPARATOR) == 1
    assert "\nMSG: own/Inner\nuint8 A=5\nuint8 x" in definition.text
    types = definition.types("own/msg/Outer")
    assert types["own/msg/Inner"][1] == [("x", (1, ("uint8", 0)))]
