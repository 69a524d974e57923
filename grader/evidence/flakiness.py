"""Flakiness: what correct programs meet once in a while too, so that a single occurrence is not conclusive."""

from __future__ import annotations

from collections.abc import Iterable

from grader.evidence.cpu_delay import Span
from grader.evidence.crash.diagnosis import HIT_IN_A_CALL, ended_by_limit
from grader.evidence.crash.tracebacks import tracebacks
from grader.evidence.recorded import Recorded
from grader.lab.steps.call import CallResult, CallStep
from grader.lab.steps.change_state import ChangeStateStep
from grader.lab.steps.get_parameters import GetParametersStep
from grader.lab.steps.send_goal import SendGoalResult, SendGoalStep
from grader.lab.steps.set_parameters import SetParametersStep
from grader.lab.steps.start import StartResult, StartStep
from grader.lab.steps.wait_for import WaitForStep
from grader.recording.session import ProcessRun, StepRun

_KILLED = (-9, 137)
#: What programs say when they may have no more threads or processes. The kernel counts those of a user, and in
#: another container on the machine somebody else may have the same.
_NO_MORE_TASKS = ("Resource temporarily unavailable", "can't start new thread")
#: Recordings up to which that counts; what a program reports of itself can be made up.
_FLAKY_RECORDINGS = 2
#: Share of the time for which something was waited for in vain, from which it may be the machine's doing that it did
#: not come.
_STALLED = 0.5
#: Shorter delays are those of any start, and who had so much time without one had enough for it, wherever that lay.
_LEAST_STALL_S, _ENOUGH_S = 0.6, 3.0
#: Within these a program waits, and has to expect Ctrl-C.
_SPINNING = {"spin", "spin_once", "spin_until_future_complete"}


def inconclusive_reason(recorded: Recorded, reference_nodes: Iterable[str]) -> str | None:
    """Say what in the recording of a session has to be seen again before it costs anything; None if nothing."""
    students = [run for run in recorded.record.processes if run.role == "student"]
    if (stalled := _stalled(recorded)) is not None:
        return stalled
    if may_be_flaky(recorded) and any(_was_refused_tasks(run) for run in students):
        return "A program could not start a thread although it had few: the machine may have run out of them."
    if recorded.record.times_recorded > 1:
        return None
    killed = (run for run in students if run.exit_status in _KILLED and run.ended_by == "itself")
    if any(not ended_by_limit(run) for run in killed):
        return "A program was killed, but not by this session; the system does that when memory is short."
    if _nobody_came(recorded, students, frozenset(reference_nodes)):
        return "The program ran, but its node did not appear in time. A single occurrence is not conclusive."
    if (late := _came_late(recorded)) is not None:
        return f"{late} came too late for this. A single occurrence is not conclusive."
    return None


def may_be_flaky(recorded: Recorded) -> bool:
    """Whether what a program alone says of itself may leave something undecided: not for ever, as it can be made up."""
    return recorded.record.times_recorded <= _FLAKY_RECORDINGS


def flaky_end(run: ProcessRun) -> str:
    """Say what befell a program at Ctrl-C that correct ones meet too now and then, if anything."""
    if any(HIT_IN_A_CALL in line.text for line in run.output):
        return "Ctrl-C arrived inside a call into rclpy and became another error; a correct program can meet this too."
    raised = tracebacks(run.output)[-1:] if run.interrupted_ns else []
    if any(
        end.name == "KeyboardInterrupt" and not _SPINNING & {f.function for f in end.frames}
        for end in raised
    ):
        return "Ctrl-C was raised after rclpy.spin() had ended already; a correct program can meet this too."
    if run.interrupted_ns and run.ended_by in ("terminate", "kill"):
        return "The node did not end in time after Ctrl-C, and had to be stopped before it printed its results."
    return ""


def _stalled(recorded: Recorded) -> str | None:
    """Say that something did not come in time while the machine delayed a process, if so.

    What does not come in a calm time either, with nothing started between, would not have come without that delay.
    """
    late: dict[str, str] = {}
    missing: set[str] = set()
    came_ns = _came_ns(recorded)
    for step in recorded.record.steps:
        if step.kind == StartStep.kind and StartResult.of(step).started is not False:
            if late.keys() - missing:
                break
            late, missing = {}, set()
        span, wanted = Span(step.started_ns, step.ended_ns), recorded.used(_wanted(step))
        if step.outcome != "timeout" or span.duration_s < _LEAST_STALL_S:
            continue
        delay_s = recorded.longest_delay_s(span) + recorded.recorder_delay_s(span)
        if delay_s <= max(_LEAST_STALL_S, _STALLED * span.duration_s, span.duration_s - _ENOUGH_S):
            # What was waited for before has not come since either.
            missing |= {wanted, *(late.keys() - came_ns.keys())} - {""}
        elif not recorded.students_busy(span):
            late[wanted] = f"for {min(delay_s, span.duration_s):.1f} s of {span.duration_s:.1f} s"
    for wanted, how_long in late.items():
        if wanted not in missing:
            return (
                f"Something did not appear in time while the grading computer was busy {how_long}."
            )
    return None


def _was_refused_tasks(run: ProcessRun) -> bool:
    """Whether a program ended with that complaint, without having reached a limit of the session."""
    last = run.output[-1].text if run.output else ""
    return (
        run.ended_by == "itself"
        and run.limit is None
        and any(words in last for words in _NO_MORE_TASKS)
    )


def _nobody_came(
    recorded: Recorded, students: Iterable[ProcessRun], reference_nodes: frozenset[str]
) -> bool:
    """Whether something was waited for in vain while a program showed no node, had to be stopped, and hit no limit."""
    waited = any(
        step.kind == "wait_for" and step.outcome == "timeout" for step in recorded.record.steps
    )
    ran_on = [
        run.name
        for run in students
        if run.ended_by in ("interrupt", "terminate", "kill") and run.limit is None
    ]
    asked = (
        {claim.process for claim in recorded.record.claims}
        if set(recorded.nodes) - reference_nodes
        else set()
    )
    return waited and not asked.issuperset(ran_on)


def _came_late(recorded: Recorded) -> str | None:
    """Return what the session waited for, or called, in vain, although it came into the graph after that."""
    came_ns = _came_ns(recorded)
    for step in recorded.record.steps:
        if step.outcome == "timeout" and step.kind in ("wait_for", "call", "send_goal"):
            wanted = _wanted(step)
            if came_ns.get(recorded.used(wanted), 0) > step.ended_ns:
                return wanted
    return None


def _came_ns(recorded: Recorded) -> dict[str, int]:
    """Return when each name was first in the graph."""
    came_ns: dict[str, int] = {}
    for graph in reversed(recorded.record.graph):
        servers = [s.name for s in (*graph.services, *graph.actions, *graph.action_clients)]
        names = [*graph.nodes, *(e.topic for e in graph.endpoints), *servers]
        came_ns |= dict.fromkeys(names, graph.t_ns)
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
