"""Checks of a tool that compares QoS profiles: it ends by itself, its profiles, and whether its numbers are true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field, field_validator

from grader import references as ref
from grader.checks.endpoints import claimed_qos, clash, student_endpoints
from grader.checks.finding import (
    Context,
    apart,
    failed,
    graded,
    in_steps,
    inconclusive,
    kept_from_core,
    not_reached,
    passed,
    percent,
    why_nothing,
)
from grader.evidence.chance import is_believed
from grader.evidence.printed import text_of
from grader.evidence.recorded import Floats, Span, clock_step_s
from grader.evidence.result_rows import (
    LINE_LIMIT,
    ResultRow,
    lines_naming,
    plain_numbers,
    result_row,
    rounding_of,
)
from grader.evidence.timing import timing_of
from grader.patterns import Match, compiled, search
from grader.recording.session import OutputLine, ProcessRun, Qos
from grader.references import Parameters, Pattern, Share
from grader.result import Finding, Where


class EndsByItself(Parameters):
    """A process ends by itself in time, without an error, and has said something."""

    artifact: ref.Artifact
    step: ref.ExitLabel = Field(description="Label of the wait_exit step.")
    least_s: float
    most_s: float
    output: Pattern = Field(description="Regular expression that its output matches.")
    half_credit: Share = Field(0.5, description="Credit of results without an end in time, or the other way round.")


def ends_by_itself(context: Context, p: EndsByItself) -> Finding:
    """Judge the end of the artifact's process: half for ending well, half for its results."""
    expected = f"ends by itself after {p.least_s:g} to {p.most_s:g} s, with its results printed"
    processes = context.session.processes_of(p.artifact)
    if not processes:
        return inconclusive(expected, "not started", "The recording does not show the program.")
    run = processes[-1]
    spot = context.output_of(p.artifact)
    printed = _without_tracebacks(run.output)
    said = search(p.output, printed) is not None
    ran_s = ((run.exited_ns or context.session.record.ended_ns) - run.started_ns) / 1e9
    half, spots = (p.half_credit if said else 0.0), (spot,)
    if run.interrupted_ns is not None or run.ended_by != "itself":
        stopped_s = ((run.interrupted_ns or run.started_ns) - run.started_ns) / 1e9
        reason = f"It was still running after {stopped_s:.0f} s and had to be stopped."
        hint = "End rclpy.spin after 10 s: count the time in a timer, or spin_once in a loop."
        return graded(half, expected, "had to be stopped", reason, hint=hint, where=spots)
    shown_s = apart(ran_s, p.least_s, places=1)
    measured = f"ended after {shown_s} s with status {run.exit_status}" + ("" if said else ", no results")
    if said and ran_s >= p.least_s:
        notes = () if run.exit_status == 0 else (_bad_end(run.exit_status),)
        return passed(expected, measured, where=spots, notes=notes)
    if said:
        reason = f"It ended after {shown_s} s already, which is too soon."
        return graded(half, expected, measured, reason, where=spots)
    if run.exit_status == 0 and ran_s >= p.least_s:
        unread = bool(printed.strip())
        reason = "It ended in time, but nothing that it printed could be read as results."
        reason = reason if unread else "It ended in time, and printed nothing."
        return graded(p.half_credit * unread, expected, measured, reason, hint=_RESULTS_HINT, where=spots)
    reason, hint, where = why_nothing(context, p.artifact, "It ended without results.")
    return failed(expected, measured, reason, hint=hint, where=where)


_RESULTS_HINT = "Print the results before the program ends, with print() or the logger."


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
    return text_of(kept)


def _bad_end(status: int | None) -> str:
    """Say how a program ended that had done its work; shells give 128 and more for a signal that ended it."""
    if status is None or 0 < status <= 128:
        return f"Its exit status is {status}."
    return f"It crashes when it ends (exit status {status}); stop executors and threads before rclpy.shutdown()."


class TopicsCarryTraffic(Parameters):
    """Messages flow on each topic; each is a part."""

    topics: tuple[ref.Topic, ...]
    least_messages: int = 1
    other_name_costs: Share = Field(0.5, description="Share of a topic's credit that another name costs.")


def topics_carry_traffic(context: Context, p: TopicsCarryTraffic) -> Finding:
    """Judge the number of messages by the publishers' sequence numbers; another name costs a part of a topic.

    Too few earn their share of it.
    """
    counts = {t: _written(context, t) for t in p.topics}
    few = {t: in_steps(n / p.least_messages) for t, n in counts.items() if n < p.least_messages}
    renamed = [t for t in p.topics if counts[t] and context.session.used(t) != t]
    expected = f"at least {p.least_messages} messages on each of {', '.join(p.topics)}"
    measured = ", ".join(f"{context.session.used(t)} {n}" for t, n in counts.items())
    reasons = [f"Too little came on {', '.join(few)}."] if few else []
    reasons += [f"{t} is named {context.session.used(t)}; the rest is judged on that." for t in renamed]
    shares = [max(0.0, few.get(t, 1.0) - p.other_name_costs * (t in renamed)) for t in p.topics]
    share, late, where = sum(shares) / len(shares), _held_up(context), (context.where(),)
    best = 1.0 if few and late else share
    return graded(share, expected, measured, " ".join(reasons), where=where, best=best, doubt=late)


#: Share of its time for which a program was kept from a core, from which that may be why it sent so little.
_MANY_DELAYS = 0.25


def _held_up(context: Context) -> str:
    """Say that the machine kept a student's program from a core for much of its time, if it did."""
    for run in (run for run in context.session.record.processes if run.role == "student"):
        delay_s, length_s = _delay_s(context, run)
        if delay_s > _MANY_DELAYS * length_s:
            return kept_from_core(delay_s, length_s)
    return ""


def _delay_s(context: Context, run: ProcessRun) -> tuple[float, float]:
    """Return for how long the machine kept a process from its core, and how long it ran, in s."""
    span = Span(run.started_ns, run.exited_ns or context.session.record.ended_ns)
    return context.session.machine_delay_s(run, span), span.duration_s


def _written(context: Context, topic: str, until_ns: int | None = None) -> int:
    stream = context.session.stream(topic)
    sequence = stream.sequence if until_ns is None else stream.sequence[stream.source_ns <= until_ns]
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
    profiles: tuple[WantedProfile, ...]


def qos_profiles(context: Context, p: QosProfiles) -> Finding:
    """Judge reliability and durability from discovery, history and depth from what the program asked rclpy for."""
    parts: list[float] = []
    reasons, texts, spots, unknown = [], [], [], []
    for wanted in p.profiles:
        sides = [_Side.of(context, kind, wanted.topic) for kind in ("publisher", "subscription")]
        lacking = [side.kind for side in sides if not side.seen]
        if len(lacking) == 1 and _was_made(context, lacking[0], wanted.topic):
            reason = f"A {lacking[0]} on {wanted.topic} was made, but was not seen in the graph."
            return inconclusive(wanted.topic, f"no {lacking[0]} in the graph", reason, where=(context.where(),))
        if lacking:
            reasons.append(f"There is no {' and no '.join(lacking)} on {wanted.topic}.")
        told: dict[str, list[str]] = {}
        for policy in ("reliability", "durability", "history", "depth"):
            share, which, reason = _judge_policy(wanted, policy, sides)
            parts.append(share * (1 - len(lacking) / 2))
            if reason:
                told.setdefault(which, []).append(reason)
                wrong = [s for s in sides if any(value != getattr(wanted, policy) for value in s.policies(policy))]
                spots += [side.where for side in wrong if side.where is not None][:1]
        reasons += [f"{which} has {', and '.join(each)}." for which, each in told.items() if len(lacking) < len(sides)]
        texts.append(_shown(wanted.topic, sides))
        unknown += [f"the {s.kind} on {wanted.topic}" for s in sides if s.seen and s.claim is None]
    expected = "; ".join(f"{w.topic}: {w.reliability}, {w.history} {w.depth}, {w.durability}" for w in p.profiles)
    where = (*dict.fromkeys(spots), context.where())
    if unknown and not reasons:
        reason = f"The run does not say which history and depth {unknown[0]} has."
        return inconclusive(expected, "; ".join(texts), reason, where=where, retry=False)
    return graded(sum(parts) / len(parts), expected, "; ".join(texts), " ".join(reasons), where=where)


def _was_made(context: Context, kind: str, topic: str) -> bool:
    """Whether a student's program made an endpoint, as the tap notes, if that is to be believed."""
    used = context.session.used(topic).lstrip("/")
    claims = context.session.record.claims if is_believed(context.session) else []
    return any(claim.kind == kind and claim.name.lstrip("/") == used for claim in claims)


@dataclass(frozen=True)
class _Side:
    """One side of a topic: what the graph shows of its QoS, and what the program asked for as the tap noted."""

    kind: str
    seen: tuple[Qos, ...]
    claim: Qos | None
    where: Where | None

    @classmethod
    def of(cls, context: Context, kind: str, topic: str) -> _Side:
        claim, where = claimed_qos(context, kind, topic)
        return cls(kind, tuple(e.qos for e in student_endpoints(context, topic, kind)), claim, where)

    def policies(self, policy: str) -> list[str | int | None]:
        """Return a policy's values: those on the wire as seen, those of the queue as claimed."""
        if policy in ("reliability", "durability"):
            return [getattr(qos, policy) for qos in self.seen]
        return [getattr(self.claim, policy)] if self.claim is not None else []

    def __str__(self) -> str:
        history = f"{self.claim.history} {self.claim.depth}" if self.claim is not None else "history unknown"
        return f"{self.seen[0].reliability}, {history}, {self.seen[0].durability}" if self.seen else "nothing"


def _judge_policy(wanted: WantedProfile, policy: str, sides: Sequence[_Side]) -> tuple[float, str, str]:
    """Return the share of a policy, and where it is wrong, on which side or sides and how."""
    value = getattr(wanted, policy)
    got = [each for side in sides for each in side.policies(policy)]
    wrong = [(side.kind, each) for side in sides for each in side.policies(policy) if each != value]
    if not wrong:
        return 1.0, "", ""
    kinds = list(dict.fromkeys(kind for kind, _ in wrong))
    which = f"The {kinds[0]} on {wanted.topic}" if len(kinds) == 1 else wanted.topic
    return 1 - len(wrong) / len(got), which, f"{policy} {wrong[0][1]}, not {value}"


def _shown(topic: str, sides: Sequence[_Side]) -> str:
    told = dict.fromkeys(str(side) for side in sides)
    if len(told) == 1:
        return f"{topic}: {sides[0]}"
    return f"{topic}: " + " / ".join(f"{side.kind} {side}" for side in sides)


class Row(Parameters):
    """The line that reports on a topic: the one that begins with the name."""

    name: str
    topic: ref.Topic


class ReportedTraffic(Parameters):
    """Reported counts and latencies agree with what was recorded; each row is a part."""

    artifact: ref.Artifact
    rows: tuple[Row, ...]
    pattern: Pattern = Field(description="Regular expression with groups count, mean_ms and max_ms.")
    count_tolerance: Share = 0.02
    latency_factor: float = Field(
        4, description="The reported mean may be above the recorded one, or below its least, by this factor."
    )
    latency_slack_s: float = Field(0.004, description="It may be above the recorded one by this much in any case.")

    @field_validator("pattern")
    @classmethod
    def _has_groups(cls, value: str) -> str:
        groups = compiled(value).groupindex
        if not {"count", "mean_ms", "max_ms"} <= set(groups):
            raise ValueError("the groups count, mean_ms and max_ms are needed")
        return value


#: Share of its time for which a program was kept from a core, from which that may explain a high latency.
_NOTABLE_DELAY = 0.01
#: By how much counts excused by the machine may raise the credit before the report counts as undecided.
_DOUBTFUL_SHARE = 0.1


def reported_traffic(context: Context, p: ReportedTraffic) -> Finding:
    """Judge each row: half for the count, half for the latency."""
    parts, best, reasons, texts = [], [], [], []
    untold: list[str] = []
    claims = {row.name: _claimed(context, p, row) for row in p.rows}
    # Where nothing was sent, and nothing is said to have come, that is charged with the traffic.
    rows = [r for r in p.rows if _written(context, r.topic) or ((said := claims[r.name]) is not None and said.count)]
    expected = (
        f"for each profile the messages delivered (± {percent(p.count_tolerance)}) and a latency that is possible"
    )
    if not rows:
        return not_reached("Nothing was sent on any of the topics, which is charged above.", expected=expected)
    for row in rows:
        claim = claims[row.name]
        if claim is None:
            parts.append(0.0)
            best.append(0.0)
            untold.append(row.name)
            continue
        shares, text, reason = _judge_row(context, p, row, claim)
        parts.append(shares[0])
        best.append(shares[1])
        texts.append(text)
        reasons += [reason] if reason else []
    reasons += [f"There is no line with count and latency for {', '.join(untold)}."] if untold else []
    hint = _ROW_HINT.format(untold[0]) if untold else _SIDES_HINT if all("incompatible" in r for r in reasons) else ""
    measured = "; ".join(texts) or "no results"
    spot = context.output_of(p.artifact)
    if sum(best) - sum(parts) > _DOUBTFUL_SHARE * len(parts):
        late = "The machine kept the program from a core for times in which it may have lost what it did not count."
        return inconclusive(expected, measured, late, where=(spot,))
    return graded(sum(best) / len(best), expected, measured, " ".join(reasons), hint=hint, where=(spot,))


_ROW_HINT = "Print a line for each profile, as '{}: 1000 msgs, avg latency: 0.50ms, max: 2.00ms'."
_SIDES_HINT = "Give publisher and subscription of a profile the same QoSProfile; then messages arrive."


def _claimed(context: Context, p: ReportedTraffic, row: Row) -> ResultRow | None:
    """Return what is printed about a row: in the pattern's form, or in another that can be read."""
    output = context.session.output_of(p.artifact)
    lines = [plain_numbers(line.text[:LINE_LIMIT]) for line in output]
    for loosely in (False, True):
        for place in lines_naming(lines, row.name, loosely=loosely):
            if match := search(p.pattern, lines[place]):
                mean_s, max_s = (_signed(match, name) / 1e3 for name in ("mean_ms", "max_ms"))
                rounding_s = rounding_of(match["mean_ms"], 1e-3)
                return ResultRow(output[place].t_ns, int(match["count"]), mean_s, max_s, rounding_s)
        others = [other.name for other in p.rows if other is not row]
        if (found := result_row(output, row.name, others, loosely=loosely)) is not None:
            return found
    return None


def _signed(match: Match[str], name: str) -> float:
    """Return a group as a number, negative if a minus that the pattern skipped stands right before it."""
    value = float(match[name])
    return -value if value > 0 and match.string[: match.start(name)].endswith("-") else value


def _judge_row(context: Context, p: ReportedTraffic, row: Row, got: ResultRow) -> tuple[tuple[float, float], str, str]:
    """Judge a row: half for the count, half for the latency; numbers that cannot be are worth nothing together.

    The first share takes the count as it is, the second excuses what the machine may have kept from the program.
    """
    written = min((_written(context, row.topic, t) for t in (None, got.t_ns)), key=lambda n: abs(n - got.count))
    latency = "no latency" if got.mean_s is None else f"{got.mean_s * 1e3:.2f} ms"
    text = f"{row.name} {got.count} of {written}, {latency}"
    counted = f"{row.name} reports {got.count} messages"
    if not student_endpoints(context, row.topic, "subscription"):
        return (0.0, 0.0), text, f"{counted}, but nothing subscribes to {row.topic}."
    if not got.count and (policy := _self_clash(context, row.topic)):
        return (0.5, 0.5), text, f"{counted}, as its own two sides are incompatible in {policy}: none can arrive."
    slack = max(3.0, p.count_tolerance * written)
    if not written - slack - _overwritten(context, p, row) <= got.count <= written + slack:
        return (0.0, 0.0), text, f"{counted}; {written} were published.{_all_together(context, p, got.count)}"
    problem = _latency_problem(context, p, row, got)
    share = 0.5 if problem else 1.0
    if not problem and got.max_s is None:
        share, problem = 0.75, f"{row.name} reports no largest latency."
    best = 1.0 if _late_by_the_machine(context, p, row, got) else share
    return (share if got.count >= written - slack else 0.0, best), text, problem


def _late_by_the_machine(context: Context, p: ReportedTraffic, row: Row, got: ResultRow) -> bool:
    """Whether a mean latency is only higher than what was recorded, and by no more than the machine held it up."""
    latencies = _latencies_s(context, row.topic)
    run = context.session.process(p.artifact)
    if got.mean_s is None or got.max_s is None or run is None or not len(latencies):
        return False
    delay_s, length_s = _delay_s(context, run)
    explained = float(np.mean(latencies)) <= got.mean_s <= float(np.mean(latencies)) + delay_s
    return delay_s > _NOTABLE_DELAY * length_s and explained and got.mean_s <= got.max_s + 1e-5


def _self_clash(context: Context, topic: str) -> str | None:
    """Return the policy in which the student's subscription asks for more than the student's publisher offers."""
    offers = student_endpoints(context, topic, "publisher")
    requests = student_endpoints(context, topic, "subscription")
    if not offers or not requests:
        return None
    return clash(requests[0], offers[0].qos)


def _all_together(context: Context, p: ReportedTraffic, count: int) -> str:
    """Say so if a count is that of all rows together: their callbacks share a loop's variable."""
    every = sum(_written(context, row.topic) for row in p.rows)
    if len(p.rows) < 2 or abs(count - every) > p.count_tolerance * every:
        return ""
    return (
        " That is as many as on all topics together: a lambda made in a loop sees the loop's last name, "
        "unless it is bound as in `lambda msg, name=name: ...`."
    )


def _overwritten(context: Context, p: ReportedTraffic, row: Row) -> float:
    """Return how many messages may have been overwritten in a short queue while the machine held the tool up."""
    timing = timing_of(context.session.stream(row.topic), None)
    run = context.session.process(p.artifact)
    if timing is None or run is None:
        return 0.0
    return timing.rate_hz * _delay_s(context, run)[0]


def _latency_problem(context: Context, p: ReportedTraffic, row: Row, got: ResultRow) -> str:
    """Say why a reported latency cannot be, or nothing.

    Nothing is delivered much sooner than the soonest that was recorded; later is a matter of the machine.
    """
    if got.mean_s is None:
        return f"{row.name} reports {got.count} messages, but no latency."
    latencies = _latencies_s(context, row.topic)
    if not len(latencies):
        return ""
    if _stamped_otherwise(context, latencies):
        return f"What is sent on {row.topic} carries time stamps that are not those of its sending."
    truth_s = float(np.mean(latencies))
    least_s = float(np.min(latencies)) / p.latency_factor
    most_s = max(truth_s * p.latency_factor, truth_s + p.latency_slack_s)
    in_order = got.max_s is None or got.mean_s <= got.max_s + 1e-5
    if least_s - got.rounding_s <= got.mean_s <= most_s + got.rounding_s and got.mean_s >= 0 and in_order:
        return ""
    most = f" (max {got.max_s * 1e3:.2f} ms)" if got.max_s is not None else ""
    mean_ms = apart(got.mean_s * 1e3, *([] if got.max_s is None else [got.max_s * 1e3]), places=2)
    reported = f"{row.name} reports a mean latency of {mean_ms} ms{most}"
    slip = " No message arrives before it was sent: subtract the other way round." if got.mean_s < 0 else ""
    if least_s <= 1e3 * got.mean_s <= most_s:
        slip = " It would be right in s: times 1000, it is in ms."
    return f"{reported}; recorded was {truth_s * 1e3:.2f} ms.{slip}"


#: Median latencies that no message has within a machine, unless the recorder lacked a core for this share of the time.
_LEAST_MEDIAN_S, _MOST_MEDIAN_S, _RECORDER_BUSY = -0.001, 0.03, 0.2


def _stamped_otherwise(context: Context, latencies: Floats) -> bool:
    """Whether messages did not leave when they are stamped: their stamps are the work of the student's process."""
    record = context.session.record
    span = Span(record.started_ns, record.ended_ns)
    busy = context.session.recorder_delay_s(span) > _RECORDER_BUSY * span.duration_s
    plausible = _LEAST_MEDIAN_S <= float(np.median(latencies)) <= _MOST_MEDIAN_S
    return not plausible and not busy and not clock_step_s(record, span)


def _latencies_s(context: Context, topic: str) -> Floats:
    stream = context.session.stream(topic)
    return (stream.received_ns - stream.source_ns) / 1e9
