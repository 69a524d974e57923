"""Check of the numbers that a tool prints about the messages of its QoS profiles."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from grader.own_checks import (
    Artifact,
    Context,
    Delayed,
    Finding,
    Location,
    Outcome,
    Part,
    Pattern,
    ResultRow,
    Run,
    Share,
    Topic,
    apart,
    check,
    failed,
    idle_callback,
    late_lambda,
    not_reached,
    of_parts,
    percent,
)


class Row(BaseModel):
    """The line of the results that begins with a name and reports on a topic."""

    name: str
    topic: Topic


class ReportedTraffic(BaseModel):
    """Reported counts and latencies agree with the recording; each row is a part."""

    artifact: Artifact
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
    least_matched: Share = Field(
        0.0,
        description="Least share of rows whose messages can arrive; with fewer of them, the table compares nothing.",
    )


#: Results by the names of their rows; None if a row was not printed.
_Claims = Mapping[str, ResultRow | None]


@check(commands=("python3 {artifact}",))
def reported_traffic(context: Context, p: ReportedTraffic) -> Finding:
    """Judge each row: half for the count, half for the latency.

    A table with an impossible latency in each of its rows misleads, and earns half of the rest.
    """
    names = [row.name for row in p.rows]
    claims = context.result_rows(p.artifact, names, p.pattern)
    rows = [row for row in p.rows if _has_traffic(context, row, claims)]
    expected = _expected_rows(p)
    if not rows:
        reason = "Not tested, because nothing was sent on any of the topics."
        return not_reached(reason, expected=expected)
    printed = [claim for claim in claims.values() if claim is not None]
    constants = _written_beforehand(context, p, printed)
    if constants:
        return _all_constants(expected, constants)
    finding = _judge_rows(context, p, rows, claims, expected)
    finding = _explained_by_lambda(context, p, finding, printed)
    unmeasured = _unmeasured(context, p, rows, claims, finding)
    return replace(finding, unmeasured=unmeasured)


def _judge_rows(
    context: Context, p: ReportedTraffic, rows: Sequence[Row], claims: _Claims, expected: str
) -> Finding:
    """Judge the rows on topics with messages."""
    run = context.process(p.artifact)
    delay = Delayed(0.0, 1.0)
    if run is not None:
        started_s, ended_s = context.life(run)
        delay = context.delayed(run, started_s, ended_s)
    parts = []
    measured = "no results"
    for row in rows:
        part = _judge_reported(context, p, row, claims[row.name], delay)
        parts.append(part)
        if part.text:
            measured = ""
    where = context.output_location(p.artifact)
    parts = _with_shared_latency(rows, claims, parts)
    parts = _misleading(parts)
    parts = _nothing_compared(context, p, rows, parts)
    return of_parts(expected, parts, measured=measured, where=(where,), doubt=delay.why)


def _expected_rows(p: ReportedTraffic) -> str:
    tolerance = (
        f"± {percent(p.count_tolerance)}, fewer if a full queue lost some on a busy computer"
    )
    return f"for each profile the messages delivered ({tolerance}) and a latency that is possible"


def _explained_by_lambda(
    context: Context, p: ReportedTraffic, finding: Finding, printed: Sequence[ResultRow]
) -> Finding:
    """Name the lambda of a loop if all messages were counted for one row."""
    path = context.path_of(p.artifact) or ""
    late = late_lambda(context.text(path) or "")
    counting = [row for row in printed if row.count]
    if late is None:
        return finding
    if len(printed) < 2 or len(counting) != 1:
        return finding
    line, name = late
    reason = f"{finding.reason} All callbacks count for one row: the lambda in line {line} is called after the loop, and "
    reason += f"sees the last value of {name}."
    hint = f"Keep the value as a default: lambda message, {name}={name}: ..."
    where = (Location(file=path, line=line), *finding.where)
    return replace(finding, reason=reason, hint=hint, where=where)


def _has_traffic(context: Context, row: Row, claims: _Claims) -> bool:
    """Tell whether messages were sent on a topic, or are said to have come.

    Another check charges a topic without messages.
    """
    claim = claims[row.name]
    if claim is not None and claim.count:
        return True
    return _written(context, row.topic) > 0


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


@dataclass(frozen=True)
class _RowPart(Part):
    """Judgement of one row."""

    #: True if its count is right and its latency impossible, whatever the machine delayed.
    has_impossible_latency: bool = False


def _misleading(parts: Sequence[_RowPart]) -> list[_RowPart]:
    """Halve the shares of a table with several latencies if all of them are impossible."""
    impossible = sum(part.has_impossible_latency for part in parts)
    if impossible < max(2, len(parts)):
        return list(parts)
    return [replace(part, share=part.share / 2, best=part.share / 2) for part in parts]


#: Least of the largest latencies, in s, at which equal ones are no coincidence: printed to 0.01 ms, it has many values.
_LEAST_SHARED_S = 0.0002
#: Least number of rows with the same latencies.
_MANY_ROWS = 3


def _with_shared_latency(
    rows: Sequence[Row], claims: _Claims, parts: Sequence[_RowPart]
) -> list[_RowPart]:
    """Return the parts, with half of their credit if all rows print one and the same mean and largest latency."""
    printed = set()
    for row in rows:
        claim = claims[row.name]
        if claim is None or claim.max_s is None:
            return list(parts)
        printed.add((claim.mean_s, claim.max_s))
    mean_s, most_s = next(iter(printed))
    if len(printed) > 1 or len(rows) < _MANY_ROWS:
        return list(parts)
    if mean_s is None or most_s is None or most_s < _LEAST_SHARED_S:
        return list(parts)
    latencies = f"{mean_s * 1e3:.2f} ms and at most {most_s * 1e3:.2f} ms"
    reason = f"All rows print the same latencies, {latencies}, so these are not their own."
    hint = "Keep a list of latencies for each profile."
    shared = []
    for part in parts:
        half = min(part.share, 0.5)
        shared.append(
            replace(
                part, share=half, best=half, reason=reason, hint=hint, has_impossible_latency=True
            )
        )
    return shared


def _nothing_compared(
    context: Context, p: ReportedTraffic, rows: Sequence[Row], parts: Sequence[_RowPart]
) -> list[_RowPart]:
    """Return the parts, all without credit if too few rows can have messages."""
    matched = len(rows)
    for row in rows:
        unheard = ""
        if context.endpoints(row.topic, "subscription"):
            unheard = context.unheard(row.topic)
        if unheard:
            matched -= 1
    if matched >= p.least_matched * len(rows):
        return list(parts)
    nothing = [replace(part, share=0.0, best=0.0) for part in parts]
    first = nothing[0]
    reason = f"Messages can arrive for {matched} of {len(rows)} rows, which is too few to compare. {first.reason}"
    nothing[0] = replace(first, reason=reason.strip())
    return nothing


def _judge_reported(
    context: Context, p: ReportedTraffic, row: Row, claim: ResultRow | None, delay: Delayed
) -> _RowPart:
    """Judge the printed numbers of one row."""
    if claim is None:
        reason = f"There is no line with count and latency for {row.name}."
        hint = f"Print a line for each profile, as '{row.name}: 1000 msgs, avg latency: 0.50ms, max: 2.00ms'."
        return _RowPart(0.0, reason=reason, hint=hint)
    run = context.process(p.artifact)
    written = _nearest_count(context, row, claim)
    usual = _usual_lateness(context, run, row.topic, written)
    pushed_out = written * delay.delay_s / delay.length_s
    worst = _worst_lateness(context, run, usual, pushed_out)
    judged = _judge_row(context, p, row, claim, written, usual)
    best = _judge_row(context, p, row, claim, written, worst)
    if claim.mean_s is None:
        latency = "no latency"
    else:
        latency = f"{claim.mean_s * 1e3:.2f} ms"
    text = (
        f"{row.name} {claim.count} of {written}{_pushed_out(p, claim, written, usual)}, {latency}"
    )
    hint = ""
    if "incompatible" in judged.reason:
        hint = "Give publisher and subscription of a profile the same QoSProfile; then messages arrive."
    return _RowPart(
        judged.share,
        text,
        judged.reason,
        best.share,
        hint=hint,
        has_impossible_latency=best.has_impossible_latency,
    )


def _pushed_out(p: ReportedTraffic, claim: ResultRow, written: int, usual: _Lateness) -> str:
    """Say how many messages the busy computer can have cost, if a count is lower than its tolerance."""
    missing = written - claim.count
    if missing <= _count_slack(p, written):
        return ""
    if usual.pushed_out < 1:
        return ""
    return f" (a full queue may have lost {int(usual.pushed_out)})"


def _count_slack(p: ReportedTraffic, written: int) -> float:
    """Return by how many messages a count may be off."""
    return max(3.0, p.count_tolerance * written)


def _nearest_count(context: Context, row: Row, claim: ResultRow) -> int:
    """Return the number of messages, of all or until the row was printed, that is nearest to the claim."""
    printed_s = context.since_start_s(claim.t_ns)
    counts = (_written(context, row.topic), _written(context, row.topic, printed_s))
    return min(counts, key=lambda count: abs(count - claim.count))


def _written(context: Context, topic: str, until_s: float = math.inf) -> int:
    """Return the number of messages written to a topic, up to a time in s if one is given."""
    messages = context.messages(topic)
    sequence = messages.sequence[messages.sent_s <= until_s]
    return int(sequence.max(initial=0))


def _usual_lateness(
    context: Context, run: Run | None, topic: str, written: int
) -> _Lateness:
    """Return the effects that the machine delays surely had."""
    if run is None:
        return _Lateness(0.0, 0.0)
    pushed_out = min(_unheld(context, run, topic), _MOST_UNHELD * written)
    return _Lateness(_waits_s(context, run, topic), pushed_out)


def _worst_lateness(
    context: Context, run: Run | None, usual: _Lateness, pushed_out: float
) -> _Lateness:
    """Return the greatest possible effects of the machine delays.

    A message that waits for a core comes late, and may push waiting ones out of a short queue.
    """
    late_s = 0.0
    if run is not None:
        late_s = context.backlog(run, *context.life(run)).late_s
    return _Lateness(max(late_s, usual.late_s), pushed_out)


def _unmeasured(
    context: Context, p: ReportedTraffic, rows: Sequence[Row], claims: _Claims, finding: Finding
) -> str | None:
    """Say which counts cannot come from received messages; None if all can."""
    counted = []
    unheard = []
    for row in rows:
        claim = claims[row.name]
        if claim is None or not claim.count:
            continue
        counted.append(row)
        if not context.endpoints(row.topic, "subscription"):
            unheard.append(row.topic)
    if unheard:
        topics = ", ".join(unheard)
        return f"It counts messages on {topics}, to which nothing of the submission subscribes."
    count = len(rows)
    has_failed = finding.outcome is Outcome.FAILED
    if has_failed and len(counted) == count > 1:
        return f"None of the {count} counts that it prints is that of the messages in the recording."
    path = context.path_of(p.artifact) or ""
    line = idle_callback(context.text(path) or "")
    if counted and line is not None:
        return f"It counts messages, but no callback of its subscriptions ({path}, line {line}) keeps anything of one."
    return None


_NUMBER = re.compile(r"(?<![\w.])\d{1,15}(?:\.\d{1,15})?(?:[eE]-?\d{1,2})?(?![\w.])")
#: Characters of a line of the source that are read.
_LINE_LIMIT = 1000
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
    held = _numbers_in(context.text(path) or "")
    latencies: set[float] = set()
    for claim in claims:
        if claim.count not in held:
            return []
        for value in (claim.mean_s, claim.max_s):
            if value:
                latencies.add(value)
    if len(latencies) < _LEAST_LATENCIES:
        return []
    for unit in _UNITS:
        lines = _lines_of([value * unit for value in latencies], held)
        if lines:
            return [Location(file=path, line=line) for line in lines[:_MOST_LINES]]
    return []


def _numbers_in(source: str) -> dict[float, int]:
    """Return the numbers in a source, each with the last line that holds it."""
    held = {}
    for number, line in enumerate(source.splitlines(), 1):
        for text in _NUMBER.findall(line[:_LINE_LIMIT]):
            held[float(text)] = number
    return held


def _lines_of(values: Sequence[float], held: Mapping[float, int]) -> list[int]:
    """Return the lines that hold some values, in their order; empty if one of the values is missing."""
    lines = set()
    for value in values:
        line = _line_of(value, held)
        if line is None:
            return []
        lines.add(line)
    return sorted(lines)


def _line_of(value: float, held: Mapping[float, int]) -> int | None:
    """Return the line of the first number that is close to a value."""
    for number, line in held.items():
        if math.isclose(number, value):
            return line
    return None


#: Greatest share of the messages that is excused as lost from a queue.
_MOST_UNHELD = 0.1


def _unheld(context: Context, run: Run, topic: str) -> float:
    """Return the number of messages that a queue lost while its node had no core.

    As many may be missing in a true count. One message may have come just as the node began to wait.
    """
    claim = context.claim("subscription", topic)
    depth = 1
    if claim is not None and claim.qos is not None:
        depth = claim.qos.depth
    times_s = context.messages(topic).sent_s
    if len(times_s) < 2:
        return 0.0
    lasted_s = float(times_s[-1] - times_s[0])
    period_s = lasted_s / (len(times_s) - 1)
    room_s = (depth - 1) * period_s
    start_s, end_s = context.life(run)
    backlog = context.backlog(run, start_s, end_s, room_s)
    return backlog.lost_s / max(period_s, 1e-9)


def _waits_s(context: Context, run: Run, topic: str) -> float:
    """Return the mean time in seconds that a message waits because the machine delays its node.

    It is half of a delay, weighed by the share of time in that delay. Other waiting is not included.
    """
    times_s = context.messages(topic).sent_s
    if len(times_s) < 2:
        return 0.0
    start_s = float(times_s[0])
    end_s = float(times_s[-1])
    delays_s = context.noted_delays_s(run, start_s, end_s)
    squares = float((delays_s**2).sum())
    lasted_s = max(end_s - start_s, 1e-9)
    return squares / 2 / lasted_s


@dataclass(frozen=True)
class _Judged:
    """Credit of a row, and the reason if it is not full."""

    share: float
    reason: str = ""
    has_impossible_latency: bool = False


def _judge_row(
    context: Context,
    p: ReportedTraffic,
    row: Row,
    got: ResultRow,
    written: int,
    lateness: _Lateness,
) -> _Judged:
    """Judge a row. An impossible count earns nothing for the latency either."""
    counted = f"{row.name} reports {got.count} messages"
    if not got.count:
        unheard = context.unheard(row.topic)
        if unheard:
            return _Judged(0.0, f"{counted}, so nothing was measured. {unheard}")
    if not context.endpoints(row.topic, "subscription"):
        return _Judged(0.0, f"{counted}, but nothing subscribes to {row.topic}.")
    slack = _count_slack(p, written)
    least = written - slack - lateness.pushed_out
    if not least <= got.count <= written + slack:
        return _Judged(0.0, f"{counted}; {written} were published.")
    return _judge_latency(context, p, row, got, lateness.late_s)


def _judge_latency(
    context: Context, p: ReportedTraffic, row: Row, got: ResultRow, late_s: float
) -> _Judged:
    """Judge the latency of a row with a right count."""
    if got.mean_s is None:
        return _Judged(0.5, f"{row.name} reports {got.count} messages, but no latency.")
    messages = context.messages(row.topic)
    latencies = messages.received_s - messages.sent_s
    problem = ""
    if len(latencies):
        if _stamped_otherwise(context, latencies):
            reason = f"The messages on {row.topic} have time stamps that are not their times of publication."
            return _Judged(0.5, reason)
        problem = _impossible_latency(context, p, row, got, got.mean_s, latencies, late_s)
    if problem:
        return _Judged(0.5, problem, has_impossible_latency=True)
    if got.max_s is None:
        return _Judged(0.75, f"{row.name} reports no largest latency.")
    return _Judged(1.0)


#: Factors that make seconds of a mean in another unit, each with a sentence about it.
_SLIPS = (
    (1e3, "The value is right in seconds; multiply it by 1000 for ms."),
    (1e-3, "The value is right in µs; divide it by 1000 for ms."),
)


def _impossible_latency(
    context: Context,
    p: ReportedTraffic,
    row: Row,
    got: ResultRow,
    mean_s: float,
    latencies: NDArray[np.float64],
    late_s: float,
) -> str:
    """Say why a reported latency is impossible; empty if it is possible.

    No message comes much sooner than the soonest recorded one; a later one depends on the machine.

    Parameters
    ----------
    latencies
        float64[n]: Recorded latencies, in s.
    late_s
        Lateness that the machine can have caused, in s.
    """
    truth_s = float(np.mean(latencies))
    least_s = float(np.min(latencies)) / p.latency_factor
    most_s = max(truth_s * p.latency_factor, truth_s + p.latency_slack_s)
    most_s += late_s
    if _is_possible(got, mean_s, least_s, most_s):
        return _impossible_largest(context, row, got, mean_s, latencies)
    reported = _reported_latency(row, got, mean_s)
    reason = f"{reported}; recorded was {truth_s * 1e3:.2f} ms."
    for factor, said in _SLIPS:
        # Without the slack, which a much larger value would hide in.
        if least_s <= factor * mean_s <= truth_s * p.latency_factor + late_s:
            return f"{reason} {said}"
    return reason


def _is_possible(got: ResultRow, mean_s: float, least_s: float, most_s: float) -> bool:
    """Tell whether a mean latency lies between two bounds, and not above the largest one."""
    if mean_s < 0:
        return False
    if got.max_s is not None and mean_s > got.max_s + 1e-5:
        return False
    low_s = least_s - got.rounding_s
    high_s = most_s + got.rounding_s
    return low_s <= mean_s <= high_s


#: The largest of so many latencies is surely above the usual one.
_MANY_MESSAGES = 100


def _impossible_largest(
    context: Context, row: Row, got: ResultRow, mean_s: float, latencies: NDArray[np.float64]
) -> str:
    """Say that half of many messages took longer than the largest reported latency; empty if they did not.

    A program may hear messages sooner than the recorder. Its slowest of many is still slower than
    a usual one of the recorder: 25 times or more in the recorded tools of the lab.
    """
    if got.max_s is None:
        return ""
    if len(latencies) < _MANY_MESSAGES:
        return ""
    usual_s = float(np.median(latencies))
    if got.max_s + got.rounding_s >= usual_s:
        return ""
    if _is_recorder_delayed(context):
        return ""
    reported = _reported_latency(row, got, mean_s)
    return f"{reported}; half of the recorded messages took {usual_s * 1e3:.2f} ms or longer."


def _reported_latency(row: Row, got: ResultRow, mean_s: float) -> str:
    """State the reported mean latency and the largest one."""
    if got.max_s is None:
        mean_ms = apart(mean_s * 1e3, places=2)
        return f"{row.name} reports a mean latency of {mean_ms} ms"
    max_ms = got.max_s * 1e3
    mean_ms = apart(mean_s * 1e3, max_ms, places=2)
    return f"{row.name} reports a mean latency of {mean_ms} ms (max {max_ms:.2f} ms)"


#: Bounds in seconds of median latencies within a machine, valid up to a delayed share of the recorder's time.
_LEAST_MEDIAN_S, _MOST_MEDIAN_S, _RECORDER_BUSY = -0.001, 0.03, 0.2


def _stamped_otherwise(context: Context, latencies: NDArray[np.float64]) -> bool:
    """Tell whether the student's process stamped messages with other times than the publication."""
    median_s = float(np.median(latencies))
    if _LEAST_MEDIAN_S <= median_s <= _MOST_MEDIAN_S:
        return False
    if _is_recorder_delayed(context):
        return False
    return not context.clock_step_s(0.0, context.duration_s)


def _is_recorder_delayed(context: Context) -> bool:
    """Tell whether the recorder was delayed too often for its times to be usual ones."""
    end_s = context.duration_s
    return context.recorder_delay_s(0.0, end_s) > _RECORDER_BUSY * end_s
