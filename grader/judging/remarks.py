"""Remarks that cost nothing: advisories about programs, files and packages, and the choice among files of one name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from grader.evidence.build_faults import build_fault
from grader.evidence.compiled import why_not_built
from grader.evidence.crash.diagnosis import advisories, hit_limit
from grader.evidence.gaps import limits_hit
from grader.evidence.installed_faults import use_fault
from grader.evidence.recorded import Recorded
from grader.evidence.session_variables import Asked, asked_in, planned
from grader.lab.steps.start import StartResult, StartStep
from grader.recording.session import NEWER_IDIOM, Claim
from grader.recording.submission import SubmissionRecord
from grader.result import FOR_A_PERSON, ChosenFile, CriterionResult
from launch_plan.plan import Process


def chosen_files(submission: SubmissionRecord) -> tuple[ChosenFile, ...]:
    """Return the graded files that share their name with other files."""
    found = []
    for fact in submission.artifacts:
        if fact.path is not None and fact.passed_over:
            others = tuple(fact.passed_over)
            found.append(ChosenFile(fact.expected, fact.path, others, fact.why, fact.is_open))
    return tuple(found)


def advisories_of(
    sessions: Iterable[Recorded], submission: SubmissionRecord, criteria: Iterable[CriterionResult]
) -> tuple[str, ...]:
    """Return each remark once: from the programs' output, the files, the packages, and the checks' notes."""
    recordings = list(sessions)
    found = [*_of_programs(recordings), *_of_files(submission)]
    asked: list[Asked] = []
    for recorded in recordings:
        asked += asked_in(recorded, submission)
        found += _of_prefixes(recorded)
    reasons = []
    for criterion in criteria:
        for check in criterion.checks:
            found += check.notes
            reasons.append(check.reason)
    said = "\n".join(reasons)
    for each in asked:
        if not _is_charged(each, said):
            found.append(_of_variable(each))
    for remark, fault in _of_builds(submission):
        if fault not in said:
            found.append(remark)
    return tuple(dict.fromkeys(found))


def _of_builds(submission: SubmissionRecord) -> Iterator[tuple[str, str]]:
    """Yield a remark about each package that `ros2 run` cannot use as handed in, and its fault alone."""
    for package in submission.packages:
        build = submission.build_of(package)
        if build is None:
            continue
        if why_not_built(build):
            continue
        fault = build_fault(package, build, submission.texts)
        if fault is None:
            fault = use_fault(package, build, submission.texts)
        if fault is not None:
            yield f"{fault.message} {fault.remedy}", fault.message


def _of_programs(sessions: Iterable[Recorded]) -> Iterator[str]:
    """Yield each remark about programs after their artifacts, such as `talker, listener: It ignores Ctrl-C.`."""
    artifacts: dict[str, list[str]] = {}
    for recorded in sessions:
        for text, artifact in _said_in(recorded):
            artifacts.setdefault(text, []).append(artifact)
    for text, names in artifacts.items():
        named = list(dict.fromkeys(filter(None, names)))
        yield f"{', '.join(named)}: {text}" if named else text


def _said_in(recorded: Recorded) -> Iterator[tuple[str, str]]:
    """Yield each remark about a student's program of a session, with its artifact; empty if it has none."""
    limits = limits_hit(recorded)
    for process in recorded.students:
        artifact = process.artifact or ""
        for text in advisories(process.output):
            yield text, artifact
        for claim in recorded.record.claims:
            if claim.process == process.name and claim.kind == NEWER_IDIOM:
                yield _of_idiom(claim), ""
        hit = hit_limit(replace(process, limit=limits.get(process.name)))
        if hit is not None:
            yield " ".join(hit), artifact


def _of_variable(asked: Asked) -> str:
    """Tell of a variable of the session, with another value in the submission."""
    seen = f"{asked.place} sets {asked.variable} to {asked.value}"
    why = "each session has a ROS domain, an RMW and DDS settings of its own"
    text = f"{seen}. The programs ran without it, because {why}."
    if asked.is_other_domain:
        return text
    return f"{text} That costs no points."


def _is_charged(asked: Asked, said: str) -> bool:
    """Tell whether the reason of a check names a ROS domain at its place."""
    if not asked.is_other_domain:
        return False
    return asked.place in said


def _of_prefixes(recorded: Recorded) -> Iterator[str]:
    """Tell of the omitted prefixes of a launch file."""
    processes = {}
    for process in planned(recorded):
        processes[process.id] = process
    for step in recorded.record.steps:
        if step.kind != StartStep.kind:
            continue
        left_out = StartResult.of(step).without_prefix
        if left_out is None:
            continue
        known = left_out.keys() & processes.keys()
        for id_ in sorted(known):
            yield _of_prefix(processes[id_], left_out[id_])


def _of_prefix(process: Process, prefix: str) -> str:
    """Tell that a launched program ran without the words before its command line."""
    seen = f"{process.file}, line {process.line} starts {process.runs} by the prefix `{prefix}`"
    why = "the grading computer has no such program, or no screen for it"
    return f"{seen}. It ran without the prefix, because {why}. That costs no points."


def _of_idiom(claim: Claim) -> str:
    """Tell of a use of ROS 2 that the ROS 2 of the grading does not know, and that was made to work."""
    place = f"{claim.file}, line {claim.line}"
    seen = f"`{claim.name}:` ends a program on the ROS 2 of this grading, and works on a newer one"
    return f"{FOR_A_PERSON} {place}: {seen}. The grader let it work. The points are given."


def _of_files(submission: SubmissionRecord) -> Iterator[str]:
    """Yield the remarks about files with another name, and about packages."""
    for fact in submission.artifacts:
        if fact.found_by == "near miss":
            yield f"{fact.path} was used as {fact.expected}."
    for package in submission.packages:
        for problem in package.problems:
            yield f"Package {package.name}: {problem}"
