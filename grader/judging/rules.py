"""The rules of judging a check, in their order; each is a function of a case and gives a finding or None."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np

from grader.checks.base import inconclusive, not_reached, undecided
from grader.checks.preconditions import (
    DOUBTS,
    artifact_of,
    in_other_domain,
    missing_artifact,
    missing_file,
)
from grader.checks.registry import check_given
from grader.checks.registry import measured as check_measured
from grader.checks.situation import Situation, first_answer, last_answer
from grader.evidence.flakiness import inconclusive_reason, may_be_flaky
from grader.evidence.gaps import (
    UnreadGap,
    describe_gap,
    dropped,
    gaps_by_student,
    is_unread_by_student,
    unread,
)
from grader.evidence.recorded import Recorded
from grader.evidence.session_variables import Asked, asked_in, leave_domain
from grader.judging.invalidated import Referents, not_measurable, referents, without_rest
from grader.lab.patterns import patterns_bounded
from grader.lab.rubric import CheckSpec, Rubric
from grader.recording.session import RecordingGap
from grader.result import FOR_A_PERSON, Finding, Location, Outcome, Violation

#: Reason of a session that judging leaves out.
TOO_LARGE = (
    "The session was recorded, but judging it takes more time or memory than the grader allows (limit: judging). "
    "A person has to decide."
)
_NOT_READ = f"{FOR_A_PERSON} comparing the text with the rubric's patterns took too long, so the rest was not read."


@dataclass(frozen=True, kw_only=True)
class Case(Situation):
    """One check of a rubric, with all that decides about it."""

    spec: CheckSpec
    rubric: Rubric
    #: Tampering with something on which the check depends.
    violation: Violation | None = None
    #: True if the recording of the session is too large to be judged.
    is_too_large: bool = False
    #: Id of a failed check that this one requires, and that is passed in another session; the recording is of that one.
    shown_elsewhere: str | None = None

    @property
    def recorded(self) -> Recorded | None:
        """The recording of the check's session."""
        return self.context.recorded

    def referents(self) -> Referents:
        """Return the names and steps in the recording to which the check refers."""
        return referents(self.spec, self.context.session)


Rule = Callable[[Case], Finding | None]

# -- before the measurement ------------------------------------------------------------------------


def required(case: Case) -> Finding | None:
    """Do not test a check if one that it requires has failed, was not tested, or is undecided."""
    for id_ in case.spec.requires:
        earlier = case.context.findings.get(id_)
        if id_ == case.shown_elsewhere or earlier is None:
            continue
        if not _goes_on(case, earlier):
            return _not_tested(case, id_, earlier)
    return None


def _goes_on(case: Case, earlier: Finding) -> bool:
    """Tell whether a check that requires another one can be judged after its finding."""
    if earlier.is_silent:
        return is_by_endpoints(case.spec)
    if earlier.passes_on is not None:
        return earlier.passes_on > 0
    return earlier.outcome.goes_on


def _not_tested(case: Case, required_id: str, earlier: Finding) -> Finding:
    """State that a check could not be tested because of an earlier one."""
    title = case.context.titles[required_id]
    if not earlier.outcome.decided:
        return inconclusive("", "", f"Depends on '{title}', which is not decided yet.", retry=False)
    if earlier.outcome is Outcome.NOT_REACHED:
        return not_reached(earlier.reason, blocked_by=earlier.blocked_by)
    why = f"'{title}' failed"
    if earlier.is_silent:
        why = f"no messages were recorded, as '{title}' says"
    elif earlier.passes_on is not None:
        why = f"nothing arrives at your node, as '{title}' says"
    return not_reached(f"Not tested, because {why}.", blocked_by=required_id)


def too_large(case: Case) -> Finding | None:
    """Leave the check to a person if judging its session takes more time or memory than allowed."""
    if not case.is_too_large:
        return None
    return inconclusive("", "", TOO_LARGE, retry=False)


def not_recorded(case: Case) -> Finding | None:
    """Fail the check if its session was not recorded because its file is missing; otherwise leave it undecided."""
    session = case.spec.session
    if session is None or case.recorded is not None:
        return None
    needed = case.rubric.needed_first(case.spec)
    missing = missing_artifact(case.context, needed or None)
    return missing or inconclusive("", "", f"The session '{session}' was not recorded.")


def disturbed(case: Case) -> Finding | None:
    """Fail the check if the student's programs disturbed the recording more than once."""
    if case.violation is None or not case.violation.kind.disturbs:
        return None
    return not_measurable("", case.violation)


def unsound(case: Case) -> Finding | None:
    """Leave the check undecided if its session was not carried out or recorded as planned."""
    if case.recorded is None:
        return None
    found = faults(case.recorded)
    if not found:
        return None
    reason = f"The session could not be carried out as planned: {'; '.join(found)}"
    return inconclusive("", "", reason)


def faults(recorded: Recorded) -> list[str]:
    """Return the faults of a recording on the grader's side."""
    students = gaps_by_student(recorded)
    found = list(recorded.record.problems)
    for gap in recorded.record.unrecorded:
        if gap not in students:
            found.append(describe_gap(gap))
    if not recorded.record.complete:
        return [*found, "The recording was cut off."]
    # Unreadable messages must not count as silence of a node.
    if recorded.bag.damage:
        found.append(f"The bag is damaged: {'; '.join(recorded.bag.damage)}.")
    elif not recorded.bag.finished:
        found.append("The bag is damaged or incomplete.")
    return found


# -- the measurement -------------------------------------------------------------------------------


def measure(case: Case) -> Finding:
    """Return the finding of the check itself, by the rules about its file, its measurement and its program.

    A check that breaks costs nothing and leaves the other checks alone.
    """
    try:
        # Students may publish the largest numbers that there are.
        with patterns_bounded() as budget, np.errstate(over="ignore", invalid="ignore"):
            finding = check_given(case.spec.check, case.spec.parameters).judge(
                case.context, case.spec.parameters
            )
    except (Exception, SystemExit) as problem:  # A lab's file may end the program that loads it.
        reason = f"The check failed with an error: {type(problem).__name__}: {problem}"
        error = Finding(Outcome.ERROR, Decimal(0), reason=reason)
        return replace(error, decided_by=check_measured.__name__)
    if budget.exceeded:
        return replace(finding, notes=(*finding.notes, f"'{case.spec.title}': {_NOT_READ}"))
    return finding


# -- doubts about the recording --------------------------------------------------------------------


def repeated(case: Case) -> Finding | None:
    """Decide a doubt that a program can cause by itself once its session has been recorded three times."""
    settled = case.found.settled
    if settled is None or case.recorded is None or may_be_flaky(case.recorded):
        return None
    times = case.recorded.record.times_recorded
    often = f"The session was recorded {times} times; a program can cause this by itself."
    reason = f"{settled.reason} {often}"
    return replace(settled, reason=reason.strip())


def left_out(case: Case) -> Finding | None:
    """Fail the check if messages of the student were too many to be recorded or read.

    If the grader published most of them, a person decides. A check of endpoints passes without the messages, and names
    the limit.
    """
    if not _rests_on_messages(case):
        return None
    gap = _gap_on(case.referents(), case.context.session)
    if gap is None:
        return None
    if is_by_endpoints(case.spec) and case.found.outcome.goes_on:
        notes = (*case.found.notes, describe_gap(gap))
        return replace(case.found, notes=notes)
    if isinstance(gap, UnreadGap) and not is_unread_by_student(case.context.session, gap):
        return undecided(case.found, describe_gap(gap), retry=False)
    return without_rest(case.found, gap, timed=case.referents().is_timed)


def not_understood(case: Case) -> Finding | None:
    """Leave the check to a person if the grader cannot decode the messages on one of its topics."""
    if not _rests_on_messages(case) or is_by_endpoints(case.spec):
        return None
    for topic in sorted(case.referents().names):
        if not case.context.session.bag.stream(topic).understood:
            reason = (
                f"The grader cannot decode the messages on {topic}: it does not understand the "
                "definition of their type."
            )
            return undecided(case.found, reason, retry=False)
    return None


def _rests_on_messages(case: Case) -> bool:
    return case.recorded is not None and case.found.outcome is not Outcome.ERROR


def is_by_endpoints(spec: CheckSpec) -> bool:
    """Tell whether a check can be passed without all messages of its topics."""
    return check_given(spec.check, spec.parameters).by_endpoints


def _gap_on(of: Referents, recorded: Recorded) -> RecordingGap | None:
    """Return the first gap by the student on some topics, else the first messages there that were not decoded."""
    for gap in gaps_by_student(recorded):
        if gap.topic in of.names:
            return gap
    for topic in sorted(of.names):
        rest = unread(recorded, topic)
        if rest is not None:
            return rest
    return None


def messages_dropped(case: Case) -> Finding | None:
    """Leave the check undecided if messages of the grader are missing on a topic of the check."""
    if case.recorded is None:
        return None
    names = case.referents().names
    for topic, text in dropped(case.recorded).items():
        if topic in names:
            return undecided(case.found, text)
    return None


def tampered(case: Case) -> Finding | None:
    """Fail the check if the student's programs tampered with something that it measures."""
    if case.violation is None:
        return None
    return not_measurable(case.found.expected, case.violation)


def cut_short(case: Case) -> Finding | None:
    """Name the first failed check of the session as the cause if the session did not get as far as this check."""
    if case.found.outcome is not Outcome.NOT_REACHED:
        return None
    for spec in case.rubric.checks():
        earlier = case.context.findings.get(spec.id)
        if earlier is None or spec.session != case.spec.session:
            continue
        if earlier.outcome is Outcome.FAILED:
            return replace(case.found, blocked_by=spec.id)
    return None


def flaky(case: Case) -> Finding | None:
    """Leave lost points undecided if correct programs sometimes meet the same fault, until it is seen again.

    No machine sends a program into the other ROS domain that its source sets.
    """
    if case.recorded is None or not case.took_points:
        return None
    if in_other_domain(case, artifact_of(case.context, case.spec.parameters)):
        return None
    reason = inconclusive_reason(case.recorded, case.context.reference_nodes)
    return undecided(case.found, reason) if reason is not None else None


# -- consequences of other checks ------------------------------------------------------------------


def other_domain(case: Case) -> Finding | None:
    """Charge a ROS domain of the program's own like another name of an endpoint; the rest is judged in the session's."""
    costs = getattr(case.spec.parameters, "other_domain_costs", 0.0)
    if not case.found.credit:
        return None
    if not costs:
        return None
    asked = _other_domain_of(case)
    if asked is None:
        return None
    says = f"{asked.place} chooses the ROS domain {asked.value}. No program of the lab is there."
    judged = f"{says} To judge the rest, the program ran in the domain of the session."
    charged = replace(
        case.found,
        outcome=Outcome.FAILED,
        credit=max(Decimal(0), case.found.credit - Decimal(str(costs))),
        reason=f"{judged} {case.found.reason}".strip(),
        measured=f"nothing in the domain of the lab; in the domain of the session, {case.found.measured}",
        hint=leave_domain(asked.place),
        where=(Location(file=asked.file, line=asked.line), *case.found.where),
    )
    if charged.credit:
        charged = replace(charged, outcome=Outcome.PARTIAL)
    return case.context.charge(charged, f"domain of {asked.file}")


def _other_domain_of(case: Case) -> Asked | None:
    """Return the first ROS domain of their own in the programs of a check; None if there is none."""
    if case.recorded is None:
        return None
    artifact = getattr(case.spec.parameters, "artifact", None)
    for asked in asked_in(case.recorded, case.context.submission, artifact):
        if asked.is_other_domain:
            return asked
    return None


def repaired(case: Case) -> Finding | None:
    """Give a share of the credit if a required file failed and was repaired on a copy."""
    finding = case.found
    id_ = _first_repaired(case, case.spec)
    if id_ is None or not finding.credit:
        return None
    earlier = case.context.findings[id_]
    share = earlier.passes_on or Decimal(1)
    title = case.context.titles[id_]
    reason = f"Judged as if '{title}' were right; {1 - float(share):.0%} are lost by that."
    return replace(
        finding,
        outcome=Outcome.PARTIAL,
        credit=finding.credit * share,
        reason=f"{reason} {finding.reason}".strip(),
        hint=finding.hint or earlier.hint,
    )


def _first_repaired(case: Case, spec: CheckSpec) -> str | None:
    """Return the id of the first check with a repaired file that one requires, directly or not."""
    by_id = {each.id: each for each in case.rubric.checks()}
    for id_ in spec.requires:
        earlier = case.context.findings.get(id_)
        if earlier is not None and earlier.passes_on:
            return id_
        further = _first_repaired(case, by_id[id_])
        if further is not None:
            return further
    return None


def excused(case: Case) -> Finding | None:
    """Charge a mistake once: excuse the check if another one charges the same mistake."""
    finding = case.context.charge(case.found, case.spec.cause, case.spec.excused_by)
    if finding.outcome is not Outcome.EXCUSED:
        return None
    return finding


#: Rules that need no measurement; the first answer ends it.
BEFORE: Sequence[Rule] = (required, too_large, not_recorded, disturbed, unsound)
#: Rules about the recording.
RECORDING: Sequence[Rule] = (
    repeated,
    left_out,
    not_understood,
    messages_dropped,
    tampered,
    cut_short,
    flaky,
)
#: Rules about other checks, also without a measurement.
CONSEQUENCES: Sequence[Rule] = (other_domain, repaired, excused)
#: All rules in their order; `docs/judging.md` lists them.
RULES = (*BEFORE, missing_file, check_measured, *DOUBTS, *RECORDING, *CONSEQUENCES)


def decide(case: Case) -> Finding:
    """Return the finding of a case, with the rule that decided it."""
    finding = first_answer(case, BEFORE)
    if finding is None:
        measurement = replace(case, finding=measure(case))
        finding = with_hint(case.spec, last_answer(measurement, RECORDING))
    decided = last_answer(replace(case, finding=finding), CONSEQUENCES)
    return case.context.charge(decided, case.spec.cause)


def with_hint(spec: CheckSpec, finding: Finding) -> Finding:
    """Return a finding with the hint of the rubric if it lost points and has no hint of its own."""
    if finding.hint or not finding.outcome.took_points:
        return finding
    return replace(finding, hint=spec.hint)


def sentence_of(rule: str | None) -> str:
    """Return the sentence about a rule, by its name in a result; empty for an unknown name."""
    for each in RULES:
        if each.__name__ == rule:
            paragraph = inspect.getdoc(each) or ""
            return " ".join(paragraph.partition("\n\n")[0].split())
    return ""
