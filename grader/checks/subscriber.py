"""Checks of a subscribing node: its subscriptions, reports on messages and final statistics."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import Field

from grader.checks.base import (
    CREDIT_LEVELS,
    Context,
    Part,
    apart,
    cpu_delay_doubt,
    failed,
    graded,
    inconclusive,
    of_parts,
    passed,
    quantise,
    unclear,
    unexplained,
)
from grader.checks.endpoints import (
    OfEndpoint,
    OfferedProfile,
    QosWanted,
    claim_of,
    claimed_at,
    clash,
    qos_as_wanted,
    student_endpoints,
    unheard,
)
from grader.evidence.cpu_delay import Span
from grader.evidence.flakiness import flaky_end
from grader.evidence.recorded import Integers, NumericStream
from grader.evidence.text.printed import PrintedVector, Report, printed_vector, reports
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern, Patterns, Share
from grader.lab.steps.publish import PublishResult, PublishStep
from grader.recording.session import Endpoint, OutputLine, ProcessRun, StepRun
from grader.result import Finding, Outcome


class WantedTopic(Parameters):
    """A topic to which the node subscribes."""

    topic: ref.RosName
    type: ref.MessageType


class TopicsSubscribed(OfEndpoint):
    """A node subscribes to topics, with compatible types and QoS. It needs all topics, so the worst one decides."""

    artifact: ref.Artifact
    topics: tuple[WantedTopic, ...] = Field(min_length=1)
    offered: OfferedProfile = OfferedProfile()
    incompatible_costs: Share = Field(
        0.6, description="Share of the credit that a profile which gets nothing costs."
    )
    reliability: ref.Reliability | None = Field(
        None, description="What the lab lets them request; another one is only noted."
    )


def topics_subscribed(context: Context, p: TopicsSubscribed) -> Finding:
    """Judge the subscriptions from discovery."""
    expected = ", ".join(f"{wanted.type} from {wanted.topic}" for wanted in p.topics)
    endpoints = {}
    nodes = []
    for wanted in p.topics:
        found = student_endpoints(context, wanted.topic, "subscription")
        endpoints[wanted] = found
        nodes += [endpoint.node for endpoint in found]
    if not nodes:
        fallback = "The node subscribed to none of the topics, nor to any of a similar name."
        return unexplained(failed(expected, "no subscription in the graph", fallback))
    parts = [_judge_subscription(context, p, wanted, endpoints[wanted]) for wanted in endpoints]
    least = min(part.share for part in parts)
    parts = [replace(part, share=least) for part in parts]
    finding = of_parts(expected, parts, costs=p.node_faults(nodes), where=(context.location(),))
    return replace(finding, cut_off=any(unheard(context, wanted.topic) for wanted in p.topics))


def _judge_subscription(
    context: Context, p: TopicsSubscribed, wanted: WantedTopic, endpoints: Sequence[Endpoint]
) -> Part:
    if not endpoints:
        reason = f"There is no subscription on {wanted.topic}, nor on a similar name."
        return Part(1 - p.other_name_costs, f"nothing on {wanted.topic}", reason)
    used = context.session.used(wanted.topic)
    endpoint = _fitting(endpoints, wanted.type)
    qos = endpoint.qos
    costs = p.faults("topic", (wanted.topic, wanted.type), (used, endpoint.type), [endpoint.node])
    policy = clash(endpoint, p.offered) or unheard(context, wanted.topic)
    if policy is not None:
        arrives = "so no message would arrive from the lab's publisher."
        reason = f"On {used} the two sides are incompatible in {policy}, {arrives}"
        costs.append((p.incompatible_costs, reason))
    notes = []
    if _is_weaker(p, endpoints):
        best_effort = f"The subscription on {used} requests BEST_EFFORT"
        notes.append(f"{best_effort}; with RELIABLE a lost message would be sent again.")
    return Part(
        1 - max((cost for cost, _ in costs), default=0.0),
        f"{endpoint.type} from {used} ({qos.reliability}, {qos.durability})",
        " ".join(reason for _, reason in costs),
        where=claimed_at(claim_of(context, "subscription", wanted.topic)),
        notes=tuple(notes),
    )


def _fitting(endpoints: Sequence[Endpoint], wanted_type: str) -> Endpoint:
    """Return the first endpoint of the wanted type, or else the first one."""
    for endpoint in endpoints:
        if endpoint.type == wanted_type:
            return endpoint
    return endpoints[0]


def _is_weaker(p: TopicsSubscribed, endpoints: Sequence[Endpoint]) -> bool:
    """Tell whether a subscription requests best effort where the lab has reliable ones."""
    if p.reliability != "reliable":
        return False
    return any(endpoint.qos.reliability == "best_effort" for endpoint in endpoints)


class RequestedQos(QosWanted):
    """A subscription requests a QoS profile. History and depth come from the source and only advise."""


def requested_qos(context: Context, p: RequestedQos) -> Finding:
    """Judge reliability and durability from discovery; history and depth only advise."""
    return qos_as_wanted(context, p, "subscription", "requests")


class Streams(Parameters):
    """Base of checks that compare an artifact's reports with an oracle over recorded topics."""

    artifact: ref.Artifact
    streams: Mapping[str, ref.Topic] = Field(description="Role that the oracle knows -> topic.")
    field: ref.FieldPath
    oracle: ref.Loadable = Field(description="file.py:function beside the rubric.")
    parameters: Mapping[str, Any] = Field(
        default_factory=dict, description="Passed on to the oracle."
    )

    def answer(
        self,
        context: Context,
        streams: Mapping[str, NumericStream],
        other: Mapping[str, Any] | None = None,
    ) -> Any:
        """Return the oracle's answer over some streams, with the check's parameters and others."""
        parameters = {**self.parameters, **(other or {})}
        return context.oracle(self.oracle)(streams, parameters, context.session.record.seed)

    def recorded(self, context: Context) -> dict[str, NumericStream] | None:
        """Return the streams by role, or None if one of them was not recorded."""
        streams = context.session.streams(self.streams, self.field)
        return streams if len(streams) == len(self.streams) else None

    def longest(self, context: Context) -> Integers:
        """Return the source timestamps of the recorded stream with the most messages."""
        streams = context.session.streams(self.streams, self.field).values()
        return max((stream.source_ns for stream in streams), key=len)


_NO_STIMULUS = "Commands and states were not recorded, so there is nothing to compare with."


class Alternative(Parameters):
    """A known way to get other numbers, and how much credit it leaves."""

    parameters: Mapping[str, Any]
    meaning: str
    credit: float = Field(0.0, ge=0, le=1)
    charged_by: tuple[ref.EarlierCheckId, ...] = Field(
        (), description="Where one of these checks took points, none are lost here."
    )

    def left(self, context: Context) -> float:
        """Return the credit that it leaves: all if another check has charged it."""
        return 1.0 if self._is_charged(context) else self.credit

    def explains(self, context: Context, finding: Finding, least: float = 0.0) -> Finding:
        """State the credit of numbers that match this mistake, and name it.

        A note names it only if no other check has charged it. The share of right numbers is the
        least credit.
        """
        meant = f"Your numbers match {self.meaning}."
        notes = finding.notes
        if self.credit >= 1 and not self._is_charged(context):
            notes = (*notes, meant)
        return graded(
            max(self.left(context), least),
            finding.expected,
            finding.measured,
            f"{finding.reason} {meant}".strip(),
            where=finding.where,
            notes=notes,
        )

    def _is_charged(self, context: Context) -> bool:
        return any(map(context.charged, self.charged_by))


class ReportShare(Parameters):
    """Share of messages with a report, among those that an oracle counts as reportable."""

    oracle: ref.Loadable = Field(description="file.py:function beside the rubric.")
    full_from: Share = 0.9
    costs: Share = Field(
        0.25, description="Share of the credit that a node loses which reports for next to none."
    )


class ReportedSeries(Streams):
    """Numbers that a node reports agree with an oracle's value on each span of time, and come for each message."""

    pattern: Patterns
    share: ReportShare | None = None
    tolerance: float = Field(
        gt=0, description="Absolute; 1 % of the value, and what rounding makes, are allowed too."
    )
    settle_s: float = Field(0.05, description="Reports this close to a span's ends do not count.")
    alternatives: tuple[Alternative, ...] = ()
    end_charged_by: ref.CheckId | None = Field(
        None,
        description="Check that charges a node that ends early; then only half of the spans must be reached.",
    )


@dataclass(frozen=True)
class _Plateau:
    """A span of the oracle with its value, and the node's reports within it."""

    span: Span
    right: float
    reports: tuple[Report, ...]

    @property
    def value(self) -> float | None:
        """The median of the reports; None without any."""
        if not self.reports:
            return None
        return float(np.median([report.value for report in self.reports]))

    def is_right(self, p: ReportedSeries) -> bool:
        """Tell whether the value is right, up to the rounding of the printed numbers."""
        if self.value is None:
            return False
        roundings = [report.rounding for report in self.reports if report.rounding]
        rounding = min(roundings, default=0.0)
        slack = max(p.tolerance, 0.01 * abs(self.right), rounding * 1.01)
        return abs(self.value - self.right) <= slack

    def has_value_of(self, earlier: Sequence[_Plateau], p: ReportedSeries) -> bool:
        """Tell whether the value would be right on one of some earlier plateaus."""
        return any(replace(self, right=each.right).is_right(p) for each in earlier)


def _plateaus(
    context: Context,
    p: ReportedSeries,
    heard: Sequence[Report],
    other: Mapping[str, Any] | None = None,
) -> list[_Plateau]:
    """Return the oracle's spans with the reports in each; none if the stimulus was not recorded."""
    streams = p.recorded(context)
    if streams is None:
        return []
    settle_ns = int(p.settle_s * 1e9)
    found = []
    for each in p.answer(context, streams, other):
        span = Span(each["start_ns"] + settle_ns, each["end_ns"] - settle_ns)
        inside = [report for report in heard if span.start_ns <= report.t_ns <= span.end_ns]
        found.append(_Plateau(span, float(each["value"]), tuple(inside)))
    return found


@dataclass(frozen=True)
class _Series:
    """All plateaus of the oracle, in order of time, and whether the reports on each are right."""

    plateaus: Sequence[_Plateau]
    fits: Sequence[bool]

    @property
    def count(self) -> int:
        """Number of plateaus."""
        return len(self.plateaus)

    @property
    def right(self) -> int:
        """Number of plateaus with right reports."""
        return sum(self.fits)

    @property
    def reached(self) -> int:
        """Number of plateaus up to the last one with a report."""
        numbers = [number for number, each in enumerate(self.plateaus, 1) if each.reports]
        return max(numbers, default=0)

    @property
    def unreported(self) -> int:
        """Number of plateaus without a report before the last right one."""
        last_right = max((number for number, fit in enumerate(self.fits, 1) if fit), default=0)
        return sum(not plateau.reports for plateau in self.plateaus[:last_right])

    def behind(self, p: ReportedSeries) -> list[_Plateau]:
        """Return the wrong plateaus that have the value of an earlier one."""
        found = []
        for number, plateau in enumerate(self.plateaus):
            if not self.fits[number] and plateau.has_value_of(self.plateaus[:number], p):
                found.append(plateau)
        return found


@dataclass(frozen=True)
class _ReportCount:
    """Share of messages with a report, and the words about it."""

    share: float
    #: Greatest share as far as the machine delays tell.
    best: float
    measured: str
    reason: str
    doubt: str


def reported_series(context: Context, p: ReportedSeries) -> Finding:
    """Judge each span by the median of its reports, less the cost of messages without a report."""
    finding = _right_values(context, p)
    if p.share is None or finding.outcome not in (Outcome.PASSED, Outcome.PARTIAL):
        return finding
    count = _report_share(context, p, p.share)
    if count.share >= 1.0:
        return finding
    return graded(
        _credit_left(finding, p.share, count.share),
        finding.expected,
        f"{finding.measured}; {count.measured}",
        f"{finding.reason} {count.reason}".strip(),
        where=finding.where,
        notes=finding.notes,
        best=_credit_left(finding, p.share, count.best),
        doubt=count.doubt,
    )


def _credit_left(finding: Finding, p: ReportShare, share: float) -> float:
    """Return the credit of a finding, less the cost of messages without a report."""
    unreported = 1 - quantise(min(1.0, share))
    return float(finding.credit) * (1 - p.costs * unreported)


def _right_values(context: Context, p: ReportedSeries) -> Finding:
    """Judge the share of plateaus with right reports."""
    heard = reports(context.session, p.artifact, p.pattern)
    plateaus = _plateaus(context, p, heard)
    count = len(plateaus)
    expected = f"the right value in each of {count} phases of constant commands and states, ± {p.tolerance:g} or 1%"
    if not plateaus:
        return unclear(expected, "no stimulus recorded", _NO_STIMULUS)
    if not heard:
        return _no_report(context, p, expected)
    series = _Series(plateaus, [plateau.is_right(p) for plateau in plateaus])
    where = (context.output_of(p.artifact), context.location(next(iter(p.streams.values()))))
    measured = f"right in {series.right} of {count} phases ({len(heard)} reports)"
    if series.right == count:
        return passed(expected, measured, where=where)
    example = _wrong(context, plateaus[series.fits.index(False)])
    wrong = failed(expected, measured, example, where=where)
    mistake = _mistake(context, p, heard, count)
    if mistake is not None:
        return mistake.explains(context, wrong, series.right / count)
    return _judge_plateaus(context, p, series, wrong)


def _no_report(context: Context, p: ReportedSeries, expected: str) -> Finding:
    """State that the node printed no report."""
    printed = [line.text for line in context.session.output_of(p.artifact)]
    others = ""
    if printed:
        others = f"; it printed {len(printed)} others, the last of which is {printed[-1][:100]!r}"
    reason = f"The node printed no tracking error in the requested form, neither to its output nor to its log{others}."
    return unexplained(failed(expected, "no report", reason))


def _mistake(
    context: Context, p: ReportedSeries, heard: Sequence[Report], count: int
) -> Alternative | None:
    """Return the first known mistake that matches all reports, of at least half of the plateaus."""
    for other in p.alternatives:
        plateaus = _plateaus(context, p, heard, other.parameters)
        alike = [plateau.is_right(p) for plateau in plateaus if plateau.reports]
        if all(alike) and 2 * len(alike) >= count:
            return other
    return None


def _judge_plateaus(
    context: Context, p: ReportedSeries, series: _Series, wrong: Finding
) -> Finding:
    """Grade the share of right plateaus, with the texts of a finding about the wrong ones.

    The share of reports charges the plateaus without a report before the last right one.
    """
    unreported = series.unreported
    notes = []
    if p.end_charged_by is not None and _ended_early(context, p, series):
        phase = f"phase {series.reached + 1} of {series.count}"
        notes.append(f"The node ended in {phase}, which costs points in {p.end_charged_by}.")
        unreported += min(series.count - series.reached, series.count // 2)
    judged = max(series.right, series.count - unreported)
    silent = series.plateaus[series.reached :]
    kept, doubt = _kept_behind(context, p, [*series.behind(p), *silent])
    return graded(
        series.right / judged,
        wrong.expected,
        wrong.measured,
        wrong.reason,
        where=wrong.where,
        notes=notes,
        best=min(1.0, (series.right + kept) / judged),
        doubt=doubt,
    )


def _ended_early(context: Context, p: ReportedSeries, series: _Series) -> bool:
    """Tell whether the node ended by itself before the last plateau."""
    return series.reached < series.count and _went_on(context, p.artifact) is None


#: Longest stall of the grader, in seconds, without a report that is read on the next plateau.
_READ_LATE_S = 0.3


def _kept_behind(
    context: Context, p: ReportedSeries, behind: Sequence[_Plateau]
) -> tuple[float, str]:
    """Return the number of plateaus that the machine may have spoiled, and a doubt about them.

    It may have spoiled each given plateau if the node had no core for half of it, and any plateau
    if the grader stalled and read the printed reports too late.
    """
    run = _went_on(context, p.artifact)
    if run is None:
        return 0.0, ""
    session = context.session
    times = [stream.source_ns for stream in session.streams(p.streams, p.field).values()]
    first_ns = min(int(each[0]) for each in times)
    last_ns = max(int(each[-1]) for each in times)
    span = Span(first_ns, last_ns)
    doubt = cpu_delay_doubt(session.machine_delay_s(run, span), span.duration_s)
    stalled = session.stalled_s(span) > _READ_LATE_S
    if stalled and run.limit is None and not run.output_dropped_bytes:
        return float("inf"), doubt
    spoiled = 0
    for plateau in behind:
        delay_s = session.machine_delay_s(run, plateau.span)
        spoiled += delay_s >= plateau.span.duration_s / 2
    return float(spoiled), doubt


def _wrong(context: Context, plateau: _Plateau) -> str:
    """Compare the reported value of a plateau with the right one."""
    begin_s = context.session.since_start_s(plateau.span.start_ns)
    value = plateau.value
    if value is None:
        return f"From {begin_s:.1f} s on there is no report during a whole phase of constant commands and states."
    shown = apart(value, plateau.right, places=4)
    wanted = apart(plateau.right, value, places=4)
    return f"At {begin_s:.1f} s it reports {shown}; right is {wanted}."


def _went_on(context: Context, artifact: str) -> ProcessRun | None:
    """Return the artifact's last process, unless it ended by itself and so waited for nothing."""
    runs = context.session.processes_of(artifact)
    if not runs:
        return None
    run = runs[-1]
    was_asked = run.interrupted_ns is not None or run.ended_by == "kill"
    return run if run.exited_ns is None or was_asked else None


def _lost_to_machine(context: Context, p: Streams) -> tuple[float, str]:
    """Return the share of messages that a node may have lost to machine delays, and a doubt.

    It loses nothing while its queue has room, or after its end.
    """
    run = _went_on(context, p.artifact)
    if run is None:
        return 0.0, ""
    times_ns = p.longest(context)
    span = Span(int(times_ns[0]), int(times_ns[-1]))
    delay_s = context.session.machine_delay_s(run, span)
    lost = lost_share(context, [run], p.streams.values(), times_ns)
    return lost, cpu_delay_doubt(delay_s, max(span.duration_s, 1e-9))


def lost_share(
    context: Context, runs: Iterable[ProcessRun], topics: Iterable[str], times_ns: Integers
) -> float:
    """Return the greatest share of messages that one of some processes may have lost.

    A process loses nothing while the queues of its subscriptions have room.

    Parameters
    ----------
    times_ns
        int64[n]: Source timestamps of the messages.
    """
    span = Span(int(times_ns.min()), int(times_ns.max()))
    length_s = max(span.duration_s, 1e-9)
    room = min(_queue_depth(context, topic) for topic in topics) - 1
    room_s = max(0, room) * length_s / len(times_ns)
    shares = [context.session.backlog(run, span, room_s).lost_s / length_s for run in runs]
    return max(shares, default=0.0)


def _queue_depth(context: Context, topic: str) -> int:
    """Return the queue depth that the node gave for a subscription; 1 if it is not known."""
    claim = claim_of(context, "subscription", topic)
    if claim is None or claim.qos is None:
        return 1
    return claim.qos.depth


class Shorter(Parameters):
    """Another session with fewer messages, which must lead to printed numbers too."""

    session: ref.SessionId
    least: int = Field(description="Messages from which there must be numbers.")
    most: int = Field(description="With so many messages it would be no shorter run.")
    credit: float = Field(
        0.5, ge=0, le=1, description="Credit of a node that prints nothing there."
    )


class ReportedStatistics(Streams):
    """A vector printed behind a label agrees with an oracle's bounds."""

    label: str
    synonyms: tuple[str, ...] = Field(
        (), description="Other words for the label, tried in this order after it."
    )
    unless: Pattern | None = Field(
        None, description="Found before the numbers, it tells that they are of another."
    )
    key: str = Field(description="Key in the oracle's answer.")
    length: int
    tolerance: float = Field(
        0.001, description="Absolute; 1 % of the value, and what rounding makes, are allowed too."
    )
    alternatives: tuple[Alternative, ...] = ()
    report_pattern: Patterns = Field(
        (), description="The node's report on each message, to see whether it lost any."
    )
    shorter: Shorter | None = None
    full_from: Share = Field(
        0.5,
        description="Share of the messages from which numbers over those alone that the node reports earn all.",
    )


def reported_statistics(context: Context, p: ReportedStatistics) -> Finding:
    """Judge a printed vector, element by element; known mistakes are named."""
    expected = f"{p.length} numbers behind '{p.label}:' at Ctrl-C, agreeing with the recording"
    streams = p.recorded(context)
    if streams is None:
        return unclear(expected, "no stimulus recorded", _NO_STIMULUS)
    runs = context.session.processes_of(p.artifact)
    run = runs[-1] if runs else None
    stopped_ns = run.interrupted_ns if run is not None else None
    printed = _printed(p, context.session.output_of(p.artifact), stopped_ns)
    if printed is None:
        return _nothing_printed(p, run, expected)
    finding = _judge_vector(context, p, streams, printed)
    if finding.outcome is Outcome.PASSED and p.shorter is not None:
        reason = _silent_when_shorter(context, p, p.shorter)
        share = p.shorter.credit if reason else 1.0
        return graded(share, finding.expected, finding.measured, reason, notes=finding.notes)
    return finding


def _printed(
    p: ReportedStatistics, output: Sequence[OutputLine], stopped_ns: int | None
) -> PrintedVector | None:
    return printed_vector(output, (p.label, *p.synonyms), stopped_ns, p.unless)


def _nothing_printed(p: ReportedStatistics, run: ProcessRun | None, expected: str) -> Finding:
    """State that no vector was printed."""
    flaky = flaky_end(run) if run is not None else None
    if flaky:
        return unclear(expected, "nothing", flaky)
    reason = f"Nothing of the form '{p.label}: [...]' was printed after Ctrl-C."
    hint = (
        f"Catch KeyboardInterrupt around rclpy.spin(node), and print '{p.label}: [...]' after it."
    )
    return unexplained(failed(expected, "nothing", reason, hint=hint))


#: Share of messages lost to the machine from which the printed numbers may be of the others.
_LOST_SHARE = 0.03


@dataclass(frozen=True)
class _Vector:
    """A printed vector beside the right one, with the words about both."""

    printed: PrintedVector
    #: Share of its elements that are right.
    share: float
    right_text: str
    expected: str
    measured: str
    notes: tuple[str, ...]

    def graded(self, share: float, reason: str, best: float, doubt: str) -> Finding:
        """State a share of credit."""
        return graded(
            share, self.expected, self.measured, reason, notes=self.notes, best=best, doubt=doubt
        )


def _judge_vector(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    printed: PrintedVector,
) -> Finding:
    """Judge the elements of a printed vector over all messages, or over the reported ones."""
    vector = _vector(context, p, streams, printed)
    if vector.share >= 1:
        return passed(vector.expected, vector.measured, notes=vector.notes)
    if len(printed.values) != p.length:
        reason = f"{len(printed.values)} numbers are printed, not one for each of {p.length}. Expected: {vector.right_text}."
        return failed(vector.expected, vector.measured, reason)
    heard, comparable = _heard_of_some(context, p, streams)
    fits = bool(heard) and _agreement(context, p, streams, {"reports": heard}, printed) >= 1
    of_all = len(heard) / comparable / p.full_from
    # After a loss, a right history reaches back further and may look like one that is too long.
    if fits and of_all >= 1:
        note = f"{p.label}: judged over the {len(heard)} messages that the node reported; it lost the others."
        return passed(vector.expected, vector.measured, notes=[*vector.notes, note])
    for other in p.alternatives:
        if _agreement(context, p, streams, other.parameters, printed) >= 1:
            return other.explains(
                context, passed(vector.expected, vector.measured, notes=vector.notes)
            )
    if fits:
        return _of_reported_only(context, p, vector, len(heard), of_all)
    lost, doubt = _lost_to_machine(context, p)
    best = 1.0 if heard and lost >= _LOST_SHARE else vector.share
    return vector.graded(vector.share, f"Expected: {vector.right_text}.", best, doubt)


def _vector(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    printed: PrintedVector,
) -> _Vector:
    """Compare a printed vector with the oracle's."""
    share = _agreement(context, p, streams, {}, printed)
    right = p.answer(context, streams)[p.key]["value"]
    measured, right_text = _shown_vectors(printed.values[: p.length], right, share < 1)
    expected = f"{right_text} from the recording, behind '{p.label}:' at Ctrl-C"
    notes: tuple[str, ...] = ()
    if printed.form != "vector":
        form = f"{p.label} is printed in another form"
        notes = (f"{form}; the lab asks for a line '{p.label}: [...]'.",)
    return _Vector(printed, share, right_text, expected, measured, notes)


def _shown_vectors(
    printed: Sequence[float], right: Sequence[float], loses_points: bool
) -> tuple[str, str]:
    """Return two vectors with four decimal places each.

    If points are lost and the texts are equal, as many places are added as make them differ.
    """
    if loses_points:
        for places in range(4, 10):
            pair = (_shown_vector(printed, places), _shown_vector(right, places))
            if pair[0] != pair[1]:
                return pair
    return _shown_vector(printed, 4), _shown_vector(right, 4)


def _shown_vector(values: Iterable[float], places: int) -> str:
    return f"[{' '.join(f'{value:.{places}f}' for value in values)}]"


def _of_reported_only(
    context: Context, p: ReportedStatistics, vector: _Vector, heard: int, of_all: float
) -> Finding:
    """Grade numbers that are right over the reported messages alone, by the share of these."""
    lost, doubt = _lost_to_machine(context, p)
    reason = f"Your numbers match only the {heard} messages that the node reported; it missed the others."
    return graded(
        of_all,
        vector.expected,
        vector.measured,
        reason,
        best=of_all + lost / p.full_from,
        doubt=doubt,
        levels=CREDIT_LEVELS,
    )


def _silent_when_shorter(context: Context, p: ReportedStatistics, shorter: Shorter) -> str:
    """Say that the node printed no numbers after a run with fewer messages.

    Empty if it printed them, or if the run does not tell.
    """
    other = context.sessions.get(shorter.session)
    if other is None:
        return ""
    for run in other.record.processes:
        count = _reports_in(run, p.report_pattern)
        if not shorter.least <= count <= shorter.most or not _was_interrupted(run):
            continue
        unprinted = _printed(p, run.output, run.interrupted_ns) is None
        if unprinted and not any("KeyboardInterrupt" in line.text for line in run.output):
            return (
                f"In the session '{shorter.session}' it was stopped after {count} reports, and printed no "
                f"'{p.label}: [...]'; {shorter.least} are enough."
            )
    return ""


def _reports_in(run: ProcessRun, patterns: Sequence[str]) -> int:
    """Count the lines of a process with a report, by the first pattern that finds any."""
    for pattern in patterns:
        count = sum(search(pattern, line.text[:2000]) is not None for line in run.output)
        if count:
            return count
    return 0


def _was_interrupted(run: ProcessRun) -> bool:
    """Tell whether a student's process ended by Ctrl-C as it should, with all of its output kept."""
    if run.role != "student" or run.ended_by != "interrupt" or run.output_dropped_bytes:
        return False
    return not flaky_end(run)


def _agreement(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    other: Mapping[str, Any],
    printed: PrintedVector,
) -> float:
    """Return the share of elements that lie within the oracle's bounds."""
    right = p.answer(context, streams, other).get(p.key)
    if right is None or len(printed.values) != len(right["value"]):
        return 0.0
    elements = zip(printed.values, right["value"], right["low"], right["high"], strict=True)
    right_ones = 0
    for printed_value, value, low, high in elements:
        slack = max(p.tolerance, 0.01 * abs(value), 1.01 * printed.rounding)
        right_ones += bool(low - slack <= printed_value <= high + slack)
    return right_ones / len(printed.values)


def _heard_of_some(
    context: Context, p: ReportedStatistics, streams: Mapping[str, NumericStream]
) -> tuple[list[tuple[int, float]], int]:
    """Return time and value of the node's reports, and the number of comparable messages.

    No report is returned if there is one for nearly every message.
    """
    begun_ns = max(int(stream.source_ns[0]) for stream in streams.values())
    counts = [int((stream.source_ns >= begun_ns).sum()) for stream in streams.values()]
    comparable = max(counts)
    heard = reports(context.session, p.artifact, p.report_pattern) if p.report_pattern else []
    heard = _without_repeats(context, p, heard)
    if len(heard) >= 0.99 * comparable:
        return [], comparable
    return [(report.t_ns, report.value) for report in heard], comparable


class Survives(Parameters):
    """A process is still alive after a step with difficult messages."""

    artifact: ref.Artifact
    step: ref.AnyStep
    until: ref.AnyStep | None = Field(
        None, description="A later step; what ends after that one's start has survived."
    )
    quiet: Patterns = Field(
        (), description="A report that cannot be made yet, before the later step starts."
    )
    quiet_credit: float = Field(
        0.5, ge=0, le=1, description="Credit of a node that makes it all the same."
    )


def survives(context: Context, p: Survives) -> Finding:
    """Judge whether the artifact's first process and its node outlived the step.

    A program that starts its node again does not pass.
    """
    expected = "the node goes on"
    step = context.session.step(p.step)
    processes = context.session.processes_of(p.artifact)
    if step is None or not processes or step.outcome == "failed":
        reason = "The recording does not show what the node did then."
        return inconclusive(expected, "the step was not reached", reason)
    first = processes[0]
    later = context.session.step(p.until) if p.until is not None else None
    until_ns = _tested_until_ns(processes, later)
    if _ended_by_itself(first, until_ns):
        measured = (
            f"it ended with status {first.exit_status} at {_at_s(context, first.exited_ns)} s"
        )
        return unexplained(failed(expected, measured, "The node ended."))
    if _never_matched(context, step):
        reason = "The subscription was not matched in time, so that the node may not have got what was sent."
        return unclear(expected, "it went on", reason)
    replaced_ns = _replaced_ns(context, step, until_ns)
    if replaced_ns is not None:
        measured = f"the program went on; its node ended before {_at_s(context, replaced_ns)} s"
        reason = "The node ended, and the program went on without it or started it again; messages are lost meanwhile."
        return unexplained(failed(expected, measured, reason))
    return _judge_early_reports(context, p, step, later)


def _at_s(context: Context, t_ns: int | None) -> str:
    """Return a time of the system clock as seconds since the session's start."""
    assert t_ns is not None
    return f"{context.session.since_start_s(t_ns):.2f}"


def _tested_until_ns(processes: Sequence[ProcessRun], later: StepRun | None) -> int:
    """Return the start of the second process or of a later step, before which the first must not end."""
    starts_ns = [run.started_ns for run in processes[1:2]]
    if later is not None:
        starts_ns.append(later.started_ns)
    return min(starts_ns, default=2**63)


def _ended_by_itself(run: ProcessRun, until_ns: int) -> bool:
    """Tell whether a process ended without an interrupt, up to a time."""
    if run.exited_ns is None or run.interrupted_ns is not None:
        return False
    return run.exited_ns <= until_ns


def _judge_early_reports(
    context: Context, p: Survives, step: StepRun, later: StepRun | None
) -> Finding:
    """Judge whether a surviving node made reports before there was anything to compare."""
    expected = "the node goes on"
    early = _early_reports(context, p, step, later)
    if not early:
        return passed(expected, "it went on")
    when_s = context.session.since_start_s(early[0].t_ns)
    reason = f"At {when_s:.1f} s it reports {early[0].value:g}, when there is nothing yet to compare with."
    measured = f"it went on; early reports: {len(early)}"
    return graded(p.quiet_credit, f"{expected}, and reports nothing", measured, reason)


def _replaced_ns(context: Context, step: StepRun, until_ns: int) -> int | None:
    """Return when the subscriptions to a step's topic were gone, or when their node subscribed anew.

    None if they lasted.
    """
    topic = PublishStep.given(step).topic
    endpoints = student_endpoints(context, topic, "subscription")
    nodes = {endpoint.gid: endpoint.node for endpoint in endpoints}
    before: set[str] = set()
    for graph in context.session.record.graph:
        there = {endpoint.gid for endpoint in graph.endpoints if endpoint.gid in nodes}
        if graph.t_ns <= step.started_ns:
            before = there
        elif before and graph.t_ns < until_ns and _is_replaced(before, there, nodes):
            return graph.t_ns
    return None


def _is_replaced(before: set[str], there: set[str], nodes: Mapping[str, str]) -> bool:
    """Tell whether no endpoint of before is there, or a new endpoint of one of the same nodes."""
    if not there & before:
        return True
    names = {nodes[gid] for gid in before}
    return any(nodes[gid] in names for gid in there - before)


def _never_matched(context: Context, step: StepRun) -> bool:
    """Tell whether a step published to no subscription, though the student's are compatible."""
    if step.kind != PublishStep.kind or PublishResult.of(step).matched is not False:
        return False
    given = PublishStep.given(step)
    requests = student_endpoints(context, given.topic, "subscription")
    offered = OfferedProfile(durability="transient_local")
    for request in requests:
        if request.type != given.type or clash(request, offered) is not None:
            return False
    return bool(requests)


def _early_reports(
    context: Context, p: Survives, step: StepRun, later: StepRun | None
) -> list[Report]:
    """Return a node's reports on messages with which nothing could be compared yet."""
    if later is None:
        return []
    heard = reports(context.session, p.artifact, p.quiet)
    # A line that explains a missing report may hold the same word, and a number.
    lead_ins = {report.lead_in for report in heard if report.t_ns >= later.started_ns}
    early = []
    for report in heard:
        if step.started_ns <= report.t_ns < later.started_ns and report.lead_in in lead_ins:
            early.append(report)
    return early


def _report_share(context: Context, p: ReportedSeries, of: ReportShare) -> _ReportCount:
    """Count the messages with a report, as far as the output was kept."""
    streams = p.recorded(context) or {}
    kept = ""
    last_ns = _output_kept_until_ns(context, p)
    if last_ns is not None:
        kept = ", as far as its output is kept: it printed more"
        streams = {
            role: stream.only(stream.received_ns <= last_ns) for role, stream in streams.items()
        }
    count_messages = context.oracle(of.oracle)
    possible = int(count_messages(streams, dict(p.parameters), context.session.record.seed))
    lines = reports(context.session, p.artifact, p.pattern)
    heard = len(_without_repeats(context, p, lines))
    repeats = f", and {len(lines) - heard} that repeat one" if heard < len(lines) else ""
    lost, doubt = _lost_to_machine(context, p)
    share = heard / max(1, possible) / of.full_from
    return _ReportCount(
        share,
        share + lost / of.full_from,
        f"{heard} reports{repeats} for {possible} messages{kept}",
        f"Only {heard} of {possible} messages led to a report.",
        doubt,
    )


def _output_kept_until_ns(context: Context, p: ReportedSeries) -> int | None:
    """Return the time of the last kept line of a node that printed more; None if all was kept."""
    runs = context.session.processes_of(p.artifact)
    if runs and runs[-1].output_dropped_bytes and runs[-1].output:
        return runs[-1].output[-1].t_ns
    return None


#: Number of median intervals without a message after which a new value comes.
_SILENT_INTERVALS = 5
#: Relative difference up to which two values are the same.
_ALIKE = 0.01


def _without_repeats(context: Context, p: Streams, heard: Sequence[Report]) -> list[Report]:
    """Return the reports without lines that repeat the line before.

    A late node reports on several messages at once, but on no more than came until then. If there
    are more reports than that, and the stalls of the grader do not explain it, reports that follow
    one another faster than messages count once.
    """
    sent = _sent_ns(context, p)
    if len(sent) < 2:
        return list(heard)
    steps = np.diff(sent)
    interval_ns = float(np.median(steps))
    starts = sent[np.concatenate(([True], steps > _SILENT_INTERVALS * interval_ns))]
    runs = _runs_of_one_value([report for report in heard if report.t_ns >= _begun_ns(context, p)])
    surplus = sum(_surplus(run, sent, starts) for run in runs)
    stalled_s = context.session.stalled_s(Span(int(sent[0]), int(sent[-1])))
    if surplus <= stalled_s * 1e9 / interval_ns:
        return list(heard)
    kept = []
    for run in runs:
        kept.append(run[0])
        for before, report in pairwise(run):
            if report.t_ns - before.t_ns > interval_ns / 2:
                kept.append(report)
    return kept


def _begun_ns(context: Context, p: Streams) -> int:
    """Return when the last of the streams began."""
    streams = context.session.streams(p.streams, p.field).values()
    return max((int(stream.source_ns[0]) for stream in streams), default=0)


def _sent_ns(context: Context, p: Streams) -> Integers:
    """Return the times of the most frequent stream, from the beginning of the last one on."""
    begun_ns = _begun_ns(context, p)
    sent: Integers = np.array([], dtype=np.int64)
    for stream in context.session.streams(p.streams, p.field).values():
        times_ns = stream.source_ns[stream.source_ns >= begun_ns]
        if len(times_ns) > len(sent):
            sent = times_ns
    return sent


def _runs_of_one_value(heard: Iterable[Report]) -> list[list[Report]]:
    """Sort reports by time, and split them where the value changes."""
    runs: list[list[Report]] = []
    for report in sorted(heard, key=lambda report: report.t_ns):
        if runs and _is_alike(report, runs[-1][-1]):
            runs[-1].append(report)
        else:
            runs.append([report])
    return runs


def _is_alike(report: Report, before: Report) -> bool:
    return math.isclose(report.value, before.value, rel_tol=_ALIKE, abs_tol=1e-8)


def _surplus(run: Sequence[Report], sent: Integers, starts: Integers) -> int:
    """Return how many more reports of one value came than messages, at most at any time.

    Parameters
    ----------
    sent
        int64[n]: Times of the messages, in ns.
    starts
        int64[m]: Times of the first messages after each silence, in ns.
    """
    start = int(np.searchsorted(starts, run[0].t_ns, side="right")) - 1
    first = int(np.searchsorted(sent, starts[max(0, start)]))
    surplus = 0
    for count, report in enumerate(run, 1):
        came = int(np.searchsorted(sent, report.t_ns, side="right"))
        surplus = max(surplus, count - (came - first))
    return surplus
