"""Checks of numbers that a node prints: a report on each message, and statistics at its end."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from grader.own_checks import (
    Artifact,
    CheckId,
    Context,
    EarlierCheckId,
    FieldPath,
    Finding,
    Loadable,
    Location,
    NumericStream,
    Outcome,
    Pattern,
    Patterns,
    PrintedVector,
    Report,
    Run,
    SessionId,
    Share,
    Topic,
    apart,
    appended_again,
    check,
    debug_log,
    excused,
    failed,
    graded,
    hidden_exception,
    passed,
    quantise,
    unclear,
    unexplained,
)

Integers = NDArray[np.int64]


#: Credit levels of a measured share.
_LEVELS = 10


class Streams(BaseModel):
    """Base of checks that compare an artifact's reports with an oracle over recorded topics."""

    artifact: Artifact
    streams: Mapping[str, Topic] = Field(description="Role that the oracle knows -> topic.")
    field: FieldPath
    oracle: Loadable = Field(description="file.py:function beside the rubric.")
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
        return context.oracle(self.oracle)(streams, parameters, context.seed)

    def recorded(self, context: Context) -> dict[str, NumericStream] | None:
        """Return the streams by role, or None if one of them was not recorded."""
        streams = context.streams(self.streams, self.field)
        if len(streams) < len(self.streams):
            return None
        return streams

    def longest(self, context: Context) -> Integers:
        """Return the source timestamps of the recorded stream with the most messages."""
        times_ns = []
        for stream in context.streams(self.streams, self.field).values():
            times_ns.append(stream.source_ns)
        return max(times_ns, key=len)


_NO_STIMULUS = "Commands and states were not recorded, so there is nothing to compare with."


class Alternative(BaseModel):
    """A known way to get other numbers, and how much credit it leaves."""

    parameters: Mapping[str, Any]
    meaning: str
    credit: float = Field(0.0, ge=0, le=1)
    cause: str | None = Field(
        None,
        description="Name of the mistake, by default its parameters; only its dearest check is charged.",
    )
    charged_by: tuple[EarlierCheckId, ...] = Field(
        (), description="Where one of these checks took points, none are lost here."
    )
    stores_one_object: str | None = Field(
        None,
        description="Words for numbers of one object that is stored again and again, if the source does not show where.",
    )
    each: bool = Field(
        False,
        description="The mistake leaves little of use: each check that it fails loses its own points.",
    )

    def explains(
        self, context: Context, artifact: str, finding: Finding, least: float = 0.0
    ) -> Finding:
        """State the credit of numbers that match this mistake, and name it.

        The share of right numbers is the least credit. A mistake that costs nothing is excused.
        """
        meant, hint, places = self._meant(context, artifact)
        reason = f"{finding.reason} {meant}".strip()
        judged = _regraded(finding, max(self.credit, least), reason)
        judged = replace(judged, hint=hint, where=(*places, *finding.where))
        if judged.outcome is Outcome.PASSED:
            return excused(judged, meant)
        if self.each:
            return judged
        cause = self.cause
        if not cause:
            cause = f"{artifact}: {dict(self.parameters)}"
        return context.charge(judged, cause, self.charged_by)


    def _meant(self, context: Context, artifact: str) -> tuple[str, str, Sequence[Location]]:
        """Name the mistake, with its remedy and its place if the source shows them."""
        meant = f"Your numbers match {self.meaning}"
        if self.stores_one_object is None:
            return f"{meant}.", "", ()
        path = context.path_of(artifact)
        stored = None
        if path is not None:
            stored = appended_again(str(context.text(path)))
        if stored is None:
            return f"{meant}: {self.stores_one_object}.", "", ()
        line, copying = stored
        reason = f"{meant}: line {line} of {path} appends the same object each time."
        return reason, f"Append a copy in line {line}: `{copying}`.", (Location(file=path, line=line),)


class FewerReports(BaseModel):
    """Known mistake of a node that reports for some messages only."""

    oracle: Loadable = Field(description="file.py:function that counts the reports.")
    meaning: str
    credit: float = Field(ge=0, le=1)


def _regraded(
    finding: Finding, share: float, reason: str, best: float | None = None, doubt: str = ""
) -> Finding:
    """State another share of credit with the texts of a finding."""
    expected, measured = finding.expected, finding.measured
    where, notes = finding.where, finding.notes
    return graded(
        share, expected, measured, reason, where=where, notes=notes, best=best, doubt=doubt
    )


class ReportShare(BaseModel):
    """Share of messages with a report, among those that an oracle counts as reportable."""

    oracle: Loadable = Field(description="file.py:function beside the rubric.")
    full_from: Share = 0.9
    costs: Share = Field(
        0.25, description="Share of the credit that a node loses which reports for next to none."
    )
    fewer: tuple[FewerReports, ...] = Field(
        (), description="Known ways to fewer reports; the first with the right number is meant."
    )


class Outdated(BaseModel):
    """Known mistake: the first messages after each change are compared with an older value."""

    meaning: str
    least: int = Field(
        5, description="Number of wrong reports at the start of each span but the first."
    )
    credit: float = Field(ge=0, le=1)


class ReportedSeries(Streams):
    """Numbers that a node reports agree with an oracle's value on each span of time, and come for each message."""

    pattern: Patterns
    share: ReportShare | None = None
    tolerance: float = Field(
        gt=0, description="Absolute; 1 % of the value, and what rounding makes, are allowed too."
    )
    settle_s: float = Field(0.05, description="Reports this close to a span's ends do not count.")
    alternatives: tuple[Alternative, ...] = ()
    outdated: Outdated | None = None
    least_reached: Share | None = Field(
        None,
        description="A node that ends early is judged by the spans that it reached, and by this share of all at least.",
    )
    end_charged_by: CheckId | None = Field(
        None, description="Name in earlier rubrics; any check means least_reached: 0.5."
    )

    @property
    def judged_at_least(self) -> float | None:
        """Least share of spans for the judgement of an ended node; None for all."""
        if self.end_charged_by is not None:
            return 0.5
        return self.least_reached


@dataclass(frozen=True)
class _Plateau:
    """A span of the oracle with its value, and the node's reports within it."""

    start_ns: int
    end_ns: int
    right: float
    reports: tuple[Report, ...]

    @property
    def value(self) -> float | None:
        """The median of the reports; None without any."""
        values = [report.value for report in self.reports]
        if not values:
            return None
        return float(np.median(values))

    def is_right(self, p: ReportedSeries) -> bool:
        """Tell whether the value is right, up to the rounding of the printed numbers."""
        if self.value is None:
            return False
        roundings = [report.rounding for report in self.reports if report.rounding]
        rounding = min(roundings, default=0.0)
        hundredth = 0.01 * abs(self.right)
        slack = max(p.tolerance, hundredth, rounding * 1.01)
        return abs(self.value - self.right) <= slack

    def wrong_at_start(
        self, heard: Sequence[Report], earlier: Sequence[_Plateau], p: ReportedSeries
    ) -> int:
        """Count the wrong reports from the span's start to its first right one.

        Late reports of an earlier plateau do not count.
        """
        start_ns = self.start_ns - int(p.settle_s * 1e9)
        count = 0
        for report in heard:
            if not start_ns <= report.t_ns <= self.end_ns:
                continue
            alone = replace(self, reports=(report,))
            if alone.is_right(p):
                break
            if not alone.has_value_of(earlier, p):
                count += 1
        return count

    def has_value_of(self, earlier: Sequence[_Plateau], p: ReportedSeries) -> bool:
        """Tell whether the value would be right on one of some earlier plateaus."""
        for each in earlier:
            as_then = replace(self, right=each.right)
            if as_then.is_right(p):
                return True
        return False


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
        start_ns = each["start_ns"] + settle_ns
        end_ns = each["end_ns"] - settle_ns
        right = float(each["value"])
        inside = []
        for report in heard:
            if start_ns <= report.t_ns <= end_ns:
                inside.append(report)
        found.append(_Plateau(start_ns, end_ns, right, tuple(inside)))
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
        last = 0
        for number, plateau in enumerate(self.plateaus, 1):
            if plateau.reports:
                last = number
        return last

    @property
    def unreported(self) -> int:
        """Number of plateaus without a report before the last right one."""
        count = 0
        before = 0
        for plateau, fits in zip(self.plateaus, self.fits, strict=True):
            if not plateau.reports:
                count += 1
            if fits:
                before = count
        return before

    def behind(self, p: ReportedSeries) -> list[_Plateau]:
        """Return the wrong plateaus that have the value of an earlier one."""
        found = []
        earlier: list[_Plateau] = []
        for plateau, fits in zip(self.plateaus, self.fits, strict=True):
            if not fits and plateau.has_value_of(earlier, p):
                found.append(plateau)
            earlier.append(plateau)
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
    #: Share of credit that a known mistake with as many reports leaves.
    leaves: float = 1.0

    def credit(self, finding: Finding, p: ReportShare) -> float:
        """Return the credit of a finding, less the cost of messages without a report."""
        return _credit_left(finding, p, self.share) * self.leaves

    def best_credit(self, finding: Finding, p: ReportShare) -> float:
        """Return the credit if the machine caused as many losses as it can have; it may have caused all of them."""
        best = _credit_left(finding, p, self.best)
        if self.best < 1:
            best *= self.leaves
        return best


@check(commands=("python3 {artifact}", "ros2 bag play recordings/{session} --topics {streams}"))
def reported_series(context: Context, p: ReportedSeries) -> Finding:
    """Judge each span by the median of its reports, less the cost of messages without a report."""
    finding = _right_values(context, p)
    if p.share is None:
        return finding
    if finding.outcome not in (Outcome.PASSED, Outcome.PARTIAL):
        return finding
    count = _report_share(context, p, p.share)
    if count.share >= 1.0:
        return finding
    both = replace(finding, measured=f"{finding.measured}; {count.measured}")
    reason = f"{finding.reason} {count.reason}".strip()
    share = count.credit(finding, p.share)
    best = count.best_credit(finding, p.share)
    less = _regraded(both, share, reason, best, count.doubt)
    return replace(less, causes=finding.causes)


def _credit_left(finding: Finding, p: ReportShare, share: float) -> float:
    """Return the credit of a finding, less the cost of messages without a report."""
    unreported = 1 - quantise(min(1.0, share))
    left = 1 - p.costs * unreported
    return float(finding.credit) * left


def _right_values(context: Context, p: ReportedSeries) -> Finding:
    """Judge the share of plateaus with right reports."""
    heard = context.reports(p.artifact, p.pattern)
    plateaus = _plateaus(context, p, heard)
    count = len(plateaus)
    expected = f"the right value in each of {count} phases of constant commands and states, ± {p.tolerance:g} or 1%"
    if not plateaus:
        return unclear(expected, "no stimulus recorded", _NO_STIMULUS)
    if not heard:
        return _no_report(context, p, expected)
    series = _Series(plateaus, [plateau.is_right(p) for plateau in plateaus])
    topic = next(iter(p.streams.values()))
    where = (context.output_location(p.artifact), context.location(topic))
    measured = f"right in {series.right} of {count} phases ({len(heard)} reports)"
    if series.right == count:
        right = passed(expected, measured, where=where)
        return _less_if_outdated(p, series, heard, right)
    example = _wrong(context, plateaus[series.fits.index(False)])
    wrong = failed(expected, measured, example, where=where)
    mistake = _mistake(context, p, heard, count)
    if mistake is not None:
        return mistake.explains(context, p.artifact, wrong, series.right / count)
    return _judge_plateaus(context, p, series, wrong)


def _less_if_outdated(
    p: ReportedSeries, series: _Series, heard: Sequence[Report], right: Finding
) -> Finding:
    """Grade right plateaus lower if each one but the first begins with wrong reports."""
    if p.outdated is None:
        return right
    counts = []
    for number, plateau in enumerate(series.plateaus[1:], 1):
        earlier = series.plateaus[:number]
        counts.append(plateau.wrong_at_start(heard, earlier, p))
    fewest = min(counts, default=0)
    if fewest < p.outdated.least:
        return right
    measured = f"{right.measured}; the first {fewest} or more reports of each later phase are wrong"
    reason = f"Your numbers match {p.outdated.meaning}."
    return _regraded(replace(right, measured=measured), p.outdated.credit, reason)


def _no_report(context: Context, p: ReportedSeries, expected: str) -> Finding:
    """State that the node printed no report."""
    run = _last_run(context, p.artifact)
    lines: list[str] = []
    if run is not None:
        end_s = math.inf
        if run.interrupted_s is not None:
            end_s = run.interrupted_s
        lines = [line.text for line in run.lines if line.t_s <= end_s]
    others = ""
    if lines:
        others = f"; it printed {len(lines)} others, the last of which is {lines[-1][:100]!r}"
    reason = f"The node printed no tracking error in the requested form, neither to its output nor to its log{others}."
    nothing = failed(expected, "no report", reason)
    return unexplained(_explained_by_source(context, p.artifact, nothing))


def _source(context: Context, artifact: str) -> tuple[str, str]:
    """Return the path and the text of an artifact; both are empty without a file."""
    path = context.path_of(artifact)
    text = None
    if path is not None:
        text = context.text(path)
    if path is None or text is None:
        return "", ""
    return path, text


def _explained_by_source(context: Context, artifact: str, nothing: Finding) -> Finding:
    """Name the line of a silent `except`, or else of a log below the usual level."""
    path, text = _source(context, artifact)
    line = hidden_exception(text)
    said = "hides each exception of the code above it, so that nothing shows why"
    hint = "Take the try and its except away, run it again, and correct the line that the traceback names."
    if line is None:
        line = debug_log(text)
        said = "logs at the level debug, which is not shown unless it is asked for"
        hint = "Log it with info(), as the lab asks."
    if line is None:
        return nothing
    reason = f"{nothing.reason} Line {line} of {path} {said}."
    where = (Location(file=path, line=line), *nothing.where)
    return replace(nothing, reason=reason, hint=hint, where=where)


def _mistake(
    context: Context, p: ReportedSeries, heard: Sequence[Report], count: int
) -> Alternative | None:
    """Return the first known mistake that matches all reports, of at least half of the plateaus."""
    for other in p.alternatives:
        plateaus = _plateaus(context, p, heard, other.parameters)
        reported = [plateau for plateau in plateaus if plateau.reports]
        if 2 * len(reported) < count:
            continue
        if all(plateau.is_right(p) for plateau in reported):
            return other
    return None


def _judge_plateaus(
    context: Context, p: ReportedSeries, series: _Series, wrong: Finding
) -> Finding:
    """Grade the share of right plateaus, with the texts of a finding about the wrong ones.

    The share of reports charges the plateaus without a report before the last right one.
    """
    not_judged, notes = _after_its_end(context, p, series)
    unreported = series.unreported + not_judged
    judged = max(series.right, series.count - unreported)
    behind = series.behind(p)
    behind += series.plateaus[series.reached :]
    kept, doubt = _kept_behind(context, p, behind)
    share = series.right / judged
    best = min(1.0, (series.right + kept) / judged)
    noted = replace(wrong, notes=notes)
    return _regraded(noted, share, wrong.reason, best, doubt)


def _after_its_end(
    context: Context, p: ReportedSeries, series: _Series
) -> tuple[int, tuple[str, ...]]:
    """Return the number of free plateaus after the node's end, and a note about them."""
    least = p.judged_at_least
    if least is None:
        return 0, ()
    if not _ended_early(context, p, series):
        return 0, ()
    needed = math.ceil(least * series.count)
    note = f"The node ended in phase {series.reached + 1} of {series.count}. "
    note += f"Later phases cost nothing here, if {needed} were reached."
    not_reached = series.count - series.reached
    return min(not_reached, series.count - needed), (note,)


def _ended_early(context: Context, p: ReportedSeries, series: _Series) -> bool:
    """Tell whether the node ended by itself before the last plateau."""
    if series.reached == series.count:
        return False
    return _went_on(context, p.artifact) is None


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
    start_s, end_s = _lasted_s(context, p)
    doubt = context.delayed(run, start_s, end_s).why
    stalled = context.stalled_s(start_s, end_s) > _READ_LATE_S
    if stalled and run.limit is None and not run.output_dropped:
        return float("inf"), doubt
    spoiled = 0.0
    for plateau in behind:
        if _may_be_spoiled(context, run, plateau):
            spoiled += 1
    return spoiled, doubt


def _lasted_s(context: Context, p: Streams) -> tuple[float, float]:
    """Return the times of the first and of the last message of the streams, in s."""
    firsts_ns = []
    lasts_ns = []
    for stream in context.streams(p.streams, p.field).values():
        firsts_ns.append(int(stream.source_ns[0]))
        lasts_ns.append(int(stream.source_ns[-1]))
    start_s = context.since_start_s(min(firsts_ns))
    end_s = context.since_start_s(max(lasts_ns))
    return start_s, end_s


def _may_be_spoiled(context: Context, run: Run, plateau: _Plateau) -> bool:
    """Tell whether a process had no core for half of a plateau."""
    start_s = context.since_start_s(plateau.start_ns)
    end_s = context.since_start_s(plateau.end_ns)
    delay = context.delayed(run, start_s, end_s)
    return delay.delay_s >= delay.length_s / 2


def _wrong(context: Context, plateau: _Plateau) -> str:
    """Compare the reported value of a plateau with the right one."""
    begin_s = context.since_start_s(plateau.start_ns)
    value = plateau.value
    if value is None:
        return f"From {begin_s:.1f} s on there is no report during a whole phase of constant commands and states."
    shown = apart(value, plateau.right, places=4)
    wanted = apart(plateau.right, value, places=4)
    return f"At {begin_s:.1f} s it reports {shown}; right is {wanted}."


def _last_run(context: Context, artifact: str) -> Run | None:
    """Return the last process of an artifact; None if there is none."""
    runs = context.runs(artifact)
    if not runs:
        return None
    return runs[-1]


def _went_on(context: Context, artifact: str) -> Run | None:
    """Return the artifact's last process, unless it ended by itself and so waited for nothing."""
    run = _last_run(context, artifact)
    if run is None or not run.went_on:
        return None
    return run


def _lost_to_machine(context: Context, p: Streams) -> tuple[float, str]:
    """Return the share of messages that a node may have lost to machine delays, and a doubt.

    It loses nothing while its queue has room, or after its end.
    """
    run = _went_on(context, p.artifact)
    if run is None:
        return 0.0, ""
    times_ns = p.longest(context)
    sent_s = np.array([context.since_start_s(t_ns) for t_ns in times_ns.tolist()])
    delayed = context.delayed(run, float(sent_s[0]), float(sent_s[-1]))
    lost = context.lost_share(run, p.streams.values(), sent_s)
    return lost, delayed.why


class Shorter(BaseModel):
    """Another session with fewer messages, which must lead to printed numbers too."""

    session: SessionId
    least: int = Field(description="Messages from which there must be numbers.")
    most: int = Field(description="With so many messages it would be no shorter run.")
    credit: float = Field(
        0.5, ge=0, le=1, description="Credit of a node that prints nothing there."
    )
    unfilled_credit: float | None = Field(
        None,
        ge=0,
        le=1,
        description="Credit of numbers that count the empty entries of a history as zeros.",
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


@check(commands=("python3 {artifact}", "ros2 bag play recordings/{session} --topics {streams}"))
def reported_statistics(context: Context, p: ReportedStatistics) -> Finding:
    """Judge a printed vector, element by element; known mistakes are named."""
    expected = f"{p.length} numbers behind '{p.label}:' at the end, agreeing with the recording"
    streams = p.recorded(context)
    if streams is None:
        return unclear(expected, "no stimulus recorded", _NO_STIMULUS)
    run = _last_run(context, p.artifact)
    printed = _printed(p, run)
    if printed is None:
        return _nothing_printed(context, p, run, expected)
    finding = _judge_vector(context, p, streams, printed)
    if p.shorter is None:
        return finding
    if finding.outcome is not Outcome.PASSED:
        return finding
    return _judge_shorter(context, p, p.shorter, finding)


def _judge_shorter(
    context: Context, p: ReportedStatistics, shorter: Shorter, right: Finding
) -> Finding:
    """Judge right numbers by those after fewer messages, too."""
    if shorter.credit < 1:
        reason = _silent_when_shorter(context, p, shorter)
        if reason:
            return _regraded(right, shorter.credit, reason)
    if shorter.unfilled_credit is not None:
        reason = _unfilled_when_shorter(context, p, shorter)
        if reason:
            return _regraded(right, shorter.unfilled_credit, reason)
    return right


def _printed(p: ReportedStatistics, run: Run | None) -> PrintedVector | None:
    """Return the vector that a process printed; None without a process."""
    if run is None:
        return None
    labels = (p.label, *p.synonyms)
    return run.printed_vector(labels, p.unless)


def _nothing_printed(
    context: Context, p: ReportedStatistics, run: Run | None, expected: str
) -> Finding:
    """State that no vector was printed."""
    if run is not None:
        flaky = run.flaky_end()
        if flaky:
            return unclear(expected, "nothing", flaky)
    empty = _empty_line(p, run)
    if empty:
        reason = f"It prints {empty!r}, without a number."
        hint = "Add to the history only once a command is known: an entry without numbers leaves none to print."
        return unexplained(failed(expected, f"{empty!r}", reason, hint=hint))
    reason = f"Nothing of the form '{p.label}: [...]' was printed after Ctrl-C."
    hint = (
        f"Catch KeyboardInterrupt around rclpy.spin(node), and print '{p.label}: [...]' after it."
    )
    if _ended_by_interrupt(run):
        reason += " KeyboardInterrupt ended the program before it could be."
        hint = (
            "Catch KeyboardInterrupt around the line of yours that the traceback in the output names last, "
            "and print the numbers after it."
        )
    nothing = failed(expected, "no such line", reason, hint=hint)
    _, text = _source(context, p.artifact)
    if hidden_exception(text) is not None:
        nothing = _explained_by_source(context, p.artifact, nothing)
    return unexplained(nothing)


def _ended_by_interrupt(run: Run | None) -> bool:
    """Tell whether a program ended with a traceback of KeyboardInterrupt."""
    if run is None:
        return False
    if run.exit_status == 0:
        return False
    return any(line.text == "KeyboardInterrupt" for line in run.lines)


def _empty_line(p: ReportedStatistics, run: Run | None) -> str:
    """Return the last line with the label and an empty list, as in `Mean: []`; empty without one."""
    if run is None:
        return ""
    labels = "|".join(re.escape(word) for word in (p.label, *p.synonyms))
    pattern = re.compile(rf"\W*(?:{labels})\b[^\[\]]{{0,40}}\[\s*\]\W*", re.IGNORECASE)
    found = ""
    for line in run.lines:
        if pattern.fullmatch(line.text):
            found = line.text.strip()
    return found


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

    @property
    def right(self) -> Finding:
        """The finding that all elements are right."""
        return passed(self.expected, self.measured, notes=self.notes)


def _judge_vector(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    printed: PrintedVector,
) -> Finding:
    """Judge the elements of a printed vector over all messages, or over the reported ones."""
    vector = _vector(context, p, streams, printed)
    if vector.share >= 1:
        return vector.right
    reason = f"Expected: {vector.right_text}."
    count = len(printed.values)
    if count != p.length:
        reason = f"{_numbers_are(count)} printed, not one for each of {p.length}. {reason}"
        few = failed(vector.expected, vector.measured, reason)
        return context.charge(few, f"{p.artifact}: {count} numbers")
    heard, comparable = _heard_of_some(context, p, streams)
    fits = False
    if heard:
        fits = _agrees(context, p, streams, {"reports": heard}, printed)
    of_all = len(heard) / comparable / p.full_from
    # After a loss, a right history reaches back further and may look like one that is too long.
    if fits and of_all >= 1:
        return _passed_over_reported(context, p, streams, vector, heard, comparable)
    for other in p.alternatives:
        if _agrees(context, p, streams, other.parameters, printed):
            return other.explains(context, p.artifact, vector.right)
    if fits:
        return _of_reported_only(context, p, vector, len(heard), of_all)
    lost, doubt = _lost_to_machine(context, p)
    best = vector.share
    if heard and lost >= _LOST_SHARE:
        best = 1.0
    return _regraded(vector.right, vector.share, reason, best, doubt)


def _numbers_are(count: int) -> str:
    """Return the beginning of a sentence about some numbers."""
    if count == 1:
        return "1 number is"
    return f"{count} numbers are"


def _agrees(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    other: Mapping[str, Any],
    printed: PrintedVector,
) -> bool:
    """Tell whether all elements lie within the oracle's bounds."""
    return _agreement(context, p, streams, other, printed) >= 1


def _passed_over_reported(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    vector: _Vector,
    heard: Sequence[tuple[int, float]],
    comparable: int,
) -> Finding:
    """State that a vector is right for the messages that the node reported, with the right one for these."""
    answer = p.answer(context, streams, {"reports": heard})
    right = answer[p.key]["value"]
    measured, right_text = _shown_vectors(vector.printed.values, right, False)
    expected = f"{right_text} from the {len(heard)} messages that the node reported, behind '{p.label}:' at Ctrl-C"
    note = f"{p.artifact}: The statistics are right for the {len(heard)} of {comparable} messages that the node reported."
    lost, _ = _lost_to_machine(context, p)
    if lost >= _LOST_SHARE:
        note += " The grading computer was busy, which can cost a node some messages."
    notes = (*vector.notes, note)
    return passed(expected, measured, notes=notes)


def _vector(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    printed: PrintedVector,
) -> _Vector:
    """Compare a printed vector with the oracle's."""
    share = _agreement(context, p, streams, {}, printed)
    answer = p.answer(context, streams)
    right = answer[p.key]["value"]
    shown = printed.values[: p.length]
    measured, right_text = _shown_vectors(shown, right, share < 1)
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
            printed_text = _shown_vector(printed, places)
            right_text = _shown_vector(right, places)
            if printed_text != right_text:
                return printed_text, right_text
    return _shown_vector(printed, 4), _shown_vector(right, 4)


def _shown_vector(values: Iterable[float], places: int) -> str:
    numbers = [f"{value:.{places}f}" for value in values]
    return f"[{' '.join(numbers)}]"


def _of_reported_only(
    context: Context, p: ReportedStatistics, vector: _Vector, heard: int, of_all: float
) -> Finding:
    """Grade numbers that are right over the reported messages alone, by the share of these."""
    lost, doubt = _lost_to_machine(context, p)
    reason = f"Your numbers match only the {heard} messages that the node reported; it missed the others."
    expected, measured = vector.expected, vector.measured
    best = of_all + lost / p.full_from
    return graded(
        of_all, expected, measured, reason, best=best, doubt=doubt, levels=_LEVELS
    )


#: Largest relative difference between the printed size and the size in a history with empty entries. The reports tell
#: the RMS exactly; the mean depends on the order of arrival of commands and states.
_SAME_SIZE = {"mean": 0.35, "rms": 0.04}
#: Largest filled share of a history for a clear difference from a full one.
_MOST_FILLED = {"mean": 0.5, "rms": 0.8}


def _unfilled_when_shorter(context: Context, p: ReportedStatistics, shorter: Shorter) -> str:
    """Say that the printed numbers count empty entries of the history after a run with fewer messages; empty if not.

    Zeros in place of missing entries make a mean smaller by the filled share of the history, and an RMS by its root.
    """
    for run, values in _shorter_runs(context, p, shorter):
        printed = _printed(p, run)
        if printed is None:
            continue
        if len(printed.values) != p.length:
            continue
        size = _size_when_shorter(context, p, shorter, values)
        if size is None:
            continue
        filled = len(values) / p.parameters["history"]
        if filled > _MOST_FILLED[p.key]:
            continue
        if p.key == "mean":
            own = float(np.mean(np.abs(printed.values)))
            diluted = size * filled
        else:
            own = _root_mean_square(printed.values)
            diluted = size * math.sqrt(filled)
        if math.isclose(own, diluted, rel_tol=_SAME_SIZE[p.key]):
            stopped = f"In the session '{shorter.session}' it was stopped after {len(values)} reports"
            compared = f"their {p.label} over all joints is {size:.4f}, that of the printed numbers {own:.4f}"
            return f"{stopped}; {compared}: empty entries of the history are counted as zeros."
    return ""


def _size_when_shorter(
    context: Context, p: ReportedStatistics, shorter: Shorter, reported: Sequence[float]
) -> float | None:
    """Return the right size of the numbers over all joints after a run with fewer messages.

    The RMS is the one of the reports. The mean needs the recorded messages; None without them.
    """
    if p.key != "mean":
        return _root_mean_square(reported)
    other = context.in_session(shorter.session)
    if other is None:
        return None
    streams = p.recorded(other)
    if streams is None:
        return None
    answer = p.answer(other, streams, {"history": None})
    return float(np.mean(answer[p.key]["value"]))


def _root_mean_square(values: Sequence[float]) -> float:
    squares = [value * value for value in values]
    return math.sqrt(sum(squares) / len(squares))


def _shorter_runs(
    context: Context, p: ReportedStatistics, shorter: Shorter
) -> list[tuple[Run, list[float]]]:
    """Return the interrupted processes of the other session with as few reports as are wanted, and their values."""
    other = context.in_session(shorter.session)
    if other is None:
        return []
    found = []
    for run in other.runs():
        values = [report.value for report in run.reports(p.report_pattern)]
        if not shorter.least <= len(values) <= shorter.most:
            continue
        if _was_interrupted(run):
            found.append((run, values))
    return found


def _silent_when_shorter(context: Context, p: ReportedStatistics, shorter: Shorter) -> str:
    """Say that the node printed no numbers after a run with fewer messages.

    Empty if it printed them, or if the run does not tell.
    """
    for run, values in _shorter_runs(context, p, shorter):
        if _printed(p, run) is None and not _quotes_interrupt(run):
            stopped = f"In the session '{shorter.session}' it was stopped after {len(values)} reports"
            missing = f"printed no '{p.label}: [...]'"
            return f"{stopped}, and {missing}; {shorter.least} are enough."
    return ""


def _quotes_interrupt(run: Run) -> bool:
    """Tell whether a process printed the name of the exception that Ctrl-C raises."""
    for line in run.lines:
        if "KeyboardInterrupt" in line.text:
            return True
    return False


def _was_interrupted(run: Run) -> bool:
    """Tell whether a student's process ended by Ctrl-C as it should, with all of its output kept."""
    if (run.role, run.ended_by) != ("student", "interrupt"):
        return False
    if run.output_dropped:
        return False
    return not run.flaky_end()


def _agreement(
    context: Context,
    p: ReportedStatistics,
    streams: Mapping[str, NumericStream],
    other: Mapping[str, Any],
    printed: PrintedVector,
) -> float:
    """Return the share of elements that lie within the oracle's bounds."""
    answer = p.answer(context, streams, other)
    right = answer.get(p.key)
    if right is None:
        return 0.0
    count = len(printed.values)
    if count != len(right["value"]):
        return 0.0
    rounding = 1.01 * printed.rounding
    elements = zip(printed.values, right["value"], right["low"], right["high"], strict=True)
    right_ones = 0
    for printed_value, value, low, high in elements:
        hundredth = 0.01 * abs(value)
        slack = max(p.tolerance, hundredth, rounding)
        if low - slack <= printed_value <= high + slack:
            right_ones += 1
    return right_ones / count


def _heard_of_some(
    context: Context, p: ReportedStatistics, streams: Mapping[str, NumericStream]
) -> tuple[list[tuple[int, float]], int]:
    """Return time and value of the node's reports, and the number of comparable messages.

    No report is returned if there is one for nearly every message.
    """
    begun_ns = max(int(stream.source_ns[0]) for stream in streams.values())
    comparable = 0
    for stream in streams.values():
        later = stream.source_ns >= begun_ns
        comparable = max(comparable, int(later.sum()))
    heard: list[Report] = []
    if p.report_pattern:
        heard = context.reports(p.artifact, p.report_pattern)
        heard = _without_repeats(context, p, heard)
    if len(heard) >= 0.99 * comparable:
        return [], comparable
    found = [(report.t_ns, report.value) for report in heard]
    return found, comparable


def _report_share(context: Context, p: ReportedSeries, of: ReportShare) -> _ReportCount:
    """Count the messages with a report, as far as the output was kept."""
    streams, kept = _received_while_kept(context, p)
    possible = _counted(context, of.oracle, p, streams)
    lines = context.reports(p.artifact, p.pattern)
    heard = len(_without_repeats(context, p, lines))
    reports = _in_words(heard, len(lines) - heard)
    lost, doubt = _lost_to_machine(context, p)
    share = heard / max(1, possible) / of.full_from
    best = share + lost / of.full_from
    count = _ReportCount(
        share,
        best,
        f"{reports} for {possible} messages{kept}",
        f"Only {heard} of {possible} messages led to a report.",
        doubt,
    )
    return _explained_by_mistake(count, _mistake_of_count(context, p, of, streams, heard))


def _counted(
    context: Context, oracle: str, p: ReportedSeries, streams: Mapping[str, NumericStream]
) -> int:
    """Return the number of reports that an oracle counts for some streams."""
    return int(context.oracle(oracle)(streams, dict(p.parameters), context.seed))


def _in_words(heard: int, repeats: int) -> str:
    """State a number of reports, and how many more repeat one."""
    if repeats:
        return f"{heard} reports, and {repeats} that repeat one"
    return f"{heard} reports"


def _explained_by_mistake(count: _ReportCount, mistake: FewerReports | None) -> _ReportCount:
    """Return a count with the meaning and the credit of a known mistake, if there is one."""
    if mistake is None:
        return count
    return replace(count, reason=f"{count.reason} {mistake.meaning}", leaves=mistake.credit)


def _received_while_kept(
    context: Context, p: ReportedSeries
) -> tuple[dict[str, NumericStream], str]:
    """Return the streams as far as the output of the node was kept, and a clause about that."""
    streams = p.recorded(context) or {}
    last_s = _output_kept_until_s(context, p)
    if last_s is None:
        return streams, ""
    for role, stream in streams.items():
        streams[role] = _until(context, stream, last_s)
    return streams, ", as far as its output is kept: it printed more"


def _mistake_of_count(
    context: Context,
    p: ReportedSeries,
    of: ReportShare,
    streams: Mapping[str, NumericStream],
    heard: int,
) -> FewerReports | None:
    """Return the known mistake that leads to as many reports; None if there is none."""
    if heard < _LEAST_OF_MISTAKE:
        return None
    for fewer in of.fewer:
        alike = _counted(context, fewer.oracle, p, streams)
        if math.isclose(heard, alike, rel_tol=_SAME_COUNT):
            return fewer
    return None


#: Relative difference up to which two numbers of reports are the same.
_SAME_COUNT = 0.07
#: Number of reports from which their number tells of a mistake.
_LEAST_OF_MISTAKE = 50


def _until(context: Context, stream: NumericStream, last_s: float) -> NumericStream:
    """Return the messages of a stream that were received up to a time in s."""
    received = []
    for t_ns in stream.received_ns.tolist():
        received.append(context.since_start_s(t_ns) <= last_s)
    return stream.only(np.array(received))


def _output_kept_until_s(context: Context, p: ReportedSeries) -> float | None:
    """Return the time of the last kept line before Ctrl-C of a node that printed more; None if all was kept."""
    run = _last_run(context, p.artifact)
    if run is None or not run.output_dropped:
        return None
    interrupted_s = run.interrupted_s
    if interrupted_s is None:
        interrupted_s = math.inf
    last_s = None
    for line in run.lines:
        if line.t_s < interrupted_s:
            last_s = line.t_s
    return last_s


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
    interval_ns = float(np.median(np.diff(sent)))
    starts = _starts(sent, interval_ns)
    begun_ns = _begun_ns(context, p)
    runs = _runs_of_one_value([report for report in heard if report.t_ns >= begun_ns])
    surplus = sum(_surplus(run, sent, starts) for run in runs)
    start_s = context.since_start_s(int(sent[0]))
    end_s = context.since_start_s(int(sent[-1]))
    stalled_ns = context.stalled_s(start_s, end_s) * 1e9
    if surplus <= stalled_ns / interval_ns:
        return list(heard)
    kept = []
    for run in runs:
        kept.append(run[0])
        for before, report in pairwise(run):
            if report.t_ns - before.t_ns > interval_ns / 2:
                kept.append(report)
    return kept


def _starts(sent: Integers, interval_ns: float) -> Integers:
    """Return the first time, and each time after a silence, in ns.

    Parameters
    ----------
    sent
        int64[n]: Times of the messages, in ns.
    interval_ns
        Median interval between them.
    """
    steps = np.diff(sent)
    is_silence = steps > _SILENT_INTERVALS * interval_ns
    is_start = np.concatenate(([True], is_silence))
    starts: Integers = sent[is_start]
    return starts


def _begun_ns(context: Context, p: Streams) -> int:
    """Return when the last of the streams began."""
    begun_ns = 0
    for stream in context.streams(p.streams, p.field).values():
        begun_ns = max(begun_ns, int(stream.source_ns[0]))
    return begun_ns


def _sent_ns(context: Context, p: Streams) -> Integers:
    """Return the times of the most frequent stream, from the beginning of the last one on."""
    begun_ns = _begun_ns(context, p)
    sent: Integers = np.array([], dtype=np.int64)
    for stream in context.streams(p.streams, p.field).values():
        times_ns = stream.source_ns[stream.source_ns >= begun_ns]
        if len(times_ns) > len(sent):
            sent = times_ns
    return sent


def _runs_of_one_value(heard: Iterable[Report]) -> list[list[Report]]:
    """Sort reports by time, and split them where the value changes."""
    runs: list[list[Report]] = []
    run: list[Report] = []
    for report in sorted(heard, key=lambda report: report.t_ns):
        if not run or not _is_alike(report, run[-1]):
            run = []
            runs.append(run)
        run.append(report)
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
    begun = int(np.searchsorted(starts, run[0].t_ns, side="right"))
    start_ns = starts[max(0, begun - 1)]
    first = int(np.searchsorted(sent, start_ns))
    surplus = 0
    for count, report in enumerate(run, 1):
        came = int(np.searchsorted(sent, report.t_ns, side="right"))
        surplus = max(surplus, count - (came - first))
    return surplus
