"""The simulated arm as a ROS 2 node: follows `/joint_commands`, publishes `/joint_states`, and time if asked.

Settings (the rubric's `with`) are the fields of `ArmSettings`; how it is started is told in
`grader.reference_node`.
"""

from __future__ import annotations

import math
import random
import sys
import time
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

# `python -I` leaves the script's own folder off the path; its sibling modules are found there.
sys.path.insert(0, str(Path(__file__).resolve().parent))

from arm_model import JOINT_COUNT, ArmModel

from grader.reference_node import Configuration, ReferenceNode, StopRequest, reference_node, run, sleep_until

if TYPE_CHECKING:
    from rclpy.node import Node

# Between two steps a busy client may make many calls, with two events each.
EVENT_DEPTH = 1000
COMMAND_TOPIC, STATE_TOPIC, CLOCK_TOPIC = "/joint_commands", "/joint_states", "/clock"
# Short lateness is caught up in a burst of steps; after a longer one (a stopped process, a starved machine)
# the schedule starts anew from now, as a simulator's real-time factor drops.
CATCH_UP_LIMIT_NS = 100_000_000


@dataclass(frozen=True)
class ArmSettings:
    """What the rubric may choose.

    Attributes
    ----------
    rate_hz : float
        Rate of `/joint_states`.
    simulation_time : bool
        Publish `/clock`.
    clock_rate_hz : float
        Rate of `/clock`; a whole multiple of `rate_hz`. Twice the rate of a student's timer: at the same
        rate, two clock messages that come close together on a busy machine cost the timer a period.
    max_velocity : float
        Scales the velocity limits.
    enabled : bool or None
        Whether the arm moves at the start; None means yes, unless there is an `enable_service`.
    enable_service : str or None
        SetBool service that gates the motion. The arm calls nothing: it reads the service events of the
        grader's client, and takes over a request that was answered with success.
    initial_offset_rad : float
        Largest distance of each joint from zero at the start.
    noise_rad : float
        Standard deviation of the measured positions.
    match_timeout_s : float
        Begin even where the recorder is not there after this time.
    """

    rate_hz: float = 100.0
    simulation_time: bool = False
    clock_rate_hz: float = 200.0
    max_velocity: float = 1.0
    enabled: bool | None = None
    enable_service: str | None = None
    initial_offset_rad: float = 0.05
    noise_rad: float = 0.0
    match_timeout_s: float = 5.0

    def __post_init__(self) -> None:
        for name in ("rate_hz", "clock_rate_hz", "max_velocity"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive")
        if self.initial_offset_rad < 0 or self.noise_rad < 0:
            raise ValueError("initial_offset_rad and noise_rad must not be negative")
        if self.simulation_time and abs(self.clock_rate_hz / self.rate_hz - self.steps_per_state) > 1e-9:
            raise ValueError("clock_rate_hz must be a whole multiple of rate_hz")

    @property
    def steps_per_state(self) -> int:
        """Number of steps between two published states."""
        return max(1, round(self.clock_rate_hz / self.rate_hz)) if self.simulation_time else 1

    @property
    def step_rate_hz(self) -> float:
        """Steps per second: one for each `/clock` message, or else for each state."""
        return self.clock_rate_hz if self.simulation_time else self.rate_hz


class EnableGate:
    """Whether the arm may move, judged from the service events of the grader's client.

    A client's request and the response to it are separate events with the client's gid and a
    sequence number in common.
    """

    def __init__(self, enabled: bool) -> None:
        self.enabled = enabled
        self._asked: dict[tuple[bytes, int], bool] = {}

    def hear(self, message: Any) -> None:
        """Take a `SetBool_Event` into account."""
        info = message.info
        call = (bytes(info.client_gid), info.sequence_number)
        if info.event_type == info.REQUEST_SENT and message.request:
            self._asked[call] = message.request[0].data
        elif info.event_type == info.RESPONSE_RECEIVED and message.response:
            wanted = self._asked.pop(call, None)
            if wanted is not None and message.response[0].success:
                self.enabled = wanted


class CommandInput:
    """The latest well-formed command; others are ignored and counted."""

    def __init__(self) -> None:
        self.latest: Sequence[float] | None = None
        self.ignored = 0

    def hear(self, message: Any) -> None:
        """Take a `Float64MultiArray` into account."""
        if len(message.data) == JOINT_COUNT and all(map(math.isfinite, message.data)):
            self.latest = message.data
        else:
            self.ignored += 1


def take_all(subscription: Any, hear: Callable[[Any], None]) -> None:
    """Hand all messages that have arrived to `hear`.

    The arm takes its messages itself, as an executor would, once in each step: that costs half of a
    `spin_once` and keeps everything in one thread, so that no callback can delay a step.
    """
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            hear(taken[0])


def arm_qos(reliable: bool, depth: int = 10) -> Any:
    """Give the profile of the arm's endpoints: volatile, keep last."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


class SimulatedArm:
    """The node's endpoints and the arm's state."""

    def __init__(self, reference: ReferenceNode, configuration: Configuration, settings: ArmSettings) -> None:
        self.settings = settings
        self.model = ArmModel(1.0 / settings.step_rate_hz, settings.max_velocity)
        self.state = self.model.initial_state(configuration.seed, settings.initial_offset_rad)
        self.commands = CommandInput()
        enabled = settings.enabled if settings.enabled is not None else settings.enable_service is None
        self.gate = EnableGate(enabled)
        self._draw = random.Random(f"arm noise {configuration.seed}")
        # In whole milliseconds, as simulators count; never zero, which would mean "no time yet".
        start_ms = random.Random(f"arm clock {configuration.seed}").randrange(10_000, 900_000)
        self._clock_start_ns = start_ms * 10**6
        self._open_inputs(reference.node, configuration)
        self._open_outputs(reference, configuration)

    def _open_inputs(self, node: Node, configuration: Configuration) -> None:
        from std_msgs.msg import Float64MultiArray

        # Requests the least, so that it hears every publisher: a wrong QoS is judged elsewhere.
        qos = arm_qos(reliable=False)
        topic = configuration.name(COMMAND_TOPIC)
        inputs: list[CommandInput | EnableGate] = [self.commands]
        subscriptions = [node.create_subscription(Float64MultiArray, topic, self.commands.hear, qos)]
        if self.settings.enable_service is not None:
            from std_srvs.srv import SetBool

            topic = configuration.name(self.settings.enable_service) + "/_service_event"
            inputs.append(self.gate)
            qos = arm_qos(reliable=False, depth=EVENT_DEPTH)
            subscriptions.append(node.create_subscription(SetBool.Event, topic, self.gate.hear, qos))
        self._inputs = list(zip(subscriptions, inputs, strict=True))

    def _open_outputs(self, reference: ReferenceNode, configuration: Configuration) -> None:
        from std_msgs.msg import Float64MultiArray

        qos = arm_qos(reliable=True)
        self._state_message = Float64MultiArray()
        self._states = reference.open_publisher(Float64MultiArray, configuration.name(STATE_TOPIC), qos)
        self._clock = None
        if self.settings.simulation_time:
            from rosgraph_msgs.msg import Clock

            self._clock_message = Clock()
            self._clock = reference.open_publisher(Clock, CLOCK_TOPIC, qos)

    def step(self, count: int, elapsed_ns: int) -> None:
        """Do the step `count`, `elapsed_ns` after the first: read the inputs, move, publish."""
        for subscription, heard_by in self._inputs:
            take_all(subscription, heard_by.hear)
        if self.commands.latest is not None:
            self.state = self.model.step(self.state, self.commands.latest, self.gate.enabled)
        if self._clock is not None:
            now = self._clock_message.clock
            now.sec, now.nanosec = divmod(self._clock_start_ns + elapsed_ns, 10**9)
            self._clock.publish(self._clock_message)
        if count % self.settings.steps_per_state == 0:
            self._state_message.data = array("d", self._measured())
            self._states.publish(self._state_message)

    def _measured(self) -> Sequence[float]:
        if not self.settings.noise_rad:
            return self.state.positions
        return [q + self._draw.gauss(0.0, self.settings.noise_rad) for q in self.state.positions]


def play(configuration: Configuration, settings: ArmSettings, stop: StopRequest) -> None:
    """Step the arm at its rate, paced by absolute deadlines, until a stop is requested."""
    with reference_node("simulated_arm") as reference:
        arm = SimulatedArm(reference, configuration, settings)
        print("ready", flush=True)
        reference.wait_until_recorded(stop, settings.match_timeout_s)
        start_ns, count = time.monotonic_ns(), 0
        while not stop:
            elapsed_ns = round(count * 1e9 / settings.step_rate_hz)
            sleep_until(start_ns + elapsed_ns, stop)
            late_ns = time.monotonic_ns() - start_ns - elapsed_ns
            if late_ns > CATCH_UP_LIMIT_NS:
                start_ns += late_ns
            arm.step(count, elapsed_ns)
            count += 1
    if arm.commands.ignored:
        print(f"ignored {arm.commands.ignored} malformed commands", flush=True)


if __name__ == "__main__":
    sys.exit(run(ArmSettings, play))
