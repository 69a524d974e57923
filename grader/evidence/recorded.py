"""A recorded session as the checks see it: numbers and facts, no judgement.

Names are those of the rubric; where the student used another, it is followed. Floats are seconds since the start.
"""

from __future__ import annotations

import bisect
import functools
import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grader.evidence.authorship import Authorship, authorship
from grader.evidence.cpu_delay import Backlog, Delay, Span, backlog
from grader.evidence.crash.tracebacks import without_colours
from grader.evidence.fields import numbers_of, time_ns
from grader.lab.steps.call import CallStep
from grader.lab.steps.observe import ObserveResult
from grader.lab.steps.wait_for import WaitForStep
from grader.recording.bag import Bag, Stream
from grader.recording.definitions import field_steps
from grader.recording.elements import MOST_VALUES
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

#: How far the clock may move against the monotonic one; what is more than slewing means that it was set.
_STEP_S, _SLEW = 0.002, 0.001

#: Who used, or waited for, so much of a core had no time left.
_SATURATED = 0.9
#: The kernel tells a core's idle time in hundredths of a second; both ends of a span may be off by one.
_IDLE_ERROR_S = 0.02
#: A thread by itself waits for no longer than its program does not compute; what is more than that by this share of a
#: span, which is more than what samples leave open, are waits of several at once.
_AT_ONCE = 0.25

#: The machine is sampled at even times: what comes later than this many intervals after the last was delayed, if there
#: are samples enough to tell how far apart they are to be.
_LATE_SAMPLE, _FEWEST_SAMPLES = 1.5, 4
#: Share of a time in which the student's own programs may have used a core, if the machine is to blame for a delay.
_OWN_DOING = 0.5
#: Average number of the student's waiting threads that makes a crowd. A starting node has one or two, an executor with
#: four busy threads has four.
_CROWD = 8.0
#: Samples of the machine in one part of a session: 2 s, of which the error of a core's idle time is a hundredth.
_SAMPLES_OF_A_PART = 4

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


@dataclass(frozen=True)
class NumericStream:
    """Messages of a topic that carry rows of numbers of one length, in the order of their source timestamps."""

    source_ns: Integers
    received_ns: Integers
    sequence: Integers
    values: Floats  # (n, m)
    #: Which messages of the topic's stream these are.
    index: Integers

    def only(self, rows: NDArray[np.bool_]) -> NumericStream:
        """Return some of the messages."""
        return NumericStream(*(column[rows] for column in vars(self).values()))


@dataclass
class Sighting:
    """An endpoint, and when it was in the graph, in ns of the system clock."""

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
        """Open a session's folder; raises FileNotFoundError or ValueError if it is no recording of this version.

        Of each topic, so many values are decoded at most.
        """
        return cls(read_session(folder), Bag.open(folder, most_values))

    # -- names and times ----------------------------------------------------------------------

    def used(self, name: str) -> str:
        """Return the name that the student used for one of the rubric's."""
        return self.record.names.get(name, name)

    def since_start_s(self, t_ns: int) -> float:
        """Convert a time of the system clock to seconds since the session's start."""
        return (t_ns - self.record.started_ns) / 1e9

    def seconds(self, times_ns: Integers) -> Floats:
        """Convert times of the system clock to seconds since the session's start."""
        seconds: Floats = (times_ns - self.record.started_ns) / 1e9
        return seconds

    def step(self, label: str) -> StepRun | None:
        """Return the step of this label, if it was reached."""
        return next((s for s in self.record.steps if s.label == label), None)

    def window(self, label: str) -> Span | None:
        """Return the span of an `observe` step, if its window opened."""
        step = self.step(label)
        if step is None:
            return None
        window = ObserveResult.of(step)
        if window.opened_ns is None or window.closed_ns is None:
            return None
        return Span(window.opened_ns, window.closed_ns)

    # -- traffic ------------------------------------------------------------------------------

    @functools.cache  # noqa: B019 - a recording lives as long as its judging
    def stream(self, name: str) -> Stream:
        """Return all messages on a topic of the rubric's; only the grader's own where the grader is to publish."""
        topic = self.used(name)
        apart = self.authorship(topic)
        return self.bag.stream(topic) if apart is None else apart.own

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
        """Return what the grader reported that it published on a topic (of the graph).

        Nothing, unless all of its publishers there reported it, and no step expects the student to publish there.
        """
        published = tuple(entry for entry in self.record.published if entry.topic == topic)
        reporting = {entry.process for entry in published}
        prefixes = tuple(t.gid_prefix for t in self.record.trusted if t.process not in reporting)
        publishers = [e for e in self.endpoints if e.topic == topic and e.kind == "publisher"]
        silent = any(publisher.gid.startswith(prefixes) for publisher in publishers)
        return () if silent or self.silent_references or topic in self.awaited else published

    @functools.cached_property
    def silent_references(self) -> tuple[str, ...]:
        """Reference nodes whose endpoints are not known, since they reported nothing through the trusted channel."""
        known = {t.process for t in self.record.trusted}
        return tuple(
            p.name for p in self.record.processes if p.role == "reference" and p.name not in known
        )

    @functools.cache  # noqa: B019
    def authorship(self, topic: str) -> Authorship | None:
        """Separate the grader's own messages on a topic (of the graph) from others; None where this cannot be done."""
        published = self.published_on(topic)
        return authorship(self.bag, topic, published) if published else None

    @functools.cache  # noqa: B019
    def rows(self, name: str, field: str) -> tuple[Floats | None, ...]:
        """Return the numbers in a field of each message, as `numbers_of` finds them; None where a message has none.

        In a wrong type, which is charged elsewhere, the first field that holds an array of numbers stands in.
        """
        stream, own = self.stream(name), field_steps(field)[0]
        if any(hasattr(message, str(own)) for message in stream.messages):
            return tuple(numbers_of(value) for value in stream.field(field))
        return tuple(_first_numbers(message) for message in stream.messages)

    @functools.cache  # noqa: B019
    def numeric(self, name: str, field: str, *, finite: bool = True) -> NumericStream | None:
        """Return the messages whose field holds (finite) numbers of the most frequent length, by source time."""
        return numeric_stream(self.stream(name), self.rows(name, field), finite=finite)

    @functools.cache  # noqa: B019
    def texts(self, name: str, field: str) -> tuple[str | None, ...]:
        """Return the text in a field of each message on a topic of the rubric's; None where a message has none."""
        return tuple(
            value if isinstance(value, str) else None for value in self.stream(name).field(field)
        )

    @functools.cache  # noqa: B019
    def stamps_ns(self, name: str, field: str = "header.stamp") -> tuple[int | None, ...]:
        """Return the time stamp in a field of each message, in ns; None where a message has none."""
        return tuple(time_ns(value) for value in self.stream(name).field(field))

    def streams(self, roles: Mapping[str, str], field: str) -> dict[str, NumericStream]:
        """Return the numeric streams for an oracle, by role; roles without numbers are left out."""
        found = {role: self.numeric(topic, field) for role, topic in roles.items()}
        return {role: stream for role, stream in found.items() if stream is not None}

    # -- graph --------------------------------------------------------------------------------

    def is_trusted(self, gid: str) -> bool:
        """Whether an endpoint is one of the grader's own, by what its processes reported themselves."""
        return gid.startswith(tuple(t.gid_prefix for t in self.record.trusted))

    @functools.cached_property
    def sightings(self) -> tuple[Sighting, ...]:
        """All endpoints that were ever in the graph, as first seen complete, and when they were there.

        One whose node never became known belongs to the node of its participant.
        """
        graphs = self.record.graph
        ends_ns = [*(graph.t_ns for graph in graphs[1:]), self.record.ended_ns]
        found: dict[tuple[str, str, str], Sighting] = {}
        nodes: dict[str, str] = {}
        for graph, end_ns in zip(graphs, ends_ns, strict=False):
            for endpoint in graph.endpoints:
                known = found.setdefault(
                    (endpoint.gid, endpoint.topic, endpoint.kind), Sighting(endpoint, graph.t_ns)
                )
                known.end_ns = end_ns
                if UNKNOWN_NODE not in endpoint.node:
                    nodes.setdefault(endpoint.gid[:PARTICIPANT_DIGITS], endpoint.node)
                    known.endpoint = (
                        endpoint if UNKNOWN_NODE in known.endpoint.node else known.endpoint
                    )
        for sighting in found.values():
            endpoint = sighting.endpoint
            if UNKNOWN_NODE in endpoint.node:
                node = nodes.get(endpoint.gid[:PARTICIPANT_DIGITS], endpoint.node)
                sighting.endpoint = replace(endpoint, node=node)
        return tuple(found.values())

    @functools.cached_property
    def endpoints(self) -> tuple[Endpoint, ...]:
        """All endpoints that were ever in the graph, by gid.

        One whose node is not known is left out: it left before anybody could tell whose it was, and may have been ours.
        """
        return tuple(s.endpoint for s in self.sightings if UNKNOWN_NODE not in s.endpoint.node)

    def endpoints_on(
        self, name: str, kind: str, without: Iterable[str] = ()
    ) -> tuple[Endpoint, ...]:
        """Return the endpoints of a kind ("publisher", "subscription") on a topic of the rubric's.

        Those of nodes (fully qualified) that are to be left out, e.g. reference nodes, do not count. Where the grader's
        are known by their gids, these count by no name, which others can give them, and another node of it counts.
        """
        topic, left_out = self.used(name), set(without)
        ours = {e.gid: e.node for e in self.endpoints if left_out and self.is_trusted(e.gid)}
        fitting = (e for e in self.endpoints if e.topic == topic and e.kind == kind)
        return tuple(
            e
            for e in fitting
            if e.gid not in ours and (e.node not in left_out or e.node in ours.values())
        )

    @functools.cached_property
    def nodes(self) -> tuple[str, ...]:
        """Fully qualified names of all nodes that were ever in the graph."""
        return tuple(dict.fromkeys(node for graph in self.record.graph for node in graph.nodes))

    def claims_of(self, kind: str, name: str) -> list[Claim]:
        """Return the calls by which student's nodes asked for an endpoint, in whatever namespace, by the tap."""
        plain = self.used(name).rsplit("/", 1)[-1]
        return [
            c for c in self.record.claims if c.kind == kind and c.name.rsplit("/", 1)[-1] == plain
        ]

    # -- processes ----------------------------------------------------------------------------

    def processes_of(self, artifact: str) -> tuple[ProcessRun, ...]:
        """Return the processes that ran an artifact under its own name, in order of their start."""
        return tuple(
            p for p in self.record.processes if p.artifact == artifact and p.name == artifact
        )

    def process(self, name: str) -> ProcessRun | None:
        """Return the last process of this name."""
        return next((p for p in reversed(self.record.processes) if p.name == name), None)

    @property
    def students(self) -> tuple[ProcessRun, ...]:
        """The student's processes, in order of their start."""
        return tuple(run for run in self.record.processes if run.role == "student")

    @functools.cache  # noqa: B019 - see `stream`
    def delays(self, run: ProcessRun) -> tuple[Delay, ...]:
        """Return when the machine may have delayed a process; of one not watched, by samples only."""
        if run.disturbed is not None:
            noted = tuple(
                Delay(start_ns, start_ns + length_ns, delay)
                for start_ns, length_ns, delay in run.disturbed
            )
            if run.role == "student":
                return self._left_of(run, noted)
            return noted
        parts = (Span(*part) for part in itertools.pairwise([usage.t_ns for usage in run.usage]))
        return tuple(
            Delay(p.start_ns, p.end_ns, round(self._sampled_delay_s(run, p) * 1e9)) for p in parts
        )

    def _left_of(self, run: ProcessRun, noted: Sequence[Delay]) -> tuple[Delay, ...]:
        """Return noted delays, shortened to what others can have had of the cores in each part of the session.

        The threads of a program also wait for each other, and its children come and go between two samples.
        """
        edges = [sample.t_ns for sample in self.record.machine[::_SAMPLES_OF_A_PART]]
        parts: dict[int, list[Delay]] = {}
        for delay in noted:
            parts.setdefault(bisect.bisect_right(edges, delay.start_ns), []).append(delay)
        left: list[Delay] = []
        for delays in parts.values():
            noted_ns, end_ns = 0, 0
            for delay in delays:
                noted_ns += delay.delay_ns
                end_ns = max(end_ns, delay.end_ns)
            most_s = self._others_around_s(run, Span(delays[0].start_ns, end_ns))
            share = min(1.0, most_s * 1e9 / max(1, noted_ns))
            for delay in delays:
                left.append(replace(delay, delay_ns=round(share * delay.delay_ns)))
        return tuple(left)

    def _others_around_s(self, run: ProcessRun, span: Span) -> float:
        """Return for how long others than the student's programs had a process's cores around a span, in s.

        It is an upper bound for each part of the time between the two samples around the span; infinite without these.
        """
        before, after = self._samples_around(span)
        if before is None or after is None:
            return math.inf
        around = Span(before.t_ns, after.t_ns)
        is_held = _is_held(run, around)
        cores = [str(run.core)] if is_held else list(before.idle_ns)
        if not before.idle_ns.keys() & after.idle_ns.keys() >= set(cores):
            return math.inf
        others_s = -self._unseen_s(around)
        for core in cores:
            others_s += around.duration_s - (after.idle_ns[core] - before.idle_ns[core]) / 1e9
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
        columns: Integers = np.array(run.disturbed, dtype=np.int64).reshape(-1, 3).T
        return columns

    def machine_delay_s(self, run: ProcessRun, span: Span) -> float:
        """Return for how long within a span the machine may have delayed a process, in s.

        Processes of the student's that came and went unseen had the core too: that was not the machine.
        """
        if run.disturbed is None:
            return self._sampled_delay_s(run, span)
        start_ns, length_ns, delay_ns = self._disturbed(run)
        within_ns = np.minimum(start_ns + length_ns, span.end_ns) - np.maximum(
            start_ns, span.start_ns
        )
        delay_s = float(np.minimum(delay_ns, np.maximum(within_ns, 0)).sum()) / 1e9
        if run.role != "student":
            return delay_s
        return max(0.0, min(delay_s - self._unseen_s(span), self._others_around_s(run, span)))

    def backlog(self, run: ProcessRun, span: Span, room_s: float = float("inf")) -> Backlog:
        """Return what may have waited for a process within a span, with so much room in its queue.

        Who computed, or waited for its core, all the time would have done more with the time that it waited.
        """
        found = backlog(
            self.delays(run), span, room_s, self.cpu_s(run, span) / max(span.duration_s, 1e-9)
        )
        missed_s = 0.0
        for part in (
            Span(*part) for part in itertools.pairwise([usage.t_ns for usage in run.usage])
        ):
            within_s = span.shared_ns(part.start_ns, part.end_ns) / 1e9
            cpu_s, delay_s = self.cpu_s(run, part), self.machine_delay_s(run, part)
            if cpu_s + delay_s > _SATURATED * part.duration_s:
                missed_s += within_s * delay_s / (cpu_s + delay_s)
        return (
            replace(found, lost_s=max(found.lost_s, missed_s)) if room_s < float("inf") else found
        )

    def _sampled_delay_s(self, run: ProcessRun, span: Span) -> float:
        """Return the same of a process that was not watched, in s, from samples twice a second.

        It is the run-queue delay of its threads and the time that a virtual machine's host took; or where that is more,
        the time in which the grader itself stalled. Threads also wait for each other, and for other programs of the
        student's; so it is at most the time for which somebody else was on the core.
        """
        if len(run.usage) < 2:
            return 0.0
        idle_s = max(0.0, span.duration_s - self.cpu_s(run, span))
        delay_s, others_s = _run_delay_s(run, span), self._others_s(run, span)
        if delay_s > idle_s + _AT_ONCE * span.duration_s and others_s < float("inf"):
            # Several waited at once, for each other too: of that others have the share in which they had the core.
            others_s *= others_s / max(span.duration_s, others_s)
        stolen_s = _grown_s(
            [(sample.t_ns, sample.stolen_ns) for sample in self.record.machine], span
        )
        return min(max(min(delay_s, others_s) + stolen_s, self.stalled_s(span)), idle_s)

    def _unseen_s(self, span: Span) -> float:
        """Return the CPU time that those of the student's processes took within a span whom nobody saw or waited for.

        It is what the kernel counts of all together, and no process is known to have used; 0 where it does not count.
        """
        counted = [
            (s.t_ns, s.students_ns) for s in self.record.machine if s.students_ns is not None
        ]
        if len(counted) != len(self.record.machine):
            return 0.0
        return max(0.0, _grown_s(counted, span) - self.students_cpu_s(span))

    def _others_s(self, run: ProcessRun, span: Span) -> float:
        """Return for how long within a span neither nothing nor a student's program was on a process's core, in s.

        Before it is held to one, that is the sum over all cores. Where that is not known, there is no bound.
        """
        samples = [sample for sample in self.record.machine if sample.idle_ns]
        held = _is_held(run, span)
        cores = [str(run.core)] if held else list(samples[0].idle_ns) if samples else []
        if len(samples) < 2 or any(
            core not in sample.idle_ns for core in cores for sample in samples
        ):
            return float("inf")
        idle_s = sum(
            _grown_s([(sample.t_ns, sample.idle_ns[core]) for sample in samples], span)
            for core in cores
        )
        students = [r for r in self.record.processes if r.role == "student" or r is run]
        own_s = sum(self.cpu_s(r, span) for r in students if not held or r.core in (None, run.core))
        return (
            max(0.0, len(cores) * span.duration_s - idle_s - own_s - self._unseen_s(span))
            + _IDLE_ERROR_S
        )

    def cpu_s(self, run: ProcessRun, span: Span) -> float:
        """Return the CPU time that a process took within a span, in s, interpolated between samples."""
        return _grown_s([(usage.t_ns, usage.cpu_ns) for usage in run.usage], span)

    def delays_s(self, starts_ns: Integers, ends_ns: Integers) -> Floats:
        """Return for how long the machine delayed that process which it delayed most, in each of many spans, in s.

        Each is what `longest_delay_s` gives for its span; where a delay reaches over an end, its part.
        """
        most: Floats = np.zeros(len(starts_ns))
        for run in (run for run in self.record.processes if run.role in ("student", "reference")):
            delays = self.delays(run)
            if delays:
                edges = np.array(
                    [edge for d in delays for edge in ((d.start_ns, 0), (d.end_ns, d.delay_ns))]
                ).T
                before, after = (
                    np.interp(t, edges[0], np.cumsum(edges[1])) for t in (starts_ns, ends_ns)
                )
                most = np.maximum(most, (after - before) / 1e9)
        return most

    def longest_delay_s(self, span: Span) -> float:
        """Return for how long within a span the machine delayed that process which it delayed most, in s.

        The grader's own recorder is left out: it may be late.
        """
        runs = (run for run in self.record.processes if run.role in ("student", "reference"))
        return max((self.machine_delay_s(run, span) for run in runs), default=0.0)

    def recorder_delay_s(self, span: Span) -> float:
        """Return for how long within a span the machine delayed the recorder, in s."""
        return sum(self.machine_delay_s(run, span) for run in self.recorders)

    @property
    def recorders(self) -> tuple[ProcessRun, ...]:
        """Return the grader's own processes on the way of the session's traffic into the recording."""
        graders = [run for run in self.record.processes if run.role == "grader"]
        return tuple(run for run in graders if run.name != LINK)

    def students_cpu_s(self, span: Span) -> float:
        """Return the CPU time that the student's processes took within a span, in s."""
        return sum(self.cpu_s(run, span) for run in self.record.processes if run.role == "student")

    def students_busy(self, span: Span) -> bool:
        """Whether the student's own programs used so much of a core that a delay need not be the machine's.

        The same holds if so many of their threads waited at a time that each waited for the others.
        """
        waited_s = 0.0
        for run in self.students:
            waited_s += _grown_s([(usage.t_ns, usage.run_delay_ns) for usage in run.usage], span)
        if waited_s >= _CROWD * span.duration_s:
            return True
        return self.students_cpu_s(span) >= _OWN_DOING * span.duration_s

    @functools.cached_property
    def stalls(self) -> tuple[Delay, ...]:
        """When the grader itself stalled, by samples that came late."""
        times = [s.t_ns for s in self.record.machine]
        if len(times) < _FEWEST_SAMPLES:
            return ()
        usual_ns = float(np.median(np.diff(times)))
        late = [(a, b) for a, b in itertools.pairwise(times) if b - a > _LATE_SAMPLE * usual_ns]
        return tuple(Delay(a, b, round(b - a - usual_ns)) for a, b in late)

    def stalled_s(self, span: Span) -> float:
        """Return for how long within a span the grader itself stalled, in s."""
        return sum(min(s.delay_ns, span.shared_ns(s.start_ns, s.end_ns)) for s in self.stalls) / 1e9

    def output_of(self, artifact: str) -> list[OutputLine]:
        """Return the output of the last process that ran an artifact, without colours."""
        processes = self.processes_of(artifact)
        return self.lines_of(processes[-1]) if processes else []

    def lines_of(self, run: ProcessRun) -> list[OutputLine]:
        """Return the output of a process, without colours."""
        return [
            replace(o, text=without_colours(o.text)) if "\x1b" in o.text else o for o in run.output
        ]


def _is_held(run: ProcessRun, span: Span) -> bool:
    """Whether a process was held to its core for all of a span."""
    if run.core is None or run.held_ns is None:
        return False
    return run.held_ns <= span.start_ns


def clock_step_s(record: SessionRecord, span: Span) -> float:
    """Return by how much the system's clock was set within a span, in s; 0 where it ran on evenly."""
    samples = [s for s in record.machine if span.start_ns - 1e9 <= s.t_ns <= span.end_ns + 1e9]
    for before, after in itertools.pairwise(samples):
        moved_s = (after.clock_offset_ns - before.clock_offset_ns) / 1e9
        passed_s = (after.t_ns - before.t_ns) / 1e9 - moved_s
        if abs(moved_s) > _STEP_S + _SLEW * passed_s:
            return abs(moved_s)
    return 0.0


def _grown_s(samples: Sequence[tuple[int, int]], span: Span) -> float:
    """Return by how much a counter in ns grew within a span, in s, interpolated between its samples (time, value)."""
    if not samples:
        return 0.0
    times, values = np.array(samples, dtype=np.float64).T
    before, after = np.interp([span.start_ns, span.end_ns], times, values)
    return float(after - before) / 1e9


def _run_delay_s(run: ProcessRun, span: Span) -> float:
    """Return the greatest run-queue delay that a process may have had within a span, in s.

    Between two samples only the sum is known: all of it may lie in the part that belongs to the span. After the last
    sample of a process that ended by itself, the delay is taken to have been as usual.
    """
    samples = [(u.t_ns, u.run_delay_ns) for u in run.usage]
    if (
        run.usage[-1].t_ns == run.exited_ns
    ):  # added when it had ended, and could not be asked any more
        samples.pop()
    started_ns = min(run.started_ns, samples[0][0]) if run.started_ns else samples[0][0]
    total = 0.0
    for (begin_ns, before), (end_ns, after) in itertools.pairwise([(started_ns, 0), *samples]):
        total += max(0, min(after - before, span.shared_ns(begin_ns, end_ns)))
    last_ns, delayed_ns = samples[-1]
    if run.exited_ns is not None and run.ended_by == "itself" and last_ns > started_ns:
        total += delayed_ns * span.shared_ns(last_ns, run.exited_ns) // (last_ns - started_ns)
    return total / 1e9


def numeric_stream(
    stream: Stream, all_rows: Sequence[Floats | None], *, finite: bool = True
) -> NumericStream | None:
    """Return the messages of a stream whose rows hold (finite) numbers of the most frequent length, by source time."""
    rows = {i: row for i, row in enumerate(all_rows) if row is not None and len(row)}
    if finite:
        rows = {i: row for i, row in rows.items() if np.isfinite(row).all()}
    lengths = Counter(map(len, rows.values()))
    if not lengths:
        return None
    length = max(lengths, key=lambda n: (lengths[n], n))
    kept = [i for i, row in rows.items() if len(row) == length]
    order = sorted(kept, key=lambda i: (int(stream.source_ns[i]), int(stream.sequence[i])))
    values = np.array([rows[i] for i in order], dtype=np.float64)
    times = (stream.source_ns[order], stream.received_ns[order], stream.sequence[order])
    return NumericStream(*times, values, np.array(order, dtype=np.int64))


def _first_numbers(message: object | None) -> Floats | None:
    for value in vars(message).values() if hasattr(message, "__dict__") else ():
        row = numbers_of(value) if isinstance(value, np.ndarray) else None
        if row is not None and len(row):
            return row
    return None
