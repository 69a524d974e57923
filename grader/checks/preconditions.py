"""Conditions of every check: its file exists, its program did not end early, the clock was not set."""

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
from grader.recording.session import Claim, ProcessRun
from grader.result import Finding, Location

#: Reason, hint and locations.
Explanation = tuple[str, str, tuple[Location, ...]]


def missing_artifact(context: Context, artifact: str | None) -> Finding | None:
    """State that an artifact's file is missing, and why one of its name was not extracted.

    None if the file is there.
    """
    if artifact is None or context.path_of(artifact) is not None:
        return None
    fact = context.submission.artifact(artifact)
    name = fact.expected if fact else artifact
    reason = f"There is no {name} in the submission."
    for note in context.submission.left_out:
        path = PurePosixPath(note.partition(": ")[0])
        if path.name == name:
            reason += f" Left out was {note}."
            break
    return failed(f"a file {name}", "no such file", reason, hint=f"Hand in a file named {name}.")


def proof(context: Context, p: Any) -> tuple[Location, ...]:
    """Return the default location of a check's proof."""
    if context.recorded is None:
        return ()
    topic = getattr(p, "topic", None)
    artifact = getattr(p, "artifact", None)
    if artifact and not topic:
        return (context.output_of(artifact),)
    return (context.location(topic),)


def artifact_of(context: Context, p: Any) -> str | None:
    """Return the artifact of a check: the named one, its process's, or else the first started one."""
    artifact: str | None = getattr(p, "artifact", None)
    if artifact:
        return artifact
    run = context.session.process(getattr(p, "process", ""))
    if run is not None:
        return run.artifact
    students = context.session.students
    return students[0].artifact if students else None


def explained(context: Context, p: Any, finding: Finding) -> Finding:
    """Return a finding with the crash, end or limit of the program as its reason, if it asks for one."""
    if not finding.unexplained:
        return finding
    artifact = artifact_of(context, p)
    explanation = why_nothing(context, artifact) if artifact else None
    reason, hint, places = explanation or (finding.reason, "", ())
    where = list(places)
    for location in finding.where or proof(context, p):
        if location not in places:
            where.append(location)
    return replace(finding, reason=reason, hint=hint or finding.hint, where=tuple(where))


def why_nothing(context: Context, artifact: str) -> Explanation | None:
    """Explain why an artifact's process did not show the expected behaviour; None if it went on."""
    output = context.output_of(artifact)
    processes = context.session.processes_of(artifact)
    found = context.diagnosis(artifact)
    if processes:
        run = processes[-1]
        hit = hit_limit(run)
        if hit is not None and (found is None or ended_by_limit(run)):
            return *hit, (output,)
    if found is not None:
        where = Location(file=found.file, line=found.line) if found.file else output
        return describe_diagnosis(found), found.remedy, (where,)
    return _ended_already(context, artifact)


def _ended_already(context: Context, artifact: str) -> Explanation | None:
    """Describe a program that ended by itself; None if it went on until it was asked to end."""
    runs = context.session.processes_of(artifact)
    if not runs:
        return None
    run = runs[-1]
    if run.exited_ns is None or run.interrupted_ns is not None or run.ended_by != "itself":
        return None
    after_s = (run.exited_ns - run.started_ns) / 1e9
    if run.exit_status == 0:
        how = f" (exit status 0 after {after_s:.1f} s, no error)"
        hint = "main() has to reach rclpy.spin(node), which runs the node's callbacks until Ctrl-C."
    else:
        how = f", with exit status {run.exit_status} after {after_s:.1f} s"
        hint = "Its output shows what ended it."
    return f"Your {artifact} node had already ended{how}.", hint, (context.output_of(artifact),)


def not_assessable_here(context: Context, artifact: str, expected: str) -> Finding | None:
    """State that a program needs something that is missing on the grading computer.

    None if it does not.
    """
    return _gap(context, artifact, context.diagnosis(artifact), expected)


def no_program_assessable_here(context: Context, p: Any, expected: str) -> Finding | None:
    """State that a program of the session needs something that is missing here, or None.

    The check names the program by its artifact or process; without either, any program of the
    session counts, also one of a launch file.
    """
    concerned = _concerned(context, p)
    for process in context.session.record.processes:
        if process.role != "student":
            continue
        found = context.explain(process)
        for artifact in concerned:
            gap = _gap(context, artifact, found, expected)
            if gap is not None:
                return gap
    return None


def _concerned(context: Context, p: Any) -> list[str]:
    """Return the artifact that a check names by its parameters, or else all that were handed in."""
    run = context.session.process(str(getattr(p, "process", "")))
    named = getattr(p, "artifact", None)
    if not named and run is not None:
        named = run.artifact
    artifacts = [fact.name for fact in context.submission.artifacts if fact.path is not None]
    if named in artifacts:
        return [named]
    return artifacts


def _gap(context: Context, artifact: str, found: Diagnosis | None, expected: str) -> Finding | None:
    reason = environment_gap_of(context, artifact, found)
    if found is None or reason is None:
        return None
    location = Location(file=found.file, line=found.line) if found.file else context.location()
    return inconclusive(expected, describe_diagnosis(found), reason, where=(location,), retry=False)


def environment_gap_of(context: Context, artifact: str, found: Diagnosis | None) -> str | None:
    """Name the requirement of a program that is missing on the grading computer, by the end of a run.

    None if its runs in any session end otherwise, because nothing is missing in one session alone.
    """
    reason = environment_gap(found, context.submission, context.path_of(artifact))
    if found is None or reason is None:
        return None
    for recorded in context.sessions.values():
        for run in recorded.students:
            if run.artifact == artifact and not _ends_alike(context, run, found):
                return None
    return reason


def _ends_alike(context: Context, run: ProcessRun, found: Diagnosis) -> bool:
    end = context.explain(run)
    return end is not None and (end.kind, end.subject) == (found.kind, found.subject)


def unseen(context: Context, p: Any, finding: Finding, kinds: Sequence[str]) -> Finding | None:
    """State that a running program asked for an endpoint that the graph never showed.

    Then the discovery failed, or the program forged its request; both leave its behaviour open.
    None if there is no such endpoint.
    """
    for kind, wanted in itertools.product(kinds, wanted_by(p)):
        used = context.session.used(wanted[_NAMED_BY[kind]])
        if _is_in_graph(context, kind, used):
            continue
        for claim in context.session.record.claims:
            if _asks_for(claim, kind, used) and _went_on(context, claim):
                at = f"{claim.file}:{claim.line}"
                reason = f"The node asked for the {kind} {used} ({at}), but it was not seen in the graph."
                located = replace(finding, where=claimed_at(claim))
                return undecided(located, reason, settled=finding)
    return None


def _asks_for(claim: Claim, kind: str, name: str) -> bool:
    """Tell whether a call asks for an endpoint or a node of this name."""
    if kind == "node" and claim.node == name:
        return True
    sought = name if kind == "node" else name.lstrip("/")
    return (claim.kind, claim.name.lstrip("/")) == (kind, sought)


#: Parameter of a check that names an endpoint of each kind.
_NAMED_BY = {
    "publisher": "topic",
    "subscription": "topic",
    "service": "service",
    "action": "action",
    "node": "node",
}


def wanted_by(p: Any) -> list[dict[str, Any]]:
    """Return the parameters of each of several parts, or of the check itself."""
    plain: dict[str, Any] = p.model_dump()
    for name in ("topics", "nodes", "profiles"):
        if name in plain:
            return list(plain[name])
    return [plain]


def _is_in_graph(context: Context, kind: str, name: str) -> bool:
    session = context.session
    if kind == "node":
        return name in session.nodes
    if kind not in ("service", "action"):
        return bool(session.endpoints_on(name, kind, context.reference_nodes))
    for graph in session.record.graph:
        offers = graph.services if kind == "service" else graph.actions
        if any(offer.name == name for offer in offers):
            return True
    return False


def _went_on(context: Context, claim: Claim) -> bool:
    """Tell whether a program ran until it was told to end, or was seen in the graph, without a fault."""
    run = context.session.process(claim.process)
    if run is None or run.limit is not None or context.explain(run) is not None:
        return False
    return run.interrupted_ns is not None or claim.node in context.session.nodes


def clock_set(context: Context, p: Any, *, lost: bool) -> str:
    """Say that the machine's clock was set in the window of a check.

    For a check without a window that loses points, the whole session counts.
    """
    record = context.session.record
    window = getattr(p, "window", None)
    if not lost and not window:
        return ""
    span = context.session.window(window) if window else Span(record.started_ns, record.ended_ns)
    step_s = clock_step_s(record, span) if span is not None else 0.0
    if not step_s:
        return ""
    return f"The grading computer's clock jumped by {step_s * 1e3:.1f} ms during this measurement."
