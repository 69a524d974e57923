"""Recordings and submissions as a lab's own checks see them, by `grader.own_checks`.

Public names and their meanings stay as they are within a version of `API_VERSION`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grader.checks import base, endpoints, service, subscriber
from grader.checks.base import Part
from grader.evidence import bounds
from grader.evidence.bounds import Delayed
from grader.evidence.cpu_delay import Backlog, Span, clipped
from grader.evidence.fields import numbers_of
from grader.evidence.flakiness import flaky_end
from grader.evidence.recorded import NumericStream, Recorded, clock_step_s
from grader.evidence.text.printed import (
    PrintedVector,
    Report,
    reports,
    reports_of,
    vector_printed_by,
)
from grader.evidence.text.result_rows import ResultRow, result_rows
from grader.lab.steps import STEPS
from grader.lab.steps.call import CallRecord, CallResult
from grader.recording.session import Endpoint, ProcessRun
from grader.result import Finding, Location
from ros_bag.qos import Qos
from ros_bag.reading import Stream


@dataclass(frozen=True)
class Messages:
    """Messages of one topic in the order of their arrival; all times in s since the session's start.

    Attributes
    ----------
    topic, type : str
        As the student named them; the type is empty if nothing was published.
    sent_s, received_s : float64[n]
        Times of publication, by the publisher's middleware, and of arrival at the grader.
    sequence : int64[n]
        Publication sequence numbers.
    """

    topic: str
    type: str
    sent_s: NDArray[np.float64]
    received_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    _stream: Stream

    def __len__(self) -> int:
        return len(self._stream)

    def field(self, path: str) -> list[Any]:
        """Return a field of each message by its path ("pose.position.x", "data[0]"); None if a message has no such field."""
        return self._stream.field(path)

    def numbers(self, path: str) -> list[NDArray[np.float64] | None]:
        """Return the numbers in a field of each message: one, those of an array, of a point, a time in s; or None."""
        return [numbers_of(value) for value in self.field(path)]


@dataclass(frozen=True)
class Series:
    """Numbers in a field of a topic's messages, in the order of sending.

    Attributes
    ----------
    sent_s, received_s : float64[n]
        Times at which each message was published and received, in s since the session's start.
    sequence : int64[n]
        Publication sequence numbers; the first message of a publisher has 1.
    values : float64[n, m]
        The m numbers of each message.
    """

    sent_s: NDArray[np.float64]
    received_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)

    def only(self, rows: NDArray[np.bool_]) -> Series:
        """Return the messages that a bool[n] selects."""
        return Series(
            self.sent_s[rows], self.received_s[rows], self.sequence[rows], self.values[rows]
        )


@dataclass(frozen=True)
class Line:
    """A line of output, with its time in s since the session's start and its stream, "stdout" or "stderr"."""

    t_s: float
    stream: str
    text: str


@dataclass(frozen=True)
class Run:
    """A process of the session; times in s since the session's start, None for an event that did not happen.

    `role` is "student" or "reference"; `ended_by` "itself", "interrupt", "terminate", "kill" or "limit"; `limit` the
    limit that it hit, if any.
    """

    name: str
    role: str
    artifact: str | None
    started_s: float
    interrupted_s: float | None
    exited_s: float | None
    exit_status: int | None
    ended_by: str
    limit: str | None
    lines: tuple[Line, ...]
    _recorded: ProcessRun = field(repr=False)

    @property
    def output_dropped(self) -> bool:
        """True if it printed more than was kept."""
        return bool(self._recorded.output_dropped_bytes)

    @property
    def went_on(self) -> bool:
        """True if it ran until it was interrupted or killed."""
        run = self._recorded
        if run.exited_ns is None:
            return True
        return run.interrupted_ns is not None or run.ended_by == "kill"

    def flaky_end(self) -> str:
        """Describe an accident at Ctrl-C that correct programs meet too; empty if there was none."""
        return flaky_end(self._recorded)

    def reports(self, patterns: Sequence[str]) -> list[Report]:
        """Return the numbers that the first fitting pattern finds in its output until Ctrl-C."""
        return reports_of(self._recorded, patterns)

    def printed_vector(
        self, labels: Sequence[str], unless: str | None = None
    ) -> PrintedVector | None:
        """Return the last vector that was printed behind a label, as in `Mean: [0.1 0.2]`; None without one.

        In the output after Ctrl-C, tables and lines such as `mean = 0.1` count too.

        Parameters
        ----------
        labels
            Words for the label in the order of the trials, in any case.
        unless
            Pattern in front of the numbers that tells that they are of something else.
        """
        return vector_printed_by(self._recorded, labels, unless)


@dataclass(frozen=True)
class Step:
    """A finished step; times in s since the session's start.

    Attributes
    ----------
    outcome : str
        "done", "timeout", "cancelled" or "failed".
    parameters, result : mapping
        Parameters and results as the recording keeps them.
    given : grader.lab.steps.Step
        The parameters with their types and defaults, e.g. `given.request` of a `call`.
    found : grader.lab.steps.base.StepResult
        The results with their types, e.g. `found.service`; a missing one is None or empty.
    """

    kind: str
    outcome: str
    started_s: float
    ended_s: float
    parameters: Mapping[str, Any]
    result: Mapping[str, Any]
    given: Any
    found: Any


@dataclass(frozen=True)
class Call:
    """A call of a service by the grader; times in s since the session's start.

    Attributes
    ----------
    response : mapping or None
        Fields of the response; None without an answer.
    latency_s : float
        Time from the request to the answer, or to the end of waiting for it.
    delay_s : float
        Longest machine delay of the involved processes.
    """

    started_s: float
    ended_s: float
    response: Mapping[str, Any] | None
    latency_s: float
    delay_s: float


@dataclass(frozen=True)
class Claim:
    """A program's call for an endpoint: a claim of the student's code, no evidence.

    Attributes
    ----------
    qos : Qos or None
        The profile that the program passed; None if it is not known.
    where : tuple of Location
        The source line of the call; empty if it is not in the submission.
    """

    qos: Qos | None
    where: tuple[Location, ...]


class Submission:
    """The files that a student handed in."""

    def __init__(self, inner: base.Context) -> None:
        self._inner = inner

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of all files."""
        return tuple(file.path for file in self._inner.submission.files)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Paths of files and folders that were handed in and left out of the grading, such as "ws/build/"."""
        return tuple(note.partition(": ")[0] for note in self._inner.submission.left_out)

    def text(self, path: str) -> str | None:
        """Return the contents of a file; None if it is missing, is no text, or is too large to be kept."""
        return self._inner.submission.texts.get(path)

    def path_of(self, artifact: str) -> str | None:
        """Return the path of an artifact's file; None if it was not handed in."""
        return self._inner.path_of(artifact)

    def finding(self, check: str) -> Finding | None:
        """Return the finding of an earlier check."""
        return self._inner.findings.get(check)

    def charged(self, check: str | None) -> bool:
        """Tell whether an earlier check has taken points; False for None.

        One mistake is charged once: a mistake that an earlier check has charged costs nothing more.
        """
        return self._inner.charged(check)

    def charge(self, finding: Finding, cause: str | None, by: Iterable[str] = ()) -> Finding:
        """Charge a finding for a mistake of this name, unless another check charges the mistake.

        The dearest check of a mistake charges it; findings of the others come back without their loss. An earlier
        check among `by` charges the consequences of its own loss.
        """
        return self._inner.charge(finding, cause, by)

    def charge_part(self, part: Part, cause: str | None, by: Iterable[str] = ()) -> Part:
        """Charge a part for a mistake of this name, as `charge` does with a finding."""
        return self._inner.charge_part(part, cause, by)


class Context(Submission):
    """A recording and its submission, as a check sees them. Topics have the rubric's names, even if the student's differ."""

    @property
    def _session(self) -> Recorded:
        return self._inner.session

    @property
    def seed(self) -> int:
        """The seed of the session's stimuli."""
        return self._session.record.seed

    @property
    def duration_s(self) -> float:
        """Length of the session in s."""
        return self._session.since_start_s(self._session.record.ended_ns)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Fully qualified names of all nodes that were ever in the graph."""
        return self._session.nodes

    def messages(self, topic: str, window: str | None = None) -> Messages:
        """Return the messages on a topic, or those received within the `observe` step of a label: none if it failed."""
        session = self._session
        stream = session.stream(topic)
        if window is not None:
            span = session.window(window) or Span(0, 0)
            is_begun = stream.received_ns >= span.start_ns
            is_over = stream.received_ns > span.end_ns
            stream = stream.only(is_begun & ~is_over)
        return Messages(
            stream.topic,
            stream.topic_type,
            session.seconds(stream.source_ns),
            session.seconds(stream.received_ns),
            stream.sequence,
            stream,
        )

    def rows(self, topic: str, field: str) -> tuple[NDArray[np.float64] | None, ...]:
        """Return the numbers in a field of each message, in the order of `messages`.

        In messages of a type without this field, the first field that holds an array of numbers
        stands in, because the type is for another check to judge. None for a message without numbers.
        """
        return self._session.rows(topic, field)

    def series(self, topic: str, field: str, *, finite: bool = True) -> Series | None:
        """Return the messages with as many numbers in a field as most have; None if none has any.

        Parameters
        ----------
        topic, field
            As for `rows`.
        finite
            Whether messages with NaN or an infinite number are left out.
        """
        stream = self._session.numeric(topic, field, finite=finite)
        if stream is None:
            return None
        seconds = self._session.seconds
        return Series(
            seconds(stream.source_ns),
            seconds(stream.received_ns),
            stream.sequence,
            stream.values,
        )

    def window(self, label: str) -> tuple[float, float] | None:
        """Return begin and end of an `observe` step in s; None if it was not reached."""
        span = self._session.window(label)
        if span is None:
            return None
        return self.since_start_s(span.start_ns), self.since_start_s(span.end_ns)

    def endpoints(self, topic: str, kind: str = "publisher") -> tuple[Endpoint, ...]:
        """Return the student's endpoints of a kind, "publisher" or "subscription", on a topic."""
        return self._session.endpoints_on(topic, kind, self._inner.reference_nodes)

    def unheard(self, topic: str) -> str:
        """Say why the student's own side cannot receive the messages on a topic; empty if it can."""
        offers = self.endpoints(topic, "publisher")
        requests = self.endpoints(topic, "subscription")
        if not requests:
            return f"Nothing subscribes to {topic}."
        policy = None
        if offers:
            policy = endpoints.clash(requests[0], offers[0].qos)
        if policy is None:
            return ""
        return f"The two sides of {topic} are incompatible in {policy}: none can arrive."

    def used(self, name: str) -> str:
        """Return the student's name for a topic, service or node of the rubric."""
        return self._session.used(name)

    def claim(self, kind: str, name: str) -> Claim | None:
        """Return the student's first call for a "publisher", "subscription" or "service"; None if none was seen."""
        found = endpoints.claim_of(self._inner, kind, name)
        if found is None:
            return None
        return Claim(found.qos, endpoints.claimed_at(found))

    def step(self, label: str) -> Step | None:
        """Return the step of a label; None if it was not reached."""
        run = self._session.step(label)
        if run is None:
            return None
        started_s = self.since_start_s(run.started_ns)
        ended_s = self.since_start_s(run.ended_ns)
        model = STEPS[run.kind]
        return Step(
            run.kind,
            run.outcome,
            started_s,
            ended_s,
            run.parameters,
            run.result,
            given=model.given(run),
            found=model.result.of(run),
        )

    def calls(self, step: str) -> tuple[Call, ...]:
        """Return the calls of a `call` step, in their order; none if it was not reached."""
        run = self._session.step(step)
        if run is None:
            return ()
        return tuple(map(self._call, CallResult.of(run).calls))

    def _call(self, made: CallRecord) -> Call:
        span = Span(made.started_ns, made.ended_ns)
        return Call(
            started_s=self.since_start_s(span.start_ns),
            ended_s=self.since_start_s(span.end_ns),
            response=made.response,
            latency_s=span.duration_s,
            delay_s=bounds.asking_delay(self._session, span, made.held_up_ns).delay_s,
        )

    def unanswered(self, step: str, expected: str, reason: str = "") -> Finding:
        """State that the call of a step had no answer; only the first such call of a session costs points.

        Parameters
        ----------
        reason
            Reason for the lost points; by default, how long the grader waited for the answer.
        """
        run = self._session.step(step)
        return service.silence(self._inner, run, expected, reason or service.problem_of(run))

    def silent_before(self, step: str) -> bool:
        """Tell whether an earlier call had no answer, so that `unanswered` takes no points any more.

        False if the call went to another name than the service of the student has.
        """
        run = self._session.step(step)
        misnamed = service.not_asked(self._inner, run, "service")
        return not misnamed and service.earlier_silence(self._inner, run, "") is not None

    def process(self, name: str) -> Run | None:
        """Return the last process of a name; an artifact's process has the artifact's name by default."""
        run = self._session.process(name)
        return None if run is None else self._run(run)

    def runs(self, artifact: str | None = None) -> tuple[Run, ...]:
        """Return the processes that ran an artifact under its own name, by their start; without one, all processes."""
        found: Sequence[ProcessRun] = self._session.record.processes
        if artifact is not None:
            found = self._session.processes_of(artifact)
        return tuple(map(self._run, found))

    def _run(self, run: ProcessRun) -> Run:
        return _run_of(self._session, run)

    def delay_s(self, process: str, window: str) -> float:
        """Return the machine delay of a process within a step, in s: 0 on an idle machine."""
        session = self._session
        run = session.process(process)
        span = session.window(window)
        step = session.step(window)
        if span is None and step is not None:
            span = Span(step.started_ns, step.ended_ns)
        if run is None or span is None:
            return 0.0
        return session.machine_delay_s(run, span)

    def longest_delay_s(self, start_s: float, end_s: float) -> float:
        """Return the longest machine delay of any process of the session within a span, in s.

        Parameters
        ----------
        start_s, end_s
            Begin and end of the span in s since the session's start.
        """
        return self._session.longest_delay_s(self._span_of(start_s, end_s))

    def machine_delay_s(self, run: Run, start_s: float, end_s: float) -> float:
        """Return the machine delay of a process within a span, in s."""
        return self._session.machine_delay_s(run._recorded, self._span_of(start_s, end_s))

    def life(self, run: Run) -> tuple[float, float]:
        """Return the start of a process and its end, or that of the session if it did not end, in s."""
        if run.exited_s is None:
            return run.started_s, self.duration_s
        return run.started_s, run.exited_s

    def delayed(self, run: Run, start_s: float, end_s: float) -> Delayed:
        """Return the machine delay of a process within a span, with the length of the span."""
        return Delayed(self.machine_delay_s(run, start_s, end_s), end_s - start_s)

    def noted_delays_s(self, run: Run, start_s: float, end_s: float) -> NDArray[np.float64]:
        """Return each delay of a process by the machine within a span, in s; none if only their sum is known."""
        found = []
        if run._recorded.disturbed:
            span = self._span_of(start_s, end_s)
            for delay in clipped(self._session.delays(run._recorded), span):
                found.append(delay.delay_ns / 1e9)
        return np.array(found, dtype=np.float64)

    def backlog(self, run: Run, start_s: float, end_s: float, room_s: float = math.inf) -> Backlog:
        """Return the largest possible backlog of a process within a span.

        Parameters
        ----------
        run
            The process.
        start_s, end_s
            Begin and end of the span in s since the session's start.
        room_s
            Time after which the queue of its subscription is full, in s.
        """
        return self._session.backlog(run._recorded, self._span_of(start_s, end_s), room_s)

    def recorder_delay_s(self, start_s: float, end_s: float) -> float:
        """Return the machine delay of the recorder within a span, in s."""
        return self._session.recorder_delay_s(self._span_of(start_s, end_s))

    def clock_step_s(self, start_s: float, end_s: float) -> float:
        """Return the change of the system's clock by setting it within a span, in s; 0 if it ran evenly."""
        return clock_step_s(self._session.record, self._span_of(start_s, end_s))

    def stalled_s(self, start_s: float, end_s: float) -> float:
        """Return the time of a span without reading of output because the grader itself stalled, in s."""
        return self._session.stalled_s(self._span_of(start_s, end_s))

    def lost_share(self, run: Run, topics: Iterable[str], sent_s: NDArray[np.float64]) -> float:
        """Return the greatest share of messages that a process may have lost because the machine delayed it.

        A process loses no message while the queues of its subscriptions have room.

        Parameters
        ----------
        topics
            Topics of its subscriptions.
        sent_s
            float64[n]: Times of the messages.
        """
        since_start_ns = np.rint(sent_s * 1e9).astype(np.int64)
        times_ns = self._session.record.started_ns + since_start_ns
        return subscriber.lost_share(self._inner, [run._recorded], topics, times_ns)

    def _span_of(self, start_s: float, end_s: float) -> Span:
        zero_ns = self._session.record.started_ns
        start_ns = zero_ns + round(start_s * 1e9)
        end_ns = zero_ns + round(end_s * 1e9)
        return Span(start_ns, end_ns)

    def oracle(self, reference: str) -> Callable[..., Any]:
        """Return an oracle, "file.py:function", as other checks call it: with streams, parameters and seed."""
        return self._inner.oracle(reference)

    def streams(self, roles: Mapping[str, str], field: str) -> dict[str, NumericStream]:
        """Return the streams of an oracle by their roles; a topic without finite numbers is left out.

        Parameters
        ----------
        roles
            Topics by the names that the oracle has for them.
        """
        return self._session.streams(roles, field)

    def since_start_s(self, t_ns: int) -> float:
        """Convert a time of an oracle's streams or of a report to s since the session's start."""
        return self._session.since_start_s(t_ns)

    def reports(self, artifact: str, patterns: Sequence[str]) -> list[Report]:
        """Return the numbers that a program reported until it was interrupted, by the first pattern that finds any.

        A pattern is looked for in each line of the output, or else of the node's log on /rosout. The
        number is in its last group.
        """
        return list(reports(self._session, artifact, patterns))

    def result_rows(
        self, artifact: str, names: Sequence[str], pattern: str
    ) -> dict[str, ResultRow | None]:
        """Return the counts and latencies that a program printed for each of several things.

        Parameters
        ----------
        artifact
            The program.
        names
            Names of the things; a line or a row of a table begins with one.
        pattern
            Regular expression with groups count, mean_ms and max_ms; other readable forms count if no line fits.
        """
        return result_rows(self._session.output_of(artifact), names, pattern)

    def output_location(self, artifact: str) -> Location:
        """Point at the output of an artifact's process."""
        return self._inner.output_of(artifact)

    def in_session(self, name: str) -> Context | None:
        """Return another session of the submission; None if it was not recorded."""
        other = self._inner.sessions.get(name)
        if other is None:
            return None
        return Context(replace(self._inner, recorded=other))

    def location(
        self,
        topic: str | None = None,
        window: str | None = None,
        *,
        span_s: tuple[float, float] | None = None,
    ) -> Location:
        """Point at the place in the recording where the proof of a finding lies.

        Parameters
        ----------
        topic
            A topic or service; the whole session without one.
        window
            Label of an `observe` step.
        span_s
            Begin and end in s since the session's start, instead of a window.
        """
        span = None
        if window is not None:
            span = self._session.window(window)
        where = self._inner.location(topic, span)
        if span_s is None:
            return where
        return replace(where, start_s=span_s[0], end_s=span_s[1])


# Each check asks for the processes, and the output of one can be long.
@functools.lru_cache(maxsize=64)
def _run_of(session: Recorded, run: ProcessRun) -> Run:
    """Return a process of a session for checks."""
    lines = []
    for line in session.lines_of(run):
        lines.append(Line(session.since_start_s(line.t_ns), line.stream, line.text))
    return Run(
        name=run.name,
        role=run.role,
        artifact=run.artifact,
        started_s=session.since_start_s(run.started_ns),
        interrupted_s=_since_or_none(session, run.interrupted_ns),
        exited_s=_since_or_none(session, run.exited_ns),
        exit_status=run.exit_status,
        ended_by=run.ended_by,
        limit=run.limit,
        lines=tuple(lines),
        _recorded=run,
    )


def _since_or_none(session: Recorded, t_ns: int | None) -> float | None:
    if t_ns is None:
        return None
    return session.since_start_s(t_ns)
