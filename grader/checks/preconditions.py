"""What the engine asks about each check alike: is the file there, how did the program end, was the clock set."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

from grader.checks.base import Context, describe_diagnosis, failed, inconclusive, undecided
from grader.checks.endpoints import claimed_at
from grader.evidence.cpu_delay import Span
from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.diagnosis import ended_by_limit, hit_limit
from grader.evidence.environment_gap import environment_gap
from grader.evidence.recorded import clock_step_s
from grader.recording.session import Claim
from grader.result import Finding, Location

Explanation = tuple[str, str, tuple[Location, ...]]


def missing_artifact(context: Context, artifact: str | None) -> Finding | None:
    """State that an artifact's file is not there, or None if it is; and if one of its name was not extracted, why."""
    if artifact is None or context.path_of(artifact) is not None:
        return None
    fact = context.submission.artifact(artifact)
    name = fact.expected if fact else artifact
    left_out = [
        note
        for note in context.submission.left_out
        if PurePosixPath(note.partition(": ")[0]).name == name
    ]
    reason = f"There is no {name} in the submission." + (
        f" Left out was {left_out[0]}." if left_out else ""
    )
    return failed(f"a file {name}", "no such file", reason, hint=f"Hand in a file named {name}.")


def proof(context: Context, p: Any) -> tuple[Location, ...]:
    """Return where the proof of a finding lies that names no other place."""
    if context.recorded is None:
        return ()
    topic, artifact = getattr(p, "topic", None), getattr(p, "artifact", None)
    return (context.output_of(artifact) if artifact and not topic else context.location(topic),)


def artifact_of(context: Context, p: Any) -> str | None:
    """Return the artifact that a check is about: it names it, or its process; else the first that was started."""
    run = context.session.process(getattr(p, "process", ""))
    students = (run.artifact for run in context.session.record.processes if run.role == "student")
    return getattr(p, "artifact", None) or (
        run.artifact if run is not None else next(students, None)
    )


def explained(context: Context, p: Any, finding: Finding) -> Finding:
    """Put in what kept the program from it, where it crashed, ended or hit a limit, and the check has not said so."""
    if not finding.unexplained:
        return finding
    artifact = artifact_of(context, p)
    reason, hint, where = (artifact and why_nothing(context, artifact)) or (finding.reason, "", ())
    where = (
        *where,
        *(location for location in finding.where or proof(context, p) if location not in where),
    )
    return replace(finding, reason=reason, hint=hint or finding.hint, where=where)


def why_nothing(context: Context, artifact: str) -> Explanation | None:
    """Say why an artifact's process did not show what was expected: reason, hint and where; None if it went on."""
    output, processes = context.output_of(artifact), context.session.processes_of(artifact)
    hit = hit_limit(processes[-1]) if processes else None
    found = context.diagnosis(artifact)
    if hit is not None and (found is None or ended_by_limit(processes[-1])):
        return *hit, (output,)
    if found is not None:
        where = Location(file=found.file, line=found.line) if found.file else output
        return describe_diagnosis(found), found.remedy, (where,)
    return _ended_already(context, artifact)


def _ended_already(context: Context, artifact: str) -> Explanation | None:
    """Say of a program that ended by itself what was seen of it; None if it went on until it was asked to end."""
    run = next(reversed(context.session.processes_of(artifact)), None)
    if (
        run is None
        or run.exited_ns is None
        or run.interrupted_ns is not None
        or run.ended_by != "itself"
    ):
        return None
    after_s = (run.exited_ns - run.started_ns) / 1e9
    how = f" (exit status 0 after {after_s:.1f} s, no error)"
    hint = "main() has to reach rclpy.spin(node), which runs the node's callbacks until Ctrl-C."
    if run.exit_status != 0:
        how, hint = (
            f", with exit status {run.exit_status} after {after_s:.1f} s",
            "Its output shows what ended it.",
        )
    return f"Your {artifact} node had already ended{how}.", hint, (context.output_of(artifact),)


def not_assessable_here(context: Context, artifact: str, expected: str) -> Finding | None:
    """State that a program cannot be judged since it needs what is missing here, or None if it does not."""
    return _gap(context, artifact, context.diagnosis(artifact), expected)


def no_program_assessable_here(context: Context, p: Any, expected: str) -> Finding | None:
    """State that a program of the session cannot be judged since it needs what is missing here, or None.

    It is the one that the check names by its artifact or process; where it names none, any, also one of a launch.
    """
    run = context.session.process(str(getattr(p, "process", "")))
    named = getattr(p, "artifact", None) or (run.artifact if run is not None else None)
    artifacts = [fact.name for fact in context.submission.artifacts if fact.path is not None]
    concerned = [named] if named in artifacts else artifacts
    for process in context.session.record.processes:
        found = context.explain(process) if process.role == "student" else None
        gaps = (_gap(context, artifact, found, expected) for artifact in concerned)
        gap = next(filter(None, gaps), None)
        if gap is not None:
            return gap
    return None


def _gap(context: Context, artifact: str, found: Diagnosis | None, expected: str) -> Finding | None:
    reason = environment_gap_of(context, artifact, found)
    if found is None or reason is None:
        return None
    location = Location(file=found.file, line=found.line) if found.file else context.location()
    return inconclusive(expected, describe_diagnosis(found), reason, where=(location,), retry=False)


def environment_gap_of(context: Context, artifact: str, found: Diagnosis | None) -> str | None:
    """Say what a program needs that is missing here, by how one of its runs ended; None if all runs do not end so.

    What is missing is missing whenever the program runs, in whatever session.
    """
    reason = environment_gap(found, context.submission, context.path_of(artifact))
    if found is None or reason is None:
        return None
    records = [recorded.record for recorded in context.sessions.values()]
    runs = [
        run
        for record in records
        for run in record.processes
        if run.role == "student" and run.artifact == artifact
    ]
    ends = map(context.explain, runs)
    alike = all(
        end is not None and (end.kind, end.subject) == (found.kind, found.subject) for end in ends
    )
    return reason if alike else None


def unseen(context: Context, p: Any, finding: Finding, kinds: Sequence[str]) -> Finding | None:
    """State that a program which went on asked for something that the graph never showed, or None if that is not so.

    Then the discovery failed, or the program forged its request: both leave open what it would have done.
    """
    for kind, wanted in itertools.product(kinds, wanted_by(p)):
        used = context.session.used(wanted[_NAMED_BY[kind]])
        claims = [] if _is_in_graph(context, kind, used) else context.session.record.claims
        sought = ("node", used) if kind == "node" else (kind, used.lstrip("/"))
        asked = (c for c in claims if sought in (("node", c.node), (c.kind, c.name.lstrip("/"))))
        claim = next((c for c in asked if _went_on(context, c)), None)
        if claim is not None:
            reason = f"The node asked for the {kind} {used} ({claim.file}:{claim.line}), but it was not seen in the graph."
            return undecided(replace(finding, where=claimed_at(claim)), reason, settled=finding)
    return None


#: What names an endpoint of a kind in a check's parameters.
_NAMED_BY = {
    "publisher": "topic",
    "subscription": "topic",
    "service": "service",
    "action": "action",
    "node": "node",
}


def wanted_by(p: Any) -> list[dict[str, Any]]:
    """Return what each of several parts asks for, or the check itself."""
    plain = p.model_dump()
    return next(
        (list(plain[name]) for name in ("topics", "nodes", "profiles") if name in plain), [plain]
    )


def _is_in_graph(context: Context, kind: str, name: str) -> bool:
    session = context.session
    if kind == "node":
        return name in session.nodes
    if kind in ("service", "action"):
        offers = (
            graph.services if kind == "service" else graph.actions for graph in session.record.graph
        )
        return any(offer.name == name for listed in offers for offer in listed)
    return bool(session.endpoints_on(name, kind, context.reference_nodes))


def _went_on(context: Context, claim: Claim) -> bool:
    """Whether a program was there until it was told to end, or was seen at least, and nothing else kept it."""
    run = context.session.process(claim.process)
    if run is None or run.limit is not None or context.explain(run) is not None:
        return False
    return run.interrupted_ns is not None or claim.node in context.session.nodes


def clock_set(context: Context, p: Any, *, lost: bool) -> str:
    """Say that the machine's clock was set in the window of a check, or else in the session where it is lost."""
    record, window = context.session.record, getattr(p, "window", None)
    span = context.session.window(window) if window else Span(record.started_ns, record.ended_ns)
    step_s = clock_step_s(record, span) if span is not None and (lost or window) else 0.0
    return (
        f"The grading computer's clock jumped by {step_s * 1e3:.1f} ms during this measurement."
        if step_s
        else ""
    )
