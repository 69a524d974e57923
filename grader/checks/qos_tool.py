"""Checks of a tool that compares QoS profiles: it ends by itself, its profiles, and whether its numbers are true."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field, field_validator

from grader.checks.base import (
    Context,
    Part,
    apart,
    cpu_delay_doubt,
    failed,
    graded,
    inconclusive,
    not_reached,
    of_parts,
    percent,
    quantise,
    unclear,
    undecided,
    unexplained,
    without_delay,
)
from grader.checks.endpoints import claim_of, claimed_at, clash, student_endpoints
from grader.evidence.cpu_delay import Span, clipped
from grader.evidence.flakiness import flaky_end
from grader.evidence.recorded import Floats, clock_step_s
from grader.evidence.text.result_rows import (
    LINE_LIMIT,
    ResultRow,
    lines_naming,
    plain_numbers,
    result_row,
    rounding_of,
)
from grader.lab import references as ref
from grader.lab.patterns import compiled, search
from grader.lab.references import Parameters, Pattern, Share
from grader.recording.session import OutputLine, ProcessRun, Qos
from grader.result import Finding, Location, Outcome


class EndsByItself(Parameters):
    """A process ends by itself in time, without an error, and has said something."""

    artifact: ref.Artifact
    step: ref.ExitLabel = Field(description="Label of the wait_exit step.")
    least_s: float
    most_s: float
    output: Pattern = Field(description="Regular expression that its output matches.")
    half_credit: Share = Field(
        0.5,
        description="Credit for results without an end in time, or an end in time without results.",
    )


def ends_by_itself(context: Context, p: EndsByItself) -> Finding:
    """Judge the end of the artifact's process: half for ending well, half for its results."""
    expected = f"ends by itself after {p.least_s:g} to {p.most_s:g} s, with its results printed"
    processes = context.session.processes_of(p.artifact)
    if not processes:
        return inconclusive(expected, "not started", "The recording does not show the program.")
    run = processes[-1]
    printed = _without_tracebacks(run.output)
    claimed = search(p.output, printed) is not None
    half = p.half_credit if claimed else 0.0
    if not claimed and run.ended_by == "interrupt" and (flaky := flaky_end(run)):
        return unclear(expected, "no results", flaky)
    if run.interrupted_ns is not None or run.ended_by != "itself":
        stopped_s = ((run.interrupted_ns or run.started_ns) - run.started_ns) / 1e9
        reason = f"It was still running after {stopped_s:.0f} s and had to be stopped."
        hint = "End rclpy.spin after 10 s: count the time in a timer, or spin_once in a loop."
        return graded(half, expected, "had to be stopped", reason, hint=hint)
    ran_s = ((run.exited_ns or context.session.record.ended_ns) - run.started_ns) / 1e9
    shown_s = apart(ran_s, p.least_s, places=1)
    measured = f"ended after {shown_s} s with status {run.exit_status}" + (
        "" if claimed else ", no results"
    )
    if claimed:
        reason = f"It ended after {shown_s} s, which is too early."
        share = half if ran_s < p.least_s else 1.0
        note = "It does not end with exit status 0; stop executors and threads before rclpy.shutdown()."
        return graded(
            share, expected, measured, reason, notes=[] if run.exit_status == 0 else [note]
        )
    if run.exit_status == 0 and ran_s >= p.least_s:
        unread = bool(printed.strip())
        what = (
            "but nothing that it printed could be read as results"
            if unread
            else "and printed nothing"
        )
        hint = "Print the results before the program ends, with print() or the logger."
        return graded(
            p.half_credit * unread, expected, measured, f"It ended in time, {what}.", hint=hint
        )
    return unexplained(graded(0.0, expected, measured, "It ended without results."))


def _without_tracebacks(output: Sequence[OutputLine]) -> str:
    """Return what was printed without tracebacks, which quote the source."""
    kept: list[OutputLine] = []
    quoting: set[str] = set()  # streams; lines of the other may stand between those of a traceback
    for line in output:
        begins = line.text.startswith("Traceback (most recent call last)")
        if not begins and line.stream not in quoting:
            kept.append(line)
        elif begins or line.text.startswith(" "):
            quoting.add(line.stream)
        else:
            quoting.remove(line.stream)  # what is not indented is the message, the last line
    return "\n".join(line.text for line in kept)


class TopicsCarryTraffic(Parameters):
    """Messages are published and received on each topic; each is a part."""

    topics: tuple[ref.Topic, ...] = Field(min_length=1)
    least_messages: int = 1
    other_name_costs: Share = Field(
        0.5, description="Share of a topic's credit that another name costs."
    )
    unheard_credit: Share = Field(
        1.0, description="Credit of a topic from which no subscription of its own can hear."
    )


def topics_carry_traffic(context: Context, p: TopicsCarryTraffic) -> Finding:
    """Judge the number of messages by the publishers' sequence numbers; another name costs a part of a topic.

    Too few earn their share of it.
    """
    runs = [run for run in context.session.record.processes if run.role == "student"]
    delay_s, length_s = max((_delay_s(context, run) for run in runs), default=(0.0, 0.0))
    expected = f"at least {p.least_messages} messages on each of {', '.join(p.topics)}"
    parts = []
    for topic in p.topics:
        used, count = context.session.used(topic), _written(context, topic)
        renamed, few = bool(count) and used != topic, count < p.least_messages
        least, most = (
            quantise(n / p.least_messages) for n in (count, without_delay(count, delay_s, length_s))
        )
        unheard = _unheard(context, topic) if count else ""
        heard = p.unheard_credit if unheard else 1.0
        share, best = (
            max(0.0, min(1.0, each) - p.other_name_costs * renamed) * heard
            for each in (least, most)
        )
        reasons = [unheard] * bool(unheard)
        reasons += [f"Too few messages arrived on {topic}."] * few
        reasons += [f"{topic} is named {used}; the other checks use that name."] * renamed
        parts.append(Part(share, f"{used} {count}", " ".join(reasons), best))
    return of_parts(expected, parts, doubt=cpu_delay_doubt(delay_s, length_s))


def _unheard(context: Context, topic: str) -> str:
    """Say why nothing that is published on a topic can be received by the student's own side, or nothing."""
    offers, requests = (
        student_endpoints(context, topic, kind) for kind in ("publisher", "subscription")
    )
    if not requests:
        return f"Nothing subscribes to {topic}."
    policy = clash(requests[0], offers[0].qos) if offers else None
    return (
        f"The two sides of {topic} are incompatible in {policy}: none can arrive." if policy else ""
    )


def _delay_s(context: Context, run: ProcessRun) -> tuple[float, float]:
    """Return for how long the machine delayed a process, and how long it ran, in s."""
    span = _life(context, run)
    return context.session.machine_delay_s(run, span), span.duration_s


def _life(context: Context, run: ProcessRun) -> Span:
    return Span(run.started_ns, run.exited_ns or context.session.record.ended_ns)


def _written(context: Context, topic: str, until_ns: int | None = None) -> int:
    stream = context.session.stream(topic)
    sequence = (
        stream.sequence if until_ns is None else stream.sequence[stream.source_ns <= until_ns]
    )
    return int(sequence.max()) if len(sequence) else 0


class WantedProfile(Parameters):
    """The QoS profile of a topic's publisher and subscription."""

    topic: ref.Topic
    reliability: ref.Reliability
    durability: ref.Durability
    history: ref.History
    depth: int


class QosProfiles(Parameters):
    """Publisher and subscription of each topic have the profile; every policy of every profile is a part."""

    artifact: ref.Artifact
    profiles: tuple[WantedProfile, ...] = Field(min_length=1)
    one_sided_credit: Share = Field(
        0.5, description="Most of a profile's credit where a side of its topic is lacking."
    )
    alike_credit: Share = Field(
        1.0, description="Most of the credit where all profiles are one and the same."
    )


_POLICIES = ("reliability", "durability", "history", "depth")


@dataclass(frozen=True)
class _Side:
    """One side of a topic: what the graph shows of its QoS, and what the program asked rclpy for."""

    kind: str
    seen: tuple[Qos, ...]
    asked: Qos | None
    where: tuple[Location, ...]

    @classmethod
    def of(cls, context: Context, kind: str, topic: str) -> _Side:
        claim = claim_of(context, kind, topic)
        seen = tuple(e.qos for e in student_endpoints(context, topic, kind))
        return cls(kind, seen, claim.qos if claim is not None else None, claimed_at(claim))

    def values(self, policy: str) -> list[str | int | None]:
        """Return a policy's values: those on the wire as seen, those of the queue as asked for."""
        if policy in ("reliability", "durability"):
            return [getattr(qos, policy) for qos in self.seen]
        return [getattr(self.asked, policy)] if self.asked is not None else []

    def wrong(self, wanted: WantedProfile) -> str:
        """Say which policies are others than wanted, and how."""
        each = [(policy, value) for policy in _POLICIES for value in self.values(policy)]
        others = [(policy, value) for policy, value in each if value != getattr(wanted, policy)]
        return ", and ".join(
            f"{policy} {value}, not {getattr(wanted, policy)}" for policy, value in others
        )

    def __str__(self) -> str:
        history = (
            f"{self.asked.history} {self.asked.depth}"
            if self.asked is not None
            else "history unknown"
        )
        return (
            f"{self.seen[0].reliability}, {history}, {self.seen[0].durability}"
            if self.seen
            else "nothing"
        )


def qos_profiles(context: Context, p: QosProfiles) -> Finding:
    """Judge reliability and durability from discovery, history and depth from what the program asked rclpy for."""
    sides = {
        w: [_Side.of(context, kind, w.topic) for kind in ("publisher", "subscription")]
        for w in p.profiles
    }
    parts = [_judge_profile(wanted, each, p.one_sided_credit) for wanted, each in sides.items()]
    alike = (
        len(parts) > 1
        and len({str(side) for each in sides.values() for side in each if side.seen}) == 1
    )
    if alike and sum(part.share for part in parts) > p.alike_credit * len(parts):
        parts = [replace(part, share=p.alike_credit) for part in parts]
        reason = f"All topics have one and the same profile, so that nothing is compared. {parts[0].reason}"
        parts[0] = replace(parts[0], reason=reason.strip())
    finding = of_parts(
        "; ".join(
            f"{w.topic}: {w.reliability}, {w.history} {w.depth}, {w.durability}" for w in p.profiles
        ),
        parts,
        where=(context.location(),),
    )
    unknown = [
        f"the {s.kind} on {w.topic}"
        for w, each in sides.items()
        for s in each
        if s.seen and s.asked is None
    ]
    if not unknown or finding.outcome is not Outcome.PASSED:
        return finding
    return undecided(
        finding, f"The recording does not show the history and depth of {unknown[0]}.", retry=False
    )


def _judge_profile(wanted: WantedProfile, sides: Sequence[_Side], one_sided_credit: float) -> Part:
    """Judge a topic: each policy counts the same."""
    topic, lacking = wanted.topic, [side.kind for side in sides if not side.seen]
    reasons = [f"There is no {' and no '.join(lacking)} on {topic}."] if lacking else []
    values = {
        policy: [value for side in sides for value in side.values(policy)] for policy in _POLICIES
    }
    right = [
        each.count(getattr(wanted, policy)) / len(each) if each else 1.0
        for policy, each in values.items()
    ]
    wrong = [(side, side.wrong(wanted)) for side in sides if len(lacking) < len(sides)]
    alike = len({text for _, text in wrong}) == 1
    charged = [(side, text) for side, text in (wrong[:1] if alike else wrong) if text]
    reasons += [
        f"{topic if alike else f'The {side.kind} on {topic}'} has {text}." for side, text in charged
    ]
    shown = (
        str(sides[0])
        if len(set(map(str, sides))) == 1
        else " / ".join(f"{side.kind} {side}" for side in sides)
    )
    return Part(
        sum(right) / len(right) * (1.0, one_sided_credit, 0.0)[len(lacking)],
        f"{topic}: {shown}",
        " ".join(reasons),
        where=tuple(location for side, _ in charged for location in side.where),
    )


class Row(Parameters):
    """The line that reports on a topic: the one that begins with the name."""

    name: str
    topic: ref.Topic


class ReportedTraffic(Parameters):
    """Reported counts and latencies agree with what was recorded; each row is a part."""

    artifact: ref.Artifact
    rows: tuple[Row, ...] = Field(min_length=1)
    pattern: Pattern = Field(
        description="Regular expression with groups count, mean_ms and max_ms.",
        examples=[
            r"(?P<count>\d+) messages, mean (?P<mean_ms>[0-9.]+) ms, most (?P<max_ms>[0-9.]+) ms"
        ],
    )
    count_tolerance: Share = 0.02
    latency_factor: float = Field(
        4,
        description="The reported mean may be above the recorded one, or below its least, by this factor.",
    )
    latency_slack_s: float = Field(
        0.004, description="It may be above the recorded one by this much in any case."
    )

    @field_validator("pattern")
    @classmethod
    def _has_groups(cls, value: str) -> str:
        if not {"count", "mean_ms", "max_ms"} <= set(compiled(value).groupindex):
            raise ValueError("the groups count, mean_ms and max_ms are needed")
        return value


def reported_traffic(context: Context, p: ReportedTraffic) -> Finding:
    """Judge each row: half for the count, half for the latency."""
    claims = {row.name: _claimed(context, p, row) for row in p.rows}
    # Where nothing was sent, and nothing is said to have come, that is charged with the traffic.
    rows = [
        r
        for r in p.rows
        if _written(context, r.topic) or ((claimed := claims[r.name]) is not None and claimed.count)
    ]
    expected = f"for each profile the messages delivered (± {percent(p.count_tolerance)}) and a latency that is possible"
    if not rows:
        return not_reached(
            "Not tested, because nothing was sent on any of the topics.", expected=expected
        )
    if constants := _written_beforehand(
        context, p, [claim for claim in claims.values() if claim is not None]
    ):
        reason = "Every count and latency that it prints is a constant in its source, so none was measured."
        hint = "Count in the callbacks, and print what was counted."
        found = failed(expected, "constants of the source", reason, hint=hint, where=constants)
        return replace(
            found, unmeasured="All counts and latencies that it prints are constants of its source."
        )
    run = context.session.process(p.artifact)
    delay_s, length_s = _delay_s(context, run) if run is not None else (0.0, 1.0)
    late_s = context.session.backlog(run, _life(context, run)).late_s if run is not None else 0.0
    parts = []
    for row in rows:
        claim = claims[row.name]
        if claim is None:
            untold = f"There is no line with count and latency for {row.name}."
            hint = f"Print a line for each profile, as '{row.name}: 1000 msgs, avg latency: 0.50ms, max: 2.00ms'."
            parts.append(Part(0.0, reason=untold, hint=hint))
            continue
        written = min(
            (_written(context, row.topic, t) for t in (None, claim.t_ns)),
            key=lambda n: abs(n - claim.count),
        )
        unheld, waits_s = (
            f(context, run, row.topic) if run is not None else 0.0 for f in (_unheld, _waits_s)
        )
        share, reason = _judge_row(
            context,
            p,
            row,
            claim,
            written,
            late_s=waits_s,
            pushed_out=min(unheld, _MOST_UNHELD * written),
        )
        # What waits for a core comes late, and may push out of a short queue what waits already.
        pushed_out = written * delay_s / length_s
        best, _ = _judge_row(
            context, p, row, claim, written, late_s=max(late_s, waits_s), pushed_out=pushed_out
        )
        latency = "no latency" if claim.mean_s is None else f"{claim.mean_s * 1e3:.2f} ms"
        sides = "Give publisher and subscription of a profile the same QoSProfile; then messages arrive."
        hint = sides if "incompatible" in reason else ""
        parts.append(
            Part(
                share, f"{row.name} {claim.count} of {written}, {latency}", reason, best, hint=hint
            )
        )
    where, doubt = (context.output_of(p.artifact),), cpu_delay_doubt(delay_s, length_s)
    measured = "" if any(part.text for part in parts) else "no results"
    finding = of_parts(expected, parts, measured=measured, where=where, doubt=doubt)
    return replace(finding, unmeasured=_unmeasured(context, rows, claims, finding))


def _unmeasured(
    context: Context, rows: Sequence[Row], claims: Mapping[str, ResultRow | None], finding: Finding
) -> str | None:
    """Say which counts cannot come from messages that were received; None if there are no such."""
    counted = [row for row in rows if (claim := claims[row.name]) is not None and claim.count]
    unheard = [
        row.topic for row in counted if not student_endpoints(context, row.topic, "subscription")
    ]
    if unheard:
        return f"It counts messages on {', '.join(unheard)}, to which nothing of the submission subscribes."
    if len(counted) == len(rows) > 1 and finding.outcome is Outcome.FAILED:
        return f"None of the {len(rows)} counts that it prints is that of the messages in the recording."
    return None


_NUMBER = re.compile(r"(?<![\w.])\d{1,15}(?:\.\d{1,15})?(?:[eE]-?\d{1,2})?(?![\w.])")
#: So many different latencies are no coincidence.
_LEAST_LATENCIES = 4


def _written_beforehand(
    context: Context, p: ReportedTraffic, claims: Sequence[ResultRow]
) -> list[Location]:
    """Return the lines of the source that hold all that is printed, as counts and latencies in s, ms or µs."""
    path = context.path_of(p.artifact) or ""
    lines = context.submission.texts.get(path, "").splitlines()
    held = {
        float(number): place
        for place, line in enumerate(lines, 1)
        for number in _NUMBER.findall(line[:LINE_LIMIT])
    }
    latencies = {value for claim in claims for value in (claim.mean_s, claim.max_s) if value}
    if len(latencies) < _LEAST_LATENCIES or not all(claim.count in held for claim in claims):
        return []
    for unit in (1.0, 1e3, 1e6):
        places = [
            next((at for n, at in held.items() if math.isclose(n, value * unit)), None)
            for value in latencies
        ]
        if None not in places:
            return [
                Location(file=path, line=place)
                for place in sorted({place for place in places if place})
            ][:4]
    return []


def _claimed(context: Context, p: ReportedTraffic, row: Row) -> ResultRow | None:
    """Return what is printed about a row: in the pattern's form, or in another that can be read."""
    output = context.session.output_of(p.artifact)
    lines = [line.text[:LINE_LIMIT] for line in output]
    for loosely in (False, True):
        for place in lines_naming(lines, row.name, loosely=loosely):
            if match := search(p.pattern, plain_numbers(lines[place])):
                mean_s, max_s = (float(match[name]) / 1e3 for name in ("mean_ms", "max_ms"))
                rounding_s = rounding_of(match["mean_ms"], 1e-3)
                return ResultRow(output[place].t_ns, int(match["count"]), mean_s, max_s, rounding_s)
        others = [other.name for other in p.rows if other is not row]
        if (found := result_row(output, row.name, others, loosely=loosely)) is not None:
            return found
    return None


#: At most this share of the messages is taken for that.
_MOST_UNHELD = 0.1


def _unheld(context: Context, run: ProcessRun, topic: str) -> float:
    """Return how many messages the queue of a subscription did not hold while the machine kept its node from a core.

    That many may be missing in a count that is true. One message may have come just as it began to wait.
    """
    claim, life = claim_of(context, "subscription", topic), _life(context, run)
    depth = claim.qos.depth if claim is not None and claim.qos is not None else 1
    times = context.session.stream(topic).source_ns
    if len(times) < 2:
        return 0.0
    period_s = float(times[-1] - times[0]) / 1e9 / (len(times) - 1)
    return context.session.backlog(run, life, (depth - 1) * period_s).lost_s / max(period_s, 1e-9)


def _waits_s(context: Context, run: ProcessRun, topic: str) -> float:
    """Return for how long a message that comes at any moment waits on average, as the machine delays its node, in s.

    Half of a delay that it comes in, as often as that is; what waits for others besides is not in it.
    """
    times = context.session.stream(topic).source_ns
    if not run.disturbed or len(times) < 2:
        return 0.0
    span = Span(int(times[0]), int(times[-1]))
    squares = sum(
        (delay.delay_ns / 1e9) ** 2 for delay in clipped(context.session.delays(run), span)
    )
    return squares / 2 / max(span.duration_s, 1e-9)


def _judge_row(
    context: Context,
    p: ReportedTraffic,
    row: Row,
    got: ResultRow,
    written: int,
    *,
    late_s: float,
    pushed_out: float,
) -> tuple[float, str]:
    """Return what a row earns, and why no more; numbers that cannot be are worth nothing together.

    So many messages were `written` until the row was printed. The machine may have made the mean later by `late_s`,
    and have cost the messages that were `pushed_out`.
    """
    counted = f"{row.name} reports {got.count} messages"
    if not got.count and (unheard := _unheard(context, row.topic)):
        return 0.5, f"{counted}, which is true. {unheard}"
    if not student_endpoints(context, row.topic, "subscription"):
        return 0.0, f"{counted}, but nothing subscribes to {row.topic}."
    slack = max(3.0, p.count_tolerance * written)
    if not written - slack - pushed_out <= got.count <= written + slack:
        return 0.0, f"{counted}; {written} were published."
    if problem := _latency_problem(context, p, row, got, late_s):
        return 0.5, problem
    return (0.75, f"{row.name} reports no largest latency.") if got.max_s is None else (1.0, "")


def _latency_problem(
    context: Context, p: ReportedTraffic, row: Row, got: ResultRow, late_s: float
) -> str:
    """Say why a reported latency cannot be, or nothing.

    Nothing is delivered much sooner than the soonest that was recorded; later is a matter of the machine.
    """
    if got.mean_s is None:
        return f"{row.name} reports {got.count} messages, but no latency."
    stream = context.session.stream(row.topic)
    latencies: Floats = (stream.received_ns - stream.source_ns) / 1e9
    if not len(latencies):
        return ""
    if _stamped_otherwise(context, latencies):
        return (
            f"The messages on {row.topic} have time stamps that are not their times of publication."
        )
    truth_s = float(np.mean(latencies))
    least_s = float(np.min(latencies)) / p.latency_factor
    most_s = max(truth_s * p.latency_factor, truth_s + p.latency_slack_s) + late_s
    in_order = got.max_s is None or got.mean_s <= got.max_s + 1e-5
    if (
        least_s - got.rounding_s <= got.mean_s <= most_s + got.rounding_s
        and got.mean_s >= 0
        and in_order
    ):
        return ""
    most = f" (max {got.max_s * 1e3:.2f} ms)" if got.max_s is not None else ""
    mean_ms = apart(got.mean_s * 1e3, *([] if got.max_s is None else [got.max_s * 1e3]), places=2)
    slip = (
        " The value is right in seconds; multiply it by 1000 for ms."
        if least_s <= 1e3 * got.mean_s <= most_s
        else ""
    )
    return f"{row.name} reports a mean latency of {mean_ms} ms{most}; recorded was {truth_s * 1e3:.2f} ms.{slip}"


#: Median latencies that no message has within a machine, unless the recorder lacked a core for this share of the time.
_LEAST_MEDIAN_S, _MOST_MEDIAN_S, _RECORDER_BUSY = -0.001, 0.03, 0.2


def _stamped_otherwise(context: Context, latencies: Floats) -> bool:
    """Whether messages did not leave when they are stamped: their stamps are the work of the student's process."""
    record = context.session.record
    span = Span(record.started_ns, record.ended_ns)
    busy = context.session.recorder_delay_s(span) > _RECORDER_BUSY * span.duration_s
    plausible = _LEAST_MEDIAN_S <= float(np.median(latencies)) <= _MOST_MEDIAN_S
    return not plausible and not busy and not clock_step_s(record, span)
