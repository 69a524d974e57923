"""The simulated arm: its inputs as pure objects, and as a node on a real graph."""

import re
import signal
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from arm import (
    ALIGNMENT,
    COMMANDED_TOPIC,
    LOOKS,
    MEASURED_TOPIC,
    ArmSettings,
    CommandInput,
    DataReader,
    Drawing,
    State,
    marker,
    serialized_clock,
)
from arm_model import CHAIN, ArmModel

from tests.reference.live_graph import Listener, listener, started, stop, use_private_graph

TARGETS = [0.4, -0.3, 0.2, 0.1, 0.0, -0.1, -0.2]


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """A domain for the test alone."""
    return use_private_graph(monkeypatch.setenv, tmp_path)


@pytest.fixture
def student(domain_id: int) -> Iterator[Listener]:
    """A node that listens to the arm, as a student's would."""
    with listener(domain_id) as beside:
        for topic in LOOKS:
            beside.listen(
                topic,
                pytest.importorskip("visualization_msgs.msg", reason="needs the ROS wheels").Marker,
            )
        yield beside


def test_a_step_is_one_clock_message_or_one_state() -> None:
    """With simulation time there is a step for each clock message, otherwise for each state."""
    real, simulated = ArmSettings(rate_hz=50), ArmSettings(rate_hz=50, simulation_time=True)
    assert (real.step_rate_hz, real.steps_per_state, real.steps_per_posture) == (50, 1, 5)
    assert (simulated.step_rate_hz, simulated.steps_per_state, simulated.steps_per_posture) == (
        200,
        4,
        20,
    )


@pytest.mark.parametrize("topic", LOOKS)
def test_a_drawing_is_the_marker_serialized(topic: str) -> None:
    """A drawing is byte for byte the message with the same stamp and points."""
    serialization = pytest.importorskip("rclpy.serialization", reason="needs the ROS wheels")
    drawing = Drawing(topic)
    for shift in (0.25, -3.5):
        points = [(number + shift, -number, shift) for number in range(len(CHAIN))]
        message = marker(topic)
        message.header.stamp.sec, message.header.stamp.nanosec = 12, 345_678_901
        for point, place in zip(message.points, points, strict=True):
            point.x, point.y, point.z = map(float, place)
        assert drawing.serialized(points, 12_345_678_901) == serialization.serialize_message(
            message
        )


def test_a_clock_is_the_message_serialized() -> None:
    """The same bytes come from rclpy's serialization of a time."""
    serialization = pytest.importorskip("rclpy.serialization")
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    message = Clock(clock=Time(sec=12, nanosec=345_678_901))
    assert serialized_clock(12_345_678_901) == serialization.serialize_message(message)


def test_a_state_is_the_message_serialized() -> None:
    """A state is the message with the same data, byte for byte but for old memory before the data."""
    serialization = pytest.importorskip("rclpy.serialization", reason="needs the ROS wheels")
    from std_msgs.msg import Float64MultiArray

    state = State()
    for data in (TARGETS, TARGETS[::-1]):
        expected = serialization.serialize_message(Float64MultiArray(data=data))
        assert aligned_by_zeros(state.serialized(data)) == aligned_by_zeros(expected)


def aligned_by_zeros(plain: bytes) -> bytes:
    """Return a message without a layout, with zeros for the bytes that align its data."""
    place = len(plain) - 8 * len(TARGETS)
    return plain[: place - ALIGNMENT] + bytes(ALIGNMENT) + plain[place:]


def test_commands_are_read_with_any_layout() -> None:
    """The data of a message are the same, whatever else it contains, and bytes that are no message are refused."""
    serialization = pytest.importorskip("rclpy.serialization", reason="needs the ROS wheels")
    from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

    reader = DataReader()
    labelled = MultiArrayLayout(dim=[MultiArrayDimension(label="joints", size=7, stride=7)])
    for layout in (MultiArrayLayout(), MultiArrayLayout(data_offset=1), labelled):
        for data in (TARGETS, TARGETS[::-1], TARGETS[1:], [*TARGETS, 1.0], []):
            message = Float64MultiArray(layout=layout, data=data)
            assert list(reader.read(serialization.serialize_message(message))) == data
    plain = serialization.serialize_message(Float64MultiArray(data=TARGETS))
    require_reading_without_building(reader, plain)
    # With one dimension, which takes 13 bytes and its label, and without data: as long as seven numbers.
    lookalike = MultiArrayLayout(dim=[MultiArrayDimension(label="l" * 40)])
    as_long = serialization.serialize_message(Float64MultiArray(layout=lookalike))
    assert len(as_long) == len(plain)
    assert list(reader.read(as_long)) == []
    with pytest.raises(Exception, match="deserialize"):
        reader.read(plain[:-1])


def require_reading_without_building(reader: DataReader, plain: bytes) -> None:
    """Require reading without a message for any old memory in the bytes that align the data."""
    place = len(plain) - 8 * len(TARGETS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rclpy.serialization.deserialize_message", None)
        for left in (bytes(ALIGNMENT), b"\xff" * ALIGNMENT):
            assert reader.read(plain[: place - ALIGNMENT] + left + plain[place:]) == tuple(TARGETS)


def test_malformed_commands_are_ignored_and_counted() -> None:
    """A command of the wrong length or with a number that is not finite changes nothing."""
    commands = CommandInput()
    for data in (TARGETS, TARGETS[:6], [], [float("nan")] * 7, [float("inf")] * 7):
        commands.hear(data)
    assert commands.latest is not None
    assert list(commands.latest) == TARGETS
    assert commands.ignored == 4


def positions(student: Listener, topic: str = "/joint_states") -> list[float]:
    """Give the latest positions that the arm reported."""
    return list(student.received[topic][-1][1].data)


def posture(student: Listener, topic: str) -> Any:
    """Give the points of a posture that the arm published last."""
    return np.array(
        [(point.x, point.y, point.z) for point in student.received[topic][-1][1].points]
    )


def near(student: Listener, targets: list[float]) -> bool:
    """Return whether the arm's latest positions are the targets, within the sag by its weight."""
    return positions(student) == pytest.approx(targets, abs=5e-3)


def rate_hz(received: list[tuple[int, Any]]) -> float:
    """Give the mean rate of a topic by its source timestamps."""
    return (len(received) - 1) / ((received[-1][0] - received[0][0]) / 1e9)


def keeps(received: list[tuple[int, Any]], wanted_hz: int) -> bool:
    """Tell whether a topic had its rate over its last second; in those before it, the machine may have halted."""
    last = received[-wanted_hz - 1 :]
    if len(last) <= wanted_hz:
        return False
    return rate_hz(last) == pytest.approx(wanted_hz, rel=0.02)


@pytest.mark.live
def test_arm_follows_commands_and_keeps_its_rates(student: Listener, domain_id: int) -> None:
    """The arm goes where a best-effort publisher sends it, at its rates, with a clock of exact steps."""
    from rclpy.qos import qos_profile_sensor_data
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64MultiArray

    configuration = {
        "seed": 3,
        "names": {"/joint_commands": "/cmds"},
        "with": {"simulation_time": True},
    }
    publisher = student.node.create_publisher(Float64MultiArray, "/cmds", qos_profile_sensor_data)
    student.listen("/joint_states", Float64MultiArray)
    student.listen("/clock", Clock)
    states = student.received["/joint_states"]
    with started("arm.py", configuration, domain_id) as arm:
        assert student.spin_until(lambda: len(states) > 10, 30)
        assert max(map(abs, positions(student))) <= 0.05
        assert not student.received[COMMANDED_TOPIC], "nothing is commanded yet"
        # Again and again, as a student's node does: the arm may match the publisher seconds later.
        student.node.create_timer(0.01, lambda: publisher.publish(Float64MultiArray(data=TARGETS)))
        assert student.spin_until(lambda: near(student, TARGETS), 30)
        student.node.create_timer(0.1, lambda: publisher.publish(Float64MultiArray(data=[1.0])))
        student.spin_for(1.0)
        assert student.spin_until(
            lambda: keeps(states, 100) and keeps(student.received["/clock"], 200), 30
        )
        status, rest, error = stop(arm)
    assert near(student, TARGETS)
    require_postures(student)
    require_exact_clock(student)
    assert (status, error) == (0, "")
    # Its queue keeps the latest command, so that a busy arm may never see a malformed one.
    assert re.fullmatch(r"(ignored [1-9]\d* malformed commands\n)?", rest)


def require_postures(student: Listener) -> None:
    """Require both drawn postures to match the model, at their rate."""
    assert posture(student, COMMANDED_TOPIC) == pytest.approx(
        np.array(ArmModel(0.01).posture(TARGETS)), abs=1e-6
    )
    assert posture(student, MEASURED_TOPIC) == pytest.approx(
        posture(student, COMMANDED_TOPIC), abs=5e-3
    )
    assert rate_hz(student.received[MEASURED_TOPIC]) == pytest.approx(10, rel=0.1)


def require_exact_clock(student: Listener) -> None:
    """Require steps of exactly 5 ms on the clock."""
    ticks = [m.clock.sec * 10**9 + m.clock.nanosec for _, m in student.received["/clock"]]
    assert ticks[0] > 0
    assert {b - a for a, b in pairwise(ticks)} == {5_000_000}


def add_timed_node(student: Listener, topic: str, simulation_time: bool) -> None:
    """Add a node beside the listener that publishes from a timer of 0.01 s, and listen to it."""
    import rclpy
    from rclpy.parameter import Parameter
    from std_msgs.msg import Float64MultiArray

    overrides = [Parameter("use_sim_time", value=simulation_time)]
    name = topic.strip("/")
    node = rclpy.create_node(name, context=student.node.context, parameter_overrides=overrides)
    publisher = node.create_publisher(Float64MultiArray, topic, 10)
    node.create_timer(0.01, lambda: publisher.publish(Float64MultiArray()))
    student.executor.add_node(node)
    student.listen(topic, Float64MultiArray)


@pytest.mark.live
def test_arm_without_states_is_still_drawn(student: Listener, domain_id: int) -> None:
    """Where students' nodes are to be alone with their own topics, the arm publishes its postures and no states."""
    with started("arm.py", {"seed": 1, "with": {"states": False, "rate_hz": 50}}, domain_id):
        assert student.spin_until(lambda: len(student.received[MEASURED_TOPIC]) > 5, 30)
        assert "/joint_states" not in dict(student.node.get_topic_names_and_types())


@pytest.mark.live
def test_simulation_time_keeps_a_100_hz_timer_at_100_hz(student: Listener, domain_id: int) -> None:
    """A timer of 0.01 s ticks as often on the arm's clock as on the machine's own, which may be busy."""
    add_timed_node(student, "/simulated", simulation_time=True)
    add_timed_node(student, "/real", simulation_time=False)
    with started("arm.py", {"seed": 5, "with": {"simulation_time": True}}, domain_id):
        assert student.spin_until(lambda: len(student.received["/simulated"]) > 10, 30)
        # A machine that holds up only one of the two processes does so for a while.
        assert any(alike(student, "/simulated", "/real") for _ in range(10))


def alike(student: Listener, one: str, other: str) -> bool:
    """Receive for two seconds, and tell whether two topics had the same rate in them."""
    for received in student.received.values():
        received.clear()
    student.spin_for(2.0)
    both = [student.received[topic] for topic in (one, other)]
    if min(map(len, both)) <= 10:
        return False
    return rate_hz(both[0]) == pytest.approx(rate_hz(both[1]), rel=0.1)


class Enabling:
    """A SetBool service that grants or refuses, and the grader's introspected client of it."""

    def __init__(self, atomic_replacement: Listener, name: str) -> None:
        from rclpy.qos import qos_profile_system_default
        from rclpy.service_introspection import ServiceIntrospectionState
        from std_srvs.srv import SetBool

        self.granting, self._beside, self._request = True, atomic_replacement, SetBool.Request
        atomic_replacement.node.create_service(SetBool, name, self._answer)
        self.client = atomic_replacement.node.create_client(SetBool, name)
        self.client.configure_introspection(
            atomic_replacement.node.get_clock(),
            qos_profile_system_default,
            ServiceIntrospectionState.CONTENTS,
        )

    def _answer(self, request: Any, response: Any) -> Any:
        response.success = self.granting or not request.data
        return response

    def call(self, wanted: bool, then_s: float) -> None:
        """Ask for a change, wait for the answer, and give the arm time."""
        future = self.client.call_async(self._request(data=wanted))
        assert self._beside.spin_until(future.done, 20)
        self._beside.spin_for(then_s)


@pytest.mark.live
def test_enable_service_gates_the_motion(student: Listener, domain_id: int) -> None:
    """The arm moves only while the service, called by an introspected client, last granted true."""
    from std_msgs.msg import Float64MultiArray

    enabling = Enabling(student, "/enable")
    publisher = student.node.create_publisher(Float64MultiArray, "/joint_commands", 10)
    student.listen("/joint_states", Float64MultiArray)

    target = [0.0] * 7
    student.node.create_timer(0.01, lambda: publisher.publish(Float64MultiArray(data=target)))
    configuration = {"seed": 1, "with": {"enable_service": "/enable", "initial_offset_rad": 0.0}}
    with started("arm.py", configuration, domain_id):
        assert student.spin_until(lambda: bool(student.received["/joint_states"]), 30)
        target = TARGETS
        student.spin_for(0.3)
        assert positions(student) == [0.0] * 7, "not yet enabled"
        for _ in range(20):  # until the arm has matched the client's events, which may take seconds
            enabling.call(True, then_s=0.5)
            if near(student, TARGETS):
                break
        assert near(student, TARGETS), "granted"
        enabling.call(False, then_s=0.1)
        target = [0.0] * 7
        student.spin_for(0.3)
        assert near(student, TARGETS), "disabled"
        enabling.granting = False
        enabling.call(True, then_s=0.3)
        assert near(student, TARGETS), "refused"
        enabling.granting = True
        enabling.call(True, then_s=0.0)
        assert student.spin_until(lambda: near(student, target), 30), "granted again"


@pytest.mark.live
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_arm_stops_quietly(domain_id: int, number: int) -> None:
    """Either signal ends the arm with status 0 and without a word."""
    with started("arm.py", {"seed": 1}, domain_id) as arm:
        assert stop(arm, number) == (0, "", "")


@pytest.mark.live
def test_a_flood_of_large_messages_keeps_no_step_waiting(student: Listener, domain_id: int) -> None:
    """Messages with thousands of empty dimensions come faster than they can be decoded; the arm steps and follows."""
    from rclpy.qos import qos_profile_sensor_data
    from rclpy.serialization import serialize_message
    from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

    layout = MultiArrayLayout(dim=[MultiArrayDimension() for _ in range(3000)])
    crowd = serialize_message(Float64MultiArray(layout=layout, data=TARGETS[::-1]))
    publisher = student.node.create_publisher(Float64MultiArray, "/cmds", qos_profile_sensor_data)
    student.listen("/joint_states", Float64MultiArray)
    states = student.received["/joint_states"]
    configuration = {"seed": 1, "names": {"/joint_commands": "/cmds"}, "with": {"rate_hz": 100}}
    with started("arm.py", configuration, domain_id) as arm:
        assert student.spin_until(lambda: len(states) > 10, 30)

        def flood() -> None:
            for _ in range(20):
                publisher.publish(crowd)
            publisher.publish(Float64MultiArray(data=TARGETS))

        student.node.create_timer(0.01, flood)
        count = len(states)
        assert student.spin_until(lambda: len(states) > count + 100, 30)
        assert student.spin_until(lambda: near(student, TARGETS), 30)
        _, rest, _ = stop(arm)
    # Its queue keeps the latest command, so that a busy arm may never see a malformed one.
    assert re.fullmatch(r"(ignored [1-9]\d* malformed commands\n)?", rest)
