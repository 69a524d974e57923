"""Prepare values of the judgement and the recordings for the templates of pages, in order and in words."""

from __future__ import annotations

import re
import signal
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from decimal import ROUND_HALF_UP, Decimal
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from grader.recording.session import OutputLine, ProcessRun, SessionRecord
from grader.recording.submission import ArtifactFact
from grader.report.escape import line
from grader.report.whole_files import WholeFile, lines_of
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
from grader.result_folder import REPORT_FILE

if TYPE_CHECKING:
    from grader.report.figures.svg import Figure

HEAD_LINES, TAIL_LINES = 30, 40
PRINTED_HEAD_LINES, PRINTED_TAIL_LINES = 6, 14
#: Lines that are shown before a highlighted line of output, such as those of a traceback.
LINES_BEFORE = 6
CONTEXT_LINES = 2
LONGEST_SOURCE_LINE = 200
LONGEST_OUTPUT_LINE = 500
MOST_LOCATIONS = 8
#: Smallest width of a moment on a line of 1000, so that it can be seen.
_NARROWEST = 6.0


@dataclass(frozen=True)
class Badge:
    """An outcome as style class, sign and word: colour is never the only difference."""

    style: str
    sign: str
    word: str
    #: Code of the outcome for the class page's script.
    letter: str = ""
    #: Colour on a terminal.
    colour: str = ""


_UNDECIDED = Badge("undecided", "?", "undecided", "u", "magenta")
_BADGES = {
    Outcome.PASSED: Badge("passed", "✓", "passed", "p", "green"),
    Outcome.EXCUSED: Badge("excused", "○", "excused", "e", "yellow"),
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
    if "." in text:
        return text.rstrip("0").rstrip(".")
    return text


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
    """Describe points; the badge shows the outcome of the whole."""
    whole = possible or Decimal(1)
    open_points = points(undecided) if undecided else ""
    earned_part = f"{100 * earned / whole:.2f}"
    undecided_part = f"{100 * undecided / whole:.2f}"
    badge = badge_of(outcome_of_points(earned, possible, undecided))
    return Share(points(earned), points(possible), open_points, earned_part, undecided_part, badge)


@dataclass(frozen=True)
class Loss:
    """A check that lost points by itself, its criterion, and other checks with the same mistake.

    Attributes
    ----------
    others
        Checks with points that the same fix opens.
    spared
        Excused checks: the mistake is charged here, and costs nothing there.
    """

    check: CheckResult
    criterion: CriterionResult
    others: tuple[CheckResult, ...]
    spared: tuple[CheckResult, ...] = ()

    @property
    def opens(self) -> Decimal:
        """The points that can be earned too once it is fixed."""
        return sum((check.lost for check in self.others), Decimal(0))


def losses_of(result: Result) -> list[Loss]:
    """Return the checks that lost points by themselves, with those that depend on them.

    Losses that endanger come first, then the largest gains.
    Checks of a criterion with the same hint lost their points by the same mistake, and are one loss.
    """
    found = []
    for criterion in result.criteria:
        for first, *same in _same_mistakes(criterion):
            blocked = _blocked_by(first, result)
            spared = _spared_by([first, *same], result)
            found.append(Loss(first, criterion, (*same, *blocked), tuple(spared)))
    found.sort(key=lambda loss: -(loss.check.lost + loss.opens))
    return sorted(found, key=lambda loss: not loss.check.endangers)


def _same_mistakes(criterion: CriterionResult) -> list[list[CheckResult]]:
    """Return the checks of a criterion that lost points by themselves, together if they have the same hint."""
    by_mistake: dict[str, list[CheckResult]] = {}
    for check in criterion.checks:
        if check.lost > 0 and check.outcome is not Outcome.NOT_REACHED:
            by_mistake.setdefault(check.hint or check.id, []).append(check)
    return list(by_mistake.values())


def same_fixes(result: Result) -> dict[str, CheckResult]:
    """Return the check with the same hint before each check of a criterion that repeats a hint, by the latter's id."""
    found: dict[str, CheckResult] = {}
    for criterion in result.criteria:
        first: dict[str, CheckResult] = {}
        for check in criterion.checks:
            if check.hint in first:
                found[check.id] = first[check.hint]
            elif check.hint:
                first[check.hint] = check
    return found


def _blocked_by(blocking: CheckResult, result: Result) -> list[CheckResult]:
    """Return the checks that lost points because another check failed."""
    found = []
    for check in result.checks:
        if check.blocked_by == blocking.id and check.lost > 0:
            found.append(check)
    return found


def titles_by_id(result: Result) -> dict[str, str]:
    """Return the title of each check by its id."""
    titles = {}
    for check in result.every_check:
        titles[check.id] = check.title
    return titles


def _spared_by(charging: Sequence[CheckResult], result: Result) -> list[CheckResult]:
    """Return the checks excused by one of the charging checks."""
    ids = set()
    for check in charging:
        ids.add(check.id)
    found = []
    for check in result.checks:
        if not ids.isdisjoint(check.charged_by or ()):
            found.append(check)
    return found


def bonus_lines(result: Result) -> list[str]:
    """Write the points of each submitted extension, such as `Plots: 3 of 5`; no sum includes them."""
    lines = []
    for part in result.bonus:
        text = f"{part.title}: {points(part.earned)} of {points(part.possible)}"
        if part.undecided:
            text += f" ({points(part.undecided)} undecided)"
        lines.append(text)
    return lines


#: Heading of the lines of `bonus_lines`.
BONUS = "Extensions, beside the points"


def figures_by_loss(losses: Sequence[Loss], figures: Sequence[Figure]) -> dict[str, list[Figure]]:
    """Return the figures of losses by the id of the check; each figure is shown with the first loss that it shows."""
    found: dict[str, list[Figure]] = {}
    for figure in figures:
        for loss in losses:
            if loss.check.id in figure.shows:
                found.setdefault(loss.check.id, []).append(figure)
                break
    return found


def earned_text(check: CheckResult) -> str:
    """Write the earned points of a check; a question mark if none of its points is decided."""
    if check.possible and check.undecided >= check.possible:
        return "?"
    return points(check.earned)


def credit_text(check: CheckResult) -> str:
    """Write the credit of a check with partial credit, such as `50% of 8 points`."""
    return f"{check.credit:.1%} of {points(check.possible)} points".replace(".0%", "%")


@dataclass(frozen=True)
class AdjustmentView:
    """A change of points after the judgement, in words; `by` is empty if the rubric's policy made it."""

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
        """The person and the time of the decision."""
        return self.by or "the lab's rule"

    @property
    def text(self) -> str:
        """The whole adjustment in one line, which is still untrusted: `−2 Late: a day (the lab's rule)`."""
        text = f"{self.points} {self.title}".rstrip(": ")
        if self.reason:
            text += f": {self.reason}"
        if self.by:
            text += f" ({self.by})"
        return text


def adjustments_of(result: Result) -> list[AdjustmentView]:
    """Describe the adjustments, each with a link to its check or criterion."""
    titles = {check.id: (check.title, "check") for check in result.checks}
    titles |= {criterion.id: (criterion.title, "criterion") for criterion in result.criteria}
    return [_adjustment_view(each, titles) for each in result.adjustments]


def _adjustment_view(each: Adjustment, titles: Mapping[str, tuple[str, str]]) -> AdjustmentView:
    title, kind = titles.get(each.what, ("", ""))
    style = ""
    if each.points:
        style = "gain" if each.points > 0 else "loss"
    href = ""
    if kind:
        href = "#" + anchor(kind, each.what)
    decided = [each.who, each.when.replace("T", " ")]
    by = ", ".join(filter(None, decided))
    is_appeal = each.kind is AdjustmentKind.APPEAL
    return AdjustmentView(
        points=signed(each.points),
        style=style,
        title=_adjustment_title(each, title),
        href=href,
        reason=each.reason,
        by=by,
        comment=each.comment,
        is_appeal=is_appeal,
    )


def _adjustment_title(each: Adjustment, title: str) -> str:
    """Name an adjustment; `title` is that of its check or criterion, empty for all others."""
    named = title or each.what
    titles = {
        AdjustmentKind.POINTS: named,
        AdjustmentKind.EXCUSED: f"{named}: excused",
        AdjustmentKind.REVIEWED: f"{title or 'The whole'}: looked at, stays as it is",
        AdjustmentKind.APPEAL: f"{named}: appeal",
        AdjustmentKind.BONUS: "Bonus",
        AdjustmentKind.SUBMITTED: f"Handed in {each.what}",
        AdjustmentKind.EXTENSION: f"Extension: {each.what}",
        AdjustmentKind.LATE: "Late" if each.points else "Lateness",
    }
    return titles[each.kind]


def said_of(result: Result) -> dict[str, list[AdjustmentView]]:
    """Return appeals and decisions, in their order, by the id of the check or criterion; `score` is the whole."""
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


def appeal_of(result: Result) -> str:
    """Return the beginning of each question: `Appeal: LAB, SUBMISSION`."""
    return f"Appeal: {result.lab}, {result.submission}"


def appeal_head(result: Result, check: CheckResult) -> str:
    """Return the first line of a question about a check: `Appeal: LAB, SUBMISSION, check ID`."""
    return f"{appeal_of(result)}, check {check.id}"


#: Words before a student's own words in a question.
QUESTION = "What I think is wrong:"


def appeal_text(result: Result, check: CheckResult) -> str:
    """Return the text of a question about a check, for the student to complete and send."""
    lines = [
        appeal_head(result, check),
        f"{check.title}: {earned_text(check)} of {points(check.possible)} points",
        f"Link: {REPORT_FILE}#{anchor('check', check.id)}",
        *_facts(check),
    ]
    return "\n".join([*lines, f"{QUESTION} "])


def _facts(check: CheckResult) -> list[str]:
    """Return the known facts of a finding, a line each."""
    facts = []
    for name, fact in (
        ("Expected", check.expected),
        ("Measured", check.measured),
        ("The report says", check.reason),
    ):
        if fact:
            facts.append(f"{name}: {fact}")
    return facts


def mail_link(address: str, result: Result, check: CheckResult) -> str:
    """Return a link that opens a mail about a check; the page's script adds the text."""
    return f"mailto:{quote(address, safe='@')}?subject={quote(appeal_head(result, check))}"


def cell_badge(result: Result, criterion: CriterionResult) -> Badge:
    """Return the badge of a criterion with all decisions of people."""
    ids = {check.id for check in criterion.checks}
    undecided = Decimal(0)
    for check in result.open_checks:
        if check.id in ids:
            undecided += check.undecided
    decided = criterion.possible - undecided
    earned = max(Decimal(0), min(result.final_of(criterion), decided))
    return badge_of(outcome_of_points(earned, criterion.possible, undecided))


def signed(value: Decimal) -> str:
    """Write points with their sign: `+2`, `−0.5`, `±0`."""
    if not value:
        return "±0"
    sign = "+" if value > 0 else "−"
    return sign + points(abs(value))


def final_share(result: Result) -> Share:
    """Describe the points with all adjustments; with a bonus, they can exceed the possible points."""
    possible = result.score.possible
    within = max(Decimal(0), min(result.final, possible))
    share = share_of(within, possible, min(result.still_undecided, possible - within))
    return replace(share, earned=points(result.final))


# -- interference with the grader's own nodes and topics ---------------------------------------

HEADING = "For the instructor: something interfered with the grader's nodes or topics"
EXPLANATION = (
    "Seen in the recordings. Each can have an honest cause, such as a wrong topic name or a simulator of one's own. "
    "It costs no points by itself: only checks that could not be measured because of it fail, and these are named here."
)


def titles_of(violation: Violation, result: Result) -> list[tuple[str, str]]:
    """Return ids and titles of the checks that fail because of a violation."""
    found = []
    for check in result.checks:
        if check.id in violation.checks:
            found.append((check.id, check.title))
    return found


def note_of(violation: Violation) -> str:
    """Say that the cause of a violation is uncertain; empty if it is certain."""
    return "" if violation.certain else "What caused it is not certain."


# -- locations of the proof --------------------------------------------------------------------


@dataclass(frozen=True)
class SourceLine:
    """A line of a student's file; `meant` if it is the line of the location."""

    number: int
    text: str
    meant: bool


@dataclass(frozen=True)
class ShownLocation:
    """A location of proof: words, a link within the page, and source lines."""

    text: str
    href: str
    lines: tuple[SourceLine, ...]


def _excerpt(texts: Mapping[str, str], file: str, number: int) -> tuple[SourceLine, ...]:
    """Return a line of a file with its neighbours, without common indentation.

    Lines are numbered from 1, and end as Python's lines do.
    """
    if file not in texts:
        return ()
    lines = lines_of(texts[file])
    if not 1 <= number <= len(lines):
        return ()
    first = max(1, number - CONTEXT_LINES)
    last = min(len(lines), number + CONTEXT_LINES)
    near = [_source_text(text) for text in lines[first - 1 : last]]
    indentations = [_indentation(text) for text in near if text.strip()]
    common = min(indentations, default=0)
    shown = []
    for n, text in enumerate(near, first):
        is_empty_end = n == len(lines) and not text
        if n == number or not is_empty_end:
            shown.append(SourceLine(n, text[common:], n == number))
    return tuple(shown)


def _source_text(text: str) -> str:
    """Return a source line with blanks instead of tabs; a long line is cut."""
    text = text.replace("\t", "    ")
    if len(text) > LONGEST_SOURCE_LINE:
        text = text[: LONGEST_SOURCE_LINE - 1] + "…"
    return text


def _indentation(text: str) -> int:
    return len(text) - len(text.lstrip(" "))


def location_of(
    where: Location,
    texts: Mapping[str, str],
    anchors: Mapping[tuple[str, str], str],
    whole: Mapping[str, WholeFile] = MappingProxyType({}),
) -> ShownLocation:
    """Put a location in words, with its source lines and a link to its file, its process's output or its session."""
    if where.file:
        if not where.line:
            return ShownLocation(str(where), "", ())
        lines = _excerpt(texts, where.file, where.line)
        href = ""
        if lines and where.file in whole:
            href = "#" + whole[where.file].anchor_of(where.line)
        return ShownLocation(str(where), href, lines)
    session = where.session or ""
    process = where.process or ""
    href = anchors.get((session, process)) or anchors.get((session, "")) or ""
    return ShownLocation(str(where), href, ())


def locations_of(
    check: CheckResult,
    texts: Mapping[str, str],
    anchors: Mapping[tuple[str, str], str],
    whole: Mapping[str, WholeFile] = MappingProxyType({}),
) -> list[ShownLocation]:
    """Return the first locations of a check's proof, each once."""
    places = list(dict.fromkeys(check.where))
    found = []
    for where in places[:MOST_LOCATIONS]:
        location = location_of(where, texts, anchors, whole)
        if location.text:
            found.append(location)
    return found


# -- moments -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moment:
    """A time in a motion at which a check lost points: in words, and as a position on a line of 1000.

    `at_ms` is the time at which a reader should look first.
    """

    check: CheckResult
    text: str
    left: float
    width: float
    at_ms: int


def moments_of(result: Result, figure: Figure) -> list[Moment]:
    """Return the first moment of each check's proof within the motion that a figure shows."""
    first_ms = int(figure.content.times_ms[0])
    last_ms = int(figure.content.times_ms[-1])
    whole_ms = max(1, last_ms - first_ms)
    found = []
    for check in result.checks:
        where = _first_in(check, figure.session)
        if where is None or where.start_s is None:
            continue
        end_s = where.end_s
        if end_s is None:
            end_s = where.start_s
        start_ms = min(max(round(where.start_s * 1000), first_ms), last_ms)
        end_ms = min(max(round(end_s * 1000), first_ms), last_ms)
        left = 1000 * (start_ms - first_ms) / whole_ms
        width = 1000 * (end_ms - start_ms) / whole_ms
        found.append(Moment(check, where.span, left, max(width, _NARROWEST), start_ms))
    return found


def _first_in(check: CheckResult, session: str | None) -> Location | None:
    """Return the first location with a time in a session, if the check lost points."""
    if not check.lost:
        return None
    for where in check.where:
        if where.session == session and where.start_s is not None:
            return where
    return None


# -- sessions ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class PrintedLine:
    """A line of output, counted from 0; `far` lines are left out on paper. `left_out` lines before it are not shown."""

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
    """Return the heading of a process: its name, and the number of its start if it was started several times."""
    name = record.processes[number].name
    starts = [n for n, other in enumerate(record.processes) if other.name == name]
    heading = line(name, 120)
    if len(starts) > 1:
        heading += f", start {starts.index(number) + 1}"
    return heading


def processes_of(record: SessionRecord) -> list[tuple[int, str, ProcessRun]]:
    """Return the processes to show, the submission's first: index in the record, heading, and process.

    Processes of the grader are shown only if they printed something.
    """
    shown = []
    for number, run in enumerate(record.processes):
        if run.role != "grader" or run.output:
            shown.append((number, heading_of(record, number), run))
    order = {"student": 0, "reference": 1, "grader": 2}
    return sorted(shown, key=lambda one: order.get(one[2].role, 3))


def output_of(run: ProcessRun, started_ns: int, meant: Collection[int] = ()) -> list[PrintedLine]:
    """Return the first and the last lines of a process's output, and the lines near those of `meant`."""
    count = len(run.output)
    near_meant: set[int] = set()
    for each in meant:
        near_meant.update(range(each - LINES_BEFORE, each + 2))
    near_meant.intersection_update(range(count))
    near = near_meant | _ends(count, PRINTED_HEAD_LINES, PRINTED_TAIL_LINES)
    shown = near_meant | _ends(count, HEAD_LINES, TAIL_LINES)
    printed = []
    previous = -1
    for number in sorted(shown):
        left_out = number - previous - 1
        far = number not in near
        printed.append(_printed(run.output[number], number, started_ns, far, left_out))
        previous = number
    return printed


def _ends(count: int, head: int, tail: int) -> set[int]:
    """Return the numbers of the first and the last lines of an output."""
    first = range(min(head, count))
    last = range(max(0, count - tail), count)
    return {*first, *last}


def _printed(
    output: OutputLine, number: int, started_ns: int, far: bool, left_out: int
) -> PrintedLine:
    # A bare carriage return overwrites the line, as a progress bar does.
    text = output.text.rstrip("\r").rpartition("\r")[2]
    if len(text) > LONGEST_OUTPUT_LINE:
        text = text[: LONGEST_OUTPUT_LINE - 1] + "…"
    time = f"{(output.t_ns - started_ns) / 1e9:.3f}"
    return PrintedLine(number, time, output.stream == "stderr", text, far, left_out)


def end_of(run: ProcessRun) -> str:
    """Say how a process ended, such as `ended by itself, exit status 0`."""
    status = run.exit_status
    if status is None:
        return "did not end" if run.exited_ns is None else "ended, exit status not known"
    how = _status_text(status)
    ways = {
        "itself": f"ended by itself, {how}",
        "interrupt": f"ended after Ctrl-C (SIGINT), {how}",
        "terminate": f"did not end on Ctrl-C; ended on SIGTERM, {how}",
        "kill": f"did not end on Ctrl-C or SIGTERM; killed, {how}",
        "limit": "ended by the grader",
    }
    text = ways[run.ended_by]
    if run.limit is not None:
        text += f"; limit hit: {run.limit}"
    return text


def _status_text(status: int) -> str:
    """Write an exit status; a negative one is a signal, such as `signal SIGKILL`."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"signal {signal.Signals(-status).name}"
    except ValueError:
        return f"signal {-status}"


# -- circumstances of the grading --------------------------------------------------------------


def utc(t_ns: Any) -> str:
    """Write a time of the system clock as date and minute in UTC; empty if it is not a time."""
    if not isinstance(t_ns, int) or not 0 < t_ns < 2**62:
        return ""
    return datetime.fromtimestamp(t_ns // 10**9, tz=UTC).strftime("%Y-%m-%d %H:%M UTC")


def isolations_of(
    sessions: Mapping[str, SessionRecord],
) -> list[tuple[Mapping[str, Any], list[str]]]:
    """Return the ways of confinement, each with the names of its sessions."""
    found: list[tuple[Mapping[str, Any], list[str]]] = []
    for name, record in sessions.items():
        for way, names in found:
            if way == record.isolation:
                names.append(name)
                break
        else:
            found.append((record.isolation, [name]))
    return found


def versions_of(result: Result) -> list[tuple[str, str]]:
    """Return names and values of the versions and hashes behind a result."""
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
    """Name the distribution of ROS of the grading, and that of the handout if it is another."""
    graded = _distribution(result.provenance.get("versions", {}))
    if not graded:
        return ""
    text = f"graded on ROS 2 {graded}"
    handout = result.provenance.get("handout_ros", "")
    if handout not in ("", graded):
        text += f" (the handout: {handout})"
    return text


def _distribution(packages: Iterable[str]) -> str:
    """Return the distribution of ROS in the names of packages: `Jazzy` from `ros-jazzy-rclpy`."""
    for package in packages:
        name = re.fullmatch(r"ros-([a-z]+)-rclpy", package)
        if name:
            return name[1].capitalize()
    return ""


def found_note(artifact: ArtifactFact) -> str:
    """Say how a file was found that stands for one of the lab's, or name the candidates for a missing file."""
    if artifact.path is None:
        candidates = ", ".join(artifact.candidates[:5])
        return f"could have been meant: {candidates}" if candidates else ""
    notes = {"name": "", "near miss": "used in its place, under another name"}
    return notes.get(artifact.found_by, artifact.found_by)


#: Most listed paths of files that were not graded.
_MOST_PATHS = 5
SEVERAL_FILES = "Several files of one name"
IF_WRONG = "If the wrong one was graded, tell your instructor."


def chosen_words(chosen: ChosenFile) -> str:
    """Say which of several files of one name was graded, why, and which files were not."""
    listed = ", ".join(chosen.others[:_MOST_PATHS])
    left = len(chosen.others) - _MOST_PATHS
    if left > 0:
        listed += f" and {left} more"
    words = f"{chosen.path} was graded"
    if chosen.why:
        joined = "; " if chosen.is_open else ", because "
        words += f"{joined}{chosen.why}"
    words += f". Not graded: {listed}."
    if chosen.is_open:
        words += " Your instructor is asked to look."
    return words
