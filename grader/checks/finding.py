"""What every check gets and gives: the context of a judgement, and ways to state a finding."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path, PurePosixPath
from typing import Any

from grader.evidence.diagnosis import Diagnosis, explain
from grader.evidence.elsewhere import only_elsewhere
from grader.evidence.limits import ended_by_limit, hit_limit
from grader.evidence.oracle import load_oracle
from grader.evidence.recorded import Floats, NumericStream, Recorded, can_hold_row
from grader.evidence.source import spin_lines
from grader.recording.session import ProcessRun
from grader.recording.submission import SubmissionRecord
from grader.result import Finding, Outcome, Where


@dataclass(frozen=True)
class Context:
    """All that a check may look at.

    Attributes
    ----------
    recorded : Recorded or None
        The check's session; None for static checks.
    sessions : mapping
        All sessions that were recorded, by name.
    findings : mapping
        Findings of the checks before this one, by id.
    reference_nodes : frozenset of str
        Fully qualified names of the reference nodes; their endpoints are not the student's.
    lab_folder : Path
        Where the rubric's oracles lie.
    """

    submission: SubmissionRecord
    recorded: Recorded | None
    sessions: Mapping[str, Recorded]
    findings: Mapping[str, Finding]
    reference_nodes: frozenset[str]
    lab_folder: Path

    @property
    def session(self) -> Recorded:
        """The check's session.

        Raises
        ------
        LookupError
            If the check has none: a mistake in the rubric.
        """
        if self.recorded is None:
            raise LookupError("this check needs a session; name one in the rubric")
        return self.recorded

    def where(self, topic: str | None = None, **more: Any) -> Where:
        """Point at the check's session, and at a topic there under the name that the student used."""
        name = self.recorded.record.session if self.recorded else None
        used = self.session.used(topic) if topic else None
        return Where(session=name, topic=used, **more)

    def path_of(self, artifact: str) -> str | None:
        """Return an artifact's path in the submission, or None if it is missing."""
        fact = self.submission.artifact(artifact)
        return fact.path if fact else None

    def output_of(self, artifact: str) -> Where:
        """Point at what an artifact's process printed."""
        return Where(session=self.session.record.session, process=artifact)

    def charged(self, check: str | None) -> bool:
        """Whether a check, if any, has already taken points."""
        finding = self.findings.get(check) if check is not None else None
        return finding is not None and finding.outcome in (Outcome.FAILED, Outcome.PARTIAL, Outcome.NOT_REACHED)

    def explain(self, run: ProcessRun) -> Diagnosis | None:
        """Explain why a process ended or misbehaved, from its output."""
        return explain(run.output, [f.path for f in self.submission.files], run.interrupted_ns)

    def diagnosis(self, artifact: str) -> Diagnosis | None:
        """Explain why one of an artifact's processes ended or misbehaved."""
        runs = self.recorded.processes_of(artifact) if self.recorded is not None else ()
        return next(filter(None, map(self.explain, runs)), None)

    def parameter(self, step: str | None, name: str | None) -> Any:
        """Return the value of a parameter as a step read it in the running node; None if it did not."""
        run = self.session.step(step) if step is not None else None
        read = (run.result.get("values", {}) if run is not None else {}).get(name)
        return read["value"] if read is not None else None

    def streams(self, roles: Mapping[str, str], fieldname: str) -> dict[str, NumericStream]:
        """Return the numeric streams for an oracle, by role; roles without numbers are left out."""
        found = {role: self.numeric(topic, fieldname) for role, topic in roles.items()}
        return {role: stream for role, stream in found.items() if stream is not None}

    def numeric(self, topic: str, fieldname: str, *, finite: bool = True) -> NumericStream | None:
        """Return the messages on a topic that carry rows of numbers in a field, see `Recorded.numeric`."""
        self._require_row(topic, fieldname)
        return self.session.numeric(topic, fieldname, finite=finite)

    def rows(self, topic: str, fieldname: str) -> tuple[Floats | None, ...]:
        """Return the row of numbers in a field of each message on a topic, see `Recorded.rows`."""
        self._require_row(topic, fieldname)
        return self.session.rows(topic, fieldname)

    def _require_row(self, topic: str, fieldname: str) -> None:
        """See that a field of the type that the rubric gives a topic can hold a row of numbers.

        Raises
        ------
        LookupError
            If it cannot, which no student can help: a mistake in the rubric.
        """
        stream = self.session.stream(topic)
        given = (step.parameters for step in self.session.record.steps if topic in step.parameters.values())
        types = {str(parameters["type"]) for parameters in given if parameters.get("type")}
        if types and stream.topic_type not in types:
            return  # Another type is the student's, and charged where it is published.
        first = next((message for message in stream.messages() if message is not None), None)
        if first is not None and not can_hold_row(first, fieldname):
            problem = f"the field '{fieldname}' of {stream.topic_type} on {topic} holds no row of numbers"
            raise LookupError(f"{problem}: name another in the rubric")

    def oracle(self, reference: str) -> Callable[..., Any]:
        """Load an oracle by ``file.py:function``, relative to the rubric's folder."""
        return load_oracle(self.lab_folder, reference)


def credit_of(share: float) -> Decimal:
    """Turn a share into credit: between 0 and 1, in thousandths."""
    return Decimal(str(round(min(1.0, max(0.0, share)), 3)))


def passed(expected: str, measured: str, *, where: Sequence[Where] = (), notes: Sequence[str] = ()) -> Finding:
    """State that all is as it should be."""
    return Finding(Outcome.PASSED, Decimal(1), expected, measured, where=tuple(where), notes=tuple(notes))


#: What is nearer to full credit than points are given is full credit.
_AS_GOOD_AS_FULL = Decimal("0.99")


def graded(
    share: float,
    expected: str,
    measured: str,
    reason: str,
    *,
    hint: str = "",
    where: Sequence[Where] = (),
    notes: Sequence[str] = (),
    best: float | None = None,
    doubt: str = "",
    uneven: bool = False,
) -> Finding:
    """State a finding by the share of credit that it earns; the reason is dropped when that is all.

    Parameters
    ----------
    share : float
        What it earns; with `best`, the least that the recording and the machine's delays leave possible.
    best : float, optional
        The most that they leave possible: where it earns more than the least, the finding is inconclusive.
    doubt : str
        What keeps it from being decided then.
    uneven : bool
        Whether that is the program's own doing, so that the least counts where it stays so.
    """
    if best is not None and credit_of(best) != credit_of(share):
        settled = graded(share, expected, measured, reason, where=where) if uneven else None
        return inconclusive(expected, measured, doubt, where=where, settled=settled)
    credit = credit_of(share)
    if credit >= _AS_GOOD_AS_FULL:
        return passed(expected, measured, where=where, notes=notes)
    outcome = Outcome.PARTIAL if credit > 0 else Outcome.FAILED
    return Finding(outcome, credit, expected, measured, reason, hint, tuple(where), tuple(notes))


#: Steps in which a measured share earns credit.
STEPS = 10


def in_steps(share: float, steps: int = STEPS) -> float:
    """Return a measured share as credit in even steps, rounded down; what is as good as full is full.

    Two recordings of the same program never measure exactly the same. Steps keep the score the same, except
    where the measurement lies at a step's edge, which `measured_share` leaves undecided.
    """
    if share >= float(_AS_GOOD_AS_FULL):
        return 1.0
    return math.floor(max(0.0, share) * steps + 1e-9) / steps


def measured_share(
    worst: float,
    best: float,
    expected: str,
    measured: str,
    reason: str,
    doubt: str,
    *,
    steps: int = STEPS,
    by_machine: bool = True,
    where: Sequence[Where] = (),
) -> Finding:
    """State a finding about a share that is known within bounds: decided where both ends earn the same credit.

    Bounds that are further apart than a step, and not for the machine's delays, are the program's unevenness: where
    they stay so, the lower one counts.

    Parameters
    ----------
    worst, best : float
        The least and the largest share that the recording and the machine's delays leave possible.
    doubt : str
        What keeps it from being decided, where it is not.
    by_machine : bool
        Whether that is what the machine did.
    """
    low, high = in_steps(worst, steps), in_steps(best, steps)
    uneven = not by_machine and high - low > 1.5 / steps
    return graded(low, expected, measured, reason, where=where, best=high, doubt=doubt, uneven=uneven)


def failed(expected: str, measured: str, reason: str, *, hint: str = "", where: Sequence[Where] = ()) -> Finding:
    """State that nothing of it is as it should be."""
    return graded(0.0, expected, measured, reason, hint=hint, where=where)


def inconclusive(
    expected: str,
    measured: str,
    reason: str,
    *,
    where: Sequence[Where] = (),
    retry: bool = True,
    settled: Finding | None = None,
) -> Finding:
    """State that the recording cannot answer: the machine's doing, or for a person to decide; it earns nothing."""
    return Finding(Outcome.INCONCLUSIVE, Decimal(0), expected, measured, reason, "", tuple(where), (), retry, settled)


def undecided(finding: Finding, reason: str) -> Finding:
    """Return a finding as one that the recording cannot answer after all."""
    return replace(finding, outcome=Outcome.INCONCLUSIVE, credit=Decimal(0), reason=reason, hint="")


def unclear(expected: str, measured: str, reason: str, *, where: Sequence[Where] = ()) -> Finding:
    """State that the recording cannot answer, which a program can bring about too: repeated, it has failed."""
    fails = failed(expected, measured, reason, where=where)
    return inconclusive(expected, measured, reason, where=where, settled=fails)


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
        shown = [(round(value, digits) > round(n, digits)) - (round(value, digits) < round(n, digits)) for n in limits]
        if shown == [(value > n) - (value < n) for n in limits]:
            return f"{value:.{digits}f}"
    return f"{value:.{places}f}"


def percent(share: float) -> str:
    """Return a share from a rubric as it is written there."""
    return f"{100 * share:g}%"


def kept_from_core(delay_s: float, length_s: float) -> str:
    """Say that the machine's delay may be why something is not as it should be."""
    return f"The machine kept a process from a core for {delay_s:.2f} s of {length_s:.1f} s, which may be why."


def missing_artifact(context: Context, artifact: str | None) -> Finding | None:
    """State that an artifact's file is not there, or None if it is; and if one of its name was not taken in, why."""
    if artifact is None or context.path_of(artifact) is not None:
        return None
    fact = context.submission.artifact(artifact)
    name = fact.expected if fact else artifact
    left_out = [said for said in context.submission.left_out if PurePosixPath(said.partition(": ")[0]).name == name]
    reason = f"There is no {name} in the submission." + (f" Left out was {left_out[0]}." if left_out else "")
    return failed(f"a file {name}", "no such file", reason, hint=f"Hand in a file named {name}.")


def told(found: Diagnosis) -> str:
    """Return a diagnosis as a sentence, with the exception and the student's line."""
    place = f"{found.file}, line {found.line}" if found.file and found.line else found.file or ""
    parts = [part for part in (found.exception_type, place) if part]
    return f"{found.sentence} ({' in '.join(parts)})" if parts else found.sentence


def runs_elsewhere(context: Context, artifact: str, expected: str) -> Finding | None:
    """State that a program cannot be judged since it needs what is missing here, or None if it does not."""
    found = context.diagnosis(artifact)
    reason = environment_gap(context, artifact, found)
    if found is None or reason is None:
        return None
    spot = Where(file=found.file, line=found.line) if found.file else context.where()
    return inconclusive(expected, told(found), reason, where=(spot,), retry=False)


def environment_gap(context: Context, artifact: str, found: Diagnosis | None) -> str | None:
    """Say what a program needs that is missing here, by how one of its runs ended; None if all runs do not end so.

    What is missing is missing whenever the program runs, in whatever session.
    """
    reason = only_elsewhere(found, context.submission, context.path_of(artifact))
    if found is None or reason is None:
        return None
    records = [recorded.record for recorded in context.sessions.values()]
    runs = [run for record in records for run in record.processes if run.role == "student" and run.artifact == artifact]
    ends = map(context.explain, runs)
    alike = all(end is not None and (end.kind, end.subject) == (found.kind, found.subject) for end in ends)
    return reason if alike else None


def nothing_seen(
    context: Context, artifact: str, expected: str, fallback: str, kind: str, names: Sequence[str]
) -> Finding:
    """State that an artifact's node showed none of some endpoints, and why: see `not_seen` and `why_nothing`."""
    reason, hint, where = why_nothing(context, artifact, fallback)
    fails = failed(expected, f"no {kind} in the graph", reason, hint=hint, where=where)
    return not_seen(context, artifact, kind, names, expected) or fails


def why_nothing(context: Context, artifact: str, fallback: str) -> tuple[str, str, tuple[Where, ...]]:
    """Say why an artifact's process did not show what was expected: (reason, hint, where)."""
    output, processes = context.output_of(artifact), context.session.processes_of(artifact)
    hit = hit_limit(processes[-1]) if processes else None
    found = context.diagnosis(artifact)
    if hit is not None and (found is None or ended_by_limit(processes[-1])):
        return *hit, (output,)
    if found is not None:
        return told(found), found.remedy, (Where(file=found.file, line=found.line) if found.file else output,)
    return ended_already(context, artifact) or (fallback, "", (output,))


def ended_already(context: Context, artifact: str) -> tuple[str, str, tuple[Where, ...]] | None:
    """Say of a program that ended by itself without an error what was seen of it: (reason, hint, where).

    That it never spins is said only where its source shows it; None if it went on until it was asked to end.
    """
    runs = context.session.processes_of(artifact)
    run = runs[-1] if runs else None
    if run is None or run.exited_ns is None or run.interrupted_ns is not None or run.ended_by != "itself":
        return None
    output = context.output_of(artifact)
    after_s = (run.exited_ns - run.started_ns) / 1e9
    if run.exit_status != 0:
        reason = f"Your {artifact} node had already ended, with exit status {run.exit_status} after {after_s:.1f} s."
        return reason, "See in its output what ended it.", (output,)
    path = context.path_of(artifact) or ""
    spins = spin_lines(context.submission.texts.get(path, ""), context.submission.texts)
    ended = f"Your {artifact} node had already ended (exit status 0 after {after_s:.1f} s, no error)"
    if spins is None or not path:
        return f"{ended}.", _KEEP_HINT, (output,)
    if not spins:
        return f"{ended}: main() never reaches rclpy.spin(node).", _SPIN_HINT, (Where(file=path), output)
    reason = f"{ended}: what spins in line {spins[0]} was not reached, or came back."
    return reason, _KEEP_HINT, (Where(file=path, line=spins[0]), output)


_SPIN_HINT = "Call rclpy.spin(node) in main() once the node is made: it serves the node's callbacks until Ctrl-C."
_KEEP_HINT = "See that main() is called, and that it goes on to spin the node until Ctrl-C."


def not_seen(context: Context, artifact: str, kind: str, names: Sequence[str], expected: str) -> Finding | None:
    """State that a node which goes on asked for an endpoint that the graph never showed, or None if that is not so.

    Then the discovery failed, or the node forged its request: both leave open what it would have done. Where the
    program hit a limit, that is what kept the node from it.

    Parameters
    ----------
    kind : str
        Kind of the request, as the tap notes it.
    names : sequence of str
        Names of which one was asked for, literally.
    """
    processes = context.session.processes_of(artifact)
    if not processes or processes[-1].interrupted_ns is None or processes[-1].limit is not None:
        return None
    if context.diagnosis(artifact) is not None:
        return None
    wanted = {name.lstrip("/") for name in names}
    for claim in context.session.record.claims:
        if claim.kind == kind and claim.process == processes[-1].name and claim.name.lstrip("/") in wanted:
            reason = f"The node asked for {claim.name} ({claim.file}:{claim.line}), but was not seen in the graph."
            spot = Where(file=claim.file, line=claim.line)
            return unclear(expected, f"no {kind} in the graph", reason, where=(spot,))
    return None
