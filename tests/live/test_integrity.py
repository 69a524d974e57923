"""Integrity in real sandboxes: a node that tampers with all, an honest one, and a reference that leaves."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from grader.evidence.integrity import tampering_in  # noqa: E402
from grader.evidence.recorded import Recorded  # noqa: E402
from grader.live.sandbox.environment import trusted_environment  # noqa: E402
from grader.result import ViolationKind  # noqa: E402
from tests.live.small_lab import TALKER, make_lab, texts  # noqa: E402
from tests.reference.live_graph import own_domain  # noqa: E402

pytestmark = pytest.mark.live

NODES = {"beacon": "/beacon"}

#: A reference node that counts aloud at 50 Hz; its log and parameters are out of reach.
BEACON = """
import sys, time
from dataclasses import dataclass
from grader.reference_node import reference_node, run, sleep_until

@dataclass(frozen=True)
class Settings:
    leaves: bool = False

def play(configuration, settings, stop):
    from std_msgs.msg import Int64
    with reference_node("beacon") as reference:
        publisher = reference.open_publisher(Int64, "/count", 10)
        print("ready", flush=True)
        count = 0
        while not stop and not (settings.leaves and count == 10):
            count += 1
            publisher.publish(Int64(data=count))
            sleep_until(time.monotonic_ns() + 20_000_000, stop)

sys.exit(run(Settings, play))
"""

#: Takes the beacon's name, counts too, logs in its name, and asks to change its parameters.
TOUCHER = """
import rclpy
from rcl_interfaces.msg import Log, Parameter, ParameterEvent
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Int64

rclpy.init()
node = rclpy.create_node('toucher')
twin = rclpy.create_node(TWIN, namespace=SPACE)
counter = node.create_publisher(Int64, '/count', 10)
log = node.create_publisher(Log, '/rosout', 10)
events = node.create_publisher(ParameterEvent, '/parameter_events', 10)
client = node.create_client(SetParameters, '/beacon/set_parameters')

def tick():
    counter.publish(Int64(data=-1))
    log.publish(Log(name='beacon', msg='all is well'))
    events.publish(ParameterEvent(node='/beacon', changed_parameters=[Parameter(name='use_sim_time')]))

node.create_timer(0.02, tick)
print('service:', client.wait_for_service(timeout_sec=1.0), flush=True)
rclpy.spin(node)
"""

#: Hears the beacon, and has a topic, a service and a second node of its own.
HONEST = """
import rclpy
from std_msgs.msg import Int64
from std_srvs.srv import SetBool

rclpy.init()
node, other = rclpy.create_node('honest'), rclpy.create_node('helper')
node.create_subscription(Int64, '/count', lambda message: own.publish(message), 10)
own = other.create_publisher(Int64, '/heard', 10)
never = other.create_publisher(Int64, '/count', 10)
other.create_service(SetBool, '/go', lambda request, response: response)
rclpy.spin(node)
"""


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recorded]:
    """Record all sessions, side by side."""
    folder = tmp_path_factory.mktemp("integrity")
    sources = {
        "twin": TOUCHER.replace("TWIN", "'beacon'").replace("SPACE", "None"),
        "probe": TOUCHER.replace("TWIN", "'probe'").replace("SPACE", "'/_grader'"),
        "honest": HONEST,
        "talker": TALKER,
    }
    steps = {}
    for name, node in (
        ("twin", "toucher"),
        ("probe", "toucher"),
        ("honest", "honest"),
        ("talker", "talker"),
    ):
        steps[name] = [
            {"start": {"reference": "beacon", "with": {"leaves": name == "talker"}}},
            {"start": {"student": name}},
            {"wait_for": {"node": f"/{node}", "timeout_s": 20}},
            *(
                [{"wait_for": {"output_of": name, "text": "service: ", "timeout_s": 20}}]
                if node == "toucher"
                else []
            ),
            {"observe": {"duration_s": 1.2, "first_message_on": "/count"}},
            {"interrupt": {"process": name}},
        ]
    lab = make_lab(folder, sources, {})
    (folder / "beacon.py").write_text(BEACON, encoding="utf-8")
    plain = yaml.safe_load(lab.rubric_file.read_text(encoding="utf-8"))
    plain["reference"] = {"beacon": {"file": "beacon.py", "node": "/beacon"}}
    plain["sessions"] = {name: {"steps": listed} for name, listed in steps.items()}
    lab.rubric_file.write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")
    return lab.record()


def kinds(recorded: Recorded) -> list[ViolationKind]:
    """Give the kinds of all that the census found in a session without problems."""
    assert recorded.record.complete
    assert not recorded.record.problems
    return [tampering.violation.kind for tampering in tampering_in(recorded, NODES)]


def counted(recorded: Recorded) -> list[int]:
    """Give the numbers that checks see on the beacon's topic."""
    return [int(value) for value in recorded.stream("/count").field("data")]


def test_a_twin_of_a_reference_node_is_found(sessions: dict[str, Recorded]) -> None:
    """Its name and its messages are found, and the beacon's own messages are seen without them."""
    recorded = sessions["twin"]
    assert kinds(recorded) == [
        ViolationKind.IMPERSONATES_NODE,
        ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC,
        ViolationKind.CHANGES_REFERENCE,
    ]
    numbers = counted(recorded)
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert len(numbers) > 10
    for tampering in tampering_in(recorded, NODES):
        assert tampering.violation.certain


def test_what_is_said_in_the_name_of_a_reference_node_is_found(
    sessions: dict[str, Recorded],
) -> None:
    """A node in the grader's namespace, log messages and parameter events that name the beacon."""
    assert kinds(sessions["probe"]) == [
        ViolationKind.IMPERSONATES_NODE,
        ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC,
        ViolationKind.CHANGES_REFERENCE,
        ViolationKind.FORGES_ROSOUT,
        ViolationKind.FORGES_PARAMETER_EVENTS,
    ]


def test_no_parameter_of_a_reference_node_can_be_changed(sessions: dict[str, Recorded]) -> None:
    """The node offers no service at all: a client waits in vain."""
    recorded = sessions["probe"]
    assert texts(recorded, "probe") == ["service: False"]
    for graph in recorded.record.graph:
        assert "/beacon" not in {service.node for service in graph.services}


def test_an_honest_node_touches_nothing(sessions: dict[str, Recorded]) -> None:
    """Several nodes in a process, services, and a publisher that is never used are all its own."""
    recorded = sessions["honest"]
    assert kinds(recorded) == []
    assert {trusted.process for trusted in recorded.record.trusted} == {"director", "beacon"}
    assert len(counted(recorded)) > 10


def test_a_reference_node_that_leaves_decides_nothing(sessions: dict[str, Recorded]) -> None:
    """Also with exit status 0: nothing can be judged by such a session."""
    (problem,) = sessions["talker"].record.problems
    assert "beacon ended" in problem


@pytest.mark.skipif(
    all(name == "lo" for _, name in socket.if_nameindex()), reason="not a network of our own"
)
def test_other_nodes_in_the_network_are_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where sandboxes share a network, nodes that were there before are told, and not taken for the student's."""
    import rclpy

    domain_id, _ = own_domain()
    context = rclpy.Context()
    environment = trusted_environment(tmp_path, domain_id)
    for name, value in environment.items():
        if name.startswith(("FASTDDS", "ROS_AUTOMATIC")):
            monkeypatch.setenv(name, value)
    rclpy.init(context=context, domain_id=domain_id)
    stranger = rclpy.create_node("stranger", context=context)
    # The director looks until it finds the stranger, not for half a second: its speed is not tested
    # here.
    program = f"""
from pathlib import Path
from grader.live.ros_node import director
director._FOREIGN_S = 30.0
director.Director(Path({str(tmp_path)!r}), "bag", {domain_id}, set(), set()).serve()
"""
    command = [sys.executable, "-I", "-c", program]
    try:
        run = subprocess.run(
            command,
            input='{"op": "stop"}\n',
            env=environment,
            cwd="/",
            capture_output=True,
            text=True,
            timeout=60,
        )
    finally:
        stranger.destroy_node()
        context.shutdown()
    told = [json.loads(line) for line in run.stdout.splitlines()]
    (problem,) = (value for name, value in told if name == "problems")
    assert "/stranger" in problem
