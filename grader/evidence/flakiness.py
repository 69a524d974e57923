"""Flakiness: events that correct programs meet occasionally too, so that a single one is not conclusive."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from grader.evidence.cpu_delay import Span
from grader.evidence.crash.diagnosis import HIT_IN_A_CALL, ended_by_limit
from grader.evidence.crash.tracebacks import Raised, tracebacks
from grader.evidence.recorded import Recorded
from grader.lab.steps.call import CallResult, CallStep
from grader.lab.steps.change_state import ChangeStateStep
from grader.lab.steps.get_parameters import GetParametersStep
from grader.lab.steps.send_goal import SendGoalResult, SendGoalStep
from grader.lab.steps.set_parameters import SetParametersStep
from grader.lab.steps.start import StartResult, StartStep
from grader.lab.steps.wait_for import WaitForStep
from grader.recording.session import Claim, ProcessRun, StepRun

_KILLED = (-9, 137)
#: Complaints of programs that may have no more threads or processes. The kernel counts those of a user, and another
#: container on the machine can have the same user.
_NO_MORE_TASKS = ("Resource temporarily unavailable", "can't start new thread")
#: Recordings up to which a program's own complaint counts, because it can be made up.
_FLAKY_RECORDINGS = 2
#: Share of a wait from which a delay of the machine can be its cause.
_STALLED = 0.5
#: Longest delay of a usual start, in s.
_LEAST_STALL_S = 0.6
#: Undelayed time that is enough for any start, in s.
_ENOUGH_S = 3.0
#: Functions that wait, where a program must expect Ctrl-C.
_SPINNING = {"spin", "spin_once", "spin_until_future_complete"}
_STOPPED_FROM_OUTSIDE = ("interrupt", "terminate", "kill")


def inconclusive_reason(recorded: Recorded, reference_nodes: Iterable[str]) -> str | None:
    """Say why a session must be recorded again before it costs points; None if it need not."""
    stalled = _stalled(recorded)
    if stalled is not None:
        return stalled
    students = recorded.students
    if may_be_flaky(recorded) and any(map(_was_refused_tasks, students)):
        return "A program could not start a thread although it had few: the machine may have run out of them."
    if recorded.record.times_recorded > 1:
        return None
    return _occasional(recorded, students, frozenset(reference_nodes))


def _occasional(
    recorded: Recorded, students: Sequence[ProcessRun], reference_nodes: frozenset[str]
) -> str | None:
    """Describe a failure that is not conclusive in a first recording."""
    if any(map(_was_killed_by_others, students)):
        return "A program was killed, but not by this session; the system does that when memory is short."
    if _no_node_came(recorded, students, reference_nodes):
        return "The program ran, but its node did not appear in time. A single occurrence is not conclusive."
    late = _came_late(recorded)
    if late is not None:
        return f"{late} came too late for this. A single occurrence is not conclusive."
    return None


def may_be_flaky(recorded: Recorded) -> bool:
    """Return whether a program's own complaint may leave points undecided; not for ever, as it can be made up."""
    return recorded.record.times_recorded <= _FLAKY_RECORDINGS


def flaky_end(run: ProcessRun) -> str:
    """Describe an event at Ctrl-C that correct programs meet occasionally too; empty if there was none."""
    if any(HIT_IN_A_CALL in line.text for line in run.output):
        return "Ctrl-C arrived inside a call into rclpy and became another error; a correct program can meet this too."
    if not run.interrupted_ns:
        return ""
    raised = tracebacks(run.output)
    if raised and _interrupted_late(raised[-1]):
        return "Ctrl-C was raised after rclpy.spin() had ended already; a correct program can meet this too."
    if run.ended_by in ("terminate", "kill"):
        return "The node did not end in time after Ctrl-C, and had to be stopped before it printed its results."
    return ""


def _interrupted_late(raised: Raised) -> bool:
    """Return whether Ctrl-C was raised outside the functions that wait."""
    if raised.name != "KeyboardInterrupt":
        return False
    return all(frame.function not in _SPINNING for frame in raised.frames)


@dataclass
class _Waits:
    """Waits in vain since the last start of a program."""

    #: Names that did not come while the machine delayed a process, with the length of the delay.
    late: dict[str, str] = field(default_factory=dict)
    #: Names that did not come in a calm time either.
    missing: set[str] = field(default_factory=set)

    def found(self) -> tuple[str, str] | None:
        """Return a name that could have come without a delay, and the length of the delay."""
        for wanted, how_long in self.late.items():
            if wanted not in self.missing:
                return wanted, how_long
        return None


def _stalled(recorded: Recorded) -> str | None:
    """Say that something did not come in time while the machine delayed a process; None if all came.

    A name that did not come in a calm time either, with no program started in between, would not have come without the
    delay.
    """
    waits = _Waits()
    came_ns = _came_ns(recorded)
    for step in recorded.record.steps:
        if step.kind == StartStep.kind and StartResult.of(step).started is not False:
            if waits.found() is not None:
                break
            waits = _Waits()
        span = Span(step.started_ns, step.ended_ns)
        if step.outcome != "timeout" or span.duration_s < _LEAST_STALL_S:
            continue
        wanted = recorded.used(_wanted(step))
        if not _could_come(recorded, step, wanted):
            continue
        delay_s = recorded.longest_delay_s(span) + recorded.recorder_delay_s(span)
        enough_s = span.duration_s - _ENOUGH_S
        if delay_s <= max(_LEAST_STALL_S, _STALLED * span.duration_s, enough_s):
            # A name of a previous wait has not come since either, unless it is in the graph.
            waits.missing |= waits.late.keys() - came_ns.keys()
            waits.missing.add(wanted)
            waits.missing.discard("")
        elif not recorded.students_busy(span):
            shown_s = min(delay_s, span.duration_s)
            waits.late[wanted] = f"for {shown_s:.1f} s of {span.duration_s:.1f} s"
    found = waits.found()
    if found is None:
        return None
    wanted, how_long = found
    missing = f"{wanted} did not appear" if wanted else "An answer did not come"
    return f"{missing} in time while the grading computer was busy {how_long}."


def _could_come(recorded: Recorded, step: StepRun, wanted: str) -> bool:
    """Return whether a program that may bring a name ran until the end of the wait for the name.

    A program that ended by itself brings nothing any more. The claims show which program asked for the name, if one did.
    """
    going_on = set()
    for run in recorded.students:
        ended = run.ended_by == "itself" and run.interrupted_ns is None
        is_over = ended and run.exited_ns is not None and run.exited_ns < step.ended_ns
        if not is_over:
            going_on.add(run.name)
    asked = {claim.process for claim in recorded.record.claims if _is_of(claim, wanted)}
    if not recorded.students:
        return True
    return bool(going_on & asked) if asked else bool(going_on)


def _is_of(claim: Claim, wanted: str) -> bool:
    """Return whether a claim is about a name, in any namespace; of no claim for an empty name."""
    name = wanted.rsplit("/", 1)[-1]
    return bool(name) and name in (claim.name.rsplit("/", 1)[-1], claim.node.rsplit("/", 1)[-1])


def _was_refused_tasks(run: ProcessRun) -> bool:
    """Return whether a program ended because it could start no thread, without reaching a limit of the session."""
    if run.ended_by != "itself" or run.limit is not None:
        return False
    if not run.output:
        return False
    last = run.output[-1].text
    return any(words in last for words in _NO_MORE_TASKS)


def _was_killed_by_others(run: ProcessRun) -> bool:
    """Return whether the system killed a program, and not this session."""
    if run.exit_status not in _KILLED or run.ended_by != "itself":
        return False
    return not ended_by_limit(run)


def _no_node_came(
    recorded: Recorded, students: Iterable[ProcessRun], reference_nodes: frozenset[str]
) -> bool:
    """Return whether a session waited in vain for a node of a program that ran on, and hit no limit."""
    if not any(_waited_in_vain(step) for step in recorded.record.steps):
        return False
    asked: set[str] = set()
    if set(recorded.nodes) - reference_nodes:
        asked = {claim.process for claim in recorded.record.claims}
    for run in students:
        ran_on = run.ended_by in _STOPPED_FROM_OUTSIDE and run.limit is None
        if ran_on and run.name not in asked:
            return True
    return False


def _waited_in_vain(step: StepRun) -> bool:
    return step.kind == "wait_for" and step.outcome == "timeout"


def _came_late(recorded: Recorded) -> str | None:
    """Return a name that came into the graph only after the session had waited for it, or called it, in vain."""
    came_ns = _came_ns(recorded)
    for step in recorded.record.steps:
        if step.outcome == "timeout" and step.kind in ("wait_for", "call", "send_goal"):
            wanted = _wanted(step)
            if came_ns.get(recorded.used(wanted), 0) > step.ended_ns:
                return wanted
    return None


def _came_ns(recorded: Recorded) -> dict[str, int]:
    """Return the time at which each name was first in the graph."""
    came_ns: dict[str, int] = {}
    for graph in recorded.record.graph:
        for name in graph.nodes:
            came_ns.setdefault(name, graph.t_ns)
        for endpoint in graph.endpoints:
            came_ns.setdefault(endpoint.topic, graph.t_ns)
        for server in (*graph.services, *graph.actions, *graph.action_clients):
            came_ns.setdefault(server.name, graph.t_ns)
    return came_ns


def _wanted(step: StepRun) -> str:
    """Return the name that a step waited for; empty if it was up, because then its requests got no answer."""
    if step.kind == CallStep.kind:
        return "" if CallResult.of(step).calls else CallStep.given(step).service
    if step.kind == SendGoalStep.kind:
        return "" if SendGoalResult.of(step).goals else SendGoalStep.given(step).action
    if step.kind == WaitForStep.kind:
        _, name = WaitForStep.given(step).awaited
        return name
    for model in (GetParametersStep, SetParametersStep, ChangeStateStep):
        if step.kind == model.kind:
            return model.given(step).node
    return ""
