"""A recorded session as the checks see it: numbers and facts, no judgement.

Names are those of the rubric; a name that the student used instead is followed. Floats are seconds since the start.
"""

from __future__ import annotations

import bisect
import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grader.evidence.authorship import Authorship, authorship
from grader.evidence.cpu_delay import Backlog, Delay, Span, backlog, clipped, delay_before
from grader.evidence.fields import numbers_of, time_ns
from grader.evidence.text.output import plain_output
from grader.lab.steps.call import CallStep
from grader.lab.steps.observe import ObserveResult
from grader.lab.steps.publish import PublishStep
from grader.lab.steps.wait_for import WaitForStep
from grader.recording.session import (
    LINK,
    PARTICIPANT_DIGITS,
    UNKNOWN_NODE,
    Claim,
    Endpoint,
    MachineSample,
    OutputLine,
    ProcessRun,
    Published,
    SessionRecord,
    StepRun,
    read_session,
)
from ros_bag.elements import MOST_VALUES
from ros_bag.fields import field_steps
from ros_bag.reading import Bag, Stream

#: Largest step of the system clock against the monotonic clock, in s, that is not a setting of the clock.
_STEP_S = 0.002
#: Largest slew of the clock, as a share of the time.
_SLEW = 0.001
#: Share of a core from which a process had no time left, computing and waiting together.
_SATURATED = 0.9
#: Error of a core's idle time within a span, in s: the kernel counts hundredths of a second, and each end may be off
#: by one.
_IDLE_ERROR_S = 0.02
#: Share of a span by which a process's waits exceed its idle time if several threads waited at once. A single thread
#: waits at most for the time in which its process does not compute; samples leave less than this share open.
_AT_ONCE = 0.25
#: Usual intervals between samples of the machine from which a sample is late.
_LATE_SAMPLE = 1.5
#: Samples from which the usual interval is known.
_FEWEST_SAMPLES = 4
#: Share of a core, used by the student's programs, from which a delay need not be the machine's.
_OWN_DOING = 0.5
#: Average number of the student's waiting threads that makes a crowd. A starting node has one or two, an executor with
#: four busy threads has four.
_CROWD = 8.0
#: Samples of the machine in one part of a session: 2 s, a hundred times the error of a core's idle time.
_SAMPLES_OF_A_PART = 4

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


@dataclass(frozen=True)
class NumericStream:
    """Messages of a topic with rows of m numbers each, in the order of their source timestamps."""

    source_ns: Integers
    received_ns: Integers
    sequence: Integers
    #: float64[n, m]
    values: Floats
    #: Rows of these messages in the topic's stream.
    index: Integers

    def only(self, rows: Booleans) -> NumericStream:
        """Return some of the messages."""
        return NumericStream(
            self.source_ns[rows],
            self.received_ns[rows],
            self.sequence[rows],
            self.values[rows],
            self.index[rows],
        )


@dataclass
class Sighting:
    """An endpoint, and its time in the graph, in ns of the system clock."""

    endpoint: Endpoint
    start_ns: int
    end_ns: int = 0


class Recorded:
    """One session's recording: the contents of its `session.json`, and its traffic."""

    def __init__(self, record: SessionRecord, bag: Bag) -> None:
        self.record = record
        self.bag = bag

    @classmethod
    def open(cls, folder: Path, most_values: int = MOST_VALUES) -> Recorded:
        """Open a session's folder.

        Parameters
        ----------
        folder
            The folder.
        most_values
            Largest number of values of a topic that are decoded.

        Raises
        ------
        FileNotFoundError, ValueError
            If the folder holds no recording of this version.
        """
        return cls(read_session(folder), Bag.open(folder, most_values))

    # -- names and times ----------------------------------------------------------------------

    def used(self, name: str) -> str:
        """Return the student's name for a name of the rubric."""
        return self.record.names.get(name, name)

    def since_start_s(self, t_ns: int) -> float:
        """Convert a time of the system clock to seconds since the session's start."""
        return (t_ns - self.record.started_ns) / 1e9

    def seconds(self, times_ns: Integers) -> Floats:
        """Convert times of the system clock to seconds since the session's start."""
        seconds: Floats = (times_ns - self.record.started_ns) / 1e9
        return seconds

    def step(self, label: str) -> StepRun | None:
        """Return the step with this label, if it was reached."""
        for step in self.record.steps:
            if step.label == label:
                return step
        return None

    def window(self, label: str) -> Span | None:
        """Return the span of an `observe` step, if its window opened; it holds the message that opened it.

        The window of a `publish` step is the time of the step.
        """
        step = self.step(label)
        if step is None:
            return None
        if step.kind == PublishStep.kind:
            return Span(step.started_ns, step.ended_ns)
        window = ObserveResult.of(step)
        if window.opened_ns is None or window.closed_ns is None:
            return None
        return Span(self._begin_ns(step, window.opened_ns), window.closed_ns)

    def _begin_ns(self, step: StepRun, opened_ns: int) -> int:
        """Return when a window began: with the publication of the message that its step awaited, if any."""
        topic = step.parameters.get("first_message_on")
        if topic is None:
            return opened_ns
        stream = self.bag.stream(self.used(topic))
        if not len(stream):
            return opened_ns
        first = int(np.argmin(stream.received_ns))
        if not step.started_ns <= stream.received_ns[first] <= opened_ns:
            return opened_ns
        sent_ns = int(stream.source_ns[first])
        return min(max(sent_ns, self.record.started_ns), opened_ns)

    # -- traffic ------------------------------------------------------------------------------

    @functools.cache  # noqa: B019 - a recording lives as long as its judging
    def stream(self, name: str) -> Stream:
        """Return the messages on a topic of the rubric; only the grader's own if the grader publishes it."""
        topic = self.used(name)
        apart = self.authorship(topic)
        if apart is None:
            return self.bag.stream(topic)
        return apart.own

    @functools.cached_property
    def awaited(self) -> frozenset[str]:
        """Topics and services that the steps expect of the student, under the names that the student used."""
        names: list[str | None] = []
        for step in self.record.steps:
            if step.kind == WaitForStep.kind:
                awaited = WaitForStep.given(step)
                names += [awaited.publisher, awaited.service]
            elif step.kind == CallStep.kind:
                names.append(CallStep.given(step).service)
        return frozenset(self.used(name) for name in names if name is not None)

    def published_on(self, topic: str) -> tuple[Published, ...]:
        """Return the grader's reports of its publications on a topic (of the graph).

        The result is empty unless all publishers of the grader on the topic reported theirs, and if a step expects the
        student to publish there.
        """
        if self.silent_references or topic in self.awaited:
            return ()
        published = []
        reporting = set()
        for entry in self.record.published:
            if entry.topic == topic:
                published.append(entry)
                reporting.add(entry.process)
        silent = []
        for trusted in self.record.trusted:
            if trusted.process not in reporting:
                silent.append(trusted.gid_prefix)
        prefixes = tuple(silent)
        for endpoint in self.endpoints:
            is_publisher = endpoint.topic == topic and endpoint.kind == "publisher"
            if is_publisher and endpoint.gid.startswith(prefixes):
                return ()
        return tuple(published)

    @functools.cached_property
    def silent_references(self) -> tuple[str, ...]:
        """Reference nodes with unknown endpoints, because they reported nothing through the trusted channel."""
        known = {trusted.process for trusted in self.record.trusted}
        silent = []
        for run in self.record.processes:
            if run.role == "reference" and run.name not in known:
                silent.append(run.name)
        return tuple(silent)

    @functools.cache  # noqa: B019
    def authorship(self, topic: str) -> Authorship | None:
        """Separate the grader's messages on a topic (of the graph) from others; None if this is impossible."""
        published = self.published_on(topic)
        return authorship(self.bag, topic, published) if published else None

    @functools.cache  # noqa: B019
    def rows(self, name: str, field: str) -> tuple[Floats | None, ...]:
        """Return the numbers in a field of each message, as `numbers_of` finds them; None if a message has none.

        If messages have another type, which another check judges, the first field with an array of numbers is read
        instead.
        """
        stream = self.stream(name)
        numbers = stream.numbers(field)
        if numbers is not None:
            return tuple(numbers)
        own = str(field_steps(field)[0])
        for message in stream.messages:
            if hasattr(message, own):
                return tuple(map(numbers_of, stream.field(field)))
        return tuple(map(_first_numbers, stream.messages))

    @functools.cache  # noqa: B019
    def numeric(self, name: str, field: str, *, finite: bool = True) -> NumericStream | None:
        """Return the messages with (finite) numbers of the most frequent length in a field, by source time."""
        return numeric_stream(self.stream(name), self.rows(name, field), finite=finite)

    @functools.cache  # noqa: B019
    def texts(self, name: str, field: str) -> tuple[str | None, ...]:
        """Return the text in a field of each message on a topic of the rubric; None if a message has no text there."""
        found = []
        for value in self.stream(name).field(field):
            text = value if isinstance(value, str) else None
            found.append(text)
        return tuple(found)

    @functools.cache  # noqa: B019
    def stamps_ns(self, name: str, field: str = "header.stamp") -> tuple[int | None, ...]:
        """Return the time stamp in a field of each message, in ns; None if a message has no time stamp there."""
        return tuple(map(time_ns, self.stream(name).field(field)))

    def streams(self, roles: Mapping[str, str], field: str) -> dict[str, NumericStream]:
        """Return the numeric streams for an oracle, by role; roles without numbers are left out."""
        found: dict[str, NumericStream] = {}
        for role, topic in roles.items():
            stream = self.numeric(topic, field)
            if stream is not None:
                found[role] = stream
        return found

    # -- graph --------------------------------------------------------------------------------

    def is_trusted(self, gid: str) -> bool:
        """Return whether an endpoint belongs to the grader, by the reports of the grader's processes."""
        return gid.startswith(tuple(t.gid_prefix for t in self.record.trusted))

    @functools.cached_property
    def sightings(self) -> tuple[Sighting, ...]:
        """All endpoints that were ever in the graph, with their times there.

        An endpoint without a known node gets the node of its participant.
        """
        graphs = self.record.graph
        ends_ns = [graph.t_ns for graph in graphs[1:]]
        ends_ns.append(self.record.ended_ns)
        found: dict[tuple[str, str, str], Sighting] = {}
        nodes: dict[str, str] = {}
        for graph, end_ns in zip(graphs, ends_ns, strict=False):
            for endpoint in graph.endpoints:
                key = (endpoint.gid, endpoint.topic, endpoint.kind)
                known = found.setdefault(key, Sighting(endpoint, graph.t_ns))
                known.end_ns = end_ns
                if UNKNOWN_NODE in endpoint.node:
                    continue
                nodes.setdefault(endpoint.gid[:PARTICIPANT_DIGITS], endpoint.node)
                if UNKNOWN_NODE in known.endpoint.node:
                    known.endpoint = endpoint
        for sighting in found.values():
            endpoint = sighting.endpoint
            if UNKNOWN_NODE in endpoint.node:
                node = nodes.get(endpoint.gid[:PARTICIPANT_DIGITS], endpoint.node)
                sighting.endpoint = replace(endpoint, node=node)
        return tuple(found.values())

    @functools.cached_property
    def endpoints(self) -> tuple[Endpoint, ...]:
        """All endpoints of known nodes that were ever in the graph.

        Other endpoints left before their node was known, and may belong to the grader.
        """
        found = []
        for sighting in self.sightings:
            if UNKNOWN_NODE not in sighting.endpoint.node:
                found.append(sighting.endpoint)
        return tuple(found)

    def endpoints_on(
        self, name: str, kind: str, without: Iterable[str] = ()
    ) -> tuple[Endpoint, ...]:
        """Return endpoints on a topic of the rubric.

        Parameters
        ----------
        name
            The topic.
        kind
            "publisher" or "subscription".
        without
            Fully qualified names of nodes that are left out, such as reference nodes. The grader's endpoints are left
            out by their gids, if these are known. Another node can have the name of such a node, and counts.
        """
        topic = self.used(name)
        left_out = set(without)
        our_gids = set()
        if left_out:
            our_gids = {e.gid for e in self.endpoints if self.is_trusted(e.gid)}
        our_nodes = {e.node for e in self.endpoints if e.gid in our_gids}
        found = []
        for endpoint in self.endpoints:
            if endpoint.topic != topic or endpoint.kind != kind:
                continue
            if endpoint.gid in our_gids:
                continue
            if endpoint.node not in left_out or endpoint.node in our_nodes:
                found.append(endpoint)
        return tuple(found)

    @functools.cached_property
    def nodes(self) -> tuple[str, ...]:
        """Fully qualified names of all nodes that were ever in the graph."""
        found: dict[str, None] = {}
        for graph in self.record.graph:
            found.update(dict.fromkeys(graph.nodes))
        return tuple(found)

    def claims_of(self, kind: str, name: str) -> list[Claim]:
        """Return the calls of student's nodes for an endpoint in any namespace, seen by the tap."""
        plain = self.used(name).rsplit("/", 1)[-1]
        found = []
        for claim in self.record.claims:
            called = claim.name.rsplit("/", 1)[-1]
            if claim.kind == kind and called == plain:
                found.append(claim)
        return found

    # -- processes ----------------------------------------------------------------------------

    def processes_of(self, artifact: str) -> tuple[ProcessRun, ...]:
        """Return the processes that ran an artifact under its own name, in order of their start."""
        found = []
        for run in self.record.processes:
            if run.artifact == artifact and run.name == artifact:
                found.append(run)
        return tuple(found)

    def process(self, name: str) -> ProcessRun | None:
        """Return the last process of this name."""
        for run in reversed(self.record.processes):
            if run.name == name:
                return run
        return None

    @property
    def students(self) -> tuple[ProcessRun, ...]:
        """The student's processes, in order of their start."""
        return tuple(run for run in self.record.processes if run.role == "student")

    @functools.cache  # noqa: B019 - see `stream`
    def delays(self, run: ProcessRun) -> tuple[Delay, ...]:
        """Return the possible delays of a process by the machine; from samples if it was not watched."""
        found = []
        if run.disturbed is None:
            for part in _parts(run):
                delay_s = self._sampled_delay_s(run, part)
                found.append(Delay(part.start_ns, part.end_ns, round(delay_s * 1e9)))
            return tuple(found)
        for start_ns, length_ns, delay_ns, stalled_ns in _noted(run):
            end_ns = start_ns + length_ns
            found.append(Delay(start_ns, end_ns, delay_ns, stalled_ns))
        if run.role == "student":
            return self._left_of(run, found)
        return tuple(found)

    def _left_of(self, run: ProcessRun, noted: Sequence[Delay]) -> tuple[Delay, ...]:
        """Return noted delays, with the waits in each part of the session shortened to the time that others had the cores.

        The threads of a program also wait for each other, and its children come and go between two samples. Nobody has
        a core while it stands still: it then counts as idle.
        """
        edges = [sample.t_ns for sample in self.record.machine[::_SAMPLES_OF_A_PART]]
        parts: dict[int, list[Delay]] = {}
        for delay in noted:
            parts.setdefault(bisect.bisect_right(edges, delay.start_ns), []).append(delay)
        left: list[Delay] = []
        for delays in parts.values():
            waited_ns = sum(delay.waited_ns for delay in delays)
            end_ns = max(delay.end_ns for delay in delays)
            most_s = self._others_around_s(run, Span(delays[0].start_ns, end_ns))
            share = min(1.0, most_s * 1e9 / max(1, waited_ns))
            for delay in delays:
                delay_ns = delay.stalled_ns + round(share * delay.waited_ns)
                left.append(replace(delay, delay_ns=delay_ns))
        return tuple(left)

    def _others_around_s(self, run: ProcessRun, span: Span) -> float:
        """Return the time that programs of others had a process's cores around a span, in s.

        The time is an upper bound for each part of the time between the two samples around the span. Without these
        samples it is infinite.
        """
        before, after = self._samples_around(span)
        if before is None or after is None:
            return math.inf
        around = Span(before.t_ns, after.t_ns)
        is_held = _is_held(run, around)
        cores = list(before.idle_ns)
        if is_held:
            cores = [str(run.core)]
        measured = before.idle_ns.keys() & after.idle_ns.keys()
        if not measured >= set(cores):
            return math.inf
        others_s = -self._unseen_s(around)
        for core in cores:
            idle_ns = after.idle_ns[core] - before.idle_ns[core]
            others_s += around.duration_s - idle_ns / 1e9
        for student in self.students:
            # A program without a core of its own yet may have run elsewhere.
            is_there = student.core == run.core and _is_held(student, around)
            if is_there or not is_held:
                others_s -= self.cpu_s(student, around)
        return max(0.0, others_s) + _IDLE_ERROR_S

    def _samples_around(self, span: Span) -> tuple[MachineSample | None, MachineSample | None]:
        """Return the last sample of the machine before a span and the first one after it, if cores were sampled."""
        before = None
        for sample in self.record.machine:
            if sample.idle_ns and sample.t_ns <= span.start_ns:
                before = sample
            elif sample.idle_ns and sample.t_ns >= span.end_ns:
                return before, sample
        return before, None

    @functools.cache  # noqa: B019 - see `stream`
    def _disturbed(self, run: ProcessRun) -> Integers:
        columns: Integers = np.array(_noted(run), dtype=np.int64).reshape(-1, 4).T
        return columns

    @functools.cache  # noqa: B019 - see `stream`
    def machine_delay_s(self, run: ProcessRun, span: Span) -> float:
        """Return the time that the machine may have delayed a process within a span, in s.

        Time that the core spent on unseen processes of the student is not the machine's.
        """
        if run.disturbed is None:
            return self._sampled_delay_s(run, span)
        start_ns, length_ns, delay_ns, stalled_ns = self._disturbed(run)
        first_ns = np.maximum(start_ns, span.start_ns)
        within_ns = np.minimum(start_ns + length_ns, span.end_ns) - first_ns
        most_ns = np.maximum(within_ns, 0)
        delay_s = _sum_s(delay_ns, most_ns)
        if run.role != "student":
            return delay_s
        if not delay_s:
            return 0.0
        stalled_s = _sum_s(stalled_ns, most_ns)
        waited_s = delay_s - stalled_s - self._unseen_s(span)
        most_s = self._others_around_s(run, span)
        return stalled_s + max(0.0, min(waited_s, most_s))

    @functools.cache  # noqa: B019 - see `stream`
    def backlog(self, run: ProcessRun, span: Span, room_s: float = math.inf) -> Backlog:
        """Return the largest possible backlog of a process within a span.

        A process that computed, or waited for its core, all the time would have used the time that it waited.

        Parameters
        ----------
        run
            The process.
        span
            The span.
        room_s
            Time after which its queue is full.
        """
        busy = self.cpu_s(run, span) / max(span.duration_s, 1e-9)
        found = backlog(self.delays(run), span, room_s, busy)
        if room_s == math.inf:
            return found
        missed_s = 0.0
        for part in _parts(run):
            delay_s = self.machine_delay_s(run, part)
            wanted_s = self.cpu_s(run, part) + delay_s
            if wanted_s > _SATURATED * part.duration_s:
                within_s = span.shared_ns(part.start_ns, part.end_ns) / 1e9
                missed_s += within_s * delay_s / wanted_s
        return replace(found, lost_s=max(found.lost_s, missed_s))

    def _sampled_delay_s(self, run: ProcessRun, span: Span) -> float:
        """Return the possible delay of a process that was not watched, in s, from samples twice a second.

        The delay is the sum of the run-queue delay of the process's threads and the time that the host of a virtual
        machine took, but at least the time in which the grader itself stalled. Threads also wait for each other, and
        for other programs of the student; the run-queue delay therefore counts up to the time that others had the core.
        """
        if len(run.usage) < 2:
            return 0.0
        idle_s = max(0.0, span.duration_s - self.cpu_s(run, span))
        delay_s = _run_delay_s(run, span)
        others_s = self._others_s(run, span)
        several_waited = delay_s > idle_s + _AT_ONCE * span.duration_s
        if several_waited and others_s < math.inf:
            # The threads waited for each other too; others caused the share of time that they had the core.
            others_s *= others_s / max(span.duration_s, others_s)
        stolen = [(sample.t_ns, sample.stolen_ns) for sample in self.record.machine]
        possible_s = min(delay_s, others_s) + _grown_s(_columns(stolen), span)
        return min(max(possible_s, self.stalled_s(span)), idle_s)

    def _unseen_s(self, span: Span) -> float:
        """Return the CPU time of unseen student's processes within a span, in s.

        The time is the kernel's count for all student's processes less the time of the known ones; 0 if there is no count.
        """
        if not self._counted.size:
            return 0.0
        return max(0.0, _grown_s(self._counted, span) - self.students_cpu_s(span))

    @functools.cached_property
    def _counted(self) -> Floats:
        """The kernel's count of the CPU time of all student's processes, see `_columns`; empty if there is none."""
        counted = []
        for sample in self.record.machine:
            if sample.students_ns is None:
                return _columns([])
            counted.append((sample.t_ns, sample.students_ns))
        return _columns(counted)

    def _others_s(self, run: ProcessRun, span: Span) -> float:
        """Return the time that programs of others spent on a process's core within a span, in s.

        Before a process is held to one core, the time is the sum over all cores. Without samples it is infinite.
        """
        samples = [sample for sample in self.record.machine if sample.idle_ns]
        if len(samples) < 2:
            return math.inf
        is_held = _is_held(run, span)
        if is_held:
            cores = [str(run.core)]
        else:
            cores = list(samples[0].idle_ns)

        idle_s = 0.0
        for core in cores:
            if any(core not in sample.idle_ns for sample in samples):
                return math.inf
            idle = [(sample.t_ns, sample.idle_ns[core]) for sample in samples]
            idle_s += _grown_s(_columns(idle), span)
        cores_used = (None, run.core) if is_held else ()
        own_s = self._own_s(run, span, cores_used)
        busy_s = len(cores) * span.duration_s - idle_s
        others_s = busy_s - own_s - self._unseen_s(span)
        return max(0.0, others_s) + _IDLE_ERROR_S

    def _own_s(self, run: ProcessRun, span: Span, cores: Sequence[int | None]) -> float:
        """Return the CPU time of a process and of the student's processes on some cores, or on all, in s."""
        own_s = 0.0
        for other in self.record.processes:
            is_own = other.role == "student" or other is run
            was_there = not cores or other.core in cores
            if is_own and was_there:
                own_s += self.cpu_s(other, span)
        return own_s

    @functools.cache  # noqa: B019 - see `stream`
    def cpu_s(self, run: ProcessRun, span: Span) -> float:
        """Return the CPU time that a process took within a span, in s, interpolated between samples."""
        return _grown_s(self._cpu(run), span)

    @functools.cache  # noqa: B019 - see `stream`
    def _cpu(self, run: ProcessRun) -> Floats:
        return _columns([(usage.t_ns, usage.cpu_ns) for usage in run.usage])

    @property
    def _delayed_runs(self) -> Iterator[ProcessRun]:
        """Processes that must not be delayed; the grader's recorder may be late."""
        for run in self.record.processes:
            if run.role in ("student", "reference"):
                yield run

    def delays_s(self, starts_ns: Integers, ends_ns: Integers) -> Floats:
        """Return the machine's delay of the most delayed process in each of many spans, in s.

        Each value is `longest_delay_s` of its span; a delay across an end counts by its part.
        """
        most: Floats = np.zeros(len(starts_ns))
        for run in self._delayed_runs:
            delays = self.delays(run)
            if delays:
                within_ns = delay_before(delays, ends_ns) - delay_before(delays, starts_ns)
                most = np.maximum(most, within_ns / 1e9)
        return most

    def longest_delay_s(self, span: Span) -> float:
        """Return the machine's delay of the most delayed process within a span, in s."""
        longest_s = 0.0
        for run in self._delayed_runs:
            longest_s = max(longest_s, self.machine_delay_s(run, span))
        return longest_s

    def recorder_delay_s(self, span: Span) -> float:
        """Return the machine's delay of the recorder within a span, in s."""
        return sum(self.machine_delay_s(run, span) for run in self.recorders)

    @property
    def recorders(self) -> tuple[ProcessRun, ...]:
        """The grader's processes between the session's traffic and the recording."""
        found = []
        for run in self.record.processes:
            if run.role == "grader" and run.name != LINK:
                found.append(run)
        return tuple(found)

    def students_cpu_s(self, span: Span) -> float:
        """Return the CPU time of the student's processes within a span, in s."""
        return sum(self.cpu_s(run, span) for run in self.students)

    def students_busy(self, span: Span) -> bool:
        """Return whether the student's programs were so busy that a delay need not be the machine's.

        They are busy if they used a large part of a core, or if a crowd of their threads waited for each other.
        """
        waited_s = 0.0
        for run in self.students:
            samples = [(usage.t_ns, usage.run_delay_ns) for usage in run.usage]
            waited_s += _grown_s(_columns(samples), span)
        if waited_s >= _CROWD * span.duration_s:
            return True
        return self.students_cpu_s(span) >= _OWN_DOING * span.duration_s

    @functools.cached_property
    def stalls(self) -> tuple[Delay, ...]:
        """Stalls of the grader itself, seen by samples that came late."""
        times_ns = [sample.t_ns for sample in self.record.machine]
        if len(times_ns) < _FEWEST_SAMPLES:
            return ()
        usual_ns = float(np.median(np.diff(times_ns)))
        found = []
        for start_ns, end_ns in itertools.pairwise(times_ns):
            length_ns = end_ns - start_ns
            if length_ns > _LATE_SAMPLE * usual_ns:
                found.append(Delay(start_ns, end_ns, round(length_ns - usual_ns)))
        return tuple(found)

    def stalled_s(self, span: Span) -> float:
        """Return the time that the grader itself stalled within a span, in s."""
        return sum(delay.delay_ns for delay in clipped(self.stalls, span)) / 1e9

    def output_of(self, artifact: str) -> list[OutputLine]:
        """Return the output of the last process that ran an artifact, without colours."""
        processes = self.processes_of(artifact)
        if not processes:
            return []
        return self.lines_of(processes[-1])

    def lines_of(self, run: ProcessRun) -> list[OutputLine]:
        """Return the output of a process as a terminal shows it, without colours and control characters."""
        return list(self._plain_output(run))

    @functools.cache  # noqa: B019 - see `stream`
    def _plain_output(self, run: ProcessRun) -> tuple[OutputLine, ...]:
        return tuple(plain_output(run.output))


def _sum_s(times_ns: Integers, most_ns: Integers) -> float:
    """Return the sum of some times, each limited, in s."""
    limited_ns = np.minimum(times_ns, most_ns)
    return float(limited_ns.sum()) / 1e9


def _noted(run: ProcessRun) -> list[list[int]]:
    """Return the noted delays of a watched process; earlier versions did not note whether a core stood still."""
    assert run.disturbed is not None
    noted = []
    for delay in run.disturbed:
        complete = [*delay, 0]
        noted.append(complete[:4])
    return noted


def _parts(run: ProcessRun) -> Iterator[Span]:
    """Yield the spans between the samples of a process."""
    for start, end in itertools.pairwise(run.usage):
        yield Span(start.t_ns, end.t_ns)


def _is_held(run: ProcessRun, span: Span) -> bool:
    """Return whether a process was held to its core for all of a span."""
    if run.core is None or run.held_ns is None:
        return False
    return run.held_ns <= span.start_ns


def clock_step_s(record: SessionRecord, span: Span) -> float:
    """Return the change of the system's clock by setting it within a span, in s; 0 if it ran evenly."""
    first_ns = span.start_ns - 1e9
    last_ns = span.end_ns + 1e9
    samples = [sample for sample in record.machine if first_ns <= sample.t_ns <= last_ns]
    for before, after in itertools.pairwise(samples):
        moved_s = (after.clock_offset_ns - before.clock_offset_ns) / 1e9
        passed_s = (after.t_ns - before.t_ns) / 1e9 - moved_s
        if abs(moved_s) > _STEP_S + _SLEW * passed_s:
            return abs(moved_s)
    return 0.0


def _columns(samples: Sequence[tuple[int, int]]) -> Floats:
    """Return samples of a counter as two rows: times in ns, and values in ns."""
    columns: Floats = np.array(samples, dtype=np.float64).reshape(-1, 2).T
    return columns


def _grown_s(columns: Floats, span: Span) -> float:
    """Return the growth of a counter within a span, in s, interpolated between its samples, see `_columns`."""
    if not columns.size:
        return 0.0
    times, values = columns
    before, after = np.interp([span.start_ns, span.end_ns], times, values)
    return float(after - before) / 1e9


def _run_delay_s(run: ProcessRun, span: Span) -> float:
    """Return the greatest possible run-queue delay of a process within a span, in s.

    Between two samples only the sum of the delays is known, and all of it may lie in the part within the span. After
    the last sample of a process that ended by itself, the delay is taken to be the usual one.
    """
    samples = [(usage.t_ns, usage.run_delay_ns) for usage in run.usage]
    if run.usage[-1].t_ns == run.exited_ns:
        # A sample added after the end of the process does not count its delay.
        samples.pop()
    started_ns = samples[0][0]
    if run.started_ns:
        started_ns = min(run.started_ns, started_ns)
    total = 0.0
    for (begin_ns, before), (end_ns, after) in itertools.pairwise([(started_ns, 0), *samples]):
        total += max(0, min(after - before, span.shared_ns(begin_ns, end_ns)))
    last_ns, delayed_ns = samples[-1]
    was_sampled = last_ns > started_ns
    if run.exited_ns is not None and run.ended_by == "itself" and was_sampled:
        unsampled_ns = span.shared_ns(last_ns, run.exited_ns)
        total += delayed_ns * unsampled_ns // (last_ns - started_ns)
    return total / 1e9


def numeric_stream(
    stream: Stream, all_rows: Sequence[Floats | None], *, finite: bool = True
) -> NumericStream | None:
    """Return the messages of a stream with (finite) numbers of the most frequent length, by source time."""
    by_length: dict[int, list[int]] = {}
    for index, row in enumerate(all_rows):
        if row is not None and len(row):
            by_length.setdefault(len(row), []).append(index)
    kept: Integers = np.empty(0, dtype=np.int64)
    values: Floats = np.empty((0, 0))
    # Among equally frequent lengths, the greatest one counts.
    for length in sorted(by_length, reverse=True):
        indices = np.array(by_length[length], dtype=np.int64)
        rows = np.array([all_rows[index] for index in by_length[length]], dtype=np.float64)
        if finite:
            is_finite = np.isfinite(rows).all(axis=1)
            indices = indices[is_finite]
            rows = rows[is_finite]
        if len(indices) > len(kept):
            kept = indices
            values = rows
    if not len(kept):
        return None
    by_time = np.lexsort((stream.sequence[kept], stream.source_ns[kept]))
    order = kept[by_time]
    return NumericStream(
        stream.source_ns[order],
        stream.received_ns[order],
        stream.sequence[order],
        values[by_time],
        order,
    )


def _first_numbers(message: object | None) -> Floats | None:
    """Return the numbers of a message's first array that holds some."""
    if not hasattr(message, "__dict__"):
        return None
    for value in vars(message).values():
        if not isinstance(value, np.ndarray):
            continue
        row = numbers_of(value)
        if row is not None and len(row):
            return row
    return None
