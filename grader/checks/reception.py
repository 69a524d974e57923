"""Checks of a node that listens: its subscriptions, what it reports on each message, its statistics at the end."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from grader import references as ref
from grader.checks.endpoints import OfEndpoint, OfferedProfile, claimed_at, claimed_qos, clash, student_endpoints
from grader.checks.finding import (
    Context,
    apart,
    failed,
    graded,
    inconclusive,
    kept_from_core,
    measured_share,
    not_reached,
    not_seen,
    nothing_seen,
    passed,
    percent,
    told,
    unclear,
    why_nothing,
)
from grader.evidence.printed import PrintedVector, Report, printed_vector, reports
from grader.evidence.recorded import Span
from grader.patterns import search
from grader.recording.session import Endpoint, OutputLine, ProcessRun, StepRun
from grader.references import Parameters, Pattern, Patterns, Share
from grader.result import Finding, Outcome, Where


class WantedTopic(Parameters):
    """A topic to which the node subscribes."""

    topic: ref.RosName
    type: ref.MessageType


class TopicsSubscribed(OfEndpoint):
    """A node subscribes to topics, with types and QoS that fit; each topic is a part."""

    artifact: ref.Artifact
    topics: tuple[WantedTopic, ...]
    offered: OfferedProfile = OfferedProfile()
    incompatible_costs: Share = Field(0.6, description="Share of the credit that a profile which gets nothing costs.")
    reliability: ref.Reliability | None = Field(
        None, description="What the lab lets them request; another one is only noted."
    )
    node: ref.RosName | None = None


def topics_subscribed(context: Context, p: TopicsSubscribed) -> Finding:
    """Judge the subscriptions from discovery."""
    expected = ", ".join(f"{t.type} from {t.topic}" for t in p.topics)
    shares, texts, reasons, absent = [], [], [], []
    spots: list[Where] = []
    nodes: list[str] = []
    notes: list[str] = []
    for topic in p.topics:
        endpoints = student_endpoints(context, topic.topic, "subscription")
        absent += [] if endpoints else [topic.topic]
        nodes += [e.node for e in endpoints]
        notes += _weaker_requests(context, topic.topic, endpoints, p.reliability)
        share, text, reason = _judge_subscription(context, p, topic, endpoints)
        shares.append(share)
        texts.append(text)
        reasons += [reason] if reason else []
        spots += claimed_at(context, "subscription", topic.topic)
    if not any(shares):
        fallback = "The node subscribed to none of the topics, nor to any of a similar name."
        return nothing_seen(context, p.artifact, expected, fallback, "subscription", absent)
    if (asked := not_seen(context, p.artifact, "subscription", absent, expected)) is not None:
        return asked
    other_node = p.node_faults(p.node, nodes)
    share = sum(shares) / len(shares) - sum(costs for costs, _ in other_node)
    reasons += [reason for _, reason in other_node]
    return graded(share, expected, ", ".join(texts), " ".join(reasons), where=(*spots, context.where()), notes=notes)


def _weaker_requests(context: Context, topic: str, endpoints: Sequence[Endpoint], wanted: str | None) -> list[str]:
    """Note a request for less than the lab asks for: it is compatible, but a lost message is not sent again."""
    if wanted != "reliable" or not any(e.qos.reliability == "best_effort" for e in endpoints):
        return []
    used = context.session.used(topic)
    return [f"The subscription on {used} requests BEST_EFFORT; with RELIABLE a lost message would be sent again."]


def _judge_subscription(
    context: Context, p: TopicsSubscribed, wanted: WantedTopic, endpoints: Sequence[Endpoint]
) -> tuple[float, str, str]:
    used = context.session.used(wanted.topic)
    if not endpoints:
        return (
            0.0,
            f"nothing on {wanted.topic}",
            f"There is no subscription on {wanted.topic}, nor on a similar name.",
        )
    endpoint = next((e for e in endpoints if e.type == wanted.type), endpoints[0])
    text = f"{endpoint.type} from {used} ({endpoint.qos.reliability}, {endpoint.qos.durability})"
    wrong = p.faults("topic", (wanted.topic, wanted.type), (used, endpoint.type), [endpoint.node])
    if (policy := clash(endpoint, p.offered)) is not None:
        arrives = "so no message would arrive from the lab's publisher."
        wrong.append((p.incompatible_costs, f"On {used} the two sides are incompatible in {policy}, {arrives}"))
    return max(0.0, 1 - sum(costs for costs, _ in wrong)), text, " ".join(reason for _, reason in wrong)


class Streams(Parameters):
    """Base of checks that compare an artifact's reports with an oracle over recorded topics."""

    artifact: ref.Artifact
    streams: Mapping[str, ref.Topic] = Field(description="Role that the oracle knows -> topic.")
    field: ref.FieldPath
    oracle: ref.Loadable = Field(description="file.py:function beside the rubric.")
    parameters: Mapping[str, Any] = Field(default_factory=dict, description="Passed on to the oracle.")


class Alternative(Parameters):
    """A known way to get other numbers, and how much credit it leaves."""

    parameters: Mapping[str, Any]
    meaning: str
    credit: float = Field(0.0, ge=0, le=1)
    charged_by: tuple[ref.EarlierCheckId, ...] = Field(
        (), description="Where one of these checks took points, none are lost here."
    )

    def finding(
        self,
        context: Context,
        expected: str,
        measured: str,
        least: float = 0.0,
        *,
        example: str = "",
        where: Sequence[Where],
        notes: Sequence[str] = (),
    ) -> Finding:
        """State what numbers are worth that fit it; where another check has charged the mistake, that says it.

        Numbers of which a share is right all the same are worth at least that.
        """
        if any(map(context.charged, self.charged_by)):
            return passed(expected, measured, where=where, notes=notes)
        meant = f"These numbers fit {self.meaning}."
        reason = f"{example} {meant}".strip()
        more = [*notes, meant] if self.credit >= 1 else notes
        return graded(max(self.credit, least), expected, measured, reason, where=where, notes=more)


class ReportedSeries(Streams):
    """Numbers that a node reports agree with an oracle's value on each span of time."""

    pattern: Patterns
    tolerance: float = Field(gt=0, description="Absolute; 1 % of the value, and what rounding makes, are allowed too.")
    settle_s: float = Field(0.05, description="Reports this close to a span's ends do not count.")
    alternatives: tuple[Alternative, ...] = ()
    smoothed_credit: float = Field(0.5, ge=0, le=1, description="Credit of reports that reach each value slowly.")
    end_charged_by: ref.CheckId | None = Field(
        None, description="Check that charges a node that ends early; then only half of the spans must be reached."
    )


def spans_of(context: Context, p: Streams, other: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the oracle's spans (``start_ns``, ``end_ns``, ``value``), none if the stimulus was not recorded.

    Parameters
    ----------
    other : mapping, optional
        Parameters for the oracle besides the check's own.
    """
    streams = context.streams(p.streams, p.field)
    if len(streams) < len(p.streams):
        return []
    parameters = {**p.parameters, **(other or {})}
    found: list[dict[str, Any]] = context.oracle(p.oracle)(streams, parameters, context.session.record.seed)
    return found


def _no_stimulus(expected: str) -> Finding:
    reason = "Commands and states were not recorded, so there is nothing to compare with."
    return unclear(expected, "no stimulus recorded", reason)


def reported_series(context: Context, p: ReportedSeries) -> Finding:
    """Judge each span by the median of the reports that fall into it."""
    spans = spans_of(context, p)
    expected = f"the right value on each of {len(spans)} plateaus (times of constant messages), ± {p.tolerance:g} or 1%"
    if not spans:
        return _no_stimulus(expected)
    heard = reports(context.session, p.artifact, p.pattern)
    if not heard:
        fallback, remedy = _unheard(context, p.artifact)
        if (mismatch := _deaf(context, p)) is not None:
            spot = context.output_of(p.artifact)
            return failed(expected, "no report", mismatch, hint=_DEAF_HINT, where=(spot,))
        reason, hint, where = why_nothing(context, p.artifact, fallback)
        return failed(expected, "no report", reason, hint=hint or remedy, where=where)
    spot = context.output_of(p.artifact)
    where = (spot, context.where(next(iter(p.streams.values()))))
    seen = _Seen.of(heard, spans, p)
    measured = f"right on {seen.right} of {len(spans)} plateaus ({len(heard)} reports)"
    if seen.right < len(spans) and (unread := _read_late(context, p)):
        return inconclusive(expected, measured, unread, where=(spot,))
    if seen.right < len(spans) and (other := _other_series(context, p, heard)) is not None:
        example = _first_wrong(context, seen)
        return other.finding(context, expected, measured, seen.right / len(spans), example=example, where=where)
    held_up = sum(_is_held_up(context, p, span) for span in spans[len(spans) - seen.silent :])
    if held_up and seen.right + seen.silent == len(spans):
        best = (seen.right + held_up) / len(spans)
        reason = _first_wrong(context, seen)
        return measured_share(
            seen.right / len(spans), best, expected, measured, reason, _late(context, p), steps=len(spans), where=where
        )
    if seen.right == len(spans) and (smoothed := _smoothed(context, p, heard, spans)):
        hint = "Report the error of each message by itself, without those before it."
        return graded(p.smoothed_credit, expected, measured, smoothed, hint=hint, where=where)
    notes = []
    if p.end_charged_by is not None and seen.silent and _ended_ns(context, p.artifact) is not None:
        notes = [f"The node ended before the last {seen.silent} plateaus, which is charged in {p.end_charged_by}."]
        seen = replace(seen, left_out=seen.left_out + min(seen.silent, len(spans) // 2))
    judged = max(seen.right, len(spans) - seen.left_out)
    # A formula that is right somewhere is none that is always wrong by the same factor.
    formula = "" if seen.right else _formula(seen.ratios, len(spans), context, p)
    reason = f"{_first_wrong(context, seen)}{formula}"
    return graded(seen.right / judged, expected, measured, reason, where=where, notes=notes)


#: So many lines are more than what a node says of itself when it starts.
_MANY_LINES = 20


def _unheard(context: Context, artifact: str) -> tuple[str, str]:
    """Say of a node without reports what else it did: reason and hint."""
    reason = "The node reported no tracking error at all, neither on its output nor in its log."
    source = context.submission.texts.get(context.path_of(artifact) or "", "")
    processes = context.session.processes_of(artifact)
    until_ns = (processes[-1].interrupted_ns if processes else None) or 2**63
    lines = [line.text for line in processes[-1].output if line.t_ns < until_ns] if processes else []
    if len(lines) >= _MANY_LINES:
        shown = re.sub(r"^(\[[^\]]{0,80}\]:?\s*){1,3}", "", lines[-1])[:100]
        return f"None of the {len(lines)} lines that it printed has the form asked for; the last is {shown!r}.", ""
    if re.search(r"logger\w{0,20}(?:\(\))?\.debug\(", source):
        return f"{reason} What it logs with debug() is not shown.", "Log with info(), as the lab asks for."
    return reason, ""


@dataclass(frozen=True)
class _Seen:
    """How a node's reports agree with the spans.

    Attributes
    ----------
    right : int
        Spans with the right value.
    silent : int
        Spans without a report, after the last that has one.
    left_out : int
        Spans without a report before another that is right: the share of reports charges for them.
    ratios : tuple of float
        Of a wrong value to the right one.
    first_wrong : tuple or None
        Start (ns) of the first span that is not right, what is reported there (None if nothing) and what is right.
    """

    right: int
    silent: int
    left_out: int
    ratios: tuple[float, ...]
    first_wrong: tuple[int, float | None, float] | None

    @classmethod
    def of(cls, heard: Sequence[Report], spans: Sequence[Mapping[str, Any]], p: ReportedSeries) -> _Seen:
        """Judge each span by the median of the reports within it."""
        rounding = _rounding(heard)
        right, silent, left_out, ratios, wrong = 0, 0, 0, [], []
        for span in spans:
            inside = _inside(heard, span, p.settle_s)
            value = float(np.median([r.value for r in inside])) if inside else None
            if value is not None and _shows(value, span, p, rounding):
                right += 1
                left_out, silent = left_out + silent, 0
                continue
            wrong.append((span["start_ns"], value, span["value"]))
            if value is not None:
                ratios.append(value / span["value"])
            else:
                silent += 1
        return cls(right, silent, left_out, tuple(ratios), wrong[0] if wrong else None)


def _rounding(heard: Sequence[Report]) -> float:
    """Return how far rounding may move a report: what was printed with two places cannot be known better."""
    return min((r.rounding for r in heard if r.rounding), default=0.0)


def _shows(value: float, span: Mapping[str, Any], p: ReportedSeries, rounding: float) -> bool:
    right = float(span["value"])
    return abs(value - right) <= max(p.tolerance, 0.01 * abs(right), rounding * 1.01)


#: Share of the reports that may fit no span: the few of messages that came while the value changed.
_SMOOTHED_SHARE = 0.1


def _smoothed(context: Context, p: ReportedSeries, heard: Sequence[Report], spans: Sequence[Mapping[str, Any]]) -> str:
    """Say that many reports fit no span, each before the first that is right in its own, if that is so.

    A node that is late shows the value of an earlier span, and one that reports a second number besides shows the
    right one from the first message on.
    """
    rounding, right, between = _rounding(heard), 0, []
    for span in spans:
        inside = _inside(heard, span, p.settle_s)
        fits = [_shows(report.value, span, p, rounding) for report in inside]
        right += sum(fits)
        before = inside[: fits.index(True)] if True in fits else []
        between += [(r, span) for r in before if not any(_shows(r.value, other, p, rounding) for other in spans)]
    messages = max(
        sum(_sent_inside(stream.source_ns, span, p.settle_s) for span in spans)
        for stream in context.streams(p.streams, p.field).values()
    )
    if len(between) <= _SMOOTHED_SHARE * (right + len(between)) or right >= (1 - _SMOOTHED_SHARE) * messages:
        return ""
    report, span = between[0]
    example = f"At {context.session.since_start_s(report.t_ns):.1f} s it reports {report.value:.4f}"
    return (
        f"{len(between)} of {right + len(between)} reports fit no plateau: after each change the number goes over to "
        f"the right one step by step, as a mean or a filter over several messages does. {example}; right is "
        f"{span['value']:.4f}."
    )


def _sent_inside(source_ns: NDArray[np.int64], span: Mapping[str, Any], settle_s: float) -> int:
    settle_ns = settle_s * 1e9
    return int(((source_ns >= span["start_ns"] + settle_ns) & (source_ns <= span["end_ns"] - settle_ns)).sum())


def _first_wrong(context: Context, seen: _Seen) -> str:
    if seen.first_wrong is None:
        return ""
    start_ns, value, right = seen.first_wrong
    begin_s = context.session.since_start_s(start_ns)
    if value is None:
        return f"From {begin_s:.1f} s on there is no report on a whole plateau."
    shown, wanted = apart(value, right, places=4), apart(right, value, places=4)
    return f"At {begin_s:.1f} s it reports {shown}; right is {wanted}."


def _other_series(context: Context, p: ReportedSeries, heard: Sequence[Report]) -> Alternative | None:
    """Return the alternative that fits all that was reported."""
    for other in p.alternatives:
        spans = spans_of(context, p, other.parameters)
        seen = _Seen.of(heard, spans, p)
        if spans and 2 * seen.right >= len(spans) and seen.right + seen.silent + seen.left_out == len(spans):
            return other
    return None


def _ended_ns(context: Context, artifact: str) -> int | None:
    """Return when the artifact's last process ended without having been told to, None if it did not."""
    processes = context.session.processes_of(artifact)
    run = processes[-1] if processes else None
    return run.exited_ns if run is not None and run.interrupted_ns is None and run.ended_by != "kill" else None


def _inside(heard: Sequence[Report], span: Mapping[str, Any], settle_s: float) -> list[Report]:
    settle_ns = settle_s * 1e9
    return [r for r in heard if span["start_ns"] + settle_ns <= r.t_ns <= span["end_ns"] - settle_ns]


def _formula(ratios: Sequence[float], spans: int, context: Context, p: Streams) -> str:
    """Recognise a wrong formula by a constant ratio to the right values."""
    if len(ratios) < max(2, spans // 2) or not np.ptp(ratios) <= 0.02 * abs(np.mean(ratios)):
        return ""
    streams = context.streams(p.streams, p.field)
    count = next(iter(streams.values())).values.shape[1]
    ratio = float(np.mean(ratios))
    if abs(ratio / np.sqrt(count) - 1) < 0.02:
        root = f"the root of {count}: the sum was taken where the mean belongs"
        return f" It is always {ratio:.2f} times the right value, {root}."
    if abs(ratio * np.sqrt(count) - 1) < 0.02:
        return f" It is always {ratio:.2f} times the right value: divide by {count} under the root, not after it."
    if abs(ratio / np.degrees(1) - 1) < 0.02:
        return f" It is always {ratio:.2f} times the right value: it is in degrees, not in rad."
    return f" It is always {ratio:.2f} times the right value."


class Shorter(Parameters):
    """Another session, in which a node that also needs fewer messages prints its numbers too."""

    session: ref.SessionId
    least: int = Field(description="Messages from which there must be numbers.")
    most: int = Field(description="With so many messages it would be no shorter run.")
    credit: float = Field(0.5, ge=0, le=1, description="Credit of a node that prints nothing there.")


class ReportedStatistics(Streams):
    """A vector printed behind a label agrees with an oracle's bounds."""

    label: str
    synonyms: tuple[str, ...] = Field((), description="Other words for the label, tried in this order after it.")
    unless: Pattern | None = Field(None, description="Found before the numbers, it tells that they are of another.")
    key: str = Field(description="Key in the oracle's answer.")
    length: int
    tolerance: float = Field(0.001, description="Absolute; 1 % of the value, and what rounding makes, are allowed too.")
    alternatives: tuple[Alternative, ...] = ()
    report_pattern: Patterns = Field((), description="The node's report on each message, to see whether it lost any.")
    shorter: Shorter | None = None
    full_from: Share = Field(
        0.5, description="Share of the messages from which numbers over those alone that the node reports earn all."
    )


def reported_statistics(context: Context, p: ReportedStatistics) -> Finding:
    """Judge a printed vector, element by element; known mistakes are named."""
    expected = f"{p.length} numbers behind '{p.label}:' at Ctrl-C, agreeing with the recording"
    streams = context.streams(p.streams, p.field)
    if len(streams) < len(p.streams):
        return _no_stimulus(expected)
    processes = context.session.processes_of(p.artifact)
    stopped_ns = processes[-1].interrupted_ns if processes else None
    printed = _printed(p, context.session.output_of(p.artifact), stopped_ns)
    if printed is None:
        return _nothing_printed(context, p, expected)
    finding = _judge_vector(context, p, streams, printed, expected)
    if finding.outcome is Outcome.PASSED and p.shorter is not None and (reason := _silent_when_shorter(context, p)):
        return graded(p.shorter.credit, expected, finding.measured, reason, where=finding.where, notes=finding.notes)
    return finding


def _printed(p: ReportedStatistics, output: Sequence[OutputLine], stopped_ns: int | None) -> PrintedVector | None:
    return printed_vector(output, (p.label, *p.synonyms), stopped_ns, p.unless)


def _vectors(values: Sequence[float], right: Sequence[float], places: int) -> tuple[str, str]:
    shown, wanted = (" ".join(f"{x:.{places}f}" for x in numbers) for numbers in (values, right))
    return f"[{shown}]", f"[{wanted}]"


_OTHER_FORMS = {
    "table": "{0} is printed in a table; the lab asks for a line '{0}: [...]'.",
    "lines": "{0} is printed in a line for each element; the lab asks for one line '{0}: [...]'.",
}


def _judge_vector(
    context: Context, p: ReportedStatistics, streams: Mapping[str, Any], printed: PrintedVector, expected: str
) -> Finding:
    spot = context.output_of(p.artifact)
    notes = [_OTHER_FORMS[printed.form].format(p.label)] if printed.form in _OTHER_FORMS else []
    right = context.oracle(p.oracle)(streams, p.parameters, context.session.record.seed)[p.key]["value"]
    # Numbers that lose points do not read as the right ones.
    share = _agreement(context, p, streams, {}, printed)
    texts = [_vectors(printed.values[: p.length], right, places) for places in range(4, 10)]
    measured, right_text = next((pair for pair in texts if share < 1 and pair[0] != pair[1]), texts[0])
    expected = f"{right_text} from the recording, behind '{p.label}:' at Ctrl-C"
    if share >= 1:
        return passed(expected, measured, where=(spot,), notes=notes)
    heard = _reports_of_some(context, p) if len(printed.values) == p.length else []
    over_heard = [f"{p.label}: judged over the {len(heard)} messages that the node reported; it lost the others."]
    fits_heard = bool(heard) and _agreement(context, p, streams, {"reports": heard}, printed) >= 1
    # After a loss a right history reaches back further, so that it may look like one that is too long.
    of_all = len(heard) / _comparable(context, p) / p.full_from
    if fits_heard and of_all >= 1:
        return passed(expected, measured, where=(spot,), notes=[*notes, *over_heard])
    for other in p.alternatives:
        if _agreement(context, p, streams, other.parameters, printed) >= 1:
            return other.finding(context, expected, measured, where=(spot,), notes=notes)
    if fits_heard:
        reason = (
            f"These numbers fit the {len(heard)} messages alone on which the node reported; it left out the others."
        )
        best = of_all + _messages_during_delay(context, p) / _comparable(context, p) / p.full_from
        return measured_share(of_all, best, expected, measured, reason, _late(context, p), where=(spot,))
    if heard and (late := _starved(context, p)):
        return inconclusive(expected, measured, late, where=(spot,))
    reason = f"Right would be {right_text}."
    if len(printed.values) != p.length:
        count = len(printed.values)
        amount = "One number is" if count == 1 else f"{count} numbers are"
        reason = f"{amount} printed, not one for each of {p.length}. " + reason
        share = 0.0
    return graded(share, expected, measured, reason, where=(spot,), notes=notes)


def _silent_when_shorter(context: Context, p: ReportedStatistics) -> str:
    """Say that the node printed no numbers after a run with fewer messages, if it ran, and ended as it should."""
    assert p.shorter is not None
    other = context.sessions.get(p.shorter.session)
    for run in other.record.processes if other is not None else ():
        each = (sum(search(one, line.text[:2000]) is not None for line in run.output) for one in p.report_pattern)
        count = next(filter(None, each), 0)
        if run.role != "student" or not p.shorter.least <= count <= p.shorter.most:
            continue
        chance = any("KeyboardInterrupt" in o.text or _HIT_IN_A_CALL in o.text for o in run.output)
        if run.ended_by != "interrupt" or run.output_dropped_bytes or chance:
            continue
        if _printed(p, run.output, run.interrupted_ns) is None:
            return (
                f"In the session '{p.shorter.session}' it was stopped after {count} reports, and printed no "
                f"'{p.label}: [...]'; {p.shorter.least} are enough."
            )
    return ""


#: What pybind11 says when a signal's exception strikes while it converts an argument.
_HIT_IN_A_CALL = "RuntimeError: Unable to convert call argument"


def _nothing_printed(context: Context, p: ReportedStatistics, expected: str) -> Finding:
    processes = context.session.processes_of(p.artifact)
    spot = context.output_of(p.artifact)
    if any(_HIT_IN_A_CALL in line.text for process in processes[-1:] for line in process.output):
        late = "Ctrl-C came in the midst of a call into rclpy, which made another error of it; that is chance."
        return unclear(expected, "nothing", late, where=(spot,))
    if processes and processes[-1].interrupted_ns and processes[-1].ended_by in ("terminate", "kill"):
        if context.session.record.times_recorded == 1:  # Correct nodes were seen to hang once in a while, too.
            reason = "The node did not end after Ctrl-C. Once is no proof."
            return inconclusive(expected, "nothing", reason, where=(spot,))
        reason = "After Ctrl-C the node did not end in time, and had to be stopped before it printed statistics."
        return failed(
            expected,
            "nothing",
            reason,
            hint="Let KeyboardInterrupt end rclpy.spin, then print.",
            where=(spot,),
        )
    nothing = f"Nothing of the form '{p.label}: [...]' was printed after Ctrl-C."
    hint = f"Catch KeyboardInterrupt around rclpy.spin(node), and print '{p.label}: [...]' after it."
    if (end_ns := _ended_ns(context, p.artifact)) is not None and (found := context.diagnosis(p.artifact)) is not None:
        when = f"The node ended by itself at {context.session.since_start_s(end_ns):.1f} s, before Ctrl-C."
        spots = (Where(file=found.file, line=found.line),) if found.file else (spot,)
        return failed(expected, "nothing", f"{when} {told(found)}", hint=found.remedy, where=spots)
    if (mismatch := _deaf(context, p)) is not None:
        return failed(expected, "nothing", f"{nothing} {mismatch}", hint=_DEAF_HINT, where=(spot,))
    if last := _last_words(processes):
        nothing += f" What was printed then begins with: {last!r}"
        hint = f"Print a line '{p.label}: ' with all {p.length} numbers behind it, as numpy prints an array."
    reason, remedy, where = why_nothing(context, p.artifact, nothing)
    return failed(expected, "nothing", reason, hint=remedy or hint, where=where)


_DEAF_HINT = "Subscribe with the right type; then the rest follows."


def _deaf(context: Context, p: Streams) -> str | None:
    """Say that the node could not hear a topic since it asked for another type, if so."""
    for topic in p.streams.values():
        kinds = {e.type for e in student_endpoints(context, topic, "subscription")}
        sent = context.session.stream(topic).topic_type
        if kinds and sent and sent not in kinds:
            return f"No message reached it on {context.session.used(topic)}, where it asks for {min(kinds)}."
    return None


def _last_words(processes: Sequence[ProcessRun]) -> str:
    """Return the first line with a number that the last process printed after it was interrupted."""
    until_ns = processes[-1].interrupted_ns if processes else None
    if until_ns is None:
        return ""
    lines = (o.text.strip() for o in processes[-1].output if o.t_ns >= until_ns and o.stream == "stdout")
    return next((line[:80] for line in lines if re.search(r"\d\.\d", line)), "")


def _agreement(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, Any],
    other: Mapping[str, Any],
    printed: PrintedVector,
) -> float:
    """Return the share of elements that lie within the oracle's bounds."""
    right = context.oracle(p.oracle)(streams, {**p.parameters, **other}, context.session.record.seed).get(p.key)
    if right is None or len(printed.values) != len(right["value"]):
        return 0.0
    slack = [max(p.tolerance, 0.01 * abs(v), 1.01 * printed.rounding) for v in right["value"]]
    bounds = zip(printed.values, right["low"], right["high"], slack, strict=True)
    right_ones: list[bool] = [low - s <= x <= high + s for x, low, high, s in bounds]
    return sum(right_ones) / len(printed.values)


def _messages_during_delay(context: Context, p: Streams) -> float:
    """Return how many messages came while the node was ready but had no core: those it may have lost by that.

    While its queue has room, nothing is lost.
    """
    streams = context.streams(p.streams, p.field).values()
    most = max(streams, key=lambda s: len(s.source_ns))
    span = Span(int(most.source_ns[0]), int(most.source_ns[-1]))
    rate_hz = len(most.source_ns) / max(span.duration_s, 1e-9)
    room = _queue_room(context, p)
    run = context.session.processes_of(p.artifact)[-1]
    return rate_hz * context.session.long_delays_s(run, span, room / rate_hz)


def _queue_room(context: Context, p: Streams) -> int:
    """Return how many messages may wait besides the one that is next, by what the node asked for."""
    asked = [claimed_qos(context, "subscription", t)[0] for t in p.streams.values()]
    return max(0, min((qos.depth if qos is not None else 1) for qos in asked) - 1)


#: Share of a time for which a process was kept from a core, from which it may have lost messages by that.
_STARVED_SHARE = 0.03


def _starved(context: Context, p: Streams) -> str:
    """Say that the machine kept the node from a core while messages came, if it did; one that ended did not wait."""
    if _ended_ns(context, p.artifact) is not None:
        return ""
    delay_s, length_s = _delay_s(context, p)
    return _late(context, p) if delay_s >= _STARVED_SHARE * length_s else ""


#: Share of a span without a report for which the machine kept the node from a core, if it is to blame for all of that.
_HELD_UP_SHARE = 0.5


def _is_held_up(context: Context, p: Streams, span: Mapping[str, Any]) -> bool:
    """Whether the machine may have kept the node from all reports within a span; one that ended did not wait."""
    if _ended_ns(context, p.artifact) is not None:
        return False
    whole, run = Span(span["start_ns"], span["end_ns"]), context.session.processes_of(p.artifact)[-1]
    return context.session.machine_delay_s(run, whole) >= _HELD_UP_SHARE * whole.duration_s


#: So long the grader may stand still without reading a report at another value than that for which it was printed.
_READ_LATE_S = 0.3


def _read_late(context: Context, p: Streams) -> str:
    """Say that the grader stood still while messages came, if it did, so that it read the output too late."""
    span = _stimulus(context, p)
    run = context.session.processes_of(p.artifact)[-1]
    stalled_s = context.session.stalled_s(span) if span is not None else 0.0
    if stalled_s <= _READ_LATE_S or run.limit is not None or run.output_dropped_bytes:
        return ""
    return f"The grader stood still for {stalled_s:.2f} s while messages came, and read too late what was printed."


def _late(context: Context, p: Streams) -> str:
    delay_s, length_s = _delay_s(context, p)
    return kept_from_core(delay_s, length_s)


def _delay_s(context: Context, p: Streams) -> tuple[float, float]:
    """Return for how long the node was ready but had no core while messages came, and how long they came."""
    span, processes = _stimulus(context, p), context.session.processes_of(p.artifact)
    if span is None or not processes:
        return 0.0, 0.0
    return context.session.machine_delay_s(processes[-1], span), span.duration_s


def _stimulus(context: Context, p: Streams) -> Span | None:
    """Return the time in which messages came."""
    streams = context.streams(p.streams, p.field).values()
    if not streams:
        return None
    return Span(min(int(s.source_ns[0]) for s in streams), max(int(s.source_ns[-1]) for s in streams))


def _reports_of_some(context: Context, p: ReportedStatistics) -> list[tuple[int, float]]:
    """Return the node's reports if they are clearly fewer than the messages: some may never have reached it."""
    heard = reports(context.session, p.artifact, p.report_pattern) if p.report_pattern else []
    heard = _without_repeats(context, p, heard)
    if len(heard) >= 0.99 * _comparable(context, p):
        return []
    return [(r.t_ns, r.value) for r in heard]


def _comparable(context: Context, p: ReportedStatistics) -> int:
    """Return the number of messages for which there is something to compare with."""
    streams = context.streams(p.streams, p.field)
    begun_ns = max(int(s.source_ns[0]) for s in streams.values())
    return max(int((s.source_ns >= begun_ns).sum()) for s in streams.values())


class Survives(Parameters):
    """A process is still alive after a step that tests its nerves."""

    artifact: ref.Artifact
    step: ref.AnyStep
    until: ref.AnyStep | None = Field(None, description="A later step; what ends after that one's start has survived.")
    quiet: Patterns = Field((), description="A report that cannot be made yet, before the later step starts.")
    quiet_credit: float = Field(0.5, ge=0, le=1, description="Credit of a node that makes it all the same.")


def survives(context: Context, p: Survives) -> Finding:
    """Judge whether the artifact's first process outlived the step, and the node in it.

    A program that starts its node again has not kept it from ending.
    """
    expected = "the node goes on"
    step = context.session.step(p.step)
    processes = context.session.processes_of(p.artifact)
    if step is None or not processes or step.outcome == "failed":
        return inconclusive(expected, "the step was not reached", "The recording does not show what the node did then.")
    first = processes[0]
    spot = context.output_of(p.artifact)
    later = context.session.step(p.until) if p.until is not None else None
    second_start_ns = processes[1].started_ns if len(processes) > 1 else 2**63
    second_start_ns = min(second_start_ns, later.started_ns) if later is not None else second_start_ns
    if first.exited_ns is None or first.interrupted_ns is not None or first.exited_ns > second_start_ns:
        if _never_matched(context, step):
            return unclear(expected, "it went on", _UNMATCHED, where=(spot,))
        if (replaced_ns := _replaced_ns(context, step, second_start_ns)) is not None:
            reason, hint, where = why_nothing(context, p.artifact, _REPLACED)
            measured = f"the program went on; its node ended before {context.session.since_start_s(replaced_ns):.2f} s"
            return failed(expected, measured, reason, hint=hint, where=where)
        return _early_report(context, p, step, later) or passed(expected, "it went on", where=(spot,))
    reason, hint, where = why_nothing(context, p.artifact, "The node ended.")
    measured = f"it ended with status {first.exit_status} at {context.session.since_start_s(first.exited_ns):.2f} s"
    return failed(expected, measured, reason, hint=hint, where=where)


def _replaced_ns(context: Context, step: StepRun, until_ns: int) -> int | None:
    """Return when what subscribed to a step's topic was first seen gone, or the same node to have subscribed anew."""
    nodes = {e.gid: e.node for e in student_endpoints(context, str(step.parameters.get("topic")), "subscription")}
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


_REPLACED = "The node ended, and the program went on without it or started it again; messages are lost meanwhile."
_UNMATCHED = "The subscription was not matched in time, so that the node may not have got what was sent."


def _never_matched(context: Context, step: StepRun) -> bool:
    """Whether a step published what no subscription was there for, although the student's could have taken it."""
    topic, sent = str(step.parameters.get("topic", "")), step.parameters.get("type")
    requests = student_endpoints(context, topic, "subscription") if step.kind == "publish" else ()
    fitting = [e for e in requests if e.type == sent and clash(e, OfferedProfile(durability="transient_local")) is None]
    return step.result.get("matched") is False and bool(fitting) and len(fitting) == len(requests)


def _early_report(context: Context, p: Survives, step: StepRun, later: StepRun | None) -> Finding | None:
    """State that a node reported on messages with which nothing could be compared yet, None if it did not."""
    if later is None:
        return None
    heard = reports(context.session, p.artifact, p.quiet)
    # A line that says why there is no report yet may hold the same word, and a number.
    lead_ins = {r.lead_in for r in heard if r.t_ns >= later.started_ns}
    early = [r for r in heard if step.started_ns <= r.t_ns < later.started_ns and r.lead_in in lead_ins]
    if not early:
        return None
    when_s = context.session.since_start_s(early[0].t_ns)
    reason = f"At {when_s:.1f} s it reports {early[0].value:g}, when there is nothing yet to compare with."
    spot = context.output_of(p.artifact)
    measured = f"it went on, with {len(early)} report{'s' if len(early) > 1 else ''} too early"
    return graded(p.quiet_credit, "the node goes on, and reports nothing", measured, reason, where=(spot,))


class ReportShare(Streams):
    """A node reports for a share of the messages for which it could."""

    pattern: Patterns
    full_from: Share = 0.9


_NEVER_NS = 2**63 - 1
_TOO_MUCH = ", as far as its output is kept: it printed more"


def _kept_until_ns(context: Context, artifact: str) -> int:
    """Return up to when an artifact's output was kept."""
    last = context.session.processes_of(artifact)[-1:]
    full = [run for run in last if run.output_dropped_bytes and run.output]
    return full[0].output[-1].t_ns if full else _NEVER_NS


def report_share(context: Context, p: ReportShare) -> Finding:
    """Judge the number of reports against the oracle's count."""
    streams = context.streams(p.streams, p.field)
    expected = f"a report for at least {percent(p.full_from)} of the messages"
    if len(streams) < len(p.streams):
        return _no_stimulus(expected)
    until_ns = _kept_until_ns(context, p.artifact)
    streams = {role: stream.until(until_ns) for role, stream in streams.items()}
    possible = int(context.oracle(p.oracle)(streams, p.parameters, context.session.record.seed))
    lines = reports(context.session, p.artifact, p.pattern)
    if not lines:
        return not_reached("There is no report at all, as said above.", expected=expected)
    heard = len(_without_repeats(context, p, lines))
    repeats = f", and {len(lines) - heard} that repeat one" if heard < len(lines) else ""
    measured = f"{heard} reports{repeats} for {possible} messages" + (_TOO_MUCH if until_ns < _NEVER_NS else "")
    spot = context.output_of(p.artifact)
    share, best = (n / max(1, possible) / p.full_from for n in (heard, heard + _messages_during_delay(context, p)))
    reason = f"Only {heard} of {possible} messages led to a report."
    late = _late(context, p)
    return measured_share(share, best, expected, measured, reason, late, where=(spot,))


#: After so many intervals without a message, those that follow come with another value.
_SILENT_INTERVALS = 5


def _without_repeats(context: Context, p: Streams, heard: Sequence[Report]) -> list[Report]:
    """Return the reports without lines that say again what the one before said.

    A node that fell behind reports on several messages at once, and may say the same of each. But of messages that
    came together after a silence it cannot say more than came until then. Where more is said than the time in which
    the grader stood still explains, lines are repeated: those that follow each other faster than messages count once.
    """
    streams = context.streams(p.streams, p.field).values()
    begun_ns = max((int(stream.source_ns[0]) for stream in streams), default=0)
    sent = max((s.source_ns[s.source_ns >= begun_ns] for s in streams), key=len, default=np.array([], dtype=np.int64))
    if len(sent) < 2:
        return list(heard)
    interval_ns = float(np.median(np.diff(sent)))
    starts = sent[np.concatenate(([True], np.diff(sent) > _SILENT_INTERVALS * interval_ns))]
    surplus = most = said = first = 0
    before: Report | None = None
    kept: list[Report] = []
    for report in sorted((r for r in heard if r.t_ns >= begun_ns), key=lambda report: report.t_ns):
        came = int(np.searchsorted(sent, report.t_ns, side="right"))
        if before is None or not np.isclose(report.value, before.value, rtol=_ALIKE):
            surplus, most, said = surplus + most, 0, 0
            first = int(np.searchsorted(sent, starts[starts <= report.t_ns][-1]))
        said += 1
        most = max(most, said - (came - first))
        if not said > 1 or before is None or report.t_ns - before.t_ns > interval_ns / 2:
            kept.append(report)
        before = report
    stalled_s = context.session.stalled_s(Span(int(sent[0]), int(sent[-1])))
    return kept if surplus + most > stalled_s * 1e9 / interval_ns else list(heard)


#: Values that differ by less are taken for one.
_ALIKE = 0.01
