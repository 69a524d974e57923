"""What the report's template shows: values of the judgement and the recordings, put in order and in words."""

from __future__ import annotations

import re
import signal
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from decimal import ROUND_HALF_UP, Decimal
from typing import TYPE_CHECKING, Any

from grader.recording.session import OutputLine, ProcessRun, SessionRecord
from grader.recording.submission import ArtifactFact
from grader.report.escape import line
from grader.result import (
    ANSWERS,
    MEASURED,
    Adjustment,
    AdjustmentKind,
    CheckResult,
    ChosenFile,
    CriterionResult,
    Location,
    Outcome,
    Result,
    Violation,
    outcome_of_points,
)

if TYPE_CHECKING:
    from grader.report.figures.svg import Figure

HEAD_LINES, TAIL_LINES = 40, 60
PRINTED_HEAD_LINES, PRINTED_TAIL_LINES = 6, 14
#: Of what leads to a line that is meant, such as a traceback.
LINES_BEFORE = 6
CONTEXT_LINES = 2
LONGEST_SOURCE_LINE = 200
LONGEST_OUTPUT_LINE = 500
MOST_LOCATIONS = 8
#: A moment on a line of 1000 is to be seen.
_NARROWEST = 6.0


@dataclass(frozen=True)
class Badge:
    """An outcome as style class, sign and word: colour is never the only difference."""

    style: str
    sign: str
    word: str
    #: By which the class page's script knows an outcome, and that of the terminal.
    letter: str = ""
    colour: str = ""


_UNDECIDED = Badge("undecided", "?", "undecided", "u", "magenta")
_BADGES = {
    Outcome.PASSED: Badge("passed", "✓", "passed", "p", "green"),
    Outcome.PARTIAL: Badge("partial", "◐", "partial", "a", "yellow"),
    Outcome.FAILED: Badge("failed", "✕", "failed", "f", "red"),
    Outcome.NOT_REACHED: Badge("not-reached", "–", "not reached", "n", "red"),
}


def badge_of(outcome: Outcome) -> Badge:
    """Return a check's badge."""
    return _BADGES.get(outcome, _UNDECIDED)


def points(value: Decimal) -> str:
    """Write points without trailing zeros."""
    text = f"{value:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def tenths(value: Decimal) -> str:
    """Write points in tenths, whole ones without a decimal."""
    return points(value.quantize(Decimal("0.1"), ROUND_HALF_UP))


def anchor(kind: str, name: str) -> str:
    """Return an id for the page's links."""
    return f"{kind}-" + re.sub(r"[^A-Za-z0-9_.-]", "-", name)


# -- points ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Share:
    """Earned and undecided points, and both as parts of 100 for a bar."""

    earned: str
    possible: str
    undecided: str
    earned_part: str
    undecided_part: str
    badge: Badge


def share_of(earned: Decimal, possible: Decimal, undecided: Decimal = Decimal(0)) -> Share:
    """Describe points; the badge is that of the whole."""
    whole = possible or Decimal(1)
    return Share(
        points(earned),
        points(possible),
        points(undecided) if undecided else "",
        f"{100 * earned / whole:.2f}",
        f"{100 * undecided / whole:.2f}",
        badge_of(outcome_of_points(earned, possible, undecided)),
    )


@dataclass(frozen=True)
class Loss:
    """A check that lost points by itself, its criterion, and the checks whose points the same fix opens."""

    check: CheckResult
    criterion: CriterionResult
    others: tuple[CheckResult, ...]

    @property
    def opens(self) -> Decimal:
        """The points that can be earned too once it is fixed."""
        return sum((check.lost for check in self.others), Decimal(0))


def losses_of(result: Result) -> list[Loss]:
    """Return what lost points by itself; first that by which most can be won, with what depends on it.

    What has the same fix as an earlier check of its criterion lost its points by the same mistake.
    """
    found = []
    for criterion in result.criteria:
        lost = [
            check
            for check in criterion.checks
            if check.lost > 0 and check.outcome is not Outcome.NOT_REACHED
        ]
        first = {check.hint or check.id: check for check in reversed(lost)}
        for check in lost:
            if first[check.hint or check.id] is check:
                same = [
                    other
                    for other in lost
                    if other is not check and check.hint and other.hint == check.hint
                ]
                blocked = [
                    other
                    for other in result.checks
                    if other.blocked_by == check.id and other.lost > 0
                ]
                found.append(Loss(check, criterion, (*same, *blocked)))
    return sorted(found, key=lambda loss: -(loss.check.lost + loss.opens))


def bonus_lines(result: Result) -> list[str]:
    """Return a line for each extension that was handed in, whose points are in no sum."""
    lines = [
        (part, f"{part.title}: {points(part.earned)} of {points(part.possible)}")
        for part in result.bonus
    ]
    return [
        f"{text} ({points(part.undecided)} undecided)" if part.undecided else text
        for part, text in lines
    ]


#: Heads what `bonus_lines` gives.
BONUS = "Extensions, beside the points"


def figures_by_loss(losses: Sequence[Loss], figures: Sequence[Figure]) -> dict[str, list[Figure]]:
    """Return the figures that show a loss, each by the id of the first check of which it does."""
    found: dict[str, list[Figure]] = {}
    for figure in figures:
        shown = next((loss.check.id for loss in losses if loss.check.id in figure.shows), None)
        if shown is not None:
            found.setdefault(shown, []).append(figure)
    return found


def earned_text(check: CheckResult) -> str:
    """Write what a check earned; a question mark if nothing of it is decided."""
    return "?" if check.possible and check.undecided >= check.possible else points(check.earned)


def credit_text(check: CheckResult) -> str:
    """Write the credit of a check that earned a part of its points."""
    return f"{check.credit:.1%} of {points(check.possible)} points".replace(".0%", "%")


@dataclass(frozen=True)
class AdjustmentView:
    """What changed the points after the judgement, in words; `by` is empty where the rubric's policy did."""

    points: str
    style: str
    title: str
    href: str
    reason: str
    by: str
    comment: str = ""
    is_appeal: bool = False

    @property
    def decided(self) -> str:
        """Who decided it, and when."""
        return self.by or "the lab's rule"

    @property
    def text(self) -> str:
        """All of it in one line, which is still untrusted."""
        head = f"{self.points} {self.title}".rstrip(": ")
        return (
            head
            + (f": {self.reason}" if self.reason else "")
            + (f" ({self.by})" if self.by else "")
        )


def adjustments_of(result: Result) -> list[AdjustmentView]:
    """Describe the adjustments, with a link to the check or criterion that each concerns."""
    titles = {check.id: (check.title, "check") for check in result.checks}
    titles |= {criterion.id: (criterion.title, "criterion") for criterion in result.criteria}
    return [_adjustment_view(each, titles) for each in result.adjustments]


def _adjustment_view(each: Adjustment, titles: Mapping[str, tuple[str, str]]) -> AdjustmentView:
    title, kind = titles.get(each.what, ("", ""))
    words = {
        AdjustmentKind.POINTS: title or each.what,
        AdjustmentKind.EXCUSED: f"{title or each.what}: excused",
        AdjustmentKind.REVIEWED: f"{title or 'The whole'}: looked at, stays as it is",
        AdjustmentKind.APPEAL: f"{title or each.what}: appeal",
        AdjustmentKind.BONUS: "Bonus",
        AdjustmentKind.SUBMITTED: f"Handed in {each.what}",
        AdjustmentKind.EXTENSION: f"Extension: {each.what}",
        AdjustmentKind.LATE: "Late" if each.points else "Lateness",
    }
    style = "gain" if each.points > 0 else "loss" if each.points else ""
    href = "#" + anchor(kind, each.what) if kind else ""
    by = ", ".join(part for part in (each.who, each.when.replace("T", " ")) if part)
    is_appeal = each.kind is AdjustmentKind.APPEAL
    return AdjustmentView(
        signed(each.points), style, words[each.kind], href, each.reason, by, each.comment, is_appeal
    )


def said_of(result: Result) -> dict[str, list[AdjustmentView]]:
    """Return what people asked and decided, in its order, by the id of the check or criterion; `score` is the whole."""
    said: dict[str, list[AdjustmentView]] = {}
    for each, view in zip(result.adjustments, adjustments_of(result), strict=True):
        if each.kind in (*ANSWERS, AdjustmentKind.APPEAL):
            said.setdefault(each.what, []).append(view)
    return said


def rule_text(check: CheckResult) -> str:
    """Name the rule that decided, such as `the rule “messages dropped”`; empty if the result does not name it."""
    if check.decided_by is None:
        return ""
    if check.decided_by == MEASURED:
        return "the check itself"
    return f"the rule “{check.decided_by.replace('_', ' ')}”"


def appeal_text(result: Result, check: CheckResult) -> str:
    """Return what a student can send to appeal against a check."""
    facts = (
        f"Expected: {check.expected}",
        f"Measured: {check.measured}",
        f"The report says: {check.reason}",
    )
    known = [fact for fact in facts if not fact.endswith(": ")]
    head = f"Appeal: {result.lab}, {result.submission}, check {check.id}"
    title = f"{check.title}: {earned_text(check)} of {points(check.possible)} points"
    return "\n".join([head, title, *known, "What I think is wrong: "])


def cell_badge(result: Result, criterion: CriterionResult) -> Badge:
    """Return the badge of a criterion as it stands, with what people decided."""
    ids = {check.id for check in criterion.checks}
    undecided = sum(
        (check.undecided for check in result.open_checks if check.id in ids), Decimal(0)
    )
    earned = max(Decimal(0), min(result.final_of(criterion), criterion.possible - undecided))
    return badge_of(outcome_of_points(earned, criterion.possible, undecided))


def signed(value: Decimal) -> str:
    """Write points with their sign."""
    return f"{'+' if value > 0 else '−'}{points(abs(value))}" if value else "±0"


def final_share(result: Result) -> Share:
    """Describe the points with all adjustments; a bonus may make them more than are possible."""
    possible = result.score.possible
    within = max(Decimal(0), min(result.final, possible))
    share = share_of(within, possible, min(result.still_undecided, possible - within))
    return replace(share, earned=points(result.final))


# -- what interfered with the grader's own nodes and topics ------------------------------------

HEADING = "For the instructor: something interfered with the grader's nodes or topics"
EXPLANATION = (
    "Seen in the recordings. Each can have an honest cause, such as a wrong topic name or a simulator of one's own. "
    "It costs no points by itself: only checks that could not be measured because of it fail, and these are named here."
)


def titles_of(violation: Violation, result: Result) -> list[tuple[str, str]]:
    """Return ids and titles of the checks that fail because of a violation."""
    return [(check.id, check.title) for check in result.checks if check.id in violation.checks]


def note_of(violation: Violation) -> str:
    """Say how sure it is, where it is not."""
    return "" if violation.certain else "What caused it is not certain."


# -- where the proof lies ----------------------------------------------------------------------


@dataclass(frozen=True)
class SourceLine:
    """A line of a student's file; `meant` if it is the one that is pointed at."""

    number: int
    text: str
    meant: bool


@dataclass(frozen=True)
class ShownLocation:
    """Where proof lies: words, a link within the page, and source lines."""

    text: str
    href: str
    lines: tuple[SourceLine, ...]


def _excerpt(texts: Mapping[str, str], file: str, number: int) -> tuple[SourceLine, ...]:
    """Return a line of a file with those around it, numbered as Python counts, without common indentation."""
    lines = re.split(r"\r\n|\r|\n", texts.get(file, ""))
    if not 1 <= number <= len(lines) or file not in texts:
        return ()
    first = max(1, number - CONTEXT_LINES)
    last = min(len(lines), number + CONTEXT_LINES)
    tabless = (text.replace("\t", "    ") for text in lines[first - 1 : last])
    near = [
        t if len(t) <= LONGEST_SOURCE_LINE else t[: LONGEST_SOURCE_LINE - 1] + "…" for t in tabless
    ]
    common = min((len(text) - len(text.lstrip(" ")) for text in near if text.strip()), default=0)
    return tuple(
        SourceLine(n, text[common:], n == number)
        for n, text in enumerate(near, first)
        if n == number or n < len(lines) or text
    )


def location_of(
    where: Location, texts: Mapping[str, str], anchors: Mapping[tuple[str, str], str]
) -> ShownLocation:
    """Put a place in words, with its source lines and the part of the page that shows more."""
    session, process = where.session or "", where.process or ""
    href = anchors.get((session, process)) or anchors.get((session, "")) or ""
    lines = _excerpt(texts, where.file, where.line) if where.file and where.line else ()
    return ShownLocation(str(where), "" if where.file else href, lines)


def locations_of(
    check: CheckResult, texts: Mapping[str, str], anchors: Mapping[tuple[str, str], str]
) -> list[ShownLocation]:
    """Return the first places where the proof of a check lies, each once."""
    locations = (
        location_of(where, texts, anchors)
        for where in list(dict.fromkeys(check.where))[:MOST_LOCATIONS]
    )
    return [location for location in locations if location.text]


# -- moments -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moment:
    """When in a motion a check lost points: in words, where it is on a line of 1000, and where to look first."""

    check: CheckResult
    text: str
    left: float
    width: float
    at_ms: int


def moments_of(result: Result, figure: Figure) -> list[Moment]:
    """Return when, in the motion that a figure shows, each check lost points, by the first place of its proof there."""
    first_ms, last_ms = (int(figure.content.times_ms[n]) for n in (0, -1))
    whole_ms = max(1, last_ms - first_ms)
    found = []
    for check in result.checks:
        spans = (
            [w for w in check.where if w.session == figure.session and w.start_s is not None]
            if check.lost
            else []
        )
        for where in spans[:1]:
            assert where.start_s is not None
            ends_s = (where.start_s, where.start_s if where.end_s is None else where.end_s)
            start, end = (min(max(round(end_s * 1000), first_ms), last_ms) for end_s in ends_s)
            left, width = 1000 * (start - first_ms) / whole_ms, 1000 * (end - start) / whole_ms
            found.append(Moment(check, where.span, left, max(width, _NARROWEST), start))
    return found


# -- sessions ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class PrintedLine:
    """A line of output, counted from 0; `far` if it is left out on paper, behind some that are not shown at all."""

    number: int
    time: str
    error: bool
    text: str
    far: bool
    left_out: int


def anchors_of(sessions: Mapping[str, SessionRecord]) -> dict[tuple[str, str], str]:
    """Return the links to each session, and to the last process of each name in it."""
    links = {}
    for name, record in sessions.items():
        links[name, ""] = "#" + anchor("session", name)
        for number, process in enumerate(record.processes):
            links[name, process.name] = f"#{anchor('output', name)}-{number}"
    return links


def heading_of(record: SessionRecord, number: int) -> str:
    """Return what a process is called on the page: its name, and which start it is where there are several."""
    name = record.processes[number].name
    starts = [n for n, other in enumerate(record.processes) if other.name == name]
    return line(name, 120) + (f", start {starts.index(number) + 1}" if len(starts) > 1 else "")


def processes_of(record: SessionRecord) -> list[tuple[int, str, ProcessRun]]:
    """Return the processes to show, the submission's first: place in the record, heading, and process."""
    runs = enumerate(record.processes)
    shown = [
        (n, heading_of(record, n), run) for n, run in runs if run.role != "grader" or run.output
    ]
    order = {"student": 0, "reference": 1, "grader": 2}
    return sorted(shown, key=lambda one: order.get(one[2].role, 3))


def output_of(run: ProcessRun, started_ns: int, meant: Collection[int] = ()) -> list[PrintedLine]:
    """Return the first and the last lines of a process's output, and those with what comes before that are meant."""
    count = len(run.output)
    shown = {n for each in meant for n in range(each - LINES_BEFORE, each + 2)} & set(range(count))
    near = {
        *range(min(PRINTED_HEAD_LINES, count)),
        *range(max(0, count - PRINTED_TAIL_LINES), count),
        *shown,
    }
    shown |= {*range(min(HEAD_LINES, count)), *range(max(0, count - TAIL_LINES), count)}
    ordered = sorted(shown)
    return [
        _printed(run.output[number], number, started_ns, number not in near, number - before - 1)
        for before, number in zip([-1, *ordered], ordered, strict=False)
    ]


def _printed(
    output: OutputLine, number: int, started_ns: int, far: bool, left_out: int
) -> PrintedLine:
    # What follows a bare carriage return is written over what was there, as a progress bar does.
    text = output.text.rstrip("\r").rpartition("\r")[2]
    if len(text) > LONGEST_OUTPUT_LINE:
        text = text[: LONGEST_OUTPUT_LINE - 1] + "…"
    time = f"{(output.t_ns - started_ns) / 1e9:.3f}"
    return PrintedLine(number, time, output.stream == "stderr", text, far, left_out)


def end_of(run: ProcessRun) -> str:
    """Say how a process ended."""
    status = run.exit_status
    if status is None:
        return "did not end" if run.exited_ns is None else "ended, exit status not known"
    signals = {each.value: each.name for each in signal.Signals}
    how = f"signal {signals.get(-status, -status)}" if status < 0 else f"exit status {status}"
    ways = {
        "itself": f"ended by itself, {how}",
        "interrupt": f"ended after Ctrl-C (SIGINT), {how}",
        "terminate": f"did not end on Ctrl-C; ended on SIGTERM, {how}",
        "kill": f"did not end on Ctrl-C or SIGTERM; killed, {how}",
        "limit": "ended by the grader",
    }
    limit = f"; limit hit: {run.limit}" if run.limit is not None else ""
    return ways[run.ended_by] + limit


# -- where and how -----------------------------------------------------------------------------


def utc(t_ns: Any) -> str:
    """Write a time of the system clock as date and minute in UTC; empty if it is none."""
    if not isinstance(t_ns, int) or not 0 < t_ns < 2**62:
        return ""
    return datetime.fromtimestamp(t_ns // 10**9, tz=timezone.utc).strftime("%Y-%m-%d %H:%M UTC")


def isolations_of(
    sessions: Mapping[str, SessionRecord],
) -> list[tuple[Mapping[str, Any], list[str]]]:
    """Return how sessions were confined, each way with the names of the sessions that were so."""
    all_ways = [record.isolation for record in sessions.values()]
    ways = [way for n, way in enumerate(all_ways) if way not in all_ways[:n]]
    return [
        (way, [name for name, record in sessions.items() if record.isolation == way])
        for way in ways
    ]


def versions_of(result: Result) -> list[tuple[str, str]]:
    """Return names and values of what the result depends on: versions and hashes."""
    provenance = result.provenance
    versions = {
        "grader": provenance.get("grader", ""),
        **provenance.get("versions", {}),
        "submission, SHA-256": provenance.get("submission_sha256", ""),
        "rubric, SHA-256": provenance.get("rubric_sha256", ""),
        "rubric with the files that it names, SHA-256": provenance.get("lab_sha256", ""),
    }
    return [(name, value) for name, value in versions.items() if value]


def graded_on(result: Result) -> str:
    """Say on which distribution of ROS it was graded, and which the handout was written for."""
    names = (
        re.fullmatch(r"ros-([a-z]+)-rclpy", name) for name in result.provenance.get("versions", {})
    )
    graded = next((name[1].capitalize() for name in names if name), "")
    handout = result.provenance.get("handout_ros", "")
    if not graded:
        return ""
    return f"graded on ROS 2 {graded}" + (
        f" (the handout: {handout})" if handout not in ("", graded) else ""
    )


def found_note(artifact: ArtifactFact) -> str:
    """Say how the file was found that stands for one of the lab's, or what may have been meant."""
    if artifact.path is None:
        meant = ", ".join(artifact.candidates[:5])
        return f"could have been meant: {meant}" if meant else ""
    return {"name": "", "near miss": "used in its place, under another name"}.get(
        artifact.found_by, artifact.found_by
    )


#: Paths that are listed of files that were not graded.
_MOST_PATHS = 5
SEVERAL_FILES = "Several files of one name"
IF_WRONG = "If the wrong one was graded, tell your instructor."


def chosen_words(chosen: ChosenFile) -> str:
    """Say which of several files of one name was graded, why, and which were not."""
    listed = ", ".join(chosen.others[:_MOST_PATHS])
    left = len(chosen.others) - _MOST_PATHS
    if left > 0:
        listed += f" and {left} more"
    words = f"{chosen.path} was graded"
    if chosen.why:
        words += "; " if chosen.is_open else ", because "
        words += chosen.why
    words += f". Not graded: {listed}."
    if chosen.is_open:
        words += " Your instructor is asked to look."
    return words
