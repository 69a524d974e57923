"""Writes the bag of a recording: one MCAP file and its `metadata.yaml`."""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ros_bag.definitions import MessageDefinition
from ros_bag.mcap_file import DAMAGE, TopicInfo
from ros_bag.qos import INFINITE_NS, Qos, qos_text

if TYPE_CHECKING:
    from mcap.writer import Writer

METADATA_FILE = "metadata.yaml"
#: Last version with QoS profiles as text; Humble reads no other form.
METADATA_VERSION = 8


class BagWriter:
    """Writes a bag into a folder, which is made if it is missing. One thread at a time may use it.

    Chunks are compressed: a bag is a third as large, for less than 1 ms of CPU time in a session. `flush` ends a chunk.
    """

    def __init__(self, folder: Path, name: str) -> None:
        from mcap.writer import CompressionType, Writer

        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file_name = name + ".mcap"
        self._stream = (folder / self._file_name).open("wb")
        self._writer: Writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="ros-lab-grader")
        self._stream.flush()
        self._schemas: dict[tuple[str, MessageDefinition], int] = {}
        self._channels: dict[int, TopicInfo] = {}
        self._start_ns = INFINITE_NS
        self._end_ns = 0

    def add_channel(
        self,
        topic: str,
        topic_type: str,
        type_hash: str,
        definition: MessageDefinition,
        offered_qos: Sequence[Qos],
    ) -> int:
        """Add a topic of one type, and return its channel for `write`."""
        text = qos_text(offered_qos)
        return self.add_topic(TopicInfo(topic, topic_type, type_hash, definition, text))

    def add_topic(self, channel: TopicInfo) -> int:
        """Add a topic as another bag describes it, and return its channel for `write`."""
        key = (channel.topic_type, channel.definition)
        if key not in self._schemas:
            text = channel.definition.text.encode()
            self._schemas[key] = self._writer.register_schema(
                channel.topic_type, channel.definition.encoding, text
            )
        metadata = {"offered_qos_profiles": channel.qos_text, "topic_type_hash": channel.type_hash}
        number = self._writer.register_channel(channel.topic, "cdr", self._schemas[key], metadata)
        self._channels[number] = channel
        return number

    def write(
        self, channel: int, data: bytes, *, received_ns: int, source_ns: int, sequence: int
    ) -> None:
        """Add a message: its CDR bytes with the header of four bytes, and its times."""
        # The source timestamp comes over the wire, and can be anything.
        received_ns = min(max(received_ns, 0), INFINITE_NS)
        source_ns = min(max(source_ns, 0), INFINITE_NS)
        self._writer.add_message(channel, received_ns, data, source_ns, sequence & 0xFFFFFFFF)
        self._channels[channel].count += 1
        self._start_ns = min(self._start_ns, received_ns)
        self._end_ns = max(self._end_ns, received_ns)

    def note_damage(self, damage: Sequence[str]) -> None:
        """Note the unreadable parts of the bag from which this one is made, if any."""
        if damage:
            numbered = {str(n): words for n, words in enumerate(damage)}
            self._writer.add_metadata(DAMAGE, numbered)

    def flush(self) -> None:
        """Hand all written data to the system; it outlives a kill of this process."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Finish the MCAP file, then write `metadata.yaml`; its presence says that the bag is whole."""
        if self._stream.closed:
            return
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()
        start_ns = min(self._start_ns, self._end_ns)
        text = _metadata_yaml(
            self._file_name, list(self._channels.values()), start_ns, self._end_ns
        )
        _replace(self._folder / METADATA_FILE, text)


def _metadata_yaml(
    file_name: str, channels: Sequence[TopicInfo], start_ns: int, end_ns: int
) -> str:
    total = sum(channel.count for channel in channels)
    duration = {"nanoseconds": end_ns - start_ns}
    start = {"nanoseconds_since_epoch": start_ns}
    file = {"path": file_name, "starting_time": start, "duration": duration, "message_count": total}
    information = {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": start,
        "message_count": total,
        "topics_with_message_count": [_plain_topic(channel) for channel in channels],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [file],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    return json.dumps({"rosbag2_bagfile_information": information}, indent=1) + "\n"


def _plain_topic(channel: TopicInfo) -> dict[str, Any]:
    metadata = {
        "name": channel.topic,
        "type": channel.topic_type,
        "serialization_format": "cdr",
        "offered_qos_profiles": channel.qos_text,
        "type_description_hash": channel.type_hash,
    }
    return {"topic_metadata": metadata, "message_count": channel.count}


def _replace(path: Path, text: str) -> None:
    """Write a file in one step: no reader sees half of it, and it goes through no link of another user."""
    partial = path.with_name(f".{secrets.token_hex(8)}.partial")
    try:
        with partial.open("x", encoding="utf-8") as file:
            file.write(text)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
