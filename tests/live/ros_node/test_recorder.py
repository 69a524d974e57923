"""The recorder on a real ROS graph: nothing lost, times exact, and a bag that others can read."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from ros_bag.reading import Bag, Stream
from ros_bag.recovery import recover

pytestmark = pytest.mark.live

FLOATS, TEXT, EVENT = (
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/String",
    "std_srvs/srv/SetBool_Event",
)
RATES_HZ = {"/rate_1": 1, "/rate_10": 10, "/rate_100": 100, "/rate_1000": 1000}
BURST_HZ, BURST_COUNT = 5000, 7500
LATE_COUNT = 350

# Publishes by absolute deadlines once each publisher is matched, and logs begin and end of each
# call. It holds all messages until the recorder has them: with a smaller queue it would itself lose
# messages on a busy machine.
PUBLISHERS = """
import heapq, json, sys, time
import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, String
plan, log_path = json.loads(sys.argv[1]), sys.argv[2]
rclpy.init()
node = rclpy.create_node(plan["node"])
kinds = {"floats": Float64MultiArray, "text": String}
log, publishers, due = {}, [], []
for index, entry in enumerate(plan["publishers"]):
    reliability = ReliabilityPolicy[entry.get("reliability", "RELIABLE")]
    qos = QoSProfile(depth=entry["count"], reliability=reliability)
    publishers.append(node.create_publisher(kinds[entry["kind"]], entry["topic"], qos))
    log[entry["topic"]] = []
    due.append((0.0, index, 0))
deadline = time.monotonic() + 15
while time.monotonic() < deadline and any(p.get_subscription_count() == 0 for p in publishers):
    time.sleep(0.01)
for line in plan.get("say", []):
    node.get_logger().info(line)
time.sleep(0.3)
start = time.monotonic()
while due:
    at, index, number = heapq.heappop(due)
    entry = plan["publishers"][index]
    if entry["kind"] == "floats":
        message = Float64MultiArray(data=[float(number), *[0.5] * entry.get("values", 6)])
    else:
        message = String(data=f"{plan['node']} {number}")
    wait = start + at - time.monotonic()
    if wait > 0:
        time.sleep(wait)
    begun_ns = time.time_ns()
    publishers[index].publish(message)
    log[entry["topic"]].append((begun_ns, time.time_ns()))
    if number + 1 < entry["count"]:
        heapq.heappush(due, ((number + 1) / entry["rate_hz"], index, number + 1))
with open(log_path, "w") as stream:
    json.dump(log, stream)
for publisher in publishers:
    publisher.wait_for_all_acked(Duration(seconds=20))
time.sleep(1.5)
"""

# A server and a client that shows its calls by service introspection.
SERVICE = """
import threading, time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState
from std_srvs.srv import SetBool
rclpy.init()
def answer(request, response):
    response.success, response.message = request.data, f"set to {request.data}"
    return response
server = rclpy.create_node("server")
server.create_service(SetBool, "/enable", answer)
caller = rclpy.create_node("caller")
client = caller.create_client(SetBool, "/enable")
events = QoSProfile(depth=100)
client.configure_introspection(caller.get_clock(), events, ServiceIntrospectionState.CONTENTS)
executor = SingleThreadedExecutor()
executor.add_node(server)
executor.add_node(caller)
threading.Thread(target=executor.spin, daemon=True).start()
deadline = time.monotonic() + 15
while time.monotonic() < deadline and not (
    client.service_is_ready() and caller.count_subscribers("/enable/_service_event")
):
    time.sleep(0.01)
time.sleep(0.5)
for value in (True, False, True):
    call = client.call_async(SetBool.Request(data=value))
    while time.monotonic() < deadline and not call.done():
        time.sleep(0.001)
time.sleep(0.5)
"""

# Records while the programs given to it run, as the director of a session does.
SESSION = """
import json, os, resource, signal, subprocess, sys, time
from pathlib import Path
import rclpy
from confine.namespaces import end_with_parent
from grader.live.ros_node.recorder import Recorder
from ros_bag.writing import BagWriter
from grader.recording.session import (Endpoint)
from ros_bag.qos import Qos
setting = json.loads(sys.argv[1])
rclpy.init()
probe = rclpy.create_node("_grader_probe", enable_rosout=False)
limits = setting.get("limits", {})
recorder = Recorder(BagWriter(Path(setting["folder"]), "session"), int(os.environ["ROS_DOMAIN_ID"]), **limits)
extra = [Endpoint("publisher", t, k, "", "/nobody", "00") for t, k in setting.get("extra", [])]

def publishers():
    for topic, _ in probe.get_topic_names_and_types():
        for info in probe.get_publishers_info_by_topic(topic):
            if not info.node_name.startswith("_grader"):
                qos = info.qos_profile
                yield Endpoint("publisher", topic, info.topic_type, str(info.topic_type_hash),
                    "/" + info.node_name, str(info.endpoint_gid),
                    Qos(qos.reliability.name.lower(), qos.durability.name.lower()))

def begin(argv):
    return subprocess.Popen([sys.executable, *argv], preexec_fn=end_with_parent)

def counted(topic):
    return sum(count for key, count in recorder.counts.items() if key[0] == topic)

children = [begin(argv) for argv in setting["programs"]]
later = setting.get("later", [])
start = looked = time.monotonic()
held = []
while (later or any(child.poll() is None for child in children)) and time.monotonic() < start + 50:
    recorder.follow([*publishers(), *extra])
    if later and counted(later[0][0]) > 50:
        children.append(begin(later.pop(0)[1]))
    looked, before = time.monotonic(), looked
    # Not after a halt of the machine, in which the recorder could not write either.
    going = looked - before < 0.3
    if going and setting.get("kill_after") and sum(recorder.counts.values()) >= setting["kill_after"]:
        print(json.dumps({"killed_ns": time.time_ns()}), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    if not held and counted(setting.get("hold_at")) > 50:
        with recorder._lock:
            held = [time.time_ns()]
            time.sleep(2)
            held.append(time.time_ns())
    time.sleep(0.1)
for child in children:
    child.kill()
    child.wait()
recorder.stop()
used = resource.getrusage(resource.RUSAGE_SELF)
counts = [[*key, count] for key, count in recorder.counts.items()]
left_out = [[u.topic, u.messages, u.size_bytes, u.reason, u.limit] for u in recorder.unrecorded]
told = {"problems": recorder.problems, "unrecorded": left_out, "counts": counts, "held_ns": held}
print(json.dumps({**told, "cpu_s": used.ru_utime + used.ru_stime}))
probe.destroy_node()
rclpy.shutdown()
"""


def alone(command: list[str]) -> list[str]:
    """Command that runs in a network namespace of its own where the system permits it."""
    wrapper = ["unshare", "--net", "--map-root-user"]
    if (
        shutil.which("unshare")
        and subprocess.run([*wrapper, "true"], capture_output=True).returncode == 0
    ):
        return [*wrapper, "sh", "-c", 'ip link set lo up && exec "$@"', "sh", *command]
    return command


def record(folder: Path, domain_id: int, **setting: Any) -> dict[str, Any]:
    """Run a session in separate processes; returns its output."""
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain_id),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "ROS_LOG_DIR": str(folder.parent / "log"),
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
    }
    plain = json.dumps({"folder": str(folder), **setting})
    done = subprocess.run(
        alone([sys.executable, "-c", SESSION, plain]),
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
    )
    printed: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return printed


def publishers(node: str, log: Path, *entries: dict[str, Any], **more: Any) -> list[str]:
    """Arguments that run a node with publishers."""
    return [
        "-c",
        PUBLISHERS,
        json.dumps({"node": node, "publishers": list(entries), **more}),
        str(log),
    ]


class Recorded:
    """One session with all kinds of traffic, recorded once for all tests."""

    def __init__(self, home: Path) -> None:
        self.folder = home / "bag"
        rates = []
        for topic, rate in RATES_HZ.items():
            rates.append({"topic": topic, "kind": "floats", "rate_hz": rate, "count": 5 * rate + 1})
        burst = {"topic": "/burst", "kind": "floats", "rate_hz": BURST_HZ, "count": BURST_COUNT}
        mixed = []
        for kind in ("text", "floats"):
            mixed.append({"topic": "/mixed", "kind": kind, "rate_hz": 100, "count": 100})
        self.printed = record(
            self.folder,
            71,
            hold_at="/rate_100",
            programs=[
                publishers("rates", home / "rates.json", *rates, say=["first line", "second line"]),
                publishers("burst", home / "burst.json", burst, mixed[0]),
                publishers("other", home / "other.json", mixed[1]),
                ["-c", SERVICE],
            ],
        )
        #: By topic: when each call that published began and ended.
        self.called_ns: dict[str, list[tuple[int, int]]] = {}
        for name in ("rates", "burst"):
            self.called_ns |= json.loads((home / f"{name}.json").read_text())
        self.bag = Bag.open(self.folder)

    def stream(self, topic: str, topic_type: str | None = None) -> Stream:
        """One stream of the bag."""
        return self.bag.stream(topic, topic_type)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A recorded session of about eight seconds."""
    return Recorded(tmp_path_factory.mktemp("recorded"))


def test_nothing_went_wrong(recorded: Recorded) -> None:
    """An ordinary session gives a whole bag and no problem."""
    assert recorded.printed["problems"] == []
    assert recorded.bag.finished
    counts = {(topic, kind): count for topic, kind, count in recorded.printed["counts"]}
    assert counts == {(t.topic, t.topic_type): t.count for t in recorded.bag.topics}


@pytest.mark.parametrize("topic", [*RATES_HZ, "/burst"])
def test_times_are_exact(recorded: Recorded, topic: str) -> None:
    """Each source timestamp lies within the call that published its message, so that a rate is the publisher's own.

    However the machine delays the publisher: most calls take far less than a thousandth of these five seconds.
    """
    stream = recorded.stream(topic)
    calls_ns = np.array(recorded.called_ns[topic])[stream.sequence - 1]
    assert ((calls_ns[:, 0] <= stream.source_ns) & (stream.source_ns <= calls_ns[:, 1])).all()
    assert np.median(calls_ns[:, 1] - calls_ns[:, 0]) < 5_000_000


@pytest.mark.parametrize("topic", [*RATES_HZ, "/burst"])
def test_nothing_is_lost(recorded: Recorded, topic: str) -> None:
    """Every message is in the bag, at 5,000 messages/s as well, with its own value."""
    stream = recorded.stream(topic)
    count = len(recorded.called_ns[topic])
    assert stream.sequence.tolist() == list(range(1, count + 1))
    assert [values[0] for values in stream.field("data")] == list(range(count))


def test_received_time_is_the_middlewares(recorded: Recorded) -> None:
    """The received time is a message's arrival, even during the recorder's two idle seconds.

    Some messages have a later one all the same: each message after a lost one counts as received
    once the lost one was sent again.
    """
    begun_ns, ended_ns = recorded.printed["held_ns"]
    meanwhile = 0
    for topic in RATES_HZ:
        stream = recorded.stream(topic)
        assert (stream.received_ns >= stream.source_ns).all()
        meanwhile += ((stream.received_ns > begun_ns) & (stream.received_ns < ended_ns)).sum()
    assert meanwhile > 10


def test_two_types_on_one_topic(recorded: Recorded) -> None:
    """Both types that were published on one topic are recorded, each as itself."""
    assert len(recorded.stream("/mixed", TEXT)) == 100
    assert len(recorded.stream("/mixed", FLOATS)) == 100
    assert recorded.stream("/mixed", TEXT).field("data")[0].startswith("burst")


def test_a_weaker_publisher_that_joins_is_recorded_too(tmp_path: Path) -> None:
    """When a best-effort publisher joins, the reliable one's messages are neither lost nor doubled.

    A flood beside them would fill the socket, and nothing is sent again to a best-effort subscription.
    """
    firm = {"topic": "/late", "kind": "text", "rate_hz": 70, "count": LATE_COUNT}
    weak = {
        "topic": "/late",
        "kind": "text",
        "rate_hz": 50,
        "count": 50,
        "reliability": "BEST_EFFORT",
    }
    record(
        tmp_path / "bag",
        74,
        programs=[publishers("firm", tmp_path / "firm.json", firm)],
        later=[("/late", publishers("weak", tmp_path / "weak.json", weak))],
    )
    numbers: dict[str, list[int]] = {"firm": [], "weak": []}
    for line in Bag.open(tmp_path / "bag").stream("/late").field("data"):
        node, number = line.split()
        numbers[node].append(int(number))
    # The reliable of two receiving subscriptions may be later.
    assert sorted(numbers["firm"]) == list(range(LATE_COUNT))
    assert len(numbers["weak"]) == len(set(numbers["weak"])) > 0


def test_log_and_service_events_are_recorded(recorded: Recorded) -> None:
    """`/rosout` and the events of a client's calls are in the bag and decode."""
    assert {"first line", "second line"} <= set(recorded.stream("/rosout").field("msg"))
    events = recorded.stream("/enable/_service_event")
    assert events.topic_type == EVENT
    # A client notes its request (0, request sent) and the answer (3, response received).
    kinds = events.field("info.event_type")
    sent = []
    for kind, value in zip(kinds, events.field("request.0.data"), strict=True):
        if kind == 0:
            sent.append(value)
    answers = [
        value
        for kind, value in zip(kinds, events.field("response.0.message"), strict=True)
        if kind == 3
    ]
    assert sent == [True, False, True]
    assert answers == ["set to True", "set to False", "set to True"]


def _without_constants(message: object) -> str:
    """Write a message without the constants of its definition, which `rosbags` takes for fields."""
    return re.sub(r", [A-Z][A-Z0-9_]*=[^,()]*", "", repr(message))


def test_all_readers_agree(recorded: Recorded) -> None:
    """`rosbags`, `mcap` and our reader agree on counts, times, bytes and values of all topics."""
    theirs: dict[tuple[str, str], list[tuple[int, object]]] = {}
    with AnyReader([recorded.folder]) as reader:
        for connection, time_ns, data in reader.messages():
            key = connection.topic, connection.msgtype
            theirs.setdefault(key, []).append(
                (time_ns, reader.deserialize(data, connection.msgtype))
            )
    raw: dict[tuple[str, str], list[tuple[int, int, int, bytes]]] = {}
    with (recorded.folder / "session.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            row = (message.log_time, message.publish_time, message.sequence, message.data)
            raw.setdefault((channel.topic, schema.name), []).append(row)
    assert {"/rosout", "/enable/_service_event", "/rate_100"} <= {topic for topic, _ in theirs}
    for info in recorded.bag.topics:
        stream = recorded.stream(info.topic, info.topic_type)
        key = info.topic, info.topic_type
        columns = (
            stream.received_ns.tolist(),
            stream.source_ns.tolist(),
            stream.sequence.tolist(),
            stream.data,
        )
        assert sorted(raw.get(key, [])) == sorted(zip(*columns, strict=True))
        ours = zip(stream.received_ns.tolist(), map(repr, stream.messages), strict=True)
        read = [(time_ns, _without_constants(value)) for time_ns, value in theirs.get(key, [])]
        assert sorted(read) == sorted(ours)
        assert all(message is not None for message in stream.messages)


def test_a_killed_recorder_leaves_its_evidence(tmp_path: Path) -> None:
    """After SIGKILL all but the last second can be read, and repaired into a bag that others read."""
    folder = tmp_path / "bag"
    entry = {"topic": "/commands", "kind": "floats", "rate_hz": 500, "count": 5000}
    programs = [publishers("talker", tmp_path / "log.json", entry)]
    printed = record(folder, 72, programs=programs, kill_after=1000)

    stream = Bag.open(folder).stream("/commands")
    assert not Bag.open(folder).finished
    assert stream.sequence.tolist() == list(range(1, len(stream) + 1))
    assert printed["killed_ns"] - int(stream.source_ns[-1]) < 1_000_000_000
    assert recover(folder)
    with AnyReader([folder]) as reader:
        wanted = [c for c in reader.connections if c.topic == "/commands"]
        assert len(list(reader.messages(wanted))) == len(stream)


def test_limits_and_unknown_types_are_reported(tmp_path: Path) -> None:
    """A flood is cut at no cost to other topics, and unrecordable topics are reported.

    Neither is the recorder's fault.
    """
    flood = {"topic": "/flood", "kind": "floats", "rate_hz": 500, "count": 500, "values": 1000}
    calm = {"topic": "/calm", "kind": "floats", "rate_hz": 100, "count": 100, "values": 0}
    printed = record(
        tmp_path / "bag",
        73,
        programs=[publishers("talker", tmp_path / "log.json", flood, calm)],
        limits={"limit_bytes": 1_000_000},
        extra=[
            ("/strange", "nowhere/msg/Thing"),
            ("/worse", "../../msg/Thing"),
            ("not a name", TEXT),
        ],
    )
    bag = Bag.open(tmp_path / "bag")
    assert 0 < len(bag.stream("/flood")) < 100
    assert len(bag.stream("/calm")) == 100
    assert (tmp_path / "bag" / "session.mcap").stat().st_size < 1_000_000
    left_out = {topic: facts for topic, *facts in printed["unrecorded"]}
    assert set(left_out) == {"/flood", "/strange", "/worse", "not a name"}
    messages, size_bytes, _, limit = left_out.pop("/flood")
    assert (messages, limit) == (len(bag.stream("/flood")), True)
    assert size_bytes > sum(map(len, bag.stream("/flood").data))
    for count, size, reason, of_limit in left_out.values():
        assert reason
        assert (count, size, of_limit) == (0, 0, False)
    assert printed["problems"] == []
