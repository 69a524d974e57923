"""The judging half in one place: recordings + submission facts + rubric → result. Pure.

No ROS, no processes, no clock, no randomness: the same recording and rubric give the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from grader.checks.base import Context
from grader.checks.commands import commands_of
from grader.errors import RecordingError
from grader.evidence.integrity import tampering_in
from grader.evidence.recorded import Recorded
from grader.judging.causes import are_contested, charges_of, with_charges
from grader.judging.elsewhere import evidence_elsewhere, with_origin
from grader.judging.invalidated import with_checks
from grader.judging.names import names_not_awaited
from grader.judging.provenance import provenance_of
from grader.judging.remarks import advisories_of, chosen_files
from grader.judging.rules import TOO_LARGE, Case, decide, faults
from grader.judging.score import score_criteria, total
from grader.lab.rubric import CheckSpec, Rubric
from grader.recording.session import SESSION_FILE
from grader.recording.submission import SubmissionRecord, read_submission
from grader.result import Finding, Result, Violation
from ros_bag.elements import MOST_VALUES


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

    def of(self, spec: CheckSpec) -> Recorded | None:
        """Return the recording of a check's session."""
        return self.sessions.get(spec.session) if spec.session is not None else None


@dataclass(frozen=True)
class Effort:
    """Limits of judging recordings: the values decoded of a topic, and the sessions left out as too large."""

    most_values: int = MOST_VALUES
    too_much: frozenset[str] = frozenset()


#: All of them.
FULL = Effort()


def open_recordings(folder: Path, rubric: Rubric, effort: Effort = FULL) -> Recordings:
    """Open `recordings/` of one submission.

    Raises
    ------
    RecordingError
        The folder holds no recordings, or recordings of another version.
    """
    submission = _read_submission(folder)
    sessions = {}
    problems = []
    for name in rubric.sessions:
        if not (folder / name / SESSION_FILE).exists():
            continue
        if name in effort.too_much:
            problems.append(f"{name}: {TOO_LARGE}")
            continue
        recorded = _open_session(folder / name, effort)
        if recorded is None:
            problems.append(f"The recording '{name}' has no bag; its checks are undecided.")
            continue
        recorded.record.names.update(names_not_awaited(recorded, rubric))
        sessions[name] = recorded
        problems += [f"{name}: {fault}" for fault in faults(recorded)]
    return Recordings(submission, sessions, tuple(problems), effort.too_much)


def _read_submission(folder: Path) -> SubmissionRecord:
    """Read the facts about a submission; raises RecordingError if there are none."""
    try:
        return read_submission(folder)
    except (OSError, ValueError) as problem:
        raise RecordingError(
            "this is not a folder of recordings",
            location=str(folder),
            remedy=f"Give a results folder of `grade`. ({problem})",
        ) from problem


def _open_session(folder: Path, effort: Effort) -> Recorded | None:
    """Open the recording of a session, None without a bag; raises RecordingError if it cannot be read."""
    try:
        return Recorded.open(folder, effort.most_values)
    except FileNotFoundError:
        return None
    except ValueError as problem:
        raise RecordingError(
            "a recording cannot be read",
            location=str(folder),
            remedy=f"It may be of another version. ({problem})",
        ) from problem


def violations_of(recordings: Recordings, rubric: Rubric) -> tuple[Violation, ...]:
    """Return the tampering in the sessions, with the checks that cannot be judged because of it.

    A session with an unreadable message shows none, because such a message looks like a removed one.
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
    """Judge all checks of the chosen sessions, in the rubric's order.

    If two checks lose points by the same mistake, all are judged again, and only the dearest is charged.
    """
    judged = _judge_once(recordings, rubric, violations, {})
    if are_contested(judged):
        judged = _judge_once(recordings, rubric, violations, charges_of(judged))
    return {case.spec.id: case.found for case in judged}


def _judge_once(
    recordings: Recordings,
    rubric: Rubric,
    violations: Sequence[Violation],
    charges: Mapping[str, str],
) -> list[Case]:
    """Judge all checks of the chosen sessions, given the check charged for each mistake: cause -> id."""
    findings: dict[str, Finding] = {}
    context = _context(recordings, rubric, findings)
    untouched = _without_tampering(context, violations)
    specs = {spec.id: spec for spec in rubric.checks()}
    judged = []
    for spec in _checks_to_judge(recordings, rubric, context):
        gate, other = evidence_elsewhere(spec, specs, untouched)
        case = Case(
            spec=spec,
            rubric=rubric,
            context=replace(context, recorded=other or recordings.of(spec)),
            violation=_violation_of(spec, violations),
            is_too_large=spec.session in recordings.too_much,
            shown_elsewhere=gate,
        )
        charged = with_charges(case, charges)
        finding = decide(charged)
        if other is not None:
            finding = with_origin(finding, spec.session, other)
        findings[spec.id] = finding
        decided = replace(case, finding=finding)
        judged.append(decided)
    return judged


def _context(recordings: Recordings, rubric: Rubric, findings: Mapping[str, Finding]) -> Context:
    """Return the context of all checks, still without a session.

    A check is never compared with another session that cannot be read in full.
    """
    sound = {name: each for name, each in recordings.sessions.items() if each.bag.whole}
    references = frozenset(reference.node for reference in rubric.reference.values())
    titles = {spec.id: spec.title for spec in rubric.checks()}
    submission = recordings.submission
    return Context(submission, None, sound, findings, references, rubric.folder, titles=titles)


def _without_tampering(context: Context, violations: Sequence[Violation]) -> Context:
    """Return the context of all checks with the recordings that show no tampering."""
    kept = dict(context.sessions)
    for violation in violations:
        kept.pop(violation.session, None)
    return replace(context, sessions=kept)


def _violation_of(spec: CheckSpec, violations: Sequence[Violation]) -> Violation | None:
    """Return the first violation that invalidates a check; None without one."""
    for violation in violations:
        if spec.id in violation.checks:
            return violation
    return None


def _checks_to_judge(recordings: Recordings, rubric: Rubric, context: Context) -> list[CheckSpec]:
    """Return the checks of the chosen sessions, and of the bonus that was handed in."""
    bonus = _bonus_checks(rubric)
    found = []
    for spec in rubric.checks():
        # A missing bonus is no mistake.
        if spec.id in bonus and context.path_of(rubric.needed_first(spec)) is None:
            continue
        if _is_chosen(spec, recordings.submission):
            found.append(spec)
    return found


def _bonus_checks(rubric: Rubric) -> set[str]:
    """Return the ids of the checks of the bonus."""
    found: set[str] = set()
    for criterion in rubric.bonus:
        found.update(check.id for check in criterion.checks)
    return found


def _is_chosen(spec: CheckSpec, submission: SubmissionRecord) -> bool:
    """Tell whether the session of a check was to be graded; a check without a session always is."""
    if submission.sessions is None or spec.session is None:
        return True
    return spec.session in submission.sessions


def judge(recordings: Recordings, rubric: Rubric) -> Result:
    """Judge one submission."""
    submission = recordings.submission
    violations = violations_of(recordings, rubric)
    findings = judge_checks(recordings, rubric, violations)
    commands = _commands(recordings, rubric, findings)
    criteria = score_criteria(rubric.criteria, findings, commands)
    bonus = score_criteria(rubric.bonus, findings, commands)
    sessions = recordings.sessions
    return Result(
        submission=submission.name,
        lab=f"Lab {rubric.lab.id}: {rubric.lab.title}",
        score=total(criteria),
        criteria=criteria,
        bonus=bonus,
        advisories=advisories_of(sessions.values(), submission, (*criteria, *bonus)),
        problems=recordings.problems,
        provenance=provenance_of(submission, sessions, rubric),
        violations=violations,
        chosen=chosen_files(submission),
    )


def _commands(
    recordings: Recordings, rubric: Rubric, findings: Mapping[str, Finding]
) -> dict[str, tuple[str, ...]]:
    """Return the commands that show a student the fault of each check, under the names in the session."""
    commands = {}
    for spec in rubric.checks():
        if spec.id not in findings:
            continue
        recorded = recordings.of(spec)
        used = recorded.record.names if recorded is not None else {}
        finding = findings[spec.id]
        commands[spec.id] = commands_of(spec, rubric, recordings.submission, used, finding)
    return commands
