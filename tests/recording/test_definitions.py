"""Definitions found in the installed packages are those that others decode by."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from grader.recording.definitions import (
    SEPARATOR,
    DefinitionNotFound,
    MessageDefinition,
    definition_of,
    share_folders,
    type_hash_of,
)


def installed_types() -> list[str]:
    """All message types, and all types that services imply, of the installed packages."""
    share = Path(sys.prefix) / "share"
    messages = [f"{path.parts[-3]}/msg/{path.stem}" for path in share.glob("*/msg/*.msg")]
    services = [f"{path.parts[-3]}/srv/{path.stem}" for path in share.glob("*/srv/*.srv")]
    return messages + [f"{name}_{part}" for name in services for part in ("Request", "Response", "Event")]


def hash_by_rosbags(topic_type: str, definition: MessageDefinition) -> str:
    """The type's hash, computed by `rosbags` from the definition's text alone."""
    store = get_typestore(Stores.EMPTY)
    if definition.encoding == "ros2msg":
        store.register(get_types_from_msg(definition.text, topic_type))
    else:
        for block in definition.text.split(SEPARATOR + "\n")[1:]:
            store.register(get_types_from_idl(block.partition("\n")[2]))
    return store.hash_rihs01(topic_type)


def test_every_installed_definition_gives_the_types_hash() -> None:
    """The text of each definition leads another implementation to the hash that the package tells."""
    types = installed_types()
    if not types:
        pytest.skip("no ROS packages are installed")
    wrong = [name for name in types if hash_by_rosbags(name, definition_of(name)) != type_hash_of(name)]
    assert wrong == []


def test_text_format() -> None:
    """Messages come as their own text with dependencies after it, service events as IDL structs."""
    floats = definition_of("std_msgs/msg/Float64MultiArray")
    assert floats.encoding == "ros2msg"
    headings = [line for line in floats.text.splitlines() if line.startswith("MSG: ")]
    assert headings == ["MSG: std_msgs/MultiArrayLayout", "MSG: std_msgs/MultiArrayDimension"]
    event = definition_of("std_srvs/srv/SetBool_Event")
    assert event.encoding == "ros2idl"
    assert event.text.startswith(f"{SEPARATOR}\nIDL: std_srvs/srv/SetBool_Event\n")
    assert "#include" not in event.text


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


def test_packages_on_the_prefix_path_come_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Packages below AMENT_PREFIX_PATH are found, and their dependencies in the same package."""
    folder = tmp_path / "share" / "own" / "msg"
    folder.mkdir(parents=True)
    (folder / "Outer.msg").write_text("int32 LIMIT=3 # a constant\nInner[<=4] parts\nstring<=5 name\n")
    (folder / "Inner.msg").write_text("builtin_interfaces/Time stamp\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert share_folders()[0] == tmp_path / "share"
    text = definition_of("own/msg/Outer").text
    assert [line for line in text.splitlines() if line.startswith("MSG: ")] == [
        "MSG: own/Inner",
        "MSG: builtin_interfaces/Time",
    ]
