"""The integrity of a session: parts of the grader that the student's processes tampered with.

The grader's processes report their endpoints and messages through the trusted channel; every other endpoint in the
graph belongs to the student. Without reports, nothing is found. A finding can have an honest cause, such as a publisher
on a wrong topic. The text of a finding therefore states the observation only, and measurements continue with the
grader's own messages if these can be separated.
"""

from __future__ import annotations

import itertools
import signal
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grader.evidence.cpu_delay import Span
from grader.evidence.gaps import dropped
from grader.evidence.recorded import Recorded, Sighting
from grader.recording.session import (
    GRADER_NAMESPACE,
    PARTICIPANT_DIGITS,
    PROCESS_DIGITS,
    UNKNOWN_NODE,
    GraphSnapshot,
    ProcessRun,
    ServiceEndpoint,
)
from grader.result import Location, Violation, ViolationKind
from ros_bag.reading import Stream

#: Topics on which every node publishes.
_SHARED_TOPICS = ("/rosout", "/parameter_events")
_CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
#: Services of a node for changing its parameters from other nodes.
_CHANGING = ("set_parameters", "set_parameters_atomically")
_MOST_NAMED = 5
#: Share of a span that the recorder's threads together wait for a core on a busy machine. Beside other
#: sessions of the same grading, it is 0.1.
_BUSY = 0.2
#: Number of recordings after which a problem no longer counts as occasional.
_REPEATED = 2
#: Signals by which administrators, or the system when memory is short, end a process.
_SENT_BY_OTHERS = (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)
_OUT_OF_MEMORY = ("MemoryError", "bad_alloc")
#: Last lines of a process's output that are searched for a lack of memory.
_LAST_LINES = 5
#: A time after every session, in ns.
_NEVER_NS = 2**63


@dataclass(frozen=True)
class Tampering:
    """A part of the grader that was tampered with.

    Nothing can be measured any more of the `invalidated` topics, services and nodes, or of the `whole` session.
    """

    violation: Violation
    invalidated: frozenset[str] = frozenset()
    whole: bool = False


class _Integrity:
    def __init__(self, recorded: Recorded, reference_nodes: Mapping[str, str]) -> None:
        self.recorded = recorded
        self.record = recorded.record
        #: Names of all reference nodes, including other sessions.
        self.nodes = frozenset(reference_nodes.values())
        #: Names of the reference nodes of this session, by process.
        self.running: dict[str, str] = {}
        reporting = {trusted.process for trusted in self.record.trusted}
        for process, node in reference_nodes.items():
            if process in reporting:
                self.running[process] = node
        self.ours: list[Sighting] = []
        self.student_endpoints: list[Sighting] = []
        for sighting in recorded.sightings:
            if recorded.is_trusted(sighting.endpoint.gid):
                self.ours.append(sighting)
            else:
                self.student_endpoints.append(sighting)
        self.topics: set[str] = set()
        self.clocks: set[str] = set()
        for info in recorded.bag.topics:
            self.topics.add(info.topic)
            if info.topic_type == _CLOCK_TYPE:
                self.clocks.add(info.topic)

    @cached_property
    def student_nodes(self) -> frozenset[str]:
        """Names of the nodes of the student's endpoints."""
        return frozenset(sighting.endpoint.node for sighting in self.student_endpoints)

    def tampering(
        self,
        kind: ViolationKind,
        text: str,
        evidence: Iterable[str],
        span: Span,
        topic: str | None = None,
        *,
        invalidated: Iterable[str] = (),
        whole: bool = False,
        certain: bool = True,
    ) -> Tampering:
        """Return a tampering with its location in the session."""
        session = self.record.session
        start_s = self._second(span.start_ns)
        end_s = self._second(span.end_ns)
        where = Location(session=session, topic=topic, start_s=start_s, end_s=end_s)
        violation = Violation(kind, session, text, tuple(evidence), where, certain)
        return Tampering(violation, frozenset(invalidated), whole)

    def described(self, sightings: Sequence[Sighting]) -> Iterator[str]:
        """Yield a line about each of the first sightings, and the number of the others."""
        for sighting in sightings[:_MOST_NAMED]:
            endpoint = sighting.endpoint
            node = f"node {endpoint.node}"
            if UNKNOWN_NODE in endpoint.node:
                node = "a node whose name is not known"
            place = f"{endpoint.kind} on {endpoint.topic} of {node}, gid {endpoint.gid}"
            period = self._period(Span(sighting.start_ns, sighting.end_ns))
            yield f"{place}, in the graph {period}"
        if len(sightings) > _MOST_NAMED:
            yield f"and {len(sightings) - _MOST_NAMED} more"

    def _second(self, time_ns: int) -> float:
        return round(self.recorded.since_start_s(time_ns), 2)

    def _period(self, span: Span) -> str:
        return f"from {self._second(span.start_ns):g} to {self._second(span.end_ns):g} s"

    # -- nodes --------------------------------------------------------------------------------

    def impersonated(self) -> Iterator[Tampering]:
        """Find nodes of the submission with a name of the grader."""
        by_name: dict[str, list[Sighting]] = {}
        for sighting in self.student_endpoints:
            node = sighting.endpoint.node
            if node in self.nodes:
                by_name.setdefault(node, []).append(sighting)
            elif node.startswith(f"{GRADER_NAMESPACE}/"):
                by_name.setdefault(GRADER_NAMESPACE, []).append(sighting)
        for name, sightings in by_name.items():
            yield self._impersonation(name, sightings)

    def _impersonation(self, name: str, sightings: Sequence[Sighting]) -> Tampering:
        text = f"A node of the submission has the name {name}, which is the name of a node of the grader's."
        if name == GRADER_NAMESPACE:
            text = f"Nodes of the submission are in the grader's own namespace {name}."
        evidence = list(self.described(sightings))
        own = []
        for sighting in self.ours:
            if sighting.endpoint.node == name:
                own.append(sighting.endpoint.gid)
        if own:
            participant = min(own)[:PARTICIPANT_DIGITS]
            evidence.append(f"the grader's own node has gids that begin with {participant}")
        kind = ViolationKind.IMPERSONATES_NODE
        return self.tampering(kind, text, evidence, _span_of(sightings), invalidated={name})

    def asked_to_change(self) -> Iterator[Tampering]:
        """Find clients of the services that set parameters of a reference node."""
        wanted: dict[str, str] = {}
        for node in self.nodes:
            for service in _CHANGING:
                wanted[f"{node}/{service}"] = node
        found: dict[str, list[tuple[int, ServiceEndpoint]]] = {}
        for graph in self.record.graph:
            for client in graph.clients:
                if client.name in wanted:
                    found.setdefault(wanted[client.name], []).append((graph.t_ns, client))
        for reference, seen in found.items():
            yield self._change(reference, seen)

    def _change(self, reference: str, seen: Sequence[tuple[int, ServiceEndpoint]]) -> Tampering:
        found: set[tuple[str, str]] = set()
        for _, client in seen:
            found.add((client.name, client.node))
        clients = sorted(found)
        text = f"The submission has clients that set parameters of {reference}, a node of the grader's."
        if self._offered.isdisjoint(service for service, _ in clients):
            text += " It has no such service, so nothing of it was changed."
        evidence = []
        for service, node in clients[:_MOST_NAMED]:
            evidence.append(f"client of {service} in node {node}")
        span = Span(seen[0][0], seen[-1][0])
        return self.tampering(ViolationKind.CHANGES_REFERENCE, text, evidence, span)

    @cached_property
    def _offered(self) -> frozenset[str]:
        """Names of all services that were ever in the graph."""
        found: set[str] = set()
        for graph in self.record.graph:
            for offer in graph.services:
                found.add(offer.name)
        return frozenset(found)

    def second_servers(self) -> Iterator[Tampering]:
        """Find services that the submission offers beside a reference node, or from two programs of its own."""
        found: dict[str, list[tuple[int, str]]] = {}
        for graph in self.record.graph:
            for service, nodes in _servers_in(graph).items():
                theirs = nodes - self.nodes
                if theirs and self._is_offered_twice(graph, service, nodes):
                    seen = found.setdefault(service, [])
                    for node in theirs:
                        seen.append((graph.t_ns, node))
        for service, seen in found.items():
            yield self._second_server(service, seen)

    def _second_server(self, service: str, seen: Sequence[tuple[int, str]]) -> Tampering:
        nodes = sorted({node for _, node in seen})[:_MOST_NAMED]
        evidence = [f"server of {service} in node {node}" for node in nodes]
        if service in self.recorded.awaited:
            offering = f"{' and '.join(nodes)} of the submission both offer the service {service}"
            text = f"{offering}; which of them answered is not known."
            invalidated = []
        else:
            text = f"The submission offers the service {service}, as a node of the grader's does."
            invalidated = [service]
        span = Span(seen[0][0], seen[-1][0])
        kind = ViolationKind.SECOND_SERVER
        return self.tampering(kind, text, evidence, span, service, invalidated=invalidated)

    def _is_offered_twice(self, graph: GraphSnapshot, service: str, nodes: set[str]) -> bool:
        if service in self.recorded.awaited:
            return self._are_rivals(graph, nodes - self.nodes)
        references = set(self.running.values()) - self.student_nodes
        return not nodes.isdisjoint(references)

    def _are_rivals(self, graph: GraphSnapshot, nodes: set[str]) -> bool:
        """Return whether nodes belong to different programs: not to a program that was started twice, or came back."""
        if len(nodes) < 2:
            return False
        processes = [_processes_of(graph, node) for node in nodes]
        for some, others in itertools.combinations(processes, 2):
            if not some or not others or some & others:
                return False
        alive = self._programs_at(graph.t_ns)
        return len(set(alive)) == len(alive)

    def _programs_at(self, t_ns: int) -> list[str]:
        """Return the programs of the student's processes that ran at a time."""
        found = []
        for run in self.recorded.students:
            exited_ns = run.exited_ns or _NEVER_NS
            if run.argv and run.started_ns <= t_ns < exited_ns:
                found.append(run.artifact or run.argv[0])
        return found

    # -- disturbances ------------------------------------------------------------------------

    def brought_down(self) -> Iterator[Tampering]:
        """Find processes of the grader that crashed in their native code, or no longer reacted.

        The network of a session connects its own processes only, and one of them must be the cause. A single
        occurrence is not conclusive; if it happens in two recordings, programs of the submission caused it.
        """
        for run in self.record.processes:
            span = Span(run.started_ns, run.exited_ns or self.record.ended_ns)
            end = _brought_down(run) if run.role != "student" else ""
            if end and not self._machine_was_busy(span):
                name = f"process {run.name}"
                if run.name in self.running:
                    name = f"node {self.running[run.name]}"
                during = "while programs of the submission were running"
                text = f"The grader's own {name} {end} {during}."
                yield self._disturbed(ViolationKind.ENDS_REFERENCE, text, span, whole=True)

    def dropped_messages(self) -> Iterator[Tampering]:
        """Find messages of the grader that never reached its recorder on an idle machine."""
        span = Span(self.record.started_ns, self.record.ended_ns)
        if self._machine_was_busy(span):
            return
        for topic, loss in dropped(self.recorded).items():
            text = f"{loss} Packets in the grader's name can do that, and the machine was not busy."
            invalidated: Iterable[str] = (topic,)
            if topic in self.clocks:
                invalidated = self.topics
            yield self._disturbed(
                ViolationKind.DISTURBS_RECORDING, text, span, topic, invalidated=invalidated
            )

    def repeatedly_disturbed(self) -> Iterator[Tampering]:
        """Find other problems that repeatedly stopped a session on an idle machine.

        Only a person can tell their cause; until then they are undecided.
        """
        if self.record.complete:
            problems = self.record.problems[:_MOST_NAMED]
            span = Span(self.record.started_ns, self.record.ended_ns)
        else:
            problems = ["the recording was cut off"]
            # Only the start of such a session is known.
            span = Span(self.record.started_ns, self.record.started_ns)
        without_student = self.record.complete and not self.recorded.students
        if not problems or without_student:
            return
        if self.record.times_recorded < _REPEATED:
            return
        if self._machine_was_busy(span):
            return
        text = (
            f"In {self.record.times_recorded} recordings the session could not be carried out as planned while "
            "programs of the submission were running, and the machine was not busy."
        )
        yield self.tampering(ViolationKind.DISTURBS_RECORDING, text, problems, span, certain=False)

    def _disturbed(
        self,
        kind: ViolationKind,
        text: str,
        span: Span,
        topic: str | None = None,
        *,
        invalidated: Iterable[str] = (),
        whole: bool = False,
    ) -> Tampering:
        """Return a disturbance, which is certain if a previous recording showed one too."""
        repeated = self.record.disturbed_before
        evidence = f"so in recording number {self.record.attempt}"
        if repeated:
            evidence += " and in one before"
        return self.tampering(
            kind,
            text,
            [evidence],
            span,
            topic,
            invalidated=invalidated,
            whole=whole,
            certain=repeated,
        )

    def _machine_was_busy(self, span: Span) -> bool:
        """Return whether the machine was busy with other work than the student's programs."""
        if self.recorded.recorder_delay_s(span) <= _BUSY * span.duration_s:
            return False
        return not self.recorded.students_busy(span)

    # -- topics -------------------------------------------------------------------------------

    def published(self) -> Iterator[Tampering]:
        """Find messages of other publishers on topics that are reserved for the grader."""
        topics = {entry.topic for entry in self.record.published}
        for sighting in self.ours:
            if sighting.endpoint.kind == "publisher":
                topics.add(sighting.endpoint.topic)
        for topic in sorted(topics - self.recorded.awaited - set(_SHARED_TOPICS)):
            yield from self._published_on(topic)

    def _published_on(self, topic: str) -> Iterator[Tampering]:
        publishers = []
        for sighting in self.student_endpoints:
            if sighting.endpoint.kind == "publisher" and sighting.endpoint.topic == topic:
                publishers.append(sighting)
        apart = self.recorded.authorship(topic)
        if apart is None:
            mixed = self._mixed(topic) if publishers else ""
            if mixed:
                yield self._on_topic(topic, publishers, mixed, _span_of(publishers))
            return
        others_ns = apart.others_ns
        if len(others_ns):
            span = Span(int(others_ns[0]), int(others_ns[-1]))
            recorded = f"{len(others_ns)} messages recorded on {topic} {self._period(span)}"
            seen = f"{recorded} are none of the grader's {len(apart.own)}"
            yield self._on_topic(topic, publishers, seen, span)

    def _mixed(self, topic: str) -> str:
        """Describe why the grader's messages cannot be separated; empty if they need not be."""
        stream = self.recorded.bag.stream(topic)
        if repeated := _repeated(stream):
            return f"{repeated} of {len(stream)} messages recorded there repeat a publication sequence number"
        reported = any(entry.digests for entry in self.recorded.published_on(topic))
        if reported and len(stream):
            return f"none of {len(stream)} messages recorded there is one of the grader's"
        return ""

    def _on_topic(
        self, topic: str, publishers: Sequence[Sighting], seen: str, span: Span
    ) -> Tampering:
        author = _author(publishers)
        evidence = [seen, *self.described(publishers)]
        if not publishers:
            evidence.append("no publisher of theirs was seen in the graph")
        if topic in self.clocks:
            kind = ViolationKind.SPOOFS_CLOCK
            text = f"{author} published time on {topic}, where in this session the grader's own clock is."
            # Every timer and every simulation follows the clock.
            invalidated = self.topics
        else:
            kind = ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC
            text = f"{author} published on {topic}, where in this session only the grader is to publish."
            invalidated = {topic}
            if self.recorded.authorship(topic) is not None:
                invalidated = set()
                evidence.append("checks of this topic used the grader's own messages only")
        certain = bool(publishers)
        return self.tampering(
            kind, text, evidence, span, topic, invalidated=invalidated, certain=certain
        )

    # -- logs ---------------------------------------------------------------------------------

    def forged(self) -> Iterator[Tampering]:
        """Find log messages and parameter events in the name of a grader node; these nodes send none."""
        names = {*self.nodes, f"{GRADER_NAMESPACE}/probe"} - self.student_nodes
        yield from self._forged_log(names)
        yield from self._forged_events(names)

    def _forged_log(self, nodes: set[str]) -> Iterator[Tampering]:
        log = self.recorded.bag.stream("/rosout", "rcl_interfaces/msg/Log")
        loggers = {node.strip("/").replace("/", "."): node for node in nodes}
        text = "Log messages on /rosout have the name of a node of the grader's, which sends none."
        rows = _naming(log, "name", loggers)
        yield from self._forged(ViolationKind.FORGES_ROSOUT, text, log, rows)

    def _forged_events(self, nodes: set[str]) -> Iterator[Tampering]:
        events = self.recorded.bag.stream("/parameter_events", "rcl_interfaces/msg/ParameterEvent")
        naming = _naming(events, "node", {node: node for node in nodes})
        is_naming = np.zeros(len(events), dtype=bool)
        is_naming[list(naming)] = True
        changes = events.only(is_naming).field("changed_parameters")
        # A starting node declares its parameters; a grader node changes none of them later.
        rows: dict[int, str] = {}
        for row, changed in zip(sorted(naming), changes, strict=True):
            if changed:
                rows[row] = naming[row]
        text = "Events on /parameter_events report changed parameters of the grader's nodes, which cannot be changed."
        yield from self._forged(ViolationKind.FORGES_PARAMETER_EVENTS, text, events, rows)

    def _forged(
        self, kind: ViolationKind, text: str, stream: Stream, rows: Mapping[int, str]
    ) -> Iterator[Tampering]:
        if not rows:
            return
        times_ns = stream.received_ns[list(rows)]
        span = Span(int(times_ns[0]), int(times_ns[-1]))
        evidence = []
        for node, count in sorted(Counter(rows.values()).items()):
            evidence.append(f"{count} messages in the name of {node}")
        yield self.tampering(kind, text, evidence, span, stream.topic)


def tampering_in(recorded: Recorded, reference_nodes: Mapping[str, str]) -> tuple[Tampering, ...]:
    """Return the tampering in a session.

    Parameters
    ----------
    recorded
        The session.
    reference_nodes
        Names of the lab's reference nodes, by the names of their processes.
    """
    integrity = _Integrity(recorded, reference_nodes)
    disturbed = tuple(integrity.brought_down()) or tuple(integrity.repeatedly_disturbed())
    if not recorded.record.trusted or recorded.silent_references:
        return disturbed
    return (
        *integrity.impersonated(),
        *integrity.published(),
        *integrity.second_servers(),
        *integrity.asked_to_change(),
        *integrity.forged(),
        *disturbed,
        *integrity.dropped_messages(),
    )


def _span_of(sightings: Sequence[Sighting]) -> Span:
    """Return the span from the first to the last time at which one of the endpoints was in the graph."""
    start_ns = min(sighting.start_ns for sighting in sightings)
    end_ns = max(sighting.end_ns for sighting in sightings)
    return Span(start_ns, end_ns)


def _author(publishers: Sequence[Sighting]) -> str:
    """Return a name for the submission, with up to three of its nodes that publish."""
    nodes: set[str] = set()
    for sighting in publishers:
        if UNKNOWN_NODE not in sighting.endpoint.node:
            nodes.add(sighting.endpoint.node)
    if not nodes:
        return "The submission"
    named = ", ".join(sorted(nodes)[:3])
    return f"The submission ({named})"


def _servers_in(graph: GraphSnapshot) -> dict[str, set[str]]:
    """Return the nodes that offer each service."""
    found: dict[str, set[str]] = {}
    for offer in graph.services:
        found.setdefault(offer.name, set()).add(offer.node)
    return found


def _processes_of(graph: GraphSnapshot, node: str) -> set[str]:
    """Return the processes of a node's endpoints, as they begin gids."""
    found: set[str] = set()
    for endpoint in graph.endpoints:
        if endpoint.node == node:
            found.add(endpoint.gid[:PROCESS_DIGITS])
    return found


def _repeated(stream: Stream) -> int:
    """Count messages with the sequence number of another message that was sent at another time."""
    pairs = set(zip(stream.sequence.tolist(), stream.source_ns.tolist(), strict=True))
    counts = Counter(number for number, _ in pairs)
    return len(pairs) - len(counts)


def _naming(stream: Stream, field: str, names: Mapping[str, str]) -> dict[int, str]:
    """Return the rows of messages with one of the names in a field, each with the value of that name.

    Only messages with the bytes of a name are decoded.
    """
    sought = [name.encode() for name in names]
    possible = np.zeros(len(stream), dtype=bool)
    for row, data in enumerate(stream.data):
        possible[row] = any(name in data for name in sought)
    values = stream.only(possible).field(field)
    found: dict[int, str] = {}
    for row, value in zip(np.flatnonzero(possible).tolist(), values, strict=True):
        if value in names:
            found[row] = names[value]
    return found


def _brought_down(run: ProcessRun) -> str:
    """Say how a grader process was brought down; empty if it was not."""
    if run.ended_by in ("terminate", "kill"):
        return "no longer reacted and had to be killed"
    if run.ended_by != "itself":
        return ""
    status = run.exit_status or 0
    if status < 0 and status not in _SENT_BY_OTHERS:
        return f"ended by signal {-status}"
    for line in run.output[-_LAST_LINES:]:
        if any(word in line.text for word in _OUT_OF_MEMORY):
            return f"ended with exit status {run.exit_status}"
    return ""
