"""Where a result comes from: versions, hashes, and the recorded sessions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from grader import __version__
from grader.evidence.gaps import limits_hit
from grader.evidence.recorded import Recorded
from grader.lab.kept_lab import identity_of
from grader.lab.rubric import Rubric
from grader.recording.submission import SubmissionRecord
from grader.result import Provenance, SessionProvenance

_Role = Literal["student", "reference", "grader"]
_ROLES: tuple[_Role, ...] = ("student", "reference", "grader")


def provenance_of(
    submission: SubmissionRecord, sessions: Mapping[str, Recorded], rubric: Rubric
) -> Provenance:
    """Return the provenance of the result of a submission."""
    found = Provenance(
        grader=__version__,
        lab=rubric.lab.id,
        rubric_sha256=rubric.sha256,
        lab_sha256=identity_of(rubric),
        submission_sha256=submission.sha256,
        versions=_versions(sessions),
    )
    if rubric.lab.ros:
        found["handout_ros"] = rubric.lab.ros
    found["sessions"] = {name: _session(recorded) for name, recorded in sessions.items()}
    found["left_out"] = list(submission.left_out)
    found["previous"] = []
    return found


def _versions(sessions: Mapping[str, Recorded]) -> dict[str, str]:
    """Return the versions that the first session was recorded with; empty without a session."""
    for recorded in sessions.values():
        return dict(recorded.record.versions)
    return {}


def _session(recorded: Recorded) -> SessionProvenance:
    """Return time, confinement, CPU time and limits of a session."""
    record = recorded.record
    return SessionProvenance(
        started_ns=record.started_ns,
        duration_s=round((record.ended_ns - record.started_ns) / 1e9, 3),
        seed=record.seed,
        isolation=record.isolation.get("level", "unknown"),
        cpu_s={role: _cpu_s(recorded, role) for role in _ROLES},
        limits=limits_hit(recorded),
    )


def _cpu_s(recorded: Recorded, role: _Role) -> float:
    """Return the CPU time of all processes with a role in a session, in seconds."""
    total_ns = 0
    for run in recorded.record.processes:
        if run.role == role and run.usage:
            total_ns += run.usage[-1].cpu_ns
    return round(total_ns / 1e9, 3)
