"""Checks of a tool that compares QoS profiles: its end, its profiles, and the truth of its numbers."""

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
    """A process ends by itself in time, without an error, after printing its results."""

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
    has_results = search(p.output, printed) is not None
    if not has_results and run.ended_by == "interrupt":
        flaky = flaky_end(run)
        if flaky:
            return unclear(expected, "no results", flaky)
    if run.interrupted_ns is not None or run.ended_by != "itself":
        return _had_to_be_stopped(p, run, expected, has_results)
    ran_s = ((run.exited_ns or context.session.record.ended_ns) - run.started_ns) / 1e9
    ended = f"ended after {apart(ran_s, p.least_s, places=1)} s"
    measured = f"{ended} with status {run.exit_status}"
    if has_results:
        return _ended_with_results(p, run, expected, ran_s, ended)
    measured += ", no results"
    if run.exit_status == 0 and ran_s >= p.least_s:
        return _ended_without_results(p, expected, measured, bool(printed.strip()))
    return unexplained(graded(0.0, expected, measured, "It ended without results."))


def _had_to_be_stopped(
    p: EndsByItself, run: ProcessRun, expected: str, has_results: bool
) -> Finding:
    """State that a process was still running when it was stopped."""
    stopped_s = ((run.interrupted_ns or run.started_ns) - run.started_ns) / 1e9
    reason = f"It was still running after {stopped_s:.0f} s and had to be stopped."
    hint = "End rclpy.spin after 10 s: count the time in a timer, or spin_once in a loop."
    share = p.half_credit if has_results else 0.0
    return graded(share, expected, "had to be stopped", reason, hint=hint)


def _ended_with_results(
    p: EndsByItself, run: ProcessRun, expected: str, ran_s: float, ended: str
) -> Finding:
    """Judge the time at which a process with results ended, and note its exit status."""
    notes = []
    if run.exit_status != 0:
        notes.append(
            "It does not end with exit status 0; stop executors and threads before rclpy.shutdown()."
        )
    share = p.half_credit if ran_s < p.least_s else 1.0
    measured = f"{ended} with status {run.exit_status}"
    return graded(share, expected, measured, f"It {ended}, which is too early.", notes=notes)


def _ended_without_results(
    p: EndsByItself, expected: str, measured: str, has_printed: bool
) -> Finding:
    """State that a process ended in time, but that its output holds no results."""
    reason = "It ended in time, and printed nothing."
    if has_printed:
        reason = "It ended in time, but nothing that it printed could be read as results."
    hint = "Print the results before the program ends, with print() or the logger."
    return graded(p.half_credit * has_printed, expected, measured, reason, hint=hint)


def _without_tracebacks(output: Sequence[OutputLine]) -> str:
    """Return the output without tracebacks, because they quote the source."""
    kept: list[str] = []
    # Streams in the middle of a traceback; lines of other streams may stand between its lines.
    quoting: set[str] = set()
    for line in output:
        begins = line.text.startswith("Traceback (most recent call last)")
        if begins:
            quoting.add(line.stream)
        elif line.stream not in quoting:
            kept.append(line.text)
        elif not line.text.startswith(" "):
            # The last line of a traceback is its message, which is not indented.
            quoting.remove(line.stream)
    return "\n".join(kept)


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
    """Judge the number of messages by the publishers' sequence numbers.

    Too few messages earn their share of a topic, and another name costs a part of it.
    """
    delays = [_delay_of(context, run) for run in context.session.students]
    delay = max(delays, default=_Delay(0.0, 0.0))
    expected = f"at least {p.least_messages} messages on each of {', '.join(p.topics)}"
    parts = [_judge_traffic(context, p, topic, delay) for topic in p.topics]
    return of_parts(expected, parts, doubt=delay.doubt)


def _judge_traffic(context: Context, p: TopicsCarryTraffic, topic: str, delay: _Delay) -> Part:
    """Judge the number of messages on one topic."""
    used = context.session.used(topic)
    count = _written(context, topic)
    undelayed = without_delay(count, delay.delay_s, delay.length_s)
    reasons = []
    heard = 1.0
    unheard = _unheard(context, topic) if count else ""
    if unheard:
        heard = p.unheard_credit
        reasons.append(unheard)
    if count < p.least_messages:
        reasons.append(f"Too few messages arrived on {topic}.")
    cost = 0.0
    if count and used != topic:
        cost = p.other_name_costs
        reasons.append(f"{topic} is named {used}; the other checks use that name.")
    share = max(0.0, _share_of(count, p) - cost) * heard
    best = max(0.0, _share_of(undelayed, p) - cost) * heard
    return Part(share, f"{used} {count}", " ".join(reasons), best)


def _share_of(count: float, p: TopicsCarryTraffic) -> float:
    return min(1.0, quantise(count / p.least_messages))


def _unheard(context: Context, topic: str) -> str:
    """Say why the student's own side cannot receive the messages on a topic; empty if it can."""
    offers = student_endpoints(context, topic, "publisher")
    requests = student_endpoints(context, topic, "subscription")
    if not requests:
        return f"Nothing subscribes to {topic}."
    policy = clash(requests[0], offers[0].qos) if offers else None
    if policy is None:
        return ""
    return f"The two sides of {topic} are incompatible in {policy}: none can arrive."


@dataclass(frozen=True, order=True)
class _Delay:
    """Machine delay of a process, and the time that it ran, both in seconds."""

    delay_s: float
    length_s: float

    @property
    def doubt(self) -> str:
        """Say that the delay may be the reason of a loss."""
        return cpu_delay_doubt(self.delay_s, self.length_s)


def _delay_of(context: Context, run: ProcessRun) -> _Delay:
    """Return the machine delay of a process over its whole life."""
    span = _life(context, run)
    return _Delay(context.session.machine_delay_s(run, span), span.duration_s)


def _life(context: Context, run: ProcessRun) -> Span:
    return Span(run.started_ns, run.exited_ns or context.session.record.ended_ns)


def _written(context: Context, topic: str, until_ns: int | None = None) -> int:
    """Return the number of messages written to a topic, up to a time if one is given."""
    stream = context.session.stream(topic)
    sequence = stream.sequence
    if until_ns is not None:
        sequence = sequence[stream.source_ns <= until_ns]
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

    def sought(self) -> Sequence[ref.Sought]:
        """Return a publisher and a subscription for each profile."""
        publishers = [ref.Sought("publisher", wanted.topic) for wanted in self.profiles]
        subscriptions = [ref.Sought("subscription", wanted.topic) for wanted in self.profiles]
        return [*publishers, *subscriptions]


_POLICIES = ("reliability", "durability", "history", "depth")


@dataclass(frozen=True)
class _Side:
    """One side of a topic: its QoS in the graph, and the QoS that the program passed to rclpy."""

    kind: str
    seen: tuple[Qos, ...]
    asked: Qos | None
    where: tuple[Location, ...]

    @classmethod
    def of(cls, context: Context, kind: str, topic: str) -> _Side:
        claim = claim_of(context, kind, topic)
        seen = tuple(endpoint.qos for endpoint in student_endpoints(context, topic, kind))
        return cls(kind, seen, claim.qos if claim is not None else None, claimed_at(claim))

    def values(self, policy: str) -> list[str | int | None]:
        """Return the values of a policy: from the graph, or for history and depth from the program."""
        if policy in ("reliability", "durability"):
            return [getattr(qos, policy) for qos in self.seen]
        return [getattr(self.asked, policy)] if self.asked is not None else []

    def wrong(self, wanted: WantedProfile) -> str:
        """Say which policies have other values than wanted."""
        clauses = []
        for policy in _POLICIES:
            right = getattr(wanted, policy)
            for value in self.values(policy):
                if value != right:
                    clauses.append(f"{policy} {value}, not {right}")
        return ", and ".join(clauses)

    def __str__(self) -> str:
        if not self.seen:
            return "nothing"
        history = "history unknown"
        if self.asked is not None:
            history = f"{self.asked.history} {self.asked.depth}"
        return f"{self.seen[0].reliability}, {history}, {self.seen[0].durability}"


#: Both sides of each topic.
_Sides = Mapping[WantedProfile, Sequence[_Side]]


def qos_profiles(context: Context, p: QosProfiles) -> Finding:
    """Judge reliability and durability from discovery, history and depth from the calls of rclpy."""
    sides = {}
    for wanted in p.profiles:
        publisher = _Side.of(context, "publisher", wanted.topic)
        subscription = _Side.of(context, "subscription", wanted.topic)
        sides[wanted] = [publisher, subscription]
    parts = [_judge_profile(wanted, sides[wanted], p.one_sided_credit) for wanted in sides]
    if _all_alike(sides) and sum(part.share for part in parts) > p.alike_credit * len(parts):
        parts = [replace(part, share=p.alike_credit) for part in parts]
        reason = f"All topics have one and the same profile, so that nothing is compared. {parts[0].reason}"
        parts[0] = replace(parts[0], reason=reason.strip())
    expected = "; ".join(map(_shown_profile, p.profiles))
    finding = of_parts(expected, parts, where=(context.location(),))
    unknown = _without_history(sides)
    if unknown is None or finding.outcome is not Outcome.PASSED:
        return finding
    reason = f"The recording does not show the history and depth of {unknown}."
    return undecided(finding, reason, retry=False)


def _shown_profile(wanted: WantedProfile) -> str:
    queue = f"{wanted.history} {wanted.depth}"
    return f"{wanted.topic}: {wanted.reliability}, {queue}, {wanted.durability}"


def _all_alike(sides: _Sides) -> bool:
    """Tell whether all sides of several topics have the same profile."""
    shown: set[str] = set()
    for both in sides.values():
        shown.update(str(side) for side in both if side.seen)
    return len(sides) > 1 and len(shown) == 1


def _without_history(sides: _Sides) -> str | None:
    """Return the first side without a known history and depth, in words."""
    for wanted, both in sides.items():
        for side in both:
            if side.seen and side.asked is None:
                return f"the {side.kind} on {wanted.topic}"
    return None


def _judge_profile(wanted: WantedProfile, sides: Sequence[_Side], one_sided_credit: float) -> Part:
    """Judge a topic: each policy counts the same."""
    missing = [side.kind for side in sides if not side.seen]
    reasons = []
    if missing:
        reasons.append(f"There is no {' and no '.join(missing)} on {wanted.topic}.")
    shares = [_right_share(wanted, sides, policy) for policy in _POLICIES]
    share = sum(shares) / len(shares) * (1.0, one_sided_credit, 0.0)[len(missing)]
    where: list[Location] = []
    if len(missing) < len(sides):
        wrong, charged = _wrong_policies(wanted, sides)
        reasons += wrong
        for side in charged:
            where += side.where
    text = f"{wanted.topic}: {_shown_sides(sides)}"
    return Part(share, text, " ".join(reasons), where=tuple(where))


def _right_share(wanted: WantedProfile, sides: Sequence[_Side], policy: str) -> float:
    """Return the share of right values of a policy; all of it if none is known."""
    values: list[str | int | None] = []
    for side in sides:
        values += side.values(policy)
    return values.count(getattr(wanted, policy)) / len(values) if values else 1.0


def _wrong_policies(wanted: WantedProfile, sides: Sequence[_Side]) -> tuple[list[str], list[_Side]]:
    """Return a sentence for each side with wrong policies, and these sides.

    One sentence is enough if both sides have the same.
    """
    texts = [side.wrong(wanted) for side in sides]
    if len(set(texts)) == 1:
        if not texts[0]:
            return [], []
        return [f"{wanted.topic} has {texts[0]}."], [sides[0]]
    sentences = []
    charged = []
    for side, text in zip(sides, texts, strict=True):
        if text:
            sentences.append(f"The {side.kind} on {wanted.topic} has {text}.")
            charged.append(side)
    return sentences, charged


def _shown_sides(sides: Sequence[_Side]) -> str:
    """Return the profile of both sides, once if they are the same."""
    if len(set(map(str, sides))) == 1:
        return str(sides[0])
    return " / ".join(f"{side.kind} {side}" for side in sides)


class Row(Parameters):
    """The line of the results that begins with a name and reports on a topic."""

    name: str
    topic: ref.Topic


class ReportedTraffic(Parameters):
    """Reported counts and latencies agree with the recording; each row is a part."""

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


#: Results by the names of their rows; None if a row was not printed.
_Claims = Mapping[str, ResultRow | None]


def reported_traffic(context: Context, p: ReportedTraffic) -> Finding:
    """Judge each row: half for the count, half for the latency."""
    claims = {row.name: _claimed(context, p, row) for row in p.rows}
    rows = [row for row in p.rows if _has_traffic(context, row, claims)]
    expected = f"for each profile the messages delivered (± {percent(p.count_tolerance)}) and a latency that is possible"
    if not rows:
        reason = "Not tested, because nothing was sent on any of the topics."
        return not_reached(reason, expected=expected)
    printed = [claim for claim in claims.values() if claim is not None]
    constants = _written_beforehand(context, p, printed)
    if constants:
        return _all_constants(expected, constants)
    run = context.session.process(p.artifact)
    delay = _delay_of(context, run) if run is not None else _Delay(0.0, 1.0)
    parts = [_judge_reported(context, p, row, claims[row.name], delay) for row in rows]
    measured = "" if any(part.text for part in parts) else "no results"
    where = (context.output_of(p.artifact),)
    finding = of_parts(expected, parts, measured=measured, where=where, doubt=delay.doubt)
    return replace(finding, unmeasured=_unmeasured(context, rows, claims, finding))


def _has_traffic(context: Context, row: Row, claims: _Claims) -> bool:
    """Tell whether messages were sent on a topic, or are said to have come.

    Another check charges a topic without messages.
    """
    claim = claims[row.name]
    says_so = claim is not None and bool(claim.count)
    return says_so or _written(context, row.topic) > 0


def _all_constants(expected: str, constants: Sequence[Location]) -> Finding:
    """State that all printed numbers are constants of the source."""
    reason = (
        "Every count and latency that it prints is a constant in its source, so none was measured."
    )
    hint = "Count in the callbacks, and print what was counted."
    finding = failed(expected, "constants of the source", reason, hint=hint, where=constants)
    unmeasured = "All counts and latencies that it prints are constants of its source."
    return replace(finding, unmeasured=unmeasured)


@dataclass(frozen=True)
class _Lateness:
    """Effects of machine delays on the numbers of a row."""

    #: Greatest additional mean latency, in seconds.
    late_s: float
    #: Greatest number of messages that were lost.
    pushed_out: float


def _judge_reported(
    context: Context, p: ReportedTraffic, row: Row, claim: ResultRow | None, delay: _Delay
) -> Part:
    """Judge the printed numbers of one row."""
    if claim is None:
        reason = f"There is no line with count and latency for {row.name}."
        hint = f"Print a line for each profile, as '{row.name}: 1000 msgs, avg latency: 0.50ms, max: 2.00ms'."
        return Part(0.0, reason=reason, hint=hint)
    run = context.session.process(p.artifact)
    written = _nearest_count(context, row, claim)
    usual = _usual_lateness(context, run, row.topic, written)
    worst = _worst_lateness(context, run, usual, written * delay.delay_s / delay.length_s)
    share, reason = _judge_row(context, p, row, claim, written, usual)
    best, _ = _judge_row(context, p, row, claim, written, worst)
    latency = "no latency" if claim.mean_s is None else f"{claim.mean_s * 1e3:.2f} ms"
    text = f"{row.name} {claim.count} of {written}, {latency}"
    hint = ""
    if "incompatible" in reason:
        hint = "Give publisher and subscription of a profile the same QoSProfile; then messages arrive."
    return Part(share, text, reason, best, hint=hint)


def _nearest_count(context: Context, row: Row, claim: ResultRow) -> int:
    """Return the number of messages, of all or until the row was printed, that is nearest to the claim."""
    counts = (_written(context, row.topic), _written(context, row.topic, claim.t_ns))
    return min(counts, key=lambda count: abs(count - claim.count))


def _usual_lateness(
    context: Context, run: ProcessRun | None, topic: str, written: int
) -> _Lateness:
    """Return the effects that the machine delays surely had."""
    if run is None:
        return _Lateness(0.0, 0.0)
    pushed_out = min(_unheld(context, run, topic), _MOST_UNHELD * written)
    return _Lateness(_waits_s(context, run, topic), pushed_out)


def _worst_lateness(
    context: Context, run: ProcessRun | None, usual: _Lateness, pushed_out: float
) -> _Lateness:
    """Return the greatest possible effects of the machine delays.

    A message that waits for a core comes late, and may push waiting ones out of a short queue.
    """
    late_s = 0.0
    if run is not None:
        late_s = context.session.backlog(run, _life(context, run)).late_s
    return _Lateness(max(late_s, usual.late_s), pushed_out)


def _unmeasured(
    context: Context, rows: Sequence[Row], claims: _Claims, finding: Finding
) -> str | None:
    """Say which counts cannot come from received messages; None if all can."""
    counted = []
    for row in rows:
        claim = claims[row.name]
        if claim is not None and claim.count:
            counted.append(row)
    unheard = []
    for row in counted:
        if not student_endpoints(context, row.topic, "subscription"):
            unheard.append(row.topic)
    if unheard:
        return f"It counts messages on {', '.join(unheard)}, to which nothing of the submission subscribes."
    if len(counted) == len(rows) > 1 and finding.outcome is Outcome.FAILED:
        return f"None of the {len(rows)} counts that it prints is that of the messages in the recording."
    return None


_NUMBER = re.compile(r"(?<![\w.])\d{1,15}(?:\.\d{1,15})?(?:[eE]-?\d{1,2})?(?![\w.])")
#: Number of different latencies that do not stand in a source by coincidence.
_LEAST_LATENCIES = 4
#: Greatest number of lines that are shown.
_MOST_LINES = 4
#: Units of latencies in a source, as parts of a second.
_UNITS = (1.0, 1e3, 1e6)


def _written_beforehand(
    context: Context, p: ReportedTraffic, claims: Sequence[ResultRow]
) -> list[Location]:
    """Return the lines of the source that hold all printed counts and latencies.

    Latencies may be in s, ms or µs. Empty if the source does not hold them all.
    """
    path = context.path_of(p.artifact) or ""
    held = _numbers_in(context.submission.texts.get(path, ""))
    latencies: set[float] = set()
    for claim in claims:
        latencies.update(value for value in (claim.mean_s, claim.max_s) if value)
    if len(latencies) < _LEAST_LATENCIES or not all(claim.count in held for claim in claims):
        return []
    for unit in _UNITS:
        places = [_line_of(value * unit, held) for value in latencies]
        if None not in places:
            lines = sorted({line for line in places if line})
            return [Location(file=path, line=line) for line in lines[:_MOST_LINES]]
    return []


def _numbers_in(source: str) -> dict[float, int]:
    """Return the numbers in a source, each with the last line that holds it."""
    held = {}
    for number, line in enumerate(source.splitlines(), 1):
        for text in _NUMBER.findall(line[:LINE_LIMIT]):
            held[float(text)] = number
    return held


def _line_of(value: float, held: Mapping[float, int]) -> int | None:
    """Return the line of the first number that is close to a value."""
    for number, line in held.items():
        if math.isclose(number, value):
            return line
    return None


def _claimed(context: Context, p: ReportedTraffic, row: Row) -> ResultRow | None:
    """Return the printed numbers of a row, by the pattern or in another readable form."""
    output = context.session.output_of(p.artifact)
    others = [other.name for other in p.rows if other is not row]
    for loosely in (False, True):
        found = _by_pattern(output, p.pattern, row.name, loosely=loosely)
        if found is None:
            found = result_row(output, row.name, others, loosely=loosely)
        if found is not None:
            return found
    return None


def _by_pattern(
    output: Sequence[OutputLine], pattern: str, name: str, *, loosely: bool
) -> ResultRow | None:
    """Return the numbers of the first line that names a row and matches the pattern."""
    lines = [line.text[:LINE_LIMIT] for line in output]
    for place in lines_naming(lines, name, loosely=loosely):
        match = search(pattern, plain_numbers(lines[place]))
        if match:
            return ResultRow(
                output[place].t_ns,
                int(match["count"]),
                float(match["mean_ms"]) / 1e3,
                float(match["max_ms"]) / 1e3,
                rounding_of(match["mean_ms"], 1e-3),
            )
    return None


#: Greatest share of the messages that is excused as lost from a queue.
_MOST_UNHELD = 0.1


def _unheld(context: Context, run: ProcessRun, topic: str) -> float:
    """Return the number of messages that a queue lost while its node had no core.

    As many may be missing in a true count. One message may have come just as the node began to wait.
    """
    claim = claim_of(context, "subscription", topic)
    depth = claim.qos.depth if claim is not None and claim.qos is not None else 1
    times = context.session.stream(topic).source_ns
    if len(times) < 2:
        return 0.0
    period_s = float(times[-1] - times[0]) / 1e9 / (len(times) - 1)
    backlog = context.session.backlog(run, _life(context, run), (depth - 1) * period_s)
    return backlog.lost_s / max(period_s, 1e-9)


def _waits_s(context: Context, run: ProcessRun, topic: str) -> float:
    """Return the mean time in seconds that a message waits because the machine delays its node.

    It is half of a delay, weighed by the share of time in that delay. Other waiting is not included.
    """
    times = context.session.stream(topic).source_ns
    if not run.disturbed or len(times) < 2:
        return 0.0
    span = Span(int(times[0]), int(times[-1]))
    delays = clipped(context.session.delays(run), span)
    squares = sum((delay.delay_ns / 1e9) ** 2 for delay in delays)
    return squares / 2 / max(span.duration_s, 1e-9)


def _judge_row(
    context: Context,
    p: ReportedTraffic,
    row: Row,
    got: ResultRow,
    written: int,
    lateness: _Lateness,
) -> tuple[float, str]:
    """Return the credit of a row, and the reason if it is not full.

    An impossible count earns nothing for the latency either.
    """
    counted = f"{row.name} reports {got.count} messages"
    unheard = "" if got.count else _unheard(context, row.topic)
    if unheard:
        return 0.5, f"{counted}, which is true. {unheard}"
    if not student_endpoints(context, row.topic, "subscription"):
        return 0.0, f"{counted}, but nothing subscribes to {row.topic}."
    slack = max(3.0, p.count_tolerance * written)
    if not written - slack - lateness.pushed_out <= got.count <= written + slack:
        return 0.0, f"{counted}; {written} were published."
    problem = _latency_problem(context, p, row, got, lateness.late_s)
    if problem:
        return 0.5, problem
    if got.max_s is None:
        return 0.75, f"{row.name} reports no largest latency."
    return 1.0, ""


def _latency_problem(
    context: Context, p: ReportedTraffic, row: Row, got: ResultRow, late_s: float
) -> str:
    """Say why a reported latency is impossible; empty if it is possible.

    No message comes much sooner than the soonest recorded one; a later one depends on the machine.
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
    if _is_possible(got, got.mean_s, least_s, most_s):
        return ""
    reason = f"{_reported_latency(row, got, got.mean_s)}; recorded was {truth_s * 1e3:.2f} ms."
    if least_s <= 1e3 * got.mean_s <= most_s:
        reason += " The value is right in seconds; multiply it by 1000 for ms."
    return reason


def _is_possible(got: ResultRow, mean_s: float, least_s: float, most_s: float) -> bool:
    """Tell whether a mean latency lies between two bounds, and not above the largest one."""
    if mean_s < 0 or (got.max_s is not None and mean_s > got.max_s + 1e-5):
        return False
    return least_s - got.rounding_s <= mean_s <= most_s + got.rounding_s


def _reported_latency(row: Row, got: ResultRow, mean_s: float) -> str:
    """State the reported mean latency and the largest one."""
    if got.max_s is None:
        mean_ms = apart(mean_s * 1e3, places=2)
        return f"{row.name} reports a mean latency of {mean_ms} ms"
    mean_ms = apart(mean_s * 1e3, got.max_s * 1e3, places=2)
    return f"{row.name} reports a mean latency of {mean_ms} ms (max {got.max_s * 1e3:.2f} ms)"


#: Bounds in seconds of median latencies within a machine, valid up to a delayed share of the recorder's time.
_LEAST_MEDIAN_S, _MOST_MEDIAN_S, _RECORDER_BUSY = -0.001, 0.03, 0.2


def _stamped_otherwise(context: Context, latencies: Floats) -> bool:
    """Tell whether the student's process stamped messages with other times than the publication."""
    record = context.session.record
    span = Span(record.started_ns, record.ended_ns)
    busy = context.session.recorder_delay_s(span) > _RECORDER_BUSY * span.duration_s
    plausible = _LEAST_MEDIAN_S <= float(np.median(latencies)) <= _MOST_MEDIAN_S
    return not plausible and not busy and not clock_step_s(record, span)
