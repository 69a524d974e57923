"""Common parts of the reference nodes of all labs: their configuration, their node, their pace and their end.

A reference node is a program of the lab, in the folder of its rubric, that runs beside students' nodes:

    import sys
    from dataclasses import dataclass
    from grader.reference_node import reference_node, run

    @dataclass(frozen=True)
    class Settings:
        rate_hz: float = 10.0

    def play(configuration, settings, stop):
        with reference_node("beacon") as reference:
            publisher = reference.open_publisher(Int64, configuration.name("/count"), 10)
            print("ready", flush=True)
            while not stop:
                ...

    sys.exit(run(Settings, play))

It is started with one argument, `{"seed": 1, "names": {...}, "with": {...}}`. It prints `ready` once all its endpoints
exist, runs until SIGINT or SIGTERM, and exits with status 0.

With `-` as its argument, it reads the configuration from the first line of standard input, and other users of the
machine cannot see it on the command line. It then prints its identity in the graph, and opens no endpoint before the
second line: the grader first keeps packets of other programs in its name away from the recorder.

It also prints the digests of its messages (see `grader.recording.trusted_channel`). All its messages must be in the
recording if it published nothing before `wait_until_recorded`.
"""

from __future__ import annotations

import json
import os
import secrets
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

from grader.recording.session import GRADER_NAMESPACE, PARTICIPANT_DIGITS
from grader.recording.trusted_channel import digest

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.qos import QoSProfile

BAD_CONFIGURATION_STATUS = 2
#: Argument of a node that reads its configuration from standard input.
FROM_INPUT = "-"
#: Digests in a line of output, which may not be longer than 8 KiB.
DIGESTS_IN_LINE = 500
#: Largest size of all messages that wait for their digests, in bytes; computing these takes half a millisecond.
MOST_WAITING_BYTES = 8 * 1024
MATCH_POLL_NS = 10_000_000

#: Keys of the configuration with objects, in the order of `Configuration`.
_OBJECTS = ("names", "with", "subscriptions", "types")

T = TypeVar("T")


class ConfigurationError(ValueError):
    """The configuration on the command line cannot be used."""


@dataclass(frozen=True)
class Configuration:
    """A reference node's only input."""

    #: Seed of all random choices.
    seed: int = 0
    #: Topic or service name in the rubric -> name in the student's graph.
    names: dict[str, str] = field(default_factory=dict)
    #: The rubric's `with`.
    settings: dict[str, Any] = field(default_factory=dict)
    #: Topic on the graph -> number of the student's subscriptions. DDS counts the subscriptions of a dead process until
    #: their lease has run out.
    subscriptions: dict[str, int] = field(default_factory=dict)
    #: Topic on the graph -> type of these subscriptions.
    types: dict[str, str] = field(default_factory=dict)

    def name(self, rubric_name: str) -> str:
        """Return the name on the graph of a topic or service of the rubric."""
        return self.names.get(rubric_name, rubric_name)


def parse_configuration(text: str) -> Configuration:
    """Read a JSON object such as `{"seed": 1, "names": {"/in": "/input"}}`; raises ConfigurationError for other texts."""
    try:
        plain = json.loads(text)
    except ValueError as problem:
        raise ConfigurationError(f"the configuration is not JSON: {problem}") from problem
    if not isinstance(plain, dict) or not plain.keys() <= {"seed", *_OBJECTS}:
        raise ConfigurationError(
            'the configuration must be an object with "seed", "names", "with" and "subscriptions"'
        )
    seed = plain.get("seed", 0)
    objects = [plain.get(key) or {} for key in _OBJECTS]
    if not isinstance(seed, int) or not all(isinstance(each, dict) for each in objects):
        raise ConfigurationError(
            '"seed" must be an integer, "names", "with" and "subscriptions" objects'
        )
    return Configuration(seed, *objects)


def build_settings(kind: type[T], plain: dict[str, Any]) -> T:
    """Build a settings dataclass from the rubric's `with`; raises ConfigurationError if a setting does not fit."""
    known = sorted(f.name for f in fields(kind))  # type: ignore[arg-type]
    for key in plain:
        if key not in known:
            raise ConfigurationError(
                f"unknown setting {key!r}; the settings are {', '.join(known)}"
            )
    try:
        return kind(**plain)
    except (TypeError, ValueError) as problem:
        raise ConfigurationError(str(problem)) from problem


class StopRequest:
    """True as soon as SIGINT or SIGTERM has come, even if the parent had ignored them."""

    def __init__(self) -> None:
        self._requested = False
        # Python goes on with a call of `time.sleep` after a signal. It writes a byte here, which ends a `select`.
        self._signals, written = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.set_wakeup_fd(written, warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._requested = True

    def __bool__(self) -> bool:
        return self._requested

    def wait(self, timeout_s: float) -> None:
        """Sleep for a time, or until a signal has come."""
        signalled, _, _ = select.select([self._signals], [], [], timeout_s)
        if signalled:
            os.read(self._signals, select.PIPE_BUF)


def sleep_until(deadline_ns: int, stop: StopRequest) -> None:
    """Sleep until `time.monotonic_ns()` reaches the deadline, or a stop is requested."""
    while not stop:
        left_ns = deadline_ns - time.monotonic_ns()
        if left_ns <= 0:
            break
        stop.wait(left_ns / 1e9)


class ReportingPublisher:
    """A publisher that keeps the digest of each message, to report it through the pipe."""

    def __init__(self, node: Node, message_class: type, topic: str, qos: QoSProfile) -> None:
        from rclpy.serialization import serialize_message

        self.message_class = message_class
        package, folder, *_ = message_class.__module__.split(".")
        self.topic_type = f"{package}/{folder}/{message_class.__name__}"
        self._node = node
        self._serialize = serialize_message
        self._publisher = node.create_publisher(message_class, topic, qos)
        self._digests: list[str] = []
        #: Messages without a digest. Between two messages, other work pushes the code of digests out of the caches, so
        #: that digests of many messages at a time take less CPU time.
        self._waiting: list[bytes] = []
        self._waiting_bytes = 0

    @property
    def topic(self) -> str:
        """The topic's fully qualified name."""
        return str(self._publisher.topic_name)

    @property
    def subscription_count(self) -> int:
        """Number of matched subscriptions."""
        return int(self._publisher.get_subscription_count())

    def publish(self, message: Any) -> None:
        """Publish a message."""
        self.publish_serialized(self._serialize(message))

    def publish_serialized(self, data: bytes) -> None:
        """Publish the serialized bytes of a message."""
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        self._publisher.publish(data)
        if self._waiting_bytes > MOST_WAITING_BYTES:
            self._digest_waiting()

    def _digest_waiting(self) -> None:
        """Replace the waiting messages by their digests; a stimulus may hold a value for hundreds of messages."""
        known = {data: digest(data) for data in set(self._waiting)}
        for data in self._waiting:
            self._digests.append(known[data])
        self._waiting = []
        self._waiting_bytes = 0

    def report(self, *, recorded: bool) -> None:
        """Print the digests of all messages, in order."""
        self._digest_waiting()
        last = " recorded" if recorded else ""
        for first in range(0, max(1, len(self._digests)), DIGESTS_IN_LINE):
            digests = "".join(self._digests[first : first + DIGESTS_IN_LINE]) or "-"
            print(f"published {self.topic} {self.topic_type} {digests}{last}", flush=True)


class ReferenceNode:
    """A node that reports its identity and its messages through the pipe."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._publishers: list[ReportingPublisher] = []
        #: Types of its topics by name, including the topics of its actions.
        self._topics: dict[str, str] = {}
        self._recorded = False

    def open_publisher(
        self, message_class: type, topic: str, qos: QoSProfile
    ) -> ReportingPublisher:
        """Open a publisher; a reference node must open each of its publishers by this method."""
        publisher = ReportingPublisher(self.node, message_class, topic, qos)
        self._publishers.append(publisher)
        self._topics[publisher.topic] = publisher.topic_type
        return publisher

    def open_action_server(
        self, action_class: type, name: str, execute: Callable[[Any], Any], **more: Any
    ) -> Any:
        """Open rclpy's action server with further arguments; a reference node must open each of its servers by this method.

        Goals are answered while the node spins. Feedback is in the recording if the node spins after `wait_until_recorded`.
        """
        from rclpy.action import ActionServer

        server = ActionServer(self.node, action_class, name, execute, **more)
        action = f"{self.node.resolve_topic_name(name)}/_action"
        package, folder, *_ = action_class.__module__.split(".")
        feedback_type = f"{package}/{folder}/{action_class.__name__}_FeedbackMessage"
        self._topics[f"{action}/feedback"] = feedback_type
        self._topics[f"{action}/status"] = "action_msgs/msg/GoalStatusArray"
        return server

    def wait_until_recorded(
        self,
        stop: StopRequest,
        timeout_s: float,
        ready: Callable[[ReportingPublisher], bool] = lambda publisher: True,
    ) -> None:
        """Wait until the recorder has subscribed to each topic and action of this node, and each publisher is `ready`.

        The node must call this before its first message. After the timeout it returns too; messages that the recorder
        then misses count as missing.
        """
        self._recorded = True
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        missing = list(self._topics)
        while not stop and time.monotonic_ns() < deadline_ns:
            if self._all_recorded(missing) and all(map(ready, self._publishers)):
                return
            sleep_until(min(time.monotonic_ns() + MATCH_POLL_NS, deadline_ns), stop)

    def _all_recorded(self, missing: list[str]) -> bool:
        """Strike recorded topics from a list, and return whether none is left."""
        while missing:
            if not self._is_recorded(missing[-1]):
                return False
            missing.pop()
        return True

    def _is_recorded(self, topic: str) -> bool:
        topic_type = self._topics[topic]
        try:
            # Counting subscriptions takes a small part of the time of describing them.
            if not self.node.count_subscribers(topic):
                return False
            found = self.node.get_subscriptions_info_by_topic(topic)
        except (UnicodeDecodeError, RuntimeError):
            return False  # A student's node may have a name that is not text.
        subscribers = [(info.node_namespace, info.topic_type) for info in found]
        return (GRADER_NAMESPACE, topic_type) in subscribers

    def report_participant(self) -> None:
        """Print the first digits of its gids, from those on a topic with a name that no other node can know."""
        from std_msgs.msg import Empty

        topic = f"/_grader/_{secrets.token_hex(8)}"
        publisher = self.node.create_publisher(Empty, topic, 1)
        (info,) = self.node.get_publishers_info_by_topic(topic)
        self.node.destroy_publisher(publisher)
        gid = bytes(info.endpoint_gid).hex()
        print(f"participant {gid[:PARTICIPANT_DIGITS]}", flush=True)

    def report_published(self) -> None:
        """Print the digests of all its messages."""
        for publisher in self._publishers:
            publisher.report(recorded=self._recorded)


@contextmanager
def reference_node(name: str) -> Iterator[ReferenceNode]:
    """Yield a node that cannot be steered from outside: no services, no ROS arguments, no rosout."""
    import rclpy
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(
        name,
        start_parameter_services=False,
        enable_rosout=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )
    reference = ReferenceNode(node)
    reference.report_participant()
    if sys.argv[1:] == [FROM_INPUT]:
        sys.stdin.readline()
    try:
        yield reference
    finally:
        reference.report_published()
        node.destroy_node()
        rclpy.try_shutdown()


def run(kind: type[T], play: Callable[[Configuration, T, StopRequest], None]) -> int:
    """Run a reference node's `play` with the configuration of the command line, and return the exit status."""
    stop = StopRequest()
    try:
        if len(sys.argv) != 2:
            raise ConfigurationError(
                "one argument is expected: the configuration as a JSON object, or -"
            )
        text = sys.argv[1]
        if text == FROM_INPUT:
            text = sys.stdin.readline()
        configuration = parse_configuration(text)
        settings = build_settings(kind, configuration.settings)
    except ConfigurationError as problem:
        print(f"{sys.argv[0]}: {problem}", file=sys.stderr)
        return BAD_CONFIGURATION_STATUS
    play(configuration, settings, stop)
    return 0
