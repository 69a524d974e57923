"""The context of each check, and functions that state its finding."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from grader.evidence.bounds import Interval
from grader.evidence.cpu_delay import Span
from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.diagnosis import crashed_at, ended_by_signal, explain
from grader.evidence.crash.hang import hang_of
from grader.evidence.oracle import load_oracle
from grader.evidence.recorded import Recorded
from grader.evidence.source_causes import OVERWRITTEN, corrected
from grader.lab.steps.get_parameters import GetParametersResult
from grader.recording.session import ProcessRun
from grader.recording.submission import SubmissionRecord
from grader.result import Finding, Location, Outcome


@dataclass(frozen=True)
class Context:
    """The evidence that a check may look at."""

    submission: SubmissionRecord
    #: The check's session; None for static checks.
    recorded: Recorded | None
    #: All sessions that were recorded, by name.
    sessions: Mapping[str, Recorded]
    #: Findings of the checks before this one, by id.
    findings: Mapping[str, Finding]
    #: Fully qualified names of the reference nodes; their endpoints are not the student's.
    reference_nodes: frozenset[str]
    #: Where the rubric's oracles lie.
    lab_folder: Path
    #: Titles of all checks, by id.
    titles: Mapping[str, str] = field(default_factory=dict)
    #: Mistakes charged by other checks: name -> id of the check.
    charged_elsewhere: Mapping[str, str] = field(default_factory=dict)

    @property
    def session(self) -> Recorded:
        """The recording of the check's session; a rubric loads only if each check that needs a session has one."""
        assert self.recorded is not None
        return self.recorded

    def location(self, topic: str | None = None, span: Span | None = None) -> Location:
        """Point at the check's session, and at a topic or service there under the name that the student used."""
        name = self.recorded.record.session if self.recorded else None
        used = self.session.used(topic) if topic else None
        if span is None:
            return Location(session=name, topic=used)
        start_s = self.session.since_start_s(span.start_ns)
        end_s = self.session.since_start_s(span.end_ns)
        return Location(session=name, topic=used, start_s=start_s, end_s=end_s)

    def path_of(self, artifact: str) -> str | None:
        """Return an artifact's path in the submission, or None if it is missing."""
        fact = self.submission.artifact(artifact)
        return fact.path if fact else None

    def output_of(self, artifact: str) -> Location:
        """Point at the output of an artifact's process."""
        return Location(session=self.session.record.session, process=artifact)

    def charged(self, check: str | None) -> bool:
        """Tell whether a check, if any, has already taken points, or another check for the same mistake."""
        finding = None
        if check is not None:
            finding = self.findings.get(check)
        if finding is None:
            return False
        outcomes = (Outcome.NOT_REACHED, Outcome.EXCUSED)
        return finding.outcome.took_points or finding.outcome in outcomes

    def charged_under(self, cause: str | None, by: Iterable[str | None] = ()) -> str | None:
        """Return the id of another check with the charge for a mistake; None without one.

        Parameters
        ----------
        cause
            Name of the mistake; its dearest check has the charge.
        by
            Ids of earlier checks; each has the charge for the consequences of its own loss.
        """
        check = self.charged_elsewhere.get(cause or "")
        if check is not None:
            return check
        for earlier in by:
            if earlier is not None and self.charged(earlier):
                return earlier
        return None

    def also_under(self, check: str) -> str:
        """Say that a check charges the same mistake."""
        return (
            f"This mistake is charged under '{self.titles.get(check, check)}', and not again here."
        )

    def charge(self, finding: Finding, cause: str | None, by: Iterable[str | None] = ()) -> Finding:
        """Add the cause of its loss to a finding, or excuse the finding if another check has the charge."""
        if not finding.outcome.took_points:
            return finding
        check = self.charged_under(cause, by)
        if check is not None:
            return replace(excused(finding, self.also_under(check)), charged_by=(check,))
        if cause is None:
            return finding
        return replace(finding, causes=(*finding.causes, cause))

    def charge_part(self, part: Part, cause: str | None, by: Iterable[str | None] = ()) -> Part:
        """Add the cause of its loss to a part, or excuse the part if another check has the charge."""
        if part.share >= 1:
            return part
        check = self.charged_under(cause, by)
        if check is not None:
            return self.excuse_part(part, check)
        if cause is None:
            return part
        return replace(part, causes=(*part.causes, cause))

    def excuse_part(self, part: Part, check: str) -> Part:
        """Excuse a part, because a check charges the same mistake."""
        return replace(excused_part(part, self.also_under(check)), charged_by=check)

    def explain(self, run: ProcessRun) -> Diagnosis | None:
        """Explain why a process ended or misbehaved, from its output and its exit status."""
        files = [file.path for file in self.submission.files]
        found = explain(run.output, files, run.interrupted_ns)
        if found is None:
            found = ended_by_signal(run, files)
        elif found.file is None:
            found = crashed_at(found, run, files)
        if found is None or found.file is None:
            return found
        return corrected(found, self.submission.texts)

    def overwritten(self, artifact: str | None) -> Diagnosis | None:
        """Return the crash of a program by an overwritten attribute of rclpy's Node; None without one."""
        found = None
        if artifact is not None:
            found = self.diagnosis(artifact)
        if found is None or found.kind != OVERWRITTEN:
            return None
        return found

    def diagnosis(self, artifact: str) -> Diagnosis | None:
        """Explain why one of an artifact's processes ended or misbehaved."""
        if self.recorded is None:
            return None
        for run in self.recorded.processes_of(artifact):
            found = self.explain(run)
            if found is not None:
                return found
        return None

    def hang(self, artifact: str) -> Diagnosis | None:
        """Return where an artifact's program hangs; None if its stacks do not show that."""
        if self.recorded is None:
            return None
        stacks = [stack for stack in self.recorded.record.stacks if stack.process == artifact]
        return hang_of(stacks, [f.path for f in self.submission.files], self.submission.texts)

    def parameter(self, step: str | None, name: str | None) -> Any:
        """Return the value of a parameter as a step read it in the running node; None if it did not."""
        if step is None or name is None:
            return None
        run = self.session.step(step)
        if run is None:
            return None
        read = GetParametersResult.of(run).read.get(name)
        return None if read is None else read.value

    def oracle(self, reference: str) -> Callable[..., Any]:
        """Load an oracle by ``file.py:function``, relative to the rubric's folder."""
        return load_oracle(self.lab_folder, reference)


def credit_of(share: float) -> Decimal:
    """Turn a share into credit: between 0 and 1, in thousandths."""
    return Decimal(str(round(min(1.0, max(0.0, share)), 3)))


def passed(
    expected: str, measured: str, *, where: Sequence[Location] = (), notes: Sequence[str] = ()
) -> Finding:
    """State that everything is right."""
    return Finding(
        Outcome.PASSED, Decimal(1), expected, measured, where=tuple(where), notes=tuple(notes)
    )


def excused(finding: Finding, elsewhere: str) -> Finding:
    """Return a finding without its loss, with a sentence on the check charged for the same mistake."""
    reason = f"{finding.reason} {elsewhere}".strip()
    full = Decimal(1)
    return replace(finding, outcome=Outcome.EXCUSED, credit=full, reason=reason, hint="")


_MEASUREMENT_ERROR = "The measurement error spans more than one credit level."
#: Least credit that counts as full, because points are rounded to tenths.
_AS_GOOD_AS_FULL = Decimal("0.99")


def graded(
    share: float,
    expected: str,
    measured: str,
    reason: str,
    *,
    hint: str = "",
    where: Sequence[Location] = (),
    notes: Sequence[str] = (),
    best: float | None = None,
    doubt: str = "",
    levels: int = 0,
) -> Finding:
    """State a finding by its share of the credit; full credit drops the reason.

    The finding is undecided if `share` and `best` earn different credit. Without a doubt about the machine, repeated
    recordings settle it: bounds more than a level apart show that the program itself is uneven, and the lower one counts;
    neighbouring levels are the error of the measurement, and the upper one counts.

    Parameters
    ----------
    share, best
        Least and most share within the error of the recording and the delays of the machine; equal without `best`.
    reason, hint
        Why points are lost, and how to fix it.
    doubt
        Sentence on the cause of a difference between `share` and `best`; empty for the error of a measurement.
    levels
        Number of credit levels to which a measured share is rounded down; 0 for a share that is not measured.
    """
    low = _leveled(share, levels)
    if best is None:
        high = low
    else:
        high = _leveled(best, levels)
    if low != high:
        settled = None
        if not doubt:
            is_uneven = float(high - low) > 1.5 / (levels or CREDIT_LEVELS)
            settled = graded(
                float(low if is_uneven else high), expected, measured, reason, where=where
            )
        cause = f"{doubt or _MEASUREMENT_ERROR} {_between(low, high)}"
        return inconclusive(expected, measured, cause, where=where, settled=settled)
    if low >= _AS_GOOD_AS_FULL:
        return passed(expected, measured, where=where, notes=notes)
    outcome = Outcome.PARTIAL if low > 0 else Outcome.FAILED
    return Finding(outcome, low, expected, measured, reason, hint, tuple(where), tuple(notes))


def _between(low: Decimal, high: Decimal) -> str:
    """Say between which two credits an undecided check lies."""
    return f"It earns at least {low:.0%} and at most {high:.0%} of the points."


def _leveled(share: float, levels: int) -> Decimal:
    """Return a share as credit, rounded down to so many levels if there are any."""
    if levels:
        return credit_of(quantise(share, levels))
    return credit_of(share)


@dataclass(frozen=True)
class Part:
    """One of several parts of a finding: its share, its measured value and its reason; all weigh the same by default."""

    share: float
    text: str = ""
    reason: str = ""
    #: Most share within the error of the recording and the delays of the machine; None if equal to `share`.
    best: float | None = None
    #: Sentence on the cause of that difference.
    doubt: str = ""
    hint: str = ""
    where: tuple[Location, ...] = ()
    notes: tuple[str, ...] = ()
    #: Weight beside the other parts.
    weight: float = 1.0
    #: Names of the mistakes behind its loss.
    causes: tuple[str, ...] = ()
    #: True if another check charges its mistake.
    is_excused: bool = False
    #: Id of that check, if one check is known.
    charged_by: str | None = None

    @classmethod
    def between(cls, share: Interval, text: str = "", reason: str = "", hint: str = "") -> Part:
        """Return a part with the least and the most share of an interval; one that loses nothing has no reason."""
        if share.low >= 1:
            reason = ""
        return cls(share.low, text, reason, best=share.high, doubt=share.why, hint=hint)

    @property
    def most(self) -> float:
        """The most share."""
        if self.best is None:
            return self.share
        return max(self.share, self.best)


def excused_part(part: Part, elsewhere: str) -> Part:
    """Return a part without its loss, with a sentence on the check charged for the same mistake."""
    reason = f"{part.reason} {elsewhere}".strip()
    return replace(part, share=1.0, best=None, doubt="", hint="", reason=reason, is_excused=True)


def weighed(parts: Sequence[Part], weight: float) -> list[Part]:
    """Return parts with a weight together."""
    return [replace(part, weight=weight / len(parts)) for part in parts]


def of_parts(
    expected: str,
    parts: Sequence[Part],
    *,
    measured: str = "",
    costs: Sequence[tuple[float, str]] = (),
    where: Sequence[Location] = (),
    doubt: str = "",
) -> Finding:
    """State the weighted mean of parts, less costs of the whole.

    Parameters
    ----------
    measured
        Measured value; by default the texts of the parts.
    costs
        Shares of the whole that are lost, each with its reason.
    doubt
        Doubt if no part has one.
    """
    lost = sum(share for share, _ in costs)
    least, most = _bounds(parts, lost)
    places: list[Location] = []
    notes: list[str] = []
    for part in parts:
        places += part.where
        notes += part.notes
    places += where
    if not measured:
        measured = "; ".join(part.text for part in parts if part.text)
    reasons = [reason for _, reason in costs]
    reasons += [part.reason for part in parts]
    reason = " ".join(_different(reasons))
    hint = next((part.hint for part in parts if part.hint), "")
    doubts = _different(part.doubt for part in parts)
    doubt = " ".join(doubts) or doubt
    finding = graded(
        least,
        expected,
        measured,
        reason,
        hint=hint,
        where=places,
        notes=notes,
        best=most,
        doubt=doubt,
    )
    return _with_causes(finding, parts)


def _with_causes(finding: Finding, parts: Sequence[Part]) -> Finding:
    """Return the finding of parts with the causes of its loss, excused if nothing else would be lost."""
    elsewhere = _different(part.reason for part in parts if part.is_excused)
    charging: dict[str, None] = {}
    for part in parts:
        if part.charged_by is not None:
            charging[part.charged_by] = None
    finding = replace(finding, charged_by=tuple(charging))
    if finding.outcome is Outcome.PASSED and elsewhere:
        return replace(finding, outcome=Outcome.EXCUSED, reason=" ".join(elsewhere))
    if not finding.outcome.took_points:
        return finding
    causes: list[str] = []
    for part in parts:
        causes += part.causes
    return replace(finding, causes=(*finding.causes, *_different(causes)))


def _bounds(parts: Sequence[Part], lost: float) -> tuple[float, float]:
    """Return least and most weighted mean of parts, less a lost share of the whole."""
    whole = sum(part.weight for part in parts) or 1.0
    least = sum(part.weight * part.share for part in parts)
    most = sum(part.weight * part.most for part in parts)
    low = max(0.0, least / whole - lost)
    high = max(0.0, most / whole - lost)
    return low, high


def _different(texts: Iterable[str]) -> list[str]:
    """Return texts that are not empty, each once."""
    return list(dict.fromkeys(filter(None, texts)))


#: Number of credit levels of a measured share.
CREDIT_LEVELS = 10


def quantise(share: float, levels: int = CREDIT_LEVELS) -> float:
    """Return a measured share rounded down to even levels; 0.99 or more counts as full.

    Two recordings never measure the same. Levels give both the same score, except at their edges; see `graded`.
    """
    if share >= float(_AS_GOOD_AS_FULL):
        return 1.0
    return math.floor(max(0.0, share) * levels + 1e-9) / levels


def failed(
    expected: str, measured: str, reason: str, *, hint: str = "", where: Sequence[Location] = ()
) -> Finding:
    """State that nothing is right."""
    return graded(0.0, expected, measured, reason, hint=hint, where=where)


def unexplained(finding: Finding) -> Finding:
    """Return a finding that a crash, an early end or a limit of the program may explain; the engine looks for one."""
    return replace(finding, unexplained=True)


def cut_off(finding: Finding) -> Finding:
    """Return a finding after which no check that requires it can be tested, because nothing reaches the program."""
    return replace(finding, passes_on=Decimal(0))


def inconclusive(
    expected: str,
    measured: str,
    reason: str,
    *,
    where: Sequence[Location] = (),
    retry: bool = True,
    settled: Finding | None = None,
) -> Finding:
    """State that the recording cannot answer, because of the machine or because a person decides; this earns nothing."""
    return Finding(
        Outcome.INCONCLUSIVE,
        Decimal(0),
        expected,
        measured,
        reason,
        where=tuple(where),
        retry=retry,
        settled=settled,
    )


def undecided(
    finding: Finding, reason: str, *, retry: bool = True, settled: Finding | None = None
) -> Finding:
    """Return a finding without its decision, because the recording cannot answer after all."""
    return replace(
        finding,
        outcome=Outcome.INCONCLUSIVE,
        credit=Decimal(0),
        reason=reason,
        hint="",
        retry=retry,
        settled=settled,
    )


def unclear(expected: str, measured: str, reason: str) -> Finding:
    """State that the recording cannot answer, perhaps because of the program itself: repeated, the check fails."""
    fails = failed(expected, measured, reason)
    return undecided(fails, reason, settled=fails)


def not_reached(reason: str, *, expected: str = "", blocked_by: str | None = None) -> Finding:
    """State that an earlier failure kept a check, perhaps named by its id, from being tested."""
    return Finding(Outcome.NOT_REACHED, Decimal(0), expected, "", reason, blocked_by=blocked_by)


def ramp(value: float, full: float, zero: float) -> float:
    """Return 1 up to `full`, 0 from `zero`, and a straight line between them; `zero` may be less than `full`."""
    if full == zero:
        return 1.0 if value <= full else 0.0
    return min(1.0, max(0.0, (zero - value) / (zero - full)))


#: Decimal places up to which numbers can differ.
_MOST_PLACES = 9


def apart(value: float, *limits: float, places: int) -> str:
    """Return a number with enough decimal places to stand on its own side of each limit.

    For example, 99.98 with the limit 100 and one decimal place is `99.98`, because `100.0` would read as the limit.
    """
    sides = [_side(value, limit) for limit in limits]
    for digits in range(places, _MOST_PLACES):
        rounded = round(value, digits)
        if sides == [_side(rounded, round(limit, digits)) for limit in limits]:
            return f"{value:.{digits}f}"
    return f"{value:.{places}f}"


def _side(value: float, limit: float) -> int:
    """Return 1 for a value above a limit, -1 for one below it, and 0 for equal or incomparable numbers."""
    return (value > limit) - (value < limit)


def percent(share: float) -> str:
    """Write a share as in a rubric, such as `12.5%`."""
    return f"{100 * share:g}%"


def describe_diagnosis(found: Diagnosis) -> str:
    """Describe a diagnosis in a line, such as `The node crashed (KeyError in node.py, line 3)`."""
    location = found.file or ""
    if found.file and found.line:
        location = f"{found.file}, line {found.line}"
    parts = [part for part in (found.exception_type, location) if part]
    if parts:
        return f"{found.problem} ({' in '.join(parts)})"
    return found.problem
