"""A link that loses and delays packets, between two programs of the grader's that use a student's QoS profiles.

Each of the two has a network of its own, with loopback alone, and this process stands for the other: packets to one of its
ports go on into the other network, late or not at all. Nothing of this takes a privilege beyond a sandbox's. Discovery
passes unchanged.

References
----------
DDSI-RTPS 2.5, section 9.6.2: ports of participants. If the ports of the first are taken, a participant of Fast DDS
has the ports of the second.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import json
import math
import os
import random
import resource
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import IO, Any

from confine.limits import set_limit
from confine.namespaces import bring_loopback_up, enter_own_network
from grader.lab.steps.link import Crossing, LinkedTopic, LinkResult, LinkStep
from grader.live.process.forked import Program, become
from grader.live.process.process import RunningProcess
from grader.live.ros_node.link_plan import LinkPlan
from grader.recording.session import (
    LINK,
    Claim,
    Endpoint,
    ProcessRun,
    StepRun,
    asked_for,
    completed,
)

#: Ports of discovery and of data, of a domain's first participant and of its second; and where all announce themselves.
_FIRST, _SECOND = (7410, 7411), (7412, 7413)
_ANNOUNCED, _EVERYBODY, _HERE = 7400, "239.255.0.1", "127.0.0.1"
_BUFFER_BYTES, _LARGEST_BYTES = 2**20, 2**16
#: After the last message of a level so many subscriptions join, one after another, and then it ends.
_LATE, _FIRST_LATE_S, _LATE_EACH_S, _LATE_END_S = 4, 0.1, 0.15, 1.0
#: Time in s that the student's endpoints and their claims may take to be known.
_KNOWN_S, _LOOK_S = 1.0, 0.02
#: Address space of each of its processes.
_TRUSTED_BYTES = 3 * 1024**3
#: CPU time limit of each of its processes: s at the start, and share of a core from then on. With four topics, all
#: three together take 0.3 to 0.4 s in 5 s.
_START_CPU_S, _MOST_OF_A_CORE = 4.0, 0.6
_MEANS = "a relay of the grader's between two networks"


# -- the link itself -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Way:
    """From a socket that stands for the far end, to the far end itself."""

    near: socket.socket
    onward: socket.socket
    address: tuple[str, int]
    lossy: bool

    def pass_on(self, packet: bytes) -> None:
        """Send a packet to the far end."""
        try:
            self.onward.sendto(packet, self.address)
        except OSError:
            return  # Nobody has that port yet, or any more.


class _End:
    """A program on its side of the link, with the sockets that stand there for the other side's."""

    def __init__(
        self, ports: tuple[int, int], others: tuple[int, int], main: Callable[[], object], name: str
    ) -> None:
        enter_own_network()
        bring_loopback_up()
        self.ports = ports
        # The ports of discovery, of data, and of announcements to all.
        self.sockets = [_bound(_HERE, port) for port in others] + [_bound(_EVERYBODY, _ANNOUNCED)]
        (stdin, to_it), (from_it, stdout) = os.pipe(), os.pipe()
        parent = os.getpid()
        if os.fork() == 0:
            become(Program(name, main, dict(os.environ)), parent, (stdin, stdout, 2))
        os.close(stdin)
        os.close(stdout)
        self.lines: IO[bytes] = os.fdopen(from_it, "rb")
        self._to_it = to_it

    def write(self, word: str) -> None:
        """Write it a line."""
        with suppress(BrokenPipeError):
            os.write(self._to_it, f"{word}\n".encode())

    def end(self) -> None:
        """Let it know that there is no more."""
        os.close(self._to_it)

    def ways(self, far: _End) -> list[_Way]:
        """Return the ways from here to the other end."""
        discovery, data = far.ports
        ports = (discovery, data, discovery)
        onward = (far.sockets[0], far.sockets[1], far.sockets[0])
        return [
            _Way(s, o, (_HERE, port), port == data)
            for s, o, port in zip(self.sockets, onward, ports, strict=True)
        ]


def _bound(address: str, port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
    made.setblocking(False)
    if address == _EVERYBODY:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        group = socket.inet_aton(_EVERYBODY) + socket.inet_aton(_HERE)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    made.bind((address, port))
    return made


class _Relay:
    """Carries packets between two ends, and their messages about the begin and the end of a level."""

    def __init__(
        self, sender: _End, receiver: _End, loss: Sequence[float], delay_s: float, seed: int
    ) -> None:
        self._sender, self._receiver = sender, receiver
        self._loss, self._delay_ns = loss, round(delay_s * 1e9)
        self._losing = 0.0
        self._random = random.Random(seed)
        self._ways = (*sender.ways(receiver), *receiver.ways(sender))
        #: Packets on the way, with the times at which they are due, in order.
        self._delayed: deque[tuple[int, _Way, bytes]] = deque()
        self._order = itertools.count()
        #: Actions with their times: (time, number, action).
        self._due: list[tuple[int, int, Callable[[], object]]] = []
        self._sent = [0] * len(loss)
        self._received: Any = None
        #: By how much each packet was later than it was to be.
        self.late_ns: list[int] = []

    def run(self) -> tuple[list[int], Any]:
        """Carry until all levels are through; return the number of messages sent in each, and the received ones."""
        with select.epoll() as selector:
            sources: dict[int, Callable[[], object]] = {}
            for way in self._ways:
                sources[way.near.fileno()] = partial(self._carry, way)
                selector.register(way.near, select.EPOLLIN)
            for end in (self._sender, self._receiver):
                sources[end.lines.fileno()] = partial(self._hear, end)
                selector.register(end.lines, select.EPOLLIN)
            while self._received is None:
                for descriptor, _ in selector.poll(self._left_s()):
                    sources[descriptor]()
                self._do_due()
        return self._sent, self._received

    def _left_s(self) -> float | None:
        """Return the time until something is due."""
        times_ns = []
        if self._due:
            times_ns.append(self._due[0][0])
        if self._delayed:
            times_ns.append(self._delayed[0][0])
        if not times_ns:
            return None
        return max(0, min(times_ns) - time.monotonic_ns()) / 1e9

    def _do_due(self) -> None:
        """Do the actions that are due, and pass on the packets that are due."""
        while self._delayed:
            due_ns, way, packet = self._delayed[0]
            late_ns = time.monotonic_ns() - due_ns
            if late_ns < 0:
                break
            self._delayed.popleft()
            way.pass_on(packet)
            self.late_ns.append(late_ns)
        while self._due and self._due[0][0] <= time.monotonic_ns():
            heapq.heappop(self._due)[2]()

    def _after(self, seconds: float, action: Callable[[], object]) -> None:
        due_ns = time.monotonic_ns() + round(seconds * 1e9)
        heapq.heappush(self._due, (due_ns, next(self._order), action))

    def _carry(self, way: _Way) -> None:
        """Read a packet; drop, delay or pass it on. The selector tells of the packets behind it."""
        try:
            packet = way.near.recv(_LARGEST_BYTES)
        except BlockingIOError:
            return
        if not way.lossy:
            way.pass_on(packet)
        elif self._random.random() >= self._losing:
            self._delayed.append((time.monotonic_ns() + self._delay_ns, way, packet))

    def _hear(self, end: _End) -> None:
        line = end.lines.readline()
        if not line:
            raise SystemExit(1)  # This end has said why.
        kind, *what = json.loads(line)
        if kind == "begin":
            self._losing = self._loss[what[0]]
            print(json.dumps({"begun": what[0]}), flush=True)
        elif kind == "sent":
            level, self._sent[what[0]] = what
            for number in range(_LATE):
                join = partial(self._receiver.write, str(level))
                self._after(_FIRST_LATE_S + number * _LATE_EACH_S, join)
            self._after(_LATE_END_S, partial(self._sender.write, "go on"))
        elif kind == "done":
            self._receiver.end()
        else:
            (self._received,) = what


def _used_cpu_s() -> float:
    """Return the CPU time of this process and of its ended children, in seconds."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def carry(plan: LinkPlan, delay_s: float, seed: int) -> None:
    """Be the link, and start its two ends; prints lines of JSON: the begin of each level, and last the results."""
    from grader.live.ros_node import link_end

    planned_s = len(plan.loss) * (plan.duration_s + _LATE_END_S)
    most_s = math.ceil(_START_CPU_S + _MOST_OF_A_CORE * planned_s)
    set_limit("cpu", most_s)  # The ends inherit it.
    receiver = _End(_SECOND, _FIRST, partial(link_end.receive, plan), "link-receiver")
    sender = _End(_FIRST, _SECOND, partial(link_end.send, plan), "link-sender")
    relay = _Relay(sender, receiver, plan.loss, delay_s, seed)
    sent, received = relay.run()
    sender.end()
    for _ in range(2):
        os.wait()
    late_ms = 0.0
    if relay.late_ns:
        rank = int(0.95 * len(relay.late_ns))
        late_ms = sorted(relay.late_ns)[rank] / 1e6
    found = {
        "sent": sent,
        "received": received,
        "cpu_s": round(_used_cpu_s(), 3),
        "late_ms": round(late_ms, 2),
    }
    print(json.dumps(found), flush=True)


# -- beside a session ------------------------------------------------------------------------------


class Link:
    """The link of a step, which goes on beside the steps that follow.

    `endpoints` and `claims` give the student's present endpoints in the graph, and the requests to rclpy for them;
    `names` map the rubric's names to the student's. `watch` is called with its process once that has started.
    """

    def __init__(
        self,
        run: StepRun,
        step: LinkStep,
        endpoints: Callable[[], Iterable[Endpoint]],
        claims: Callable[[], Sequence[Claim]],
        names: Mapping[str, str],
        watch: Callable[[RunningProcess], object],
    ) -> None:
        self._run = run
        self._step = step
        self._endpoints = endpoints
        self._claims = claims
        self._names = names
        self._watch = watch
        self.result = LinkResult(delay_ms=step.delay_ms, means=_MEANS)

    async def run(self, seed: int, environment: Mapping[str, str]) -> ProcessRun:
        """Carry the topics that have two sides, and write the result and the time of the end into the step."""
        run = ProcessRun(LINK, "grader", ["python", "-m", __name__])
        end_s = time.monotonic() + _KNOWN_S
        while not (known := self._look()) and time.monotonic() < end_s:
            await asyncio.sleep(_LOOK_S)
        carried = [
            topic
            for topic in self.result.topics
            if topic.offered is not None and topic.requested is not None
        ]
        if carried:
            await self._carry(run, carried, seed, environment)
        elif not known:
            self.result.problem = (
                "none of the topics has both a publisher and a subscription of the student's"
            )
        self._run.outcome = "failed" if self.result.problem else "done"
        self._run.result = self.result.to_plain()
        self._run.ended_ns = time.time_ns()
        return run

    def _look(self) -> bool:
        """Note the profiles of both sides of each topic, and say whether all of them are known."""
        endpoints, claims = list(self._endpoints()), self._claims()
        self.result.topics = []
        known = []
        for name in self._step.topics:
            linked = LinkedTopic(name, self._names.get(name, name))
            self.result.topics.append(linked)
            for kind, side in (("publisher", "offered"), ("subscription", "requested")):
                found = next(
                    (e for e in endpoints if (e.kind, e.topic) == (kind, linked.topic)), None
                )
                claim = asked_for(found, claims) if found is not None else None
                known.append(claim is not None)
                if found is not None:
                    linked.type = linked.type or found.type
                    setattr(linked, side, completed(found.qos, claim))
        return all(known)

    async def _carry(
        self,
        run: ProcessRun,
        carried: Sequence[LinkedTopic],
        seed: int,
        environment: Mapping[str, str],
    ) -> None:
        said: list[bytes] = []
        loss = self._step.loss
        plan = LinkPlan(carried, loss, self._step.rate_hz, self._step.duration_s)
        main = partial(carry, plan, self.result.delay_ms / 1e3, seed)

        def hear(line: bytes) -> None:
            if not said:
                running.put_standing()  # Now its timing counts; once, so that the watch can take it away for good.
            said.append(line)

        running = await RunningProcess.fork(
            run, Program(LINK, main, environment, _TRUSTED_BYTES), on_message=hear
        )
        self._watch(running)
        try:
            await asyncio.wait({running.exited})
        finally:
            await running.kill()
        found = json.loads(said[-1]) if said else {}
        if "received" not in found:
            last = run.output[-1].text if run.output else "nothing was said"
            self.result.problem = f"the link ended early: {last}"
            return
        self.result.cpu_s, self.result.late_ms = found["cpu_s"], found["late_ms"]
        for topic, levels in zip(carried, found["received"], strict=True):
            each = zip(loss, found["sent"], levels, strict=True)
            topic.crossings = [Crossing(share, sent, **level) for share, sent, level in each]
