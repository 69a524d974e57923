"""The judging half in one place: recordings + submission facts + rubric → result. Pure.

No ROS, no processes, no clock, no randomness: the same recording and rubric give the same bytes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from grader import __version__
from grader.checks.base import Context, inconclusive, not_reached, undecided
from grader.checks.commands import commands_of
from grader.checks.invalidated import is_timed, named, not_measurable, with_checks, without_rest
from grader.checks.preconditions import missing_artifact
from grader.checks.registry import LOST, check_given
from grader.errors import RecordingError
from grader.evidence.crash.diagnosis import advisories, hit_limit
from grader.evidence.flakiness import inconclusive_reason, may_be_flaky
from grader.evidence.gaps import (
    UnreadGap,
    describe_gap,
    dropped,
    gaps_by_student,
    is_unread_by_student,
    limits_hit,
    unread,
)
from grader.evidence.integrity import tampering_in
from grader.evidence.near_miss import candidates_in, near_miss
from grader.evidence.recorded import Recorded
from grader.judging.score import score_criteria, total
from grader.lab.kept_lab import identity_of
from grader.lab.patterns import NOTE, patterns_bounded
from grader.lab.rubric import CheckSpec, Rubric
from grader.recording.elements import MOST_VALUES
from grader.recording.session import SESSION_FILE, RecordingGap
from grader.recording.submission import SubmissionRecord, read_submission
from grader.result import (
    ChosenFile,
    CriterionResult,
    Finding,
    Outcome,
    Provenance,
    Result,
    SessionProvenance,
    Violation,
)

#: Outcomes after which the checks that require this one can still be looked at.
_GOES_ON = (Outcome.PASSED, Outcome.PARTIAL)


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
_TOO_MUCH = (
    "The session was recorded, but judging it takes more time or memory than the grader allows (limit: judging). "
    "A person has to decide."
)


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
            problems.append(f"{name}: {_TOO_MUCH}")
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
        problems += [f"{name}: {fault}" for fault in _faults(recorded)]
    return Recordings(submission, sessions, tuple(problems), effort.too_much)


def _names_not_awaited(recorded: Recorded, rubric: Rubric) -> dict[str, str]:
    """Return the names that a student used for what checks seek in the graph, where no step waited for one."""
    record, references = (
        recorded.record,
        [reference.node for reference in rubric.reference.values()],
    )
    checks = [spec for spec in rubric.checks() if spec.session == record.session]
    sought = {
        each
        for spec in checks
        for each in check_given(spec.check, spec.parameters).names_sought(spec.parameters)
    }
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
    references = frozenset(reference.node for reference in rubric.reference.values())
    # A check is never compared with another session of which a part cannot be read.
    sound = {name: each for name, each in recordings.sessions.items() if each.bag.whole}
    context = Context(recordings.submission, None, sound, findings, references, rubric.folder)
    for spec in _checks_to_judge(recordings, rubric, context):
        finding = _judged_in_session(spec, recordings, context, rubric, violations)
        finding = _of_the_rest(spec, finding, findings, rubric)
        findings[spec.id] = _excused(spec, finding, context, rubric)
    return findings


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


def _judged_in_session(
    spec: CheckSpec,
    recordings: Recordings,
    context: Context,
    rubric: Rubric,
    violations: Sequence[Violation],
) -> Finding:
    """Judge a check on the recording of its session, unless judging that one takes too much."""
    if spec.session in recordings.too_much:
        return _blocked(spec, context.findings, rubric) or _undecidable()
    recorded = recordings.sessions.get(spec.session or "")
    own = dataclasses.replace(context, recorded=recorded)
    return _judge(spec, own, rubric, violations)


def _undecidable() -> Finding:
    return inconclusive("", "", _TOO_MUCH, retry=False)


def _of_the_rest(
    spec: CheckSpec, finding: Finding, findings: Mapping[str, Finding], rubric: Rubric
) -> Finding:
    """Return a finding with its share of credit where what it depends on failed and was repaired for it."""
    repaired = next(
        (findings[r] for r in _all_required(spec, rubric) if r in findings and findings[r].rest),
        None,
    )
    if repaired is None or not finding.credit:
        return finding
    credit = finding.credit * (repaired.rest or Decimal(1))
    said = f"It was judged on a repaired copy, where it earns {float(repaired.rest or 1):.0%}. {finding.reason}".strip()
    hint = finding.hint or repaired.hint
    return dataclasses.replace(
        finding, outcome=Outcome.PARTIAL, credit=credit, reason=said, hint=hint
    )


def _excused(spec: CheckSpec, finding: Finding, context: Context, rubric: Rubric) -> Finding:
    """Return a finding without its loss, where an earlier check took points for the same mistake."""
    earlier = next(filter(context.charged, spec.excused_by), None)
    if earlier is None or finding.outcome not in LOST:
        return finding
    title = next(check.title for check in rubric.checks() if check.id == earlier)
    note = f"'{spec.title}': {finding.reason} This costs nothing here, since '{title}' took points already."
    notes = (*finding.notes, note)
    return dataclasses.replace(
        finding, outcome=Outcome.PASSED, credit=Decimal(1), reason="", hint="", notes=notes
    )


def _all_required(spec: CheckSpec, rubric: Rubric) -> list[str]:
    """Return the ids of the checks that one requires, and of those that they require."""
    by_id = {check.id: check for check in rubric.checks()}
    return [id_ for r in spec.requires for id_ in (r, *_all_required(by_id[r], rubric))]


def _judge(
    spec: CheckSpec, context: Context, rubric: Rubric, violations: Sequence[Violation]
) -> Finding:
    """Judge a check, and say whose fault it is where it is not the student's.

    What the machine or the grader may have done, or what is flaky, makes a finding inconclusive, and it is asked about
    in this order; what comes first has the last word.

    1. A check that it requires was lost or is undecided.
    2. Its session was not recorded.
    3. The student's programs disturbed the recording, and not once only: failed.
    4. The recording is not sound.
    5. The check by itself: whether the file is there; the share within the bounds that the machine's delays leave
       open (`graded`); what is missing where it was graded; and the clock (`Check.judge`).
    6. What a program can bring about itself counts as failed where it was so in every recording (`Finding.settled`).
    7. What it measures was tampered with: failed.
    8. Messages are missing, the grader's own, or since the student's filled the recording: then failed.
    9. What befalls correct programs too has to be seen again (`grader.evidence.flakiness`).
    """
    if (blocked := _blocked(spec, context.findings, rubric)) is not None:
        return blocked
    recorded = context.recorded
    if spec.session and recorded is None:
        needs = rubric.sessions[spec.session].needs
        missing_file = missing_artifact(context, needs[0]) if needs else None
        return missing_file or inconclusive(
            "", "", f"The session '{spec.session}' was not recorded."
        )
    tampering = next((violation for violation in violations if spec.id in violation.checks), None)
    if tampering is not None and tampering.kind.disturbs:
        return not_measurable("", tampering)
    if recorded is not None and (faults := _faults(recorded)):
        return inconclusive(
            "", "", f"The session could not be carried out as planned: {'; '.join(faults)}"
        )
    finding = _found(spec, context)
    if tampering is not None:
        finding = not_measurable(finding.expected, tampering)
    elif recorded is not None:
        finding = _as_far_as_recorded(_settled(finding, recorded), spec, recorded)
    if finding.outcome is Outcome.NOT_REACHED:
        return dataclasses.replace(
            finding, blocked_by=_failed_before(spec, context.findings, rubric)
        )
    if finding.outcome not in (Outcome.FAILED, Outcome.PARTIAL):
        return finding
    if (
        recorded is not None
        and (flaky := inconclusive_reason(recorded, context.reference_nodes)) is not None
    ):
        return undecided(finding, flaky)
    return finding if finding.hint else dataclasses.replace(finding, hint=spec.hint)


def _blocked(spec: CheckSpec, findings: Mapping[str, Finding], rubric: Rubric) -> Finding | None:
    """Pass on that an earlier check was lost or is undecided, None if all that this one requires went on."""
    earlier_ones = ((r, findings[r]) for r in spec.requires if r in findings)
    ends = (r for r, f in earlier_ones if f.cut_off or (f.outcome not in _GOES_ON and not f.rest))
    required = next(ends, None)
    if required is None:
        return None
    title = next(check.title for check in rubric.checks() if check.id == required)
    earlier = findings[required]
    if not earlier.outcome.decided:
        return inconclusive("", "", f"Depends on '{title}', which is not decided yet.", retry=False)
    if earlier.outcome is Outcome.NOT_REACHED:
        # Both are blocked by the same check.
        return dataclasses.replace(not_reached(earlier.reason), blocked_by=earlier.blocked_by)
    why = (
        f"nothing arrives at your node, as '{title}' says"
        if earlier.cut_off
        else f"'{title}' failed"
    )
    return dataclasses.replace(not_reached(f"Not tested, because {why}."), blocked_by=required)


def _failed_before(spec: CheckSpec, findings: Mapping[str, Finding], rubric: Rubric) -> str | None:
    """Return the first check of a session that failed, for which a later one could not be reached."""
    earlier = (
        check.id
        for check in rubric.checks()
        if check.session == spec.session and check.id in findings
    )
    return next((name for name in earlier if findings[name].outcome is Outcome.FAILED), None)


def _found(spec: CheckSpec, context: Context) -> Finding:
    """Return what the check itself finds; a broken one never costs points, and does not take the others with it."""
    try:
        # Students may publish the largest numbers that there are.
        with patterns_bounded() as budget, np.errstate(over="ignore", invalid="ignore"):
            finding = check_given(spec.check, spec.parameters).judge(context, spec.parameters)
    except (Exception, SystemExit) as problem:  # A lab's file may end the program that loads it.
        return Finding(
            Outcome.ERROR,
            Decimal(0),
            reason=f"The check failed with an error: {type(problem).__name__}: {problem}",
        )
    if budget.exceeded:
        return dataclasses.replace(finding, notes=(*finding.notes, f"'{spec.title}': {NOTE}"))
    return finding


def _settled(finding: Finding, recorded: Recorded) -> Finding:
    """Return what became of a finding that stayed undecided in all recordings, by what a program can do itself."""
    settled = finding.settled
    if settled is None or may_be_flaky(recorded):
        return finding
    often = f"The session was recorded {recorded.record.times_recorded} times; a program can cause this by itself."
    return dataclasses.replace(settled, reason=f"{settled.reason} {often}")


def _faults(recorded: Recorded) -> list[str]:
    """Return what is wrong with a recording on the grader's side."""
    students = gaps_by_student(recorded)
    gaps = [describe_gap(gap) for gap in recorded.record.unrecorded if gap not in students]
    faults = [*recorded.record.problems, *gaps]
    if not recorded.record.complete:
        return [*faults, "The recording was cut off."]
    # Unreadable messages must not count as silence of a node.
    if recorded.bag.damage:
        faults.append(f"The bag is damaged: {'; '.join(recorded.bag.damage)}.")
    elif not recorded.bag.finished:
        faults.append("The bag is damaged or incomplete.")
    return faults


def _as_far_as_recorded(finding: Finding, spec: CheckSpec, recorded: Recorded) -> Finding:
    """Limit a finding to the recorded messages, if a topic that its check rests on has others."""
    names = named(spec, recorded)
    loss = _loss_on(names, recorded)
    if loss is not None:
        return undecided(finding, loss)
    if finding.outcome is Outcome.ERROR:
        return finding
    if check_given(spec.check, spec.parameters).by_endpoints:
        if finding.outcome in _GOES_ON:
            return finding
    else:
        strange = _not_understood(recorded, names)
        if strange:
            return undecided(finding, strange, retry=False)
    gap = _gap_on(names, recorded)
    if gap is None:
        return finding
    if isinstance(gap, UnreadGap) and not is_unread_by_student(recorded, gap):
        return undecided(finding, describe_gap(gap), retry=False)
    return without_rest(finding, gap, timed=is_timed(spec, recorded))


def _loss_on(topics: Collection[str], recorded: Recorded) -> str | None:
    """Return the sentence on the first topic that lost messages of the grader; None without such."""
    for topic, text in dropped(recorded).items():
        if topic in topics:
            return text
    return None


def _gap_on(topics: Collection[str], recorded: Recorded) -> RecordingGap | None:
    """Return the first gap by the student on some topics, else the first messages there that were not decoded."""
    for gap in gaps_by_student(recorded):
        if gap.topic in topics:
            return gap
    for topic in sorted(topics):
        rest = unread(recorded, topic)
        if rest is not None:
            return rest
    return None


def _not_understood(recorded: Recorded, topics: Collection[str]) -> str:
    """Say of which topic the recorded definition cannot be understood; empty if of none."""
    for topic in sorted(topics):
        if not recorded.bag.stream(topic).understood:
            return f"The grader cannot decode the messages on {topic}: it does not understand the definition of their type."
    return ""


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
                hit = hit_limit(dataclasses.replace(process, limit=limits.get(process.name)))
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
