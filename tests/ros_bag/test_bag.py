"""The bag on disk: written messages are read back, by the grader and by other readers."""

from __future__ import annotations

import random
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from ros_bag.definitions import definition_of, type_hash_of
from ros_bag.qos import Qos, offered_policies
from ros_bag.reading import Bag
from ros_bag.recovery import recover
from ros_bag.writing import METADATA_FILE, BagWriter

FLOATS, TEXT, EVENT = (
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/String",
    "std_srvs/srv/SetBool_Event",
)
START_NS = 1_800_000_000_000_000_000
RELIABLE = Qos(reliability="reliable", durability="volatile", liveliness="automatic")


def floats(*values: float) -> bytes:
    """CDR of a Float64MultiArray without a layout."""
    if values:
        body = struct.pack(f"<4x{len(values)}d", *values)
    else:
        body = b""
    return struct.pack("<BBHIII", 0, 1, 0, 0, 0, len(values)) + body


def text(value: str) -> bytes:
    """CDR of a String."""
    data = value.encode() + b"\0"
    return struct.pack("<BBHI", 0, 1, 0, len(data)) + data


def add_topic(writer: BagWriter, topic: str, topic_type: str, *offered: Qos) -> int:
    """Add a channel of an installed type."""
    return writer.add_channel(
        topic, topic_type, type_hash_of(topic_type), definition_of(topic_type), offered
    )


def put(writer: BagWriter, channel: int, number: int, data: bytes) -> None:
    """Write message `number` (from 1), received 0.1 ms after it was published, 10 ms after the one before."""
    source_ns = START_NS + number * 10_000_000
    writer.write(
        channel, data, received_ns=source_ns + 100_000, source_ns=source_ns, sequence=number
    )


def write_floats(folder: Path, count: int = 20) -> bytes:
    """Write a bag of `count` messages in two flushes; returns the bytes of its MCAP file before the end."""
    writer = BagWriter(folder, "session")
    channel = add_topic(writer, "/commands", FLOATS, RELIABLE)
    for number in range(1, count + 1):
        put(writer, channel, number, floats(number, -number))
        if number == count // 2:
            writer.flush()
    writer.flush()
    unfinished = (folder / "session.mcap").read_bytes()
    writer.close()
    return unfinished


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    """The topic with its type, hash and count comes back as it was written."""
    write_floats(tmp_path)
    bag = Bag.open(tmp_path)
    assert bag.finished
    assert [(t.topic, t.topic_type, t.count) for t in bag.topics] == [("/commands", FLOATS, 20)]
    assert bag.topics[0].type_hash == type_hash_of(FLOATS) != ""


def test_messages_are_read_back(tmp_path: Path) -> None:
    """Times, sequence numbers, bytes and values come back as they were written."""
    write_floats(tmp_path)
    stream = Bag.open(tmp_path).stream("/commands")
    assert stream.sequence.tolist() == list(range(1, 21))
    assert np.all(np.diff(stream.source_ns) == 10_000_000)
    assert np.all(stream.received_ns - stream.source_ns == 100_000)
    assert stream.data[2] == floats(3, -3)
    assert [list(values) for values in stream.field("data")] == [[n, -n] for n in range(1, 21)]
    assert all(message is not None for message in stream.messages)


def test_other_readers_agree(tmp_path: Path) -> None:
    """`rosbags`, `mcap` and our reader give the same messages, service events included."""
    write_floats(tmp_path)
    ours = Bag.open(tmp_path).stream("/commands")
    with AnyReader([tmp_path]) as reader:
        theirs = []
        for connection, time_ns, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            theirs.append((time_ns, message.data.tolist()))
    with (tmp_path / "session.mcap").open("rb") as stream:
        raw = []
        for *_, m in make_reader(stream).iter_messages():
            raw.append((m.log_time, m.publish_time, m.sequence, m.data))

    values = [array.tolist() for array in ours.field("data")]
    assert theirs == list(zip(ours.received_ns.tolist(), values, strict=True))
    columns = (
        ours.received_ns.tolist(),
        ours.source_ns.tolist(),
        ours.sequence.tolist(),
        ours.data,
    )
    assert raw == list(zip(*columns, strict=True))


def test_service_events_decode(tmp_path: Path) -> None:
    """A service event decodes from the IDL that the bag carries, whichever part of it is present."""
    writer = BagWriter(tmp_path, "session")
    channel = add_topic(writer, "/enable/_service_event", EVENT, RELIABLE)
    info = struct.pack("<BBHB3xiI16s4xq", 0, 1, 0, 1, 7, 8, bytes(range(16)), 42)
    put(writer, channel, 1, info + struct.pack("<IB3xI", 1, 1, 0))
    writer.close()

    stream = Bag.open(tmp_path).stream("/enable/_service_event")
    assert stream.field("info.sequence_number") == [42]
    assert stream.field("request.0.data") == [True]
    assert stream.field("response.0.message") == [None]
    with AnyReader([tmp_path]) as reader:
        assert [c.msgtype for c, _, _ in reader.messages()] == [EVENT]


def test_metadata_says_the_same_as_the_channel(tmp_path: Path) -> None:
    """`metadata.yaml` and the channel hold the same text of QoS profiles, which names policies by rmw's numbers."""
    writer = BagWriter(tmp_path, "session")
    add_topic(writer, "/none", TEXT)
    late = Qos(
        "best_effort", "transient_local", "unknown", 0, 1_500_000_000, None, "automatic", None
    )
    put(writer, add_topic(writer, "/two", TEXT, RELIABLE, late), 1, text("x"))
    writer.close()

    metadata = yaml.safe_load((tmp_path / METADATA_FILE).read_text())["rosbag2_bagfile_information"]
    listed = {}
    for topic in metadata["topics_with_message_count"]:
        described = topic["topic_metadata"]
        listed[described["name"]] = described["offered_qos_profiles"]
    channels = profiles_in_channels(tmp_path / "session.mcap")
    told = channels["/two"]
    assert channels == {topic: listed[topic] for topic in channels}
    assert metadata["version"] == 8
    assert metadata["relative_file_paths"] == ["session.mcap"]
    profiles = yaml.safe_load(told)
    assert profiles[1]["deadline"] == {"sec": 1, "nsec": 500_000_000}
    assert profiles[1]["lifespan"] == {"sec": 9_223_372_036, "nsec": 854_775_807}
    policies = [(p["reliability"], p["durability"], p["history"]) for p in profiles]
    assert policies == [(1, 2, 3), (2, 1, 3)]
    assert offered_policies(told) == [("reliable", "volatile"), ("best_effort", "transient_local")]


def profiles_in_channels(path: Path) -> dict[str, str]:
    """Return the text of QoS profiles in each channel of a file, by topic."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    found = {}
    for channel in summary.channels.values():
        found[channel.topic] = channel.metadata["offered_qos_profiles"]
    return found


def test_policies_of_earlier_recordings_are_understood() -> None:
    """The names of policies stood in a text of the channel; any other text offers nothing."""
    named = '[{"reliability": "best_effort", "durability": "volatile"}]'
    assert offered_policies(named) == [("best_effort", "volatile")]
    for wrong in ("", "[]", "- a", "[1]", "{}", "[" * 100_000, "&a [*a, *a]"):
        assert offered_policies(wrong) == []


def test_two_types_on_one_topic_are_kept_apart(tmp_path: Path) -> None:
    """A topic with two types is two streams; without a type, the one with more messages is meant."""
    writer = BagWriter(tmp_path, "session")
    first, second = add_topic(writer, "/mixed", TEXT), add_topic(writer, "/mixed", FLOATS)
    put(writer, first, 1, text("a"))
    put(writer, second, 2, floats(1.0))
    put(writer, second, 3, floats(2.0))
    writer.close()

    bag = Bag.open(tmp_path)
    assert [(t.topic_type, t.count) for t in bag.topics] == [(FLOATS, 2), (TEXT, 1)]
    assert bag.stream("/mixed").topic_type == FLOATS
    assert bag.stream("/mixed", TEXT).field("data") == ["a"]
    assert len(bag.stream("/absent")) == 0


def test_messages_are_in_order_of_reception(tmp_path: Path) -> None:
    """Messages written late are put where they were received."""
    writer = BagWriter(tmp_path, "session")
    channel = add_topic(writer, "/a", TEXT)
    for number in (3, 1, 2):
        put(writer, channel, number, text(str(number)))
    writer.close()
    assert Bag.open(tmp_path).stream("/a").field("data") == ["1", "2", "3"]


def test_every_cut_of_the_file_can_be_read_and_repaired(tmp_path: Path) -> None:
    """Wherever the file was cut, the messages before the cut come back, and never fewer for a later cut."""
    source = tmp_path / "source"
    write_floats(source)
    whole = (source / "session.mcap").read_bytes()
    folder = tmp_path / "cut"
    folder.mkdir()
    before = 0
    for size in range(0, len(whole), 7):
        (folder / "session.mcap").write_bytes(whole[:size])
        stream = Bag.open(folder).stream("/commands")
        assert len(stream) >= before
        assert stream.sequence.tolist() == list(range(1, len(stream) + 1))
        before = len(stream)
        if size % 70 == 0:
            assert recover(folder)
            assert len(Bag.open(folder).stream("/commands")) == before
            (folder / METADATA_FILE).unlink()
    assert before == 20


def test_a_killed_recorders_bag_becomes_valid(tmp_path: Path) -> None:
    """Recovery keeps all that was flushed, and others can read it; a second time it changes nothing."""
    unfinished = write_floats(tmp_path)
    (tmp_path / "session.mcap").write_bytes(unfinished)
    (tmp_path / METADATA_FILE).unlink()

    assert not Bag.open(tmp_path).finished
    assert recover(tmp_path)
    assert not recover(tmp_path)
    assert Bag.open(tmp_path).finished
    assert sorted(path.name for path in tmp_path.iterdir()) == [METADATA_FILE, "session.mcap"]
    with AnyReader([tmp_path]) as reader:
        assert len(list(reader.messages())) == 20
    with (tmp_path / "session.mcap").open("rb") as stream:
        assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == 20


@pytest.mark.parametrize("content", [None, b"", b"\x89MCAP0\r\n", b"no bag at all", bytes(5000)])
def test_a_bag_without_anything_becomes_an_empty_one(tmp_path: Path, content: bytes | None) -> None:
    """A file that holds nothing, or is not there, gives a valid bag without messages."""
    if content is not None:
        (tmp_path / "session.mcap").write_bytes(content)
    assert recover(tmp_path)
    assert Bag.open(tmp_path).topics == ()
    metadata = yaml.safe_load((tmp_path / METADATA_FILE).read_text())["rosbag2_bagfile_information"]
    assert metadata["topics_with_message_count"] == []


def test_a_folder_without_a_bag_is_refused(tmp_path: Path) -> None:
    """Opening or mending a missing bag raises an error that names the remedy."""
    with pytest.raises(FileNotFoundError, match=r"no \.mcap file"):
        Bag.open(tmp_path)
    with pytest.raises(NotADirectoryError):
        recover(tmp_path / "absent")


def test_malformed_messages_are_counted(tmp_path: Path) -> None:
    """Bytes that do not fit the type give None and are counted; the messages around them decode."""
    writer = BagWriter(tmp_path, "session")
    channel = add_topic(writer, "/a", FLOATS)
    hostile = [
        b"",
        b"\0",
        floats(1.0)[:-3],
        struct.pack("<BBHIII", 0, 1, 0, 0, 0, 2**32 - 1),
        b"\xff" * 64,
    ]
    for number, data in enumerate(
        [floats(1.0), *hostile, floats(float("nan"), float("inf")), floats()], 1
    ):
        put(writer, channel, number, data)
    writer.close()

    stream = Bag.open(tmp_path).stream("/a")
    values = stream.field("data")
    assert [m is None for m in stream.messages] == [False, *[True] * 5, False, False]
    assert np.isnan(values[6][0])
    assert np.isinf(values[6][1])
    assert len(values[7]) == 0


def test_random_bytes_never_raise(tmp_path: Path) -> None:
    """No bytes whatever make decoding raise or take long, for nested types with text and sequences."""
    source = random.Random(1)
    types = (
        FLOATS,
        TEXT,
        EVENT,
        "diagnostic_msgs/msg/DiagnosticArray",
        "trajectory_msgs/msg/JointTrajectory",
    )
    writer = BagWriter(tmp_path, "session")
    for topic_type in types:
        channel = add_topic(writer, "/a", topic_type)
        for number in range(300):
            filling = source.choice([b"\0", b"\xff", b"\1\0\0\0", source.randbytes(8)])
            put(
                writer,
                channel,
                number,
                b"\0\1\0\0" + source.randbytes(source.randrange(40)) + filling * 20,
            )
    writer.close()

    bag = Bag.open(tmp_path)
    started = time.process_time()
    for topic_type in types:
        assert len(bag.stream("/a", topic_type).messages) == 300
    assert time.process_time() - started < 5


def test_impossible_times_are_held_within_bounds(tmp_path: Path) -> None:
    """Timestamps beyond 63 bits, which a publisher could send, neither raise nor turn negative."""
    writer = BagWriter(tmp_path, "session")
    channel = add_topic(writer, "/a", TEXT)
    writer.write(channel, text("x"), received_ns=START_NS, source_ns=-5, sequence=2**32 + 1)
    writer.write(channel, text("x"), received_ns=START_NS, source_ns=2**64, sequence=-1)
    writer.close()
    stream = Bag.open(tmp_path).stream("/a")
    assert stream.source_ns.tolist() == [0, 2**63 - 1]
    assert stream.sequence.tolist() == [1, 2**32 - 1]


def test_many_topics_and_large_arrays(tmp_path: Path) -> None:
    """4,000 topics and an array of 8 MB open without trouble."""
    writer = BagWriter(tmp_path, "session")
    for number in range(4000):
        put(writer, add_topic(writer, f"/t{number}", FLOATS, RELIABLE), number, floats(number))
    large = np.zeros(2**20).tobytes()
    head = struct.pack("<BBHIII4x", 0, 1, 0, 0, 0, 2**20)
    put(writer, add_topic(writer, "/large", FLOATS), 1, head + large)
    writer.close()

    bag = Bag.open(tmp_path)
    assert len(bag.topics) == 4001
    assert bag.stream("/t3999").field("data")[0].tolist() == [3999.0]
    assert len(bag.stream("/large").field("data")[0]) == 2**20


def test_a_bag_is_smaller_than_what_it_holds(tmp_path: Path) -> None:
    """A timer's messages take less than their bytes alone, with all times and the index for ROS 2 tools."""
    writer = BagWriter(tmp_path, "session")
    channel = add_topic(writer, "/a", FLOATS)
    for number in range(1000):
        put(writer, channel, number, floats(*[number * 0.01] * 7))
    writer.close()
    assert (tmp_path / "session.mcap").stat().st_size < Bag.open(tmp_path).size_bytes


@pytest.mark.parametrize("compression", ["LZ4", "ZSTD"])
def test_compressed_bags_of_others_open(tmp_path: Path, compression: str) -> None:
    """Bags that another recorder wrote with compressed chunks can be judged too."""
    from mcap.writer import CompressionType, Writer

    definition = definition_of(FLOATS)
    with (tmp_path / "other.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType[compression])
        writer.start(profile="ros2")
        schema = writer.register_schema(FLOATS, definition.encoding, definition.text.encode())
        channel = writer.register_channel("/a", "cdr", schema)
        for number in range(10):
            writer.add_message(channel, START_NS + number, floats(number), START_NS, number)
        writer.finish()  # type: ignore[no-untyped-call]
    assert [values[0] for values in Bag.open(tmp_path).stream("/a").field("data")] == list(
        range(10)
    )


def test_opening_is_fast(tmp_path: Path) -> None:
    """Opening and decoding 5,000 messages takes less than twice as long as the imports, first use of the decoder included."""
    writer = BagWriter(tmp_path, "session")
    channel = add_topic(writer, "/a", FLOATS)
    for number in range(5000):
        put(writer, channel, number, floats(*range(7)))
    writer.close()
    program = (
        "import pathlib, sys, time, numpy; from ros_bag.reading import Bag; t = time.process_time();"
        "n = len(Bag.open(pathlib.Path(sys.argv[1])).stream('/a').field('data'));"
        "print(n, time.process_time() - t, t)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True
    )
    count, taken_s, imports_s = done.stdout.split()
    assert int(count) == 5000
    assert float(taken_s) < 2 * float(imports_s)


def test_reading_needs_no_ros() -> None:
    """Neither ROS nor processes are imported for reading a bag."""
    program = "import sys, ros_bag.reading;print([m for m in ('rclpy', 'subprocess', 'rosbags') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
