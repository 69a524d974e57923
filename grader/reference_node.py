"""What the reference nodes of all labs share: their configuration, their node, their pace and their end.

A reference node is a program beside a lab's rubric, which stands beside students' nodes and is none of theirs:

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

It is started with one argument, `{"seed": 1, "names": {...}, "with": {...}}`, or with `-` in place of it, and reads it
from standard input then: who may see the command line learns nothing from it. It prints `ready` once all its endpoints
exist, runs until SIGINT or SIGTERM, and exits with status 0.

It also prints who it is in the graph, and what it published (see `grader.recording.trusted_channel`). All that a node
published has to be in the recording if it published nothing before `wait_until_recorded`.
"""

from __future__ import annotations

import json
import secrets
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

# No sleep is longer than this, so that a stop is noticed soon: a signal does not cut `time.sleep` short.
LONGEST_SLEEP_S = 0.02
BAD_CONFIGURATION_STATUS = 2
# A line of output may not be longer than 8 KiB.
DIGESTS_IN_LINE = 500
MATCH_POLL_NS = 5_000_000

T = TypeVar("T")


class ConfigurationError(ValueError):
    """The configuration on the command line cannot be used."""


@dataclass(frozen=True)
class Configuration:
    """A reference node's only input."""

    #: All that is drawn by lot is drawn from it.
    seed: int = 0
    #: Topic or service name in the rubric -> name that the student used.
    names: dict[str, str] = field(default_factory=dict)
    #: The rubric's `with`.
    settings: dict[str, Any] = field(default_factory=dict)
    #: Topic on the graph -> number of the student's subscriptions to it, and the type of these. DDS counts those of a
    #: process that died until their lease has run out.
    subscriptions: dict[str, int] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)

    def name(self, rubric_name: str) -> str:
        """Give the name to use on the graph for a topic or service of the rubric."""
        return self.names.get(rubric_name, rubric_name)


def parse_configuration(text: str) -> Configuration:
    """Read the JSON object of the command line; raises ConfigurationError if it is not such an object."""
    try:
        plain = json.loads(text)
    except ValueError as problem:
        raise ConfigurationError(f"the configuration is not JSON: {problem}") from problem
    if not isinstance(plain, dict) or not set(plain) <= {
        "seed",
        "names",
        "with",
        "subscriptions",
        "types",
    }:
        raise ConfigurationError(
            'the configuration must be an object with "seed", "names", "with" and "subscriptions"'
        )
    seed = plain.get("seed", 0)
    names, settings, subscriptions, types = (
        plain.get(key) or {} for key in ("names", "with", "subscriptions", "types")
    )
    if not isinstance(seed, int) or not all(
        isinstance(x, dict) for x in (names, settings, subscriptions, types)
    ):
        raise ConfigurationError(
            '"seed" must be an integer, "names", "with" and "subscriptions" objects'
        )
    return Configuration(seed, names, settings, subscriptions, types)


def build_settings(kind: type[T], plain: dict[str, Any]) -> T:
    """Build a settings dataclass from the rubric's `with`; raises ConfigurationError if one of these does not fit."""
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
    """True as soon as SIGINT or SIGTERM has come, also where the parent had them ignored."""

    def __init__(self) -> None:
        self._requested = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._requested = True

    def __bool__(self) -> bool:
        return self._requested


def sleep_until(deadline_ns: int, stop: StopRequest) -> None:
    """Sleep until `time.monotonic_ns()` reaches the deadline, or a stop is requested."""
    while not stop and (left_s := (deadline_ns - time.monotonic_ns()) / 1e9) > 0:
        time.sleep(min(left_s, LONGEST_SLEEP_S))


class ReportingPublisher:
    """A publisher that keeps the digest of each message, to be reported through the pipe."""

    def __init__(self, node: Node, message_class: type, topic: str, qos: QoSProfile) -> None:
        from rclpy.serialization import serialize_message

        self.message_class = message_class
        package, folder, *_ = message_class.__module__.split(".")
        self.topic_type = f"{package}/{folder}/{message_class.__name__}"
        self._node = node
        self._serialize = serialize_message
        self._publisher = node.create_publisher(message_class, topic, qos)
        self._digests: list[str] = []

    @property
    def topic(self) -> str:
        """The topic's fully qualified name."""
        return str(self._publisher.topic_name)

    @property
    def subscription_count(self) -> int:
        """How many subscriptions are matched."""
        return int(self._publisher.get_subscription_count())

    def publish(self, message: Any) -> None:
        """Publish a message."""
        data = self._serialize(message)
        self._digests.append(digest(data))
        self._publisher.publish(data)

    def report(self, *, recorded: bool) -> None:
        """Print the digests of all messages, in order."""
        last = " recorded" if recorded else ""
        for first in range(0, max(1, len(self._digests)), DIGESTS_IN_LINE):
            digests = "".join(self._digests[first : first + DIGESTS_IN_LINE]) or "-"
            print(f"published {self.topic} {self.topic_type} {digests}{last}", flush=True)


class ReferenceNode:
    """A node that reports through the pipe what it does in the graph."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._publishers: list[ReportingPublisher] = []
        #: Names and types of what it publishes, those of its actions too.
        self._topics: dict[str, str] = {}
        self._recorded = False

    def open_publisher(
        self, message_class: type, topic: str, qos: QoSProfile
    ) -> ReportingPublisher:
        """Open a publisher. Each publisher of a reference node must be opened so."""
        publisher = ReportingPublisher(self.node, message_class, topic, qos)
        self._publishers.append(publisher)
        self._topics[publisher.topic] = publisher.topic_type
        return publisher

    def open_action_server(
        self, action_class: type, name: str, execute: Callable[[Any], Any], **more: Any
    ) -> Any:
        """Open an action server, rclpy's with all that it takes; each one of a reference node must be opened so.

        Goals are answered while the node spins. Feedback is in the recording if it spins after `wait_until_recorded`.
        """
        from rclpy.action import ActionServer

        server = ActionServer(self.node, action_class, name, execute, **more)
        action = f"{self.node.resolve_topic_name(name)}/_action"
        package, folder, *_ = action_class.__module__.split(".")
        self._topics[f"{action}/feedback"] = (
            f"{package}/{folder}/{action_class.__name__}_FeedbackMessage"
        )
        self._topics[f"{action}/status"] = "action_msgs/msg/GoalStatusArray"
        return server

    def wait_until_recorded(
        self,
        stop: StopRequest,
        timeout_s: float,
        ready: Callable[[ReportingPublisher], bool] = lambda publisher: True,
    ) -> None:
        """Wait until the recorder has subscribed to each topic and action of this node, and each publisher is `ready`.

        To be called before the first message. Once the time is up it goes on, and what is lost then counts as lost.
        """
        self._recorded = True
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        while not stop and (now_ns := time.monotonic_ns()) < deadline_ns:
            if all(self._is_recorded(*topic) for topic in self._topics.items()) and all(
                map(ready, self._publishers)
            ):
                return
            sleep_until(min(now_ns + MATCH_POLL_NS, deadline_ns), stop)

    def _is_recorded(self, topic: str, topic_type: str) -> bool:
        try:
            found = self.node.get_subscriptions_info_by_topic(topic)
        except (
            UnicodeDecodeError,
            RuntimeError,
        ):  # A student's node may have a name that is no text.
            return False
        return (GRADER_NAMESPACE, topic_type) in {
            (info.node_namespace, info.topic_type) for info in found
        }

    def report_participant(self) -> None:
        """Print by which gids its endpoints are known: by those on a topic whose name no other node can know."""
        from std_msgs.msg import Empty

        topic = f"/_grader/_{secrets.token_hex(8)}"
        publisher = self.node.create_publisher(Empty, topic, 1)
        (info,) = self.node.get_publishers_info_by_topic(topic)
        self.node.destroy_publisher(publisher)
        print(f"participant {bytes(info.endpoint_gid).hex()[:PARTICIPANT_DIGITS]}", flush=True)

    def report_published(self) -> None:
        """Print the digests of all messages that it published."""
        for publisher in self._publishers:
            publisher.report(recorded=self._recorded)


@contextmanager
def reference_node(name: str) -> Iterator[ReferenceNode]:
    """Give a node that nobody can steer from outside: no services, no ROS arguments, no rosout."""
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
    try:
        yield reference
    finally:
        reference.report_published()
        node.destroy_node()
        rclpy.try_shutdown()


def run(kind: type[T], play: Callable[[Configuration, T, StopRequest], None]) -> int:
    """Run a reference node's `play` with the configuration of the command line; give the exit status."""
    stop = StopRequest()
    try:
        if len(sys.argv) != 2:
            raise ConfigurationError(
                "one argument is expected: the configuration as a JSON object, or -"
            )
        configuration = parse_configuration(sys.stdin.read() if sys.argv[1] == "-" else sys.argv[1])
        settings = build_settings(kind, configuration.settings)
    except ConfigurationError as problem:
        print(f"{sys.argv[0]}: {problem}", file=sys.stderr)
        return BAD_CONFIGURATION_STATUS
    play(configuration, settings, stop)
    return 0
