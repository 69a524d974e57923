"""Bags as other people's readers see them: every message of every installed type is decoded."""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from ros_bag.reading import Bag
from ros_bag.writing import METADATA_FILE
from tests.ros_bag.sample_messages import Sent, message_types, same, write_all_types

pytestmark = pytest.mark.slow

pytest.importorskip("rclpy")

#: Packages of npm that read a bag as Foxglove and Lichtblick do.
NPM = (
    "@mcap/core@2.2.2",
    "@mcap/support@1.1.0",
    "@foxglove/rosmsg@5.0.5",
    "@foxglove/rosmsg2-serialization@3.1.0",
    "@foxglove/ros2idl-parser@0.3.5",
)
PROGRAM = Path(__file__).with_name("read_bag.mjs")
#: Types that a reader does not know in any form: wide strings; and for Foxglove's, messages that have constants only.
WIDE = {"/test_msgs_msg_WStrings"}
CONSTANTS_ONLY = {"/rcl_interfaces_msg_ParameterType", "/test_msgs_msg_Constants"}
#: Topic, and the message or None.
Decoded = Iterator[tuple[str, Any]]


def by_ours(folder: Path) -> Decoded:
    """Return the messages from the grader's own reader."""
    bag = Bag.open(folder)
    for info in bag.topics:
        stream = bag.stream(info.topic)
        yield from ((info.topic, message) for message in stream.messages)


def by_rosbags(folder: Path) -> Decoded:
    """Return the messages from `rosbags`, which compares type hashes too."""
    with AnyReader([folder]) as reader:
        for connection, _, data in reader.messages():
            yield connection.topic, _decoded(reader.deserialize, data, connection.msgtype)


def by_mcap_ros2(folder: Path) -> Decoded:
    """Return the messages from the reference implementation of MCAP, which checks checksums."""
    factory, decoders = DecoderFactory(), dict[int, Callable[[bytes], Any] | None]()
    with next(folder.glob("*.mcap")).open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
            decoder = decoders[channel.id]
            yield channel.topic, None if decoder is None else _decoded(decoder, message.data)


def by_foxglove(folder: Path) -> Decoded:
    """Return the messages from the npm packages of Foxglove and Lichtblick."""
    bag = next(folder.glob("*.mcap"))
    command = ["node", str(npm_folder() / PROGRAM.name), str(bag)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    for line in done.stdout.splitlines():
        found = json.loads(line)
        yield found["topic"], found.get("value")


def _decoded(decode: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return decode(*arguments)
    except (KeyError, NotImplementedError):
        return None


@functools.lru_cache(maxsize=1)
def npm_folder() -> Path:
    """Return a folder with the packages of npm and the program that uses them; skips if they are not to be had."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ros-lab-grader-tests"
    folder = cache / "-".join(("npm", *NPM)).replace("/", "_")
    folder.mkdir(parents=True, exist_ok=True)
    command = [
        "npm",
        "install",
        "--prefix",
        str(folder),
        "--no-audit",
        "--no-fund",
        "--ignore-scripts",
    ]
    if not (folder / "node_modules/@mcap/core").is_dir():
        done = subprocess.run([*command, *NPM], capture_output=True, text=True, timeout=120)
        if done.returncode != 0:
            pytest.skip(f"npm does not answer: {done.stderr.strip()[-300:]}")
    shutil.copyfile(PROGRAM, folder / PROGRAM.name)
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Sent]:
    """Give a bag with two messages of each installed type, and the messages."""
    folder = tmp_path_factory.mktemp("bags") / "all"
    return folder, write_all_types(folder, message_types())


@pytest.mark.parametrize(
    ("reader", "unknown"),
    [
        (by_ours, WIDE),
        (by_rosbags, WIDE),
        (by_mcap_ros2, WIDE),
        (by_foxglove, WIDE | CONSTANTS_ONLY),
    ],
)
def test_every_message_of_every_type_is_decoded(
    reader: Callable[[Path], Decoded], unknown: set[str], written: tuple[Path, Sent]
) -> None:
    """Values are those that were published."""
    folder, sent = written
    read: dict[str, list[Any]] = {}
    for topic, message in reader(folder):
        read.setdefault(topic, []).append(message)
    assert read.keys() == sent.keys()
    assert len(sent) > 150
    wrong = {
        topic for topic, messages in sent.items() if not all(map(_equal, read[topic], messages))
    }
    assert wrong == unknown


def _equal(read: Any, message: Any) -> bool:
    if read is None:
        return False
    return same(read, message)


def test_metadata_is_what_each_distribution_reads(written: tuple[Path, Sent]) -> None:
    """Humble reads up to version 8: profiles as a text with numbers for policies; Jazzy and later know both forms."""
    text = (written[0] / METADATA_FILE).read_text()
    metadata = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert metadata["version"] == 8
    for entry in metadata["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        assert isinstance(topic["type_description_hash"], str)
        for profile in yaml.safe_load(topic["offered_qos_profiles"]):
            policies = ("history", "reliability", "durability", "liveliness", "depth")
            assert all(isinstance(profile[policy], int) for policy in policies)
            assert profile["reliability"] == 1
            assert profile["durability"] == 2
            assert profile["liveliness"] == 1
