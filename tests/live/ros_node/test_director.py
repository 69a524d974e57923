"""The director in a real sandbox: names found, calls timed, parameters, publications and the graph."""

from __future__ import annotations

import itertools
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from rosbags.highlevel import AnyReader

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT))

from grader.evidence.recorded import Recorded  # noqa: E402
from grader.recording.session import Endpoint, StepRun  # noqa: E402
from grader.recording.trusted_channel import digest  # noqa: E402
from tests.live.small_lab import FLOATS, SET_BOOL, TEXT, record_one, texts  # noqa: E402

pytestmark = pytest.mark.live

#: A node with a placeholder for its class body; ends properly on Ctrl-C.
NODE = """
import json, time
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rcl_interfaces.msg import ParameterDescriptor
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool

class Ending(Node):
    def ending(self):
        pass

class Student(Ending):
    def __init__(self):
        super().__init__('NAME')
BODY

rclpy.init()
node = Student()
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
node.ending()
rclpy.try_shutdown()
"""


def node(body: str, name: str = "student") -> str:
    """Return the source of a node; `body` is the rest of its constructor, and further methods."""
    return NODE.replace("NAME", name).replace("BODY", body.strip("\n"))


def steps_of(recorded: Recorded, kind: str) -> list[StepRun]:
    """Return the steps of a kind; fails if the session had trouble of its own."""
    assert recorded.record.complete
    assert not recorded.record.problems
    return [step for step in recorded.record.steps if step.kind == kind]


# -- names ------------------------------------------------------------------------------------

MISSPELT = """
        self.publisher = self.create_publisher(Float64MultiArray, '/joint_comands', 10)
        self.create_timer(0.05, lambda: self.publisher.publish(Float64MultiArray(data=[1.0])))
        self.create_service(SetBool, '/robot/enabel', self.answer)
        self.create_service(SetBool, '/robot_2/enabel', self.answer)

    def answer(self, request, response):
        response.success = request.data
        return response
"""


def test_misspelt_names_are_found_and_used(tmp_path: Path) -> None:
    """A node, a topic and a service under similar names are found, and the steps after them use these."""
    recorded = record_one(
        tmp_path,
        node(MISSPELT, "joint_comand_publisher"),
        [
            {"wait_for": {"node": "/joint_command_publisher", "timeout_s": 20}},
            {"wait_for": {"publisher": "/joint_commands", "type": FLOATS, "timeout_s": 20}},
            {"wait_for": {"service": "/robot/enable", "type": SET_BOOL, "timeout_s": 20}},
            {"observe": {"duration_s": 0.3, "first_message_on": "/joint_commands"}},
            # The service found first is called later, not the next one with a similar name.
            {"wait_for": {"service": "/robot/enable", "type": SET_BOOL, "timeout_s": 20}},
            {"call": {"service": "/robot/enable", "type": SET_BOOL, "request": {"data": True}}},
            {"get_parameters": {"node": "/joint_command_publisher", "names": ["use_sim_time"]}},
        ],
    )
    assert recorded.record.names == {
        "/joint_command_publisher": "/joint_comand_publisher",
        "/joint_commands": "/joint_comands",
        "/robot/enable": "/robot/enabel",
    }
    assert [step.outcome for step in recorded.record.steps] == ["done"] * 9
    (call,) = steps_of(recorded, "call")
    assert call.result["service"] == "/robot/enabel"
    assert call.result["calls"][0]["response"]["success"] is True
    (parameters,) = steps_of(recorded, "get_parameters")
    assert parameters.result["values"]["use_sim_time"]["value"] is False
    assert len(recorded.stream("/joint_commands")) >= 4


WRONG_TYPE = """
        self.publisher = self.create_publisher(String, '/joint_commands', 10)
        self.create_timer(0.05, lambda: self.publisher.publish(String(data='1.0')))
"""


def test_a_topic_of_another_type_is_found_as_such(tmp_path: Path) -> None:
    """A topic of the right name and the wrong type counts as found, and its messages are recorded."""
    recorded = record_one(
        tmp_path,
        node(WRONG_TYPE),
        [
            {"wait_for": {"publisher": "/joint_commands", "type": FLOATS, "timeout_s": 20}},
            {"observe": {"duration_s": 0.3, "first_message_on": "/joint_commands"}},
        ],
    )
    (wait,) = steps_of(recorded, "wait_for")
    assert (wait.outcome, wait.result["name"], wait.result["type"]) == (
        "done",
        "/joint_commands",
        TEXT,
    )
    assert recorded.record.names == {}
    assert set(recorded.stream("/joint_commands").field("data")) == {"1.0"}


# -- services ---------------------------------------------------------------------------------

SERVICES = """
        self.create_service(SetBool, '/quick', self.quick)
        self.create_service(SetBool, '/slow', self.slow)
        self.create_service(SetBool, '/never', self.never)

    def quick(self, request, response):
        response.success, response.message = request.data, 'at once'
        return response

    def slow(self, request, response):
        time.sleep(0.2)
        return response

    def never(self, request, response):
        time.sleep(600)
"""


def call(service: str, **more: Any) -> dict[str, Any]:
    """Make a call step."""
    return {"call": {"service": service, "type": SET_BOOL, **more}}


def require_answered_at_once(step: StepRun) -> None:
    """Fail unless each of 20 calls has its request, its response and a short time."""
    assert (step.outcome, len(step.result["calls"])) == ("done", 20)
    assert step.result["request"] == {"data": True}
    for one in step.result["calls"]:
        assert one["response"] == {"success": True, "message": "at once"}
        assert 0 < one["ended_ns"] - one["started_ns"] < 5e9


def test_calls_are_kept_with_their_responses_and_latencies(tmp_path: Path) -> None:
    """Each call has its request, its response and its time; a late or silent service holds up nothing for long."""
    recorded = record_one(
        tmp_path,
        node(SERVICES),
        [
            {"wait_for": {"service": "/quick", "type": SET_BOOL, "timeout_s": 20}},
            call("/quick", request={"data": True}, repeat=20, clients=2),
            call("/slow", repeat=50, at_most_s=1.0),
            call("/absent", timeout_s=0.5),
            call("/never", repeat=50, timeout_s=0.7, at_most_s=20),
        ],
    )
    quick, slow, absent, never = steps_of(recorded, "call")
    require_answered_at_once(quick)
    assert slow.outcome == "done"
    assert 1 <= len(slow.result["calls"]) <= 6, "no call may start after at_most_s"
    for one in slow.result["calls"]:
        assert one["ended_ns"] - one["started_ns"] >= 0.2e9
    assert (absent.outcome, absent.result["calls"]) == ("timeout", [])
    assert (never.outcome, [one["response"] for one in never.result["calls"]]) == (
        "timeout",
        [None, None],
    )
    assert never.ended_ns - never.started_ns < 20e9, "it was asked more than twice"


def service_events(bag: Path) -> list[Any]:
    """Return the events of the service /quick, decoded by another reader."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == "/quick/_service_event"]
        assert [c.msgtype for c in connections] == ["std_srvs/srv/SetBool_Event"]
        return [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]


def test_calls_of_the_grader_are_in_the_bag(tmp_path: Path) -> None:
    """The service events of the grader's calls are recorded, and another reader decodes them."""
    recorded = record_one(
        tmp_path,
        node(SERVICES),
        [
            {"wait_for": {"service": "/quick", "type": SET_BOOL, "timeout_s": 20}},
            call("/quick", request={"data": True}, repeat=3),
        ],
    )
    assert [len(step.result["calls"]) for step in steps_of(recorded, "call")] == [3]
    events = service_events(tmp_path / "results" / "recordings" / "only")
    sent = [event for event in events if event.info.event_type == 0]
    answered = [event for event in events if event.info.event_type == 3]
    order = [event.info.event_type for event in events if event.info.event_type in (0, 3)]
    assert order == [0, 3] * 3, "requests and responses do not alternate"
    for event in sent:
        assert event.request[0].data is True
    for event in answered:
        assert event.response[0].message == "at once"


# -- parameters -------------------------------------------------------------------------------

PARAMETERS = """
        self.declare_parameter('limit', 1.5)
        self.declare_parameter('names', ['a', 'b'])
        self.declare_parameter('fixed', 7, ParameterDescriptor(read_only=True))
        self.declare_parameter('safe', 'True')
"""


def test_parameters_are_read_and_set(tmp_path: Path) -> None:
    """Declared parameters come with type and value, others are left out, and a refusal is told.

    One that was declared with another type than the value's is set in its own.
    """
    names = ["limit", "names", "fixed", "safe", "absent"]
    recorded = record_one(
        tmp_path,
        node(PARAMETERS),
        [
            {"wait_for": {"node": "/student", "timeout_s": 20}},
            {"get_parameters": {"node": "/student", "names": names}},
            {"set_parameters": {"node": "/student", "values": {"limit": 2.5}}},
            {
                "set_parameters": {
                    "node": "/student",
                    "values": {"limit": 3, "fixed": 8, "safe": False, "absent": 1},
                }
            },
            {"get_parameters": {"node": "student", "names": names}},
            {"get_parameters": {"node": "/absent", "names": names, "timeout_s": 0.5}},
        ],
    )
    before, after, absent = steps_of(recorded, "get_parameters")
    assert before.result["values"] == {
        "limit": {"type": "double", "value": 1.5},
        "names": {"type": "string_array", "value": ["a", "b"]},
        "fixed": {"type": "integer", "value": 7},
        "safe": {"type": "string", "value": "True"},
    }
    assert "use_sim_time" in before.result["declared"]
    assert after.result["values"]["limit"]["value"] == 3.0
    assert after.result["values"]["safe"]["value"] == "False"
    assert after.result["values"]["fixed"]["value"] == 7
    assert absent.outcome == "timeout"
    taken, refused = steps_of(recorded, "set_parameters")
    assert (taken.outcome, taken.result["refused"]) == ("done", {})
    assert (refused.outcome, sorted(refused.result["refused"])) == ("failed", ["absent", "fixed"])


MISSPELT_PARAMETER = """
        self.declare_parameter('safety_check', True)
        self.declare_parameter('verbose', True)
        self.declare_parameter('speed', 1.0)
"""


def test_a_misspelt_parameter_is_set_as_meant(tmp_path: Path) -> None:
    """A misspelt parameter costs one mistake; its effect is seen under the declared name."""
    recorded = record_one(
        tmp_path,
        node(MISSPELT_PARAMETER),
        [
            {"wait_for": {"node": "/student", "timeout_s": 20}},
            {"set_parameters": {"node": "/student", "values": {"safety_enabled": False}}},
            {"set_parameters": {"node": "/student", "values": {"unlike_all": "x"}}},
            {
                "get_parameters": {
                    "node": "/student",
                    "names": ["safety_check", "verbose", "use_sim_time"],
                }
            },
        ],
    )
    meant, unlike = steps_of(recorded, "set_parameters")
    assert (meant.outcome, meant.result["names"]) == ("done", {"safety_enabled": "safety_check"})
    assert (unlike.outcome, list(unlike.result["refused"])) == ("failed", ["unlike_all"])
    (read,) = steps_of(recorded, "get_parameters")
    held = {name: entry["value"] for name, entry in read.result["values"].items()}
    assert held == {"safety_check": False, "verbose": True, "use_sim_time": False}


UNGUARDED = """
        self.declare_parameter('limit', 1.5)
        self.declare_parameter('mode', 'drive', ParameterDescriptor(read_only=True))
"""


def test_what_a_node_takes_that_it_should_refuse_is_set_back(tmp_path: Path) -> None:
    """A value that a node should have refused is set back after it was accepted.

    A number is set in the parameter's own type, and an ordinary node has no states.
    """
    recorded = record_one(
        tmp_path,
        node(UNGUARDED),
        [
            {"wait_for": {"node": "/student", "timeout_s": 20}},
            {
                "set_parameters": {
                    "node": "/student",
                    "values": {"limit": -3, "mode": "fly"},
                    "refusal_expected": True,
                }
            },
            {"get_parameters": {"node": "/student", "names": ["limit", "mode"]}},
            {"change_state": {"node": "/student", "transition": "configure", "timeout_s": 1}},
            {
                "set_parameters": {
                    "node": "/absent",
                    "values": {"a": 1},
                    "refusal_expected": True,
                    "timeout_s": 0.5,
                }
            },
        ],
    )
    invalid, absent = steps_of(recorded, "set_parameters")
    assert (invalid.outcome, list(invalid.result["refused"])) == ("done", ["mode"])
    assert invalid.result["before"] == {"limit": 1.5, "mode": "drive"}
    assert invalid.result["after"] == {"limit": -3.0, "mode": "drive"}
    (read,) = steps_of(recorded, "get_parameters")
    assert read.result["values"]["limit"] == {"type": "double", "value": 1.5}
    (changed,) = steps_of(recorded, "change_state")
    assert (changed.outcome, absent.outcome) == ("timeout", "timeout")
    assert "as a lifecycle node does" in changed.result["problem"]


# -- publishing, and the graph ----------------------------------------------------------------

SUBSCRIPTIONS = """
        self.counts = {'volatile': 0, 'transient': 0, 'best_effort': 0}
        profiles = {
            'volatile': QoSProfile(depth=50),
            'transient': QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            'best_effort': QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT),
        }
        for kind, profile in profiles.items():
            self.create_subscription(String, '/orders', lambda message, kind=kind: self.count(kind, message), profile)

    def count(self, kind, message):
        self.counts[kind] += message.data == 'go'

    def ending(self):
        print(json.dumps(self.counts), flush=True)
"""


def test_a_publication_reaches_every_kind_of_subscription(tmp_path: Path) -> None:
    """The grader's publications match volatile, transient-local and best-effort requests."""
    recorded = record_one(
        tmp_path,
        node(SUBSCRIPTIONS),
        [
            {"wait_for": {"subscription": "/orders", "type": TEXT, "timeout_s": 20}},
            {
                "publish": {
                    "topic": "/orders",
                    "type": TEXT,
                    "message": {"data": "go"},
                    "count": 100,
                    "rate_hz": 50,
                }
            },
        ],
    )
    (publish,) = steps_of(recorded, "publish")
    assert publish.result == {"topic": "/orders", "matched": True}
    (told,) = recorded.record.published
    assert (told.process, told.topic, told.type) == ("director", "/orders", TEXT)
    assert told.digests == "".join(map(digest, recorded.bag.stream("/orders").data))
    assert recorded.stream("/orders").field("data") == ["go"] * 100
    taken = json.loads(texts(recorded)[0])
    assert (taken["volatile"], taken["transient"]) == (100, 100)
    assert taken["best_effort"] >= 10, (
        "only what came before the student's side was matched may be missing"
    )


PARTICIPANTS = """
        self.create_subscription(String, '/orders', lambda message: None, 10)
        self.seen = set()
        self.create_timer(0.1, self.look)

    def look(self):
        for topic, _ in self.get_topic_names_and_types():
            infos = self.get_publishers_info_by_topic(topic) + self.get_subscriptions_info_by_topic(topic)
            for info in infos:
                # The node of a step that publishes is there only during the step, too short to be seen each time.
                if info.node_namespace.startswith('/_grader') and info.node_name != 'publisher':
                    self.seen.add((info.node_name, bytes(info.endpoint_gid[:12]).hex()))

    def ending(self):
        names, participants = (len(set(each)) for each in zip(*self.seen))
        print(json.dumps([names, participants]), flush=True)
"""


def test_the_recorder_has_no_participant_of_its_own(tmp_path: Path) -> None:
    """Every process of the student would have to know one participant more."""
    orders = {"topic": "/orders", "type": TEXT}
    steps: list[dict[str, Any]] = [
        {"wait_for": {"subscription": "/orders", "type": TEXT, "timeout_s": 20}},
        {"publish": {**orders, "message": {"data": "go"}, "count": 5, "rate_hz": 50}},
        {"get_parameters": {"node": "/student", "names": ["use_sim_time"], "timeout_s": 20}},
        {"observe": {"duration_s": 3}},
    ]
    recorded = record_one(tmp_path, node(PARTICIPANTS), steps)
    steps_of(recorded, "observe")
    assert json.loads(texts(recorded)[0]) == [2, 1]


OFFERED = """
        latched = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL, deadline=Duration(seconds=0.5))
        self.create_publisher(String, '/latched', latched)
        self.create_publisher(String, '/lossy', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
        self.create_subscription(Float64MultiArray, '/input', print, 5)
"""


def endpoints_of_student(recorded: Recorded, *topics: str) -> list[Endpoint]:
    """Return the student's last known endpoint on each topic."""
    found: dict[str, Endpoint] = {}
    for snapshot in recorded.record.graph:
        found |= {each.topic: each for each in snapshot.endpoints if each.node == "/student"}
    return [found[topic] for topic in topics]


def require_identified(endpoints: list[Endpoint]) -> None:
    """Fail unless each endpoint has a type hash, and a gid of its own with its participant's prefix."""
    for endpoint in endpoints:
        assert re.fullmatch(r"[0-9a-f]{32}", endpoint.gid)
        assert re.fullmatch(r"RIHS01_[0-9a-f]{64}", endpoint.type_hash)
    assert len({endpoint.gid for endpoint in endpoints}) == len(endpoints)
    assert len({endpoint.gid[:24] for endpoint in endpoints}) == 1


def test_snapshots_hold_qos_gid_and_type_hash(tmp_path: Path) -> None:
    """A snapshot tells of each endpoint its node, type, type hash, gid and the policies that discovery carries."""
    waits = []
    for topic in ("/latched", "/lossy"):
        waits.append({"wait_for": {"publisher": topic, "type": TEXT, "timeout_s": 20}})
    waits.append({"wait_for": {"subscription": "/input", "type": FLOATS, "timeout_s": 20}})
    recorded = record_one(tmp_path, node(OFFERED), waits)
    assert not recorded.record.problems
    latched, lossy, heard = endpoints_of_student(recorded, "/latched", "/lossy", "/input")
    assert (latched.kind, latched.type, latched.node) == ("publisher", TEXT, "/student")
    assert (heard.kind, heard.type) == ("subscription", FLOATS)
    assert (latched.qos.reliability, latched.qos.durability) == ("reliable", "transient_local")
    assert (latched.qos.deadline_ns, lossy.qos.deadline_ns) == (500_000_000, None)
    assert (lossy.qos.reliability, lossy.qos.durability) == ("best_effort", "volatile")
    assert latched.type_hash == lossy.type_hash != heard.type_hash
    require_identified([latched, lossy, heard])
    for snapshot in recorded.record.graph:
        assert not [name for name in snapshot.nodes if name.startswith("/_grader")]


def test_a_wait_ends_when_the_student_has(tmp_path: Path) -> None:
    """A wait ends with the student's process, because a dead process brings nothing."""
    source = node("        self.create_timer(1.0, lambda: 1 / 0)")
    wait = {"wait_for": {"publisher": "/joint_commands", "type": FLOATS, "timeout_s": 120}}
    recorded = record_one(
        tmp_path, source, [wait, wait, {"call": {"service": "/x", "type": SET_BOOL}}]
    )
    first, second = steps_of(recorded, "wait_for")
    assert (first.outcome, second.outcome) == ("cancelled", "cancelled")
    run = recorded.process("node")
    assert run is not None
    assert run.exited_ns is not None
    assert first.ended_ns - run.exited_ns < 10e9
    assert second.ended_ns - second.started_ns < 1e9
    assert [step.outcome for step in steps_of(recorded, "call")] == ["cancelled"]
    assert "ZeroDivisionError" in "".join(line.text for line in run.output)


LATE = """
        self.create_subscription(String, '/go', self.begin, 10)
        self.hint = None

    def begin(self, message):
        if self.hint is None:
            self.hint = self.create_publisher(String, '/hint', 10)
            self.create_timer(1.5, self.offer)

    def offer(self):
        self.create_service(SetBool, '/late', lambda request, response: response)
"""


def test_what_is_missing_is_waited_for_briefly_until_something_changes(tmp_path: Path) -> None:
    """A missing service is waited for briefly, until a start or a new node may bring it.

    Without this rule a session with a missing service took 66 s.
    """
    wait = {"wait_for": {"service": "/late", "type": SET_BOOL, "timeout_s": 4}}
    call = {"call": {"service": "/late", "type": SET_BOOL, "timeout_s": 4}}
    go = {
        "publish": {
            "topic": "/go",
            "type": TEXT,
            "message": {"data": "go"},
            "count": 1,
            "rate_hz": 10,
        }
    }
    recorded = record_one(
        tmp_path,
        node(LATE),
        [
            {"wait_for": {"node": "/student", "timeout_s": 20}},
            *[wait, call, wait],
            {"start": {"student": "node", "name": "second", "remappings": {"/go": "/other"}}},
            *[
                wait,
                go,
                {"wait_for": {"service": "/late", "type": SET_BOOL, "timeout_s": 20}},
                call,
            ],
            {"interrupt": {"process": "second", "timeout_s": 30}},
        ],
    )
    waits = steps_of(recorded, "wait_for")[1:]
    took_s = [(step.ended_ns - step.started_ns) / 1e9 for step in waits]
    assert [step.outcome for step in waits] == ["timeout", "timeout", "timeout", "done"]
    assert min(took_s[0], took_s[2]) >= 4.0
    assert took_s[1] < 4.0
    first, second = steps_of(recorded, "call")
    assert (first.outcome, second.outcome) == ("timeout", "done")
    assert (first.ended_ns - first.started_ns) / 1e9 < 4.0


def test_services_of_nodes_with_one_name_are_all_seen(tmp_path: Path) -> None:
    """The services of all nodes with one name are seen.

    The middleware lists the services of one of them alone, picked by chance.
    """
    source = node(
        "        self.create_service(SetBool, '/first', lambda request, response: response)"
    )
    recorded = record_one(
        tmp_path,
        source,
        [
            {"start": {"student": "node", "name": "second", "remappings": {"/first": "/second"}}},
            *[
                {"wait_for": {"service": name, "type": SET_BOOL, "timeout_s": 10}}
                for name in ("/first", "/second")
            ],
            {"wait_for": {"service": "/first", "type": SET_BOOL, "timeout_s": 10}},
            {"interrupt": {"process": "second", "timeout_s": 30}},
        ],
    )
    assert [step.outcome for step in steps_of(recorded, "wait_for")] == ["done"] * 3
    services = itertools.chain(*(graph.services for graph in recorded.record.graph))
    assert {service.node for service in services} == {"/student"}
