"""Checks of a tool that compares QoS profiles: it ends by itself, its profiles, and whether its numbers are true."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field, field_validator

from grader.checks.finding import (
    Context,
    Parameters,
    Share,
    failed,
    graded,
    inconclusive,
    missing_artifact,
    passed,
    why_nothing,
)
from grader.checks.traffic import claimed_qos, student_endpoints
from grader.evidence.calls import rclpy_calls
from grader.evidence.printed import text_of
from grader.evidence.recorded import Floats, Span, machine_delay_s
from grader.evidence.timing import timing_of
from grader.recording.session import Qos
from grader.result import Finding, Where


class EndsByItself(Parameters):
    """A process ends by itself in time, without an error, and has said something."""

    artifact: str
    step: str = Field(description="Label of the wait_exit step.")
    least_s: float
    most_s: float
    output: str = Field(description="Regular expression that its output matches.")


def ends_by_itself(context: Context, p: EndsByItself) -> Finding:
    """Judge the end of the artifact's process: half for ending well, half for its results."""
    expected = f"ends by itself after {p.least_s:g} to {p.most_s:g} s, with its results printed"
    if (missing := missing_artifact(context, p.artifact, expected)) is not None:
        return missing
    processes = context.session.processes_of(p.artifact)
    if not processes:
        return inconclusive(expected, "not started", "The recording does not show the program.")
    run = processes[-1]
    spot = Where(session=context.session.record.session, process=p.artifact)
    said = re.search(p.output, text_of(run.output)) is not None
    ran_s = ((run.exited_ns or context.session.record.ended_ns) - run.started_ns) / 1e9
    if run.interrupted_ns is not None or run.ended_by != "itself":
        stopped_s = ((run.interrupted_ns or run.started_ns) - run.started_ns) / 1e9
        reason = f"It was still running after {stopped_s:.0f} s and had to be stopped."
        return graded(
            0.5 if said else 0.0,
            expected,
            "had to be stopped",
            reason,
            hint="End rclpy.spin after 10 s: count the time in a timer, or spin_once in a loop.",
            where=(spot,),
        )
    measured = f"ended after {ran_s:.1f} s with status {run.exit_status}" + ("" if said else ", no results")
    if said and ran_s >= p.least_s:
        return passed(
            expected,
            measured,
            where=(spot,),
            notes=() if run.exit_status == 0 else (f"Its exit status is {run.exit_status}.",),
        )
    reason, hint, where = why_nothing(context, p.artifact, "It ended without results.")
    if said:
        return graded(0.5, expected, measured, f"It ended after {ran_s:.1f} s already.", where=(spot,))
    return failed(expected, measured, reason, hint=hint, where=where)


class TopicsCarryTraffic(Parameters):
    """Messages flow on each topic; each is a part."""

    topics: tuple[str, ...]
    least_messages: int = 1


def topics_carry_traffic(context: Context, p: TopicsCarryTraffic) -> Finding:
    """Judge the number of messages by the publishers' sequence numbers."""
    counts = {t: _written(context, t) for t in p.topics}
    silent = [t for t, n in counts.items() if n < p.least_messages]
    expected = f"at least {p.least_messages} messages on each of {', '.join(p.topics)}"
    measured = ", ".join(f"{t} {n}" for t, n in counts.items())
    reason = f"Too little came on {', '.join(silent)}."
    return graded(1 - len(silent) / len(p.topics), expected, measured, reason, where=(context.where(),))


def _written(context: Context, topic: str) -> int:
    sequence = context.session.stream(topic).sequence
    return int(sequence.max()) if len(sequence) else 0


class WantedProfile(Parameters):
    """The QoS profile of a topic's publisher and subscription."""

    topic: str
    reliability: str
    durability: str
    history: str
    depth: int


class QosProfiles(Parameters):
    """Publisher and subscription of each topic have the profile; every policy of every profile is a part."""

    artifact: str
    profiles: tuple[WantedProfile, ...]


def qos_profiles(context: Context, p: QosProfiles) -> Finding:
    """Judge reliability and durability from discovery, history and depth from the source."""
    parts: list[float] = []
    reasons, texts, spots = [], [], []
    for wanted in p.profiles:
        sides = {k: student_endpoints(context, wanted.topic, k) for k in ("publisher", "subscription")}
        seen = [e.qos for endpoints in sides.values() for e in endpoints]
        claims = [c for k in sides if (c := _claim(context, p.artifact, k, wanted.topic))[0] is not None]
        lacking = [k for k, endpoints in sides.items() if not endpoints]
        if lacking:
            reasons.append(f"There is no {' and no '.join(lacking)} on {wanted.topic}.")
        missing_share = len(lacking) / 2
        for policy in ("reliability", "durability", "history", "depth"):
            source = seen if policy in ("reliability", "durability") else [c for c, _ in claims if c is not None]
            share, reason = _judge_policy(wanted, policy, source)
            parts.append(share * (1 - missing_share))
            reasons += [reason] if reason and seen else []
            if reason:
                spots += [w for _, w in claims if w is not None][:1]
        texts.append(_shown(wanted.topic, seen, [c for c, _ in claims if c is not None]))
    expected = "; ".join(f"{w.topic}: {w.reliability}, {w.history} {w.depth}, {w.durability}" for w in p.profiles)
    where = (*dict.fromkeys(spots), context.where())
    return graded(sum(parts) / len(parts), expected, "; ".join(texts), " ".join(reasons), where=where)


def _judge_policy(wanted: WantedProfile, policy: str, source: Sequence[Qos]) -> tuple[float, str]:
    value = getattr(wanted, policy)
    got = [getattr(qos, policy) for qos in source]
    wrong = [g for g in got if g != value]
    if not got:
        # Nobody says: neither tap nor source. What cannot be known is not charged if the endpoint is there.
        return 1.0, ""
    if not wrong:
        return 1.0, ""
    return 1 - len(wrong) / len(got), f"{wanted.topic} has {policy} {wrong[0]}, not {value}."


def _claim(context: Context, artifact: str, kind: str, topic: str) -> tuple[Qos | None, Where | None]:
    """Return what the node asked for, by the tap, or else by its source."""
    qos, spot = claimed_qos(context, kind, context.session.used(topic))
    if qos is not None:
        return qos, spot
    path = context.path_of(artifact) or ""
    for call in rclpy_calls(context.submission.texts.get(path, "")):
        if (
            call.kind == kind
            and call.name is not None
            and call.name.strip("/") == topic.strip("/")
            and call.qos is not None
        ):
            known = {k: v for k, v in call.qos.items() if k in ("history", "depth", "reliability", "durability")}
            return Qos(**known), Where(file=path, line=call.line)  # type: ignore[arg-type]
    return None, None


def _shown(topic: str, seen: Sequence[Qos], claims: Sequence[Qos]) -> str:
    if not seen:
        return f"{topic}: nothing"
    history = f"{claims[0].history} {claims[0].depth}" if claims else "history unknown"
    return f"{topic}: {seen[0].reliability}, {history}, {seen[0].durability}"


class Row(Parameters):
    """The line that reports on a topic: the one that begins with the name."""

    name: str
    topic: str


class ReportedTraffic(Parameters):
    """Reported counts and latencies agree with what was recorded; each row is a part."""

    artifact: str
    rows: tuple[Row, ...]
    pattern: str = Field(description="Regular expression with groups count, mean_ms and max_ms.")
    count_tolerance: Share = 0.02
    latency_factor: float = Field(
        4, description="The reported mean may be above the recorded one, or below its least, by this factor."
    )
    latency_slack_s: float = Field(0.004, description="It may be above the recorded one by this much in any case.")

    @field_validator("pattern")
    @classmethod
    def _compiles(cls, value: str) -> str:
        groups = re.compile(value).groupindex
        if not {"count", "mean_ms", "max_ms"} <= set(groups):
            raise ValueError("the groups count, mean_ms and max_ms are needed")
        return value


def reported_traffic(context: Context, p: ReportedTraffic) -> Finding:
    """Judge each row: half for the count, half for the latency."""
    lines = [line.text for line in context.session.output_of(p.artifact)]
    parts, reasons, texts = [], [], []
    for row in p.rows:
        match = next((m for line in lines if _begins(line, row.name) and (m := re.search(p.pattern, line))), None)
        if match is None:
            parts.append(0.0)
            reasons.append(f"There is no line with count and latency for {row.name}.")
            continue
        share, text, reason = _judge_row(context, p, row, match.groupdict())
        parts.append(share)
        texts.append(text)
        reasons += [reason] if reason else []
    expected = f"for each profile the messages delivered (± {p.count_tolerance:.0%}) and a latency that can be"
    spot = Where(session=context.session.record.session, process=p.artifact)
    return graded(sum(parts) / len(parts), expected, "; ".join(texts) or "no results", " ".join(reasons), where=(spot,))


def _begins(line: str, name: str) -> bool:
    """Whether a line is about a profile: its name stands in it as a word of its own."""
    return re.search(rf"(?<![A-Za-z0-9_]){re.escape(name)}(?![A-Za-z0-9_])", line.replace("test_", "")) is not None


def _judge_row(context: Context, p: ReportedTraffic, row: Row, got: Mapping[str, str]) -> tuple[float, str, str]:
    """Judge a row: half for the count, half for the latency; numbers that cannot be are worth nothing together."""
    count, mean_s, max_s = int(got["count"]), float(got["mean_ms"]) / 1e3, float(got["max_ms"]) / 1e3
    written = _written(context, row.topic)
    text = f"{row.name} {count} of {written}, {mean_s * 1e3:.2f} ms"
    if not student_endpoints(context, row.topic, "subscription"):
        return 0.0, text, f"{row.name} reports {count} messages, but nothing subscribes to {row.topic}."
    slack = max(3.0, p.count_tolerance * written)
    if not written - slack - _overwritten(context, p, row) <= count <= written + slack:
        return 0.0, text, f"{row.name} reports {count} messages; {written} were published."
    problem = _latency_problem(context, p, row, mean_s, max_s)
    return (0.5, text, problem) if problem else (1.0, text, "")


def _overwritten(context: Context, p: ReportedTraffic, row: Row) -> float:
    """Return how many messages may have been overwritten in a short queue while the machine held the tool up."""
    timing = timing_of(context.session.stream(row.topic), None)
    run = context.session.process(p.artifact)
    if timing is None or run is None:
        return 0.0
    span = Span(run.started_ns, run.exited_ns or context.session.record.ended_ns)
    return timing.rate_hz * machine_delay_s(run, span)


def _latency_problem(context: Context, p: ReportedTraffic, row: Row, mean_s: float, max_s: float) -> str:
    """Say why a reported latency cannot be, or nothing.

    Nothing is delivered much sooner than the soonest that was recorded; later is a matter of the machine.
    """
    latencies = _latencies_s(context, row.topic)
    if not len(latencies):
        return ""
    truth_s = float(np.mean(latencies))
    least_s = float(np.min(latencies)) / p.latency_factor
    most_s = max(truth_s * p.latency_factor, truth_s + p.latency_slack_s)
    if least_s <= mean_s <= most_s and mean_s <= max_s + 1e-5:
        return ""
    reported = f"{row.name} reports a mean latency of {mean_s * 1e3:.2f} ms (max {max_s * 1e3:.2f} ms)"
    return f"{reported}; recorded was {truth_s * 1e3:.2f} ms."


def _latencies_s(context: Context, topic: str) -> Floats:
    stream = context.session.stream(topic)
    return (stream.received_ns - stream.source_ns) / 1e9
