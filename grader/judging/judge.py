"""The judging half in one place: recordings + submission facts + rubric → result. Pure.

No ROS, no processes, no clock, no randomness: the same recording and rubric give the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from grader import __version__
from grader.checks.base import Context
from grader.checks.commands import commands_of
from grader.errors import RecordingError
from grader.evidence.crash.diagnosis import advisories, hit_limit
from grader.evidence.gaps import limits_hit
from grader.evidence.integrity import tampering_in
from grader.evidence.near_miss import candidates_in, near_miss
from grader.evidence.recorded import Recorded
from grader.judging.invalidated import with_checks
from grader.judging.rules import TOO_LARGE, Case, decide, faults
from grader.judging.score import score_criteria, total
from grader.lab.kept_lab import identity_of
from grader.lab.rubric import CheckSpec, Rubric
from grader.recording.elements import MOST_VALUES
from grader.recording.session import SESSION_FILE
from grader.recording.submission import SubmissionRecord, read_submission
from grader.result import (
    ChosenFile,
    CriterionResult,
    Finding,
    Provenance,
    Result,
    SessionProvenance,
    Violation,
)


@dataclass(frozen=True)
class Recordings:
    """The recordings of one submission."""

    submission: SubmissionRecord
    #: Session name -> recording, for those that can be judged.
    sessions: Mapping[str, Recorded]
    #: Faults on the grader's side.
    problems: tuple[str, ...] = ()
    #: Sessions that are recorded, and cannot be judged within bounds.
    too_much: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Effort:
    """Limits of judging recordings: the values decoded of a topic, and the sessions left out as too large."""

    most_values: int = MOST_VALUES
    too_much: frozenset[str] = frozenset()


#: All of them.
FULL = Effort()


def open_recordings(folder: Path, rubric: Rubric, effort: Effort = FULL) -> Recordings:
    """Open `recordings/` of one submission; raises RecordingError if it holds none, or one of another version."""
    try:
        submission = read_submission(folder)
    except (OSError, ValueError) as problem:
        raise RecordingError(
            "this is not a folder of recordings",
            location=str(folder),
            remedy=f"Give a results folder of `grade`. ({problem})",
        ) from problem
    sessions, problems = {}, []
    for name in rubric.sessions:
        if not (folder / name / SESSION_FILE).exists():
            continue
        if name in effort.too_much:
            problems.append(f"{name}: {TOO_LARGE}")
            continue
        try:
            recorded = Recorded.open(folder / name, effort.most_values)
        except FileNotFoundError:
            problems.append(f"The recording '{name}' has no bag; its checks are undecided.")
            continue
        except ValueError as problem:
            raise RecordingError(
                "a recording cannot be read",
                location=str(folder / name),
                remedy=f"It may be of another version. ({problem})",
            ) from problem
        recorded.record.names.update(_names_not_awaited(recorded, rubric))
        sessions[name] = recorded
        problems += [f"{name}: {fault}" for fault in faults(recorded)]
    return Recordings(submission, sessions, tuple(problems), effort.too_much)


def _names_not_awaited(recorded: Recorded, rubric: Rubric) -> dict[str, str]:
    """Return the names that a student used for what checks seek in the graph, where no step waited for one."""
    record, references = (
        recorded.record,
        [reference.node for reference in rubric.reference.values()],
    )
    checks = [spec for spec in rubric.checks() if spec.session == record.session]
    sought = {each for spec in checks for each in spec.given.sought() if each.type is not None}
    waited = {
        (key, name)
        for step in record.steps
        if step.kind == "wait_for"
        for key, name in step.parameters.items()
    }
    taken = {*(name for _, name, _ in sought), *recorded.awaited, *record.names.values()}
    found: dict[str, str] = {}
    for kind, name, topic_type in sorted(sought):
        graphs = [] if (kind, name) in waited else record.graph
        there = {c for graph in graphs for c in candidates_in(graph, kind, name, references)}
        if recorded.used(name) in {c.name for c in there}:
            continue
        if guess := near_miss(
            name, topic_type, [c for c in there if c.name not in {*taken, *found.values()}]
        ):
            found[name] = guess.name
    return found


def violations_of(recordings: Recordings, rubric: Rubric) -> tuple[Violation, ...]:
    """Return the tampering in the sessions, with the checks that cannot be judged for it.

    A session whose bag is not whole shows none: a message that cannot be read looks like one that was taken away.
    """
    nodes = {name: reference.node for name, reference in rubric.reference.items()}
    found: list[Violation] = []
    for recorded in recordings.sessions.values():
        if recorded.bag.whole:
            found += [with_checks(each, recorded, rubric) for each in tampering_in(recorded, nodes)]
    return tuple(found)


def judge_checks(
    recordings: Recordings, rubric: Rubric, violations: Sequence[Violation]
) -> dict[str, Finding]:
    """Judge all checks in the rubric's order, except those of sessions that were not asked for."""
    findings: dict[str, Finding] = {}
    # A check is never compared with another session of which a part cannot be read.
    sound = {name: each for name, each in recordings.sessions.items() if each.bag.whole}
    references = frozenset(reference.node for reference in rubric.reference.values())
    context = Context(recordings.submission, None, sound, findings, references, rubric.folder)
    for spec in _checks_to_judge(recordings, rubric, context):
        case = Case(
            spec=spec,
            rubric=rubric,
            context=replace(context, recorded=recordings.sessions.get(spec.session or "")),
            violation=_violation_of(spec, violations),
            is_too_large=spec.session in recordings.too_much,
        )
        findings[spec.id] = decide(case)
    return findings


def _violation_of(spec: CheckSpec, violations: Sequence[Violation]) -> Violation | None:
    """Return the first violation that invalidates a check; None without one."""
    for violation in violations:
        if spec.id in violation.checks:
            return violation
    return None


def _checks_to_judge(recordings: Recordings, rubric: Rubric, context: Context) -> list[CheckSpec]:
    """Return the checks of the sessions that were asked for, and of the bonus that was handed in."""
    bonus: set[str] = set()
    for criterion in rubric.bonus:
        bonus.update(check.id for check in criterion.checks)
    chosen = recordings.submission.sessions
    found = []
    for spec in rubric.checks():
        # A bonus that was not handed in is not missed.
        if spec.id in bonus and context.path_of(rubric.needed_first(spec)) is None:
            continue
        if chosen is None or spec.session is None or spec.session in chosen:
            found.append(spec)
    return found


def judge(recordings: Recordings, rubric: Rubric) -> Result:
    """Judge one submission."""
    violations = violations_of(recordings, rubric)
    findings = judge_checks(recordings, rubric, violations)
    used = {name: recorded.record.names for name, recorded in recordings.sessions.items()}
    commands = {
        spec.id: commands_of(
            spec, rubric, recordings.submission, used.get(spec.session or "", {}), findings[spec.id]
        )
        for spec in rubric.checks()
        if spec.id in findings
    }
    criteria, bonus = (
        score_criteria(specs, findings, commands) for specs in (rubric.criteria, rubric.bonus)
    )
    return Result(
        submission=recordings.submission.name,
        lab=f"Lab {rubric.lab.id}: {rubric.lab.title}",
        score=total(criteria),
        criteria=criteria,
        bonus=bonus,
        advisories=_advisories(recordings, (*criteria, *bonus)),
        problems=recordings.problems,
        provenance=_provenance(recordings, rubric),
        violations=violations,
        chosen=_chosen(recordings.submission),
    )


def _chosen(submission: SubmissionRecord) -> tuple[ChosenFile, ...]:
    """Return the files that were graded where others have the same name."""
    found = []
    for fact in submission.artifacts:
        if fact.path is None:
            continue
        if others := tuple(fact.passed_over):
            found.append(ChosenFile(fact.expected, fact.path, others, fact.why, fact.is_open))
    return tuple(found)


def _advisories(recordings: Recordings, criteria: tuple[CriterionResult, ...]) -> tuple[str, ...]:
    """Collect what costs nothing: from the processes' output (by artifact), the files, and the checks' notes."""
    sources: dict[str, list[str]] = {}
    for recorded in recordings.sessions.values():
        limits = limits_hit(recorded)
        for process in recorded.record.processes:
            if process.role == "student":
                hit = hit_limit(replace(process, limit=limits.get(process.name)))
                for text in (
                    *advisories(process.output),
                    *((" ".join(hit),) if hit is not None else ()),
                ):
                    sources.setdefault(text, []).append(process.artifact or "")
    found = []
    for text, names in sources.items():
        named = list(dict.fromkeys(name for name in names if name))
        found.append(f"{', '.join(named)}: {text}" if named else text)
    artifacts = recordings.submission.artifacts
    found += [
        f"{fact.path} was used as {fact.expected}."
        for fact in artifacts
        if fact.found_by == "near miss"
    ]
    for package in recordings.submission.packages:
        found += [f"Package {package.name}: {p}" for p in package.problems]
    found += [note for c in criteria for check in c.checks for note in check.notes]
    return tuple(dict.fromkeys(found))


def _provenance(recordings: Recordings, rubric: Rubric) -> Provenance:
    sessions: dict[str, SessionProvenance] = {}
    for name, recorded in recordings.sessions.items():
        record = recorded.record
        sessions[name] = {
            "started_ns": record.started_ns,
            "duration_s": round((record.ended_ns - record.started_ns) / 1e9, 3),
            "seed": record.seed,
            "isolation": record.isolation.get("level", "unknown"),
            "cpu_s": {
                role: round(
                    sum(p.usage[-1].cpu_ns for p in record.processes if p.role == role and p.usage)
                    / 1e9,
                    3,
                )
                for role in ("student", "reference", "grader")
            },
            "limits": limits_hit(recorded),
        }
    versions = next((dict(r.record.versions) for r in recordings.sessions.values()), {})
    return {
        "grader": __version__,
        "lab": rubric.lab.id,
        "rubric_sha256": rubric.sha256,
        "lab_sha256": identity_of(rubric),
        "submission_sha256": recordings.submission.sha256,
        "versions": versions,
        **({"handout_ros": rubric.lab.ros} if rubric.lab.ros else {}),
        "sessions": sessions,
        "left_out": list(recordings.submission.left_out),
    }
