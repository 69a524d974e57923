"""The census of a session's graph: what of the grader's own the student's processes touched.

The grader's endpoints and messages are known by what its processes told through their pipes; whatever else is in
the graph is the student's. Where a recording does not hold what was told, as older ones do not, nothing is found.

What is found has honest causes too: a publisher on a wrong topic, or an arm simulator of the student's own.
So it is stated as seen, and the grader's own messages are told from others (see `grader.evidence.authorship`)
wherever that suffices to measure all the same.
"""

from __future__ import annotations

import itertools
import signal
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grader.evidence.recorded import Recorded, Span
from grader.evidence.unrecorded import dropped
from grader.recording.bag import Stream
from grader.recording.session import (
    GRADER_NAMESPACE,
    PARTICIPANT_DIGITS,
    PROCESS_DIGITS,
    UNKNOWN_NODE,
    Endpoint,
    GraphSnapshot,
    ProcessRun,
    ServiceClient,
)
from grader.result import Violation, ViolationKind, Where

#: On these every node publishes.
_SHARED_TOPICS = ("/rosout", "/parameter_events")
_CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
#: Services of a node by which others change it.
_CHANGING = ("set_parameters", "set_parameters_atomically")
_MOST_NAMED = 5
#: Share of a time for which the recorder, all its threads together, waits for a core where the machine is busy; beside
#: other sessions of the same grading it is a tenth.
_LATE = 0.2
#: Share of a time in which the student's own programs may have used a core, if the machine is to blame for a delay.
_OWN_DOING = 0.5
#: Recordings from which trouble is none that comes once in a while.
_REPEATED = 2
#: Signals by which the system's administrators and its shortage of memory end a process: no program's doing.
_SENT_BY_OTHERS = (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)
_OUT_OF_MEMORY = ("MemoryError", "bad_alloc")


@dataclass(frozen=True)
class Touched:
    """Something of the grader's own that was touched.

    Attributes
    ----------
    spoilt : frozenset of str
        Topics, services and nodes in the graph of which nothing can be measured any more in this session.
    whole : bool
        Whether that goes for all of the session.
    """

    violation: Violation
    spoilt: frozenset[str] = frozenset()
    whole: bool = False


@dataclass(frozen=True)
class _Sighting:
    """An endpoint with the time that it was in the graph; its node is that of its participant if it is unknown."""

    endpoint: Endpoint
    span: Span


class _Census:
    def __init__(self, recorded: Recorded, reference_nodes: Mapping[str, str]) -> None:
        self.recorded = recorded
        self.record = recorded.record
        self.session = recorded.record.session
        told = {t.process for t in self.record.trusted}
        #: Names of reference nodes, whether they run in this session or not; and those that run, by process.
        self.nodes = frozenset(reference_nodes.values())
        self.running = {name: node for name, node in reference_nodes.items() if name in told}
        self.seen = _sightings(recorded)
        self.strangers = [s for s in self.seen if not recorded.is_trusted(s.endpoint.gid)]

    def seconds(self, *times_ns: int) -> list[float]:
        return [round(self.recorded.since_start_s(t), 2) for t in times_ns]

    def violation(
        self,
        kind: ViolationKind,
        text: str,
        evidence: Iterable[str],
        span: Span,
        topic: str | None = None,
        *,
        certain: bool = True,
    ) -> Violation:
        start_s, end_s = self.seconds(span.start_ns, span.end_ns)
        where = Where(session=self.session, topic=topic, start_s=start_s, end_s=end_s)
        return Violation(kind, self.session, text, tuple(evidence), where, certain)

    def described(self, sightings: Sequence[_Sighting]) -> Iterator[str]:
        for sighting in sightings[:_MOST_NAMED]:
            endpoint = sighting.endpoint
            start_s, end_s = self.seconds(sighting.span.start_ns, sighting.span.end_ns)
            node = "a node that never told its name" if UNKNOWN_NODE in endpoint.node else f"node {endpoint.node}"
            kind, gid = endpoint.kind, endpoint.gid
            yield f"{kind} on {endpoint.topic} of {node}, gid {gid}, in the graph from {start_s:g} to {end_s:g} s"
        if len(sightings) > _MOST_NAMED:
            yield f"and {len(sightings) - _MOST_NAMED} more"

    # -- nodes --------------------------------------------------------------------------------

    def impersonated(self) -> Iterator[Touched]:
        """Find nodes of the submission under a name that is the grader's."""
        by_name: dict[str, list[_Sighting]] = {}
        for sighting in self.strangers:
            node = sighting.endpoint.node
            if node in self.nodes or node.startswith(GRADER_NAMESPACE + "/"):
                by_name.setdefault(node if node in self.nodes else GRADER_NAMESPACE, []).append(sighting)
        for name, sightings in by_name.items():
            text = f"A node of the submission has the name {name}, which is that of a node of the grader's."
            if name == GRADER_NAMESPACE:
                text = f"Nodes of the submission are in the grader's own namespace {name}."
            evidence = list(self.described(sightings))
            own = [s.endpoint.gid for s in self.seen if s.endpoint.node == name and self._is_ours(s)]
            if own:
                evidence.append(f"the grader's own node has gids that begin with {min(own)[:PARTICIPANT_DIGITS]}")
            violation = self.violation(ViolationKind.IMPERSONATES_NODE, text, evidence, _whole(sightings))
            yield Touched(violation, frozenset({name}))

    def asked_to_change(self) -> Iterator[Touched]:
        """Find clients of the services that would set parameters of a reference node, if it had them."""
        wanted = {f"{node}/{service}": node for node in self.nodes for service in _CHANGING}
        found: dict[str, list[tuple[int, ServiceClient]]] = {}
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
            span = Span(seen[0][0], seen[-1][0])
            yield Touched(self.violation(ViolationKind.CHANGES_REFERENCE, text, evidence, span))

    def second_servers(self) -> Iterator[Touched]:
        """Find services that the submission offers beside a reference node, or from two of its own programs."""
        impersonated = {s.endpoint.node for s in self.strangers}
        ours = {node for node in self.running.values() if node not in impersonated}
        beside: dict[str, dict[str, list[int]]] = {}
        between: dict[str, dict[str, list[int]]] = {}
        for graph, service, nodes in self._offers():
            theirs = nodes - self.nodes
            if service not in self.recorded.awaited and nodes & ours:
                found = beside
            elif service in self.recorded.awaited and self._rivals(graph, theirs):
                found = between
            else:
                continue
            for node in theirs:
                found.setdefault(service, {}).setdefault(node, []).append(graph.t_ns)
        for service, seen in beside.items():
            text = f"The submission offers the service {service}, as a node of the grader's does."
            yield Touched(self._served(service, seen, text), frozenset({service}))
        for service, seen in between.items():
            named = " and ".join(sorted(seen)[:_MOST_NAMED])
            text = f"{named} of the submission both offer the service {service}; which of them answered is not known."
            yield Touched(self._served(service, seen, text))

    def _offers(self) -> Iterator[tuple[GraphSnapshot, str, set[str]]]:
        """Give each service in each snapshot, with the nodes that offer it."""
        for graph in self.record.graph:
            offers: dict[str, set[str]] = {}
            for offer in graph.services:
                offers.setdefault(offer.name, set()).add(offer.node)
            for service, nodes in offers.items():
                yield graph, service, nodes

    def _rivals(self, graph: GraphSnapshot, nodes: set[str]) -> bool:
        """Whether nodes belong to programs that are different: not to one that was started twice, or came back."""
        processes = {n: {e.gid[:PROCESS_DIGITS] for e in graph.endpoints if e.node == n} for n in nodes}
        apart = all(a and b and a.isdisjoint(b) for a, b in itertools.combinations(processes.values(), 2))
        alive = [
            run.artifact or run.argv[0]
            for run in self.record.processes
            if run.role == "student" and run.argv and run.started_ns <= graph.t_ns < (run.exited_ns or 2**63)
        ]
        return len(nodes) > 1 and apart and len(set(alive)) == len(alive)

    def _served(self, service: str, seen: Mapping[str, Sequence[int]], text: str) -> Violation:
        evidence = [f"server of {service} in node {node}" for node in sorted(seen)[:_MOST_NAMED]]
        times_ns = [t for times in seen.values() for t in times]
        span = Span(min(times_ns), max(times_ns))
        return self.violation(ViolationKind.SECOND_SERVER, text, evidence, span, service)

    # -- disturbances ------------------------------------------------------------------------

    def brought_down(self) -> Iterator[Touched]:
        """Find the grader's own processes that died in their native code, or no longer heeded anybody.

        In a session's network only its own processes speak, so that whatever does this comes from one of them. Once it
        may be chance; where it is so in two recordings, what the submission's programs sent is what did it.
        """
        for run in self.record.processes:
            span = Span(run.started_ns, run.exited_ns or self.record.ended_ns)
            if run.role == "student" or not _brought_down(run) or self._machine_was_late(span):
                continue
            what = f"node {self.running[run.name]}" if run.name in self.running else f"process {run.name}"
            text = f"The grader's own {what} {_end(run)} while programs of the submission were running."
            yield self._disturbed(ViolationKind.ENDS_REFERENCE, text, [], span, whole=True)

    def kept_from_recorder(self) -> Iterator[Touched]:
        """Find messages of the grader's that never reached its recorder, though the machine did not hold it up."""
        span = Span(self.record.started_ns, self.record.ended_ns)
        for missing in dropped(self.recorded) if not self._machine_was_late(span) else ():
            text = f"{missing.text} Packets in the grader's name can do that, and the machine was not busy."
            spoilt = frozenset({missing.topic})
            if any(i.topic == missing.topic and i.topic_type == _CLOCK_TYPE for i in self.recorded.bag.topics):
                spoilt = frozenset(info.topic for info in self.recorded.bag.topics)
            yield self._disturbed(ViolationKind.DISTURBS_RECORDING, text, spoilt, span, missing.topic)

    def not_in_order(self) -> Iterator[Touched]:
        """Find what else kept an experiment from being carried out in order, again and again, on an idle machine.

        Whose doing it is, only a person can tell: until then it is undecided.
        """
        whole = self.record.complete
        problems = self.record.problems[:_MOST_NAMED] if whole else ["the recording was cut off"]
        # Of a session that was cut off only its start is known.
        span = Span(self.record.started_ns, self.record.ended_ns if whole else self.record.started_ns)
        alone = whole and all(run.role != "student" for run in self.record.processes)
        once = self.record.times_recorded < _REPEATED
        if not problems or alone or once or self._machine_was_late(span):
            return
        text = (
            f"In {self.record.times_recorded} recordings the experiment could not be carried out in order while "
            "programs of the submission were running, and the machine was not busy."
        )
        yield Touched(self.violation(ViolationKind.DISTURBS_RECORDING, text, problems, span, certain=False))

    def _disturbed(
        self,
        kind: ViolationKind,
        text: str,
        spoilt: Iterable[str],
        span: Span,
        topic: str | None = None,
        *,
        whole: bool = False,
    ) -> Touched:
        repeated = self.record.disturbed_before
        evidence = [f"so in recording number {self.record.attempt}" + " and in one before" * repeated]
        violation = self.violation(kind, text, evidence, span, topic, certain=repeated)
        return Touched(violation, frozenset(spoilt), whole)

    def _machine_was_late(self, span: Span) -> bool:
        """Whether it may be the machine's doing, and not that of programs that are busy themselves."""
        students = [run for run in self.record.processes if run.role == "student"]
        own_s = sum(self.recorded.cpu_s(run, span) for run in students)
        return self.recorded.recorder_delay_s(span) > _LATE * span.duration_s and own_s < _OWN_DOING * span.duration_s

    # -- topics -------------------------------------------------------------------------------

    def published(self) -> Iterator[Touched]:
        """Find messages of others on topics on which only the grader is to publish."""
        ours = {s.endpoint.topic for s in self.seen if self._is_ours(s) and s.endpoint.kind == "publisher"}
        topics = ours | {entry.topic for entry in self.record.published}
        for topic in sorted(topics - self.recorded.awaited - set(_SHARED_TOPICS)):
            publishers = [s for s in self.strangers if s.endpoint.kind == "publisher" and s.endpoint.topic == topic]
            apart = self.recorded.authorship(topic)
            if apart is None and publishers:
                yield from self._mixed(topic, publishers)
            elif apart is not None and len(apart.others_ns):
                span = Span(int(apart.others_ns[0]), int(apart.others_ns[-1]))
                start_s, end_s = self.seconds(span.start_ns, span.end_ns)
                count = len(apart.others_ns)
                evidence = [
                    f"{count} messages recorded on {topic} from {start_s:g} to {end_s:g} s are none of the grader's "
                    f"{len(apart.own)}"
                ]
                yield self._on_topic(topic, publishers, evidence, span)

    def _is_ours(self, sighting: _Sighting) -> bool:
        return self.recorded.is_trusted(sighting.endpoint.gid)

    def _mixed(self, topic: str, publishers: Sequence[_Sighting]) -> Iterator[Touched]:
        """Find publishers whose messages cannot be told from the grader's: nothing there can be measured."""
        stream = self.recorded.bag.stream(topic)
        evidence = []
        if repeated := _repeated(stream):
            evidence = [f"{repeated} of {len(stream)} messages recorded there repeat a publication sequence number"]
        elif len(stream) and any(entry.digests for entry in self.recorded.published_on(topic)):
            evidence = [f"none of {len(stream)} messages recorded there is one of the grader's"]
        if evidence:
            touched = self._on_topic(topic, publishers, evidence, _whole(publishers))
            yield replace(touched, spoilt=touched.spoilt | {topic})

    def _on_topic(self, topic: str, publishers: Sequence[_Sighting], evidence: list[str], span: Span) -> Touched:
        whose = ", ".join(sorted({s.endpoint.node for s in publishers if UNKNOWN_NODE not in s.endpoint.node})[:3])
        who = f"The submission ({whose})" if whose else "The submission"
        evidence += self.described(publishers) if publishers else ["no publisher of theirs was seen in the graph"]
        certain = bool(publishers)
        if any(info.topic == topic and info.topic_type == _CLOCK_TYPE for info in self.recorded.bag.topics):
            text = f"{who} published time on {topic}, where in this session the grader's own clock is."
            violation = self.violation(ViolationKind.SPOOFS_CLOCK, text, evidence, span, topic, certain=certain)
            # All that is paced by the time hangs on it, whatever its topic.
            return Touched(violation, frozenset(info.topic for info in self.recorded.bag.topics))
        text = f"{who} published on {topic}, where in this session only the grader is to publish."
        kind = ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC
        if self.recorded.authorship(topic) is not None:
            evidence.append("what rests on this topic was judged by the grader's own messages alone")
        return Touched(self.violation(kind, text, evidence, span, topic, certain=certain))

    # -- logs ---------------------------------------------------------------------------------

    def forged(self) -> Iterator[Touched]:
        """Find log messages and parameter events in the name of a node of ours: none of them ever sends any."""
        theirs = {s.endpoint.node for s in self.strangers}
        names = {node for node in (*self.nodes, f"{GRADER_NAMESPACE}/probe") if node not in theirs}
        log = self.recorded.bag.stream("/rosout", "rcl_interfaces/msg/Log")
        loggers = {node.strip("/").replace("/", "."): node for node in names}
        said = _naming(log, "name", loggers)
        if said:
            text = "Log messages on /rosout have the name of a node of the grader's, which sends none."
            yield self._forged(ViolationKind.FORGES_ROSOUT, text, log, said)
        events = self.recorded.bag.stream("/parameter_events", "rcl_interfaces/msg/ParameterEvent")
        told = _naming(events, "node", {node: node for node in names})
        # When a node is made it declares its parameters; no parameter of ours is changed later.
        rows = np.isin(np.arange(len(events)), list(told))
        changes = events.only(rows).field("changed_parameters")
        told = {row: node for (row, node), changed in zip(sorted(told.items()), changes, strict=True) if changed}
        if told:
            text = "Events on /parameter_events tell of changed parameters of the grader's, where none can be changed."
            yield self._forged(ViolationKind.FORGES_PARAMETER_EVENTS, text, events, told)

    def _forged(self, kind: ViolationKind, text: str, stream: Stream, rows: Mapping[int, str]) -> Touched:
        times_ns = stream.received_ns[list(rows)]
        span = Span(int(times_ns[0]), int(times_ns[-1]))
        counts = Counter(rows.values())
        evidence = [f"{counts[node]} messages in the name of {node}" for node in sorted(counts)]
        return Touched(self.violation(kind, text, evidence, span, stream.topic))


def census(recorded: Recorded, reference_nodes: Mapping[str, str]) -> tuple[Touched, ...]:
    """Return what of the grader's own was touched in a session.

    Parameters
    ----------
    reference_nodes : mapping
        Name of each reference process -> fully qualified name of its node.
    """
    taken = _Census(recorded, reference_nodes)
    disturbed = tuple(taken.brought_down()) or tuple(taken.not_in_order())
    if not recorded.record.trusted or recorded.silent_references:
        return disturbed
    return (
        *taken.impersonated(),
        *taken.published(),
        *taken.second_servers(),
        *taken.asked_to_change(),
        *taken.forged(),
        *disturbed,
        *taken.kept_from_recorder(),
    )


def _sightings(recorded: Recorded) -> tuple[_Sighting, ...]:
    """Return all endpoints that were ever in the graph, by gid, topic and kind."""
    graphs = recorded.record.graph
    ends_ns = [graph.t_ns for graph in graphs[1:]] + [recorded.record.ended_ns] * bool(graphs)
    found: dict[tuple[str, str, str], _Sighting] = {}
    nodes: dict[str, str] = {}
    for graph, end_ns in zip(graphs, ends_ns, strict=True):
        for endpoint in graph.endpoints:
            key = (endpoint.gid, endpoint.topic, endpoint.kind)
            known = found.get(key)
            # The name of its node may be unknown at first, and again at the end.
            named = known.endpoint if known is not None and UNKNOWN_NODE in endpoint.node else endpoint
            found[key] = _Sighting(named, Span(known.span.start_ns if known is not None else graph.t_ns, end_ns))
            if UNKNOWN_NODE not in endpoint.node:
                nodes.setdefault(endpoint.gid[:PARTICIPANT_DIGITS], endpoint.node)
    return tuple(
        replace(s, endpoint=replace(s.endpoint, node=nodes.get(s.endpoint.gid[:PARTICIPANT_DIGITS], s.endpoint.node)))
        if UNKNOWN_NODE in s.endpoint.node
        else s
        for s in found.values()
    )


def _whole(sightings: Sequence[_Sighting]) -> Span:
    return Span(min(s.span.start_ns for s in sightings), max(s.span.end_ns for s in sightings))


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


def _brought_down(run: ProcessRun) -> bool:
    """Whether a process of the grader's was ended by something in its native code, or had to be killed."""
    if run.ended_by in ("terminate", "kill"):
        return True
    memory = any(word in line.text for line in run.output[-5:] for word in _OUT_OF_MEMORY)
    crashed = (run.exit_status or 0) < 0 and run.exit_status not in _SENT_BY_OTHERS
    return run.ended_by == "itself" and (crashed or memory)


def _end(run: ProcessRun) -> str:
    if run.ended_by in ("terminate", "kill"):
        return "no longer heeded anybody and had to be killed"
    if (run.exit_status or 0) < 0:
        return f"ended by signal {-(run.exit_status or 0)}"
    return f"ended with exit status {run.exit_status}"
