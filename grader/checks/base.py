"""What every check gets and gives: the context of a judgement, and ways to state a finding."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from grader.evidence.cpu_delay import Span
from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.diagnosis import explain
from grader.evidence.oracle import load_oracle
from grader.evidence.recorded import Recorded
from grader.lab.steps.get_parameters import GetParametersResult
from grader.recording.session import ProcessRun
from grader.recording.submission import SubmissionRecord
from grader.result import Finding, Location, Outcome


@dataclass(frozen=True)
class Context:
    """All that a check may look at."""

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

    @property
    def session(self) -> Recorded:
        """The check's session; no rubric is loaded in which a check has none that needs one."""
        assert self.recorded is not None
        return self.recorded

    def location(self, topic: str | None = None, span: Span | None = None) -> Location:
        """Point at the check's session, and at a topic or service there under the name that the student used."""
        name = self.recorded.record.session if self.recorded else None
        used = self.session.used(topic) if topic else None
        ends = (
            [self.session.since_start_s(t) for t in (span.start_ns, span.end_ns)]
            if span
            else [None, None]
        )
        return Location(session=name, topic=used, start_s=ends[0], end_s=ends[1])

    def path_of(self, artifact: str) -> str | None:
        """Return an artifact's path in the submission, or None if it is missing."""
        fact = self.submission.artifact(artifact)
        return fact.path if fact else None

    def output_of(self, artifact: str) -> Location:
        """Point at what an artifact's process printed."""
        return Location(session=self.session.record.session, process=artifact)

    def charged(self, check: str | None) -> bool:
        """Whether a check, if any, has already taken points."""
        finding = self.findings.get(check) if check is not None else None
        return finding is not None and finding.outcome in (
            Outcome.FAILED,
            Outcome.PARTIAL,
            Outcome.NOT_REACHED,
        )

    def explain(self, run: ProcessRun) -> Diagnosis | None:
        """Explain why a process ended or misbehaved, from its output."""
        return explain(run.output, [f.path for f in self.submission.files], run.interrupted_ns)

    def diagnosis(self, artifact: str) -> Diagnosis | None:
        """Explain why one of an artifact's processes ended or misbehaved."""
        runs = self.recorded.processes_of(artifact) if self.recorded is not None else ()
        return next(filter(None, map(self.explain, runs)), None)

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
    """State that all is as it should be."""
    return Finding(
        Outcome.PASSED, Decimal(1), expected, measured, where=tuple(where), notes=tuple(notes)
    )


_MEASUREMENT_ERROR = "The measurement error spans more than one credit level."
#: What is nearer to full credit than points are given is full credit.
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
    """State a finding by the share of credit that it earns; the reason is dropped when that is all.

    Bounds that earn the same decide it. Those of a measured share that are further apart than a level, without a doubt,
    are the program's own unevenness: where they stay so, the lower one counts.

    From `share` to `best` it earns as far as the recording and the machine's delays tell. The doubt says what keeps it
    from being decided where these differ, and is empty where that is the error of a measurement. A measured share is
    rounded down to so many credit levels; 0 where it is none.
    """
    low, high = (
        credit_of(quantise(s, levels) if levels else s)
        for s in (share, share if best is None else best)
    )
    if low != high:
        uneven = not doubt and float(high - low) > 1.5 / (levels or CREDIT_LEVELS)
        settled = graded(float(low), expected, measured, reason, where=where) if uneven else None
        return inconclusive(
            expected, measured, doubt or _MEASUREMENT_ERROR, where=where, settled=settled
        )
    if low >= _AS_GOOD_AS_FULL:
        return passed(expected, measured, where=where, notes=notes)
    outcome = Outcome.PARTIAL if low > 0 else Outcome.FAILED
    return Finding(outcome, low, expected, measured, reason, hint, tuple(where), tuple(notes))


@dataclass(frozen=True)
class Part:
    """One of several things: what it earns, what it is, and why it earns no more; all count the same by default."""

    share: float
    text: str = ""
    reason: str = ""
    #: The most that it earns as far as the recording and the machine's delays tell; None where that is `share`.
    best: float | None = None
    #: What keeps it from being decided then.
    doubt: str = ""
    hint: str = ""
    where: tuple[Location, ...] = ()
    notes: tuple[str, ...] = ()
    #: What it counts beside the others.
    weight: float = 1.0


def weighed(parts: Sequence[Part], weight: float) -> list[Part]:
    """Return parts that count so much together."""
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
    """State what parts earn together, each by its weight, less what costs a share of the whole."""
    lost, whole = sum(share for share, _ in costs), sum(part.weight for part in parts) or 1.0
    best = sum(
        part.weight * (part.share if part.best is None else max(part.share, part.best))
        for part in parts
    )
    return graded(
        max(0.0, sum(part.weight * part.share for part in parts) / whole - lost),
        expected,
        measured or "; ".join(part.text for part in parts if part.text),
        " ".join(
            dict.fromkeys(
                [*(reason for _, reason in costs), *(part.reason for part in parts if part.reason)]
            )
        ),
        hint=next((part.hint for part in parts if part.hint), ""),
        where=[*(location for part in parts for location in part.where), *where],
        notes=[note for part in parts for note in part.notes],
        best=max(0.0, best / whole - lost),
        doubt=" ".join(dict.fromkeys(part.doubt for part in parts if part.doubt)) or doubt,
    )


#: Credit levels that a measured share is rounded down to.
CREDIT_LEVELS = 10


def quantise(share: float, levels: int = CREDIT_LEVELS) -> float:
    """Return a measured share as credit in even levels, rounded down; what is as good as full is full.

    Two recordings never measure the same. Levels keep the score the same but at their edges, see `graded`.
    """
    if share >= float(_AS_GOOD_AS_FULL):
        return 1.0
    return math.floor(max(0.0, share) * levels + 1e-9) / levels


def failed(
    expected: str, measured: str, reason: str, *, hint: str = "", where: Sequence[Location] = ()
) -> Finding:
    """State that nothing of it is as it should be."""
    return graded(0.0, expected, measured, reason, hint=hint, where=where)


def unexplained(finding: Finding) -> Finding:
    """Return a finding for which the engine looks whether the program crashed, ended or hit a limit."""
    return replace(finding, unexplained=True)


def inconclusive(
    expected: str,
    measured: str,
    reason: str,
    *,
    where: Sequence[Location] = (),
    retry: bool = True,
    settled: Finding | None = None,
) -> Finding:
    """State that the recording cannot answer: the machine's doing, or for a person to decide; it earns nothing."""
    return Finding(
        Outcome.INCONCLUSIVE,
        Decimal(0),
        expected,
        measured,
        reason,
        "",
        tuple(where),
        (),
        retry,
        settled,
    )


def undecided(
    finding: Finding, reason: str, *, retry: bool = True, settled: Finding | None = None
) -> Finding:
    """Return a finding as one that the recording cannot answer after all."""
    lost: dict[str, Any] = {
        "credit": Decimal(0),
        "reason": reason,
        "hint": "",
        "retry": retry,
        "settled": settled,
    }
    return replace(finding, outcome=Outcome.INCONCLUSIVE, **lost)


def unclear(expected: str, measured: str, reason: str) -> Finding:
    """State that the recording cannot answer, which a program can bring about too: repeated, it has failed."""
    fails = failed(expected, measured, reason)
    return undecided(fails, reason, settled=fails)


def not_reached(reason: str, *, expected: str = "") -> Finding:
    """State that an earlier failure kept this from being looked at."""
    return Finding(Outcome.NOT_REACHED, Decimal(0), expected, "", reason)


def ramp(value: float, full: float, zero: float) -> float:
    """Return 1 up to `full`, 0 from `zero`, and a straight line between (or the same downwards)."""
    if full == zero:
        return 1.0 if value <= full else 0.0
    return min(1.0, max(0.0, (zero - value) / (zero - full)))


#: Decimal places after which numbers are taken for equal.
_MOST_PLACES = 9


def apart(value: float, *limits: float, places: int) -> str:
    """Return a number with so many decimal places, or more, that it reads on its own side of each limit.

    A verdict by 99.98 must not read as if it were by 100.0.
    """
    for digits in range(places, _MOST_PLACES):
        shown = [
            (round(value, digits) > round(n, digits)) - (round(value, digits) < round(n, digits))
            for n in limits
        ]
        if shown == [(value > n) - (value < n) for n in limits]:
            return f"{value:.{digits}f}"
    return f"{value:.{places}f}"


def percent(share: float) -> str:
    """Return a share from a rubric as it is written there."""
    return f"{100 * share:g}%"


#: Share of a time for which a process was delayed, from which all that happened in it may depend on that.
MANY_DELAYS = 0.25


def cpu_delay_doubt(delay_s: float, length_s: float) -> str:
    """Say that the machine's delay may be why something is not as it should be."""
    return f"Not your fault: the grading computer was too busy to measure this ({delay_s:.2f} s of {length_s:.1f} s)."


def without_delay(value: float, delay_s: float, length_s: float) -> float:
    """Return what a count or a rate may have been, had the machine not delayed the process for so long."""
    return value / (1 - min(0.5, delay_s / max(length_s, 1e-9)))


def describe_diagnosis(found: Diagnosis) -> str:
    """Describe a diagnosis in a line, with the exception and the student's line."""
    location = f"{found.file}, line {found.line}" if found.file and found.line else found.file or ""
    parts = [part for part in (found.exception_type, location) if part]
    return f"{found.problem} ({' in '.join(parts)})" if parts else found.problem
