"""A lab's own checks: what they are given, how they are called, and what becomes of their mistakes.

What stands here of public names is given to code that others have written (`grader.own_checks`): it stays as it is
within a version of `API_VERSION`, whatever becomes of what lies behind it.
"""

from __future__ import annotations

import inspect
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, TypeAdapter, ValidationError

from grader.checks import base, service, subscriber
from grader.evidence.cpu_delay import Span
from grader.evidence.fields import numbers_of
from grader.evidence.flakiness import flaky_end
from grader.evidence.oracle import describe_failure, load_oracle
from grader.evidence.recorded import NumericStream, Recorded
from grader.evidence.text.printed import PrintedVector, Report, printed_vector, reports
from grader.lab.lab_code import API_VERSION
from grader.recording.bag import Stream
from grader.recording.session import Endpoint, ProcessRun
from grader.result import Finding, Location, Outcome

#: What one call of a lab's own check may compute and how long it may take, and how soon it is ended again if it goes
#: on; judging all of a submission has 30 s and 100 s.
_MOST_CPU_S, _MOST_S, _AGAIN_S = 10.0, 30.0, 1.0
#: What is kept of a text that a lab's own check gives: it may quote what a student's program wrote.
_MOST_TEXT = 1000


@dataclass(frozen=True)
class Messages:
    """Messages of one topic, in the order in which they were received; all times in s since the session's start.

    Attributes
    ----------
    topic, type : str
        As the student named them; the type is empty where nothing was published.
    sent_s, received_s : float64[n]
        When each was published, by its publisher's middleware, and when the grader received it.
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
        """Return a field of each message by its path ("pose.position.x", "data[0]"); None where it has none such."""
        return self._stream.field(path)

    def numbers(self, path: str) -> list[NDArray[np.float64] | None]:
        """Return the numbers in a field of each message: one, those of an array, of a point, a time in s; or None."""
        return [numbers_of(value) for value in self.field(path)]


@dataclass(frozen=True)
class Series:
    """Numbers in a field of a topic's messages, in the order in which the messages were sent.

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
    """A line that a process wrote, when (s since the session's start), and to "stdout" or "stderr"."""

    t_s: float
    stream: str
    text: str


@dataclass(frozen=True)
class Run:
    """A process of the session; times in s since its start, None for what has not happened.

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
        """Whether it printed more than was kept."""
        return bool(self._recorded.output_dropped_bytes)

    @property
    def went_on(self) -> bool:
        """Whether it ran until it was interrupted or killed."""
        run = self._recorded
        if run.exited_ns is None:
            return True
        return run.interrupted_ns is not None or run.ended_by == "kill"

    def flaky_end(self) -> str:
        """Describe an accident at Ctrl-C that correct programs meet too; empty if there was none."""
        return flaky_end(self._recorded)

    def printed_vector(
        self, labels: Sequence[str], unless: str | None = None
    ) -> PrintedVector | None:
        """Return the last vector that was printed behind a label, as in `Mean: [0.1 0.2]`; None without one.

        In the output after Ctrl-C, tables and lines such as `mean = 0.1` count too.

        Parameters
        ----------
        labels
            Words for the label in the order in which they are tried, in any case.
        unless
            Pattern in front of the numbers that tells that they are of something else.
        """
        run = self._recorded
        return printed_vector(run.output, labels, run.interrupted_ns, unless)


@dataclass(frozen=True)
class Step:
    """A step as it went: "done", "timeout", "cancelled" or "failed", with its parameters and what it found."""

    kind: str
    outcome: str
    started_s: float
    ended_s: float
    parameters: Mapping[str, Any]
    result: Mapping[str, Any]


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
        Longest time for which the machine kept one of the involved processes from a core.
    """

    started_s: float
    ended_s: float
    response: Mapping[str, Any] | None
    latency_s: float
    delay_s: float


class Submission:
    """The files that a student handed in."""

    def __init__(self, inner: base.Context) -> None:
        self._inner = inner

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of all files."""
        return tuple(file.path for file in self._inner.submission.files)

    def text(self, path: str) -> str | None:
        """Return the contents of a file; None where it is none, is no text, or is too large to be kept."""
        return self._inner.submission.texts.get(path)

    def path_of(self, artifact: str) -> str | None:
        """Return where the file of an artifact lies; None where it was not handed in."""
        return self._inner.path_of(artifact)

    def finding(self, check: str) -> Finding | None:
        """Return what a check before this one found."""
        return self._inner.findings.get(check)

    def charged(self, check: str | None) -> bool:
        """Tell whether an earlier check has taken points; False for None.

        One mistake is charged once: what an earlier check has charged costs nothing more.
        """
        return self._inner.charged(check)


class Context(Submission):
    """What a check of a recording may look at; names of topics are the rubric's, also where a student has others."""

    @property
    def _session(self) -> Recorded:
        return self._inner.session

    @property
    def seed(self) -> int:
        """The seed of the session's stimuli."""
        return self._session.record.seed

    @property
    def duration_s(self) -> float:
        """How long the session took."""
        return self._session.since_start_s(self._session.record.ended_ns)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Fully qualified names of all nodes that were ever in the graph."""
        return self._session.nodes

    def messages(self, topic: str, window: str | None = None) -> Messages:
        """Return the messages on a topic, or those received within the `observe` step of a label: none if it failed."""
        stream, span = self._session.stream(topic), self._span(window)
        if span is not None:
            stream = stream.only(
                (stream.received_ns >= span.start_ns) & (stream.received_ns <= span.end_ns)
            )
        sent, received = (
            self._session.seconds(stream.source_ns),
            self._session.seconds(stream.received_ns),
        )
        return Messages(stream.topic, stream.topic_type, sent, received, stream.sequence, stream)

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
        return self._series(stream) if stream is not None else None

    def _series(self, stream: NumericStream) -> Series:
        seconds = self._session.seconds
        return Series(
            seconds(stream.source_ns),
            seconds(stream.received_ns),
            stream.sequence,
            stream.values,
        )

    def window(self, label: str) -> tuple[float, float] | None:
        """Return begin and end of an `observe` step in s; None where it was not reached."""
        span, since = self._session.window(label), self._session.since_start_s
        return None if span is None else (since(span.start_ns), since(span.end_ns))

    def _span(self, window: str | None) -> Span | None:
        return None if window is None else self._session.window(window) or Span(0, 0)

    def endpoints(self, topic: str, kind: str = "publisher") -> tuple[Endpoint, ...]:
        """Return the student's "publisher"s or "subscription"s on a topic: node, type, qos."""
        return self._session.endpoints_on(topic, kind, self._inner.reference_nodes)

    def step(self, label: str) -> Step | None:
        """Return the step of a label; None where it was not reached."""
        run = self._session.step(label)
        if run is None:
            return None
        began_s, ended_s = (self._session.since_start_s(t) for t in (run.started_ns, run.ended_ns))
        return Step(run.kind, run.outcome, began_s, ended_s, run.parameters, run.result)

    def calls(self, step: str) -> tuple[Call, ...]:
        """Return the calls of a `call` step, in their order; none if it was not reached."""
        run = self._session.step(step)
        since = self._session.since_start_s
        calls = []
        for made in run.result.get("calls", []) if run is not None else []:
            span = Span(int(made["started_ns"]), int(made["ended_ns"]))
            delay_s = service.asking_delay_s(self._inner, span, made)
            started_s, ended_s = since(span.start_ns), since(span.end_ns)
            calls.append(Call(started_s, ended_s, made["response"], span.duration_s, delay_s))
        return tuple(calls)

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
        """Return the last process of a name, which is the artifact's where the rubric gives no other."""
        run = self._session.process(name)
        return self._run(run) if run is not None else None

    def runs(self, artifact: str | None = None) -> tuple[Run, ...]:
        """Return the processes that ran an artifact under its own name, by their start; without one, all processes."""
        found: Sequence[ProcessRun] = self._session.record.processes
        if artifact is not None:
            found = self._session.processes_of(artifact)
        return tuple(map(self._run, found))

    def _run(self, run: ProcessRun) -> Run:
        since = self._session.since_start_s
        lines = []
        for line in self._session.lines_of(run):
            lines.append(Line(since(line.t_ns), line.stream, line.text))
        return Run(
            name=run.name,
            role=run.role,
            artifact=run.artifact,
            started_s=since(run.started_ns),
            interrupted_s=self._since_or_none(run.interrupted_ns),
            exited_s=self._since_or_none(run.exited_ns),
            exit_status=run.exit_status,
            ended_by=run.ended_by,
            limit=run.limit,
            lines=tuple(lines),
            _recorded=run,
        )

    def _since_or_none(self, t_ns: int | None) -> float | None:
        return self._session.since_start_s(t_ns) if t_ns is not None else None

    def delay_s(self, process: str, window: str) -> float:
        """Return for how long within a step the machine kept a process from a core: 0 on an idle one."""
        run, step, span = (
            self._session.process(process),
            self._session.step(window),
            self._session.window(window),
        )
        span = Span(step.started_ns, step.ended_ns) if span is None and step is not None else span
        return (
            self._session.machine_delay_s(run, span)
            if run is not None and span is not None
            else 0.0
        )

    def longest_delay_s(self, start_s: float, end_s: float) -> float:
        """Return the longest time in a span for which the machine kept one of the session's processes from a core.

        Parameters
        ----------
        start_s, end_s
            Begin and end of the span in s since the session's start.
        """
        return self._session.longest_delay_s(self._span_of(start_s, end_s))

    def machine_delay_s(self, run: Run, start_s: float, end_s: float) -> float:
        """Return the time within a span for which the machine may have kept a process from a core, in s."""
        return self._session.machine_delay_s(run._recorded, self._span_of(start_s, end_s))

    def stalled_s(self, start_s: float, end_s: float) -> float:
        """Return the time within a span in which the grader itself stalled and read no output, in s."""
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
        times_ns = self._session.record.started_ns + np.rint(sent_s * 1e9).astype(np.int64)
        return subscriber.lost_share(self._inner, [run._recorded], topics, times_ns)

    def _span_of(self, start_s: float, end_s: float) -> Span:
        zero_ns = self._session.record.started_ns
        return Span(zero_ns + round(start_s * 1e9), zero_ns + round(end_s * 1e9))

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

    def output_location(self, artifact: str) -> Location:
        """Point at the output of an artifact's process."""
        return self._inner.output_of(artifact)

    def in_session(self, name: str) -> Context | None:
        """Return another session of the submission; None if it was not recorded."""
        other = self._inner.sessions.get(name)
        return Context(replace(self._inner, recorded=other)) if other is not None else None

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
        span = self._session.window(window) if window is not None else None
        where = self._inner.location(topic, span)
        if span_s is None:
            return where
        return replace(where, start_s=span_s[0], end_s=span_s[1])


#: Outcomes of a finding that are without credit.
_WITHOUT = (Outcome.FAILED, Outcome.INCONCLUSIVE, Outcome.NOT_REACHED)


@dataclass(frozen=True)
class Traits:
    """Properties of a check that `check` states."""

    commands: tuple[str, ...] = ()


_Function = TypeVar("_Function", bound=Callable[..., Finding])
#: Attribute of a function that holds its traits.
_TRAITS = "__check_traits__"


def check(*, commands: tuple[str, ...] = ()) -> Callable[[_Function], _Function]:
    """Return a decorator that states properties of a check; a check without it has none of them.

    Parameters
    ----------
    commands
        Commands by which students see the fault themselves while their program runs. `{topic}`
        stands for the parameter of this name, and `{step}` for a command that does the same as the
        step with the label in this parameter.

    Examples
    --------
    >>> @check(commands=("ros2 topic echo {topic}",))
    ... def rises(context: Context, p: Parameters) -> Finding: ...
    """

    def state(function: _Function) -> _Function:
        setattr(function, _TRAITS, Traits(commands))
        return function

    return state


def traits_of(lab_folder: Path, check: str) -> Traits:
    """Return the traits of a lab's own check; none if its file cannot be loaded."""
    with suppress(Exception, SystemExit, _TooLong), _bounded():
        found = getattr(load_own(lab_folder, check), _TRAITS, Traits())
        if isinstance(found, Traits):
            return found
    return Traits()


class _TooLong(BaseException):
    """Not caught by a check that catches exceptions."""


def find_own(check: str, context: base.Context, p: Any) -> Finding:
    """Call a lab's own check, "file.py:function"; what goes wrong in it is an error, which costs no points."""
    try:
        with _bounded():
            function = load_own(context.lab_folder, check)
            seen = Context(context) if context.recorded is not None else Submission(context)
            return _checked(function(seen, *built(function, p)))
    except (Exception, SystemExit, _TooLong) as problem:
        reason = f"The lab's own check failed: {describe_failure(problem, check)}"
        return Finding(Outcome.ERROR, Decimal(0), reason=reason[:_MOST_TEXT], retry=False)


def load_own(lab_folder: Path, check: str) -> Callable[..., Any]:
    """Load a lab's own check; raises ValueError if it is none, or for another version of what it is given."""
    function = load_oracle(lab_folder, check)
    wanted = vars(sys.modules[function.__module__]).get("API_VERSION", API_VERSION)
    if wanted != API_VERSION:
        raise ValueError(
            f"it is written for version {wanted} of grader.own_checks, and this is version {API_VERSION}"
        )
    return function


def built(function: Callable[..., Any], p: BaseModel) -> list[Any]:
    """Return the parameters of a lab's own check, of the class that its second argument names; none if it has none.

    Raises ValueError if the class refuses them.
    """
    wanted = list(inspect.signature(function).parameters.values())[1:]
    # It is a text where the file imports annotations from the future; the class stands in the same file.
    beside = vars(sys.modules[function.__module__])
    kinds = [
        beside[w.annotation.strip("'\"")] if isinstance(w.annotation, str) else w.annotation
        for w in wanted
    ]
    try:
        given = p.model_dump(exclude_none=True, by_alias=True)
        return [TypeAdapter(kind).validate_python(given) for kind in kinds]
    except ValidationError as error:
        wrong = (
            ": ".join([*map(str, e["loc"]), e["msg"].removeprefix("Value error, ")])
            for e in error.errors()
        )
        raise ValueError("; ".join(wrong)) from error


def _checked(finding: Any) -> Finding:
    """Return a finding as its makers give it: credit that fits its outcome, plain numbers, and texts that can be shown.

    Whoever makes one by hand could give more points than there are, or what no result can be written of.
    """
    if not isinstance(finding, Finding) or not all(
        isinstance(location, Location) for location in finding.where
    ):
        raise TypeError(
            "a Finding is expected, as passed() and failed() give it, and where they lie by location()"
        )
    credit = finding.credit
    fits = {Outcome.PASSED: credit == 1, Outcome.PARTIAL: 0 < credit < 1}
    if not isinstance(credit, Decimal) or not fits.get(
        finding.outcome, credit == 0 and finding.outcome in _WITHOUT
    ):
        raise ValueError(
            "its credit does not fit its outcome; use passed(), failed(), graded() or inconclusive()"
        )
    texts: dict[str, Any] = {
        name: str(getattr(finding, name))[:_MOST_TEXT]
        for name in ("expected", "measured", "reason", "hint")
    }
    return Finding(
        finding.outcome,
        credit,
        **texts,
        where=tuple(map(_plain, finding.where)),
        notes=tuple(str(note)[:_MOST_TEXT] for note in finding.notes),
        retry=bool(finding.retry),
        settled=_checked(finding.settled) if finding.settled is not None else None,
        unexplained=bool(finding.unexplained),
    )


def _plain(location: Location) -> Location:
    """Return a location without numbers of numpy's, of which no JSON is made."""
    kinds = {"line": int, "start_s": float, "end_s": float}
    given = {name: getattr(location, name) for name in kinds}
    return replace(
        location, **{name: kinds[name](value) for name, value in given.items() if value is not None}
    )


@contextmanager
def _bounded() -> Iterator[None]:
    """Raise `_TooLong` within the block when it has computed, or waited, for too long; not on Windows."""
    if not hasattr(signal, "setitimer"):
        yield
        return
    # Nothing could end it in another thread, where nothing is judged but nobody's submission, to be prepared.
    if threading.current_thread() is not threading.main_thread():
        raise _TooLong("it is called in a main thread only")
    computing = _timer(
        signal.ITIMER_VIRTUAL, signal.SIGVTALRM, _MOST_CPU_S, f"{_MOST_CPU_S:g} s of CPU time"
    )
    with computing, _timer(signal.ITIMER_REAL, signal.SIGALRM, _MOST_S, f"{_MOST_S:g} s"):
        yield


@contextmanager
def _timer(timer: int, number: int, most_s: float, words: str) -> Iterator[None]:
    def stop(number: int, frame: FrameType | None) -> None:
        raise _TooLong(f"it took more than {words}")

    before = signal.signal(number, stop)
    # Again: the first may come within an `except` for all that there is.
    signal.setitimer(timer, most_s, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(timer, 0)
        signal.signal(number, before)
