"""Rules about the file of a check, its program, discovery and the clock; each is a function of a measurement."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

from grader.checks.base import Context, describe_diagnosis, failed, inconclusive, undecided
from grader.checks.endpoints import claimed_at
from grader.checks.situation import Measurement, Situation
from grader.evidence.build_faults import build_fault
from grader.evidence.compiled import (
    not_assessable,
    package_of,
    unbuilt_program_for,
    why_not_built,
)
from grader.evidence.cpu_delay import Span
from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.diagnosis import ended_by_limit, hit_limit
from grader.evidence.environment_gap import environment_gap as missing_here
from grader.evidence.installed_faults import executables_in
from grader.evidence.recorded import clock_step_s
from grader.evidence.source_causes import OTHER_DOMAIN, silent_cause
from grader.evidence.text.starter import untouched
from grader.lab.references import Sought
from grader.recording.session import Claim, ProcessRun
from grader.recording.submission import ArtifactFact, BuildFact, PackageFact
from grader.result import Finding, Location, Outcome
from grader.submission.packages.compiled import compiled_programs, is_compiled_source

#: Reason, hint and locations.
Explanation = tuple[str, str, tuple[Location, ...]]


def missing_file(measurement: Measurement) -> Finding | None:
    """Fail the check if its file is missing in the submission."""
    artifact = getattr(measurement.p, "artifact", None)
    return missing_artifact(measurement.context, artifact)


def missing_artifact(context: Context, artifact: str | None) -> Finding | None:
    """State that an artifact's file is missing, and why one of its name was not extracted.

    A compiled program that cannot be built here leaves the check to a person. None if the file is there, and is built
    if it has to be.
    """
    if artifact is None:
        return None
    fact = context.submission.artifact(artifact)
    if fact is not None and fact.path is not None:
        return _unbuilt(context, fact)
    name = fact.expected if fact else artifact
    unbuilt = unbuilt_program_for(context.submission, name)
    if unbuilt:
        return inconclusive(f"a file {name}", "a compiled program", unbuilt, retry=False)
    reason = f"There is no {name} in the submission."
    for note in context.submission.left_out:
        path = PurePosixPath(note.partition(": ")[0])
        if path.name == name:
            reason += f" Left out was {note}."
            break
    return failed(f"a file {name}", "no such file", reason, hint=f"Hand in a file named {name}.")


def _unbuilt(context: Context, artifact: ArtifactFact) -> Finding | None:
    """State that an artifact's file was not compiled; None if it was, or if Python runs it."""
    path = artifact.path or ""
    if not is_compiled_source(path):
        return None
    expected = f"a program built from {path}"
    package = package_of(context.submission, artifact)
    if package is None:
        hint = "Hand it in with package.xml and CMakeLists.txt."
        reason = f"{path} is not in a package, so that `colcon build` does not compile it."
        return failed(expected, "no package", reason, hint=hint, where=(Location(file=path),))
    build = context.submission.build_of(package)
    if why_not_built(build):
        reason = not_assessable(context.submission, package, path)
        return inconclusive(expected, "a compiled program", reason, retry=False)
    assert build is not None
    fault = build_fault(package, build, context.submission.texts)
    if fault is not None:
        where = (Location(file=fault.file, line=fault.line),)
        return failed(expected, "it does not build", fault.message, hint=fault.remedy, where=where)
    return _uninstalled(context, package, build, path)


def _uninstalled(
    context: Context, package: PackageFact, build: BuildFact, path: str
) -> Finding | None:
    """State that a package compiles a source and does not install the program; None if it may do so."""
    installed = executables_in(build)
    programs = compiled_programs(package, context.submission.texts)
    names = {name for name, source in programs.items() if source == path}
    if not names:
        names = installed
    if not names.isdisjoint(installed):
        return None
    name = min(names, default="PROGRAM")
    reason = f"The package {package.name} installs no program from {path}, so that `ros2 run` finds none."
    hint = f"Add install(TARGETS {name} DESTINATION lib/${{PROJECT_NAME}}) to CMakeLists.txt."
    script = f"{package.path}/CMakeLists.txt".lstrip("/")
    expected = f"a program built from {path}"
    return failed(expected, "it is not installed", reason, hint=hint, where=(Location(script),))


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


def explained(measurement: Measurement) -> Finding | None:
    """Give the crash, the end, the limit or the hang of the program as the reason if nothing came from it."""
    finding = measurement.found
    if not finding.unexplained:
        return None
    context = measurement.context
    artifact = artifact_of(context, measurement.p)
    if artifact is None:
        return None
    explanation = _explanation(context, artifact, finding)
    if explanation is None:
        return None
    reason, hint, places = explanation
    others = [location for location in finding.where if location not in places]
    where = (*places, *others)
    reported = replace(finding, reason=reason, hint=hint or finding.hint, where=where)
    overwritten = context.overwritten(artifact)
    if overwritten is not None:
        return context.charge(reported, overwritten.problem)
    return reported


def _explanation(context: Context, artifact: str, finding: Finding) -> Explanation | None:
    """Explain a finding by the end of a program, or add why a program that goes on is silent."""
    ended = why_ended(context, artifact)
    if ended is not None:
        return ended
    silent = why_silent(context, artifact)
    if silent is None:
        return None
    cause, remedy, places = silent
    return f"{finding.reason} {cause}".strip(), remedy, places


def why_ended(context: Context, artifact: str) -> Explanation | None:
    """Explain the crash, the end or the limit of an artifact's process; None if it went on."""
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


def why_silent(context: Context, artifact: str) -> Explanation | None:
    """Explain by its stacks or its source why a program that went on showed nothing; None if neither tells."""
    found = context.hang(artifact) or _source_cause(context, artifact)
    if found is None:
        return None
    return found.problem, found.remedy, (Location(file=found.file, line=found.line),)


def _source_cause(context: Context, artifact: str) -> Diagnosis | None:
    path = context.path_of(artifact) or ""
    theirs = set(context.session.nodes) - context.reference_nodes
    text = context.submission.texts.get(path, "")
    return silent_cause(path, text, is_in_graph=bool(theirs))


def in_other_domain(measurement: Situation, artifact: str | None) -> bool:
    """Tell whether the source of a program that is not in the graph sets another ROS domain.

    Neither a busy machine nor a failed discovery is then the cause.
    """
    context = measurement.context
    if artifact is None or context.recorded is None:
        return False
    found = _source_cause(context, artifact)
    if found is None or found.kind != OTHER_DOMAIN:
        return False
    # A value that the program computes may be the session's domain after all.
    return found.subject.isdecimal()


def _ended_already(context: Context, artifact: str) -> Explanation | None:
    """Describe a program that ended by itself; None if it went on until it was asked to end."""
    runs = context.session.processes_of(artifact)
    if not runs:
        return None
    run = runs[-1]
    if run.exited_ns is None or run.interrupted_ns is not None or run.ended_by != "itself":
        return None
    path = context.path_of(artifact) or ""
    why = untouched(context.submission.texts.get(path, ""), context.submission.given_texts.values())
    if why:
        hint = "Add the parts that the handout leaves to you."
        return f"{path} {why}: it ends without doing anything.", hint, (Location(file=path),)
    after_s = (run.exited_ns - run.started_ns) / 1e9
    if run.exit_status == 0:
        how = f" (exit status 0 after {after_s:.1f} s, no error)"
        hint = "main() has to reach rclpy.spin(node), which runs the node's callbacks until Ctrl-C."
    else:
        how = f", with exit status {run.exit_status} after {after_s:.1f} s"
        hint = "Its output shows what ended it."
    return f"Your {artifact} node had already ended{how}.", hint, (context.output_of(artifact),)


def environment_gap(measurement: Measurement) -> Finding | None:
    """Leave the check to a person if the program needs something that is missing on the grading computer."""
    finding = measurement.found
    if measurement.check.of_author:
        return _any_program_gap(measurement) if measurement.took_points else None
    names_file = getattr(measurement.p, "artifact", None) is not None
    shows_nothing = finding.unexplained or (measurement.check.by_endpoints and names_file)
    if not shows_nothing or finding.outcome is not Outcome.FAILED:
        return None
    artifact = artifact_of(measurement.context, measurement.p)
    if artifact is None:
        return None
    found = measurement.context.diagnosis(artifact)
    return _gap(measurement.context, artifact, found, finding.expected)


def _any_program_gap(measurement: Measurement) -> Finding | None:
    """State that a program of the session needs something that is missing here, or None.

    The check names the program by its artifact or process; without either, any program of the
    session counts, also one of a launch file.
    """
    context = measurement.context
    concerned = _concerned(context, measurement.p)
    for process in context.session.record.processes:
        if process.role != "student":
            continue
        found = context.explain(process)
        for artifact in concerned:
            gap = _gap(context, artifact, found, measurement.found.expected)
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
    reason = missing_here(found, context.submission, context.path_of(artifact))
    if found is None or reason is None:
        return None
    for recorded in context.sessions.values():
        for run in recorded.students:
            if run.artifact == artifact and not _ends_alike(context, run, found):
                return None
    return reason


def _ends_alike(context: Context, run: ProcessRun, found: Diagnosis) -> bool:
    end = context.explain(run)
    if end is None:
        return False
    return end.kind == found.kind and end.subject == found.subject


def unseen_endpoint(measurement: Measurement) -> Finding | None:
    """Leave the check undecided if a running program asked for an endpoint that the graph never showed.

    Either discovery failed, or the program forged its request. Another ROS domain in the source is cause enough.
    """
    context = measurement.context
    artifact = artifact_of(context, measurement.p)
    if not measurement.took_points or in_other_domain(measurement, artifact):
        return None
    for sought in measurement.p.sought():
        used = context.session.used(sought.name)
        if _is_in_graph(context, sought.kind, used):
            continue
        claim = _claim_for(context, sought, used)
        if claim is not None:
            return _not_in_graph(measurement, claim, f"{sought.kind} {used}")
    return None


def _claim_for(context: Context, sought: Sought, used: str) -> Claim | None:
    """Return the first call for an endpoint by a program that then went on; None without one."""
    for claim in context.session.record.claims:
        if _asks_for(claim, sought.kind, used) and _went_on(context, claim):
            return claim
    return None


def _not_in_graph(measurement: Measurement, claim: Claim, what: str) -> Finding:
    """State that a program asked for something that was not in the graph."""
    at = f"{claim.file}:{claim.line}"
    reason = f"The node asked for the {what} ({at}), but it was not seen in the graph."
    where = claimed_at(claim) or proof(measurement.context, measurement.p)
    located = replace(measurement.found, where=where)
    return undecided(located, reason, settled=measurement.found)


def _asks_for(claim: Claim, kind: str, name: str) -> bool:
    """Tell whether a call asks for an endpoint or a node of this name."""
    if kind == "node" and claim.node == name:
        return True
    sought = name if kind == "node" else name.lstrip("/")
    return (claim.kind, claim.name.lstrip("/")) == (kind, sought)


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


def clock_set(measurement: Measurement) -> Finding | None:
    """Leave the check undecided if the clock of the grading computer was set during its measurement.

    For a check without a window that loses points, the whole session counts.
    """
    if not measurement.check.by_clock:
        return None
    context = measurement.context
    record = context.session.record
    window = getattr(measurement.p, "window", None)
    if not measurement.took_points and not window:
        return None
    span = context.session.window(window) if window else Span(record.started_ns, record.ended_ns)
    step_s = clock_step_s(record, span) if span is not None else 0.0
    if not step_s:
        return None
    reason = (
        f"The grading computer's clock jumped by {step_s * 1e3:.1f} ms during this measurement."
    )
    return undecided(measurement.found, reason)


#: Rules about the measurement of a check, in this order; each sees the finding of those before.
DOUBTS = (explained, environment_gap, unseen_endpoint, clock_set)
