"""Checks of a node that listens: its subscriptions, what it reports on each message, its statistics at the end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
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
from grader.recording.session import Endpoint, ProcessRun, StepRun
from grader.result import Finding, Outcome


class WantedTopic(Parameters):
    """A topic to which the node subscribes."""

    topic: ref.RosName
    type: ref.MessageType


class TopicsSubscribed(OfEndpoint):
    """A node subscribes to topics, with types and QoS that fit; it needs them all, so that the worst one decides."""

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
    expected = ", ".join(f"{t.type} from {t.topic}" for t in p.topics)
    endpoints = {
        wanted: student_endpoints(context, wanted.topic, "subscription") for wanted in p.topics
    }
    nodes = [endpoint.node for each in endpoints.values() for endpoint in each]
    if not nodes:
        fallback = "The node subscribed to none of the topics, nor to any of a similar name."
        return unexplained(failed(expected, "no subscription in the graph", fallback))
    parts = [_judge_subscription(context, p, wanted, each) for wanted, each in endpoints.items()]
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
    endpoint = next((e for e in endpoints if e.type == wanted.type), endpoints[0])
    wrong = p.faults("topic", (wanted.topic, wanted.type), (used, endpoint.type), [endpoint.node])
    if (policy := clash(endpoint, p.offered) or unheard(context, wanted.topic)) is not None:
        arrives = "so no message would arrive from the lab's publisher."
        wrong.append(
            (
                p.incompatible_costs,
                f"On {used} the two sides are incompatible in {policy}, {arrives}",
            )
        )
    weaker = p.reliability == "reliable" and any(
        e.qos.reliability == "best_effort" for e in endpoints
    )
    note = f"The subscription on {used} requests BEST_EFFORT; with RELIABLE a lost message would be sent again."
    return Part(
        1 - max((costs for costs, _ in wrong), default=0.0),
        f"{endpoint.type} from {used} ({endpoint.qos.reliability}, {endpoint.qos.durability})",
        " ".join(reason for _, reason in wrong),
        where=claimed_at(claim_of(context, "subscription", wanted.topic)),
        notes=(note,) if weaker else (),
    )


class RequestedQos(QosWanted):
    """A subscription requests a QoS profile; what discovery does not carry is taken from the source, as advice only."""


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
        """Return what the oracle says over some streams, with the check's parameters and others."""
        return context.oracle(self.oracle)(
            streams, {**self.parameters, **(other or {})}, context.session.record.seed
        )

    def recorded(self, context: Context) -> dict[str, NumericStream] | None:
        """Return the streams by role, or None where one of them was not recorded."""
        streams = context.session.streams(self.streams, self.field)
        return streams if len(streams) == len(self.streams) else None


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
        """Return the credit that it leaves: all where another check has charged it."""
        return 1.0 if any(map(context.charged, self.charged_by)) else self.credit

    def explains(self, context: Context, finding: Finding, least: float = 0.0) -> Finding:
        """State what numbers are worth that fit it; where another check has charged the mistake, that says it.

        Numbers of which a share is right all the same are worth at least that.
        """
        charged, meant = (
            any(map(context.charged, self.charged_by)),
            f"Your numbers match {self.meaning}.",
        )
        share, reason = max(self.left(context), least), f"{finding.reason} {meant}".strip()
        notes = finding.notes if charged or self.credit < 1 else (*finding.notes, meant)
        return graded(
            share, finding.expected, finding.measured, reason, where=finding.where, notes=notes
        )


class ReportShare(Parameters):
    """For how many of the messages for which it could a node reports, by an oracle's count of them."""

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
    """A span of the oracle's with its value, and what a node reported within it."""

    span: Span
    right: float
    reports: tuple[Report, ...] = Field(min_length=1)

    @property
    def value(self) -> float | None:
        """The median of the reports; None without any."""
        return float(np.median([r.value for r in self.reports])) if self.reports else None

    def is_right(self, p: ReportedSeries) -> bool:
        """Whether the value is the right one; what was printed with two places cannot be known better."""
        rounding = min((r.rounding for r in self.reports if r.rounding), default=0.0)
        slack = max(p.tolerance, 0.01 * abs(self.right), rounding * 1.01)
        return self.value is not None and abs(self.value - self.right) <= slack


def _plateaus(
    context: Context,
    p: ReportedSeries,
    heard: Sequence[Report],
    other: Mapping[str, Any] | None = None,
) -> list[_Plateau]:
    """Return the oracle's spans with what was reported in each; none if the stimulus was not recorded."""
    streams, found = p.recorded(context), []
    for each in p.answer(context, streams, other) if streams is not None else ():
        span = Span(
            each["start_ns"] + int(p.settle_s * 1e9), each["end_ns"] - int(p.settle_s * 1e9)
        )
        inside = tuple(r for r in heard if span.start_ns <= r.t_ns <= span.end_ns)
        found.append(_Plateau(span, float(each["value"]), inside))
    return found


def reported_series(context: Context, p: ReportedSeries) -> Finding:
    """Judge each span by the median of the reports that fall into it, less what is lost for messages without one."""
    finding = _right_values(context, p)
    if p.share is None or finding.outcome not in (Outcome.PASSED, Outcome.PARTIAL):
        return finding
    share, best, measured, reason, doubt = _report_share(context, p, p.share)
    if share >= 1.0:
        return finding
    kept, most = (
        float(finding.credit) * (1 - p.share.costs * (1 - quantise(min(1.0, s))))
        for s in (share, best)
    )
    texts = (
        finding.expected,
        f"{finding.measured}; {measured}",
        f"{finding.reason} {reason}".strip(),
    )
    return graded(kept, *texts, where=finding.where, notes=finding.notes, best=most, doubt=doubt)


def _right_values(context: Context, p: ReportedSeries) -> Finding:
    heard = reports(context.session, p.artifact, p.pattern)
    plateaus = _plateaus(context, p, heard)
    count = len(plateaus)
    expected = f"the right value in each of {count} phases of constant commands and states, ± {p.tolerance:g} or 1%"
    if not plateaus:
        return unclear(expected, "no stimulus recorded", _NO_STIMULUS)
    if not heard:
        printed = [line.text for line in context.session.output_of(p.artifact)]
        last = (
            f"; it printed {len(printed)} others, the last of which is {printed[-1][:100]!r}."
            if printed
            else "."
        )
        reason = f"The node printed no tracking error in the requested form, neither to its output nor to its log{last}"
        return unexplained(failed(expected, "no report", reason))
    fits = [plateau.is_right(p) for plateau in plateaus]
    right, reached = (
        sum(fits),
        max((n for n, each in enumerate(plateaus, 1) if each.reports), default=0),
    )
    where = (context.output_of(p.artifact), context.location(next(iter(p.streams.values()))))
    measured = f"right in {right} of {count} phases ({len(heard)} reports)"
    if right == count:
        return passed(expected, measured, where=where)
    example = _wrong(context, plateaus[fits.index(False)])
    for other in p.alternatives:
        others = _plateaus(context, p, heard, other.parameters)
        alike = [plateau.is_right(p) for plateau in others if plateau.reports]
        if all(alike) and 2 * len(alike) >= count:
            wrong = failed(expected, measured, example, where=where)
            return other.explains(context, wrong, right / count)
    # Spans without a report before the last that is right are charged by the share of reports.
    last_right = max((n for n, fit in enumerate(fits, 1) if fit), default=0)
    unreported, notes = sum(not plateau.reports for plateau in plateaus[:last_right]), []
    if p.end_charged_by is not None and reached < count and _went_on(context, p.artifact) is None:
        notes = [
            f"The node ended in phase {reached + 1} of {count}, which costs points in {p.end_charged_by}."
        ]
        unreported += min(count - reached, count // 2)
    judged = max(right, count - unreported)
    behind = [
        each
        for n, each in enumerate(plateaus)
        if not fits[n]
        and any(replace(each, right=before.right).is_right(p) for before in plateaus[:n])
    ]
    kept, doubt = _kept_behind(context, p, [*behind, *plateaus[reached:]])
    best = min(1.0, (right + kept) / judged)
    return graded(
        right / judged,
        expected,
        measured,
        example,
        where=where,
        notes=notes,
        best=best,
        doubt=doubt,
    )


#: So long the grader may stall without reading a report at another value than that for which it was printed.
_READ_LATE_S = 0.3


def _kept_behind(
    context: Context, p: ReportedSeries, behind: Sequence[_Plateau]
) -> tuple[float, str]:
    """Return on how many plateaus the machine may have kept a node from what is right, and say so.

    Those are the silent ones at the end, and those with what was right before, for half of which it had no core; and
    any, where the grader stalled and read too late what was printed.
    """
    times = [stream.source_ns for stream in context.session.streams(p.streams, p.field).values()]
    run, span = (
        _went_on(context, p.artifact),
        Span(min(int(t[0]) for t in times), max(int(t[-1]) for t in times)),
    )
    if run is None:
        return 0.0, ""
    doubt = cpu_delay_doubt(context.session.machine_delay_s(run, span), span.duration_s)
    if (
        context.session.stalled_s(span) > _READ_LATE_S
        and run.limit is None
        and not run.output_dropped_bytes
    ):
        return float("inf"), doubt
    halves = (
        context.session.machine_delay_s(run, plateau.span) >= plateau.span.duration_s / 2
        for plateau in behind
    )
    return float(sum(halves)), doubt


def _wrong(context: Context, plateau: _Plateau) -> str:
    """Say what is reported on a plateau, and what is right."""
    begin_s, value = context.session.since_start_s(plateau.span.start_ns), plateau.value
    if value is None:
        return f"From {begin_s:.1f} s on there is no report during a whole phase of constant commands and states."
    shown, wanted = apart(value, plateau.right, places=4), apart(plateau.right, value, places=4)
    return f"At {begin_s:.1f} s it reports {shown}; right is {wanted}."


def _went_on(context: Context, artifact: str) -> ProcessRun | None:
    """Return the artifact's last process, unless it ended without having been told to: one that ended did not wait."""
    run = next(reversed(context.session.processes_of(artifact)), None)
    asked = (
        run is None
        or run.exited_ns is None
        or run.interrupted_ns is not None
        or run.ended_by == "kill"
    )
    return run if asked else None


def _lost_to_machine(context: Context, p: Streams) -> tuple[float, str]:
    """Return which share of the messages the machine may have kept from a node, and say so.

    While its queue has room, nothing is lost, and nothing by a node that had ended.
    """
    run = _went_on(context, p.artifact)
    if run is None:
        return 0.0, ""
    most = max((s.source_ns for s in context.session.streams(p.streams, p.field).values()), key=len)
    span = Span(int(most[0]), int(most[-1]))
    late_s = context.session.machine_delay_s(run, span)
    lost = lost_share(context, [run], p.streams.values(), most)
    return lost, cpu_delay_doubt(late_s, max(span.duration_s, 1e-9))


def lost_share(
    context: Context, runs: Iterable[ProcessRun], topics: Iterable[str], times_ns: Integers
) -> float:
    """Return which share of the messages that came at these times one of some processes may not have got, at most.

    While the queues of its subscriptions to these topics have room, nothing is lost.
    """
    span = Span(int(times_ns.min()), int(times_ns.max()))
    length_s = max(span.duration_s, 1e-9)
    claims = [claim_of(context, "subscription", topic) for topic in topics]
    room = min(c.qos.depth if c is not None and c.qos is not None else 1 for c in claims) - 1
    room_s = max(0, room) * length_s / len(times_ns)
    return max(
        (context.session.backlog(run, span, room_s).lost_s / length_s for run in runs), default=0.0
    )


class Shorter(Parameters):
    """Another session, in which a node that also needs fewer messages prints its numbers too."""

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
    run = context.session.processes_of(p.artifact)[-1:]
    printed = _printed(
        p, context.session.output_of(p.artifact), run[0].interrupted_ns if run else None
    )
    if printed is None:
        if run and (flaky := flaky_end(run[0])):
            return unclear(expected, "nothing", flaky)
        nothing = f"Nothing of the form '{p.label}: [...]' was printed after Ctrl-C."
        hint = f"Catch KeyboardInterrupt around rclpy.spin(node), and print '{p.label}: [...]' after it."
        return unexplained(failed(expected, "nothing", nothing, hint=hint))
    finding = _judge_vector(context, p, streams, printed)
    if finding.outcome is Outcome.PASSED and p.shorter is not None:
        reason = _silent_when_shorter(context, p, p.shorter)
        share = p.shorter.credit if reason else 1.0
        return graded(share, finding.expected, finding.measured, reason, notes=finding.notes)
    return finding


def _printed(
    p: ReportedStatistics, output: Sequence[Any], stopped_ns: int | None
) -> PrintedVector | None:
    return printed_vector(output, (p.label, *p.synonyms), stopped_ns, p.unless)


#: Share of the messages that the machine may have kept from a node, from which its numbers may be of the others.
_LOST_SHARE = 0.03


def _judge_vector(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    printed: PrintedVector,
) -> Finding:
    share = _agreement(context, p, streams, {}, printed)
    right = p.answer(context, streams)[p.key]["value"]
    # Numbers that lose points do not read as the right ones.
    shown = [
        [
            f"[{' '.join(f'{x:.{n}f}' for x in each)}]"
            for each in (printed.values[: p.length], right)
        ]
        for n in range(4, 10)
    ]
    measured, right_text = next(
        (pair for pair in shown if share < 1 and pair[0] != pair[1]), shown[0]
    )
    expected = f"{right_text} from the recording, behind '{p.label}:' at Ctrl-C"
    other_form = (
        f"{p.label} is printed in another form; the lab asks for a line '{p.label}: [...]'."
    )
    notes = [] if printed.form == "vector" else [other_form]
    if share >= 1:
        return passed(expected, measured, notes=notes)
    if len(printed.values) != p.length:
        reason = f"{len(printed.values)} numbers are printed, not one for each of {p.length}. Expected: {right_text}."
        return failed(expected, measured, reason)
    heard, of = _heard_of_some(context, p, streams)
    fits = bool(heard) and _agreement(context, p, streams, {"reports": heard}, printed) >= 1
    of_all = len(heard) / of / p.full_from
    # After a loss a right history reaches back further, so that it may look like one that is too long.
    if fits and of_all >= 1:
        note = f"{p.label}: judged over the {len(heard)} messages that the node reported; it lost the others."
        return passed(expected, measured, notes=[*notes, note])
    for other in p.alternatives:
        if _agreement(context, p, streams, other.parameters, printed) >= 1:
            return other.explains(context, passed(expected, measured, notes=notes))
    lost, late = _lost_to_machine(context, p)
    if fits:
        reason = f"Your numbers match only the {len(heard)} messages that the node reported; it missed the others."
        return graded(
            of_all,
            expected,
            measured,
            reason,
            best=of_all + lost / p.full_from,
            doubt=late,
            levels=CREDIT_LEVELS,
        )
    best = 1.0 if heard and lost >= _LOST_SHARE else share
    return graded(
        share, expected, measured, f"Expected: {right_text}.", notes=notes, best=best, doubt=late
    )


def _silent_when_shorter(context: Context, p: ReportedStatistics, shorter: Shorter) -> str:
    """Say that the node printed no numbers after a run with fewer messages, if it ran, and ended as it should."""
    other = context.sessions.get(shorter.session)
    for run in other.record.processes if other is not None else ():
        each = (
            sum(search(one, line.text[:2000]) is not None for line in run.output)
            for one in p.report_pattern
        )
        count = next(filter(None, each), 0)
        ended = (
            run.role == "student" and run.ended_by == "interrupt" and not run.output_dropped_bytes
        )
        if not ended or not shorter.least <= count <= shorter.most or flaky_end(run):
            continue
        unprinted = _printed(p, run.output, run.interrupted_ns) is None
        if unprinted and not any("KeyboardInterrupt" in line.text for line in run.output):
            return (
                f"In the session '{shorter.session}' it was stopped after {count} reports, and printed no "
                f"'{p.label}: [...]'; {shorter.least} are enough."
            )
    return ""


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
    slack = [max(p.tolerance, 0.01 * abs(v), 1.01 * printed.rounding) for v in right["value"]]
    bounds = zip(printed.values, right["low"], right["high"], slack, strict=True)
    right_ones: list[bool] = [low - s <= x <= high + s for x, low, high, s in bounds]
    return sum(right_ones) / len(printed.values)


def _heard_of_some(
    context: Context, p: ReportedStatistics, streams: Mapping[str, NumericStream]
) -> tuple[list[tuple[int, float]], int]:
    """Return the node's reports if they are clearly fewer than the messages that could be compared, and how many."""
    heard = reports(context.session, p.artifact, p.report_pattern) if p.report_pattern else []
    begun_ns = max(int(s.source_ns[0]) for s in streams.values())
    comparable = max(int((s.source_ns >= begun_ns).sum()) for s in streams.values())
    heard = _without_repeats(context, p, heard)
    return [(r.t_ns, r.value) for r in heard] if len(heard) < 0.99 * comparable else [], comparable


class Survives(Parameters):
    """A process is still alive after a step that tests its nerves."""

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
    """Judge whether the artifact's first process outlived the step, and the node in it.

    A program that starts its node again has not kept it from ending.
    """
    expected = "the node goes on"
    step = context.session.step(p.step)
    processes = context.session.processes_of(p.artifact)
    if step is None or not processes or step.outcome == "failed":
        return inconclusive(
            expected,
            "the step was not reached",
            "The recording does not show what the node did then.",
        )
    first = processes[0]
    later = context.session.step(p.until) if p.until is not None else None
    until_ns = min(
        [run.started_ns for run in processes[1:2]] + ([later.started_ns] if later else []),
        default=2**63,
    )
    if first.exited_ns is not None and first.interrupted_ns is None and first.exited_ns <= until_ns:
        measured = f"it ended with status {first.exit_status} at {context.session.since_start_s(first.exited_ns):.2f} s"
        return unexplained(failed(expected, measured, "The node ended."))
    if _never_matched(context, step):
        reason = "The subscription was not matched in time, so that the node may not have got what was sent."
        return unclear(expected, "it went on", reason)
    if (replaced_ns := _replaced_ns(context, step, until_ns)) is not None:
        measured = f"the program went on; its node ended before {context.session.since_start_s(replaced_ns):.2f} s"
        reason = "The node ended, and the program went on without it or started it again; messages are lost meanwhile."
        return unexplained(failed(expected, measured, reason))
    early = _early_reports(context, p, step, later)
    if not early:
        return passed(expected, "it went on")
    when_s = context.session.since_start_s(early[0].t_ns)
    reason = f"At {when_s:.1f} s it reports {early[0].value:g}, when there is nothing yet to compare with."
    return graded(
        p.quiet_credit,
        f"{expected}, and reports nothing",
        f"it went on; early reports: {len(early)}",
        reason,
    )


def _replaced_ns(context: Context, step: StepRun, until_ns: int) -> int | None:
    """Return when what subscribed to a step's topic was first seen gone, or the same node to have subscribed anew."""
    nodes = {
        e.gid: e.node
        for e in student_endpoints(context, str(step.parameters.get("topic")), "subscription")
    }
    before: set[str] = set()
    for graph in context.session.record.graph:
        there = {endpoint.gid for endpoint in graph.endpoints if endpoint.gid in nodes}
        if graph.t_ns <= step.started_ns:
            before = there
        elif before and graph.t_ns < until_ns:
            names = {nodes[gid] for gid in before}
            if not there & before or any(nodes[gid] in names for gid in there - before):
                return graph.t_ns
    return None


def _never_matched(context: Context, step: StepRun) -> bool:
    """Whether a step published what no subscription was there for, although the student's could have taken it."""
    topic, sent = str(step.parameters.get("topic", "")), step.parameters.get("type")
    requests = student_endpoints(context, topic, "subscription") if step.kind == "publish" else ()
    offered = OfferedProfile(durability="transient_local")
    fit = bool(requests) and all(e.type == sent and clash(e, offered) is None for e in requests)
    return step.result.get("matched") is False and fit


def _early_reports(
    context: Context, p: Survives, step: StepRun, later: StepRun | None
) -> list[Report]:
    """Return a node's reports on messages with which nothing could be compared yet."""
    heard = reports(context.session, p.artifact, p.quiet) if later is not None else []
    begun_ns = later.started_ns if later is not None else 0
    # A line that says why there is no report yet may hold the same word, and a number.
    lead_ins = {r.lead_in for r in heard if r.t_ns >= begun_ns}
    return [r for r in heard if step.started_ns <= r.t_ns < begun_ns and r.lead_in in lead_ins]


def _report_share(
    context: Context, p: ReportedSeries, of: ReportShare
) -> tuple[float, float, str, str, str]:
    """Return the share of messages with a report, the most that it may be, what was counted, why, and the doubt.

    The oracle's count goes as far as the output was kept.
    """
    streams, run = p.recorded(context) or {}, context.session.processes_of(p.artifact)[-1:]
    full = bool(run) and bool(run[0].output_dropped_bytes and run[0].output)
    if full:
        streams = {
            role: each.only(each.received_ns <= run[0].output[-1].t_ns)
            for role, each in streams.items()
        }
    possible = int(
        context.oracle(of.oracle)(streams, dict(p.parameters), context.session.record.seed)
    )
    lines = reports(context.session, p.artifact, p.pattern)
    heard = len(_without_repeats(context, p, lines))
    repeats = f", and {len(lines) - heard} that repeat one" if heard < len(lines) else ""
    kept = ", as far as its output is kept: it printed more" if full else ""
    lost, late = _lost_to_machine(context, p)
    share = heard / max(1, possible) / of.full_from
    measured = f"{heard} reports{repeats} for {possible} messages{kept}"
    return (
        share,
        share + lost / of.full_from,
        measured,
        f"Only {heard} of {possible} messages led to a report.",
        late,
    )


#: After so many intervals without a message, those that follow come with another value.
_SILENT_INTERVALS = 5
#: Values that differ by less are taken for one.
_ALIKE = 0.01


def _without_repeats(context: Context, p: Streams, heard: Sequence[Report]) -> list[Report]:
    """Return the reports without lines that say again what the one before said.

    A node that fell behind reports on several messages at once, but on no more than came until then. Where more is said
    than the time in which the grader stalled explains, what follows faster than messages counts once.
    """
    streams = context.session.streams(p.streams, p.field).values()
    begun_ns = max((int(stream.source_ns[0]) for stream in streams), default=0)
    sent = max(
        (s.source_ns[s.source_ns >= begun_ns] for s in streams),
        key=len,
        default=np.array([], dtype=np.int64),
    )
    if len(sent) < 2:
        return list(heard)
    interval_ns = float(np.median(np.diff(sent)))
    starts = sent[np.concatenate(([True], np.diff(sent) > _SILENT_INTERVALS * interval_ns))]
    surplus = most = counted = first = 0
    before: Report | None = None
    kept: list[Report] = []
    for report in sorted((r for r in heard if r.t_ns >= begun_ns), key=lambda report: report.t_ns):
        came = int(np.searchsorted(sent, report.t_ns, side="right"))
        if before is None or not math.isclose(
            report.value, before.value, rel_tol=_ALIKE, abs_tol=1e-8
        ):
            surplus, most, counted = surplus + most, 0, 0
            start = int(np.searchsorted(starts, report.t_ns, side="right")) - 1
            first = int(np.searchsorted(sent, starts[max(0, start)]))
        counted += 1
        most = max(most, counted - (came - first))
        if counted == 1 or before is None or report.t_ns - before.t_ns > interval_ns / 2:
            kept.append(report)
        before = report
    stalled_s = context.session.stalled_s(Span(int(sent[0]), int(sent[-1])))
    return kept if surplus + most > stalled_s * 1e9 / interval_ns else list(heard)
