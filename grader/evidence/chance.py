"""What once in a while happens to correct programs too, so that one recording of it proves nothing."""

from __future__ import annotations

from collections.abc import Iterable

from grader.evidence.limits import ended_by_limit
from grader.evidence.recorded import Recorded
from grader.recording.session import ProcessRun

_KILLED = (-9, 137)


def may_be_chance(recorded: Recorded, reference_nodes: Iterable[str]) -> str | None:
    """Say what in the first recording of a session has to be seen again before it costs anything; None if nothing.

    Parameters
    ----------
    reference_nodes : iterable of str
        Fully qualified names of the grader's own nodes.
    """
    if recorded.record.attempt > 1:
        return None
    students = [run for run in recorded.record.processes if run.role == "student"]
    if any(_killed_by_nobody(run) for run in students):
        return "A program was killed, and by nobody of this session; the system does so when its memory is short."
    if _nobody_came(recorded, students, frozenset(reference_nodes)):
        return "The program ran, but no node of it came into the graph in time. Once is no proof."
    return None


def _killed_by_nobody(run: ProcessRun) -> bool:
    return run.exit_status in _KILLED and run.ended_by == "itself" and not ended_by_limit(run)


def _nobody_came(recorded: Recorded, students: Iterable[ProcessRun], reference_nodes: frozenset[str]) -> bool:
    """Whether programs that had to be stopped were waited for in vain, and showed no node at all."""
    waited = any(step.kind == "wait_for" and step.outcome == "timeout" for step in recorded.record.steps)
    ran_on = any(run.ended_by in ("interrupt", "terminate", "kill") for run in students)
    return waited and ran_on and not set(recorded.nodes) - reference_nodes
