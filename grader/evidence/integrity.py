"""The integrity of a session: what of the grader's own the student's processes tampered with.

The grader's endpoints and messages are known by what its processes reported through the trusted channel; whatever else
is in the graph is the student's. Where there are no reports, nothing is found. What is has honest causes too, such as a
publisher on a wrong topic: so it is stated as seen, and where the grader's own messages can be told apart, all the same
is measured by them.
"""

from __future__ import annotations

import itertools
import signal
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grader.evidence.cpu_delay import Span
from grader.evidence.gaps import dropped
from grader.evidence.recorded import Recorded, Sighting
from grader.recording.bag import Stream
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

#: On these every node publishes.
_SHARED_TOPICS = ("/rosout", "/parameter_events")
_CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
#: Services of a node by which others change it.
_CHANGING = ("set_parameters", "set_parameters_atomically")
_MOST_NAMED = 5
#: Share of a time for which the recorder, all its threads together, waits for a core where the machine is busy; beside
#: other sessions of the same grading it is a tenth.
_BUSY = 0.2
#: Recordings from which trouble is none that comes once in a while.
_REPEATED = 2
#: Signals by which the system's administrators and its shortage of memory end a process: no program's doing.
_SENT_BY_OTHERS = (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)
_OUT_OF_MEMORY = ("MemoryError", "bad_alloc")


@dataclass(frozen=True)
class Tampering:
    """Something of the grader's own that was tampered with.

    Of the topics, services and nodes that are `invalidated`, or of the whole session, nothing can be measured any more.
    """

    violation: Violation
    invalidated: frozenset[str] = frozenset()
    whole: bool = False


class _Integrity:
    def __init__(self, recorded: Recorded, reference_nodes: Mapping[str, str]) -> None:
        self.recorded, self.record = recorded, recorded.record
        reporting = {t.process for t in self.record.trusted}
        #: Names of reference nodes, whether they run in this session or not; and those that run, by process.
        self.nodes = frozenset(reference_nodes.values())
        self.running = {name: node for name, node in reference_nodes.items() if name in reporting}
        self.ours = [s for s in recorded.sightings if recorded.is_trusted(s.endpoint.gid)]
        self.student_endpoints = [
            s for s in recorded.sightings if not recorded.is_trusted(s.endpoint.gid)
        ]
        self.topics = frozenset(info.topic for info in recorded.bag.topics)
        self.clocks = frozenset(
            info.topic for info in recorded.bag.topics if info.topic_type == _CLOCK_TYPE
        )

    def seconds(self, *times_ns: int) -> list[float]:
        return [round(self.recorded.since_start_s(t), 2) for t in times_ns]

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
        start_s, end_s = self.seconds(span.start_ns, span.end_ns)
        where = Location(session=self.record.session, topic=topic, start_s=start_s, end_s=end_s)
        violation = Violation(kind, self.record.session, text, tuple(evidence), where, certain)
        return Tampering(violation, frozenset(invalidated), whole)

    def described(self, sightings: Sequence[Sighting]) -> Iterator[str]:
        for sighting in sightings[:_MOST_NAMED]:
            endpoint = sighting.endpoint
            start_s, end_s = self.seconds(sighting.start_ns, sighting.end_ns)
            node = (
                "a node whose name is not known"
                if UNKNOWN_NODE in endpoint.node
                else f"node {endpoint.node}"
            )
            kind, gid = endpoint.kind, endpoint.gid
            yield f"{kind} on {endpoint.topic} of {node}, gid {gid}, in the graph from {start_s:g} to {end_s:g} s"
        if len(sightings) > _MOST_NAMED:
            yield f"and {len(sightings) - _MOST_NAMED} more"

    # -- nodes --------------------------------------------------------------------------------

    def impersonated(self) -> Iterator[Tampering]:
        """Find nodes of the submission under a name that is the grader's."""
        by_name: dict[str, list[Sighting]] = {}
        for sighting in self.student_endpoints:
            node = sighting.endpoint.node
            if node in self.nodes or node.startswith(GRADER_NAMESPACE + "/"):
                by_name.setdefault(node if node in self.nodes else GRADER_NAMESPACE, []).append(
                    sighting
                )
        for name, sightings in by_name.items():
            text = f"A node of the submission has the name {name}, which is the name of a node of the grader's."
            if name == GRADER_NAMESPACE:
                text = f"Nodes of the submission are in the grader's own namespace {name}."
            evidence = list(self.described(sightings))
            own = [s.endpoint.gid for s in self.ours if s.endpoint.node == name]
            if own:
                evidence.append(
                    f"the grader's own node has gids that begin with {min(own)[:PARTICIPANT_DIGITS]}"
                )
            yield self.tampering(
                ViolationKind.IMPERSONATES_NODE,
                text,
                evidence,
                _whole(sightings),
                invalidated={name},
            )

    def asked_to_change(self) -> Iterator[Tampering]:
        """Find clients of the services that would set parameters of a reference node, if it had them."""
        wanted = {f"{node}/{service}": node for node in self.nodes for service in _CHANGING}
        found: dict[str, list[tuple[int, ServiceEndpoint]]] = {}
        for graph in self.record.graph:
            for client in graph.clients:
                if client.name in wanted:
                    found.setdefault(wanted[client.name], []).append((graph.t_ns, client))
        offered = {offer.name for graph in self.record.graph for offer in graph.services}
        for reference, seen in found.items():
            clients = sorted({(client.name, client.node) for _, client in seen})
            text = f"The submission has clients that set parameters of {reference}, a node of the grader's."
            if offered.isdisjoint(name for name, _ in clients):
                text += " It has no such service, so nothing of it was changed."
            evidence = [f"client of {name} in node {node}" for name, node in clients[:_MOST_NAMED]]
            yield self.tampering(
                ViolationKind.CHANGES_REFERENCE, text, evidence, Span(seen[0][0], seen[-1][0])
            )

    def second_servers(self) -> Iterator[Tampering]:
        """Find services that the submission offers beside a reference node, or from two of its own programs."""
        ours = set(self.running.values()) - {s.endpoint.node for s in self.student_endpoints}
        found: dict[str, list[tuple[int, str]]] = {}
        for graph in self.record.graph:
            offers: dict[str, set[str]] = {}
            for offer in graph.services:
                offers.setdefault(offer.name, set()).add(offer.node)
            for service, nodes in offers.items():
                theirs = nodes - self.nodes
                seen_twice = (
                    self._rivals(graph, theirs)
                    if service in self.recorded.awaited
                    else nodes & ours
                )
                if theirs and seen_twice:
                    found.setdefault(service, []).extend((graph.t_ns, node) for node in theirs)
        for service, seen in found.items():
            listed = sorted({node for _, node in seen})[:_MOST_NAMED]
            evidence = [f"server of {service} in node {node}" for node in listed]
            is_reference = service not in self.recorded.awaited
            text = f"The submission offers the service {service}, as a node of the grader's does."
            if not is_reference:
                who = f"{' and '.join(listed)} of the submission both offer the service {service}"
                text = f"{who}; which of them answered is not known."
            span = Span(seen[0][0], seen[-1][0])
            invalidated = {service} if is_reference else ()
            yield self.tampering(
                ViolationKind.SECOND_SERVER, text, evidence, span, service, invalidated=invalidated
            )

    def _rivals(self, graph: GraphSnapshot, nodes: set[str]) -> bool:
        """Whether nodes belong to programs that are different: not to one that was started twice, or came back."""
        processes = {
            n: {e.gid[:PROCESS_DIGITS] for e in graph.endpoints if e.node == n} for n in nodes
        }
        apart = all(
            a and b and a.isdisjoint(b) for a, b in itertools.combinations(processes.values(), 2)
        )
        alive = [
            run.artifact or run.argv[0]
            for run in self.record.processes
            if run.role == "student"
            and run.argv
            and run.started_ns <= graph.t_ns < (run.exited_ns or 2**63)
        ]
        return len(nodes) > 1 and apart and len(set(alive)) == len(alive)

    # -- disturbances ------------------------------------------------------------------------

    def brought_down(self) -> Iterator[Tampering]:
        """Find the grader's own processes that died in their native code, or no longer heeded anybody.

        In a session's network only its own processes speak, so that whatever does this comes from one of them. A
        single occurrence is not conclusive; where it is so in two recordings, the submission's programs did it.
        """
        for run in self.record.processes:
            span = Span(run.started_ns, run.exited_ns or self.record.ended_ns)
            end = _brought_down(run) if run.role != "student" else ""
            if end and not self._machine_was_busy(span):
                what = (
                    f"node {self.running[run.name]}"
                    if run.name in self.running
                    else f"process {run.name}"
                )
                text = (
                    f"The grader's own {what} {end} while programs of the submission were running."
                )
                yield self._disturbed(ViolationKind.ENDS_REFERENCE, text, span, whole=True)

    def dropped_messages(self) -> Iterator[Tampering]:
        """Find messages of the grader's that never reached its recorder, though the machine did not delay it."""
        span = Span(self.record.started_ns, self.record.ended_ns)
        for topic, loss in (
            dropped(self.recorded).items() if not self._machine_was_busy(span) else ()
        ):
            text = f"{loss} Packets in the grader's name can do that, and the machine was not busy."
            invalidated = self.topics if topic in self.clocks else {topic}
            yield self._disturbed(
                ViolationKind.DISTURBS_RECORDING, text, span, topic, invalidated=invalidated
            )

    def repeatedly_disturbed(self) -> Iterator[Tampering]:
        """Find what else kept an experiment from being carried out in order, again and again, on an idle machine.

        Whose doing it is, only a person can tell: until then it is undecided.
        """
        whole = self.record.complete
        problems = self.record.problems[:_MOST_NAMED] if whole else ["the recording was cut off"]
        # Of a session that was cut off only its start is known.
        span = Span(
            self.record.started_ns, self.record.ended_ns if whole else self.record.started_ns
        )
        alone = whole and all(run.role != "student" for run in self.record.processes)
        once = self.record.times_recorded < _REPEATED
        if not problems or alone or once or self._machine_was_busy(span):
            return
        text = (
            f"In {self.record.times_recorded} recordings the session could not be carried out as planned while "
            "programs of the submission were running, and the machine was not busy."
        )
        yield self.tampering(ViolationKind.DISTURBS_RECORDING, text, problems, span, certain=False)

    def _disturbed(
        self, kind: ViolationKind, text: str, span: Span, topic: str | None = None, **more: Any
    ) -> Tampering:
        repeated = self.record.disturbed_before
        evidence = [
            f"so in recording number {self.record.attempt}" + " and in one before" * repeated
        ]
        return self.tampering(kind, text, evidence, span, topic, certain=repeated, **more)

    def _machine_was_busy(self, span: Span) -> bool:
        """Whether it may be the machine's doing, and not that of programs that are busy themselves."""
        busy = self.recorded.recorder_delay_s(span) > _BUSY * span.duration_s
        return busy and not self.recorded.students_busy(span)

    # -- topics -------------------------------------------------------------------------------

    def published(self) -> Iterator[Tampering]:
        """Find messages of others on topics on which only the grader is to publish."""
        ours = {s.endpoint.topic for s in self.ours if s.endpoint.kind == "publisher"}
        topics = ours | {entry.topic for entry in self.record.published}
        for topic in sorted(topics - self.recorded.awaited - set(_SHARED_TOPICS)):
            publishers = [
                s
                for s in self.student_endpoints
                if s.endpoint.kind == "publisher" and s.endpoint.topic == topic
            ]
            apart = self.recorded.authorship(topic)
            if apart is not None and len(apart.others_ns):
                span = Span(int(apart.others_ns[0]), int(apart.others_ns[-1]))
                start_s, end_s = self.seconds(span.start_ns, span.end_ns)
                count = f"{len(apart.others_ns)} messages recorded on {topic} from {start_s:g} to {end_s:g} s"
                yield self._on_topic(
                    topic, publishers, f"{count} are none of the grader's {len(apart.own)}", span
                )
            elif apart is None and publishers and (mixed := self._mixed(topic)):
                yield self._on_topic(topic, publishers, mixed, _whole(publishers))

    def _mixed(self, topic: str) -> str:
        """Describe why messages of others cannot be separated from the grader's; empty where they need not."""
        stream = self.recorded.bag.stream(topic)
        if repeated := _repeated(stream):
            return f"{repeated} of {len(stream)} messages recorded there repeat a publication sequence number"
        if len(stream) and any(entry.digests for entry in self.recorded.published_on(topic)):
            return f"none of {len(stream)} messages recorded there is one of the grader's"
        return ""

    def _on_topic(
        self, topic: str, publishers: Sequence[Sighting], seen: str, span: Span
    ) -> Tampering:
        named = sorted(
            {s.endpoint.node for s in publishers if UNKNOWN_NODE not in s.endpoint.node}
        )[:3]
        who = f"The submission ({', '.join(named)})" if named else "The submission"
        evidence = [seen, *self.described(publishers)]
        evidence += [] if publishers else ["no publisher of theirs was seen in the graph"]
        # Where the grader's own messages are known, what rests on the topic is judged by them alone.
        invalidated = frozenset({topic} if self.recorded.authorship(topic) is None else ())
        if topic in self.clocks:
            kind, invalidated = (
                ViolationKind.SPOOFS_CLOCK,
                self.topics,
            )  # All that is paced by the time rests on it.
            text = (
                f"{who} published time on {topic}, where in this session the grader's own clock is."
            )
        else:
            kind = ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC
            text = (
                f"{who} published on {topic}, where in this session only the grader is to publish."
            )
            if not invalidated:
                evidence.append("checks of this topic used the grader's own messages only")
        return self.tampering(
            kind, text, evidence, span, topic, invalidated=invalidated, certain=bool(publishers)
        )

    # -- logs ---------------------------------------------------------------------------------

    def forged(self) -> Iterator[Tampering]:
        """Find log messages and parameter events in the name of a node of ours: none of them ever sends any."""
        names = {*self.nodes, f"{GRADER_NAMESPACE}/probe"} - {
            s.endpoint.node for s in self.student_endpoints
        }
        log = self.recorded.bag.stream("/rosout", "rcl_interfaces/msg/Log")
        logged = _naming(log, "name", {node.strip("/").replace("/", "."): node for node in names})
        text = "Log messages on /rosout have the name of a node of the grader's, which sends none."
        yield from self._forged(ViolationKind.FORGES_ROSOUT, text, log, logged)
        events = self.recorded.bag.stream("/parameter_events", "rcl_interfaces/msg/ParameterEvent")
        rows = _naming(events, "node", {node: node for node in names})
        # When a node is made it declares its parameters; no parameter of ours is changed later.
        changes = events.only(np.isin(np.arange(len(events)), list(rows))).field(
            "changed_parameters"
        )
        rows = {
            row: node
            for (row, node), changed in zip(sorted(rows.items()), changes, strict=True)
            if changed
        }
        text = "Events on /parameter_events report changed parameters of the grader's nodes, which cannot be changed."
        yield from self._forged(ViolationKind.FORGES_PARAMETER_EVENTS, text, events, rows)

    def _forged(
        self, kind: ViolationKind, text: str, stream: Stream, rows: Mapping[int, str]
    ) -> Iterator[Tampering]:
        if rows:
            times_ns = stream.received_ns[list(rows)]
            span = Span(int(times_ns[0]), int(times_ns[-1]))
            evidence = [
                f"{count} messages in the name of {node}"
                for node, count in sorted(Counter(rows.values()).items())
            ]
            yield self.tampering(kind, text, evidence, span, stream.topic)


def tampering_in(recorded: Recorded, reference_nodes: Mapping[str, str]) -> tuple[Tampering, ...]:
    """Return the tampering in a session; reference nodes by the names of their processes."""
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


def _whole(sightings: Sequence[Sighting]) -> Span:
    return Span(min(s.start_ns for s in sightings), max(s.end_ns for s in sightings))


def _repeated(stream: Stream) -> int:
    """Count the messages whose sequence number another message has, which was sent at another time."""
    pairs = {*zip(stream.sequence.tolist(), stream.source_ns.tolist(), strict=True)}
    numbers, counts = np.unique([number for number, _ in pairs], return_counts=True)
    return int((counts[counts > 1] - 1).sum()) if len(numbers) else 0


def _naming(stream: Stream, field: str, names: Mapping[str, str]) -> dict[int, str]:
    """Return the rows of messages in which a field is one of some names, with what that stands for.

    Only those are decoded that can hold a name.
    """
    sought = [name.encode() for name in names]
    possible = np.array([any(name in data for name in sought) for data in stream.data], dtype=bool)
    values = stream.only(possible).field(field)
    rows = np.flatnonzero(possible).tolist()
    return {row: names[value] for row, value in zip(rows, values, strict=True) if value in names}


def _brought_down(run: ProcessRun) -> str:
    """Say that a process of the grader's was ended by something in its native code, or had to be killed, if so."""
    if run.ended_by in ("terminate", "kill"):
        return "no longer reacted and had to be killed"
    status = run.exit_status or 0
    if run.ended_by == "itself" and status < 0 and status not in _SENT_BY_OTHERS:
        return f"ended by signal {-status}"
    out_of_memory = any(word in line.text for line in run.output[-5:] for word in _OUT_OF_MEMORY)
    return (
        f"ended with exit status {run.exit_status}"
        if run.ended_by == "itself" and out_of_memory
        else ""
    )
