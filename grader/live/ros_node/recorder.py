"""Records the traffic of a sandbox: raw subscriptions, written to a bag as they come.

The recorder has contexts of its own for further types, because one participant cannot hold two types on one topic.
The middleware stamps each message when it receives it, so that a thread may empty all queues every
few milliseconds, at a tenth of the cost of waking for each message.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from grader.errors import without_temporary_names
from grader.live.ros_node.bare_node import BareNode
from grader.live.ros_node.graph import interface_named, new_context
from grader.recording.session import Endpoint, RecordingGap
from ros_bag.definitions import definition_of, type_hash_of
from ros_bag.writing import BagWriter

NODE_NAME = "_grader_recorder"
DEFAULT_LIMIT_BYTES = 512 * 2**20
DEFAULT_LIMIT_TOPICS = 1000

# The queue bridges the time that the recorder gets no core: 2 s at 5,000 messages/s. Keep last, not keep all:
# a full queue of a reliable keep-all subscription holds up the publisher, and recording must not
# disturb the recorded traffic. The middleware allocates the queue as it fills, so that depth costs nothing.
_DEPTH = 10_000
# Each message has its times from the middleware already. At 40,000 messages/s the queue is less than half full then.
_POLL_S = 0.1
_FLUSH_S = 0.5
# Messages remembered to detect repeats between several subscriptions of a topic: the capacity of all their queues.
_REMEMBERED = 4 * _DEPTH
_TYPES_PER_TOPIC = 4
_MOST_UNRECORDED = 5000
# Room for a message in the bag beside its data: record head and index entry.
_MESSAGE_OVERHEAD_BYTES = 47


class _LimitReached(ValueError):
    """There are more topics, or types of one, than are recorded."""


#: Policies of a subscription that decide matching: true if all messages must arrive, and true if also earlier
#: messages must.
_Request = tuple[bool, bool]


def _suiting(publishers: Sequence[Endpoint], before: _Request = (True, True)) -> _Request:
    """Return the strictest request that every publisher offers (the rule of rosbag2), no more than before."""
    reliable = all(p.qos.reliability == "reliable" for p in publishers)
    transient_local = all(p.qos.durability == "transient_local" for p in publishers)
    return before[0] and reliable, before[1] and transient_local


@dataclass
class _Line:
    """A topic of one type under record: its channel, and its subscriptions, the weakest last."""

    topic: str
    topic_type: str
    channel: int
    node: BareNode
    message_type: type
    request: _Request
    subscriptions: list[Any] = field(default_factory=list)
    seen: dict[tuple[int, int], None] = field(default_factory=dict)
    stopped: bool = False
    count: int = 0
    written_bytes: int = 0

    def subscribe(self, request: _Request) -> None:
        """Receive it by one more subscription."""
        reliable, transient_local = request
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if transient_local
            else DurabilityPolicy.VOLATILE,
        )
        self.subscriptions.append(self.node.subscribe(self.message_type, self.topic, profile))
        self.request = request

    def publishers(self) -> int:
        """Return the present number of publishers that are received."""
        subscription = self.subscriptions[-1]
        with subscription:
            return int(subscription.get_publisher_count())

    def unsubscribe(self) -> None:
        """Receive it no longer."""
        for subscription in self.subscriptions:
            subscription.destroy_when_not_in_use()
        self.subscriptions.clear()

    def is_repeat(self, source_ns: int, sequence: int) -> bool:
        """Return whether another subscription has received a message already, if there are several."""
        key = (source_ns, sequence)
        if len(self.subscriptions) == 1:
            return False
        if key in self.seen:
            return True
        self.seen[key] = None
        if len(self.seen) > _REMEMBERED:
            del self.seen[next(iter(self.seen))]
        return False


class Recorder:
    """Records every topic that it is asked to, and closes the writer of the bag when it stops.

    A topic may take as much of `limit_bytes` as is left for the others; past that it is no longer recorded, so that a
    flood cannot cost the evidence of other topics. `problems` are faults on the recorder's side, `unrecorded`
    the topics left out. `context` is for the first type of each topic; without it, the recorder makes one.
    """

    def __init__(
        self,
        writer: BagWriter,
        domain_id: int,
        *,
        limit_bytes: int = DEFAULT_LIMIT_BYTES,
        limit_topics: int = DEFAULT_LIMIT_TOPICS,
        context: Context | None = None,
    ) -> None:
        self.problems: list[str] = []
        self.unrecorded: list[RecordingGap] = []
        self._writer = writer
        self._domain_id = domain_id
        self._left_bytes = limit_bytes
        self._limit_topics = limit_topics
        self._lines: dict[tuple[str, str], _Line] = {}
        self._refused: set[tuple[str, str]] = set()
        #: Nodes, one a participant.
        self._nodes: list[BareNode] = []
        self._contexts: list[Context] = []
        if context is not None:
            self._nodes.append(BareNode(f"{NODE_NAME}_0", context))
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> Mapping[tuple[str, str], int]:
        """Messages written so far, by topic and type."""
        with self._lock:
            return {key: line.count for key, line in self._lines.items()}

    def matched(self, topic: str, topic_type: str) -> int:
        """Return the present number of publishers that the recorder receives a topic from."""
        with self._lock:
            line = self._lines.get((topic, topic_type))
            if line is None or line.stopped:
                return 0
            return line.publishers()

    def _leave_out(
        self, key: tuple[str, str], reason: str, limit: bool, messages: int = 0, size_bytes: int = 0
    ) -> None:
        if len(self.unrecorded) < _MOST_UNRECORDED:
            self.unrecorded.append(
                RecordingGap(*key, time.time_ns(), messages, size_bytes, reason, limit)
            )

    # -- subscribing: on the caller's thread ---------------------------------------------------

    def follow(self, publishers: Sequence[Endpoint]) -> None:
        """Record every topic of these publishers; to be called with all of them whenever the graph changed.

        Topics followed before stay so when their publishers are gone; other endpoints are passed over.
        """
        topics: dict[tuple[str, str], list[Endpoint]] = {}
        for publisher in publishers:
            if publisher.kind == "publisher":
                topics.setdefault((publisher.topic, publisher.type), []).append(publisher)
        for key, endpoints in topics.items():
            if key in self._refused or self._ending.is_set():
                continue
            if (line := self._lines.get(key)) is not None:
                weaker = _suiting(endpoints, line.request)
                if weaker != line.request and not line.stopped:
                    # A weaker request also receives a publisher that offers less. No message is taken meanwhile,
                    # because it could come by both.
                    with self._lock:
                        line.subscribe(weaker)
                continue
            try:
                line = self._open(*key, endpoints)
            except Exception as error:
                # Names and types are a student's: rclpy can refuse them in many ways.
                self._refused.add(key)
                self._leave_out(key, str(error), isinstance(error, _LimitReached))
            else:
                with self._lock:
                    self._lines[key] = line

    def _open(self, topic: str, topic_type: str, publishers: list[Endpoint]) -> _Line:
        if len(self._lines) >= self._limit_topics:
            raise _LimitReached(f"{self._limit_topics} topics are recorded already")
        definition = definition_of(topic_type)
        message_type = interface_named(topic_type)
        node = self._node(sum(known == topic for known, _ in self._lines))
        # The hash of the definition in the bag, whatever publishers announce: with another one, readers refuse the bag.
        type_hash = type_hash_of(topic_type)
        with self._lock:
            offered = [publisher.qos for publisher in publishers]
            channel = self._writer.add_channel(topic, topic_type, type_hash, definition, offered)
        line = _Line(topic, topic_type, channel, node, message_type, _suiting(publishers))
        line.subscribe(line.request)
        return line

    def _node(self, level: int) -> BareNode:
        """Return the node with the participant for the type number `level` of a topic."""
        if level >= _TYPES_PER_TOPIC:
            raise _LimitReached(
                f"{_TYPES_PER_TOPIC} other types of this topic are recorded already"
            )
        if level == len(self._nodes):
            context = new_context(self._domain_id)
            self._contexts.append(context)
            self._nodes.append(BareNode(f"{NODE_NAME}_{level}", context))
        return self._nodes[level]

    # -- taking: on the recorder's thread ------------------------------------------------------

    def stop(self) -> None:
        """Write all arrived messages, finish the bag, and leave the graph."""
        self.finish()
        for line in self._lines.values():
            line.unsubscribe()
        for node in self._nodes:
            node.handle.destroy_when_not_in_use()
        for context in self._contexts:
            context.try_shutdown()

    def finish(self) -> None:
        """Write all arrived messages, and finish the bag."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            flush_s = time.monotonic() + _FLUSH_S
            while not self._ending.wait(_POLL_S):
                self._poll()
                if time.monotonic() >= flush_s:
                    flush_s = time.monotonic() + _FLUSH_S
                    with self._lock:
                        self._writer.flush()
            self._poll()
        except Exception as error:
            self.problems.append(without_temporary_names(f"recording stopped early: {error}"))
        try:
            with self._lock:
                self._writer.close()
        except OSError as error:
            self.problems.append(without_temporary_names(f"the bag is not finished: {error}"))

    def _poll(self) -> None:
        """Empty all queues."""
        with self._lock:
            for line in self._lines.values():
                for subscription in tuple(line.subscriptions):
                    self._empty(line, subscription.take_message)

    def _empty(
        self, line: _Line, take: Callable[[type, bool], tuple[bytes, dict[str, Any]] | None]
    ) -> None:
        # Never more at a time than the queue holds, so that one topic cannot keep the others waiting.
        for _ in range(_DEPTH):
            if line.stopped or (message := take(line.message_type, True)) is None:
                return
            self._write(line, *message)

    def _write(self, line: _Line, data: bytes, info: Mapping[str, Any]) -> None:
        source_ns, sequence = info["source_timestamp"], info["publication_sequence_number"] or 0
        if line.is_repeat(source_ns, sequence):
            return
        cost_bytes = len(data) + _MESSAGE_OVERHEAD_BYTES
        if line.written_bytes + cost_bytes > self._left_bytes:
            self._cut(line)
            return
        received_ns = info["received_timestamp"]
        self._writer.write(
            line.channel, data, received_ns=received_ns, source_ns=source_ns, sequence=sequence
        )
        self._left_bytes -= cost_bytes
        line.written_bytes += cost_bytes
        line.count += 1

    def _cut(self, line: _Line) -> None:
        """Record this topic no longer."""
        line.stopped = True
        reason = "they fill as much space as is left for all other topics"
        self._leave_out((line.topic, line.topic_type), reason, True, line.count, line.written_bytes)
        line.unsubscribe()
